"""Read the graph of a mechanism: links in layers that grow from the base, joints and closures with their texts."""

from __future__ import annotations

import re
import textwrap
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import TopologicalSorter
from itertools import pairwise
from typing import Literal

from paraopt.mechanism import Mechanism, Mobile, Series
from paraopt.mechanism.balance import Equilibrium
from paraopt.mechanism.closures import Closure, LinkClosure

ACTIVE, OPERATIONAL = "●", "◆"
"""Signs before the names of active and operational variables: they say without colour what the colours say."""

WRAP = 44
"""Number of letters beyond which a text goes on in the next line."""


@dataclass(frozen=True)
class GraphText:
    """Hold a line of text and what it tells: a "type", or variables of a role.

    Attributes:
        text: The line.
        role: "type", "name" (of a closure), "active", "operational" or "passive".
    """

    text: str
    role: str

    @property
    def bold(self) -> bool:
        """Answer whether the line is written in bold letters."""
        return self.role in ("active", "operational")


@dataclass(frozen=True)
class GraphLink:
    """Hold a link as the graph shows it.

    Attributes:
        name: Name of the link.
        kind: "base", "link" (hangs from a father) or "mobile" (free).
        layer: Layer, 0 at the bottom.
        notes: Lines under the name: the coordinates of a mobile link.
    """

    name: str
    kind: Literal["base", "link", "mobile"]
    layer: int
    notes: tuple[GraphText, ...] = ()


@dataclass(frozen=True)
class GraphTie:
    """Hold what ties two links in the graph: a joint, or all closures between them.

    Attributes:
        name: Name, unique in the graph.
        kind: "joint" or "closure".
        ends: Names of the two links.
        lines: Text on the line: type, then names of variables. A closure that relates more than two links stands once
            for every two that it ties.
        active: Whether an actuator drives one of its variables.
    """

    name: str
    kind: Literal["joint", "closure"]
    ends: tuple[str, str]
    lines: tuple[GraphText, ...]
    active: bool = False


@dataclass(frozen=True)
class LinkGraph:
    """Hold the graph of a mechanism: its links in layers and what ties them.

    The base is in layer 0; legs that come from it stand above it, and a platform above all of its legs. Legs that hang
    from a platform and close at the ground stand below that platform, for they are read from the ground upwards too.

    Attributes:
        links: The links.
        ties: Joints and closures.
    """

    links: tuple[GraphLink, ...]
    ties: tuple[GraphTie, ...]


def build_link_graph(mechanism: Mechanism) -> LinkGraph:
    """Read the graph of a mechanism: links, joints and closures, with the layer of every link.

    Args:
        mechanism: The mechanism.

    Returns:
        The graph; several closures between the same two links make one tie.
    """
    layers = _assign_layers(mechanism)
    roles = {v.name: v.role for v in mechanism.variables}
    links = []
    ties = []
    for link in mechanism.links:
        names = [m.name for m in link.motions]
        if isinstance(link, Series):
            kind = "fixed" if not names else _words(type(link.joint).__name__)
            if len(names) == 1:
                kind += f" {link.motions[0].axis}"
            driven = any(roles[n] == "active" for n in names)
            text = (GraphText(kind, "type"), *_list_variables(names, roles))
            ties.append(GraphTie(f"joint of {link.name}", "joint", (link.father, link.name), text, driven))
            links.append(GraphLink(link.name, "link", layers[link.name]))
        elif isinstance(link, Mobile):
            links.append(GraphLink(link.name, "mobile", layers[link.name], _list_variables(names, roles)))
        else:
            links.append(GraphLink(link.name, "base", layers[link.name]))
    together: dict[tuple[str, str], list[Closure]] = defaultdict(list)
    for closure in mechanism.closures:
        for key in _list_ends(mechanism, closure):
            together[key if key in together or key[::-1] not in together else key[::-1]].append(closure)
    for ends, closures in together.items():
        text = _describe_closures(closures)
        tensions = [t.name for c in closures if isinstance(c, Equilibrium) for t in c.tensions if t.link_A in ends
                    and t.link_B in ends]  # fmt: skip
        text += _list_variables(tensions, roles) if tensions else ()
        driven = any(roles[n] == "active" for n in tensions)
        ties.append(GraphTie(f"closure of {ends[0]} and {ends[1]}", "closure", ends, text, driven))
    return LinkGraph(tuple(links), tuple(ties))


def _list_ends(mechanism: Mechanism, closure: Closure) -> list[tuple[str, str]]:
    """List the pairs of links that a closure ties, by points, by cables, or by their variables."""
    if isinstance(closure, LinkClosure):
        return [(closure.link_A, closure.link_B)]
    if isinstance(closure, Equilibrium):
        pairs = [(t.link_A, t.link_B) for t in closure.tensions]
    else:
        moved = [mechanism.variables[i].link for i in mechanism.indices(closure.related)]
        pairs = [(a, b) for a, b in pairwise(dict.fromkeys(moved))]
    return list({frozenset(pair): pair for pair in pairs}.values())


# --- Layers


def _assign_layers(mechanism: Mechanism) -> dict[str, int]:
    """Give every link a layer above all that it is reached from, seen from the base.

    Links tied by joints form trees, one from the base and one from each mobile link. Trees are ranked by the least
    number of closures between them and the base. A closure leads from the lower rank to the higher; inside a tree, a
    joint leads from father to son, but from son to father where the lower ranks are reached through the son. A closure
    between equal ranks leads to the link that more closures end at: what carries several legs stands above them.
    """
    father = {k.name: k.father for k in mechanism.links if isinstance(k, Series)}

    def ancestors(link: str) -> Iterable[str]:
        while True:
            yield link
            if link not in father:
                return
            link = father[link]

    tree = {link.name: deque(ancestors(link.name), maxlen=1)[0] for link in mechanism.links}
    ties = [pair for c in mechanism.closures for pair in _list_ends(mechanism, c)]
    rank = _rank_trees(mechanism.base.name, [(tree[a], tree[b]) for a, b in ties])
    last = max(rank.values()) + 1
    upwards: set[str] = set()
    for a, b in ties:
        low, high = rank.get(tree[a], last), rank.get(tree[b], last)
        if low != high:
            upwards.update(ancestors(b if low < high else a))
    before: dict[str, set[str]] = {link.name: set() for link in mechanism.links}
    for son, parent in father.items():
        if son in upwards and tree[son] != mechanism.base.name:
            before[parent].add(son)
        else:
            before[son].add(parent)
    for a, b in ties:
        low, high = rank.get(tree[a], last), rank.get(tree[b], last)
        if low != high:
            before[b if low < high else a].add(a if low < high else b)
    weight = Counter(end for pair in {frozenset(pair) for pair in ties} for end in pair)
    for a, b in sorted(ties, key=lambda pair: abs(weight[pair[0]] - weight[pair[1]]), reverse=True):
        lighter, heavier = (a, b) if weight[a] < weight[b] else (b, a)
        level = rank.get(tree[a], last) == rank.get(tree[b], last)
        if level and weight[a] != weight[b] and not _leads_to(before, heavier, lighter):
            before[heavier].add(lighter)
    layers: dict[str, int] = {}
    for link in TopologicalSorter(before).static_order():
        layers[link] = max((layers[other] + 1 for other in before[link]), default=0)
    return layers


def _leads_to(before: Mapping[str, set[str]], first: str, last: str) -> bool:
    """Answer whether the first link must stand below the last one."""
    waiting, seen = [last], set()
    while waiting:
        link = waiting.pop()
        if link == first:
            return True
        if link not in seen:
            seen.add(link)
            waiting += before[link]
    return False


def _rank_trees(base: str, ties: Sequence[tuple[str, str]]) -> dict[str, int]:
    """Give the least number of closures between the base's tree and every tree that closures lead to."""
    rank = {base: 0}
    queue = deque([base])
    while queue:
        tree = queue.popleft()
        for a, b in ties:
            for here, there in ((a, b), (b, a)):
                if here == tree and there not in rank:
                    rank[there] = rank[tree] + 1
                    queue.append(there)
    return rank


# --- Texts


def _words(name: str) -> str:
    """Write the name of a class as words: "ClosingRevolute" gives "closing revolute"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()


def count(number: int, word: str) -> str:
    """Write a number with its word, in the plural where it must be."""
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _list_variables(names: Sequence[str], roles: Mapping[str, str]) -> tuple[GraphText, ...]:
    """List variables in lines, one or more per role, the first of a role opened by its sign."""
    lines: list[GraphText] = []
    for role, sign in (("active", f"{ACTIVE} "), ("operational", f"{OPERATIONAL} "), ("passive", "")):
        chosen = [name for name in names if roles[name] == role]
        if chosen:
            lines += [GraphText(line, role) for line in _wrap(sign + _abbreviate(chosen))]
    return tuple(lines)


def _wrap(text: str) -> list[str]:
    return textwrap.wrap(text, WRAP, break_long_words=False, break_on_hyphens=False)


def _abbreviate(names: Sequence[str]) -> str:
    """List names, the common stem only once: "leg 1.x", "leg 1.y" gives "leg 1.x, .y"."""
    stem = names[0].rpartition(".")[0] + "."
    if len(names) < 2 or stem == "." or not all(name.startswith(stem) for name in names):
        return ", ".join(names)
    return ", ".join([names[0], *("." + name.removeprefix(stem) for name in names[1:])])


def _describe_closures(closures: Sequence[Closure]) -> tuple[GraphText, ...]:
    """Describe the closures between two links: how many of which type, and the name of one that has its own."""
    lines = []
    for kind in dict.fromkeys(type(c) for c in closures):
        count = sum(type(c) is kind for c in closures)
        words = _words(kind.__name__)
        lines.append(GraphText(words if count == 1 else f"{count} × {words}", "type"))
    first = closures[0]
    if len(closures) == 1 and first.name != replace(first, name="").name:  # type: ignore[type-var]
        lines += [GraphText(line, "name") for line in _wrap(first.name)]
    return tuple(lines)
