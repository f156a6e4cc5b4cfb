"""Solids given by a few sizes. Round ones run along their own z axis and are centred on their origin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.shapes.base import Shape
from paraopt.spatial import finite_vector, segment_pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Box(Shape):
    """Describe a rectangular box centred on its origin.

    Attributes:
        size: Full lengths along x, y and z [m], shape (3,).
    """

    size: Sequence[float] | NDArray[np.float64]

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "size", finite_vector(self.size, 3, f"size of {self.label}"))
        for length in np.asarray(self.size):
            self._check_size("side", length)

    @property
    def bounding_radius(self) -> float:
        return float(0.5 * np.linalg.norm(self.size))


@dataclass(frozen=True, eq=False, kw_only=True)
class Sphere(Shape):
    """Describe a ball.

    Attributes:
        radius: Radius [m].
    """

    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "radius", self._check_size("radius", self.radius))

    @property
    def bounding_radius(self) -> float:
        return self.radius


@dataclass(frozen=True, eq=False, kw_only=True)
class Cylinder(Shape):
    """Describe a solid cylinder along its z axis.

    Attributes:
        radius: Radius [m].
        length: Length between the flat ends [m].
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "radius", self._check_size("radius", self.radius))
        object.__setattr__(self, "length", self._check_size("length", self.length))

    @property
    def bounding_radius(self) -> float:
        return float(np.hypot(self.radius, 0.5 * self.length))

    @classmethod
    def between(cls, first: Sequence[float], second: Sequence[float], radius: float, name: str = "") -> Cylinder:
        """Place a cylinder whose flat ends are centred on two points [m] of the carrying frame."""
        pose, length = segment_pose(first, second)
        return cls(radius=radius, length=length, pose=pose, name=name)


@dataclass(frozen=True, eq=False, kw_only=True)
class Capsule(Shape):
    """Describe a segment along z thickened by a radius.

    Attributes:
        radius: Radius [m].
        length: Length of the segment [m], round ends not included.
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "radius", self._check_size("radius", self.radius))
        object.__setattr__(self, "length", self._check_size("length", self.length))

    @property
    def bounding_radius(self) -> float:
        return self.radius + 0.5 * self.length

    @classmethod
    def between(cls, first: Sequence[float], second: Sequence[float], radius: float, name: str = "") -> Capsule:
        """Place a capsule whose segment joins two points [m] of the carrying frame."""
        pose, length = segment_pose(first, second)
        return cls(radius=radius, length=length, pose=pose, name=name)


@dataclass(frozen=True, eq=False, kw_only=True)
class Cone(Shape):
    """Describe a solid cone along its z axis: the base at `-length / 2`, the apex at `+length / 2`.

    Attributes:
        radius: Radius of the base [m].
        length: Height from the base to the apex [m].
    """

    radius: float
    length: float

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "radius", self._check_size("radius", self.radius))
        object.__setattr__(self, "length", self._check_size("length", self.length))

    @property
    def bounding_radius(self) -> float:
        return float(np.hypot(self.radius, 0.5 * self.length))

    @classmethod
    def between(cls, first: Sequence[float], second: Sequence[float], radius: float, name: str = "") -> Cone:
        """Place a cone whose base is centred on the first point [m] of the carrying frame, its apex on the second."""
        pose, length = segment_pose(first, second)
        return cls(radius=radius, length=length, pose=pose, name=name)


@dataclass(frozen=True, eq=False, kw_only=True)
class HalfSpace(Shape):
    """Describe all that lies behind a plane, such as the ground or a wall: `z <= 0` in the solid's own frame."""

    @property
    def label(self) -> str:
        """Name the solid in messages."""
        return f"half-space {self.name!r}" if self.name else "half-space"

    @property
    def bounding_radius(self) -> float:
        return float("inf")

    @classmethod
    def behind(cls, point: Sequence[float], normal: Sequence[float], name: str = "") -> HalfSpace:
        """Place the plane through a point [m] of the carrying frame; the normal shows out of the solid."""
        at, out = finite_vector(point, 3, "point of the plane"), finite_vector(normal, 3, "normal of the plane")
        if not np.any(out):
            raise DefinitionError(f"normal of half-space {name!r} is zero; it must show out of the solid")
        pose = np.eye(4)
        pose[:3, :3] = segment_pose((0.0, 0.0, 0.0), out / np.max(np.abs(out)))[0][:3, :3]
        pose[:3, 3] = at
        return cls(pose=pose, name=name)
