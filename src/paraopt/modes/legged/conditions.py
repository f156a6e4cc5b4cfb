"""What a phase must keep: the centre of gravity over the standing feet, and lifted feet over the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.legged.balance import SupportPolygon, differentiate_centre, measure_centre
from paraopt.modes.legged.machine import LeggedMachine
from paraopt.modes.legged.supports import Support, measure_height

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StabilityCondition:
    """Keep the centre of gravity inside the edges of a support polygon: a condition of a `Problem`.

    Attributes:
        machine: The machine.
        polygon: The polygon of the feet that stand.
        margin: Least distance from each edge [m].
        horizon: Distance beyond the margin at which an edge is out of sight [m].

    Raises:
        DefinitionError: There is no edge, or the horizon is not above zero.
    """

    machine: LeggedMachine
    polygon: SupportPolygon
    margin: float = 0.0
    horizon: float = 0.02

    def __post_init__(self) -> None:
        if not self.polygon.edges:
            raise DefinitionError(f"{list(self.polygon.corners)} make no support polygon; at least two feet must stand")
        if not (np.isfinite(self.horizon) and self.horizon > 0):
            raise DefinitionError(f"horizon of the support margin is {self.horizon} m; it must be finite and above 0")

    @property
    def names(self) -> tuple[str, ...]:
        """Name the edges."""
        return tuple(f"support margin, edge {edge}" for edge in self.polygon.edges)

    @property
    def lower(self) -> Array:
        """Give the margin over the horizon for each edge."""
        return np.full(len(self.polygon.edges), self.margin / self.horizon)

    def values(self, X: Array) -> Array:
        """Give the distances from the edges over the horizon, shape (n, n_edges)."""
        return self.polygon.distances(measure_centre(self.machine, X)) / self.horizon

    def gradients(self, X: Array, T: Array) -> tuple[Array, Array]:
        """Give them with their derivatives along the motions T; see `PathCondition`."""
        centre, slopes = differentiate_centre(self.machine, X)
        along = self.polygon.normals @ (slopes @ T)
        return self.polygon.distances(centre) / self.horizon, along / self.horizon


@dataclass(frozen=True, eq=False)
class HeightCondition:
    """Keep lifted feet over what they will stand on: a condition of a refinement.

    It is no condition of a `Problem`, whose barriers would keep the foot from ever touching the ground.

    Attributes:
        machine: The machine.
        feet: Names of the feet.
        support: What they must not enter.
        depth: How deep they may be in it [m].
        horizon: Height that counts as one [m].
    """

    machine: LeggedMachine
    feet: Sequence[str]
    support: Support
    depth: float = 1e-7
    horizon: float = 0.02

    @property
    def names(self) -> tuple[str, ...]:
        """Name the feet."""
        return tuple(f"height of foot {foot!r}" for foot in self.feet)

    @property
    def lower(self) -> Array:
        """Give the lowest height over the horizon for each foot."""
        return np.full(len(self.feet), -self.depth / self.horizon)

    def values(self, X: Array) -> Array:
        """Give the heights over the horizon, shape (n, n_feet)."""
        points = self.machine.contacts(X)[0][:, self._places]
        return measure_height(self.support, points) / self.horizon

    def gradients(self, X: Array, T: Array) -> tuple[Array, Array]:
        """Give them with their derivatives along the motions T; see `PathCondition`."""
        points, slopes = self.machine.contact_slopes(X)
        normals = self.support.tangent_plane(points[:, self._places])[1]
        along = np.einsum("nfi,nfiv,nvm->nfm", normals, slopes[:, self._places], T)
        return measure_height(self.support, points[:, self._places]) / self.horizon, along / self.horizon

    @cached_property
    def _places(self) -> list[int]:
        return [self.machine.names.index(self.machine.foot(foot).name) for foot in self.feet]
