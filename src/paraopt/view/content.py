"""What a page or a figure is told to draw: bodies, cables, lines in space, quantities along time, phases."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.shapes import Shape
from paraopt.spatial import finite_vector
from paraopt.view.style import KIND_COLORS, check_color

KINDS = tuple(KIND_COLORS)
"""Kinds of bodies: "robot" (a link), "platform", "base", "obstacle", "actuator"."""

SIDES = ("lower", "upper")
"""What a bound is: "lower" asks for values above it, "upper" for values below it."""


@dataclass(frozen=True, eq=False)
class Body:
    """Hold a solid that a page draws.

    Attributes:
        name: Name, shown when the pointer rests on the body.
        shape: The solid; its `pose` places it in the frame that carries it.
        frame: Index of that frame in the `poses` of the page; -1 stands for the world.
        kind: "robot", "platform", "base", "obstacle" or "actuator": decides the colour and the legend's entry.
    """

    name: str
    shape: Shape
    frame: int = -1
    kind: str = "robot"

    def __post_init__(self) -> None:
        if not isinstance(self.shape, Shape):
            raise DefinitionError(f"shape of body {self.name!r} is a {type(self.shape).__name__}; it must be a Shape")
        _check_frame(self.frame, f"body {self.name!r}")
        if self.kind not in KINDS:
            raise unknown_name(f"kind of body {self.name!r}:", self.kind, KINDS)


@dataclass(frozen=True, eq=False)
class CableLine:
    """Hold a straight cable, or a line like one, between points of two frames, whose ends move with them.

    Attributes:
        name: Name, shown when the pointer rests on the cable.
        frames: Index of the frame of each end in the `poses` of the page; -1 stands for the world.
        points: Each end in its frame [m], shape (2, 3); read-only.
        radius: Radius [m]; a page draws thin cables somewhat thicker, so that they are seen.
        label: What the legend calls it; lines of one label have one colour.
        color: "#RRGGBB", or "" for that of cables.
    """

    name: str
    frames: tuple[int, int]
    points: NDArray[np.float64]
    radius: float
    label: str = "Cables"
    color: str = ""

    def __post_init__(self) -> None:
        if not (isinstance(self.frames, tuple | list) and len(self.frames) == 2):
            raise DefinitionError(f"frames of cable {self.name!r} are {self.frames!r}; they must be two indices")
        for frame in self.frames:
            _check_frame(frame, f"cable {self.name!r}")
        object.__setattr__(self, "frames", tuple(int(frame) for frame in self.frames))
        points = finite_array(self.points, (2, 3), f"points of cable {self.name!r}")
        object.__setattr__(self, "points", points)
        radius = float(finite_vector([self.radius], 1, f"radius of cable {self.name!r}")[0])
        if radius <= 0.0:
            raise DefinitionError(f"radius of cable {self.name!r} is {radius} m; it must be above 0")
        object.__setattr__(self, "radius", radius)
        if not (isinstance(self.label, str) and self.label):
            raise DefinitionError(f"label of cable {self.name!r} is {self.label!r}; it must say in words what it is")
        check_color(self.color, f"color of cable {self.name!r}")


@dataclass(frozen=True, eq=False)
class Mark:
    """Hold what stands out during a phase: a point of a frame, or all bodies on it.

    Attributes:
        label: What it means, such as "fixed foot": marks of one label have one colour and one entry in the legend.
        frame: Index of the frame in the `poses` of the page; -1 stands for the world.
        point: Where a ball is drawn, in that frame [m], shape (3,); None colours the bodies on the frame instead.
        color: "#RRGGBB", or "" for that of the label; a label that has none is given the next of the palette.
    """

    label: str
    frame: int
    point: Sequence[float] | None = None
    color: str = ""

    def __post_init__(self) -> None:
        if not (isinstance(self.label, str) and self.label):
            raise DefinitionError(f"label of a mark is {self.label!r}; it must say in words what it means")
        _check_frame(self.frame, f"mark {self.label!r}")
        if self.point is not None:
            point = finite_vector(self.point, 3, f"point of mark {self.label!r}")
            object.__setattr__(self, "point", tuple(float(v) for v in point))
        check_color(self.color, f"color of mark {self.label!r}")


@dataclass(frozen=True, eq=False)
class Phase:
    """Hold a part of a motion that has a name.

    Attributes:
        name: Name, shown while it lasts.
        begin: First instant [s].
        end: Last instant [s].
        marks: What stands out while it lasts.
    """

    name: str
    begin: float
    end: float
    marks: Sequence[Mark] = ()

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name):
            raise DefinitionError(f"name of a phase is {self.name!r}; it must be a string with something in it")
        begin, end = (float(v) for v in finite_vector([self.begin, self.end], 2, f"begin and end of {self.name!r}"))
        if not begin < end:
            raise DefinitionError(f"phase {self.name!r} lasts from {begin} s to {end} s; it must end after it begins")
        object.__setattr__(self, "begin", begin)
        object.__setattr__(self, "end", end)
        marks = tuple(self.marks)
        for mark in marks:
            if not isinstance(mark, Mark):
                raise DefinitionError(f"marks of phase {self.name!r} hold {mark!r}; each must be a Mark")
        object.__setattr__(self, "marks", marks)


def check_phases(phases: Sequence[Phase], start: float, end: float, slack: float = 1e-9) -> tuple[Phase, ...]:
    """Refuse phases that do not follow each other; between them may be time that belongs to none.

    Args:
        phases: The phases.
        start: First instant of the motion [s].
        end: Last instant of the motion [s].
        slack: Time by which one may begin before the other ended [s].

    Raises:
        DefinitionError: Something is no phase, a phase begins before the one before it ended, or the motion is over
            when it begins or has not begun when it ends.
    """
    checked = tuple(phases)
    for phase in checked:
        if not isinstance(phase, Phase):
            raise DefinitionError(f"phases hold {phase!r}; each must be a Phase")
        if phase.end <= start or (phase.begin >= end and end > start):
            raise DefinitionError(
                f"phase {phase.name!r} lasts from {phase.begin} s to {phase.end} s, "
                f"the motion from {start} s to {end} s; they must have time in common"
            )
    for before, after in itertools.pairwise(checked):
        if after.begin < before.end - slack:
            raise DefinitionError(
                f"phase {after.name!r} begins at {after.begin} s, before {before.name!r} ended at {before.end} s; "
                "phases must follow each other in time"
            )
    return checked


def _check_frame(frame: Any, what: str) -> None:
    if not isinstance(frame, int | np.integer) or isinstance(frame, bool) or frame < -1:
        raise DefinitionError(f"frame of {what} is {frame!r}; it must be an index or -1")


@dataclass(frozen=True, eq=False)
class PathLine:
    """Hold a polyline in space.

    Attributes:
        name: Name in the legend.
        points: Vertices in the world [m], shape (k, 3) with k >= 1; read-only.
        color: "#RRGGBB", or "" for the next colour of the palette.
        dashed: Whether the line is drawn dashed.
    """

    name: str
    points: NDArray[np.float64]
    color: str = ""
    dashed: bool = False

    def __post_init__(self) -> None:
        points = finite_array(self.points, (None, 3), f"points of path {self.name!r}")
        object.__setattr__(self, "points", points)
        check_color(self.color, f"color of path {self.name!r}")


@dataclass(frozen=True, eq=False)
class Readout:
    """Hold a quantity along time, shown as a live number above a small chart.

    Attributes:
        name: Name of the quantity.
        unit: Its unit as printed, "" for a pure number.
        values: One value per sample of the motion, in that unit, shape (n,); read-only.
        bound: Limit drawn as a dashed line, in the same unit; None for no limit.
        side: "lower" where values must stay above the bound, "upper" where they must stay below it.
    """

    name: str
    unit: str
    values: NDArray[np.float64]
    bound: float | None = None
    side: str = "lower"

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", finite_array(self.values, (None,), f"values of readout {self.name!r}"))
        if self.bound is not None:
            bound = finite_vector([self.bound], 1, f"bound of readout {self.name!r}")
            object.__setattr__(self, "bound", float(bound[0]))
        if self.side not in SIDES:
            raise unknown_name(f"side of readout {self.name!r}:", self.side, SIDES)


def finite_array(values: Any, shape: tuple[int | None, ...], what: str) -> NDArray[np.float64]:
    """Copy values into a read-only array of finite floats.

    Args:
        values: Numbers.
        shape: Required shape; None stands for any length of at least 1.
        what: How an error calls the array.

    Returns:
        The array, read-only.

    Raises:
        DefinitionError: The shape differs, or an entry is not a finite number; the message gives its index.
    """
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise DefinitionError(f"{what}: entries must be numbers ({error})") from error
    wanted = ", ".join("n" if size is None else str(size) for size in shape)
    fits = len(shape) == array.ndim and all(
        actual >= 1 if size is None else actual == size for size, actual in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise DefinitionError(f"{what}: shape is {array.shape}; it must be ({wanted}{',' if len(shape) == 1 else ''})")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        raise DefinitionError(f"{what}: entry {index} is {array[index]}; every entry must be finite")
    array.flags.writeable = False
    return array


def increasing_times(times: Any) -> NDArray[np.float64]:
    """Copy instants [s] into a read-only vector and refuse those that do not increase.

    Raises:
        DefinitionError: Not a vector of finite numbers, or an instant does not come after the one before.
    """
    instants = finite_array(times, (None,), "times")
    steps = np.diff(instants)
    if np.any(steps <= 0.0):
        index = int(np.argmax(steps <= 0.0)) + 1
        raise DefinitionError(
            f"times: instant {index} is {instants[index]} s, after {instants[index - 1]} s; they must increase"
        )
    return instants
