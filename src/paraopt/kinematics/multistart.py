"""All solutions of a block of equations, from starts everywhere, with an estimate of what may have been missed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from paraopt.errors import DefinitionError
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.postures import PostureReader, turn_towards
from paraopt.mechanism import LinkClosure, Mechanism, Series

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SearchOptions:
    """Choose how solutions are searched from many starts.

    Attributes:
        missing_probability: Estimated probability that a solution is missing, below which the search ends [1].
        max_starts: Bound on the number of starts.
        batch: Number of starts of the first round; later rounds are larger.
        iterations: Bound on the Newton iterations of each start.
        step_limit: Largest change of a variable in one iteration, in characteristic lengths or radians.
        tolerance: Bound on the scaled closure residual of a solution [1].
        merge_distance: Postures closer than this are one [1].
        max_solutions: Number of solutions at which the search gives up counting.
        seed: Seed of the low-discrepancy starts.

    Raises:
        DefinitionError: An option is not a positive number, or the probability is not below 1.
    """

    missing_probability: float = 0.05
    max_starts: int = 60_000
    batch: int = 128
    iterations: int = 40
    step_limit: float = 1.0
    tolerance: float = 1e-12
    merge_distance: float = 1e-5
    max_solutions: int = 400
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("missing_probability", "max_starts", "batch", "iterations", "step_limit", "tolerance",
                     "merge_distance", "max_solutions"):  # fmt: skip
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and np.isfinite(value) and value > 0):
                raise DefinitionError(f"{name} of the search is {value!r}; it must be finite and above 0")
        if self.missing_probability >= 1:
            raise DefinitionError(f"missing_probability of the search is {self.missing_probability}; it must be < 1")


@dataclass(frozen=True, eq=False)
class Search:
    """Hold the solutions that were found, and what the hits say about those that were not.

    Every start that converges is a draw from an unknown number of basins. With basins of unknown sizes, all
    distributions of them equally likely beforehand, n draws that hit w different solutions leave

    `P(no further solution) = prod_(i=1..w) (n - 1 - i) / (n - 1 + i)`

    Attributes:
        X: One configuration for each posture found [m or rad], shape (w, n_variables).
        hits: How many starts ended at each, shape (w,).
        starts: Number of starts.
        residual: Smallest scaled residual that any start reached [1].
        is_continuous: Whether so many singular solutions were found that they seem to form a continuum.
        complete: Whether the estimate fell below the bound before the starts ran out.

    Source: BoenderRinnooyKan1987; Good1953.
    """

    X: Array
    hits: NDArray[np.intp]
    starts: int
    residual: float
    is_continuous: bool
    complete: bool

    @property
    def missing_probability(self) -> float:
        """Estimate the probability that some solution was missed [1]; 1 where nothing was found."""
        return estimate_missing(int(self.hits.sum()), len(self.hits))

    @property
    def unseen_mass(self) -> float:
        """Estimate the share of the starts whose solution is unknown: those hit once over all hits (Good-Turing)."""
        return float(np.count_nonzero(self.hits == 1) / max(int(self.hits.sum()), 1))


def estimate_missing(draws: int, found: int) -> float:
    """Estimate the probability that solutions are missing after some draws; see `Search`.

    Args:
        draws: Number n of starts that converged.
        found: Number w of different solutions.

    Returns:
        The probability [1]; 1 where there are too few draws to tell.

    Source: BoenderRinnooyKan1987.
    """
    if found == 0 or draws <= found + 2:
        return 1.0
    i = np.arange(1, found + 1)
    return float(1.0 - np.prod((draws - 1.0 - i) / (draws - 1.0 + i)))


def close_rows(
    kinematics: Kinematics, X: Array, free: Array, rows: Sequence[int] | NDArray[np.intp], options: SearchOptions
) -> tuple[Array, Array]:
    """Solve some rows of the closure equations by damped Newton in the free variables.

    The free variables must enter no other row: those rows then add nothing to the step, and are not judged.

    Args:
        kinematics: The mechanism's functions.
        X: Starts [m or rad], shape (n, n_variables).
        free: 1 for the variables that may move, shape (n_variables,).
        rows: Indices of the rows.
        options: Bounds.

    Returns:
        Final values, and the largest scaled residual of the rows [1], shape (n,).

    Source: Marquardt1963.
    """
    step_of, scale = kinematics.functions.step, kinematics.graph.variable_scale
    rows = np.asarray(rows, dtype=int)
    best, n = np.array(X), len(X)
    residual, damping = np.full(n, np.inf), np.full(n, 1e-8)
    step = np.zeros_like(best)
    active = np.arange(n)
    for iteration in range(options.iterations):
        trial = best[active] + step[active]
        dX, f = step_of.batch(trial, free, damping[active][:, None])
        size = np.max(np.abs(np.atleast_2d(f)[:, rows]), axis=1, initial=0.0)
        better = size < residual[active]
        kept, lost = active[better], active[~better]
        best[kept], residual[kept] = trial[better], size[better]
        damping[kept] = np.maximum(damping[kept] * 0.1, 1e-14)
        length = np.max(np.abs(dX[better]) / scale, axis=1, initial=0.0)
        step[kept] = dX[better] * np.minimum(1.0, options.step_limit / np.maximum(length, 1e-300))[:, None]
        damping[lost] = np.maximum(damping[lost] * 30.0, 1e-8)
        step[lost] *= 0.25
        moving = np.max(np.abs(step[active]) / scale, axis=1, initial=0.0) > 1e-15
        # one more step after the tolerance is met: the last digits cost little
        goes_on = moving & ~(residual[active] <= 1e-3 * options.tolerance)
        if iteration >= 12:  # starts that have hardly closed by now rarely do, and cost as much as new ones
            goes_on &= residual[active] < (1.0 if iteration < 24 else 0.1)
        active = active[goes_on]
        if not active.size:
            break
    return best, residual


def search_solutions(
    kinematics: Kinematics,
    X: Array,
    columns: Sequence[int],
    rows: Sequence[int] | NDArray[np.intp],
    reader: PostureReader,
    options: SearchOptions,
) -> Search:
    """Find all postures that close some rows, the variables outside the columns being imposed.

    Args:
        kinematics: The mechanism's functions.
        X: Imposed values, and values of the others to which solutions should be near; shape (n_variables,).
        columns: Variables to solve for; they enter no row but the given ones.
        rows: Rows to close.
        reader: Tells postures apart.
        options: Bounds.

    Returns:
        The solutions, each with the angles that are nearest to the start; joint ranges are not looked at.
    """
    solved = np.asarray(columns, dtype=int)
    free = np.zeros(len(X))
    free[solved] = 1.0
    low, high = bound_starts(kinematics.mechanism, X, solved)
    sampler = qmc.Sobol(len(solved), rng=np.random.default_rng(options.seed)) if len(solved) else None
    if sampler is not None:
        sampler.fast_forward(1)  # the size of a batch need not be a power of two then
    found = _Found(kinematics, X, reader, options)
    starts, batch, best = 0, options.batch, np.inf
    while starts < options.max_starts:
        count = int(min(batch, options.max_starts - starts))
        here = np.tile(X, (count, 1))
        if sampler is not None:
            here[:, solved] = low + (high - low) * sampler.random(count)
        here[0, solved] = X[solved]  # where one already is
        closed, residual = close_rows(kinematics, here, free, rows, options)
        good = residual <= options.tolerance
        best = min(best, float(np.min(residual, initial=np.inf)))
        found.add(closed[good])
        starts += count
        if len(found.X) > options.max_solutions or found.is_continuous(free, rows):
            return found.conclude(starts, best, True, False)
        if estimate_missing(sum(found.hits), len(found.X)) < options.missing_probability and 1 not in found.hits:
            return found.conclude(starts, best, False, True)
        if sampler is None or (not found.X and starts >= 8 * options.batch):
            break  # nothing closes: the least residual is the evidence
        batch = min(2 * batch, 8192)
    return found.conclude(starts, best, False, sampler is None)


class _Found:
    """Gather solutions by posture; of each keep the values inside the ranges that are nearest to the start."""

    def __init__(self, kinematics: Kinematics, start: Array, reader: PostureReader, options: SearchOptions) -> None:
        self.kinematics, self.start, self.reader, self.options = kinematics, start, reader, options
        ranges = np.array([v.range for v in kinematics.mechanism.variables])
        self.low, self.high = ranges[:, 0] - 1e-9, ranges[:, 1] + 1e-9
        self.X: list[Array] = []
        self.marks: list[Array] = []
        self.hits: list[int] = []

    def add(self, X: Array) -> None:
        if not len(X):
            return
        X = turn_towards(self.kinematics, X, self.start)
        marks = self.reader(X)
        distance = self._cost(X)
        left = np.arange(len(X))
        k = 0
        while left.size:
            if k == len(self.X):
                self.X.append(X[left[0]])
                self.marks.append(marks[left[0]])
                self.hits.append(0)
            same = np.max(np.abs(marks[left] - self.marks[k]), axis=1, initial=0.0) < self.options.merge_distance
            if np.any(same):
                members = left[same]
                self.hits[k] += members.size
                nearest = members[np.argmin(distance[members])]
                if distance[nearest] < self._cost(self.X[k][None])[0] - 1e-9:
                    self.X[k] = X[nearest]
                left = left[~same]
            k += 1

    def _cost(self, X: Array) -> Array:
        """Prefer what is inside the ranges, then what is near to the start."""
        outside = np.sum((self.low > X) | (self.high < X), axis=1)
        away = np.max(np.abs(X - self.start) / self.kinematics.graph.variable_scale, axis=1, initial=0.0)
        return np.asarray(away + 1e6 * outside, dtype=float)

    def is_continuous(self, free: Array, rows: Sequence[int] | NDArray[np.intp]) -> bool:
        """Tell whether most solutions are different, singular ones: the hits fall on a continuum."""
        if len(self.X) < 24 or 2 * len(self.X) < sum(self.hits):
            return False
        (E,) = self.kinematics.functions.scaled_jacobian.batch(np.array(self.X))
        block = E[:, np.asarray(rows, dtype=int)][:, :, free > 0]
        values = np.linalg.svd(block, compute_uv=False)
        singular = (values[:, -1] < 1e-6 * values[:, 0]) | (block.shape[1] < block.shape[2])
        return bool(np.mean(singular) > 0.9)

    def conclude(self, starts: int, residual: float, continuous: bool, complete: bool) -> Search:
        X = np.array(self.X).reshape(len(self.X), len(self.start))
        return Search(X, np.array(self.hits, dtype=int), starts, residual, continuous, complete)


def bound_starts(mechanism: Mechanism, X: Array, columns: NDArray[np.intp]) -> tuple[Array, Array]:
    """Give the box of the starts: ranges of the joints, whole turns, and lengths that the machine can reach.

    Args:
        mechanism: The mechanism.
        X: Imposed values, shape (n_variables,).
        columns: Variables to start.

    Returns:
        Lowest and highest value of each column [m or rad].
    """
    span = _reach(mechanism, X, columns)
    low, high = [], []
    for k in columns:
        variable = mechanism.variables[k]
        # a platform hangs by pulls of a few times its weight
        widest = {"angle": np.pi, "length": span, "force": 2.0 * variable.scale}[variable.kind]
        a, b = variable.range
        low.append(a if np.isfinite(a) else (min(-widest, b - 2 * widest) if np.isfinite(b) else -widest))
        high.append(b if np.isfinite(b) else (max(widest, a + 2 * widest) if np.isfinite(a) else widest))
    # more than a turn says nothing new
    turns = np.array([mechanism.variables[k].kind == "angle" for k in columns], dtype=bool)
    lows, highs = np.array(low, dtype=float), np.array(high, dtype=float)
    wide = turns & (highs - lows > 2 * np.pi)
    return np.where(wide, -np.pi, lows), np.where(wide, np.pi, highs)


def _reach(mechanism: Mechanism, X: Array, columns: NDArray[np.intp]) -> float:
    """Give the largest sum of lengths along the chain from the base to a closure, and on to the origin of its end."""
    solved = {mechanism.names[k] for k in columns}
    links = {link.name: link for link in mechanism.links}

    def stroke(name: str) -> float:
        k = mechanism.index(name)
        low, high = mechanism.variables[k].range
        if name not in solved:
            return abs(float(X[k]))
        return max(abs(low), abs(high)) if np.isfinite(low) and np.isfinite(high) else 2.0 * mechanism.length

    def chain(name: str) -> float:
        total = 0.0
        link = links[name]
        while isinstance(link, Series):
            total += float(np.linalg.norm(link.at)) + sum(stroke(m.name) for m in link.motions if m.kind == "length")
            link = links[link.father]
        return total

    sums = [
        chain(c.link_A) + chain(c.link_B) + sum(float(np.linalg.norm(p)) for p in c.points)
        for c in mechanism.closures
        if isinstance(c, LinkClosure)
    ]
    return max([*sums, mechanism.length])
