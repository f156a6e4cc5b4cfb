"""Cables: straight bodies whose ends ride on two links, so that pose and length follow."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from paraopt.errors import DefinitionError
from paraopt.mechanism.links import as_point


@dataclass(frozen=True, kw_only=True)
class Cable:
    """Describe a taut cable between two links: a segment thickened by a radius, with round ends.

    A robot carries its cables (`Robot.cables`); a scene may add others, such as a hose.

    What a cable leaves its ends by does not count as touched: the solid that holds an end is not checked against it
    where nothing is ignored there, and beyond the ignored length where something is; a solid that lies all within the
    ignored length is never checked. Two cables that end at one place are not checked against each other. Only what is
    beyond an ignored length has a distance, so a length should exceed the clearance asked for, plus the radius.

    Attributes:
        link_A: Link that carries the first end.
        point_A: First end in that link's frame [m].
        link_B: Link that carries the second end.
        point_B: Second end in that link's frame [m].
        radius: Radius [m].
        ignore: Lengths at the first and at the second end that are not looked at [m], where the cable leaves its winch
            or its eye.
        name: Name in the scene; "cable of link_A and link_B" when empty.

    Raises:
        DefinitionError: A size is not finite or not positive, or a name is no string.
    """

    link_A: str
    point_A: Sequence[float]
    link_B: str
    point_B: Sequence[float]
    radius: float
    ignore: tuple[float, float] = (0.0, 0.0)
    name: str = ""

    def __post_init__(self) -> None:
        for key in ("link_A", "link_B", "name"):
            if not isinstance(getattr(self, key), str):
                raise DefinitionError(f"{key} of a cable is {getattr(self, key)!r}; it must be a string")
        if not self.name:
            object.__setattr__(self, "name", f"cable of {self.link_A} and {self.link_B}")
        for side in "AB":
            point = as_point(getattr(self, f"point_{side}"), f"point_{side} of cable {self.name!r}")
            object.__setattr__(self, f"point_{side}", point)
        radius = _as_length(self.radius, f"radius of cable {self.name!r}")
        if radius == 0.0:
            raise DefinitionError(f"radius of cable {self.name!r} is 0 m; it must be above 0")
        object.__setattr__(self, "radius", radius)
        if not (isinstance(self.ignore, (tuple, list)) and len(self.ignore) == 2):
            raise DefinitionError(f"ignore of cable {self.name!r} is {self.ignore!r}; it must be two lengths")
        ignore = tuple(_as_length(v, f"ignored length of cable {self.name!r}") for v in self.ignore)
        object.__setattr__(self, "ignore", ignore)
        if self.link_A == self.link_B and self.point_A == self.point_B:
            raise DefinitionError(f"cable {self.name!r} begins and ends at one point of {self.link_A!r}")

    @property
    def label(self) -> str:
        """Name the cable in messages."""
        return f"cable {self.name!r}"

    @property
    def links(self) -> tuple[str, str]:
        """Give the links that carry its ends."""
        return self.link_A, self.link_B

    @property
    def points(self) -> tuple[Sequence[float], Sequence[float]]:
        """Give its ends, each in the frame of its link [m]."""
        return self.point_A, self.point_B


def check_cables(given: Any, what: str) -> tuple[Cable, ...]:
    """Refuse anything but a sequence of cables.

    Args:
        given: What was given.
        what: Names it in the message.

    Returns:
        The cables.

    Raises:
        DefinitionError: It is no sequence, or holds something that is no cable.
    """
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise DefinitionError(f"{what} are {given!r}; they must be a list of Cable")
    try:
        cables = tuple(given)
    except TypeError as error:  # an array without dimension says that it is iterable
        raise DefinitionError(f"{what} are {given!r}; they must be a list of Cable") from error
    for cable in cables:
        if not isinstance(cable, Cable):
            raise DefinitionError(f"{what} hold {cable!r}; each must be a Cable")
    return cables


def _as_length(value: Any, what: str) -> float:
    try:
        length = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} is {value!r}; it must be a number of metres") from error
    if not 0.0 <= length < 1e150:  # squares of larger numbers overflow
        raise DefinitionError(f"{what} is {length} m; it must be finite and not negative")
    return length
