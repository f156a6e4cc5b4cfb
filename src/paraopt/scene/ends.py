"""What a cable's ends are on: the places where it leaves its winch or its eye, which do not count as touched."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from paraopt.errors import DefinitionError
from paraopt.scene.exact import measure_point_and_cylinder
from paraopt.shapes import (
    Box,
    Cable,
    Capsule,
    Cone,
    ConvexPolyhedron,
    Cylinder,
    HalfSpace,
    Mesh,
    Shape,
    Sphere,
    name_kinds,
)

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Tie:
    """Describe how a link is tied to another: by what, and at which points (None when it slides).

    Attributes:
        other: Name of the other link.
        kind: By what, in words.
        point: Place of the tie on the link [m].
        point_other: The same place on the other link [m].
    """

    other: str
    kind: str
    point: Point | None
    point_other: Point | None


def is_near(a: Sequence[float] | None, b: Sequence[float] | None, reach: float) -> bool:
    """Tell whether two points of one link are at the same place; never for a tie that slides."""
    return a is not None and b is not None and math.dist(a, b) <= reach


def find_places(ties: Mapping[str, Sequence[Tie]], cable: Cable) -> tuple[dict[str, Sequence[float]], ...]:
    """Name the links that meet where a cable ends, for its first and its second end.

    The link that carries the end is the first of them; the others are tied to it there by a joint or a closure, such as
    a pulley and the frame in which it turns.

    Args:
        ties: Ties of every link, by its name.
        cable: The cable.

    Returns:
        For each end the place on every such link [m], by name of link.
    """
    ends = []
    for start, point in zip(cable.links, cable.points, strict=True):
        places: dict[str, Sequence[float]] = {start: point}
        waiting = [start]
        while waiting:
            here = waiting.pop()
            for tie in ties[here]:
                if tie.other in places or tie.point_other is None or not is_near(tie.point, places[here], cable.radius):
                    continue
                places[tie.other] = tie.point_other
                waiting.append(tie.other)
        ends.append(places)
    return tuple(ends)


def why_not_solid(
    solid: Shape, link: str, cable: Cable, places: Sequence[Mapping[str, Sequence[float]]], name: str
) -> str:
    """Tell why a cable need not be checked against a solid of a link; an empty string where it must.

    Args:
        solid: The solid.
        link: The link that carries it.
        cable: The cable.
        places: Where its ends are, of `find_places`.
        name: Name of the solid.
    """
    for at, ignored in zip(places, cable.ignore, strict=True):
        if link not in at:
            continue
        if ignored == 0.0 and holds(solid, at[link], cable.radius):
            return f"the cable ends on {name!r}"
        # what remains of a straight cable never comes back into the ball of the length that is left out
        if math.dist(solid.pose[:3, 3], at[link]) + solid.bounding_radius <= ignored - cable.radius:
            return f"{name!r} lies within the length that is ignored at the cable's end"
    return ""


def why_not_cables(
    one: Cable,
    other: Cable,
    places_one: Sequence[Mapping[str, Sequence[float]]],
    places_other: Sequence[Mapping[str, Sequence[float]]],
) -> str:
    """Tell why two cables need not be checked against each other; an empty string where they must.

    Two straight cables from one place meet again only where they lie along each other.
    """
    for a in places_one:
        for b in places_other:
            for link in a:
                if link in b and math.dist(a[link], b[link]) <= one.radius + other.radius:
                    return f"both end at one place of {link!r}"
    return ""


def holds(solid: Shape, point: Sequence[float], radius: float) -> bool:
    """Tell whether a ball about a point meets a solid.

    Beyond the edges of a cone or of a polyhedron the answer is generous: the ball has to reach every plane, not the
    edge.

    Args:
        solid: The solid, placed by its `pose`.
        point: The point, in the frame that carries the solid [m].
        radius: Radius of the ball [m].

    Raises:
        DefinitionError: The solid is of an unknown kind.
    """
    p = (np.asarray(point, dtype=float) - solid.pose[:3, 3]) @ solid.pose[:3, :3]
    match solid:
        case Box():
            away = float(np.linalg.norm(np.maximum(np.abs(p) - 0.5 * np.asarray(solid.size), 0.0)))
        case Sphere():
            away = float(np.linalg.norm(p)) - solid.radius
        case Cylinder():
            away = float(
                measure_point_and_cylinder(p[None], np.array([solid.radius]), np.array([0.5 * solid.length]))[0][0]
            )
        case Capsule():
            half = 0.5 * solid.length
            away = math.dist(p, (0.0, 0.0, min(max(p[2], -half), half))) - solid.radius
        case Cone():
            slope = math.hypot(solid.radius, solid.length)
            side = (math.hypot(p[0], p[1]) * solid.length + (p[2] - 0.5 * solid.length) * solid.radius) / slope
            away = max(side, -p[2] - 0.5 * solid.length)
        case HalfSpace():
            away = float(p[2])
        case ConvexPolyhedron():
            away = float(np.max(solid.hull.normals @ p - solid.hull.offsets))
        case Mesh():
            return any(holds(part, p.tolist(), radius) for part in solid.solids)
        case _:
            raise DefinitionError(f"{solid.label} cannot be checked for collision; use {name_kinds()}")
    return bool(away <= radius * (1.0 + 1e-9))
