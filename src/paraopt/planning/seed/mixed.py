"""The mixed depth/breadth search: straight to the goal while free, along the obstacle's boundary when blocked."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BudgetExceededError, DefinitionError, NoPathError
from paraopt.planning.ground import Ground, Spot
from paraopt.planning.problem import Problem
from paraopt.planning.seed.base import Seed, begin_search, choose_step, try_straight
from paraopt.planning.validity import Validity

Array = NDArray[np.float64]
Node = tuple[int, ...]
_AHEAD = 4
_REPEATS = 200


@dataclass(frozen=True)
class MixedSearch:
    """Search a grid of the operational space, in depth while free and in breadth along blocked positions.

    Attributes:
        step: Step of the grid in the problem's metric [m]; when None an eighth of the distance, and no less than a
            thirty-second of the machine's characteristic length.
        refinements: How often the step is halved when no way is found or a way fails between its nodes.
        resolution: Spacing of the checks along an edge, as a fraction of the step.
        max_checks: Number of poses that may be judged before the search gives up.
        cuts: How often the corners of the way are cut.
        neighbourhood: "full" for all 3^m - 1 positions around one, "axes" for the 2 m along the axes; when None full
            for up to three coordinates.

    Source: Lahouar, III.1.
    """

    step: float | None = None
    refinements: int = 2
    resolution: float = 0.2
    max_checks: int = 60000
    cuts: int = 1
    neighbourhood: Literal["full", "axes"] | None = None

    def __post_init__(self) -> None:
        if self.step is not None and not (np.isfinite(self.step) and self.step > 0):
            raise DefinitionError(f"step of the search is {self.step} m; it must be finite and above 0")
        if self.refinements < 0 or self.cuts < 0 or self.max_checks < 1:
            raise DefinitionError("refinements and cuts must not be negative and max_checks at least 1")
        if self.neighbourhood not in ("full", "axes", None):
            raise DefinitionError(f"neighbourhood of the search is {self.neighbourhood!r}; it must be 'full' or 'axes'")
        if not 0 < self.resolution <= 1:
            raise DefinitionError(f"resolution of the search is {self.resolution}; it must be in (0, 1]")

    def seed(self, problem: Problem) -> Seed:
        """Find a chain of valid configurations from the start to the goal.

        Args:
            problem: The problem.

        Returns:
            The straightened polyline, with what was explored.

        Raises:
            InfeasibleError: The start or the goal is not valid, or they lie on different branches.
            NoPathError: No way exists at the finest step. Evidence: "reasons" counts what blocked it, "step" is the
                finest step, "cause" says what parts the ends: "collision", "singularity" (and ranges), "solution" (the
                goal's coordinates were reached, but in another solution of the closures), or "unknown".
            BudgetExceededError: The number of checks ran out.
        """
        validity, distance = begin_search(problem)
        step = self.step if self.step is not None else choose_step(problem, distance)
        for refinement in range(self.refinements + 1):
            grid = _Grid(problem, validity, step, self)
            try:
                return grid.run()
            except NoPathError as error:
                if refinement == self.refinements:
                    raise self._explain(problem, grid, error) from None
            step *= 0.5
        raise AssertionError("the loop returns or raises")

    def _explain(self, problem: Problem, grid: _Grid, error: NoPathError) -> NoPathError:
        """Find out what parts the ends, by a search that solids do not hinder; add it to the error."""
        solids = [r for r, _ in grid.reasons.most_common() if r.startswith("collision")]
        others = [r for r in grid.reasons if not r.startswith("collision")]
        parted = "the ends lie in different regions at this step, though their determinants have equal signs: "
        if grid.met_another:
            cause, text = (
                "solution",
                "the goal's coordinates were reached in another solution of the closures, and the grid knows one for "
                "each position: a way may exist, try RRTConnect, or a search without change of the working mode",
            )
        elif not solids:
            cause, text = "singularity", parted + "no solid stands between them"
        elif not others:
            cause, text = "collision", "only solids bound the region of the start"
        else:
            validity = Validity(problem, collisions=False)
            try:
                _Grid(problem, validity, grid.step, self).run()
            except NoPathError:
                cause, text = "singularity", parted + "there is no way without the solids either"
            except BudgetExceededError:
                cause, text = "unknown", "whether there is a way without the solids was not found within the budget"
            else:
                cause, text = (
                    "collision",
                    f"without the solids there is a way, closed first of all by {', '.join(solids[:3])}",
                )
        return grid.no_path(error.evidence["what"], cause, text)


@dataclass(frozen=True, eq=False)
class _Way:
    """Hold a chain of valid spots, their nodes but for the last one, and where the search changed its mode."""

    spots: list[Spot]
    nodes: list[Node]
    turns: list[int]
    queued: list[Array]


class _Grid(Ground):
    """Judge positions and lines at one step of the grid, and count what is found."""

    def __init__(self, problem: Problem, validity: Validity, step: float, options: MixedSearch) -> None:
        block = max(1, round(1.0 / options.resolution))
        super().__init__(problem, validity, options.resolution * step, options.max_checks, block)
        self.step, self.resolution, self.cuts = step, options.resolution, options.cuts
        m = len(problem.independent)
        if options.neighbourhood == "full" or (options.neighbourhood is None and m <= 3):
            self.moves = np.array([d for d in product((-1, 0, 1), repeat=m) if any(d)])
        else:
            self.moves = np.vstack([np.eye(m, dtype=int), -np.eye(m, dtype=int)])
        self.delta = step / problem.metric
        self.met_another = False  # the goal's coordinates, but another solution of the closures

    def run(self) -> Seed:
        """Search, straighten and check."""
        origin, goal = self.origin, self.problem.goal_values()
        straight, last = try_straight(self)
        if last is not None:
            return Seed.along(self, [origin, last], step=self.step, straight_reason=straight)
        search = _Search(self, origin, goal)
        way = search.run()
        switches = [way.spots[i].value for i in way.turns]
        spots = self.straighten(self._replan(way, search), self.cuts)
        return Seed.along(self, spots, step=self.step, straight_reason=straight, switches=switches, queued=way.queued)

    def no_path(self, what: str, cause: str = "", why: str = "") -> NoPathError:
        """Build the error that says why there is no way, and what blocked it."""
        summary = ", ".join(f"{reason} ({count})" for reason, count in self.reasons.most_common(4))
        return NoPathError(
            f"no path at a step of {1e3 * self.step:.3g} mm: {what}; blocked by {summary or 'nothing'}; "
            f"{why}{'; ' if why else ''}move the obstacle, lower the margins, or try a finer step",
            what=what,
            cause=cause,
            reasons=dict(self.reasons),
            explored=np.array(self.explored),
            blocked=np.array(self.blocked),
            step=self.step,
        )

    def _replan(self, way: _Way, search: _Search) -> list[Spot]:
        """Search again between the start, the spots where the mode changed, and the goal; keep what is shorter."""
        corners = [0, *way.turns, len(way.spots) - 1]
        result = way.spots[:1]
        for i, j in pairwise(corners):
            part = way.spots[i : j + 1]
            _, last = self.edge(part[0], part[-1].value)
            if last is not None and self.is_same(last, part[-1]):
                part = [part[0], last]
            elif j - i > 3:
                try:
                    again = search.between(way.nodes[i], part[-1].value).run().spots
                except NoPathError:
                    again = part
                if self.is_same(again[-1], part[-1]):
                    part = min(part, again, key=self.length_of)
            result += part[1:]
        return result


class _Search:
    """Hold one search from a spot to a goal: its lattice, and what is known of it."""

    def __init__(self, grid: _Grid, origin: Spot, goal: Array) -> None:
        self.grid, self.origin, self.goal, self.whole = grid, origin, goal, True
        self.root: Node = (0,) * len(goal)
        self.known: dict[Node, Spot | None] = {self.root: origin}  # None where blocked
        self.closed: set[tuple[Node, Node]] = set()  # edges that are blocked between free nodes
        self._around: dict[Node, list[Node]] = {}

    def between(self, root: Node, goal: Array) -> _Search:
        """Prepare a search for a part of the way, on the same lattice and with all that is known of it."""
        part = _Search(self.grid, self.origin, goal)
        part.root, part.whole = root, False
        part.known, part.closed = self.known, self.closed
        return part

    def run(self) -> _Way:
        """Search a way whose edges are valid too; round a blocked edge, or search again without it."""
        for _ in range(_REPEATS):
            nodes, modes, last, queued = self._walk()
            edges = list(pairwise(nodes))
            blocked = [edge for edge, free in zip(edges, self._free_edges(edges), strict=True) if not free]
            detours = {edge: self._detour(edge) for edge in blocked}
            self.closed.update(edge for edge, node in detours.items() if node is None)
            if any(node is None for node in detours.values()):
                continue
            for (a, _), node in detours.items():
                if node is not None:
                    i = nodes.index(a) + 1
                    nodes.insert(i, node)
                    modes.insert(i, modes[i - 1])
            turns = [i for i in range(1, len(modes)) if modes[i] != modes[i - 1]]
            spots = [*(self._spot(node) for node in nodes), last]
            return _Way(spots, nodes, turns, [self._spot(node).value for node in queued])
        raise self.grid.no_path(f"ways exist between the nodes, but {_REPEATS} of them are blocked between two nodes")

    def _walk(self) -> tuple[list[Node], list[str], Spot, list[Node]]:
        """Run the mixed search once.

        Returns:
            The nodes of the way, the mode in which each was reached, the goal, and the nodes that still wait.
        """
        grid = self.grid
        parent: dict[Node, tuple[Node | None, str]] = {self.root: (None, "depth")}
        queue: deque[Node] = deque([self.root])
        near = grid.step * float(np.sqrt(len(self.goal))) * 0.75
        while queue:
            head = queue.popleft()
            here = self._spot(head)
            if self._distances(here.value[None, :])[0] <= near:
                _, last = grid.edge(here, grid.toward(here.value, self.goal) if self.whole else self.goal)
                if last is not None and self.whole and not grid.is_goal(last):
                    grid.met_another = True
                elif last is not None:
                    return *_trace(head, parent), last, list(queue)
            around = self._neighbours(head)
            nearest = next((node for node in around if (head, node) not in self.closed), head)
            if nearest in parent:
                continue  # that way is already taken, from elsewhere
            self._judge([(nearest, head)])
            if self.known[nearest] is not None:
                parent[nearest] = (head, "depth")
                queue.appendleft(nearest)
                continue
            # the neighbours of the next heads will be wanted too: judging them together is much cheaper
            ahead = [head, *list(queue)[:_AHEAD]]
            self._judge(list({node: h for h in reversed(ahead) for node in self._neighbours(h)}.items()))
            walls = np.array([node for node in around if self.known[node] is None])
            for node in around:
                if self.known[node] is None or node in parent or (head, node) in self.closed:
                    continue
                if np.any(np.max(np.abs(walls - np.array(node)), axis=1) <= 1):
                    parent[node] = (head, "breadth")
                    queue.append(node)
        raise grid.no_path(f"{len(grid.explored)} positions are free and {len(grid.blocked)} blocked")

    def _spot(self, node: Node) -> Spot:
        spot = self.known[node]
        assert spot is not None  # only free nodes are queued or lie on a way
        return spot

    def _neighbours(self, head: Node) -> list[Node]:
        """List the neighbours of a node, the nearest to the goal first."""
        if head not in self._around:
            nodes = np.array(head) + self.grid.moves
            values = self.origin.value + nodes * self.grid.delta
            low, high = self.grid.problem.turn_bounds
            inside = np.all((values >= low) & (values <= high), axis=1)
            nodes = nodes[inside]
            distances = self._distances(values[inside])
            self._around[head] = [tuple(row) for row in nodes[np.argsort(distances, kind="stable")].tolist()]
        return self._around[head]

    def _judge(self, wanted: Sequence[tuple[Node, Node]]) -> None:
        """Judge those nodes that are not known yet, each from a neighbour that is free."""
        wanted = [(node, near) for node, near in wanted if node not in self.known]
        if wanted:
            values = self.origin.value + np.array([node for node, _ in wanted]) * self.grid.delta
            spots, _ = self.grid.judge(values, [self._spot(near) for _, near in wanted], record=True)
            self.known.update(zip((node for node, _ in wanted), spots, strict=True))

    def _free_edges(self, edges: Sequence[tuple[Node, Node]]) -> list[bool]:
        """Check edges between neighbouring free nodes, all at once."""
        if not edges:
            return []
        count = int(np.ceil(np.sqrt(len(self.goal)) / self.grid.resolution))
        return self.grid.short_edges([(self._spot(i), self._spot(j)) for i, j in edges], count, fine=True)

    def _distances(self, values: Array) -> Array:
        if self.whole:
            return self.grid.distances(values, self.goal)
        return np.linalg.norm((self.goal - values) * self.grid.problem.metric, axis=1)  # no full turn to win here

    def _detour(self, edge: tuple[Node, Node]) -> Node | None:
        """Find a node next to both ends of a blocked edge by which one can go round, the shortest way first."""
        a, b = np.array(edge[0]), np.array(edge[1])
        around = a + self.grid.moves
        beside = around[np.max(np.abs(around - b), axis=1) == 1]
        order = np.argsort(np.linalg.norm(beside - a, axis=1) + np.linalg.norm(beside - b, axis=1), kind="stable")
        candidates: list[Node] = [tuple(row) for row in beside[order].tolist()]
        self._judge([(node, edge[0]) for node in candidates])
        candidates = [node for node in candidates if self.known[node] is not None]
        free = self._free_edges([e for node in candidates for e in ((edge[0], node), (node, edge[1]))])
        return next((node for i, node in enumerate(candidates) if free[2 * i] and free[2 * i + 1]), None)


def _trace(node: Node | None, parent: Mapping[Node, tuple[Node | None, str]]) -> tuple[list[Node], list[str]]:
    """Follow the parents back to the root; nodes and modes from the root on."""
    nodes, modes = [], []
    while node is not None:
        nodes.append(node)
        node, mode = parent[node]
        modes.append(mode)
    return nodes[::-1], modes[::-1]
