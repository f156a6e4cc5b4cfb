"""Refinement: the shortest spline near a seed, kept from obstacles and singularities by barriers and hard bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, RefineError
from paraopt.planning.nlp import Nlp, NlpOptions, Slack, build_nlp, solve_nlp
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Refined:
    """Hold a refined path and how it was reached.

    Attributes:
        path: The path.
        length: Its length in the problem's metric [m].
        iterations: Iterations of IPOPT, over all rounds.
        rounds: Number of optimisations.
        barrier: Weight of the barriers in the last one.
        n_samples: Number of samples at which the constraints were held.
        evaluations: Number of batch evaluations.
    """

    path: Path
    length: float
    iterations: int
    rounds: int
    barrier: float
    n_samples: int
    evaluations: int


@dataclass(frozen=True)
class SplineRefiner(NlpOptions):
    """Refine a seed into a spline of least length.

    `minimise integral |dx/ds|^2 / D^2 + weight * mean over samples of [ -log|det V_a| - log|det V_x| + sum phi(d) ]`

    subject to `d >= clearance`, both singularity margins and the ranges at every sample. D is the seed's length,
    phi(d) = -log(d/h) + d/h - 1 below the horizon h and zero beyond it. The first term is least for the shortest path
    run at constant speed. First derivatives are exact: implicit-function theorem, witness points, and
    d log|det A| = tr(A^-1 dA).

    Attributes:
        rounds: Bound on the optimisations: after each one the path is checked densely, and bounds are tightened where
            it fails between the samples.

    Source: ipopt.
    """

    rounds: int = 6

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rounds < 1:
            raise DefinitionError(f"rounds is {self.rounds}; it must be at least 1")

    def refine(self, problem: Problem, seed: Seed) -> Refined:
        """Refine a seed.

        Args:
            problem: The problem.
            seed: Its seed.

        Returns:
            A path that satisfies every bound on a check ten times denser than its samples, never longer than the seed.

        Raises:
            RefineError: No such path was found; the evidence holds the last path and what it violates.
        """
        options, slack = self, Slack(clearance=self._sag(problem, seed))
        extra = np.arange(0)
        guess: Array | None = None
        iterations = evaluations = 0
        path: Path | None = None
        violation: _Violation | None = None
        for round_ in range(1, self.rounds + 1):
            nlp = build_nlp(problem, seed, options, slack, extra)
            x, stats = solve_nlp(nlp, options, guess)
            iterations += stats["iterations"]
            evaluations += nlp.evaluator.evaluations
            path = self._path(nlp, x)
            violation = _check_densely(problem, path, 10 * len(nlp.samples))
            length = path.length(problem.metric)
            if violation is None and length <= seed.length * (1.0 + 1e-9):
                return Refined(path, length, iterations, round_, options.barrier, len(nlp.samples), evaluations)
            if violation is None:
                if len(seed.points) == 2 and (straight := self._straight(nlp)) is not None:
                    # nothing is shorter than the free straight line; the barriers may only bend it
                    length = straight.length(problem.metric)
                    return Refined(straight, length, iterations, round_, 0.0, len(nlp.samples), evaluations)
                # the barriers pushed it past the seed's length: let them push less
                options = replace(options, barrier=0.1 * options.barrier)
            else:
                slack = violation.tighten(slack)
                extra = np.union1d(extra, violation.pairs)
            guess = x
        what = violation.summary if violation else "the path is longer than the seed"
        raise RefineError(
            f"refinement did not reach a path that holds between its samples in {self.rounds} rounds: {what}; "
            "allow more control points or samples, or smaller margins",
            path=path,
            violation=violation,
            seed=seed,
        )

    def _sag(self, problem: Problem, seed: Seed) -> float:
        """Estimate how far the clearance falls between samples: a chord's sag on a curve as tight as the horizon."""
        if not problem.scene.pairs:
            return 0.0
        n = self.samples_per_control * self.count_controls(seed)
        return (seed.length / n) ** 2 / (8.0 * self.choose_horizon(problem))

    def _straight(self, nlp: Nlp) -> Path | None:
        """Give the straight path if it holds on a dense check."""
        path = self._path(nlp, nlp.initial)
        return path if _check_densely(nlp.problem, path, 10 * len(nlp.samples)) is None else None

    def _path(self, nlp: Nlp, x: Array) -> Path:
        problem = nlp.problem
        spline = nlp.spline(x)
        values = nlp.evaluator(spline(nlp.samples[1:-1]))
        if not values.converged:
            raise RefineError("the closures fail on the refined path", spline=spline)
        X = np.vstack([problem.start_configuration.X, values.X, _solve_goal(problem, values.X[-1], spline(1.0))])
        return Path(problem.robot, problem.independent, spline, nlp.samples, X)


@dataclass(frozen=True, eq=False)
class _Violation:
    """Hold the worst violations of a dense check, zero where there is none."""

    clearance: float
    singularity: float
    range: float
    pairs: NDArray[np.intp]
    summary: str

    def tighten(self, slack: Slack) -> Slack:
        return Slack(
            slack.clearance + 1.3 * self.clearance + (1e-7 if self.clearance else 0.0),
            slack.singularity + 1.3 * self.singularity + (1e-7 if self.singularity else 0.0),
            slack.range + 1.3 * self.range + (1e-9 if self.range else 0.0),
        )


def _solve_goal(problem: Problem, near: Array, values: Array) -> Array:
    """Solve the goal from the last sample, so that angles stay unwrapped along the path."""
    return problem.robot.kinematics.solve_batch(problem.independent, values[None, :], near[None, :]).X[0]


def look_for_closest(
    problem: Problem, path: Path, s: Array, X: Array, parts: int = 10, rounds: int = 6
) -> tuple[Array, NDArray[np.intp]]:
    """Measure the clearance at many points of a path, and between them where it may fall below what is asked.

    A distance falls to an edge in a straight line and rises again: between two points it may be lower than at both by
    as much as the slopes around them let it. There the path is divided again.

    Args:
        problem: The problem.
        path: The path.
        s: Parameters, ascending, shape (n,).
        X: Configurations there, shape (n, n_variables).
        parts: Number of parts of a divided interval.
        rounds: Bound on the divisions.

    Returns:
        Smallest distances [m] and indices of their pairs at all points that were looked at.
    """
    distance, pair = problem.scene.clearances(X)
    if not problem.scene.pairs:
        return distance, pair
    for _ in range(rounds):
        step = np.diff(s)
        slope = np.abs(np.diff(distance)) / step
        steepest = np.maximum(slope, np.maximum(np.append(slope[1:], 0.0), np.append(0.0, slope[:-1])))
        lowest = 0.5 * (distance[:-1] + distance[1:] - steepest * step)
        doubtful = np.flatnonzero((lowest < problem.margins.clearance) & (step > 1e-9))
        if np.min(distance) < problem.margins.clearance or not doubtful.size:
            break
        between = (s[doubtful, None] + step[doubtful, None] * (np.arange(1, parts) / parts)).ravel()
        found, which = problem.scene.clearances(path.solve(between))
        order = np.argsort(np.concatenate([s, between]), kind="stable")
        s = np.concatenate([s, between])[order]
        distance, pair = np.concatenate([distance, found])[order], np.concatenate([pair, which])[order]
    return distance, pair


def _check_densely(problem: Problem, path: Path, count: int) -> _Violation | None:
    """Look for violations at many points of a path; None when there is none."""
    X = path.solve(np.linspace(0.0, 1.0, count + 1))
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    scale = problem.robot.kinematics.graph.variable_scale
    beyond = float(np.max(np.maximum(low - X, X - high) / scale, initial=0.0))
    margins = problem.space.margins(X)
    kept = [margins.parallel] if problem.allow_mode_change else [margins.parallel, margins.serial]
    short = problem.margins.singularity - float(np.min(kept))
    distance, pair = look_for_closest(problem, path, np.linspace(0.0, 1.0, count + 1), X)
    near = problem.margins.clearance - float(np.min(distance))
    if beyond <= 0.0 and short <= 0.0 and near <= 0.0:
        return None
    offending = np.unique(pair[distance < problem.margins.clearance])
    named = ", ".join(problem.scene.pairs[p].name for p in offending)
    summary = (
        f"range exceeded by {max(beyond, 0):.2g} (scaled), singularity margin short by {max(short, 0):.2g}, "
        f"clearance short by {1e3 * max(near, 0):.3g} mm{f' ({named})' if named else ''}"
    )
    return _Violation(max(near, 0.0), max(short, 0.0), max(beyond, 0.0), offending, summary)
