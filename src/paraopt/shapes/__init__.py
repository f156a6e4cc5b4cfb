"""Bodies: solids as frozen data, each with its pose in the frame it is placed in.

A shape on a link is placed by `X_LS` (pose of the shape in the link's frame), an obstacle by `X_WS` (in the world).
Cylinders, capsules and cones run along their own z axis and are centred on their origin; a half-space fills `z <= 0`.
A cable is no such solid: it is stretched between points of two links.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from paraopt.errors import DefinitionError
from paraopt.shapes.base import Shape
from paraopt.shapes.cable import Cable, check_cables
from paraopt.shapes.decompose import DecomposeOptions, decompose_mesh, load_mesh
from paraopt.shapes.mesh import Mesh
from paraopt.shapes.polyhedron import ConvexPolyhedron, Hull
from paraopt.shapes.primitives import Box, Capsule, Cone, Cylinder, HalfSpace, Sphere

__all__ = [
    "SOLIDS",
    "Box",
    "Cable",
    "Capsule",
    "Cone",
    "ConvexPolyhedron",
    "Cylinder",
    "DecomposeOptions",
    "HalfSpace",
    "Hull",
    "Mesh",
    "Shape",
    "Sphere",
    "check_cables",
    "check_solids",
    "decompose_mesh",
    "load_mesh",
    "name_kinds",
]

SOLIDS: tuple[type[Shape], ...] = (Box, Sphere, Cylinder, Capsule, Cone, HalfSpace, ConvexPolyhedron, Mesh)
"""The solids whose distance can be measured."""


def name_kinds() -> str:
    """List the solids in words, for messages."""
    names = [kind.__name__ for kind in SOLIDS]
    return f"{', '.join(names[:-1])} or {names[-1]}"


def check_solids(shapes: Any, what: str) -> tuple[Shape, ...]:
    """Refuse anything but a sequence of solids whose distance can be measured.

    Args:
        shapes: What was given.
        what: Names it in the message.

    Returns:
        The solids.

    Raises:
        DefinitionError: It is no sequence, or holds something that is none of the `SOLIDS`.
    """
    kinds = name_kinds()
    if isinstance(shapes, (str, bytes)) or not isinstance(shapes, Iterable):
        raise DefinitionError(f"{what}: {shapes!r} is given; it must be a list of {kinds}")
    try:
        solids = tuple(shapes)
    except TypeError as error:  # an array without dimension says that it is iterable
        raise DefinitionError(f"{what}: {shapes!r} is given; it must be a list of {kinds}") from error
    for solid in solids:
        if not isinstance(solid, Shape):
            raise DefinitionError(f"{what}: {solid!r} is not a shape; use {kinds}")
        if not isinstance(solid, SOLIDS):
            raise DefinitionError(f"{what}: {solid.label} cannot be checked for collision; use {kinds}")
    return solids
