"""What a page or a figure is told to draw: bodies, lines in space and quantities along time."""

from __future__ import annotations

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
        if not isinstance(self.frame, int | np.integer) or isinstance(self.frame, bool) or self.frame < -1:
            raise DefinitionError(f"frame of body {self.name!r} is {self.frame!r}; it must be an index or -1")
        if self.kind not in KINDS:
            raise unknown_name(f"kind of body {self.name!r}:", self.kind, KINDS)


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
