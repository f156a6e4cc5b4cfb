"""The mixed depth/breadth search: straight to the goal while free, along the obstacle's boundary when blocked."""

from __future__ import annotations

from collections import Counter, deque
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
            raise DefinitionError("start and goal are the same pose: there is nothing to plan")
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
    """Hold the state of one search at one step."""

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
        self.switches: list[Array] = []

    def run(self, begin: Array, goal: Array, X: Array) -> Seed:
        """Search, straighten and check."""
        origin = _Spot(begin, X, self.problem.space.tangent(X)[0])
        straight, last = self._edge(origin, goal)
        if last is not None:
            spots = [origin, last]
        else:
            way = self._search(origin, goal)
            self.switches += [way.spots[i].value for i in way.turns]
            spots = self._pull(self._replan(way))
        m = len(begin)
        return Seed(
            self.problem,
            np.array([spot.value for spot in spots]),
            np.array([spot.X for spot in spots]),
            np.array(self.explored).reshape(-1, m),
            np.array(self.blocked).reshape(-1, m),
            np.array(self.switches).reshape(-1, m),
            self.validity.checks,
            self.step,
            straight,
        )

    # -- the search ------------------------------------------------------------------------------------------------

    def _search(self, origin: _Spot, goal: Array) -> _Way:
        """Search a way whose edges are valid too; an edge that proves blocked is taken out and the search repeated."""
        root: Node = (0,) * len(goal)
        known: dict[Node, _Spot | None] = {root: origin}  # None where blocked
        closed: set[tuple[Node, Node]] = set()
        for _ in range(_REPEATS):
            nodes, modes, last = self._walk(origin, goal, known, closed)
            edges = list(pairwise(nodes))
            blocked = [edge for edge, free in zip(edges, self._free_edges(edges, known), strict=True) if not free]
            detours = {edge: self._detour(edge, known, origin) for edge in blocked}
            closed.update(edge for edge, node in detours.items() if node is None)
            if not any(node is None for node in detours.values()):
                for (a, _), node in ((edge, node) for edge, node in detours.items() if node is not None):
                    i = nodes.index(a) + 1
                    nodes.insert(i, node)
                    modes.insert(i, modes[i - 1])
                spots = [spot for node in nodes if (spot := known[node]) is not None]
                turns = [i for i in range(1, len(modes)) if modes[i] != modes[i - 1]]
                return _Way([*spots, last], turns)
        raise self._no_path(f"ways exist between the nodes, but {_REPEATS} of them are blocked between two nodes")

    def _walk(
        self, origin: _Spot, goal: Array, known: dict[Node, _Spot | None], closed: set[tuple[Node, Node]]
    ) -> tuple[list[Node], list[str], _Spot]:
        """Run the mixed search once.

        Returns:
            The nodes of the way, the mode in which each was reached, and the goal.
        """
        root: Node = (0,) * len(goal)
        parent: dict[Node, tuple[Node | None, str]] = {root: (None, "depth")}
        queue: deque[Node] = deque([root])
        cache: dict[Node, list[Node]] = {}
        near = self.step * float(np.sqrt(len(goal))) * 0.75
        while queue:
            head = queue.popleft()
            here = known[head]
            assert here is not None  # only free nodes are queued
            if self._distances(here.value[None, :], goal)[0] <= near:
                _, last = self._edge(here, here.value + self._turn(goal - here.value))
                if last is not None:
                    return *self._trace(head, parent), last
            around = self._neighbours(head, origin, goal, cache)
            open_ = [node for node in around if (head, node) not in closed]
            if not open_ or open_[0] in parent:
                continue  # that way is already taken, from elsewhere
            nearest = open_[0]
            self._judge([(nearest, head)], known, origin)
            if known[nearest] is not None:
                parent[nearest] = (head, "depth")
                queue.appendleft(nearest)
                continue
            # the neighbours of the next heads will be wanted too: judging them together is much cheaper
            ahead = [head, *list(queue)[:_AHEAD]]
            wanted = {n: h for h in reversed(ahead) for n in self._neighbours(h, origin, goal, cache) if n not in known}
            self._judge(list(wanted.items()), known, origin)
            walls = np.array([node for node in around if known[node] is None])
            for node in open_:
                if known[node] is None or node in parent:
                    continue
                if np.any(np.max(np.abs(walls - np.array(node)), axis=1) <= 1):
                    parent[node] = (head, "breadth")
                    queue.append(node)
        raise self._no_path(f"{len(self.explored)} positions are free and {len(self.blocked)} blocked")

    def _neighbours(self, head: Node, origin: _Spot, goal: Array, cache: dict[Node, list[Node]]) -> list[Node]:
        """List the neighbours of a node, the nearest to the goal first."""
        if head not in cache:
            nodes = np.array(head) + self.moves
            distances = self._distances(origin.value + nodes * self.delta, goal)
            cache[head] = [tuple(row) for row in nodes[np.argsort(distances, kind="stable")].tolist()]
        return cache[head]

    def _judge(self, wanted: list[tuple[Node, Node]], known: dict[Node, _Spot | None], origin: _Spot) -> None:
        """Judge nodes, each from a neighbour that is known."""
        wanted = [(node, near) for node, near in wanted if node not in known]
        if not wanted:
            return
        self._spend(len(wanted))
        nears = [spot for _, near in wanted if (spot := known[near]) is not None]
        values = origin.value + np.array([node for node, _ in wanted]) * self.delta
        verdict = self.validity.judge(values, np.array([s.X for s in nears]), np.array([s.T for s in nears]))
        for i, (node, _) in enumerate(wanted):
            if verdict.valid[i]:
                known[node] = _Spot(values[i], verdict.X[i], verdict.T[i])
                self.explored.append(values[i])
            else:
                known[node] = None
                self.blocked.append(values[i])
                self.reasons[verdict.reasons[i]] += 1

    def _trace(self, node: Node | None, parent: dict[Node, tuple[Node | None, str]]) -> tuple[list[Node], list[str]]:
        nodes, modes = [], []
        while node is not None:
            nodes.append(node)
            node, mode = parent[node]
            modes.append(mode)
        return nodes[::-1], modes[::-1]

    def _no_path(self, what: str) -> NoPathError:
        summary = ", ".join(f"{reason} ({count})" for reason, count in self.reasons.most_common(4))
        return NoPathError(
            f"no path at a step of {1e3 * self.step:.3g} mm: {what}; blocked by {summary or 'nothing'}; "
            "move the obstacle, lower the margins, or try a finer step",
            reasons=dict(self.reasons),
            explored=np.array(self.explored),
            blocked=np.array(self.blocked),
            step=self.step,
        )

    def _spend(self, count: int) -> None:
        if self.validity.checks + count > self.max_checks:
            raise BudgetExceededError(
                f"the search judged {self.validity.checks} poses without reaching the goal at a step of "
                f"{1e3 * self.step:.3g} mm; raise max_checks or take a larger step",
                explored=np.array(self.explored),
                blocked=np.array(self.blocked),
            )

    # -- straightening ---------------------------------------------------------------------------------------------

    def _replan(self, way: _Way) -> list[_Spot]:
        """Search again between the start, the spots where the mode changed, and the goal; keep what is shorter."""
        corners = [0, *way.turns, len(way.spots) - 1]
        result = way.spots[:1]
        for i, j in pairwise(corners):
            part = way.spots[i : j + 1]
            _, last = self._edge(part[0], part[-1].value)
            if last is not None:
                part = [part[0], last]
            elif j - i > 3:
                try:
                    again = self._search(part[0], part[-1].value).spots
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
            reason, reached = self._edge(result[-1], spots[best].value)
            if reached is None:
                raise self._no_path(f"a way exists, but one of its edges is blocked by {reason}")
            target = len(spots) - 1
            while target > best:  # look at the farthest first, then halve
                _, seen = self._edge(result[-1], spots[target].value)
                if seen is not None:
                    best, reached = target, seen
                    break
                target = best + (target - best) // 2
            result.append(reached)
            here = best
        return result

    def _free_edges(self, edges: list[tuple[Node, Node]], known: dict[Node, _Spot | None]) -> list[bool]:
        """Check edges between neighbouring free nodes, all at once."""
        ends = [(a, b) for i, j in edges if (a := known[i]) is not None and (b := known[j]) is not None]
        if not ends:
            return []
        count = int(np.ceil(np.sqrt(len(ends[0][0].value)) / self.resolution))
        share = np.arange(1, count) / count
        values = np.array([a.value + t * (b.value - a.value) for a, b in ends for t in share])
        X, T = (np.repeat([getattr(a, k) for a, _ in ends], len(share), axis=0) for k in ("X", "T"))
        self._spend(len(values))
        valid = self.validity.judge(values, X, T).valid.reshape(len(ends), -1)
        return np.all(valid, axis=1).tolist()

    def _detour(self, edge: tuple[Node, Node], known: dict[Node, _Spot | None], origin: _Spot) -> Node | None:
        """Find a node next to both ends of a blocked edge by which one can go round, the shortest way first."""
        a, b = np.array(edge[0]), np.array(edge[1])
        around = a + self.moves
        beside = around[np.max(np.abs(around - b), axis=1) == 1]
        order = np.argsort(np.linalg.norm(beside - a, axis=1) + np.linalg.norm(beside - b, axis=1), kind="stable")
        candidates: list[Node] = [tuple(row) for row in beside[order].tolist()]
        self._judge([(node, edge[0]) for node in candidates], known, origin)
        candidates = [node for node in candidates if known[node] is not None]
        edges = [e for node in candidates for e in ((edge[0], node), (node, edge[1]))]
        free = self._free_edges(edges, known)
        return next((node for i, node in enumerate(candidates) if free[2 * i] and free[2 * i + 1]), None)

    def _edge(self, a: _Spot, b: Array) -> tuple[str, _Spot | None]:
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
            self._spend(len(part))
            starts, tangents = np.tile(here.X, (len(part), 1)), np.tile(here.T, (len(part), 1, 1))
            verdict = self.validity.judge(part, starts, tangents)
            if not np.all(verdict.valid):
                return verdict.reasons[int(np.argmin(verdict.valid))], None
            here = _Spot(part[-1], verdict.X[-1], verdict.T[-1])
        return VALID, here

    def _length(self, spots: list[_Spot]) -> float:
        points = np.array([spot.value for spot in spots])
        return float(np.sum(np.linalg.norm(np.diff(points * self.problem.metric, axis=0), axis=1)))

    def _distances(self, values: Array, goal: Array) -> Array:
        difference = self._turn(goal - values) * self.problem.metric
        return np.sqrt(np.einsum("nm,nm->n", difference, difference))

    def _turn(self, difference: Array) -> Array:
        """Take periodic angles the short way round."""
        if not np.any(self.problem.periodic):
            return difference
        return np.where(self.problem.periodic, (difference + np.pi) % (2 * np.pi) - np.pi, difference)
