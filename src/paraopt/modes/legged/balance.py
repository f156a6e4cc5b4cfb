"""Balance: the centre of gravity of the whole machine, over the polygon of the feet that stand.

A machine that moves slowly does not tip over as long as its centre of gravity, projected along gravity, lies within the
convex hull of the projected points of contact. That holds on tilted supports and for feet at different heights as long
as no foot slips; friction is not part of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.closure import ClosureGraph
from paraopt.errors import DefinitionError
from paraopt.kinematics.codegen import Backend, CompiledFunction
from paraopt.modes.legged.machine import LeggedMachine
from paraopt.modes.legged.supports import Support, measure_height

Array = NDArray[np.float64]


def build_centre(machine: LeggedMachine) -> ca.SX:
    """Build the centre of gravity of the whole machine in the world.

    `c(X) = sum_i m_i (R_i p_i + t_i) / sum_i m_i` over the links, p_i the centre of mass of link i in its frame.

    Args:
        machine: The machine.

    Returns:
        The point [m] as an expression of the variables of the machine's closure graph, shape (3,).

    Source: Lahouar, IV.3.
    """
    links, weights = _weigh(machine)
    return _sum_weighted(machine.robot.kinematics.graph, links, ca.DM(weights))


def measure_centre(machine: LeggedMachine, X: ArrayLike) -> Array:
    """Give the centre of gravity at n configurations X (n, n_variables), in the world [m]; shape (n, 3)."""
    links, weights = _weigh(machine)
    (centre,) = _centre_functions(machine.robot.kinematics.graph, links, machine.robot.kinematics.functions.backend)[
        0
    ].batch(np.atleast_2d(np.asarray(X, dtype=float)), weights)
    return centre


def differentiate_centre(machine: LeggedMachine, X: ArrayLike) -> tuple[Array, Array]:
    """Give the centre of gravity and its derivatives with respect to all variables.

    Args:
        machine: The machine.
        X: Configurations, shape (n, n_variables).

    Returns:
        Centres in the world [m], shape (n, 3), and derivatives, shape (n, 3, n_variables).
    """
    links, weights = _weigh(machine)
    points = np.atleast_2d(np.asarray(X, dtype=float))
    centre, slopes = _centre_functions(
        machine.robot.kinematics.graph, links, machine.robot.kinematics.functions.backend
    )[1].batch(points, weights)
    return centre, slopes.reshape(len(points), 3, points.shape[1])


@dataclass(frozen=True, eq=False)
class SupportPolygon:
    """Hold the convex hull of points of contact, seen along gravity.

    Attributes:
        corners: Names of the feet at its corners, counterclockwise seen from above.
        points: Their points of contact in the world [m], shape (k, 3).
        down: Unit direction of gravity.
    """

    corners: tuple[str, ...]
    points: Array
    down: Array

    @classmethod
    def over(cls, names: Sequence[str], points: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -1.0)) -> SupportPolygon:
        """Build the hull of points.

        Args:
            names: Name of each foot.
            points: Points of contact in the world [m], shape (n, 3).
            gravity: Direction of gravity.

        Returns:
            The polygon: a point for one foot, a line for two or for feet in a row.

        Raises:
            DefinitionError: There is no foot.
        """
        at = np.asarray(points, dtype=float).reshape(-1, 3)
        if not len(at) or len(at) != len(names):
            raise DefinitionError(f"a support polygon needs feet; given are {list(names)} at {len(at)} points")
        down = np.asarray(gravity, dtype=float) / np.linalg.norm(np.asarray(gravity, dtype=float))
        flat = at @ level_axes(down).T
        order = _find_hull(flat)
        return cls(tuple(names[i] for i in order), at[order], down)

    @property
    def edges(self) -> tuple[str, ...]:
        """Name the edges by the feet at their ends."""
        k = len(self.corners)
        return tuple(f"{self.corners[i]} - {self.corners[(i + 1) % k]}" for i in range(k if k > 1 else 0))

    @property
    def normals(self) -> Array:
        """Give the horizontal unit directions from each edge into the polygon, in the world, shape (n_edges, 3)."""
        return self._sides[0] @ level_axes(self.down)

    def distances(self, centre: ArrayLike) -> Array:
        """Measure how far points are inside each edge, seen along gravity.

        Inside the polygon the least of them is the distance to the boundary; each is linear in the point.

        Args:
            centre: Points in the world [m], shape (n, 3).

        Returns:
            Signed distances [m], below zero outside the edge, shape (n, n_edges).
        """
        normals, levels, _ = self._sides
        return np.atleast_2d(np.asarray(centre, dtype=float)) @ level_axes(self.down).T @ normals.T - levels

    def margin(self, centre: ArrayLike) -> Array:
        """Measure the support margin: the distance to the boundary, below zero outside.

        Args:
            centre: Points in the world [m], shape (n, 3).

        Returns:
            Signed distances [m], shape (n,); over one or two feet never above zero.
        """
        flat = np.atleast_2d(np.asarray(centre, dtype=float)) @ level_axes(self.down).T
        corners = self._sides[2]
        steps = np.roll(corners, -1, axis=0) - corners
        share = np.sum((flat[:, None] - corners) * steps, axis=2) / np.maximum(np.sum(steps**2, axis=1), 1e-300)
        nearest = corners + np.clip(share, 0.0, 1.0)[:, :, None] * steps
        boundary = np.min(np.linalg.norm(flat[:, None] - nearest, axis=2), axis=1)
        if len(corners) < 3:
            return -boundary
        return np.where(np.min(self.distances(centre), axis=1) >= 0.0, boundary, -boundary)

    @cached_property
    def _sides(self) -> tuple[Array, Array, Array]:
        """Give inner normals of the edges (k, 2), their levels (k,), and the corners (k, 2), all seen along gravity."""
        corners = self.points @ level_axes(self.down).T
        if len(corners) < 2:
            return np.zeros((0, 2)), np.zeros(0), corners
        steps = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1)[:, None]
        return normals, np.sum(normals * corners, axis=1), corners


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


def measure_support(
    machine: LeggedMachine, X: ArrayLike, standing: Sequence[str], gravity: ArrayLike = (0.0, 0.0, -1.0)
) -> Array:
    """Measure the support margin at n configurations in which the same feet stand in the same places.

    Args:
        machine: The machine.
        X: Configurations, shape (n, n_variables); the first tells where the feet stand.
        standing: Names of the feet that stand.
        gravity: Direction of gravity.

    Returns:
        Signed distances of the projected centre of gravity from the polygon's boundary [m], shape (n,).
    """
    rows = np.atleast_2d(np.asarray(X, dtype=float))
    return build_polygon(machine, rows[0], standing, gravity).margin(measure_centre(machine, rows))


def build_polygon(
    machine: LeggedMachine, X: ArrayLike, standing: Sequence[str], gravity: ArrayLike = (0.0, 0.0, -1.0)
) -> SupportPolygon:
    """Build the polygon of the feet that stand in a configuration X (n_variables,)."""
    places = [machine.names.index(machine.foot(name).name) for name in standing]
    points = machine.contacts(np.atleast_2d(np.asarray(X, dtype=float)))[1][0, places]
    return SupportPolygon.over(standing, points, gravity)


def _weigh(machine: LeggedMachine) -> tuple[tuple[str, ...], Array]:
    """Give the links that have a mass, and for each `(m p, m) / sum of m`, shape (n, 4)."""
    masses, centres = machine.masses or {}, machine.centres or {}
    links = tuple(link for link, mass in masses.items() if mass > 0.0)
    share = np.array([masses[link] for link in links]) / machine.mass
    points = np.array([centres.get(link, (0.0, 0.0, 0.0)) for link in links])
    return links, np.column_stack([share[:, None] * points, share])


def _sum_weighted(graph: ClosureGraph, links: Sequence[str], weights: ca.SX | ca.DM) -> ca.SX:
    total = ca.SX.zeros(3)
    for i, link in enumerate(links):
        total += graph.X_W[link][:3, :] @ weights[i, :].T
    return total


@lru_cache(maxsize=64)
def _centre_functions(graph: ClosureGraph, links: tuple[str, ...], backend: Backend) -> list[CompiledFunction]:
    """Compile the centre of gravity, alone and with its derivatives; masses are an input, so that they may vary."""
    weights = ca.SX.sym("weights", len(links), 4)
    centre = _sum_weighted(graph, links, weights)
    slopes = ca.jacobian(centre, graph.X)
    return CompiledFunction.together(
        [
            ca.Function("paraopt_centre", [graph.X, weights], [centre], {"cse": True}),
            ca.Function("paraopt_centre_slopes", [graph.X, weights], [centre, slopes], {"cse": True}),
        ],
        backend,
    )


def level_axes(down: Array) -> Array:
    """Give two unit directions across gravity, right-handed seen from above, shape (2, 3); x and y where it is -z."""
    up = -down
    first = np.eye(3)[int(np.argmin(np.abs(up)))] if abs(up[0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    e1 = first - (first @ up) * up
    e1 /= np.linalg.norm(e1)
    return np.array([e1, np.cross(up, e1)])


def _find_hull(points: Array, tolerance: float = 1e-12) -> list[int]:
    """Find the corners of the convex hull of points (n, 2), counterclockwise; those within an edge are left out."""
    size = max(float(np.ptp(points, axis=0).max()), tolerance)
    order = sorted(range(len(points)), key=lambda i: (points[i, 0], points[i, 1]))

    def turn(chain: list[int], i: int) -> float:
        a, b = points[chain[-1]] - points[chain[-2]], points[i] - points[chain[-2]]
        return float(a[0] * b[1] - a[1] * b[0])

    def half(places: Sequence[int]) -> list[int]:
        chain: list[int] = []
        for i in places:
            if chain and np.linalg.norm(points[i] - points[chain[-1]]) <= tolerance * size:
                continue  # two feet in one place
            while len(chain) >= 2 and turn(chain, i) <= tolerance * size**2:
                chain.pop()
            chain.append(i)
        return chain

    lower, upper = half(order), half(order[::-1])
    return lower if len(lower) < 2 else [*lower[:-1], *upper[:-1]]
