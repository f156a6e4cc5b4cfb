"""Colours, in one place for the page and the figures.

The hues are those of Okabe and Ito, which people with any kind of colour vision tell apart; where two things must be
distinguished, a line style or a label says it again.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from paraopt.errors import DefinitionError

BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
ORANGE = "#E69F00"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
SLATE = "#64748B"

INK = "#1F2933"
MUTED = "#5B6776"
RULE = "#D9DEE5"
PAPER = "#FFFFFF"
SURFACE = "#F5F7F9"

SERIES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, SLATE)
"""Colours of curves, in the order in which they are given out."""

PATHS = (GREEN, PURPLE, "#7A5195", SKY, BLUE, VERMILLION)
"""Colours of paths, which are seen among bodies."""

KIND_COLORS: Mapping[str, str] = MappingProxyType(
    {"robot": "#A3AFBD", "platform": BLUE, "base": "#667385", "obstacle": VERMILLION, "actuator": ORANGE}
)
"""Colour of a body by its kind."""

CABLE = "#333D49"
"""Colour of cables."""

MARKS = ("#D81B60", "#004D40", "#F0E442", "#7B3FA0")
"""Colours of the marks of a phase, in the order of their labels: neither those of bodies nor the first of paths."""

KIND_LABELS: Mapping[str, str] = MappingProxyType(
    {"robot": "Links", "platform": "Platform", "base": "Base", "obstacle": "Obstacles", "actuator": "Actuators"}
)
"""How a legend calls a kind."""


def series_color(index: int) -> str:
    """Give the colour of the curve with this index; colours repeat after the last."""
    return SERIES[index % len(SERIES)]


def path_color(index: int) -> str:
    """Give the colour of the path with this index: those of platform and obstacles come last."""
    return PATHS[index % len(PATHS)]


def series_dash(index: int) -> str | tuple[float, tuple[float, ...]]:
    """Give the matplotlib line style that keeps curves apart once the colours repeat."""
    turn = index // len(SERIES)
    return "-" if turn == 0 else (0.0, (6.0, 1.0 + turn, 1.0, 1.0 + turn))


def check_color(color: str, what: str) -> str:
    """Return a colour written "#RRGGBB", or "" for one given out by index.

    Raises:
        DefinitionError: The colour is written otherwise.
    """
    if isinstance(color, str) and (color == "" or re.fullmatch(r"#[0-9A-Fa-f]{6}", color)):
        return color
    raise DefinitionError(f'{what} is {color!r}; it must be written "#RRGGBB", or "" to take the next of the palette')
