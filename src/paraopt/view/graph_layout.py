"""Lay out a graph in layers: boxes in rows, labels of the edges in rows of their own between them, few crossings.

Rows 0, 2, 4, ... hold the nodes, rows 1, 3, 5, ... the labels; an edge that passes a row leaves a gap there. Every box
stands in a row and every slanted piece of a line between two neighbouring rows, so that no line passes through a
foreign box and no two boxes overlap. The order inside the rows comes from barycentres and exchanges of neighbours; the
horizontal places from a linear programme that makes lines upright, for which boxes with several lines grow wider.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_array

from paraopt.errors import BackendError, DefinitionError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GraphNode:
    """Describe a box to place.

    Attributes:
        name: Name, unique.
        layer: Layer, 0 at the bottom.
        width: Least width [in].
        height: Height [in].
    """

    name: str
    layer: int
    width: float
    height: float


@dataclass(frozen=True)
class GraphEdge:
    """Describe a line between two boxes, with a label on it.

    Attributes:
        name: Name, unique.
        ends: Names of two different nodes.
        width: Width of the label [in].
        height: Height of the label [in].
    """

    name: str
    ends: tuple[str, str]
    width: float
    height: float


@dataclass(frozen=True)
class LayoutOptions:
    """State distances and effort.

    Attributes:
        gap: Least distance between boxes of a row [in].
        lane: Width that a passing line takes in a row [in].
        port_gap: Least distance between lines that leave a box on the same side [in].
        port_margin: Least distance between these lines and the corners of the box [in].
        rise: Least height between two rows [in].
        slope: Height between two rows per horizontal way of the most slanted line there [1].
        largest_rise: Largest height between two rows [in].
        sweeps: Number of passes over the rows, from each start.
        starts: Number of orders from which the search for few crossings starts.
        seed: Seed of those orders.
    """

    gap: float = 0.2
    lane: float = 0.06
    port_gap: float = 0.16
    port_margin: float = 0.25
    rise: float = 0.16
    slope: float = 0.22
    largest_rise: float = 0.7
    sweeps: int = 12
    starts: int = 8
    seed: int = 0


@dataclass(frozen=True)
class Rectangle:
    """Hold a placed box: its centre and its size [in]."""

    x: float
    y: float
    width: float
    height: float

    def gap_to(self, other: Rectangle) -> float:
        """Give the larger of the distances between two boxes across and upwards [in]; negative where they overlap."""
        return max(
            abs(self.x - other.x) - 0.5 * (self.width + other.width),
            abs(self.y - other.y) - 0.5 * (self.height + other.height),
        )


@dataclass(frozen=True, eq=False)
class Layout:
    """Hold where everything stands; x to the right, y upwards [in], with (0, 0) at the lower left.

    Attributes:
        nodes: Boxes of the nodes, by name.
        labels: Boxes of the labels, by name of the edge.
        lines: Vertices of every line from one box to the other, shape (k, 2), by name of the edge.
        width: Width of the whole [in].
        height: Height of the whole [in].
    """

    nodes: dict[str, Rectangle]
    labels: dict[str, Rectangle]
    lines: dict[str, Array]
    width: float
    height: float


@dataclass(eq=False)
class _Item:
    """Hold what stands in a row: a node, a label or a passing line; and its neighbours in the rows below and above."""

    row: int
    width: float
    height: float
    node: bool = False
    label: bool = False
    below: list[_Item] = field(default_factory=list)
    above: list[_Item] = field(default_factory=list)
    position: int = 0

    def side(self, up: bool) -> list[_Item]:
        return self.above if up else self.below


def lay_out(nodes: Sequence[GraphNode], edges: Sequence[GraphEdge], options: LayoutOptions | None = None) -> Layout:
    """Place boxes, labels and lines.

    Args:
        nodes: The boxes, with their layers; the order of declaration is kept from left to right where it costs nothing.
        edges: The lines. One between two nodes of a layer is led over a label above that layer.
        options: Distances and effort.

    Returns:
        The layout.

    Raises:
        DefinitionError: An edge ends at an unknown node, or twice at the same one; there is no node.
        BackendError: The linear programme has no solution.
    """
    chosen = options or LayoutOptions()
    if not nodes:
        raise DefinitionError("nodes of the graph is empty; there must be at least one")
    items = {n.name: _Item(2 * n.layer, n.width, n.height, node=True) for n in nodes}
    chains: dict[str, list[_Item]] = {}
    for edge in edges:
        for end in edge.ends:
            if end not in items:
                raise DefinitionError(f"edge {edge.name!r} of the graph ends at {end!r}, which is no node")
        if edge.ends[0] == edge.ends[1]:
            raise DefinitionError(f"edge {edge.name!r} of the graph ties {edge.ends[0]!r} to itself")
        chains[edge.name] = _chain(items[edge.ends[0]], items[edge.ends[1]], edge, chosen)
    rows = _order_rows([*items.values(), *(i for chain in chains.values() for i in chain[1:-1])], chosen)
    left, right, ports = _place_across(rows, chosen)
    spans = _place_upwards(rows, ports, chosen)
    boxes = {
        i: Rectangle(0.5 * (left[i] + right[i]), 0.5 * sum(spans[i.row]), right[i] - left[i], i.height)
        for row in rows
        for i in row
    }
    lines = {}
    for edge in edges:
        points: list[tuple[float, float]] = []
        for item, following in zip(chains[edge.name], chains[edge.name][1:], strict=False):
            points += _leave(boxes[item], spans[item.row], ports[item, following], following.row > item.row)
            points += reversed(
                _leave(boxes[following], spans[following.row], ports[following, item], item.row > following.row)
            )
        lines[edge.name] = np.array(points)
    return Layout(
        {name: boxes[item] for name, item in items.items()},
        {edge.name: boxes[_label(chains[edge.name])] for edge in edges},
        lines,
        max(right.values()),
        spans[-1][1],
    )


# --- From edges to items of rows


def _chain(first: _Item, last: _Item, edge: GraphEdge, options: LayoutOptions) -> list[_Item]:
    """Make the items of an edge and tie them to each other, from its lower end to its upper one."""
    low, high = (first, last) if first.row <= last.row else (last, first)
    if low.row == high.row:
        label = _Item(low.row + 1, edge.width, edge.height, label=True)
        label.below += [low, high]
        low.above.append(label)
        high.above.append(label)
        return [low, label, high]
    middle = (low.row + high.row) // 2
    middle -= 1 - middle % 2
    chain = [low]
    for row in range(low.row + 1, high.row):
        size = (edge.width, edge.height) if row == middle else (options.lane, 0.0)
        chain.append(_Item(row, *size, label=row == middle))
    chain.append(high)
    for lower, upper in itertools.pairwise(chain):
        lower.above.append(upper)
        upper.below.append(lower)
    return chain


def _label(chain: list[_Item]) -> _Item:
    return next(item for item in chain if item.label)


# --- Order inside the rows


def _order_rows(items: list[_Item], options: LayoutOptions) -> list[list[_Item]]:
    """Order every row so that few lines cross; the first order is that in which the graph is walked from the bottom."""
    count = max(item.row for item in items) + 1
    generator = np.random.default_rng(options.seed)
    best: list[list[_Item]] = []
    least = np.inf
    for start in range(options.starts):
        rows: list[list[_Item]] = [[] for _ in range(count)]
        for item in _walk(items):
            rows[item.row].append(item)
        if start:
            rows = [[row[k] for k in generator.permutation(len(row))] for row in rows]
        _number(rows)
        for sweep in range(options.sweeps + 1):
            crossings = sum(_crossings(row) for row in rows)
            if crossings < least:
                least, best = crossings, [list(row) for row in rows]
            if crossings == 0 or sweep == options.sweeps:
                break
            up = sweep % 2 == 0
            for row in rows if up else reversed(rows):
                _sort_by_barycentre(row, not up)
            for row in rows:
                _exchange_neighbours(row)
        if least == 0:
            break
    _number(best)
    return best


def _walk(items: list[_Item]) -> Iterator[_Item]:
    """Visit the items depth first, from the lowest rows upwards, in the order of declaration."""
    seen: set[int] = set()
    for root in sorted(items, key=lambda item: item.row):
        stack = [root]
        while stack:
            item = stack.pop()
            if id(item) in seen:
                continue
            seen.add(id(item))
            yield item
            stack += reversed(item.below + item.above)


def _number(rows: list[list[_Item]]) -> None:
    for row in rows:
        for position, item in enumerate(row):
            item.position = position


def _crossings(row: list[_Item]) -> int:
    """Count the crossings of the lines that rise from a row."""
    pairs = np.array([(item.position, other.position) for item in row for other in item.above])
    if len(pairs) < 2:
        return 0
    difference = np.sign(pairs[:, None, :] - pairs[None, :, :])
    return int(np.sum(difference[..., 0] * difference[..., 1] < 0)) // 2


def _sort_by_barycentre(row: list[_Item], up: bool) -> None:
    """Sort a row by the mean position of the neighbours on one side; items without any stay where they are."""

    def barycentre(item: _Item) -> float:
        others = item.side(up)
        return float(np.mean([o.position for o in others])) if others else float(item.position)

    row.sort(key=barycentre)
    _number([row])


def _exchange_neighbours(row: list[_Item]) -> None:
    """Exchange neighbours as long as that takes crossings away."""
    improved = True
    while improved:
        improved = False
        for k in range(len(row) - 1):
            a, b = row[k], row[k + 1]
            now = sum(o.position > p.position for up in (False, True) for o in a.side(up) for p in b.side(up))
            then = sum(o.position < p.position for up in (False, True) for o in a.side(up) for p in b.side(up))
            if then < now:
                row[k], row[k + 1] = b, a
                a.position, b.position = k + 1, k
                improved = True


# --- Places across


class _Programme:
    """Collect a linear programme: variables at least zero, rows of coefficients bounded from above, costs."""

    def __init__(self) -> None:
        self.costs: list[float] = []
        self.terms: list[tuple[int, int, float]] = []
        self.bounds: list[float] = []

    def variable(self, cost: float = 0.0) -> int:
        self.costs.append(cost)
        return len(self.costs) - 1

    def at_most(self, terms: dict[int, float], bound: float) -> None:
        self.terms += [(len(self.bounds), column, value) for column, value in terms.items()]
        self.bounds.append(bound)

    def solve(self) -> Array:
        rows, columns, values = (np.array(part) for part in zip(*self.terms, strict=True))
        matrix = csr_array((values, (rows, columns)), shape=(len(self.bounds), len(self.costs)))
        result = linprog(self.costs, A_ub=matrix, b_ub=self.bounds, method="highs")
        if result.status != 0:
            raise BackendError(f"the places of the graph could not be computed: {result.message}")
        return np.asarray(result.x, dtype=float)


Ports = dict[tuple[_Item, _Item], float]
_Sides = tuple[int, int]


def _place_across(
    rows: list[list[_Item]], options: LayoutOptions
) -> tuple[dict[_Item, float], dict[_Item, float], Ports]:
    """Choose left and right ends of all boxes, and the places at which lines meet them, so that lines stand upright.

    A line between two rows costs its horizontal way, more where it only passes; width costs little.
    """
    programme = _Programme()
    sides: dict[_Item, _Sides] = {}
    ports: dict[tuple[_Item, _Item], dict[int, float]] = {}
    for row in rows:
        for item in row:
            left, right = programme.variable(-0.02), programme.variable(0.02)
            sides[item] = (left, right)
            programme.at_most({left: 1.0, right: -1.0}, -item.width)
            if not (item.node and max(len(item.below), len(item.above)) > 1):
                programme.at_most({right: 1.0, left: -1.0}, item.width)
            for up in (False, True):
                _add_ports(programme, item, up, sides[item], ports, options)
        for a, b in itertools.pairwise(row):
            programme.at_most({sides[a][1]: 1.0, sides[b][0]: -1.0}, -options.gap)
    for lower in (item for row in rows for item in row):
        for upper in dict.fromkeys(lower.above):
            way = programme.variable(1.0 + 2.0 * (not lower.node) + 2.0 * (not upper.node))
            start, end = ports[lower, upper], ports[upper, lower]
            for sign in (1.0, -1.0):
                terms = {way: -1.0}
                for column, value in start.items():
                    terms[column] = terms.get(column, 0.0) + sign * value
                for column, value in end.items():
                    terms[column] = terms.get(column, 0.0) - sign * value
                programme.at_most(terms, 0.0)
    x = programme.solve()
    shift = min(x[left] for left, _ in sides.values())
    return (
        {item: x[left] - shift for item, (left, _) in sides.items()},
        {item: x[right] - shift for item, (_, right) in sides.items()},
        {key: sum(value * x[column] for column, value in terms.items()) - shift for key, terms in ports.items()},
    )


def _add_ports(
    programme: _Programme,
    item: _Item,
    up: bool,
    sides: _Sides,
    ports: dict[tuple[_Item, _Item], dict[int, float]],
    options: LayoutOptions,
) -> None:
    """Let lines meet a box in its middle, or, several of them at a node, side by side in their order."""
    left, right = sides
    others = sorted(item.side(up), key=lambda other: other.position)
    if not item.node or len(others) < 2:
        for other in others:
            ports[item, other] = {left: 0.5, right: 0.5}
        return
    columns = [programme.variable() for _ in others]
    programme.at_most({left: 1.0, columns[0]: -1.0}, -options.port_margin)
    programme.at_most({columns[-1]: 1.0, right: -1.0}, -options.port_margin)
    for a, b in itertools.pairwise(columns):
        programme.at_most({a: 1.0, b: -1.0}, -options.port_gap)
    for other, column in zip(others, columns, strict=True):
        ports[item, other] = {column: 1.0}


# --- Places upwards


def _place_upwards(rows: list[list[_Item]], ports: Ports, options: LayoutOptions) -> list[tuple[float, float]]:
    """Give the lower and upper end of every row; rows stand farther apart where lines between them are slanted."""
    spans: list[tuple[float, float]] = []
    bottom = 0.0
    for row in rows:
        top = bottom + max((i.height for i in row), default=0.0)
        spans.append((bottom, top))
        ways = [abs(ports[item, other] - ports[other, item]) for item in row for other in item.above]
        bottom = top + min(options.rise + options.slope * max(ways, default=0.0), options.largest_rise)
    return spans


def _leave(box: Rectangle, span: tuple[float, float], x: float, up: bool) -> list[tuple[float, float]]:
    """Lead a line from a box straight to the border of its row, so that it meets no higher neighbour."""
    edge = box.y + (0.5 if up else -0.5) * box.height
    border = span[1] if up else span[0]
    return [(x, edge), (x, border)] if abs(edge - border) > 1e-9 else [(x, edge)]
