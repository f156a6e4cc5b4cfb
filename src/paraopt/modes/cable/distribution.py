"""Tensions at many poses, and along motions with the inertia of the platform."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.mechanism import Mechanism
from paraopt.modes.cable.chain import MotionChain
from paraopt.modes.cable.facets import capacity_margins, scale_moments
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.read import read_rows
from paraopt.modes.cable.statics import solve_duals
from paraopt.modes.cable.wrench import cable_functions
from paraopt.planning import Trajectory

Array = NDArray[np.float64]
Index = NDArray[np.intp]
BatchAim = Literal["least norm", "closest"]


@dataclass(frozen=True, eq=False)
class TensionBatch:
    """Hold tensions at k poses.

    Attributes:
        robot: The cable robot.
        poses: Poses, shape (k, dof).
        wrench: What the cables must balance there, w [N, N m], shape (k, dof).
        values: Tensions [N], shape (k, n); within their limits everywhere.
        residual: Norms of `W t + w` with moments over the characteristic length [N], shape (k,).
        feasible: Where tensions within the limits balance the wrench, shape (k,).
        t: Times [s], shape (k,), where the poses are those of a motion.
    """

    robot: CableRobot
    poses: Array
    wrench: Array
    values: Array
    residual: Array
    feasible: NDArray[np.bool_]
    t: Array | None = None

    @property
    def margins(self) -> Array:
        """Give the least distance of a tension to a limit at each pose [N], shape (k,)."""
        return np.asarray(np.min(np.minimum(self.values - self.robot.t_min, self.robot.t_max - self.values), axis=1))

    def check(self) -> TensionBatch:
        """Give itself where every pose is feasible.

        Raises:
            InfeasibleError: A pose is not; the message tells the first, and by how much the wrench is out of reach.
        """
        if np.all(self.feasible):
            return self
        i = int(np.argmin(self.feasible))
        where = f"t = {self.t[i]:.4f} s" if self.t is not None else f"pose {i}"
        lack = "the platform hangs elsewhere"
        if self.robot.n_cables >= self.robot.dof:
            margin = capacity_margins(self.robot, self.poses[i], self.wrench[i])[0]
            lack = f"the wrench lies {max(-margin, 0.0):.4g} N beyond what the cables can make"
        raise InfeasibleError(
            f"{int(np.sum(~self.feasible))} of {len(self.feasible)} poses of {self.robot.name!r} have no tensions "
            f"within the limits, the first at {where}: {lack}",
            tensions=self, index=i,
        )  # fmt: skip


def distribute_batch(
    robot: CableRobot,
    poses: ArrayLike,
    wrench: ArrayLike | None = None,
    aim: BatchAim = "least norm",
    reference: ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> TensionBatch:
    """Choose tensions within their limits at many poses at once, continuously along a motion.

    The tensions nearest to wanted ones are unique, and where the wrench lies inside the available set they move
    continuously with the pose and the wrench. The tensions of largest margin need not: they may jump between corners,
    and are found by `distribute` at one pose only. A robot with fewer cables than freedoms has no choice: tensions are
    those that fit best, and the residual tells whether the platform hangs in balance.

    Args:
        robot: The cable robot.
        poses: Poses, shape (k, dof).
        wrench: What the cables must balance about the platform's origin [N, N m], shape (k, dof) or (dof,); weight and
            load when None.
        aim: "least norm", or "closest" to the reference.
        reference: Tensions to be close to [N], one for all, (n,) or (k, n); the middle of the limits when None.
        tolerance: Largest residual of a feasible pose, as a share of what is balanced or of the weight [1].

    Returns:
        The tensions.

    Raises:
        DefinitionError: An argument has another size or is not finite, or the aim is not one for batches.
    """
    if aim not in ("least norm", "closest"):
        raise DefinitionError(f"aim is {aim!r}; for many poses it must be 'least norm' or 'closest'")
    points = robot.check_poses(poses)
    W, w = cable_functions(robot).both(points)
    if wrench is not None:
        w = read_rows(wrench, len(points), robot.dof, "wrenches", ", ".join(robot.wrench_names))
    k, n = len(points), robot.n_cables
    wanted = np.zeros((k, n))
    if aim == "closest":
        middle = 0.5 * (robot.t_min + robot.t_max)
        wanted = read_rows(middle if reference is None else reference, k, n, "reference tensions", alone=True)
    elif reference is not None:
        raise DefinitionError(f"reference tensions are given, but the aim is {aim!r}; it must be 'closest'")
    A = scale_moments(W.transpose(0, 2, 1), robot.length_scale).transpose(0, 2, 1)
    b = scale_moments(w, robot.length_scale)
    size = np.maximum(np.maximum(np.linalg.norm(b, axis=1), robot.weight), 1e-6 * float(np.max(robot.t_max)))
    if n < robot.dof:
        free = -np.einsum("knd,kd->kn", np.linalg.pinv(A), b)
        values = np.clip(free, robot.t_min, robot.t_max)
        residual = np.linalg.norm(np.einsum("kdn,kn->kd", A, values) + b, axis=1)
    else:
        values, residual = solve_duals(A, b, wanted, robot.t_min, robot.t_max)
    return TensionBatch(robot, points, w, values, residual, residual <= tolerance * size)


def dynamic_tensions(
    robot: CableRobot,
    trajectory: Trajectory | MotionChain,
    t: ArrayLike | None = None,
    aim: BatchAim = "least norm",
    reference: ArrayLike | None = None,
    count: int = 2001,
    tolerance: float = 1e-10,
) -> TensionBatch:
    """Choose tensions along a motion by inverse dynamics: weight, load and inertia are balanced at every time.

    It shares nothing with the rows of `TensionLimits` but the functions of the pose, and so judges a time law that was
    found under them.

    A robot with fewer cables than freedoms cannot balance all of its inertia: it swings about the motion. Its tensions
    are those that fit best, and the tolerance says how much may be left.

    Args:
        robot: The cable robot.
        trajectory: A motion of its `robot`.
        t: Times [s]; `count` of them, equally far apart, when None.
        aim: As for `distribute_batch`.
        reference: As for `distribute_batch`.
        count: Number of times when none are given.
        tolerance: As for `distribute_batch`.

    Returns:
        The tensions; `check` refuses a motion that exceeds a limit.

    Raises:
        DefinitionError: The trajectory is that of a mechanism without the robot's coordinates.
    """
    times = np.linspace(0.0, trajectory.duration, count) if t is None else np.atleast_1d(np.asarray(t, dtype=float))
    index = coordinate_places(robot, trajectory.robot.mechanism)
    state = trajectory.state(times)
    poses, velocities, accelerations = (v[:, index] for v in (state.X, state.velocity, state.acceleration))
    wrench = cable_functions(robot).dynamic_wrench(poses, velocities, accelerations)
    found = distribute_batch(robot, poses, wrench, aim, reference, tolerance)
    return TensionBatch(robot, poses, wrench, found.values, found.residual, found.feasible, times)


def coordinate_places(robot: CableRobot, mechanism: Mechanism) -> Index:
    """Give the places of the pose's coordinates among the variables of a mechanism, shape (dof,).

    Raises:
        DefinitionError: The mechanism lacks one of them.
    """
    missing = [c for c in robot.coordinates if c not in mechanism.names]
    if missing:
        raise DefinitionError(
            f"mechanism {mechanism.name!r} lacks the coordinates {missing} of {robot.name!r}; use its `robot`"
        )
    return np.asarray(mechanism.indices(robot.coordinates), dtype=np.intp)
