"""Which bodies are checked against which, and why the others are not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from paraopt.mechanism import Series
from paraopt.robot import Robot
from paraopt.shapes import Shape

WORLD = -1


@dataclass(frozen=True, eq=False)
class Body:
    """Describe one solid of a scene.

    Attributes:
        name: Name.
        shape: The solid, placed in its frame.
        frame: Index of the link that carries it, in the order of `mechanism.links`; -1 for the world.
        link: Name of that link; "world" for an obstacle.
    """

    name: str
    shape: Shape
    frame: int
    link: str


@dataclass(frozen=True)
class Pair:
    """Name two bodies whose distance is checked.

    Attributes:
        first: Index of the first body.
        second: Index of the second body.
        name: Both names.
        is_external: Whether one of them is an obstacle.
    """

    first: int
    second: int
    name: str
    is_external: bool


@dataclass(frozen=True)
class SkippedPair:
    """Name two bodies whose distance is not checked, and say why.

    Attributes:
        name: Both names.
        reason: Why the pair is left out.
    """

    name: str
    reason: str


def list_bodies(robot: Robot, obstacles: Sequence[Shape]) -> tuple[Body, ...]:
    """List the solids of the links in the order of the links, then the obstacles."""
    bodies = []
    for frame, link in enumerate(robot.mechanism.links):
        for shape in robot.shapes.get(link.name, ()):
            bodies.append(Body(shape.name, shape, frame, link.name))
    for i, shape in enumerate(obstacles):
        bodies.append(Body(shape.name or f"obstacle {i + 1}", shape, WORLD, "world"))
    return tuple(bodies)


def choose_pairs(robot: Robot, bodies: Sequence[Body]) -> tuple[tuple[Pair, ...], tuple[SkippedPair, ...]]:
    """Decide for every pair of bodies whether it is checked.

    Left out are pairs on one link, pairs of fixed bodies, links joined by a joint or a closure (also through links that
    carry no solid), and the contacts that the robot declares.

    Args:
        robot: The machine.
        bodies: All solids of the scene.

    Returns:
        The checked pairs and the skipped ones with their reasons.
    """
    neighbours = find_neighbours(robot)
    still = {robot.mechanism.base.name, "world"}
    checked: list[Pair] = []
    skipped: list[SkippedPair] = []
    for i, j in combinations(range(len(bodies)), 2):
        a, b = bodies[i], bodies[j]
        name = f"{a.name} / {b.name}"
        key = frozenset((a.link, b.link))
        declared = next((r for p, r in robot.contacts.items() if frozenset(p) == key), None)
        if a.link == b.link:
            skipped.append(SkippedPair(name, f"both on {a.link!r}"))
        elif key <= still:
            skipped.append(SkippedPair(name, "neither moves"))
        elif key in neighbours:
            skipped.append(SkippedPair(name, neighbours[key]))
        elif declared is not None:
            skipped.append(SkippedPair(name, f"declared: {declared}"))
        else:
            checked.append(Pair(i, j, name, "world" in key))
    return tuple(checked), tuple(skipped)


@dataclass(frozen=True)
class _Tie:
    """Describe how a link is tied to another: by what, and at which of its own points (None when it slides)."""

    other: str
    kind: str
    point: tuple[float, float, float] | None


def find_neighbours(robot: Robot, reach: float = 0.05) -> dict[frozenset[str], str]:
    """Find the links joined to each other, directly or through links that carry no solid.

    A link without a solid (the cross of a cardan, a bare end point) makes neighbours of what is tied to it at the same
    place; a bare base or platform does not make neighbours of legs that are tied to it at different places.

    Args:
        robot: The machine.
        reach: Distance, in characteristic lengths, within which two ties are at the same place.

    Returns:
        For each pair of names the reason, such as "joined by a joint".
    """
    ties = _list_ties(robot)
    reach *= robot.mechanism.length
    found: dict[frozenset[str], str] = {}
    for start in (name for name in ties if robot.shapes.get(name)):
        waiting = [
            (tie.other, tie.kind, back) for tie in ties[start] for back in ties[tie.other] if back.other == start
        ]
        seen: set[tuple[str, str]] = set()
        while waiting:
            here, kind, arrived = waiting.pop()
            if robot.shapes.get(here):
                if here != start:
                    found.setdefault(frozenset((start, here)), f"joined by {kind}")
                continue
            for tie in ties[here]:
                if tie.other == start or (here, tie.other) in seen or not _is_near(arrived.point, tie.point, reach):
                    continue
                seen.add((here, tie.other))
                via = kind if kind.startswith("way of") else f"way of {here!r}, which has no solid"
                waiting += [(tie.other, via, back) for back in ties[tie.other] if back.other == here]
    return found


def _list_ties(robot: Robot) -> dict[str, list[_Tie]]:
    ties: dict[str, list[_Tie]] = {link.name: [] for link in robot.mechanism.links}
    origin = (0.0, 0.0, 0.0)
    for link in robot.mechanism.links:
        if isinstance(link, Series):
            slides = any(m.kind == "length" for m in link.motions)
            x, y, z = link.at
            ties[link.father].append(_Tie(link.name, "a joint", None if slides else (x, y, z)))
            ties[link.name].append(_Tie(link.father, "a joint", None if slides else origin))
    for closure in robot.mechanism.closures:
        if not closure.points:  # directions alone do not bring two links together
            continue
        anchor_A, anchor_B = closure.anchors
        ties[closure.link_A].append(_Tie(closure.link_B, "a closure", anchor_A))
        ties[closure.link_B].append(_Tie(closure.link_A, "a closure", anchor_B))
    return ties


def _is_near(a: tuple[float, float, float] | None, b: tuple[float, float, float] | None, reach: float) -> bool:
    return a is not None and b is not None and math.dist(a, b) <= reach
