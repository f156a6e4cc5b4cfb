"""A probabilistic roadmap in the space of the problem, kept for as many questions as are asked of one scene."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from paraopt.errors import BudgetExceededError, DefinitionError
from paraopt.planning.ground import Ground, Spot
from paraopt.planning.problem import Problem
from paraopt.planning.seed.base import Seed, begin_search, check_options, choose_step, sample_region, try_straight
from paraopt.planning.validity import Validity

Array = NDArray[np.float64]
Edge = tuple[int, int]


@dataclass(frozen=True)
class Roadmap:
    """Search a roadmap: random valid positions, joined by straight motions to their nearest ones.

    `seed` draws a roadmap for one question, and more of it while the ends are not joined. `grow` gives the roadmap
    itself, which answers many questions in the same scene.

    Attributes:
        nodes: Number of positions that are drawn in each round.
        neighbours: Number of nearest positions that each is joined to.
        rounds: How often positions are drawn before the search gives up.
        step: Length in the problem's metric of which `resolution` is a fraction [m]; see `MixedSearch`
            when None.
        resolution: Spacing of the checks along an edge, as a fraction of the step.
        max_checks: Number of poses that may be judged before the search gives up.
        cuts: How often the corners of a way are cut.
        random_seed: Seed of the random numbers.

    Source: Kavraki1996; Lahouar, III.1.
    """

    nodes: int = 300
    neighbours: int = 8
    rounds: int = 5
    step: float | None = None
    resolution: float = 0.2
    max_checks: int = 120000
    cuts: int = 2
    random_seed: int = 0

    def __post_init__(self) -> None:
        check_options(
            nodes=self.nodes, neighbours=self.neighbours, rounds=self.rounds, resolution=self.resolution,
            max_checks=self.max_checks, step=1.0 if self.step is None else self.step,
        )  # fmt: skip
        if self.resolution > 1 or self.cuts < 0:
            raise DefinitionError("resolution must not be above 1, and cuts not negative")

    def grow(self, problem: Problem, rounds: int = 1) -> GrownRoadmap:
        """Draw a roadmap around the start and the goal of a problem.

        Args:
            problem: The problem; its scene, margins and limits are those of the roadmap.
            rounds: How often positions are drawn, near, farther and far around in turn.

        Returns:
            The roadmap: a seeder for all problems that differ in start and goal only.

        Raises:
            InfeasibleError: The start or the goal is not valid, or they lie on different branches.
            BudgetExceededError: The number of checks ran out.
        """
        validity, distance = begin_search(problem)
        ground = self._ground(problem, validity, distance)
        grown = GrownRoadmap(self, problem, (ground.origin,), frozenset())
        for _ in range(rounds):
            grown = grown.extend(ground)
        return grown

    def seed(self, problem: Problem) -> Seed:
        """Find a chain of valid configurations from the start to the goal.

        Args:
            problem: The problem.

        Returns:
            The straightened polyline, with the positions of the roadmap as explored ones.

        Raises:
            InfeasibleError: The start or the goal is not valid, or they lie on different branches.
            BudgetExceededError: The positions do not join the ends, or the number of checks ran out; a roadmap cannot
                prove that there is no way.
        """
        validity, distance = begin_search(problem)
        ground = self._ground(problem, validity, distance)
        step = self._step(problem, distance)
        straight, last = try_straight(ground)
        if last is not None:
            return Seed.along(ground, [ground.origin, last], step=step, straight_reason=straight)
        grown = GrownRoadmap(self, problem, (ground.origin,), frozenset())
        for _ in range(self.rounds):
            grown = grown.extend(ground)
            way = grown.find(ground)
            if way is not None:
                spots = ground.straighten(way, self.cuts)
                return Seed.along(ground, spots, step=step, straight_reason=straight)
        raise grown.not_joined(ground)

    def _step(self, problem: Problem, distance: float) -> float:
        return self.step if self.step is not None else choose_step(problem, distance)

    def _ground(self, problem: Problem, validity: Validity, distance: float) -> Ground:
        spacing = self.resolution * self._step(problem, distance)
        return Ground(problem, validity, spacing, self.max_checks, max(1, round(1.0 / self.resolution)))


@dataclass(frozen=True, eq=False)
class GrownRoadmap:
    """Hold a roadmap, and answer questions with it.

    Attributes:
        options: How it was drawn.
        problem: The problem that it was drawn for.
        spots: Its positions.
        edges: Pairs of positions that a straight motion joins.
        rounds: How often positions were drawn.
    """

    options: Roadmap
    problem: Problem
    spots: tuple[Spot, ...] = field(repr=False)
    edges: frozenset[Edge] = field(repr=False)
    rounds: int = 0

    def seed(self, problem: Problem) -> Seed:
        """Join a start and a goal by the roadmap, without drawing more of it.

        Args:
            problem: A problem in the same scene, with the same margins and limits.

        Returns:
            The straightened polyline.

        Raises:
            DefinitionError: The scene, the margins or the limits are others.
            InfeasibleError: The start or the goal is not valid, or they lie on different branches.
            BudgetExceededError: The positions do not join the ends, or the number of checks ran out.
        """
        mine = self.problem
        for name in ("scene", "margins", "bounds", "allow_mode_change", "turns"):
            if getattr(problem, name) is not getattr(mine, name) and getattr(problem, name) != getattr(mine, name):
                raise DefinitionError(f"the roadmap was drawn for another {name.replace('_', ' ')}; draw one for this")
        validity, distance = begin_search(problem)
        kept = validity.signs
        if kept != Validity(mine).signs:
            raise DefinitionError("the roadmap was drawn on another branch; draw one from this start")
        ground = self.options._ground(problem, validity, distance)
        step = self.options._step(problem, distance)
        straight, last = try_straight(ground)
        if last is not None:
            return Seed.along(ground, [ground.origin, last], step=step, straight_reason=straight)
        way = self.find(ground)
        if way is None:
            raise self.not_joined(ground)
        return Seed.along(ground, ground.straighten(way, self.options.cuts), step=step, straight_reason=straight)

    def extend(self, ground: Ground) -> GrownRoadmap:
        """Draw more positions and join them to their nearest ones."""
        options, problem = self.options, self.problem
        random = np.random.default_rng((options.random_seed, self.rounds))
        # near, farther and far in turn
        reach = 5.0 * ground.spacing * ground.block * 2.0 ** (self.rounds % 3)
        spots = list(self.spots)
        for part in np.array_split(sample_region(problem, random, options.nodes, reach), max(1, options.nodes // 60)):
            known = np.array([s.value for s in spots])
            nears = [spots[int(np.argmin(self._distances(known, value)))] for value in part]
            found, reasons = ground.place(part, nears)
            for value, spot, reason in zip(part, found, reasons, strict=True):
                (ground.blocked if spot is None else ground.explored).append(value)
                if spot is None:
                    ground.reasons[reason] += 1
                else:
                    spots.append(spot)
        fresh = self._near_edges(spots, range(len(self.spots), len(spots)))
        wanted = [e for e in fresh if e not in self.edges]
        free = ground.lines([(spots[i], spots[j]) for i, j in wanted])
        edges = self.edges | {e for e, good in zip(wanted, free, strict=True) if good}
        return GrownRoadmap(options, problem, tuple(spots), edges, self.rounds + 1)

    def find(self, ground: Ground, repeats: int = 30) -> list[Spot] | None:
        """Find the shortest way over the roadmap from the start to the goal of a ground's problem.

        Args:
            ground: Where the motions to and from the roadmap are checked.
            repeats: How often an edge may turn out to be blocked between its positions.

        Returns:
            Its spots, angles unwrapped; None where the roadmap does not join the ends.
        """
        problem = ground.problem
        spots = [*self.spots, ground.origin, ground.goal]
        n = len(spots)
        edges = set(self.edges)
        wanted = self._near_edges(spots, range(n - 2, n))
        edges |= {
            e for e, good in zip(wanted, ground.lines([(spots[i], spots[j]) for i, j in wanted]), strict=True) if good
        }
        values = np.array([s.value for s in spots])
        for _ in range(repeats):
            if not edges:
                return None
            i, j = np.array(sorted(edges)).T
            lengths = np.linalg.norm(problem.turn(values[j] - values[i]) * problem.metric, axis=1)
            graph = coo_array((np.maximum(lengths, 1e-12), (i, j)), shape=(n, n)).tocsr()
            total, before = dijkstra(graph, directed=False, indices=n - 2, return_predecessors=True)
            if not np.isfinite(total[n - 1]):
                return None
            nodes = [n - 1]
            while nodes[-1] != n - 2:
                nodes.append(int(before[nodes[-1]]))
            nodes.reverse()
            points, here = list[Array](), ground.origin.value
            for node in nodes[1:]:
                here = ground.unwrap(here, values[node])
                points.append(here)
            result = ground.walk(ground.origin, points)
            if isinstance(result, list):
                return result if ground.is_goal(result[-1]) else None
            edges -= {(nodes[result[0]], nodes[result[0] + 1]), (nodes[result[0] + 1], nodes[result[0]])}
        return None

    def not_joined(self, ground: Ground) -> BudgetExceededError:
        """Build the error that says how much was drawn."""
        summary = ", ".join(f"{reason} ({count})" for reason, count in ground.reasons.most_common(4))
        return BudgetExceededError(
            f"the {len(self.spots)} positions of the roadmap ({len(self.edges)} motions between them) do not join start"
            f" and goal; drawn positions were blocked by {summary or 'nothing'}; draw more, or try another seeder",
            roadmap=self,
            reasons=dict(ground.reasons),
            checks=ground.validity.checks,
        )

    def _distances(self, values: Array, value: Array) -> Array:
        return np.linalg.norm(self.problem.turn(values - value) * self.problem.metric, axis=1)

    def _near_edges(self, spots: list[Spot], chosen: range) -> list[Edge]:
        """List pairs of chosen spots and their nearest ones."""
        values = np.array([s.value for s in spots])
        edges: dict[Edge, None] = {}
        for i in chosen:
            order = np.argsort(self._distances(values, values[i]), kind="stable")
            for j in [int(j) for j in order if j != i][: self.options.neighbours]:
                edges[min(i, j), max(i, j)] = None
        return list(edges)
