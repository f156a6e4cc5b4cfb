"""Play a RoboBASIC program on paper: which units each of the 24 servos is told, in time.

It reads the part of the language that a motion needs (SPEED, HIGHSPEED, MOVE, WAIT, DELAY, and the settings around
them) and knows nothing of how the program came about. What it does not understand it refuses with the line.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.io.servos import GROUPS, HIGHEST, LOWEST, MIDDLE, SOCKETS, ServoController

Array = NDArray[np.float64]

_FIRST = {**{g: (6 * i, 6) for i, g in enumerate(GROUPS)}, "G24": (0, SOCKETS)}


@dataclass(frozen=True, eq=False)
class Played:
    """Hold what a program told its servos: straight lines between corners.

    Attributes:
        times: Times of the corners [s], not decreasing, shape (n,).
        units: Units at the corners, shape (n, 24).
        moves: Number of moves that were made.
    """

    times: Array
    units: Array
    moves: int

    def __post_init__(self) -> None:
        for key in ("times", "units"):
            values = np.array(getattr(self, key), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, key, values)

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        return float(self.times[-1])

    def __call__(self, t: ArrayLike) -> Array:
        """Give the units at times [s], shape (..., 24); before the start and after the end the servos stand."""
        at = np.asarray(t, dtype=float)
        return np.stack([np.interp(at, self.times, column) for column in self.units.T], axis=-1)


def play(text: str, start: Sequence[float] | None = None, controller: ServoController | None = None) -> Played:
    """Play a program.

    Args:
        text: The program.
        start: Units at which the 24 servos stand before it runs; all in the middle when None.
        controller: How fast a SPEED is; as `ServoController()` when None.

    Returns:
        What the servos are told.

    Raises:
        DefinitionError: A line is not understood, a number is out of its range, or a servo is told to move while it
            moves; the message names the line.
    """
    stands = np.full(SOCKETS, float(MIDDLE)) if start is None else np.array(start, dtype=float)
    if stands.shape != (SOCKETS,) or not np.all(np.isfinite(stands)):
        raise DefinitionError(f"start has shape {stands.shape}; it must be {SOCKETS} finite numbers of units")
    clock = _Clock(stands, controller or ServoController())
    lines = text.splitlines()
    label = ""
    for number, line in enumerate(lines, start=1):
        # a quote opens a comment wherever it stands: no statement here holds text
        statement = " ".join(line.split("'", 1)[0].split()).upper()
        if not statement:
            continue
        try:
            if statement == f"GOTO {label}" and label:
                break  # the program stays here for ever
            if re.fullmatch(r"[A-Z_][A-Z0-9_]*:", statement):
                label = statement[:-1]
                continue
            label = ""
            _run(statement, clock)
        except _LineError as error:
            raise DefinitionError(f"line {number}: {line.strip()!r}: {error}") from error
    clock.wait()
    clock.mark()
    return Played(np.array(clock.times), np.array(clock.corners), clock.moves)


class _LineError(Exception):
    """Carry the reason to where the line is known."""


class _Clock:
    """Keep the time and the places of the servos."""

    def __init__(self, stands: Array, controller: ServoController) -> None:
        self.controller, self.speed, self.high = controller, 1, False
        self.now = self.since = self.until = 0.0
        self.start, self.target = stands, stands.copy()
        self.told = np.zeros(SOCKETS, dtype=bool)
        self.moves = 0
        self.times, self.corners = [0.0], [stands.copy()]

    def move(self, first: int, values: list[int | None]) -> None:
        if self.now > self.since or not self.told.any():
            if self.until > self.now:
                raise _LineError("servos are still moving; a WAIT must stand before it")
            self._settle()
            self.since = self.now
            self.told = np.zeros(SOCKETS, dtype=bool)
            self.mark()
        for number, value in enumerate(values, start=first):
            if value is not None:
                if self.told[number]:
                    raise _LineError(f"servo {number} is told twice at once; a WAIT must stand between")
                self.told[number], self.target[number] = True, value
        self.moves += 1
        way = float(np.max(np.abs(self.target - self.start)))
        factor = self.controller.highspeed if self.high else 1.0
        self.until = max(self.until, self.since + way / (self.controller.rate * self.speed * factor))

    def wait(self) -> None:
        if self.until > self.now:
            self.now = self.until
        self._settle()
        self.told = np.zeros(SOCKETS, dtype=bool)

    def delay(self, seconds: float) -> None:
        self.now += seconds
        if self.now >= self.until:
            self._settle()
            self.told = np.zeros(SOCKETS, dtype=bool)

    def _settle(self) -> None:
        """Put the corner where the last moves ended."""
        if np.any(self.target != self.start):
            self.times.append(self.until)
            self.corners.append(self.target.copy())
        self.start = self.target.copy()

    def mark(self) -> None:
        self.times.append(self.now)
        self.corners.append(self.start.copy())


def _run(statement: str, clock: _Clock) -> None:
    word, _, rest = statement.partition(" ")
    if word in ("MOVE", "MOVE24"):
        group, _, fields = ("G24", "", rest) if word == "MOVE24" else rest.partition(",")
        if group.strip() not in _FIRST:
            raise _LineError(f"{group.strip()!r} is no group; groups are {', '.join(_FIRST)}")
        first, size = _FIRST[group.strip()]
        entries = fields.split(",")
        while len(entries) > size and not entries[-1].strip():
            entries.pop()  # public programs end lines with further commas
        if len(entries) > size:
            raise _LineError(f"{len(entries)} positions for the {size} servos of the group")
        clock.move(first, [_position(entry.strip()) for entry in entries])
    elif word == "SPEED":
        clock.speed = _whole(rest, 1, clock.controller.fastest, "SPEED")
    elif word == "DELAY":
        clock.delay(1e-3 * _whole(rest, 0, 65535, "DELAY"))
    elif statement == "WAIT":
        clock.wait()
    elif word == "HIGHSPEED" and rest in ("SETON", "SETOFF"):
        clock.high = rest == "SETON"
    elif word == "PTP" and rest in ("SETON", "ALLON"):
        pass  # servos arrive together, as they are played
    elif word == "DIR":
        if re.search(r"[1-9]", rest.partition(",")[2]):
            raise _LineError("a servo that DIR turns round is not played")
    elif word not in ("MOTOR", "GETMOTORSET"):
        raise _LineError("it is not understood")


def _position(entry: str) -> int | None:
    return None if not entry else _whole(entry, LOWEST, HIGHEST, "a position")


def _whole(text: str, lowest: int, highest: int, what: str) -> int:
    if not re.fullmatch(r"[0-9]{1,6}", text.strip()):
        raise _LineError(f"{what} is {text.strip()!r}; a whole number belongs there")
    value = int(text)
    if not lowest <= value <= highest:
        raise _LineError(f"{what} is {value}; it must be in {lowest} to {highest}")
    return value
