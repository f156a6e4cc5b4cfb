"""Closing joints: closures made of simple constraints, with the freedoms of a joint.

Where the source gives two constructions, `construction` chooses, and both leave the same motions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from paraopt.errors import DefinitionError
from paraopt.mechanism.closures import (
    Closure,
    Coincidence,
    Direction,
    LinkClosure,
    ParallelAxes,
    ParallelPlanes,
    PerpendicularAxes,
    Point,
    PointOnLine,
    PointOnPlane,
    Vector,
    as_direction,
    unit,
)


class ClosingJoint(LinkClosure):
    """Hold what closures made of simple constraints share.

    Attributes:
        constructions: Names of the ways to make the joint; the first is the default.
    """

    constructions: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        chosen = getattr(self, "construction", None)
        if self.constructions and not (isinstance(chosen, str) and chosen in self.constructions):
            raise DefinitionError(
                f"construction of closure {self.name!r} is {chosen!r}; it must be one of {self.constructions}"
            )
        spread = getattr(self, "spread", None)
        if spread is not None:
            try:
                value = float(spread)
            except (TypeError, ValueError, OverflowError) as error:
                raise DefinitionError(f"spread of closure {self.name!r} is {spread!r}; it must be a number") from error
            if not (np.isfinite(value) and value > 0):
                raise DefinitionError(f"spread of closure {self.name!r} is {value} m; it must be finite and above 0")
            self._set("spread", value)

    def expand(self, planar: bool = False) -> tuple[Closure, ...]:
        return self._in_plane() if planar else self._in_space()

    def _in_space(self) -> tuple[Closure, ...]:
        raise DefinitionError(f"no construction is known for a closure of type {type(self).__name__}")

    def _in_plane(self) -> tuple[Closure, ...]:
        raise DefinitionError(f"closure {self.name!r} is a {type(self).__name__}; it has no meaning in the plane")

    def _part(self, part: str) -> str:
        return f"{self.name}: {part}"

    def _reach(self) -> float:
        """Give the distance between the points that a construction sets apart [m]."""
        stated: float | None = getattr(self, "spread", None)
        if stated is not None:
            return stated
        return max([float(np.linalg.norm(p)) for p in self.points if any(p)], default=1.0)


def along(point: Any, direction: Any, distance: float) -> Vector:
    """Give the point at a distance [m] from another along a direction."""
    x, y, z = (np.asarray(point) + distance * np.asarray(unit(direction))).tolist()
    return (x, y, z)


def perpendicular(direction: Any) -> tuple[Vector, Vector]:
    """Give two unit directions perpendicular to one and to each other; base axes for base axes."""
    u = np.asarray(unit(direction))
    helper = np.roll(np.eye(3)[int(np.argmax(np.abs(u)))], 1)
    v = helper - (helper @ u) * u
    v /= np.linalg.norm(v)
    w = np.cross(u, v)
    (a, b, c), (d, e, f) = (v + 0.0).tolist(), (w + 0.0).tolist()
    return (a, b, c), (d, e, f)


@dataclass(frozen=True)
class ClosingSpherical(ClosingJoint):
    """Close a loop by a spherical joint: 3 freedoms left. Made of a coincidence.

    Attributes:
        link_A: Name of the first link.
        point_A: Centre in the first link's frame [m].
        link_B: Name of the second link.
        point_B: Centre in the second link's frame [m].
        name: Name; `link_A = link_B` when empty.
    """

    link_A: str
    point_A: Point
    link_B: str
    point_B: Point
    name: str = ""

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        return self.point_A, self.point_B  # type: ignore[return-value]

    def _in_space(self) -> tuple[Closure, ...]:
        return (Coincidence(self.link_A, self.point_A, self.link_B, self.point_B, self._part("centre")),)


@dataclass(frozen=True)
class ClosingUniversal(ClosingJoint):
    """Close a loop by a universal joint: 2 freedoms left. Made of a coincidence and two perpendicular axes.

    Attributes:
        link_A: Name of the first link.
        point_A: Centre in the first link's frame [m].
        axis_A: Axis of the cross that is fixed to the first link.
        link_B: Name of the second link.
        point_B: Centre in the second link's frame [m].
        axis_B: Axis of the cross that is fixed to the second link.
        name: Name; `link_A = link_B` when empty.
    """

    link_A: str
    point_A: Point
    axis_A: Direction
    link_B: str
    point_B: Point
    axis_B: Direction
    name: str = ""

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        return self.point_A, self.point_B  # type: ignore[return-value]

    def _in_space(self) -> tuple[Closure, ...]:
        return (
            Coincidence(self.link_A, self.point_A, self.link_B, self.point_B, self._part("centre")),
            PerpendicularAxes(self.link_A, self.axis_A, self.link_B, self.axis_B, self._part("cross")),
        )


@dataclass(frozen=True)
class ClosingCylindrical(ClosingJoint):
    """Close a loop by a cylindrical joint: 2 freedoms left.

    Attributes:
        link_A: Name of the first link.
        point_A: A point of the axis in the first link's frame [m].
        axis_A: The axis in the first link's frame.
        link_B: Name of the second link.
        point_B: A point of the axis in the second link's frame [m].
        axis_B: The axis in the second link's frame.
        name: Name; `link_A = link_B` when empty.
        construction: "two points on a line", or "point on line, parallel axes".
        spread: Distance between the two points [m]; that of the points from their origins when None.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Point
    axis_A: Direction
    link_B: str
    point_B: Point
    axis_B: Direction
    name: str = ""
    construction: Literal["two points on a line", "point on line, parallel axes"] = "two points on a line"
    spread: float | None = None
    constructions: ClassVar[tuple[str, ...]] = ("two points on a line", "point on line, parallel axes")

    def _in_space(self) -> tuple[Closure, ...]:
        A, B = self.link_A, self.link_B
        first = PointOnLine(A, self.point_A, B, self.point_B, self.axis_B, self._part("point on line"))
        if self.construction == self.constructions[1]:
            return first, ParallelAxes(A, self.axis_A, B, self.axis_B, self._part("axes"))
        other = along(self.point_A, self.axis_A, self._reach())
        return first, PointOnLine(A, other, B, self.point_B, self.axis_B, self._part("second point on line"))


@dataclass(frozen=True)
class ClosingRevolute(ClosingJoint):
    """Close a loop by a revolute joint: 1 freedom left. In the plane it is a coincidence.

    Attributes:
        link_A: Name of the first link.
        point_A: A point of the axis in the first link's frame [m].
        axis_A: The axis in the first link's frame.
        link_B: Name of the second link.
        point_B: The same point in the second link's frame [m].
        axis_B: The axis in the second link's frame.
        name: Name; `link_A = link_B` when empty.
        construction: "two coincidences", or "cylindrical, point on plane", which also allows opposite axes.
        spread: Distance between the two points [m]; that of the points from their origins when None.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Point
    axis_A: Direction
    link_B: str
    point_B: Point
    axis_B: Direction
    name: str = ""
    construction: Literal["two coincidences", "cylindrical, point on plane"] = "two coincidences"
    spread: float | None = None
    constructions: ClassVar[tuple[str, ...]] = ("two coincidences", "cylindrical, point on plane")

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        return self.point_A, self.point_B  # type: ignore[return-value]

    def _in_space(self) -> tuple[Closure, ...]:
        A, p_A, B, p_B = self.link_A, self.point_A, self.link_B, self.point_B
        reach = self._reach()
        if self.construction == self.constructions[0]:
            q_A, q_B = along(p_A, self.axis_A, reach), along(p_B, self.axis_B, reach)
            return (
                Coincidence(A, p_A, B, p_B, self._part("first point")),
                Coincidence(A, q_A, B, q_B, self._part("second point")),
            )
        sleeve = ClosingCylindrical(A, p_A, self.axis_A, B, p_B, self.axis_B, self._part("sleeve"), spread=reach)
        stop = PointOnPlane(A, p_A, B, p_B, self.axis_B, self._part("stop"))
        return (*sleeve.expand(), stop)

    def _in_plane(self) -> tuple[Closure, ...]:
        for axis in (self.axis_A, self.axis_B):
            if axis[0] != 0 or axis[1] != 0:
                raise DefinitionError(f"closure {self.name!r} has axis {axis}; in the plane a revolute turns about z")
        return Coincidence(self.link_A, self.point_A, self.link_B, self.point_B, self._part("pivot")).expand(True)


@dataclass(frozen=True)
class ClosingPrismatic(ClosingJoint):
    """Close a loop by a prismatic joint: 1 freedom left. In the plane the axis lies in the plane.

    The rotation about the axis is stopped by a second direction on both links, perpendicular to the axis; where it is
    not stated, it is the next base axis (x, y, z, x) for an axis that is one.

    Attributes:
        link_A: Name of the first link.
        point_A: A point of the axis in the first link's frame [m].
        axis_A: The axis in the first link's frame.
        link_B: Name of the second link.
        point_B: A point of the axis in the second link's frame [m].
        axis_B: The axis in the second link's frame.
        direction_A: Direction across the axis in the first link's frame.
        direction_B: The same direction in the second link's frame.
        name: Name; `link_A = link_B` when empty.
        construction: "cylindrical, parallel axes", or "cylindrical, point on plane".
        spread: Distance between constructed points [m]; that of the points from their origins when None.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Point
    axis_A: Direction
    link_B: str
    point_B: Point
    axis_B: Direction
    direction_A: Direction | None = None
    direction_B: Direction | None = None
    name: str = ""
    construction: Literal["cylindrical, parallel axes", "cylindrical, point on plane"] = "cylindrical, parallel axes"
    spread: float | None = None
    constructions: ClassVar[tuple[str, ...]] = ("cylindrical, parallel axes", "cylindrical, point on plane")

    def __post_init__(self) -> None:
        for side in ("A", "B"):
            if getattr(self, f"direction_{side}") is None:
                axis = as_direction(getattr(self, f"axis_{side}"), f"axis_{side} in closure {self.name!r}")
                self._set(f"direction_{side}", perpendicular(axis)[0])
        super().__post_init__()
        for side in ("A", "B"):
            axis, across = (unit(getattr(self, f"{f}_{side}")) for f in ("axis", "direction"))
            cosine = float(np.dot(axis, across))
            if abs(cosine) > 1e-9:
                raise DefinitionError(
                    f"direction_{side} of closure {self.name!r} makes a cosine of {cosine:.3g} with its axis; "
                    "it must be perpendicular"
                )

    def _in_space(self) -> tuple[Closure, ...]:
        A, p_A, B, p_B = self.link_A, self.point_A, self.link_B, self.point_B
        reach = self._reach()
        sleeve = ClosingCylindrical(A, p_A, self.axis_A, B, p_B, self.axis_B, self._part("sleeve"), spread=reach)
        if self.construction == self.constructions[0]:
            key: Closure = ParallelAxes(A, self.direction_A, B, self.direction_B, self._part("key"))  # type: ignore[arg-type]
        else:
            normal = np.cross(unit(self.axis_B), unit(self.direction_B)).tolist()  # type: ignore[arg-type]
            key = PointOnPlane(A, along(p_A, self.direction_A, reach), B, p_B, normal, self._part("key"))
        return (*sleeve.expand(), key)

    def _in_plane(self) -> tuple[Closure, ...]:
        A, p_A, B, p_B = self.link_A, self.point_A, self.link_B, self.point_B
        first = PointOnLine(A, p_A, B, p_B, self.axis_B, self._part("point on line"))
        second: Closure = ParallelAxes(A, self.axis_A, B, self.axis_B, self._part("axes"))
        if self.construction == self.constructions[1]:
            other = along(p_A, self.axis_A, self._reach())
            second = PointOnLine(A, other, B, p_B, self.axis_B, self._part("second point on line"))
        return (*first.expand(True), *second.expand(True))


@dataclass(frozen=True)
class PlanarContact(ClosingJoint):
    """Keep a plane of one link on a plane of another: 3 freedoms left.

    Attributes:
        link_A: Name of the first link.
        point_A: A point of the plane in the first link's frame [m].
        normal_A: Normal in the first link's frame.
        link_B: Name of the second link.
        point_B: A point of the plane in the second link's frame [m].
        normal_B: Normal in the second link's frame.
        name: Name; `link_A = link_B` when empty.
        construction: "point on plane, parallel planes", or "three points on a plane".
        spread: Distance between the three points [m]; that of the points from their origins when None.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Point
    normal_A: Direction
    link_B: str
    point_B: Point
    normal_B: Direction
    name: str = ""
    construction: Literal["point on plane, parallel planes", "three points on a plane"] = (
        "point on plane, parallel planes"
    )
    spread: float | None = None
    constructions: ClassVar[tuple[str, ...]] = ("point on plane, parallel planes", "three points on a plane")

    def _in_space(self) -> tuple[Closure, ...]:
        A, p_A, B, p_B, n_B = self.link_A, self.point_A, self.link_B, self.point_B, self.normal_B
        first = PointOnPlane(A, p_A, B, p_B, n_B, self._part("point on plane"))
        if self.construction == self.constructions[0]:
            return first, ParallelPlanes(A, self.normal_A, B, n_B, self._part("planes"))
        others = [along(p_A, d, self._reach()) for d in perpendicular(self.normal_A)]
        words = ("second", "third")
        return first, *(
            PointOnPlane(A, q, B, p_B, n_B, self._part(f"{word} point on plane"))
            for word, q in zip(words, others, strict=True)
        )


@dataclass(frozen=True)
class LineContact(ClosingJoint):
    """Keep a line of one link on a plane of another: 4 freedoms left.

    Attributes:
        link_A: Name of the link that carries the line.
        point_A: A point of the line in its frame [m].
        axis_A: Direction of the line in its frame.
        link_B: Name of the link that carries the plane.
        point_B: A point of the plane in its frame [m].
        normal_B: Normal of the plane in its frame.
        name: Name; `link_A = link_B` when empty.
        construction: "point on plane, direction", or "two points on a plane".
        spread: Distance between the two points [m]; that of the points from their origins when None.

    Source: Lahouar, II.16.
    """

    link_A: str
    point_A: Point
    axis_A: Direction
    link_B: str
    point_B: Point
    normal_B: Direction
    name: str = ""
    construction: Literal["point on plane, direction", "two points on a plane"] = "point on plane, direction"
    spread: float | None = None
    constructions: ClassVar[tuple[str, ...]] = ("point on plane, direction", "two points on a plane")

    def _in_space(self) -> tuple[Closure, ...]:
        A, p_A, B, p_B, n_B = self.link_A, self.point_A, self.link_B, self.point_B, self.normal_B
        first = PointOnPlane(A, p_A, B, p_B, n_B, self._part("point on plane"))
        if self.construction == self.constructions[0]:
            return first, PerpendicularAxes(A, self.axis_A, B, n_B, self._part("direction"))
        other = along(p_A, self.axis_A, self._reach())
        return first, PointOnPlane(A, other, B, p_B, n_B, self._part("second point on plane"))
