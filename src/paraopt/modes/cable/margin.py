"""Tension margins as a condition on motions."""

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
    lowest: int | None = 2
    scale: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "margin", read_number(self.margin, "tension margin", "N", lowest=0.0))
        if self.scale is not None:
            object.__setattr__(self, "scale", read_number(self.scale, "scale of the tension margin", "N", above=0.0))
        if self.lowest is not None and not (isinstance(self.lowest, (int, np.integer)) and self.lowest >= 1):
            raise DefinitionError(
                f"number of nearest facets is {self.lowest!r}; it must be a whole number, at least 1, or None"
            )
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
        """Name the quantities, with the force that counts as one."""
        unit = f"tension margin / {self._scale:.4g} N"
        if self._hangs or self.lowest is None or self.lowest >= len(self._all_names):
            return tuple(f"{unit}, {name}" for name in self._all_names)
        return tuple(f"{unit}, facet {i + 1} from the nearest" for i in range(self.lowest))

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
            return levels, none, Facets(empty, empty[:, :, 0], empty[:, :, 0], none, self.robot.length_scale, 0.0)
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
