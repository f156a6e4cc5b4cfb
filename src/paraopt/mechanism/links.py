"""Links: the base, series links that hang from a father by a joint, and mobile links that are free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from paraopt.errors import DefinitionError, unknown_name
from paraopt.mechanism.joints import UNLIMITED, Fixed, Joint, Kind, Motion, Range, as_order, as_range, as_tuple
from paraopt.spatial import finite_vector

# kind and axis of each coordinate that a free link may have, in the order in which they are applied
FREE_COORDINATES: dict[str, tuple[Kind, str]] = {
    "x": ("length", "x"),
    "y": ("length", "y"),
    "z": ("length", "z"),
    "alpha": ("angle", "x"),
    "beta": ("angle", "y"),
    "gamma": ("angle", "z"),
    "theta": ("angle", "z"),
}
SPATIAL_COORDINATES = ("x", "y", "z", "alpha", "beta", "gamma")
PLANAR_COORDINATES = ("x", "y", "theta")


def as_point(values: Sequence[float], what: str) -> tuple[float, float, float]:
    """Read a point of two (planar, z = 0) or three coordinates [m]."""
    vector = finite_vector(values, None, what)
    if vector.size not in (2, 3):
        raise DefinitionError(f"{what} is {vector.tolist()}; it must have two or three coordinates")
    padded = [*vector.tolist(), 0.0]
    return (padded[0], padded[1], padded[2])


@dataclass(frozen=True)
class Link:
    """Hold what all links share.

    Attributes:
        name: Name, unique in the mechanism.
    """

    name: str

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise DefinitionError(f"name of a link is {self.name!r}; it must be a non-empty string")

    @property
    def motions(self) -> tuple[Motion, ...]:
        """List the motions that move the link relative to its father, or to the world."""
        return ()


@dataclass(frozen=True)
class Base(Link):
    """Describe the frame on which the robot stands.

    Attributes:
        name: Name.
        at: Origin in the world [m].
        rotation: Angles (alpha, beta, gamma) [rad] of `Rx Ry Rz` in the world.
    """

    name: str = "base"
    at: Sequence[float] = (0.0, 0.0, 0.0)
    rotation: Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "at", as_point(self.at, f"position of base {self.name!r}"))
        angles = finite_vector(self.rotation, 3, f"rotation of base {self.name!r}")
        object.__setattr__(self, "rotation", tuple(angles.tolist()))


@dataclass(frozen=True)
class Series(Link):
    """Describe a link that hangs from a father: constant placement, then joint.

    Attributes:
        name: Name.
        father: Name of the link it hangs from.
        at: Origin of the joint in the father's frame [m]; two coordinates in the plane.
        joint: Joint that moves the link.
        rotation: Constant angles (alpha, beta, gamma) [rad] of `Rx Ry Rz`, applied after `at` and before the joint.

    Source: Lahouar, II.1.
    """

    father: str
    at: Sequence[float] = (0.0, 0.0, 0.0)
    joint: Joint = field(default_factory=Fixed)
    rotation: Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.father, str):
            raise DefinitionError(f"father of link {self.name!r} is {self.father!r}; it must be the name of a link")
        if not isinstance(self.joint, Joint):
            raise DefinitionError(f"joint of link {self.name!r} is {self.joint!r}; it must be a Joint")
        object.__setattr__(self, "at", as_point(self.at, f"placement of link {self.name!r}"))
        angles = finite_vector(self.rotation, 3, f"rotation of link {self.name!r}")
        object.__setattr__(self, "rotation", tuple(angles.tolist()))

    @property
    def motions(self) -> tuple[Motion, ...]:
        return self.joint.motions


@dataclass(frozen=True)
class Mobile(Link):
    """Describe a free link, such as a platform.

    Its pose is the position (x, y, z) and the rotation about the three axes in the stated order: "xyz" is
    `Rx(alpha) Ry(beta) Rz(gamma)`, "zyx" is `Rz(gamma) Ry(beta) Rx(alpha)`.

    Attributes:
        name: Name.
        coordinates: Which of x, y, z [m], alpha, beta, gamma [rad] are free, in the plane x, y, theta; the others
            stay zero. All of them when None.
        prefix: Put before each coordinate's name, so that several free links may coexist.
        ranges: Lowest and highest value by coordinate; unlimited where absent.
        order: Order of the rotations, "xyz", "zyx" or any other order of the three letters.

    Source: Lahouar, II.1; Tripod (z-y-x).
    """

    coordinates: Sequence[str] | None = None
    prefix: str = ""
    ranges: Mapping[str, Range] = field(default_factory=dict)
    order: str = "xyz"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "order", as_order(self.order, f"mobile link {self.name!r}"))
        if not isinstance(self.prefix, str):
            raise DefinitionError(f"prefix of mobile link {self.name!r} is {self.prefix!r}; it must be a string")
        free: Sequence[str] = tuple(FREE_COORDINATES)
        if self.coordinates is not None:
            coordinates = as_tuple(self.coordinates, f"coordinates of mobile link {self.name!r}")
            for c in coordinates:
                if not isinstance(c, str) or c not in FREE_COORDINATES:
                    raise unknown_name(f"coordinate of mobile link {self.name!r}", c, FREE_COORDINATES)
            if len({FREE_COORDINATES[c] for c in coordinates}) != len(coordinates):
                raise DefinitionError(f"mobile link {self.name!r} has coordinates {coordinates!r}: one is doubled")
            object.__setattr__(self, "coordinates", coordinates)
            free = coordinates
        if not isinstance(self.ranges, Mapping):
            raise DefinitionError(f"ranges of mobile link {self.name!r} are {self.ranges!r}; they must be a mapping")
        ranges = {}
        for c, given in self.ranges.items():
            if c not in free:
                raise unknown_name(f"coordinate in the ranges of mobile link {self.name!r}", c, free)
            ranges[c] = as_range(given, f"range of {self.prefix + c!r}")
        object.__setattr__(self, "ranges", MappingProxyType(ranges))
        _ = self.motions  # a faulty range is refused here, not at the first use

    @property
    def motions(self) -> tuple[Motion, ...]:
        chosen = SPATIAL_COORDINATES if self.coordinates is None else self.coordinates

        def rank(coordinate: str) -> tuple[bool, int]:
            kind, axis = FREE_COORDINATES[coordinate]
            return kind == "angle", (self.order if kind == "angle" else "xyz").index(axis)

        return tuple(
            Motion(self.prefix + c, *FREE_COORDINATES[c], range=self.ranges.get(c, UNLIMITED))
            for c in sorted(chosen, key=rank)
        )
