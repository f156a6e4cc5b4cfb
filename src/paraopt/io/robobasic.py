"""RoboBASIC: a joint motion as a program for a controller of 24 servos, timed by SPEED and DELAY.

Each command is a MOVE to whole units, a WAIT for its end and a DELAY to the next. Moments of the commands are chosen as
far apart as the played program stays within a tolerance of the motion, so slow parts need few lines.

What public programs for this controller confirm: `'` comments, labels and GOTO; groups G6A (servos 0-5) to G6D (18-23)
and G24; a field left blank keeps its servo; 100 is the middle; SPEED, WAIT, DELAY, PTP SETON and ALLON (servos arrive
together), DIR, MOTOR and GETMOTORSET. What is ours: how fast a SPEED is (`ServoController`), that DELAY counts
milliseconds, and that nothing else takes time.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError, unknown_name
from paraopt.io.files import write_atomically
from paraopt.io.program import check_commands
from paraopt.io.servos import GROUPS, SOCKETS, ServoController, ServoTable
from paraopt.io.template import Column, Template

Array = NDArray[np.float64]
MS = 1e-3
"""Step of a DELAY [s]."""


@dataclass(frozen=True, eq=False)
class RoboBasic:
    """Hold a RoboBASIC program.

    Attributes:
        text: The program.
        times: Times of the motion at which the moves are commanded, and its end [s], shape (n + 1,).
        units: Positions at these times in units, shape (n + 1, n_servos).
        speeds: SPEED of each move, shape (n,).
        delays: Time from the end of each move to the next [ms], shape (n,).
        lead: Time from the end of the approach to the start of the motion [s].
        deviation: Largest distance between the played program and the motion [units].
    """

    text: str
    times: Array
    units: Array
    speeds: Array
    delays: Array
    lead: float
    deviation: float

    def __post_init__(self) -> None:
        for key in ("times", "units", "speeds", "delays"):
            values = np.array(getattr(self, key), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, key, values)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the program, whole or not at all."""
        return write_atomically(path, self.text.encode("ascii", "replace"))


def robobasic_template(table: ServoTable, *, groups: bool = False) -> Template:
    """Make the words of a program for a table of servos.

    Args:
        table: The servos.
        groups: Whether a pose is told group by group (MOVE G6A, ...) or at once (MOVE G24).

    Returns:
        The template. Its columns are SPEED, the servos' units and DELAY [ms]; its fields title, approach (a SPEED), the
        first pose as `start <number>`, settle [ms], duration and count.
    """
    by_number = {servo.number: servo for servo in table.servos}
    used = [g for i, g in enumerate(GROUPS) if any(6 * i <= n < 6 * i + 6 for n in by_number)]

    def moves(entry: Callable[[int], str]) -> str:
        blocks = [(g, 6 * GROUPS.index(g), 6) for g in used] if groups else [("G24", 0, SOCKETS)]
        lines = [
            f"MOVE {name}, " + ", ".join(entry(n) if n in by_number else "" for n in range(first, first + size))
            for name, first, size in blocks
        ]
        return "".join(line.rstrip() + "\n" for line in lines)

    names = "".join(f"' servo {n}: {_plain(by_number[n].joint)}\n" for n in sorted(by_number))
    read = ", ".join("1" if n in by_number else "0" for n in range(SOCKETS))
    turns = "".join(f"DIR {g}, 0, 0, 0, 0, 0, 0\n" for g in GROUPS)
    return Template(
        "RoboBASIC",
        (
            Column("SPEED", digits=0, lower=1),
            *(servo.column() for servo in table.servos),
            Column("DELAY", digits=0, unit="ms", lower=1),
        ),
        "SPEED {SPEED}\n" + moves(lambda n: f"{{{by_number[n].name}}}") + "WAIT\nDELAY {DELAY}\n",
        f"' {{title}}\n{names}PTP SETON\nPTP ALLON\n{turns}GETMOTORSET G24, {read}\nMOTOR G24\nSPEED {{approach}}\n"
        + moves(lambda n: f"{{start {n}}}")
        + "WAIT\nDELAY {settle}\n' {duration} s in {count} moves\n",
        "finished:\nGOTO finished\n",
    )


def build_robobasic(
    motion: Callable[[Array], Array],
    table: ServoTable,
    *,
    duration: float | None = None,
    names: Sequence[str] | None = None,
    controller: ServoController | None = None,
    tolerance: float = 1.0,
    approach: int = 3,
    settle: float = 1.0,
    longest: float = 1.0,
    groups: bool = False,
    title: str = "motion",
) -> RoboBasic:
    """Turn a joint motion into a program.

    Args:
        motion: Angles in time: called with times [s], shape (n,), it returns shape (n, n_names) [rad]. A trajectory, or
            any function.
        table: The servos; joints of the motion that it does not name are left out.
        duration: Length of the motion [s]; its own when None.
        names: What the motion's columns are called; the variables of its robot when None.
        controller: How fast a SPEED is; as `ServoController()` when None.
        tolerance: Largest distance between the played program and the motion [units].
        approach: SPEED at which the first pose is reached from wherever the machine stands.
        settle: Pause before the motion starts [s].
        longest: Largest time between two moves [s].
        groups: Whether a pose is told group by group.
        title: First comment of the program.

    Returns:
        The program.

    Raises:
        DefinitionError: An option is out of its range, or the motion returns no finite table of angles.
        UnknownNameError: The motion does not have a joint of the table.
        InfeasibleError: A position is outside its servo's range (the message names servo, joint, time and value), a
            servo would have to turn faster than its largest SPEED, or the tolerance cannot be kept.
    """
    controller = controller or ServoController()
    robot = getattr(motion, "robot", None)
    duration = getattr(motion, "duration", None) if duration is None else duration
    names = robot.mechanism.names if names is None and robot is not None else names
    if duration is None or names is None:
        raise DefinitionError("a function of time alone says neither how long it lasts nor what it moves; give both")
    if not (np.isfinite(duration) and 0.0 < duration <= 3600.0):
        raise DefinitionError(f"the motion lasts {duration} s; a program takes more than 0 and at most 3600 s")
    if not 0.5 < tolerance < np.inf:
        raise DefinitionError(f"tolerance is {tolerance} units; rounding alone takes 0.5, so it must be above")
    if type(approach) is not int or not 1 <= approach <= controller.fastest:
        raise DefinitionError(f"approach is {approach!r}; it must be a SPEED, 1 to {controller.fastest}")
    if not MS <= settle <= 60.0 or not controller.step <= longest <= 60.0:
        raise DefinitionError(f"settle is {settle} s and longest {longest} s; they must lie between a step and 60 s")
    for joint in table.joints:
        if joint not in names:
            raise unknown_name("joint in the motion", joint, names)
    ticks = max(int(np.ceil(duration / MS - 1e-9)), round(controller.step / MS))
    times = np.minimum(MS * np.arange(ticks + 1), duration)
    angles = np.asarray(motion(times), dtype=float)
    if angles.shape != (len(times), len(names)) or not np.all(np.isfinite(angles)):
        raise DefinitionError(
            f"the motion gives shape {angles.shape} for {len(times)} times; it must be finite, shape "
            f"({len(times)}, {len(names)})"
        )
    exact = table.units(angles[:, [list(names).index(j) for j in table.joints]])
    check_commands([s.column() for s in table.servos], np.round(exact), MS)
    moves = _Moves(exact, controller, tolerance, table)
    rows, knots = moves.schedule(max(1, round(longest / MS)))
    units = np.round(exact[knots])
    speeds, delays = rows[:, 0], rows[:, 1]
    words = robobasic_template(table, groups=groups)
    fields: dict[str, object] = {
        "title": _plain(title), "approach": approach, "settle": round(settle / MS), "duration": f"{duration:.3f}",
        **{f"start {n}": int(u) for n, u in zip(table.numbers, units[0], strict=True)},
    }  # fmt: skip
    text = words.render(np.column_stack([speeds, units[1:], delays]), fields)
    return RoboBasic(text, np.asarray(MS * knots), units, speeds, delays, MS * round(settle / MS), moves.worst)


class _Moves:
    """Choose the moments of the moves, keeping the clock of the program as it will run."""

    def __init__(self, exact: Array, controller: ServoController, tolerance: float, table: ServoTable) -> None:
        self.exact, self.controller, self.tolerance, self.table = exact, controller, tolerance, table
        self.rounded = np.round(exact)
        self.worst = 0.0

    def schedule(self, longest: int) -> tuple[Array, NDArray[np.int64]]:
        """Give SPEED and DELAY of each move and the ticks at which they are commanded, the end included."""
        step = max(1, int(np.ceil(self.controller.step / MS - 1e-9)))
        last, at, clock = len(self.exact) - 1, 0, 0.0
        rows, knots = [], [0]
        while at < last:
            # no remainder that is shorter than a step may be left
            sizes = [n for n in _sizes(step, min(longest, last - at)) if last - at - n == 0 or last - at - n >= step]
            best = self._farthest(at, clock, sizes or [last - at])
            if best is None:
                self._refuse(at, min(step, last - at))
                break
            ticks, speed, delay, clock, error = best
            self.worst = max(self.worst, error)
            at += ticks
            rows.append((speed, delay))
            knots.append(at)
        return np.array(rows, dtype=float), np.array(knots)

    def _farthest(self, at: int, clock: float, sizes: list[int]) -> tuple[int, int, int, float, float] | None:
        """Find a size whose move holds the tolerance, near the largest: double, then halve the bracket."""
        low, high, best = 0, 1, None
        while high <= len(sizes) and (found := self._try(at, clock, sizes[high - 1])):
            low, high, best = high, 2 * high, found
        if best is None:  # a longer one may pass where the shortest does not: rounding falls elsewhere
            return next((f for n in sizes[1:64] if (f := self._try(at, clock, n))), None)
        high = min(high, len(sizes) + 1)
        while high - low > 1:
            middle = (low + high) // 2
            found = self._try(at, clock, sizes[middle - 1])
            low, high, best = (middle, high, found) if found else (low, middle, best)
        return best

    def _try(self, at: int, clock: float, ticks: int) -> tuple[int, int, int, float, float] | None:
        start, end = self.rounded[at], self.rounded[at + ticks]
        way = float(np.max(np.abs(end - start)))
        available = MS * (at + ticks) - clock - MS  # a DELAY takes one millisecond at least
        if way > 0.0 and available <= 0.0:
            return None
        speed = max(1, int(np.ceil(way / (self.controller.rate * available) - 1e-9))) if way > 0.0 else 1
        if speed > self.controller.fastest:
            return None
        lasts = way / (self.controller.rate * speed)
        delay = max(1, round((MS * (at + ticks) - clock - lasts) / MS))
        # corners of the played motion fall between ticks; elsewhere the distance is largest at one
        corners = np.clip(np.array([clock, clock + lasts]) / MS, at, at + ticks)
        left = np.minimum(corners.astype(int), at + ticks - 1)
        share = (corners - left)[:, None]
        exact = np.vstack(
            [self.exact[at : at + ticks + 1], (1 - share) * self.exact[left] + share * self.exact[left + 1]]
        )
        now = MS * np.concatenate([np.arange(at, at + ticks + 1), corners])
        part = np.clip((now - clock) / lasts, 0.0, 1.0) if lasts > 0.0 else np.ones(len(now))
        error = float(np.max(np.abs(start + part[:, None] * (end - start) - exact)))
        return (ticks, speed, delay, clock + lasts + MS * delay, error) if error <= self.tolerance else None

    def _refuse(self, at: int, ticks: int) -> None:
        ways = np.abs(self.exact[at + ticks] - self.exact[at])
        worst = int(np.argmax(ways))
        servo, rate = self.table.servos[worst], float(ways[worst] / (MS * ticks))
        most = self.controller.rate * self.controller.fastest
        if rate > most * (1 - 1 / ticks):
            raise InfeasibleError(
                f"{servo.name} turns at {rate:.4g} units/s at t = {MS * at:.4g} s; SPEED {self.controller.fastest} is "
                f"{most:.4g} units/s; slow the motion",
                servo=servo.number, joint=servo.joint, time=MS * at, value=rate, bound=most,
            )  # fmt: skip
        raise InfeasibleError(
            f"no move of {MS * ticks:g} s or longer keeps within {self.tolerance:g} units at t = {MS * at:.4g} s, "
            f"where {servo.name} turns at {rate:.4g} units/s; slow the motion or allow more",
            servo=servo.number, joint=servo.joint, time=MS * at, value=rate, bound=self.tolerance,
        )  # fmt: skip


def _sizes(step: int, most: int) -> list[int]:
    """List lengths of a move [ticks]: every one up to four steps, then ever coarser."""
    sizes, n = [], step
    while n <= most:
        sizes.append(n)
        n += max(1, n // (4 * step))
    if sizes and sizes[-1] != most:
        sizes.append(most)
    return sizes


def _plain(text: str) -> str:
    """Keep what a comment may hold, braces doubled away."""
    return "".join(c if c.isprintable() and c.isascii() and c not in "{}" else "_" for c in text)
