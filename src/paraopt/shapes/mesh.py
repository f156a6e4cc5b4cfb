"""Meshes: triangles to look at, convex parts to measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.shapes.base import Shape
from paraopt.shapes.polyhedron import ConvexPolyhedron, as_points, build_hull

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh(Shape):
    """Describe a solid by a mesh of triangles, and by convex parts that cover it and are what is measured.

    Attributes:
        vertices: Corners in the solid's own frame [m], shape (k, 3).
        triangles: Corners of each triangle, counter-clockwise from outside, shape (m, 3).
        parts: Corners of each convex part [m], shape (k_i, 3) each; none where the mesh is closed and convex.

    Raises:
        DefinitionError: The mesh is not convex and has no parts, or its parts leave out some of it (more than a
            thousandth of its extent); `decompose_mesh` finds parts.
    """

    vertices: ArrayLike
    triangles: ArrayLike
    parts: Sequence[ArrayLike] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        points = as_points(self.vertices, f"vertices of {self.label}")
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "triangles", as_triangles(self.triangles, len(points), self.label))
        try:
            parts = tuple(self.parts)
        except TypeError as error:
            raise DefinitionError(f"parts of {self.label} are {self.parts!r:.60}; they must be arrays") from error
        parts = tuple(as_points(part, f"part {i + 1} of {self.label}") for i, part in enumerate(parts))
        object.__setattr__(self, "parts", parts)
        if not parts:
            check_convex(points, np.asarray(self.triangles), self.label)
        elif self.departure > 1e-3 * float(np.max(np.ptp(points, axis=0))):
            raise DefinitionError(
                f"parts of {self.label} leave out some of it: a point sticks out by {self.departure:.3g} m; "
                "give parts that cover it, as decompose_mesh does"
            )

    @cached_property
    def solids(self) -> tuple[ConvexPolyhedron, ...]:
        """Give the convex parts as solids in the mesh's own frame."""
        name = self.label
        return tuple(
            ConvexPolyhedron(vertices=part, name=f"{name}, part {i + 1}")
            for i, part in enumerate(self.parts or (self.vertices,))
        )

    @cached_property
    def departure(self) -> float:
        """Give the largest distance by which looked-at points of the mesh lie outside all parts [m].

        Corners, middles of sides and middles of triangles are looked at.
        """
        return float(np.max(outside_of(list_surface_points(self.vertices, self.triangles), self.solids).min(axis=1)))

    @property
    def bounding_radius(self) -> float:
        return max(solid.bounding_radius for solid in self.solids)


def list_surface_points(vertices: ArrayLike, triangles: ArrayLike) -> Array:
    """List corners, middles of sides and middles of triangles of a mesh [m], shape (n, 3)."""
    points, corners = np.asarray(vertices), np.asarray(vertices)[np.asarray(triangles)]
    middles = 0.5 * (corners + np.roll(corners, 1, axis=1))
    return np.vstack([points, middles.reshape(-1, 3), corners.mean(axis=1)])


def outside_of(points: Array, solids: Sequence[ConvexPolyhedron]) -> Array:
    """Give by how much each point violates the facets of each convex part [m], 0 inside; shape (n, n_parts).

    It is the distance to the farthest violated facet, a lower bound of the distance to the part.
    """
    columns = [np.max(points @ s.hull.normals.T - s.hull.offsets, axis=1) for s in solids]
    return np.maximum(np.column_stack(columns), 0.0)


def as_triangles(values: Any, n_vertices: int, what: str) -> NDArray[np.intp]:
    """Copy triangles into a read-only array of indices, shape (m, 3).

    Raises:
        DefinitionError: They are not whole numbers in the range of the vertices, or a triangle repeats a corner.
    """
    try:
        numbers = np.array(values, dtype=float)
        indices = numbers.astype(int) if np.all(np.abs(numbers) < 1e15) else np.full(numbers.shape, -1)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"triangles of {what} are {values!r:.60}; they must be whole numbers") from error
    if indices.ndim != 2 or indices.shape[1] != 3 or not len(indices):
        raise DefinitionError(f"triangles of {what} are of shape {indices.shape}; it must be (m, 3)")
    fits = np.all((indices == numbers) & (indices >= 0) & (indices < n_vertices), axis=1)
    if not np.all(fits):
        row = int(np.argmin(fits))
        raise DefinitionError(
            f"triangle {row} of {what} is {numbers[row].tolist()}; it must hold numbers from 0 to {n_vertices - 1}"
        )
    doubled = np.any(indices == np.roll(indices, 1, axis=1), axis=1)
    if np.any(doubled):
        row = int(np.argmax(doubled))
        raise DefinitionError(f"triangle {row} of {what} is {indices[row].tolist()}; its corners must differ")
    indices.flags.writeable = False
    return indices


def check_closed(triangles: NDArray[np.intp], what: str) -> None:
    """Refuse a mesh that does not enclose a volume: each side must belong to two triangles that agree on the outside.

    Raises:
        DefinitionError: A side is open or shared by triangles that run the same way.
    """
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    pairs, where, counts = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    balance = np.zeros(len(pairs), dtype=int)
    np.add.at(balance, where.ravel(), np.where(sides[:, 0] < sides[:, 1], 1, -1))
    bad = (counts != 2) | (balance != 0)
    if np.any(bad):
        k = int(np.argmax(bad))
        raise DefinitionError(
            f"{what} is not closed: the side between vertices {pairs[k, 0]} and {pairs[k, 1]} belongs to {counts[k]} "
            f"triangle{'s' if counts[k] != 1 else ''}{', turned the same way' if counts[k] == 2 else ''}; "
            "each side must belong to 2 that agree on the outside"
        )


def check_convex(points: Array, triangles: NDArray[np.intp], what: str, tolerance: float = 1e-6) -> None:
    """Refuse a mesh that is not closed, or that fills less of its convex hull than the tolerance [1] allows.

    Raises:
        DefinitionError: The mesh is open, flat or not convex.
    """
    check_closed(triangles, what)
    hull = build_hull(points[np.unique(triangles)], what)
    a, b, c = (points[triangles[:, k]] - points.mean(axis=0) for k in range(3))
    volume = abs(float(np.sum(np.einsum("ij,ij->i", a, np.cross(b, c))))) / 6.0
    if abs(volume / hull.volume - 1.0) > tolerance:
        raise DefinitionError(
            f"{what} is not convex: it fills {volume / hull.volume:.6g} of its hull; give its convex parts, or find "
            "them by decompose_mesh"
        )
