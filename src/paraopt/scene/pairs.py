"""Which bodies are checked against which, and why the others are not."""

from __future__ import annotations

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


def find_neighbours(robot: Robot) -> dict[frozenset[str], str]:
    """Find the links joined to each other, directly or through links that carry no solid.

    Returns:
        For each pair of names the reason, such as "joined by a joint".
    """
    mechanism = robot.mechanism
    edges: dict[str, list[tuple[str, str]]] = {link.name: [] for link in mechanism.links}

    def join(a: str, b: str, how: str) -> None:
        edges[a].append((b, how))
        edges[b].append((a, how))

    for link in mechanism.links:
        if isinstance(link, Series):
            join(link.name, link.father, "a joint")
    for closure in mechanism.closures:
        join(closure.link_A, closure.link_B, "a closure")
    found: dict[frozenset[str], str] = {}
    for start in (name for name in edges if robot.shapes.get(name)):
        waiting, seen = [(start, "", 0)], {start}
        while waiting:
            here, how, hops = waiting.pop()
            for there, kind in edges[here]:
                if there in seen:
                    continue
                seen.add(there)
                if robot.shapes.get(there):
                    via = f"joined by {kind}" if hops == 0 else f"joined through {how or here!r}, which has no solid"
                    found.setdefault(frozenset((start, there)), via)
                else:
                    waiting.append((there, how or there, hops + 1))
    return found
