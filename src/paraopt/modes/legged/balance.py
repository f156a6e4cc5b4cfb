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
    links, weights = weigh_links(machine)
    return _sum_weighted(machine.robot.kinematics.graph, links, ca.DM(weights))


def measure_centre(machine: LeggedMachine, X: ArrayLike) -> Array:
    """Give the centre of gravity at n configurations X (n, n_variables), in the world [m]; shape (n, 3)."""
    links, weights = weigh_links(machine)
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
    links, weights = weigh_links(machine)
    points = np.atleast_2d(np.asarray(X, dtype=float))
    centre, slopes = _centre_functions(
        machine.robot.kinematics.graph, links, machine.robot.kinematics.functions.backend
    )[1].batch(points, weights)
    return centre, slopes.reshape(len(points), 3, points.shape[1])


@dataclass(frozen=True, eq=False)
class SupportPolygon:
    """Hold the convex hull of points of contact, seen along gravity.

    Attributes:
        corners: Names of the feet at its corners, with a number for those of a sole, counterclockwise seen from above.
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


def measure_worst_support(
    machine: LeggedMachine,
    X: ArrayLike,
    standing: Sequence[str],
    share: float = 0.1,
    gravity: ArrayLike = (0.0, 0.0, -1.0),
) -> Array:
    """Measure the smallest support margin over all masses that differ from the stated ones by up to a share.

    Each link's mass differs by itself. The distance from an edge is `sum m_i d_i / sum m_i`, d_i that of the centre of
    link i, and least where every link on the near side of it is heavy and every other one light; which side a link is
    on follows from the value itself, so it is lowered until the sides no longer change.

    Args:
        machine: The machine.
        X: Configurations, shape (n, n_variables); the first tells where the feet stand.
        standing: Names of the feet that stand.
        share: Share by which a mass may be larger or smaller [1].
        gravity: Direction of gravity.

    Returns:
        The smallest distance inside the edges [m], shape (n,), below zero where some masses tip the machine over.

    Raises:
        DefinitionError: The share is not in [0, 1), or the feet make no polygon.

    Source: Dinkelbach1967.
    """
    if not 0.0 <= share < 1.0:
        raise DefinitionError(f"share by which masses differ is {share}; it must be in [0, 1)")
    rows = np.atleast_2d(np.asarray(X, dtype=float))
    polygon = build_polygon(machine, rows[0], standing, gravity)
    if len(polygon.corners) < 3:
        raise DefinitionError(f"feet {list(standing)} make no polygon: their corners are {list(polygon.corners)}")
    links, weights = weigh_links(machine)
    masses = weights[:, 3]
    backend = machine.robot.kinematics.functions.backend
    centres = weights[:, :3] / masses[:, None]
    (points,) = _point_function(machine.robot.kinematics.graph, links, backend).batch(rows, centres)
    d = polygon.distances(points.reshape(-1, 3)).reshape(len(rows), len(links), -1).transpose(0, 2, 1)
    worst = d @ masses
    for _ in range(len(links) + 1):
        heavy = np.where(d < worst[:, :, None], 1.0 + share, 1.0 - share) * masses
        lower = np.sum(heavy * d, axis=2) / np.sum(heavy, axis=2)
        if np.all(lower >= worst - 1e-15):
            break
        worst = np.minimum(lower, worst)
    return np.asarray(np.min(worst, axis=1))


def build_polygon(
    machine: LeggedMachine, X: ArrayLike, standing: Sequence[str], gravity: ArrayLike = (0.0, 0.0, -1.0)
) -> SupportPolygon:
    """Build the polygon of the feet that stand in a configuration X (n_variables,).

    A foot with a sole counts with all corners of it, called by the foot's name and a number.
    """
    names: list[str] = []
    points: list[Array] = []
    for name in standing:
        corners = machine.corners(np.asarray(X, dtype=float), name)[0]
        names += [f"{name} {i + 1}" for i in range(len(corners))] if machine.foot(name).sole else [name]
        points += [*corners]
    return SupportPolygon.over(names, np.array(points), gravity)


def weigh_links(machine: LeggedMachine) -> tuple[tuple[str, ...], Array]:
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


@lru_cache(maxsize=64)
def _point_function(graph: ClosureGraph, links: tuple[str, ...], backend: Backend) -> CompiledFunction:
    """Compile the places of points of links in the world, one row for each link."""
    points = ca.SX.sym("points", len(links), 3)
    placed = [graph.X_W[link][:3, :3] @ points[i, :].T + graph.X_W[link][:3, 3] for i, link in enumerate(links)]
    function = ca.Function("paraopt_mass_points", [graph.X, points], [ca.densify(ca.horzcat(*placed).T)], {"cse": True})
    return CompiledFunction(function, backend)


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
