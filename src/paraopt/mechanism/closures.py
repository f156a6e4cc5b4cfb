"""Closures: the conditions that turn a tree of links into loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from paraopt.mechanism.links import as_point


@dataclass(frozen=True)
class Closure:
    """Hold what all closures share: two links, named.

    Attributes:
        link_A: Name of the first link.
        link_B: Name of the second link.
    """

    link_A: str
    link_B: str


@dataclass(frozen=True)
class Coincidence(Closure):
    """Keep a point of one link on a point of another.

    Attributes:
        link_A: Name of the first link.
        point_A: Point in the first link's frame [m].
        link_B: Name of the second link.
        point_B: Point in the second link's frame [m].
        name: Name; `link_A = link_B` when empty.

    Source: Lahouar, II.1.
    """

    link_A: str
    point_A: Sequence[float]
    link_B: str
    point_B: Sequence[float]
    name: str = ""

    def __init__(
        self, link_A: str, point_A: Sequence[float], link_B: str, point_B: Sequence[float], name: str = ""
    ) -> None:
        label = name or f"{link_A} = {link_B}"
        object.__setattr__(self, "link_A", link_A)
        object.__setattr__(self, "link_B", link_B)
        object.__setattr__(self, "point_A", as_point(point_A, f"point of {link_A!r} in closure {label!r}"))
        object.__setattr__(self, "point_B", as_point(point_B, f"point of {link_B!r} in closure {label!r}"))
        object.__setattr__(self, "name", label)
