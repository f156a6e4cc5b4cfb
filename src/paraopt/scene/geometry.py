"""Solids in coal: what a body is made of when it is measured. With `collision`, the one door to coal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import coal
import numpy as np

from paraopt.errors import DefinitionError
from paraopt.shapes import (
    Box,
    Cable,
    Capsule,
    Cone,
    ConvexPolyhedron,
    Cylinder,
    HalfSpace,
    Hull,
    Mesh,
    Shape,
    Sphere,
    name_kinds,
)
from paraopt.shapes.polyhedron import build_hull


@dataclass(frozen=True, eq=False)
class Cell:
    """Hold one convex piece of a body.

    Attributes:
        body: Index of the body.
        shape: The piece; the body's own shape unless that is a mesh.
        geometry: coal's solid.
    """

    body: int
    shape: Shape | Cable
    geometry: coal.CollisionGeometry

    @property
    def is_polyhedral(self) -> bool:
        """Tell whether the piece is bounded by planes alone."""
        return isinstance(self.shape, (Box, ConvexPolyhedron))

    def build_hull(self) -> Hull:
        """Build the boundary of a polyhedral piece."""
        if isinstance(self.shape, ConvexPolyhedron):
            return self.shape.hull
        if isinstance(self.shape, Box):
            corners = 0.5 * np.array(list(product((-1.0, 1.0), repeat=3))) * np.asarray(self.shape.size)
            return build_hull(corners, self.shape.label)
        raise DefinitionError(f"{self.shape.label} is not bounded by planes")


def list_cells(shapes: Sequence[Shape | Cable]) -> list[Cell]:
    """List the convex pieces of bodies, those of one body side by side."""
    cells = []
    for body, shape in enumerate(shapes):
        for piece in shape.solids if isinstance(shape, Mesh) else (shape,):
            cells.append(Cell(body, piece, build_geometry(piece)))
    return cells


def build_geometry(shape: Shape | Cable) -> coal.CollisionGeometry:
    """Build coal's solid for a convex shape, in the shape's own frame; for a cable a capsule to be stretched.

    Raises:
        DefinitionError: coal has no solid for this kind of shape here.
    """
    match shape:
        case Box():
            return coal.Box(*np.asarray(shape.size, dtype=float))
        case Sphere():
            return coal.Sphere(shape.radius)
        case Cylinder():
            return coal.Cylinder(shape.radius, shape.length)
        case Capsule():
            return coal.Capsule(shape.radius, shape.length)
        case Cone():
            return coal.Cone(shape.radius, shape.length)
        case HalfSpace():
            return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        case ConvexPolyhedron():
            return _build_convex(shape.hull)
        case Cable():
            return coal.Capsule(shape.radius, 1.0)
    raise DefinitionError(f"{shape.label} cannot be checked for collision; use {name_kinds()}")


def _build_convex(hull: Hull) -> coal.CollisionGeometry:
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in hull.vertices:
        points.append(np.array(vertex))
    for a, b, c in hull.triangles.tolist():
        triangles.append(coal.Triangle(a, b, c))
    return coal.Convex(points, triangles)
