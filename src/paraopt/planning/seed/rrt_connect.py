"""RRT-Connect: two random trees, from the start and from the goal, that grow towards each other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.planning.ground import Ground, Spot
from paraopt.planning.problem import Problem
from paraopt.planning.seed.base import (
    Seed,
    begin_search,
    check_options,
    choose_step,
    sample_region,
    try_straight,
)
from paraopt.planning.validity import VALID

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RRTConnect:
    """Search with two random trees; for many coordinates, where a grid has too many neighbours.

    Each tree knows its configurations, not only its positions: two solutions of one position are never taken for one.
    Periodic angles are treated on the circle. The same problem gives the same seed.

    Attributes:
        step: Longest edge of the trees in the problem's metric [m]; see `MixedSearch` when None.
        resolution: Spacing of the checks along an edge, as a fraction of the step.
        max_checks: Number of poses that may be judged before the search gives up.
        cuts: How often the corners of the way are cut.
        random_seed: Seed of the random numbers.

    Source: Kuffner2000.
    """

    step: float | None = None
    resolution: float = 0.2
    max_checks: int = 60000
    cuts: int = 2
    random_seed: int = 0

    def __post_init__(self) -> None:
        check_options(
            step=1.0 if self.step is None else self.step, resolution=self.resolution, max_checks=self.max_checks
        )
        if self.resolution > 1 or self.cuts < 0:
            raise DefinitionError("resolution must not be above 1, and cuts not negative")

    def seed(self, problem: Problem) -> Seed:
        """Find a chain of valid configurations from the start to the goal.

        Args:
            problem: The problem.

        Returns:
            The straightened polyline, with the nodes of both trees as explored positions.

        Raises:
            InfeasibleError: The start or the goal is not valid, or they lie on different branches.
            BudgetExceededError: The number of checks ran out; random trees cannot prove that there is no way.
        """
        validity, distance = begin_search(problem)
        step = self.step if self.step is not None else choose_step(problem, distance)
        block = max(1, round(1.0 / self.resolution))
        ground = Ground(problem, validity, self.resolution * step, self.max_checks, block)
        straight, last = try_straight(ground)
        if last is not None:
            return Seed.along(ground, [ground.origin, last], step=step, straight_reason=straight)
        spots = self._join(ground, step)
        return Seed.along(ground, ground.straighten(spots, self.cuts), step=step, straight_reason=straight)

    def _join(self, ground: Ground, step: float) -> list[Spot]:
        """Grow both trees until they meet on a way that holds between its positions, too."""
        problem, random = ground.problem, np.random.default_rng(self.random_seed)
        trees = (_Tree(ground, ground.origin, step), _Tree(ground, ground.goal, step))
        for turn in count():  # the budget ends it
            grown, other = trees[turn % 2], trees[1 - turn % 2]
            reach = step * (4.0, 8.0, 16.0)[turn // 2 % 3]  # near, farther and far in turn
            (target,) = sample_region(problem, random, 1, reach)
            node = grown.extend(target, greedy=False)
            if node is None:
                continue
            met = other.extend(grown.spots[node].value, greedy=True)
            if met is None or not ground.is_same(other.spots[met], grown.spots[node]):
                continue
            ends = (node, met) if turn % 2 == 0 else (met, node)
            way = self._walk(ground, trees, ends)
            if way is not None:
                return way
        raise AssertionError("the loop returns or raises")

    def _walk(self, ground: Ground, trees: tuple[_Tree, _Tree], ends: tuple[int, int]) -> list[Spot] | None:
        """Walk the whole way from the start, so that angles are unwrapped; cut off what does not hold."""
        forth, back = trees[0].trace(ends[0]), trees[1].trace(ends[1])
        nodes = [(trees[0], n) for n in forth[1:]] + [(trees[1], n) for n in back[::-1][1:]]
        points, here = list[Array](), ground.origin.value
        for tree, node in nodes:
            here = ground.unwrap(here, tree.spots[node].value)
            points.append(here)
        low, high = ground.problem.turn_bounds
        result = ground.walk(ground.origin, points)
        if isinstance(result, list):
            good = all(np.all((low <= s.value) & (s.value <= high)) for s in result) and ground.is_goal(result[-1])
            return result if good else None
        at, _ = result
        # edge number `at` leads to a node of the first tree, or from one of the second
        if at < len(forth) - 1:
            trees[0].cut(forth[at + 1])
        else:
            trees[1].cut(back[::-1][at - len(forth) + 1])
        return None


class _Tree:
    """Hold a tree of spots."""

    def __init__(self, ground: Ground, root: Spot, step: float) -> None:
        self.ground, self.step = ground, step
        self.spots: list[Spot] = []
        self.parents: list[int] = []
        self._values = np.zeros((64, len(root.value)))
        self._alive = np.zeros(64, dtype=bool)
        self._add(root, -1)

    def extend(self, target: Array, greedy: bool) -> int | None:
        """Grow towards a position by one step, or as far as it is valid when greedy.

        Returns:
            The node that was reached, None where nothing was added; when greedy, None unless the target was reached.
        """
        problem, size = self.ground.problem, len(self.spots)
        moves = problem.turn(target - self._values[:size])
        distances = np.linalg.norm(moves * problem.metric, axis=1)
        nearest = int(np.argmin(np.where(self._alive[:size], distances, np.inf)))
        distance = float(distances[nearest])
        if distance < 1e-12:
            return nearest if greedy else None
        share = 1.0 if greedy else min(1.0, self.step / distance)
        here = self.spots[nearest]
        chain, reason, blocked = self.ground.advance(here, here.value + share * moves[nearest])
        if blocked is not None:
            self.ground.blocked.append(blocked)
            self.ground.reasons[reason] += 1
        every, node = self.ground.block, nearest
        for k in [*range(every, len(chain) - 1, every), len(chain) - 1]:
            if k > 0:
                node = self._add(chain[k], node)
        return node if node != nearest and (reason == VALID or not greedy) else None

    def trace(self, node: int) -> list[int]:
        """List the nodes from the root to a node."""
        nodes = []
        while node >= 0:
            nodes.append(node)
            node = self.parents[node]
        return nodes[::-1]

    def cut(self, node: int) -> None:
        """Take a node and all that grew from it out of the search."""
        self._alive[node] = False
        for child in range(node + 1, len(self.spots)):  # parents come before their children
            if not self._alive[self.parents[child]]:
                self._alive[child] = False

    def _add(self, spot: Spot, parent: int) -> int:
        size = len(self.spots)
        if size == len(self._values):
            self._values = np.vstack([self._values, np.zeros_like(self._values)])
            self._alive = np.concatenate([self._alive, np.zeros_like(self._alive)])
        self._values[size], self._alive[size] = spot.value, True
        self.spots.append(spot)
        self.parents.append(parent)
        if parent >= 0:
            self.ground.explored.append(spot.value)
        return size
