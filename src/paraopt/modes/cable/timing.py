"""Bounds on the timing of paths by what cables and winches can do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.cable.distribution import coordinate_places
from paraopt.modes.cable.facets import compute_facets, facet_names, scale_moments
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.read import read_number
from paraopt.modes.cable.sway import pulling_force, unbalanced_part
from paraopt.modes.cable.wrench import cable_functions
from paraopt.planning import Problem
from paraopt.planning.path import PathPoints
from paraopt.planning.retime_base import PathRows

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TensionLimits:
    """Bound the timing of a path so that tensions within their limits exist all along; a constraint of a retimer.

    Along a path the dynamics `W t + w - [m a_c; ...] = 0` ask the cables for a wrench that is affine in (s'', s'^2).
    Tensions within their limits can make it if and only if it lies within every facet of the available wrench set. Each
    facet is thus one row `a s'' + b s'^2 + c <= 0`, and all of them together are necessary and sufficient: no
    distribution is fixed beforehand, no motion is lost, and none is allowed whose tensions do not exist. Which of them
    are run is chosen afterwards, uniquely and continuously, by `distribute_batch`. The rows hold at the points at which
    the retimer asks; `dynamic_tensions` judges the motion between them.

    With fewer cables than freedoms the tensions are bounded that the wrench asks for along the directions that cables
    feel. What they do not feel makes the platform swing about its path, and is bounded by `SwayLimits`.

    Attributes:
        robot: The cable robot.
        margin: Distance to keep from the boundary, a force or a moment over the characteristic length [N]. When None
            two thousandths of the largest tension, so that the thousandth by which a retimer may exceed a row between
            its points still is within the limits.

    Raises:
        DefinitionError: The margin is negative or not finite.
    """

    robot: CableRobot
    margin: float | None = None

    def __post_init__(self) -> None:
        if self.margin is not None:
            object.__setattr__(self, "margin", read_number(self.margin, "tension margin", "N", lowest=0.0))

    @property
    def distance(self) -> float:
        """Give the distance to the boundary that is kept [N]."""
        return 2e-3 * float(np.max(self.robot.t_max)) if self.margin is None else self.margin

    def rows(self, problem: Problem, points: PathPoints) -> PathRows:
        """Give the rows, over the largest tension.

        Args:
            problem: The problem, whose mechanism has the robot's coordinates.
            points: Points of the path.

        Raises:
            DefinitionError: The mechanism lacks a coordinate.
        """
        places = coordinate_places(self.robot, problem.robot.mechanism)
        names, levels = self.affine_levels(*(v[:, places] for v in (points.X, points.dX, points.ddX)))
        a, b, c = (-values / float(np.max(self.robot.t_max)) for values in levels)
        return PathRows(names, a, b, c)

    def affine_levels(self, poses: Array, first: Array, second: Array) -> tuple[tuple[str, ...], tuple[Array, ...]]:
        """Give the distances to the limits as `a s'' + b s'^2 + c`, less the margin.

        Args:
            poses: Poses, shape (k, dof).
            first: Their derivatives with respect to the path's parameter, same shape.
            second: Their second derivatives, same shape.

        Returns:
            Names of the distances, and a, b, c [N], each of shape (k, n_distances).
        """
        robot, functions = self.robot, cable_functions(self.robot)
        weight = functions.wrench(poses)
        speeding = -functions.inertia_wrench(poses, np.zeros_like(first), first)
        turning = -functions.inertia_wrench(poses, first, second)
        if robot.n_cables < robot.dof:
            W = functions.wrench_matrix(poses)
            A = scale_moments(W.transpose(0, 2, 1), robot.length_scale).transpose(0, 2, 1)
            parts = [
                -np.einsum("knd,kd->kn", np.linalg.pinv(A), scale_moments(v, robot.length_scale))
                for v in (speeding, turning, weight)
            ]
            a, b, t = (np.hstack([v, -v]) for v in parts)
            c = t + np.concatenate([-robot.t_min, robot.t_max]) - self.distance
            return tuple(f"tension of {q}" for q in (*robot.cables, *robot.cables)), (a, b, c)
        facets = compute_facets(robot, poses)
        a, b = (facets.slopes(v) for v in (speeding, turning))
        c = facets.distances(weight) - self.distance
        is_none = ~np.isfinite(c)
        c[is_none] = float(np.max(robot.t_max))
        return facet_names(robot), (a, b, c)


@dataclass(frozen=True, eq=False)
class SwayLimits:
    """Bound what of the inertia of a hanging platform no tensions balance; a constraint of a retimer.

    A motion through equilibria is one that the platform has at rest. Run with accelerations it asks for the wrench
    `P (a s'' + b s'^2)`, where P projects onto what the cables do not feel: nothing makes it, and the platform swings.
    Its size, with moments over the characteristic length, is that of `S (s'', s'^2)` with the root S of the Gram matrix
    of `P a` and `P b`, which changes continuously along the path. The disc of allowed sizes is filled by a polygon,
    whose sides are the rows. `measure_sway` judges the motion between the points at which the retimer asks.

    Attributes:
        robot: The cable robot, with fewer cables than freedoms.
        share: Largest size of the unbalanced wrench, over weight and load [1].
        sides: Number of sides of the polygon, which fills a share `cos(pi / sides)` of the radius.

    Raises:
        DefinitionError: The share is not above zero, there are fewer than four sides, or cables balance everything.
    """

    robot: CableRobot
    share: float = 0.05
    sides: int = 16

    def __post_init__(self) -> None:
        share = read_number(self.share, "largest unbalanced share of the weight", "1", above=0.0)
        object.__setattr__(self, "share", share)
        if self.sides < 4:
            raise DefinitionError(f"number of sides is {self.sides!r}; it must be at least 4")
        if self.robot.n_cables >= self.robot.dof:
            raise DefinitionError(
                f"{self.robot.name!r} has {self.robot.n_cables} cables for {self.robot.dof} freedoms: they balance "
                "every wrench, and it does not sway; bound its tensions by `TensionLimits`"
            )

    def rows(self, problem: Problem, points: PathPoints) -> PathRows:
        """Give the rows, over the largest size.

        Args:
            problem: The problem, whose mechanism has the robot's coordinates.
            points: Points of the path, which runs through equilibria.

        Raises:
            DefinitionError: The mechanism lacks a coordinate.
        """
        places = coordinate_places(self.robot, problem.robot.mechanism)
        poses, first, second = (v[:, places] for v in (points.X, points.dX, points.ddX))
        inertia = cable_functions(self.robot).inertia_wrench
        pair = np.stack([inertia(poses, np.zeros_like(first), first), inertia(poses, first, second)], axis=1)
        pair = np.stack([unbalanced_part(self.robot, poses, pair[:, i]) for i in range(2)], axis=1)
        gram = np.einsum("kid,kjd->kij", pair, pair)
        # the root of a symmetric matrix of two rows, by Cayley and Hamilton
        root = np.sqrt(np.maximum(gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2, 0.0))
        trace = np.sqrt(gram[:, 0, 0] + gram[:, 1, 1] + 2.0 * root)
        S = (gram + root[:, None, None] * np.eye(2)) / np.maximum(trace, 1e-300)[:, None, None]
        angles = 2.0 * np.pi * np.arange(self.sides) / self.sides
        # a retimer may exceed a row by a thousandth between its points
        largest = 0.998 * self.share * pulling_force(self.robot) * np.cos(np.pi / self.sides)
        sides = np.einsum("ic,kcj->kij", np.column_stack([np.cos(angles), np.sin(angles)]), S) / largest
        names = tuple(f"unbalanced wrench, side {i + 1}" for i in range(self.sides))
        return PathRows(names, sides[:, :, 0], sides[:, :, 1], np.full(sides.shape[:2], -1.0))

    def judge(self, problem: Problem, points: PathPoints) -> PathRows:
        """Give the true size in place of the polygon's sides, at points of a motion whose parameter is time.

        The polygon turns with the parameter of the path: its sides, the retimer's, say a little less than is allowed.

        Args:
            problem: The problem, whose mechanism has the robot's coordinates.
            points: Points of the motion, with derivatives with respect to time.

        Raises:
            DefinitionError: The mechanism lacks a coordinate.
        """
        places = coordinate_places(self.robot, problem.robot.mechanism)
        asked = cable_functions(self.robot).inertia_wrench(*(v[:, places] for v in (points.X, points.dX, points.ddX)))
        rest = unbalanced_part(self.robot, points.X[:, places], asked)
        size = np.linalg.norm(rest, axis=1)[:, None] / (self.share * pulling_force(self.robot))
        return PathRows(("unbalanced wrench",), np.zeros_like(size), size, np.full_like(size, -1.0))


@dataclass(frozen=True, eq=False)
class WinchLimits:
    """Bound speed and acceleration of the paid-out lengths, arcs on the pulleys included; a constraint of a retimer.

    Without pulleys the limits of `CableRobot.robot` say the same. With them a winch pays out a little more or less than
    the distance from exit to attachment changes, and this bounds what it does exactly.

    Attributes:
        robot: The cable robot, with limits of velocity or acceleration.
    """

    robot: CableRobot

    def rows(self, problem: Problem, points: PathPoints) -> PathRows:
        """Give the rows, over the limits.

        Args:
            problem: The problem, whose mechanism has the robot's coordinates.
            points: Points of the path.

        Raises:
            DefinitionError: The mechanism lacks a coordinate.
        """
        robot = self.robot
        places = coordinate_places(robot, problem.robot.mechanism)
        first, second = cable_functions(robot).length_motion(*(v[:, places] for v in (points.X, points.dX, points.ddX)))
        zero, one = np.zeros_like(first), np.ones_like(first)
        parts = [PathRows.none(len(first))]
        if robot.velocity is not None:
            names = tuple(f"speed of winch {c}" for c in robot.cables)
            parts.append(PathRows(names, zero, (first / robot.velocity) ** 2, -one))
        if robot.acceleration is not None:
            names = tuple(f"acceleration of winch {c}" for c in robot.cables)
            a, b = first / robot.acceleration, second / robot.acceleration
            parts += [PathRows(names, a, b, -one), PathRows(names, -a, -b, -one)]
        return PathRows.join(parts)
