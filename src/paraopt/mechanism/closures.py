"""Closures: the conditions that turn a tree of links into loops.

A *simple* constraint has equations of its own (`paraopt.closure`). A *closing joint* is made of simple ones:
`expand` lists them by name; where the source gives two constructions, `construction` chooses, and both leave the same
motions. Points and directions belong to the frame of the link that is named with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

import numpy as np

from paraopt.errors import DefinitionError
from paraopt.mechanism.links import as_point
from paraopt.spatial import AXES, finite_vector

Point = Sequence[float]
Direction = str | Sequence[float]
Vector = tuple[float, float, float]
_UNIT: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def as_direction(value: Any, what: str) -> Vector:
    """Read a direction: "x", "y", "z", the same with a minus, or two or three components, not all zero."""
    if isinstance(value, str):
        axis = value.removeprefix("-")
        if axis not in _UNIT:
            raise DefinitionError(f"{what} is {value!r}; it must be one of {AXES}, '-' before it allowed, or a vector")
        sign = -1.0 if value.startswith("-") else 1.0
        x, y, z = (sign * c + 0.0 for c in _UNIT[axis])
        return (x, y, z)
    vector = as_point(value, what)
    if not np.linalg.norm(vector) > 1e-150:  # below, its square is zero
        raise DefinitionError(f"{what} is {vector}; it must not be zero")
    return vector


def unit(direction: Vector) -> Vector:
    """Scale a direction to length one."""
    x, y, z = (np.asarray(direction) / np.linalg.norm(direction)).tolist()
    return (x, y, z)


class Closure:
    """Hold what all closures share: two links, named, and a name.

    Fields called `point_*` are points [m], fields called `axis_*`, `normal_*` or `direction_*` are directions; the name
    is `link_A = link_B` when empty.
    """

    link_A: str
    link_B: str
    name: str

    def __init__(self, link_A: str, link_B: str, name: str = "") -> None:
        raise DefinitionError("a bare Closure has no equations; use Coincidence, Weld, ClosingRevolute, ...")

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise DefinitionError(f"name of a closure is {self.name!r}; it must be a string")
        for side in ("link_A", "link_B"):
            if not isinstance(getattr(self, side), str):
                raise DefinitionError(f"{side} of a closure is {getattr(self, side)!r}; it must be the name of a link")
        self._set("name", self.name or f"{self.link_A} = {self.link_B}")
        for field in fields(self):  # type: ignore[arg-type]
            kind, side = field.name.split("_")[0], field.name[-1]
            value = getattr(self, field.name)
            what = f"{kind} of {getattr(self, f'link_{side}', '')!r} in closure {self.name!r}"
            if kind == "point":
                self._set(field.name, as_point(value, what))
            elif kind in ("axis", "normal", "direction"):
                self._set(field.name, as_direction(value, what))

    def _set(self, field: str, value: Any) -> None:
        object.__setattr__(self, field, value)

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        """Give the points at which the two links are tied together, None where the tie slides or has no place."""
        return None, None

    @property
    def points(self) -> tuple[Vector, ...]:
        """List the points [m] of the description, each in the frame of its link."""
        return tuple(getattr(self, f.name) for f in fields(self) if f.name.startswith("point_"))  # type: ignore[arg-type]

    def expand(self, planar: bool = False) -> tuple[Closure, ...]:
        """List the simple constraints that this closure is made of.

        Args:
            planar: Whether the machine moves in the plane z = 0.

        Raises:
            DefinitionError: The closure has no meaning in the plane.
        """
        if planar:
            self._check_planar()
        return (self,)

    def _check_planar(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            kind = field.name.split("_")[0]
            if kind == "point" and value[2] != 0:
                raise DefinitionError(f"closure {self.name!r} has a point out of its plane: {field.name} is {value} m")
            if kind in ("axis", "normal", "direction") and value[2] != 0:
                raise DefinitionError(
                    f"closure {self.name!r} has a direction out of its plane: {field.name} is {value}"
                )


# --- Simple constraints


@dataclass(frozen=True)
class Coincidence(Closure):
    """Keep a point of one link on a point of another: `p_A - p_B = 0`, 3 equations (2 in the plane).

    Attributes:
        link_A: Name of the first link.
        point_A: Point in the first link's frame [m].
        link_B: Name of the second link.
        point_B: Point in the second link's frame [m].
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Point
    link_B: str
    point_B: Point
    name: str = ""

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        return self.point_A, self.point_B  # type: ignore[return-value]


@dataclass(frozen=True)
class ParallelAxes(Closure):
    """Keep an axis of one link parallel to an axis of another: `u_A x u_B = 0`, 3 equations of rank 2 (1 in the plane).

    Attributes:
        link_A: Name of the first link.
        axis_A: Axis in the first link's frame.
        link_B: Name of the second link.
        axis_B: Axis in the second link's frame.
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.1.
    """

    link_A: str
    axis_A: Direction
    link_B: str
    axis_B: Direction
    name: str = ""


@dataclass(frozen=True)
class ParallelPlanes(Closure):
    """Keep a plane of one link parallel to a plane of another: `n_A x n_B = 0`, 3 equations of rank 2.

    Attributes:
        link_A: Name of the first link.
        normal_A: Normal of the plane in the first link's frame.
        link_B: Name of the second link.
        normal_B: Normal of the plane in the second link's frame.
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.1.
    """

    link_A: str
    normal_A: Direction
    link_B: str
    normal_B: Direction
    name: str = ""


@dataclass(frozen=True)
class PerpendicularAxes(Closure):
    """Keep an axis of one link perpendicular to an axis of another: `u_A . u_B = 0`, 1 equation.

    Attributes:
        link_A: Name of the first link.
        axis_A: Axis in the first link's frame.
        link_B: Name of the second link.
        axis_B: Axis in the second link's frame.
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.16.
    """

    link_A: str
    axis_A: Direction
    link_B: str
    axis_B: Direction
    name: str = ""


@dataclass(frozen=True)
class PointOnLine(Closure):
    """Keep a point of one link on a line of another (linear annular): `(p_A - p_B) x u_B = 0`, 3 equations of rank 2.

    In the plane it is 1 equation.

    Attributes:
        link_A: Name of the link that carries the point.
        point_A: The point in its frame [m].
        link_B: Name of the link that carries the line.
        point_B: A point of the line in its frame [m].
        axis_B: Direction of the line in its frame.
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Point
    link_B: str
    point_B: Point
    axis_B: Direction
    name: str = ""

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        return self.point_A, None  # type: ignore[return-value]


@dataclass(frozen=True)
class PointOnPlane(Closure):
    """Keep a point of one link on a plane of another (point contact): `(p_A - p_B) . n_B = 0`, 1 equation.

    Attributes:
        link_A: Name of the link that carries the point.
        point_A: The point in its frame [m].
        link_B: Name of the link that carries the plane (in the plane: a line).
        point_B: A point of the plane in its frame [m].
        normal_B: Normal of the plane in its frame.
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Point
    link_B: str
    point_B: Point
    normal_B: Direction
    name: str = ""

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        return self.point_A, None  # type: ignore[return-value]


@dataclass(frozen=True)
class Weld(Closure):
    """Hold one link in a constant pose relative to another: `X_A X_AB = X_B`.

    12 equations of rank 6: three of the positions and the nine entries of the rotations. In the plane 4 of rank 3.

    Attributes:
        link_A: Name of the first link.
        link_B: Name of the second link.
        at: Origin of the second link in the first link's frame [m].
        rotation: Angles (alpha, beta, gamma) [rad] of `R_AB = Rx Ry Rz`.
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.1.
    """

    link_A: str
    link_B: str
    at: Point = (0.0, 0.0, 0.0)
    rotation: Sequence[float] = (0.0, 0.0, 0.0)
    name: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("at", as_point(self.at, f"at in closure {self.name!r}"))
        angles = finite_vector(self.rotation, 3, f"rotation in closure {self.name!r}")
        self._set("rotation", tuple(angles.tolist()))

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        return self.at, (0.0, 0.0, 0.0)  # type: ignore[return-value]

    @property
    def points(self) -> tuple[Vector, ...]:
        return (self.at,)  # type: ignore[return-value]

    def _check_planar(self) -> None:
        if self.at[2] != 0 or self.rotation[0] != 0 or self.rotation[1] != 0:
            raise DefinitionError(f"closure {self.name!r} has a pose out of its plane: at {self.at}, {self.rotation}")


# --- Closing joints


class ClosingJoint(Closure):
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
