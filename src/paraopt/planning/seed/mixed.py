"""The mixed depth/breadth search: straight to the goal while free, along the obstacle's boundary when blocked."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BudgetExceededError, DefinitionError, NoPathError
from paraopt.planning.problem import Problem
from paraopt.planning.seed.base import Seed
from paraopt.planning.validity import VALID, Validity, check_ends

Array = NDArray[np.float64]
Node = tuple[int, ...]
_AHEAD = 4
_REPEATS = 200


@dataclass(frozen=True)
class MixedSearch:
    """Search a grid of the operational space, in depth while free and in breadth along blocked positions.

    Attributes:
        step: Step of the grid in the problem's metric [m]; an eighth of the distance when None.
        refinements: How often the step is halved when no way is found or a way fails between its nodes.
        resolution: Spacing of the checks along an edge, as a fraction of the step.
        max_checks: Number of poses that may be judged before the search gives up.

    Source: Lahouar, III.1.
    """

    step: float | None = None
    refinements: int = 2
    resolution: float = 0.2
    max_checks: int = 60000

    def __post_init__(self) -> None:
        if self.step is not None and not (np.isfinite(self.step) and self.step > 0):
            raise DefinitionError(f"step of the search is {self.step} m; it must be finite and above 0")
        if self.refinements < 0 or self.max_checks < 1:
            raise DefinitionError("refinements must not be negative and max_checks at least 1")
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
            NoPathError: No way exists at the finest step; the evidence counts what blocked it.
            BudgetExceededError: The number of checks ran out.
        """
        validity = Validity(problem)
        check_ends(problem, validity)
        start, goal = problem.start_configuration.X, problem.goal_values()
        begin = start[problem.robot.mechanism.indices(problem.independent)]
        distance = float(np.linalg.norm((goal - begin) * problem.metric))
        if distance == 0.0:
            raise DefinitionError(
                "start and goal are the same pose: there is nothing to plan",
                start=problem.start_configuration,
                goal=problem.goal_configuration,
            )
        step = self.step if self.step is not None else distance / 8.0
        last: NoPathError | None = None
        for _ in range(self.refinements + 1):
            grid = _Grid(problem, validity, step, self.resolution, self.max_checks)
            try:
                return grid.run(begin, goal, start)
            except NoPathError as error:
                last = error
                step *= 0.5
        assert last is not None  # the loop ran at least once
        raise last


@dataclass(frozen=True, eq=False)
class _Spot:
    """Hold a valid position: its coordinates, its configuration, and the motions there."""

    value: Array
    X: Array
    T: Array


@dataclass(frozen=True, eq=False)
class _Way:
    """Hold a chain of valid spots and the indices of those where the search changed its mode."""

    spots: list[_Spot]
    turns: list[int]


class _Grid:
    """Judge positions and lines at one step of the grid, and count what is found."""

    def __init__(self, problem: Problem, validity: Validity, step: float, resolution: float, max_checks: int) -> None:
        self.problem, self.validity, self.step = problem, validity, step
        self.resolution, self.max_checks = resolution, max_checks
        m = len(problem.independent)
        full = [d for d in product((-1, 0, 1), repeat=m) if any(d)]
        self.moves = np.array(full) if m <= 3 else np.vstack([np.eye(m, dtype=int), -np.eye(m, dtype=int)])
        self.delta = step / problem.metric
        self.reasons: Counter[str] = Counter()
        self.explored: list[Array] = []
        self.blocked: list[Array] = []

    def run(self, begin: Array, goal: Array, X: Array) -> Seed:
        """Search, straighten and check."""
        origin = _Spot(begin, X, self.problem.space.tangent(X)[0])
        straight, last = self.edge(origin, goal)
        switches: list[Array] = []
        if last is not None:
            spots = [origin, last]
        else:
            way = _Search(self, origin, goal).run()
            switches = [way.spots[i].value for i in way.turns]
            spots = self._pull(self._replan(way))
        m = len(begin)
        return Seed(
            self.problem,
            np.array([spot.value for spot in spots]),
            np.array([spot.X for spot in spots]),
            np.array(self.explored).reshape(-1, m),
            np.array(self.blocked).reshape(-1, m),
            np.array(switches).reshape(-1, m),
            self.validity.checks,
            self.step,
            straight,
        )

    def judge(
        self, values: Array, nears: Sequence[_Spot], record: bool = False
    ) -> tuple[list[_Spot | None], tuple[str, ...]]:
        """Judge positions, each from a known spot near it.

        Args:
            values: Positions, shape (n, m).
            nears: A known spot for each.
            record: Whether they count as explored or blocked.

        Returns:
            The spots, None where blocked, and the reasons.

        Raises:
            BudgetExceededError: The number of checks would run over its bound.
        """
        if self.validity.checks + len(values) > self.max_checks:
            raise BudgetExceededError(
                f"the search judged {self.validity.checks} poses without reaching the goal at a step of "
                f"{1e3 * self.step:.3g} mm; raise max_checks or take a larger step",
                explored=np.array(self.explored),
                blocked=np.array(self.blocked),
            )
        verdict = self.validity.judge(values, np.array([s.X for s in nears]), np.array([s.T for s in nears]))
        if record:
            for value, valid, reason in zip(values, verdict.valid, verdict.reasons, strict=True):
                (self.explored if valid else self.blocked).append(value)
                if not valid:
                    self.reasons[reason] += 1
        spots = [
            _Spot(v, X, T) if ok else None
            for v, X, T, ok in zip(values, verdict.X, verdict.T, verdict.valid, strict=True)
        ]
        return spots, verdict.reasons

    def edge(self, a: _Spot, b: Array) -> tuple[str, _Spot | None]:
        """Check a straight line at the search's resolution, one step of the grid at a time from its beginning.

        Returns:
            What blocks it first and None, or "valid" and the spot at its end.
        """
        length = float(np.linalg.norm((b - a.value) * self.problem.metric))
        count = max(2, int(np.ceil(length / (self.resolution * self.step))))
        values = a.value + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a.value)
        values[-1] = b
        block, here = max(1, round(1.0 / self.resolution)), a
        for i in range(0, count, block):
            part = values[i : i + block]
            spots, reasons = self.judge(part, [here] * len(part))
            if (blocked := next((r for spot, r in zip(spots, reasons, strict=True) if spot is None), None)) is not None:
                return blocked, None
            here = spots[-1] or here
        return VALID, here

    def no_path(self, what: str) -> NoPathError:
        """Build the error that says why there is no way, and what blocked it."""
        summary = ", ".join(f"{reason} ({count})" for reason, count in self.reasons.most_common(4))
        return NoPathError(
            f"no path at a step of {1e3 * self.step:.3g} mm: {what}; blocked by {summary or 'nothing'}; "
            "move the obstacle, lower the margins, or try a finer step",
            reasons=dict(self.reasons),
            explored=np.array(self.explored),
            blocked=np.array(self.blocked),
            step=self.step,
        )

    def distances(self, values: Array, goal: Array) -> Array:
        """Measure the distances of positions to the goal [m], shape (n,)."""
        difference = self.turn(goal - values) * self.problem.metric
        return np.sqrt(np.einsum("nm,nm->n", difference, difference))

    def turn(self, difference: Array) -> Array:
        """Take periodic angles the short way round."""
        if not np.any(self.problem.periodic):
            return difference
        return np.where(self.problem.periodic, (difference + np.pi) % (2 * np.pi) - np.pi, difference)

    # -- straightening ---------------------------------------------------------------------------------------------

    def _replan(self, way: _Way) -> list[_Spot]:
        """Search again between the start, the spots where the mode changed, and the goal; keep what is shorter."""
        corners = [0, *way.turns, len(way.spots) - 1]
        result = way.spots[:1]
        for i, j in pairwise(corners):
            part = way.spots[i : j + 1]
            _, last = self.edge(part[0], part[-1].value)
            if last is not None:
                part = [part[0], last]
            elif j - i > 3:
                try:
                    again = _Search(self, part[0], part[-1].value).run().spots
                except NoPathError:
                    again = part
                part = min(part, again, key=self._length)
            result += part[1:]
        return result

    def _pull(self, spots: list[_Spot]) -> list[_Spot]:
        """Replace runs of corners by straight lines wherever these are valid, and check every edge that stays."""
        result, here = [spots[0]], 0
        while here < len(spots) - 1:
            best = here + 1
            reason, reached = self.edge(result[-1], spots[best].value)
            if reached is None:
                raise self.no_path(f"a way exists, but one of its edges is blocked by {reason}")
            target = len(spots) - 1
            while target > best:  # look at the farthest first, then halve
                _, seen = self.edge(result[-1], spots[target].value)
                if seen is not None:
                    best, reached = target, seen
                    break
                target = best + (target - best) // 2
            result.append(reached)
            here = best
        return result

    def _length(self, spots: list[_Spot]) -> float:
        points = np.array([spot.value for spot in spots])
        return float(np.sum(np.linalg.norm(np.diff(points * self.problem.metric, axis=0), axis=1)))


class _Search:
    """Hold one search from a spot to a goal: its lattice, and what is known of it."""

    def __init__(self, grid: _Grid, origin: _Spot, goal: Array) -> None:
        self.grid, self.origin, self.goal = grid, origin, goal
        self.root: Node = (0,) * len(goal)
        self.known: dict[Node, _Spot | None] = {self.root: origin}  # None where blocked
        self.closed: set[tuple[Node, Node]] = set()  # edges that are blocked between free nodes
        self._around: dict[Node, list[Node]] = {}

    def run(self) -> _Way:
        """Search a way whose edges are valid too; round a blocked edge, or search again without it."""
        for _ in range(_REPEATS):
            nodes, modes, last = self._walk()
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
            return _Way([*(self._spot(node) for node in nodes), last], turns)
        raise self.grid.no_path(f"ways exist between the nodes, but {_REPEATS} of them are blocked between two nodes")

    def _walk(self) -> tuple[list[Node], list[str], _Spot]:
        """Run the mixed search once.

        Returns:
            The nodes of the way, the mode in which each was reached, and the goal.
        """
        grid = self.grid
        parent: dict[Node, tuple[Node | None, str]] = {self.root: (None, "depth")}
        queue: deque[Node] = deque([self.root])
        near = grid.step * float(np.sqrt(len(self.goal))) * 0.75
        while queue:
            head = queue.popleft()
            here = self._spot(head)
            if grid.distances(here.value[None, :], self.goal)[0] <= near:
                _, last = grid.edge(here, here.value + grid.turn(self.goal - here.value))
                if last is not None:
                    return *_trace(head, parent), last
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

    def _spot(self, node: Node) -> _Spot:
        spot = self.known[node]
        assert spot is not None  # only free nodes are queued or lie on a way
        return spot

    def _neighbours(self, head: Node) -> list[Node]:
        """List the neighbours of a node, the nearest to the goal first."""
        if head not in self._around:
            nodes = np.array(head) + self.grid.moves
            distances = self.grid.distances(self.origin.value + nodes * self.grid.delta, self.goal)
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
        share = np.arange(1, count) / count
        ends = [(self._spot(i), self._spot(j)) for i, j in edges]
        values = np.array([a.value + t * (b.value - a.value) for a, b in ends for t in share])
        spots, _ = self.grid.judge(values, [a for a, _ in ends for _ in share])
        free = np.array([spot is not None for spot in spots]).reshape(len(edges), -1)
        return np.all(free, axis=1).tolist()

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
