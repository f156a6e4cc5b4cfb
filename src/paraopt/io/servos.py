"""Servos of a controller: which socket, zero, direction and gain each joint has, and how fast a SPEED is.

A servo's position is told in *units*: 100 is its middle, and 10 to 190 is what the controller takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.io.template import Column

Array = NDArray[np.float64]

SOCKETS = 24
"""Number of servos that an MR-C3024 drives."""

GROUPS = ("G6A", "G6B", "G6C", "G6D")
"""Names of the groups of six servos: 0-5, 6-11, 12-17 and 18-23."""

LOWEST, MIDDLE, HIGHEST = 10, 100, 190
"""Positions that the controller takes, in servo units."""


@dataclass(frozen=True)
class Servo:
    """Tie a joint to a servo: units = zero + direction * gain * angle.

    Attributes:
        joint: Name of the joint.
        number: Socket, 0 to 23.
        direction: 1 or -1: which way the joint turns when the units grow.
        zero: Units at the joint's angle zero.
        gain: Units for one radian; one unit is one degree by default.
        lower: Least unit that may be written, 10 or above.
        upper: Largest unit that may be written, 190 or below.

    Raises:
        DefinitionError: A number is not possible; the message names the joint.
    """

    joint: str
    number: int
    direction: int = 1
    zero: float = float(MIDDLE)
    gain: float = 180.0 / pi
    lower: int = LOWEST
    upper: int = HIGHEST

    def __post_init__(self) -> None:
        what = f"servo of joint {self.joint!r}"
        if type(self.number) is not int or not 0 <= self.number < SOCKETS:
            raise DefinitionError(f"{what} has number {self.number!r}; it must be a whole number in 0 to {SOCKETS - 1}")
        if self.direction not in (1, -1):
            raise DefinitionError(f"{what} has direction {self.direction!r}; it must be 1 or -1")
        if not (np.isfinite(self.gain) and self.gain > 0.0):
            raise DefinitionError(f"{what} has a gain of {self.gain} units/rad; it must be above 0")
        if not LOWEST <= self.lower < self.upper <= HIGHEST:
            raise DefinitionError(
                f"{what} may go from {self.lower} to {self.upper} units; it must be a range in {LOWEST} to {HIGHEST}"
            )
        if not self.lower <= self.zero <= self.upper:
            raise DefinitionError(f"{what} has its zero at {self.zero} units, outside {self.lower} to {self.upper}")

    @property
    def name(self) -> str:
        """Give the name of the servo for messages."""
        return f"servo {self.number} ({self.joint})"

    def column(self) -> Column:
        """Give the column of a program that tells this servo."""
        return Column(
            self.name, self.joint, scale=self.direction * self.gain, offset=self.zero, digits=0, unit="units",
            lower=self.lower, upper=self.upper,
        )  # fmt: skip


@dataclass(frozen=True)
class ServoTable:
    """Hold the servos of a machine.

    Attributes:
        servos: The servos; each joint and each socket once.

    Raises:
        DefinitionError: There is none, or a joint or a socket stands twice.
    """

    servos: tuple[Servo, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "servos", tuple(self.servos))
        if not self.servos:
            raise DefinitionError("a table of servos is empty; it needs at least one")
        for key in ("joint", "number"):
            values = [getattr(s, key) for s in self.servos]
            if twice := sorted({str(v) for v in values if values.count(v) > 1}):
                raise DefinitionError(f"{key} {', '.join(twice)} stands twice in the table of servos")

    @property
    def joints(self) -> tuple[str, ...]:
        """Name the joints, in the order of the table."""
        return tuple(s.joint for s in self.servos)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Give the sockets, in the order of the table."""
        return tuple(s.number for s in self.servos)

    def units(self, angles: ArrayLike) -> Array:
        """Turn angles [rad], shape (..., n_servos), into units, not rounded."""
        return np.asarray(self._offsets + self._factors * np.asarray(angles, dtype=float))

    def angles(self, units: ArrayLike) -> Array:
        """Turn units, shape (..., n_servos), into angles [rad]."""
        return np.asarray((np.asarray(units, dtype=float) - self._offsets) / self._factors)

    def of(self, joint: str) -> Servo:
        """Give the servo of a joint.

        Raises:
            UnknownNameError: The table has no such joint.
        """
        if joint not in self.joints:
            raise unknown_name("joint of the table of servos", joint, self.joints)
        return self.servos[self.joints.index(joint)]

    def only(self, joints: Iterable[str]) -> ServoTable:
        """Give the table of those servos whose joint is named; other names do not matter.

        Raises:
            DefinitionError: None is left.
        """
        wanted = set(joints)
        return ServoTable(tuple(s for s in self.servos if s.joint in wanted))

    @property
    def _factors(self) -> Array:
        return np.array([s.direction * s.gain for s in self.servos])

    @property
    def _offsets(self) -> Array:
        return np.array([s.zero for s in self.servos])


@dataclass(frozen=True)
class ServoController:
    """State how a controller spends time; the numbers are ours, to be measured on the machine.

    A MOVE brings all its servos to their targets in straight lines that end together (point to point); the one with the
    longest way goes at the speed that SPEED asks for.

    Attributes:
        rate: Speed for each step of SPEED [units/s]. 20 makes SPEED 15 as fast as 60 degrees in 0.2 s.
        fastest: Largest SPEED.
        highspeed: Factor on the speed after HIGHSPEED SETON.
        step: Least time between two MOVE commands [s]: a servo is told its place 50 times in a second.

    Raises:
        DefinitionError: A number is not above zero.
    """

    rate: float = 20.0
    fastest: int = 15
    highspeed: float = 3.0
    step: float = 0.02

    def __post_init__(self) -> None:
        for key in ("rate", "fastest", "highspeed", "step"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0):
                raise DefinitionError(f"{key} of a servo controller is {value!r}; it must be finite and above 0")


def gipo_servos(zeros: Sequence[float] | None = None) -> ServoTable:
    """Give a plausible table of GIPO's 17 servos; the source prints none, so number, direction and zero are ours.

    The sockets follow the humanoid that GIPO was made of: its left leg (0-5) is the left rear leg, its left arm (6-11)
    the left front one, its right arm (12-17) the right front one, its right leg (18-23) the right rear one. Legs use
    the first three sockets of their group; head and tail use free ones. Servos of hips and knees are mounted in mirror
    image on the right, those of the abductions point forward on both sides. The middle is the stretched leg.

    Args:
        zeros: Units at the angles zero as calibrated, in the order of the table; 100 for all when None.

    Returns:
        The table: legs, then neck, head, jaw and tail.

    Source: Lahouar, IV.3 (24 servos, RoboBASIC; the table is ours).
    """
    first = {"left rear": 0, "left front": 6, "right front": 12, "right rear": 18}
    rows = [
        (f"{leg} {joint}", number + i, -1 if leg.startswith("right") and joint != "abduction" else 1)
        for leg, number in first.items()
        for i, joint in enumerate(("hip", "abduction", "knee"))
    ]
    rows += [(joint, 9 + i, 1) for i, joint in enumerate(("neck 1", "neck 2", "head"))]
    rows += [("jaw", 15, 1), ("tail", 3, 1)]
    given = [float(MIDDLE)] * len(rows) if zeros is None else [float(z) for z in zeros]
    if len(given) != len(rows):
        raise DefinitionError(f"{len(given)} zeros are given for GIPO's {len(rows)} servos")
    return ServoTable(tuple(Servo(*row, zero=zero) for row, zero in zip(rows, given, strict=True)))
