"""Cables: straight bodies whose ends ride on two links, so that pose and length follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.mechanism.links import as_point

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Cable:
    """Describe a taut cable between two links: a segment thickened by a radius, with round ends.

    Attributes:
        link_A: Link that carries the first end.
        point_A: First end in that link's frame [m].
        link_B: Link that carries the second end.
        point_B: Second end in that link's frame [m].
        radius: Radius [m].
        ignore: Lengths at the first and at the second end that are not looked at [m], where the cable leaves its winch
            or its eye. With none at an end, the cable is not checked against the link that carries that end.
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


def _as_length(value: Any, what: str) -> float:
    try:
        length = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} is {value!r}; it must be a number of metres") from error
    if not 0.0 <= length < 1e150:  # squares of larger numbers overflow
        raise DefinitionError(f"{what} is {length} m; it must be finite and not negative")
    return length


def shorten_segments(A: Array, B: Array, ignore: Array) -> Array:
    """Take from segments the lengths that are not looked at.

    A cable shorter than what is left out shrinks to one point, which parts it in the ratio of the two lengths.

    Args:
        A: First ends [m], shape (..., 3).
        B: Second ends [m], shape (..., 3).
        ignore: Lengths left out at both ends [m], shape (..., 2).

    Returns:
        Ends of what is left [m], shape (..., 2, 3).
    """
    span = B - A
    length = np.linalg.norm(span, axis=-1)
    share = ignore / np.maximum(np.maximum(length, ignore.sum(axis=-1)), 1e-300)[..., None]
    return np.stack([A + share[..., :1] * span, B - share[..., 1:] * span], axis=-2)


def move_witnesses(A: Array, B: Array, dA: Array, dB: Array, ignore: Array, witness: Array) -> Array:
    """Give the motion of the points of cables that are nearest to something.

    The shortened segment has ends `A + a u` and `B - b u` with u the unit vector from A to B. The nearest point keeps
    its share of the shortened segment: what it does along the segment does not change a smallest distance.

    Args:
        A: First ends [m], shape (k, 3).
        B: Second ends [m], shape (k, 3).
        dA: Their derivatives, shape (k, m, 3).
        dB: Idem.
        ignore: Lengths left out [m], shape (k, 2).
        witness: Points on the cables [m], shape (k, 3).

    Returns:
        Derivatives of the points, shape (k, m, 3).
    """
    ends = shorten_segments(A, B, ignore)
    core = ends[:, 1] - ends[:, 0]
    square = np.einsum("kc,kc->k", core, core)
    along = np.einsum("kc,kc->k", witness - ends[:, 0], core)
    share = np.clip(along / np.maximum(square, 1e-300), 0.0, 1.0)
    span = B - A
    length = np.linalg.norm(span, axis=1)
    whole = length > ignore.sum(axis=1)
    u = span / np.maximum(length, 1e-300)[:, None]
    # shrunk to a point: its place is a fixed share of the way
    fixed = ignore[:, 0] / np.maximum(ignore.sum(axis=1), 1e-300)
    share = np.where(whole, share, fixed)
    turn = dB - dA
    turn = turn - np.einsum("kmc,kc->km", turn, u)[:, :, None] * u[:, None, :]
    shift = np.where(whole, (1.0 - share) * ignore[:, 0] - share * ignore[:, 1], 0.0) / np.maximum(length, 1e-300)
    return np.asarray((1.0 - share)[:, None, None] * dA + share[:, None, None] * dB + shift[:, None, None] * turn)
