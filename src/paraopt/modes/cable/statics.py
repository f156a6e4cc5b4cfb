"""Tensions that hold the platform at one pose: feasible or not by a linear program, chosen by a quadratic one.

A wrench is balanced by tensions within their limits, or the answer names the limit that stands in the way and by how
much: the least amount by which all limits must be loosened, from

    minimise v   subject to   W t + w = 0,   t_min - v <= t <= t_max + v

whose optimum, below zero, is also the largest margin that tensions can keep from their limits.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
import qpsolvers
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from paraopt.errors import BackendError, DefinitionError, InfeasibleError
from paraopt.modes.cable.facets import scale_moments
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.wrench import cable_functions
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Aim = Literal["least norm", "closest", "largest margin"]
AIMS = ("least norm", "closest", "largest margin")


@dataclass(frozen=True, eq=False)
class Feasibility:
    """Hold whether tensions within the limits balance a wrench.

    Attributes:
        robot: The cable robot.
        pose: The pose, shape (dof,).
        wrench: What the cables must balance, w [N, N m], shape (dof,).
        margin: Largest distance that all tensions can keep from their limits at once [N]; negative where the limits
            must be loosened by that much; -inf where no tensions of any sign balance the wrench.
        tensions: Tensions that keep it [N], shape (n,); the nearest to balance where there are none.
        cables: Names of the cables whose limits stand in the way, as "cable 'q1' at t_min".
        lost: Unit direction, in force and moment over the characteristic length, along which the cables give nothing
            while the wrench asks for something, shape (dof,); zeros where there is none.
    """

    robot: CableRobot
    pose: Array
    wrench: Array
    margin: float
    tensions: Array
    cables: tuple[str, ...]
    lost: Array

    @property
    def is_feasible(self) -> bool:
        """Tell whether the limits hold, but for round-off."""
        return self.margin >= -1e-9 * float(np.max(self.robot.t_max))

    @property
    def verdict(self) -> str:
        """Tell it in a sentence."""
        if np.any(self.lost):
            names = self.robot.wrench_names
            parts = [f"{v:+.3f} {c}" for v, c in zip(self.lost, names, strict=True) if abs(v) > 1e-3]
            return f"the cables give nothing along {' '.join(parts)}, where the wrench needs it"
        if self.is_feasible:
            return f"feasible: every tension can stay {max(self.margin, 0.0):.4g} N within its limits"
        return f"{', '.join(self.cables)} stand in the way: limits must be loosened by {-self.margin:.4g} N"


@dataclass(frozen=True, eq=False)
class Tensions:
    """Hold tensions that balance a wrench within their limits.

    Attributes:
        robot: The cable robot.
        pose: The pose, shape (dof,).
        wrench: What they balance, w [N, N m], shape (dof,).
        values: Tensions [N], shape (n,).
        residual: Norm of `W t + w` with moments over the characteristic length [N].
    """

    robot: CableRobot
    pose: Array
    wrench: Array
    values: Array
    residual: float

    def __getitem__(self, cable: str) -> float:
        """Give the tension of a cable by its name [N]."""
        return dict(zip(self.robot.cables, self.values.tolist(), strict=True))[cable]

    @property
    def margin(self) -> float:
        """Give the least distance of a tension to a limit [N]."""
        return float(np.min(np.minimum(self.values - self.robot.t_min, self.robot.t_max - self.values)))


def check_feasibility(robot: CableRobot, pose: ArrayLike, wrench: ArrayLike | None = None) -> Feasibility:
    """Judge by linear programming whether tensions within their limits balance a wrench.

    Args:
        robot: The cable robot.
        pose: Values of its coordinates [m, rad], shape (dof,).
        wrench: What the cables must balance about the platform's origin [N, N m]; weight and load when None.

    Returns:
        The verdict with its reason.

    Raises:
        DefinitionError: The pose or the wrench has another size, or is not finite.
        BackendError: HiGHS failed.
    """
    point, W, w = _read(robot, pose, wrench)
    A, b = _scaled(robot, W, w)
    zero = np.zeros(robot.dof)
    nearest = -np.linalg.pinv(A) @ b
    left = A @ nearest + b
    size = max(float(np.linalg.norm(b)), robot.weight, 1e-300)
    if np.linalg.norm(left) > 1e-9 * size:
        return Feasibility(robot, point, w, -np.inf, nearest, (), left / np.linalg.norm(left))
    t, v, binding = spread_evenly(A, b, robot.t_min, robot.t_max)
    cables = [f"cable {c!r} at t_min" for c, holds in zip(robot.cables, binding[0], strict=True) if holds]
    cables += [f"cable {c!r} at t_max" for c, holds in zip(robot.cables, binding[1], strict=True) if holds]
    return Feasibility(robot, point, w, -v, t, tuple(cables), zero)


def spread_evenly(A: Array, b: Array, low: Array, high: Array) -> tuple[Array, float, NDArray[np.bool_]]:
    """Find the tensions that exceed their limits least, or keep farthest from them.

        minimise v   subject to   A t + b = 0,   low - v <= t <= high + v

    Args:
        A: Matrix, shape (d, n); tensions of some sign must balance b.
        b: Right-hand side, shape (d,).
        low: Lower limits, shape (n,).
        high: Upper limits, shape (n,).

    Returns:
        The tensions, v, and which lower and upper limits hold v up, shape (2, n).

    Raises:
        BackendError: HiGHS failed.
    """
    n = A.shape[1]
    # rows that the cables do not feel are dropped: the rest is of full rank
    U, s, _ = np.linalg.svd(A, full_matrices=False)
    kept = U[:, s > 1e-12 * s[0]].T
    # in shares of the largest tension: the solver's tolerances are absolute
    scale = float(np.max(high))
    column = np.ones((n, 1))
    solved = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=np.vstack([np.hstack([-np.eye(n), -column]), np.hstack([np.eye(n), -column])]),
        b_ub=np.concatenate([-low, high]) / scale,
        A_eq=np.hstack([kept @ A, np.zeros((len(kept), 1))]),
        b_eq=-kept @ b / scale,
        bounds=(None, None),
        method="highs",
    )
    if solved.status != 0:
        raise BackendError(f"HiGHS found no tensions: {solved.message}", A=A, b=b, low=low, high=high)
    binding = np.abs(solved.ineqlin.marginals).reshape(2, n) > 1e-9
    return solved.x[:n] * scale, float(solved.x[n]) * scale, binding


def distribute(
    robot: CableRobot,
    pose: ArrayLike,
    wrench: ArrayLike | None = None,
    aim: Aim = "least norm",
    reference: ArrayLike | None = None,
) -> Tensions:
    """Choose tensions within their limits that balance a wrench.

    Args:
        robot: The cable robot.
        pose: Values of its coordinates [m, rad], shape (dof,).
        wrench: What the cables must balance about the platform's origin [N, N m]; weight and load when None.
        aim: "least norm"; "closest" to the reference; or "largest margin", the farthest from all limits.
        reference: Tensions to be close to [N], one for all or shape (n,); the middle of the limits when None.

    Returns:
        The tensions: `W t + w = 0` to round-off, and the limits hold exactly.

    Raises:
        InfeasibleError: No tensions within the limits balance the wrench; the message names the limits in the way and
            by how much, and the evidence holds the `Feasibility`.
        DefinitionError: An argument has another size, or is not finite.
        BackendError: A solver failed.
    """
    if aim not in AIMS:
        raise DefinitionError(f"aim is {aim!r}; it must be one of {', '.join(map(repr, AIMS))}")
    point, W, w = _read(robot, pose, wrench)
    A, b = _scaled(robot, W, w)
    middle = 0.5 * (robot.t_min + robot.t_max)
    wanted = {"least norm": np.zeros_like(middle), "largest margin": middle, "closest": middle}[aim]
    if reference is not None:
        if aim != "closest":
            raise DefinitionError(f"reference tensions are given, but the aim is {aim!r}; it must be 'closest'")
        wanted = finite_vector(np.broadcast_to(reference, middle.shape), len(middle), "reference tensions")
    feasible = None
    if aim == "largest margin":
        feasible = _require(robot, point, w)
        tried = _polish(A, b, feasible.tensions, robot.t_min, robot.t_max, feasible.tensions)
    else:
        tried = _polish(A, b, wanted, robot.t_min, robot.t_max, _solve_program(A, b, wanted, robot.t_min, robot.t_max))
    tolerance = 1e-10 * max(float(np.linalg.norm(b)), robot.weight, 1e-6 * float(np.max(robot.t_max)))
    if np.linalg.norm(A @ tried + b) > tolerance:
        # the program did not converge: there are no tensions, or its answer was poor
        feasible = feasible or _require(robot, point, w)
        tried = _polish(A, b, wanted, robot.t_min, robot.t_max, feasible.tensions)
    residual = float(np.linalg.norm(A @ tried + b))
    if residual > tolerance:
        raise BackendError(
            f"tensions of {robot.name!r} leave {residual:.3g} N unbalanced; the tolerance is {tolerance:.3g} N",
            pose=point, wrench=w, tensions=tried,
        )  # fmt: skip
    return Tensions(robot, point, w, tried, residual)


def _require(robot: CableRobot, pose: Array, wrench: Array) -> Feasibility:
    verdict = check_feasibility(robot, pose, wrench)
    if not verdict.is_feasible:
        where = ", ".join(f"{c} = {v:.4g}" for c, v in zip(robot.coordinates, pose, strict=True))
        raise InfeasibleError(
            f"no tensions of {robot.name!r} balance the wrench at {where}: {verdict.verdict}", feasibility=verdict
        )
    return verdict


def _solve_program(A: Array, b: Array, wanted: Array, low: Array, high: Array) -> Array:
    """Minimise the distance to the wanted tensions; shape (n,), only near balance where there are no such tensions."""
    scale = float(np.max(high))  # so that the solver's absolute tolerances are shares of the largest tension
    n = len(wanted)
    problem = qpsolvers.Problem(
        sp.eye(n, format="csc"), -wanted / scale, A=sp.csc_matrix(A), b=-b / scale, lb=low / scale, ub=high / scale
    )
    with warnings.catch_warnings():  # an answer that is not exact is judged and polished by the caller
        warnings.simplefilter("ignore")
        answer = qpsolvers.solve_problem(
            problem, solver="osqp", eps_abs=1e-9, eps_rel=1e-9, max_iter=20000, polishing=True
        )
    if answer.x is None or not np.all(np.isfinite(answer.x)):
        return np.clip(wanted, low, high)
    return np.clip(answer.x * scale, low, high)


def _polish(A: Array, b: Array, wanted: Array, low: Array, high: Array, start: Array) -> Array:
    """Make a solution of the quadratic program exact: find the active limits, then solve for the others.

    The optimum is `clip(wanted + A^T y, low, high)` with the y that balances. From the y that fits the approximate
    solution, Newton's method on the balance ends after few active sets.
    """
    return solve_duals(A[None], b[None], wanted[None], low, high, start[None])[0][0]


def solve_duals(
    A: Array, b: Array, wanted: Array, low: Array, high: Array, start: Array | None = None, iterations: int = 1000
) -> tuple[Array, Array]:
    """Minimise `|t - wanted|` with `A t + b = 0` and `low <= t <= high` for many problems at once.

    The optimum is `t(y) = clip(wanted + A^T y, low, high)` for the multipliers y that maximise a concave function whose
    gradient is `-(A t(y) + b)`: Newton's method on this piecewise linear balance, damped until the function grows. The
    limits hold exactly in every iterate.

    Args:
        A: Matrices, shape (k, d, n).
        b: Right-hand sides, shape (k, d).
        wanted: Wanted values, shape (k, n).
        low: Lower limits, shape (n,).
        high: Upper limits, shape (n,).
        start: Values from which multipliers are guessed, shape (k, n); none when None.
        iterations: Largest number of steps.

    Returns:
        The values, shape (k, n), and the norms of what is left unbalanced, shape (k,); not small where there is no
        solution.
    """
    k, d, _ = A.shape
    y = np.zeros((k, d))
    if start is not None:
        free = (start > low + 1e-9 * (high - low)) & (start < high - 1e-9 * (high - low))
        A_free = A * free[:, None, :]
        y = np.einsum("knd,kn->kd", np.linalg.pinv(A_free), (start - wanted) * free)
    size = np.maximum(np.linalg.norm(b, axis=1), 1e-6 * float(np.max(high)))
    # no values within the limits are farther from the wanted ones: a dual value beyond proves that there is no solution
    farthest = 0.5 * np.sum(np.maximum((low - wanted) ** 2, (high - wanted) ** 2), axis=1)

    def evaluate(rows: Index, duals: Array) -> tuple[Array, Array, Array]:
        """Give the values, what they leave, and the dual value."""
        t = np.clip(wanted[rows] + np.einsum("kdn,kd->kn", A[rows], duals), low, high)
        left = np.einsum("kdn,kn->kd", A[rows], t) + b[rows]
        return t, left, 0.5 * np.sum((t - wanted[rows]) ** 2, axis=1) - np.einsum("kd,kd->k", duals, left)

    everyone: Index = np.arange(k)
    t, left, value = evaluate(everyone, y)
    whole = np.einsum("kin,kjn->kij", A, A) + 1e-14 * np.eye(d)
    damping = np.full(k, 1e-2)
    active = everyone[np.linalg.norm(left, axis=1) > 1e-13 * size]
    for _ in range(iterations):
        if not active.size:
            break
        reach = wanted[active] + np.einsum("kdn,kd->kn", A[active], y[active])
        A_free = A[active] * ((reach > low) & (reach < high))[:, None, :]
        H = np.einsum("kin,kjn->kij", A_free, A[active]) + damping[active, None, None] * whole[active]
        step = -np.linalg.solve(H, left[active][:, :, None])[:, :, 0]
        gain = -np.einsum("kd,kd->k", left[active], step)
        moved, rest, higher = evaluate(active, y[active] + step)
        good = higher >= value[active] + 1e-3 * gain
        # near the solution the dual value no longer tells, but the balance does
        before, after = np.linalg.norm(left[active], axis=1), np.linalg.norm(rest, axis=1)
        good |= after < 0.5 * before
        # where values lie beyond their limits by little, steps change nothing until one is freed: they are taken
        good |= (gain < 1e-10 * np.abs(value[active])) & (after <= (1.0 + 1e-12) * before)
        damping[active] = np.where(good, np.maximum(0.1 * damping[active], 1e-13), 8.0 * damping[active])
        going = active[good]
        y[going] += step[good]
        t[going], left[going], value[going] = moved[good], rest[good], higher[good]
        done = np.linalg.norm(left[active], axis=1) <= 1e-13 * size[active]
        active = active[~done & (value[active] <= 1.001 * farthest[active]) & (damping[active] < 1e12)]
    return t, np.linalg.norm(left, axis=1)


def _read(robot: CableRobot, pose: ArrayLike, wrench: ArrayLike | None) -> tuple[Array, Array, Array]:
    point = robot.check_poses(pose)
    if len(point) != 1:
        raise DefinitionError(f"one pose is wanted; {len(point)} are given, so use distribute_batch")
    W, w = cable_functions(robot).both(point)
    asked = w[0] if wrench is None else finite_vector(np.asarray(wrench), robot.dof, "wrench")
    return point[0], W[0], np.array(asked)


def _scaled(robot: CableRobot, W: Array, w: Array) -> tuple[Array, Array]:
    return scale_moments(W.T, robot.length_scale).T, scale_moments(w, robot.length_scale)
