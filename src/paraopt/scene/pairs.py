"""Which bodies are checked against which, and why the others are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from paraopt.errors import unknown_name
from paraopt.mechanism import Fixed, LinkClosure, Series, Weld
from paraopt.robot import Robot
from paraopt.scene.ends import Tie, find_places, is_near, why_not_cables, why_not_solid
from paraopt.scene.rules import PairRule, find_rule
from paraopt.shapes import Cable, Shape

WORLD = -1


@dataclass(frozen=True, eq=False)
class Body:
    """Describe one solid or cable of a scene.

    Attributes:
        name: Name.
        shape: The solid, placed in its frame, or the cable.
        frame: Index of the link that carries it, in the order of `mechanism.links`; -1 for the world. Of a cable, that
            of its first end.
        link: Name of that link; "world" for an obstacle.
        frame_B: Index of the link that carries a cable's second end.
        link_B: Name of that link; empty for solids.
    """

    name: str
    shape: Shape | Cable
    frame: int
    link: str
    frame_B: int = WORLD
    link_B: str = ""

    @property
    def links(self) -> tuple[str, ...]:
        """Give the link that carries it, or both links of a cable."""
        return (self.link, self.link_B) if isinstance(self.shape, Cable) else (self.link,)


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


def list_bodies(robot: Robot, obstacles: Sequence[Shape], cables: Sequence[Cable] = ()) -> tuple[Body, ...]:
    """List the solids of the links in the order of the links, then the obstacles, then the cables.

    Raises:
        UnknownNameError: A cable ends on a link that does not exist.
    """
    bodies = []
    links = [link.name for link in robot.mechanism.links]
    for frame, link in enumerate(links):
        for shape in robot.shapes.get(link, ()):
            bodies.append(Body(shape.name, shape, frame, link))
    for i, shape in enumerate(obstacles):
        bodies.append(Body(shape.name or f"obstacle {i + 1}", shape, WORLD, "world"))
    for cable in cables:
        for name in cable.links:
            if name not in links:
                raise unknown_name(f"link at an end of cable {cable.name!r}:", name, links)
        a, b = (links.index(name) for name in cable.links)
        bodies.append(Body(cable.name, cable, a, cable.link_A, b, cable.link_B))
    return tuple(bodies)


def choose_pairs(
    robot: Robot, bodies: Sequence[Body], rules: Sequence[PairRule] = ()
) -> tuple[tuple[Pair, ...], tuple[SkippedPair, ...]]:
    """Decide for every pair of bodies whether it is checked.

    Left out are pairs on one link, or on links fixed to each other, pairs of bodies that do not move (obstacles, the
    base, and what is fixed to it), links joined by a joint or a closure (also through links that carry no solid),
    cables and the solids that hold their ends, cables that end at one place, and the contacts that the robot declares.
    Rules have the last word.

    Args:
        robot: The machine.
        bodies: All bodies of the scene.
        rules: What a person decided, the last rule about a pair holds.

    Returns:
        The checked pairs and the skipped ones with their reasons.
    """
    neighbours = find_neighbours(robot)
    rigid = find_rigid_groups(robot)
    declared = {frozenset(pair): reason for pair, reason in robot.contacts.items()}
    ties = _list_ties(robot)
    places = {b.name: find_places(ties, b.shape) for b in bodies if isinstance(b.shape, Cable)}
    checked: list[Pair] = []
    skipped: list[SkippedPair] = []
    for i, j in combinations(range(len(bodies)), 2):
        a, b = bodies[i], bodies[j]
        name = f"{a.name} / {b.name}"
        reason = _why_not(a, b, neighbours, rigid, declared, places)
        rule = find_rule(rules, (a.name, *a.links), (b.name, *b.links))
        if rule is not None:
            reason = "" if rule.check else rule.reason
        if reason:
            skipped.append(SkippedPair(name, reason))
        else:
            checked.append(Pair(i, j, name, "world" in (*a.links, *b.links)))
    return tuple(checked), tuple(skipped)


def _why_not(
    a: Body,
    b: Body,
    neighbours: dict[frozenset[str], str],
    rigid: dict[str, str],
    declared: dict[frozenset[str], str],
    places: Mapping[str, Sequence[Mapping[str, Sequence[float]]]],
) -> str:
    """Tell why two bodies need no check; an empty string where they do."""
    links = (*a.links, *b.links)
    if len(set(links)) == 1:
        return f"both on {a.link!r}"
    if all(rigid[link] == "world" for link in links):
        return "neither moves"
    if isinstance(a.shape, Cable) or isinstance(b.shape, Cable):
        return _why_no_cable(a, b, places)
    key = frozenset(links)
    if key in neighbours:
        return neighbours[key]
    if rigid[a.link] == rigid[b.link]:
        return f"{a.link!r} and {b.link!r} are fixed to each other"
    return f"declared: {declared[key]}" if key in declared else ""


def _why_no_cable(a: Body, b: Body, places: Mapping[str, Sequence[Mapping[str, Sequence[float]]]]) -> str:
    if isinstance(a.shape, Cable) and isinstance(b.shape, Cable):
        return why_not_cables(a.shape, b.shape, places[a.name], places[b.name])
    if isinstance(a.shape, Cable):
        a, b = b, a
    if isinstance(a.shape, Shape) and isinstance(b.shape, Cable):
        return why_not_solid(a.shape, a.link, b.shape, places[b.name], a.name)
    return ""


def find_rigid_groups(robot: Robot) -> dict[str, str]:
    """Name for every link what it moves with: "world" for what is fixed to the base.

    Fixed joints and welds hold links together.
    """
    links = [link.name for link in robot.mechanism.links]
    group = {name: name for name in links} | {"world": "world", robot.mechanism.base.name: "world"}
    held = [(k.father, k.name) for k in robot.mechanism.links if isinstance(k, Series) and isinstance(k.joint, Fixed)]
    held += [(c.link_A, c.link_B) for c in robot.mechanism.closures if isinstance(c, Weld)]
    for _ in held:  # once for each, so that chains in any order are followed to their end
        for a, b in held:
            one, other = group[a], group[b]
            kept = "world" if "world" in (one, other) else min(one, other)
            group = {name: kept if g in (one, other) else g for name, g in group.items()}
    return group


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
                if tie.other == start or (here, tie.other) in seen or not is_near(arrived.point, tie.point, reach):
                    continue
                seen.add((here, tie.other))
                via = kind if kind.startswith("way of") else f"way of {here!r}, which has no solid"
                waiting += [(tie.other, via, back) for back in ties[tie.other] if back.other == here]
    return found


def _list_ties(robot: Robot) -> dict[str, list[Tie]]:
    ties: dict[str, list[Tie]] = {link.name: [] for link in robot.mechanism.links}
    origin = (0.0, 0.0, 0.0)
    for link in robot.mechanism.links:
        if isinstance(link, Series):
            slides = any(m.kind == "length" for m in link.motions)
            x, y, z = link.at
            there, here = (None, None) if slides else ((x, y, z), origin)
            ties[link.father].append(Tie(link.name, "a joint", there, here))
            ties[link.name].append(Tie(link.father, "a joint", here, there))
    for closure in robot.mechanism.closures:
        # directions alone do not bring two links together, nor do cables or relations between joints
        if not isinstance(closure, LinkClosure) or not closure.points:
            continue
        anchor_A, anchor_B = closure.anchors
        ties[closure.link_A].append(Tie(closure.link_B, "a closure", anchor_A, anchor_B))
        ties[closure.link_B].append(Tie(closure.link_A, "a closure", anchor_B, anchor_A))
    return ties
