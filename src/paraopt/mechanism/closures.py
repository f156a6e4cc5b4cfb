"""Closures: the conditions that turn a tree of links into loops.

A *simple* constraint has equations of its own (`paraopt.closure`). A *closing joint* (`closing_joints`) is made of
simple ones: `expand` lists them by name. Points and directions belong to the frame of the link that is named with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from paraopt.errors import DefinitionError
from paraopt.mechanism.joints import Unknown
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
    """Hold what all closures share: a name, the links and variables that they relate, and variables of their own."""

    name: str

    def __init__(self, *_: Any, **__: Any) -> None:
        raise DefinitionError("a bare Closure has no equations; use Coincidence, Weld, ClosingRevolute, ...")

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise DefinitionError(f"name of a closure is {self.name!r}; it must be a string")

    def _set(self, field: str, value: Any) -> None:
        object.__setattr__(self, field, value)

    @property
    def links(self) -> tuple[str, ...]:
        """Name the links that it relates."""
        return ()

    @property
    def related(self) -> tuple[str, ...]:
        """Name the variables that its equations hold directly, not by way of poses of links."""
        return ()

    @property
    def declared(self) -> tuple[Unknown, ...]:
        """List the variables that it brings with it."""
        return ()

    @property
    def points(self) -> tuple[Vector, ...]:
        """List the points [m] of the description, each in the frame of its link."""
        return ()

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
        """Refuse what has no meaning in the plane z = 0."""


class LinkClosure(Closure):
    """Hold what the closures that tie two links together share: both links, named.

    Fields called `point_*` are points [m], fields called `axis_*`, `normal_*` or `direction_*` are directions; the name
    is `link_A = link_B` when empty.
    """

    link_A: str
    link_B: str

    def __post_init__(self) -> None:
        super().__post_init__()
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

    @property
    def links(self) -> tuple[str, ...]:
        return self.link_A, self.link_B

    @property
    def anchors(self) -> tuple[Vector | None, Vector | None]:
        """Give the points at which the two links are tied together, None where the tie slides or has no place."""
        return None, None

    @property
    def points(self) -> tuple[Vector, ...]:
        return tuple(getattr(self, f.name) for f in fields(self) if f.name.startswith("point_"))  # type: ignore[arg-type]

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
class Coincidence(LinkClosure):
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
class ParallelAxes(LinkClosure):
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
class ParallelPlanes(LinkClosure):
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
class PerpendicularAxes(LinkClosure):
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
class PointOnLine(LinkClosure):
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
class PointOnPlane(LinkClosure):
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
class Weld(LinkClosure):
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
