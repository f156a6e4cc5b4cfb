"""Bodies: simple solids as frozen data, each with its pose in the frame it is placed in.

A shape on a link is placed by `X_LS` (pose of the shape in the link's frame), an obstacle by `X_WS` (in the world).
Cylinders and capsules run along their own z axis and are centred on their origin.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.spatial import check_pose, finite_vector, segment_pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """Hold what all solids share.

    Attributes:
        name: Name within its link or scene; chosen by the owner when empty.
        pose: Pose of the solid in the frame that carries it, shape (4, 4).
    """

    name: str = ""
    pose: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise DefinitionError(f"name of a {type(self).__name__.lower()} is {self.name!r}; it must be a string")
        object.__setattr__(self, "pose", check_pose(self.pose, f"pose of {self.label}"))

    @property
    def label(self) -> str:
        """Name the solid in messages."""
        return f"{type(self).__name__.lower()} {self.name!r}" if self.name else type(self).__name__.lower()

    @property
    def bounding_radius(self) -> float:
        """Give the radius of the sphere about the solid's origin that contains it [m]."""
        raise DefinitionError(f"{self.label}: a bare Shape has no size; use Box, Sphere, Cylinder or Capsule")

    def _check_size(self, quantity: str, value: Any) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError) as error:
            raise DefinitionError(f"{quantity} of {self.label} is {value!r}; it must be a number of metres") from error
        if not 0.0 < number < 1e150:  # squares of larger numbers overflow
            raise DefinitionError(f"{quantity} of {self.label} is {number} m; it must be finite and above 0")
        return number


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


def check_solids(shapes: Any, what: str) -> tuple[Shape, ...]:
    """Refuse anything but a sequence of solids whose distance can be measured.

    Args:
        shapes: What was given.
        what: Names it in the message.

    Returns:
        The solids.

    Raises:
        DefinitionError: It is no sequence, or holds something that is not a Box, Sphere, Cylinder or Capsule.
    """
    kinds = "Box, Sphere, Cylinder or Capsule"
    if isinstance(shapes, (str, bytes)) or not isinstance(shapes, Iterable):
        raise DefinitionError(f"{what}: {shapes!r} is given; it must be a list of {kinds}")
    try:
        solids = tuple(shapes)
    except TypeError as error:  # an array without dimension says that it is iterable
        raise DefinitionError(f"{what}: {shapes!r} is given; it must be a list of {kinds}") from error
    for solid in solids:
        if not isinstance(solid, Shape):
            raise DefinitionError(f"{what}: {solid!r} is not a shape; use {kinds}")
        if not isinstance(solid, (Box, Sphere, Cylinder, Capsule)):
            raise DefinitionError(f"{what}: {solid.label} cannot be checked for collision; use {kinds}")
    return solids
