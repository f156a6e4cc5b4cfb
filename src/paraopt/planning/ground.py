"""What seeders walk on: positions and straight lines of one problem, judged in batches, counted and remembered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BudgetExceededError
from paraopt.kinematics import Configuration
from paraopt.planning.problem import Problem
from paraopt.planning.validity import VALID, Validity, compare_configurations

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Spot:
    """Hold a valid position.

    Attributes:
        value: Independent coordinates, shape (m,).
        X: Closed configuration, shape (n_variables,).
        T: Motions `dX / d independent`, shape (n_variables, m).
    """

    value: Array
    X: Array
    T: Array


class Ground:
    """Judge positions and lines of a problem, within a budget.

    Args:
        problem: The problem.
        validity: Its judge, whose count of checks the budget bounds.
        spacing: Largest distance between checked positions of a line, in the problem's metric [m].
        max_checks: Number of poses that may be judged.
        block: Number of positions of a line that are judged together; all of them start from the position before.
    """

    def __init__(self, problem: Problem, validity: Validity, spacing: float, max_checks: int, block: int = 5) -> None:
        self.problem, self.validity = problem, validity
        self.spacing, self.max_checks, self.block = spacing, max_checks, block
        self.reasons: Counter[str] = Counter()
        self.explored: list[Array] = []
        self.blocked: list[Array] = []

    @property
    def origin(self) -> Spot:
        """Give the start."""
        X = self.problem.start_configuration.X
        return Spot(X[self.problem.index], X, self.problem.space.tangent(X)[0])

    @property
    def goal(self) -> Spot:
        """Give the goal, its periodic angles within half a turn of the start."""
        X = self.problem.goal_configuration.X.copy()
        X[self.problem.index] = self.problem.goal_values()  # full turns leave the loops closed
        return Spot(X[self.problem.index], X, self.problem.space.tangent(X)[0])

    # -- positions -------------------------------------------------------------------------------------------------

    def judge(
        self, values: Array, nears: Sequence[Spot], record: bool = False
    ) -> tuple[list[Spot | None], tuple[str, ...]]:
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
                f"the search judged {self.validity.checks} poses without reaching the goal (positions checked every "
                f"{1e3 * self.spacing:.3g} mm); raise max_checks or take a larger step",
                explored=np.array(self.explored),
                blocked=np.array(self.blocked),
                reasons=dict(self.reasons),
                checks=self.validity.checks,
            )
        verdict = self.validity.judge(values, np.array([s.X for s in nears]), np.array([s.T for s in nears]))
        if record:
            for value, valid, reason in zip(values, verdict.valid, verdict.reasons, strict=True):
                (self.explored if valid else self.blocked).append(value)
                if not valid:
                    self.reasons[reason] += 1
        spots = [
            Spot(v, X, T) if ok else None
            for v, X, T, ok in zip(values, verdict.X, verdict.T, verdict.valid, strict=True)
        ]
        return spots, verdict.reasons

    def distances(self, values: Array, goal: Array) -> Array:
        """Measure distances to a position, periodic angles the short way round [m]; shape (n,)."""
        difference = self.problem.turn(goal - values) * self.problem.metric
        return np.sqrt(np.einsum("nm,nm->n", difference, difference))

    def toward(self, here: Array, goal: Array) -> Array:
        """Give the nearest of the positions that differ from a goal by full turns, within the bound on turns."""
        low, high = self.problem.turn_bounds
        near = self.unwrap(here, goal)
        inside = np.where(near > high, near - 2 * np.pi, np.where(near < low, near + 2 * np.pi, near))
        return np.where(self.problem.periodic, inside, goal)

    def unwrap(self, here: Array, value: Array) -> Array:
        """Move periodic coordinates of a position by full turns, to be nearest to another one."""
        turns = np.where(self.problem.periodic, np.round((here - value) / (2 * np.pi)), 0.0)
        return value + 2 * np.pi * turns

    def is_goal(self, spot: Spot) -> bool:
        """Tell whether a spot at the goal's coordinates is the goal, and not another solution there."""
        if not (isinstance(self.problem.goal, Configuration) or self.problem.allow_mode_change):
            return True  # a pose, on whatever branch the motion reaches
        return compare_configurations(self.problem, spot.X, self.problem.goal_configuration.X)[1] <= 1e-6

    # -- lines -----------------------------------------------------------------------------------------------------

    def edge(self, a: Spot, b: Array, fine: bool = True) -> tuple[str, Spot | None]:
        """Check a straight line from its beginning on.

        Args:
            a: The spot where it begins.
            b: Where it ends.
            fine: Whether to look between the positions, too, where a bound may be crossed there.

        Returns:
            What blocks it first and None, or "valid" and the spot at its end.
        """
        chain, reason, _ = self.advance(a, b)
        if reason == VALID and fine:
            reason = self.look_between([chain])[0]
        return (VALID, chain[-1]) if reason == VALID else (reason, None)

    def advance(self, a: Spot, b: Array) -> tuple[list[Spot], str, Array | None]:
        """Go along a straight line as far as it is valid.

        Args:
            a: The spot where it begins.
            b: Where it ends.

        Returns:
            The spots from its beginning on; what blocks the next position, or "valid" when the end is reached; and that
            position, or None.
        """
        count = max(4, int(np.ceil(self.length(np.array([a.value, b])) / self.spacing)))
        values = a.value + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a.value)
        values[-1] = b
        chain = [a]
        for i in range(0, count, self.block):
            part = values[i : i + self.block]
            spots, reasons = self.judge(part, [chain[-1]] * len(part))
            for value, spot, reason in zip(part, spots, reasons, strict=True):
                if spot is None:
                    return chain, reason, value
                chain.append(spot)
        return chain, VALID, None

    def lines(self, ends: Sequence[tuple[Spot, Spot]]) -> list[bool]:
        """Check many lines between known spots, all at once; an end that is reached on another branch does not count.

        Periodic angles go the short way round.
        """
        if not ends:
            return []
        starts = np.array([a.value for a, _ in ends])
        moves = self.problem.turn(np.array([b.value for _, b in ends]) - starts)
        lengths = np.linalg.norm(moves * self.problem.metric, axis=1)
        counts = np.maximum(2, np.ceil(lengths / self.spacing).astype(int))
        here = [a for a, _ in ends]
        free = np.ones(len(ends), dtype=bool)
        for first in range(0, int(np.max(counts, initial=0)), self.block):
            wanted = [
                (i, k)
                for i in np.flatnonzero(free).tolist()
                for k in range(first + 1, min(first + self.block, counts[i]) + 1)
            ]
            if not wanted:
                break
            values = np.array([starts[i] + moves[i] * (k / counts[i]) for i, k in wanted])
            spots, _ = self.judge(values, [here[i] for i, _ in wanted])
            for (i, _), spot in zip(wanted, spots, strict=True):
                free[i] &= spot is not None
                here[i] = spot or here[i]
        for i in np.flatnonzero(free).tolist():
            free[i] = self.is_same(here[i], ends[i][1])
        return free.tolist()

    def is_same(self, a: Spot, b: Spot) -> bool:
        """Tell whether two spots are one configuration, full turns left out."""
        return compare_configurations(self.problem, a.X, b.X)[1] <= 1e-6

    def place(self, values: Array, nears: Sequence[Spot]) -> tuple[list[Spot | None], tuple[str, ...]]:
        """Judge positions far from known spots: walk there in steps, whatever lies between.

        Args:
            values: Positions, shape (n, m).
            nears: A known spot for each, the nearer the better.

        Returns:
            The spots, None where blocked, and the reasons.
        """
        space, index = self.problem.space, self.problem.index
        X = np.array([s.X for s in nears])
        T = np.array([s.T for s in nears])
        first = np.array([s.value for s in nears])
        move = self.problem.turn(values - first)
        far = np.max(np.linalg.norm(move * self.problem.metric, axis=1), initial=0.0)
        steps = max(1, int(np.ceil(far / (0.25 * self.problem.robot.mechanism.length))))
        for k in range(1, steps):
            there = first + move * (k / steps)
            predicted = X + np.einsum("nvm,nm->nv", T, there - X[:, index])
            closed = space.solve(there, predicted)
            X = np.where(closed.converged[:, None], closed.X, X)  # the others are tried again from where they stopped
            T = space.tangent(X)
        there = first + move
        waiting = [Spot(x[index], x, t) for x, t in zip(X, T, strict=True)]
        return self.judge(there, waiting)

    def short_edges(self, ends: Sequence[tuple[Spot, Spot]], count: int, fine: bool) -> list[bool]:
        """Check short lines between known spots all together, each from its beginning."""
        if not ends:
            return []
        share = np.arange(1, count) / count
        values = np.array([a.value + t * (b.value - a.value) for a, b in ends for t in share])
        spots, _ = self.judge(values, [a for a, _ in ends for _ in share])
        k = count - 1
        inner = [spots[i * k : (i + 1) * k] for i in range(len(ends))]
        free = [all(spot is not None for spot in part) for part in inner]
        chains = [
            [a, *(spot for spot in part if spot is not None), b]
            for (a, b), part, good in zip(ends, inner, free, strict=True)
            if good
        ]
        if fine and chains:
            held = iter(self.look_between(chains))
            free = [good and next(held) == VALID for good in free]
        return free

    def look_between(
        self, chains: Sequence[Sequence[Spot]], parts: int = 4, rounds: int = 3, caution: float = 1.5
    ) -> list[str]:
        """Look between the positions of checked lines, where the slopes around let a bound be crossed.

        A distance or margin falls and rises again: between two positions it may be lower than at both by as much as its
        slopes around them let it. There the line is divided; what stays doubtful after the last round is refused.

        Args:
            chains: Spots along each line.
            parts: Number of parts of a divided interval.
            rounds: Number of divisions.
            caution: Factor by which a quantity may fall more steeply than any slope around shows.

        Returns:
            For each line "valid", or what may be wrong.
        """
        verdicts = [VALID] * len(chains)
        line = np.concatenate([np.full(len(chain), i) for i, chain in enumerate(chains)])
        place = np.concatenate([np.linspace(0.0, 1.0, len(chain)) for chain in chains])
        spots = [spot for chain in chains for spot in chain]
        levels = self._levels(spots)
        for round_ in range(rounds + 1):
            inside = line[1:] == line[:-1]
            step = np.where(inside, np.diff(place), 1.0)[:, None]
            slope = np.where(inside[:, None], np.abs(np.diff(levels, axis=0)) / step, 0.0)
            steepest = slope.copy()
            steepest[:-1] = np.maximum(steepest[:-1], slope[1:])
            steepest[1:] = np.maximum(steepest[1:], slope[:-1])
            lowest = 0.5 * (levels[:-1] + levels[1:] - caution * steepest * step)
            alive = np.array([verdicts[i] == VALID for i in line[:-1]])
            doubtful = np.flatnonzero(inside & alive & (np.min(lowest, axis=1) < -1e-12))
            if not doubtful.size:
                break
            if round_ == rounds:
                for i in doubtful:
                    verdicts[line[i]] = self.validity.level_names[int(np.argmin(lowest[i]))]
                break
            share = np.arange(1, parts) / parts
            values = np.array(
                [spots[i].value + t * (spots[i + 1].value - spots[i].value) for i in doubtful for t in share]
            )
            found, reasons = self.judge(values, [spots[i] for i in doubtful for _ in share])
            owner = np.repeat(line[doubtful], parts - 1)
            where = (place[doubtful, None] + share * (place[doubtful + 1] - place[doubtful])[:, None]).ravel()
            for i, spot, reason in zip(owner, found, reasons, strict=True):
                if spot is None and verdicts[i] == VALID:
                    verdicts[i] = reason
            good = [k for k, spot in enumerate(found) if spot is not None]
            if not good:
                break
            fresh = [spot for spot in found if spot is not None]
            spots = [*spots, *fresh]
            line, place = np.concatenate([line, owner[good]]), np.concatenate([place, where[good]])
            levels = np.vstack([levels, self._levels(fresh)])
            order = np.lexsort((place, line))
            spots, line, place, levels = [spots[k] for k in order], line[order], place[order], levels[order]
        return verdicts

    def _levels(self, spots: Sequence[Spot]) -> Array:
        return self.validity.levels(np.array([s.X for s in spots]), np.array([s.T for s in spots]))

    # -- polylines -------------------------------------------------------------------------------------------------

    def length(self, points: Array) -> float:
        """Measure a polyline in the problem's metric [m]."""
        return float(np.sum(np.linalg.norm(np.diff(points * self.problem.metric, axis=0), axis=1)))

    def length_of(self, spots: Sequence[Spot]) -> float:
        """Measure a polyline through spots in the problem's metric [m]."""
        return self.length(np.array([spot.value for spot in spots]))

    def walk(self, origin: Spot, points: Sequence[Array]) -> list[Spot] | tuple[int, str]:
        """Check a polyline edge by edge.

        Args:
            origin: The spot where it begins.
            points: The other corners.

        Returns:
            Its spots; or the index of the first blocked edge, and what blocks it.
        """
        spots = [origin]
        for i, point in enumerate(points):
            reason, spot = self.edge(spots[-1], point)
            if spot is None:
                return i, reason
            spots.append(spot)
        return spots

    def straighten(self, spots: list[Spot], cuts: int = 2) -> list[Spot]:
        """Shorten a valid polyline: drop corners, and cut those that stay; stop where the budget ends.

        Args:
            spots: Its corners; every edge is valid.
            cuts: How often all corners are cut.

        Returns:
            A valid polyline between the same ends, never longer.
        """
        best = spots
        try:
            best = self._drop_corners(best)
            for _ in range(cuts):
                cut = self._cut_corners(best)
                if cut is None:
                    break
                best = self._drop_corners(cut)
        except BudgetExceededError:
            return best  # a way is known: what could not be shortened any more stays
        return best

    def _drop_corners(self, spots: list[Spot]) -> list[Spot]:
        """Replace runs of corners by straight lines wherever these are valid: the farthest first, then by halves."""
        result, here = [spots[0]], 0
        while here < len(spots) - 1:
            best, reached = here + 1, None
            target = len(spots) - 1
            while target > here + 1:
                _, seen = self.edge(result[-1], spots[target].value)
                # a straight motion may end in another solution of the same coordinates
                if seen is not None and self.is_same(seen, spots[target]):
                    best, reached = target, seen
                    break
                target = here + 1 + (target - here - 1) // 2
            if reached is None:
                _, reached = self.edge(result[-1], spots[best].value)
            if reached is None:  # known to be free from a spot a little aside: keep what was known
                return spots
            result.append(reached)
            here = best
        return result if self.length_of(result) <= self.length_of(spots) + 1e-12 else spots

    def _cut_corners(self, spots: list[Spot], gain: float = 0.005) -> list[Spot] | None:
        """Replace each corner by a line between its edges, as deep as is valid; None when little is won."""
        points = [spot.value for spot in spots]
        result, i = [spots[0]], 1
        while i < len(points) - 1:
            here, corner, beyond = result[-1], points[i], points[i + 1]
            for share in (1.0, 0.5, 0.25):
                near = corner + share * 0.5 * (here.value - corner)
                far = corner + share * 0.5 * (beyond - corner)
                first = self.edge(here, near)[1]
                second = first and self.edge(first, far)[1]
                if first is not None and second is not None and self.edge(second, beyond)[1] is not None:
                    result += [first, second]
                    break
            else:
                kept = self.edge(here, corner)[1]
                if kept is None:
                    return None
                result.append(kept)
            i += 1
        last = self.edge(result[-1], points[-1])[1]
        if last is None:
            return None
        result.append(last)
        if not self.is_same(last, spots[-1]):
            return None
        return result if self.length_of(result) < (1.0 - gain) * self.length_of(spots) else None
