"""Tension margins as a condition on motions and as bounds on their timing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.mechanism import Mechanism
from paraopt.modes.cable.distribution import coordinate_places
from paraopt.modes.cable.facets import Facets, compute_facets, facet_gradients, facet_names, scale_moments
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.read import read_number
from paraopt.modes.cable.wrench import cable_functions
from paraopt.planning import Problem
from paraopt.planning.path import PathPoints
from paraopt.planning.retime_base import PathRows

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class TensionMargin:
    """Keep every pose of a motion wrench-feasible at rest, with a margin; a condition of a `Problem`.

    With at least as many cables as freedoms, the quantities are the distances of the wrench of weight and load to the
    nearest facets of those that the cables can make: the motion may stop anywhere, and a disturbance below the margin
    finds tensions too. With fewer cables the tensions are those of a platform that hangs in balance, and the quantities
    are their distances to the limits; the motion must then be one through equilibria.

    Attributes:
        robot: The cable robot.
        mechanism: Mechanism of the motions, with the robot's coordinates among its variables; that of `robot.robot`
            when None.
        margin: Least distance to the boundary, a force or a moment over the characteristic length, or of tensions to
            their limits [N].
        lowest: Number of nearest facets that are given; all of them when None. They are sorted, so that they change
            continuously.
        scale: Distance to the bound that counts as far [N]; a tenth of the mean span of the tensions when None.

    Raises:
        DefinitionError: A number is out of bounds, or the mechanism lacks a coordinate.
    """

    robot: CableRobot
    mechanism: Mechanism | None = None
    margin: float = 0.0
    lowest: int | None = 8
    scale: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "margin", read_number(self.margin, "tension margin", "N", lowest=0.0))
        if self.scale is not None:
            object.__setattr__(self, "scale", read_number(self.scale, "scale of the tension margin", "N", above=0.0))
        if self.lowest is not None and self.lowest < 1:
            raise DefinitionError(f"number of nearest facets is {self.lowest!r}; it must be at least 1, or None")
        _ = self._places  # a mechanism without the coordinates is refused here

    @cached_property
    def _places(self) -> Index:
        return coordinate_places(self.robot, self.mechanism or self.robot.mechanism)

    @cached_property
    def _scale(self) -> float:
        return self.scale or 0.1 * float(np.mean(self.robot.t_max - self.robot.t_min))

    @property
    def _hangs(self) -> bool:
        return self.robot.n_cables < self.robot.dof

    @cached_property
    def _all_names(self) -> tuple[str, ...]:
        if self._hangs:
            cables = self.robot.cables
            return tuple([f"{c} above t_min" for c in cables] + [f"{c} below t_max" for c in cables])
        return facet_names(self.robot)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name the quantities."""
        if self._hangs or self.lowest is None or self.lowest >= len(self._all_names):
            return tuple(f"tension margin, {name}" for name in self._all_names)
        return tuple(f"tension margin, facet {i + 1} from the nearest" for i in range(self.lowest))

    @cached_property
    def lower(self) -> Array:
        """Give the least values, over the scale [1], shape (k,)."""
        return np.full(len(self.names), self.margin / self._scale)

    def values(self, X: Array) -> Array:
        """Evaluate at configurations (n, n_variables); shape (n, k), over the scale [1]."""
        return self._choose(np.atleast_2d(X)[:, self._places])[0] / self._scale

    def gradients(self, X: Array, T: Array) -> tuple[Array, Array]:
        """Evaluate with exact derivatives along motions.

        Args:
            X: Configurations, shape (n, n_variables).
            T: Motions `dX / d independent`, shape (n, n_variables, m).

        Returns:
            Values, shape (n, k), and derivatives, shape (n, k, m), over the scale.
        """
        poses = np.atleast_2d(X)[:, self._places]
        if self._hangs:
            levels, slopes = _hanging_levels(self.robot, poses)
        else:
            levels, chosen, facets = self._choose(poses)
            slopes = facet_gradients(self.robot, poses, facets, chosen)
        along = np.einsum("nkx,nxm->nkm", slopes, T[:, self._places])
        return levels / self._scale, along / self._scale

    def _choose(self, poses: Array) -> tuple[Array, Index, Facets]:
        """Give the chosen levels [N], and where the facets have them."""
        if self._hangs:
            levels = _hanging_levels(self.robot, poses)[0]
            empty = np.zeros((len(poses), 0, self.robot.dof))
            none: Index = np.zeros((len(poses), 0), dtype=np.intp)
            return levels, none, Facets(empty, empty[:, :, 0], empty[:, :, 0], none, self.robot.length_scale)
        facets = compute_facets(self.robot, poses)
        levels = facets.distances(cable_functions(self.robot).wrench(poses))
        # where columns are dependent there is no facet: it is as far as no wrench ever is
        levels = np.where(np.isfinite(levels), levels, float(np.sum(self.robot.t_max)))
        chosen: Index = np.tile(np.arange(levels.shape[1]), (len(levels), 1))
        if len(self.names) < levels.shape[1]:
            chosen = np.argsort(levels, axis=1, kind="stable")[:, : len(self.names)]
        return np.take_along_axis(levels, chosen, axis=1), chosen, facets


def _hanging_levels(robot: CableRobot, poses: Array) -> tuple[Array, Array]:
    """Give the distances of tensions to their limits, and their derivatives along motions through equilibria.

    With `W t + w = 0` along the motion, `W dt = -(dW t + dw)`.
    """
    functions = cable_functions(robot)
    length = robot.length_scale
    W, w = functions.both(poses)
    dW, dw = functions.derivatives(poses)
    A = scale_moments(W.transpose(0, 2, 1), length).transpose(0, 2, 1)
    inverse = np.linalg.pinv(A)
    t = -np.einsum("knd,kd->kn", inverse, scale_moments(w, length))
    moved = np.einsum("kdnx,kn->kxd", dW, t) + dw.transpose(0, 2, 1)
    dt = -np.einsum("knd,kxd->knx", inverse, scale_moments(moved, length))
    return np.hstack([t - robot.t_min, robot.t_max - t]), np.concatenate([dt, -dt], axis=1)


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
    feel. What they do not feel makes the platform swing about its path: drive such a robot slowly.

    Attributes:
        robot: The cable robot.
        margin: Distance to keep from the boundary, a force or a moment over the characteristic length [N].

    Raises:
        DefinitionError: The margin is negative or not finite.
    """

    robot: CableRobot
    margin: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "margin", read_number(self.margin, "tension margin", "N", lowest=0.0))

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
            c = t + np.concatenate([-robot.t_min, robot.t_max]) - self.margin
            return tuple(f"tension of {q}" for q in (*robot.cables, *robot.cables)), (a, b, c)
        facets = compute_facets(robot, poses)
        a, b = (facets.slopes(v) for v in (speeding, turning))
        c = facets.distances(weight) - self.margin
        is_none = ~np.isfinite(c)
        c[is_none] = float(np.max(robot.t_max))
        return facet_names(robot), (a, b, c)
