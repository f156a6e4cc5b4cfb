"""Parts between a cable's free length and its winch: swivelling pulleys and drums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.cable.read import read_number
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pulley:
    """Guide a cable over a wheel that swivels about the line on which the cable comes in.

    The cable reaches the exit point A along the swivel axis, wraps the wheel there and leaves it along a tangent. The
    wheel's centre stands beside A at the distance `radius`, square to the axis, and turns towards the attachment.

    Attributes:
        radius: Radius of the wheel's groove [m].
        axis: Direction in which the cable comes in, in the world; its length does not matter.

    Raises:
        DefinitionError: The radius is not above zero, or the axis has no direction.
    """

    radius: float
    axis: Sequence[float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", read_number(self.radius, "radius of a pulley", "m", above=0.0))
        axis = finite_vector(self.axis, 3, "swivel axis of a pulley")
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise DefinitionError("swivel axis of a pulley is the zero vector; it must have a direction")
        object.__setattr__(self, "axis", tuple((axis / length).tolist()))


@dataclass(frozen=True)
class Drum:
    """Turn lengths of cable into angles of a winch.

    Attributes:
        radius: Radius at which the cable lies on the drum [m].
        pitch: Advance of the groove along the drum for one turn [m]; 0 for a plain drum.
        sign: 1 where a positive turn pays cable out, -1 where it takes cable in.
        zero_length: Length of cable that is paid out at the angle zero [m].

    Raises:
        DefinitionError: A size is not finite, the radius is not above zero, or the sign is not 1 or -1.
    """

    radius: float
    pitch: float = 0.0
    sign: int = 1
    zero_length: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", read_number(self.radius, "radius of a drum", "m", above=0.0))
        object.__setattr__(self, "pitch", read_number(self.pitch, "pitch of a drum", "m", lowest=0.0))
        object.__setattr__(self, "zero_length", read_number(self.zero_length, "length at a drum's zero", "m"))
        if self.sign not in (1, -1):
            raise DefinitionError(f"sign of a drum is {self.sign!r}; it must be 1 or -1")

    @property
    def length_per_radian(self) -> float:
        """Give how much cable a turn of one radian pays out, with the sign [m/rad]."""
        return self.sign * float(np.hypot(self.radius, self.pitch / (2.0 * np.pi)))

    def angles(self, lengths: ArrayLike) -> Array:
        """Give the angles of the winch [rad] at which these lengths [m] are paid out."""
        return np.asarray((np.asarray(lengths, dtype=float) - self.zero_length) / self.length_per_radian)

    def lengths(self, angles: ArrayLike) -> Array:
        """Give the lengths [m] that are paid out at these angles of the winch [rad]."""
        return np.asarray(self.zero_length + np.asarray(angles, dtype=float) * self.length_per_radian)
