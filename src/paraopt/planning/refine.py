"""Refinement: the best spline near a seed, kept from obstacles and singularities by barriers and hard bounds."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from paraopt.errors import DefinitionError, ParaoptError, RefineError, SolveError
from paraopt.planning.nlp import Nlp, NlpOptions, Slack, build_nlp, solve_nlp
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.refine_check import Violation, check_configurations, check_densely
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Refined:
    """Hold a refined path and how it was reached.

    Attributes:
        path: The path.
        length: Its length in the problem's metric [m].
        iterations: Iterations of the solver, over all rounds.
        rounds: Number of optimisations.
        barrier: Weight of the barriers in the last one.
        n_samples: Number of samples at which the constraints were held.
        evaluations: Number of batch evaluations.
        objective: Last value of the objective [1].
        pairs: Pairs of bodies that were held apart.
        multipliers: Those of the constraints at the end; they make a fresh start short.
        duration: Duration under the limits of the drives [s], where it was made small; else nan.
        speeds: Parameters and squared path speeds there [1/s^2], where they are known.
        slack: What was added to the margins at the samples so that they hold between them.
    """

    path: Path
    length: float
    iterations: int
    rounds: int
    barrier: float
    n_samples: int
    evaluations: int
    objective: float = 0.0
    pairs: NDArray[np.intp] = field(default_factory=lambda: np.arange(0), repr=False)
    multipliers: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    duration: float = np.nan
    speeds: tuple[Array, Array] | None = field(default=None, repr=False)
    slack: Slack | None = field(default=None, repr=False)


@dataclass(frozen=True)
class SplineRefiner(NlpOptions):
    """Refine a seed into the best spline near it.

    `minimise integral |dx/ds|^2 / D^2 + ... + weight * mean over samples of [ -log|det V_a| - log|det V_x| + sum phi ]`

    subject to `d >= clearance`, both singularity margins, the ranges and the user's own constraints at every sample. D
    is the seed's length, phi(d) = -log(d/h) + d/h - 1 below the horizon h and zero beyond it, of distances and of the
    ways to the ends of ranges. The first term is least for the shortest path run at constant speed; `objective` weighs
    it against others. First derivatives are exact: implicit-function theorem, witness points, and
    d log|det A| = tr(A^-1 dA).

    Attributes:
        rounds: Bound on the optimisations: after each one the path is checked densely. Where it fails between the
            samples, a knot and samples are added, and more is asked of the samples beside. Up to two more follow where
            the seed suggested other shares of the length for waypoints than the path gives them.

    Source: ipopt; osqp.
    """

    rounds: int = 6

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rounds < 1:
            raise DefinitionError(f"rounds is {self.rounds}; it must be at least 1")

    def refine(self, problem: Problem, seed: Seed, warm: Refined | None = None) -> Refined:
        """Refine a seed.

        Args:
            problem: The problem.
            seed: Its seed.
            warm: What was found for a problem that differs little, such as in the place of an obstacle or in a margin;
                it is where the search begins, at a fraction of the cost.

        Returns:
            A path that satisfies every bound on a check ten times denser than its samples; where only the length counts
            and nothing else shapes the path, it is never longer than the seed.

        Raises:
            RefineError: No such path was found. Evidence: the best iterate as "path" (unless the loops do not close
                along it) and its "shortfalls": which constraint, where, by how much; or the "violation" between
                samples.
        """
        self._check_ends(problem, seed)
        state = self._begin(problem, seed, warm)
        options: SplineRefiner = self if warm is None else replace(self, barrier=self.final_barrier)
        iterations = evaluations = evened = 0
        violation: Violation | None = None
        worst: list[float] = []
        round_ = 0
        while round_ < self.rounds + evened:
            round_ += 1
            nlp = state.build(problem, seed, options)
            x, stats = self._solve(nlp, options, state, seed)
            iterations += stats["iterations"]
            evaluations += nlp.evaluator.evaluations
            path = _follow(nlp, x)
            try:
                violation = check_densely(problem, path, 10 * len(nlp.samples), self.constraints)
            except SolveError as error:  # the closures hold at the samples, but not between them
                if round_ == self.rounds + evened:
                    raise RefineError(
                        f"the path leaves the reachable space between its samples: {error}; allow more samples, or "
                        "loosen what drives it there",
                        path=path,
                        seed=seed,
                        s=error.evidence.get("s"),
                    ) from error
                state = state.restart(nlp)
                continue
            if evened < 2 and (even := state.even_out(nlp, path, violation)) is not None:
                evened, state, options = evened + 1, even, replace(options, barrier=options.final_barrier)
                continue
            worst.append(0.0 if violation is None else violation.size(nlp.evaluation.barriers.horizon))
            if len(worst) > 1 and worst[-1] > max(0.7 * worst[-2], 0.2):
                break  # one more sample did not help
            length = path.length(problem.metric)
            is_longer = warm is None and self._is_plain and length > seed.length * (1.0 + 1e-9)
            if violation is None and not is_longer:
                return Refined(
                    path, length, iterations, round_, stats["weight"], len(nlp.samples), evaluations,
                    stats["objective"], nlp.evaluator.pairs, stats["multipliers"], speeds=nlp.speeds(x),
                    slack=state.slack,
                )  # fmt: skip
            if violation is None:
                if len(seed.points) == 2 and (straight := self._straight(nlp)) is not None:
                    # nothing is shorter than the free straight line; the barriers may only bend it
                    length = straight.length(problem.metric)
                    return Refined(straight, length, iterations, round_, 0.0, len(nlp.samples), evaluations)
                # the barriers pushed it past the seed's length: let them push less
                weight = 0.1 * stats["weight"]
                options = replace(options, barrier=weight, final_barrier=weight)
                state = replace(state, near=path.spline, near_X=path.anchor_X[1:-1], speeds=nlp.speeds(x))
            else:
                options = replace(options, barrier=options.final_barrier)
                state = replace(state.densify(nlp, path, violation, stats["multipliers"]), speeds=nlp.speeds(x))
        what = violation.summary if violation else "the path is longer than the seed"
        if len(worst) > 1 and worst[-1] > 0.2:
            what += " (from one sample to the next it leaps over what is in its way: perhaps no path can hold)"
        raise RefineError(
            f"refinement did not reach a path that holds between its samples in {round_} rounds: {what}; "
            "allow more control points or samples, or smaller margins",
            path=path,
            violation=violation,
            seed=seed,
        )

    @property
    def _is_plain(self) -> bool:
        """Tell whether nothing but the length shapes the path: the seed is then a bound."""
        return self.objective.is_length and not (self.rest or self.waypoints or self.tool_paths or self.constraints)

    def _check_ends(self, problem: Problem, seed: Seed) -> None:
        """Refuse ends that break a bound: no path can cure that."""
        X = np.array([problem.start_configuration.X, problem.goal_configuration.X])
        for label, at in (("start", 0), ("goal", 1)):
            broken = check_configurations(problem, X[at : at + 1], np.zeros(1), self.constraints)
            if broken is not None:
                raise RefineError(f"no path can hold: at the {label}, {broken.summary}", violation=broken, seed=seed)

    def _begin(self, problem: Problem, seed: Seed, warm: Refined | None) -> _State:
        slack = Slack(clearance=self._sag(problem, seed))
        if warm is None:
            return _State(slack)
        knots, samples = warm.path.spline.t, warm.path.anchors
        return _State(
            warm.slack or slack, warm.pairs, knots, samples, warm.path.spline, warm.path.anchor_X[1:-1],
            warm.multipliers, warm.speeds,
        )  # fmt: skip

    def _solve(self, nlp: Nlp, options: NlpOptions, state: _State, seed: Seed) -> tuple[Array, dict[str, Any]]:
        """Solve; on failure keep the best iterate as a path."""
        multipliers = state.multipliers if len(state.multipliers) == nlp.evaluation.n_g else None
        try:
            return solve_nlp(nlp, options, multipliers=multipliers)
        except RefineError as error:
            evidence = {**error.evidence, "seed": seed}
            with suppress(KeyError, ParaoptError):  # there may be no path that closes
                evidence["path"] = _follow(nlp, error.evidence["x"])
            raise RefineError(str(error), **evidence) from error

    def _sag(self, problem: Problem, seed: Seed) -> float:
        """Estimate how far the clearance falls between samples: the sag of a chord on an eighth of the machine."""
        if not problem.scene.pairs:
            return 0.0
        n = self.samples_per_control * self.count_controls(seed)
        return float((seed.length / n) ** 2 / problem.robot.mechanism.size)

    def _straight(self, nlp: Nlp) -> Path | None:
        """Give the straight path if it holds on a dense check."""
        path = _follow(nlp, nlp.initial)
        return path if check_densely(nlp.problem, path, 10 * len(nlp.samples), self.constraints) is None else None


@dataclass(frozen=True, eq=False)
class _State:
    """Hold what one optimisation hands to the next: how dense, how tight, and where to begin."""

    slack: Slack
    extra: NDArray[np.intp] = field(default_factory=lambda: np.arange(0))
    knots: Array | None = None
    samples: Array | None = None
    near: BSpline | None = None
    near_X: Array | None = None
    multipliers: Array = field(default_factory=lambda: np.zeros(0))
    speeds: tuple[Array, Array] | None = None
    choose_pairs: bool = True

    def build(self, problem: Problem, seed: Seed, options: NlpOptions) -> Nlp:
        return build_nlp(
            problem, seed, options, self.slack, self.extra,
            knots=self.knots, samples=self.samples, near=self.near, near_X=self.near_X,
            speeds=self.speeds, choose_pairs=self.choose_pairs,
        )  # fmt: skip

    def restart(self, nlp: Nlp) -> _State:
        """Begin again at the seed, with twice the samples."""
        halves = 0.5 * (nlp.samples[1:] + nlp.samples[:-1])
        return _State(Slack(), nlp.evaluator.pairs, nlp.knots, np.union1d(nlp.samples, halves))

    def even_out(self, nlp: Nlp, path: Path, violation: Violation | None, most: float = 0.02) -> _State | None:
        """Move the parameters of waypoints to where the path is run evenly; None where they are there.

        The seed only suggests them: held where they are, one part of the path would be run through in a hurry. Beside a
        tool path, which fixes the parameters of its part, they stay.
        """
        if not nlp.space.places or nlp.space.spans:
            return None
        fixed = np.unique(np.clip([0.0, *nlp.space.places, 1.0], 0.0, 1.0))
        s = np.union1d(np.linspace(0.0, 1.0, 2001), fixed)
        steps = np.linalg.norm(np.diff(path.spline(s) * nlp.problem.metric, axis=0), axis=1)
        arc = np.append(0.0, np.cumsum(steps))
        shares = arc[np.searchsorted(s, fixed)] / max(arc[-1], 1e-300)
        if np.max(np.abs(shares - fixed)) < most or np.min(np.diff(shares)) < 1e-3:
            return None
        u = np.union1d(np.linspace(0.0, 1.0, 257), shares)
        near = make_interp_spline(u, path.spline(np.interp(u, shares, fixed)), 3)
        samples = np.linspace(0.0, 1.0, len(nlp.samples))
        X = path.solve(np.interp(samples[1:-1], shares, fixed))
        slack = Slack(clearance=float(np.min(self.slack.clearance)))  # what else was added belongs to other places
        pairs = nlp.evaluator.pairs if violation is None else np.union1d(nlp.evaluator.pairs, violation.pairs)
        return _State(slack, pairs.astype(int), None, samples, near, X)

    def densify(self, nlp: Nlp, path: Path, violation: Violation, multipliers: Array) -> _State:
        """Add samples where something falls short, and a knot where that is more than a sag between samples."""
        knots, samples = nlp.knots, nlp.samples
        horizon = nlp.evaluation.barriers.horizon
        sag = {"clearance": 0.02 * horizon, "singularity": 0.005, "range": 0.005, "condition": 0.02}
        coarse = violation.places(**sag)
        places = violation.places()
        edges = np.unique(knots)
        held = np.unique(np.clip(np.searchsorted(edges, coarse, side="right") - 1, 0, len(edges) - 2))
        middles = 0.5 * (edges[held] + edges[held + 1])
        fixed = [(first + 1e-9 < middles) & (middles < last - 1e-9) for first, last in nlp.space.spans]
        wide = edges[held + 1] - edges[held] > 0.25 / len(edges)  # a place is not divided without end
        new_knots = np.sort(np.concatenate([knots, middles[wide & ~np.any([~wide, *fixed], axis=0)]]))
        gaps = np.unique(np.clip(np.searchsorted(samples, places), 1, len(samples) - 1))
        gaps = gaps[samples[gaps] - samples[gaps - 1] > 0.1 / len(samples)]
        new = np.union1d(samples, 0.5 * (samples[gaps] + samples[gaps - 1]))
        if np.setdiff1d(violation.pairs, nlp.evaluator.pairs).size:  # nothing held these apart: begin again at the seed
            return replace(self, extra=np.union1d(nlp.evaluator.pairs, violation.pairs).astype(int))
        return _State(
            violation.tighten(self.slack, samples, new, **sag),
            np.union1d(nlp.evaluator.pairs, violation.pairs).astype(int),
            new_knots,
            new,
            path.spline,
            path.solve(new[1:-1]),
            _spread(nlp, multipliers, new),
            choose_pairs=False,  # those of the path so far; the next check finds what else comes near
        )


def _spread(nlp: Nlp, multipliers: Array, samples: Array) -> Array:
    """Keep the multipliers of the samples that stay, and let nothing push at new ones; nor the limits of drives."""
    n, width = nlp.evaluation.n, nlp.evaluation.per_sample
    spread = np.zeros((len(samples) - 2, width))
    spread[np.searchsorted(samples[1:-1], nlp.samples[1:-1])] = multipliers[: n * width].reshape(n, width)
    near = multipliers[n * width : n * width + len(nlp.evaluation.balls)]
    drives = 0 if nlp.evaluation.time is None else replace(nlp.evaluation.time, s=samples).n_rows
    return np.concatenate([spread.ravel(), near, np.zeros(drives)])


def _follow(nlp: Nlp, x: Array) -> Path:
    """Build the path of a solution, with its configurations at the samples."""
    problem = nlp.problem
    spline = nlp.spline(x)
    values = nlp.evaluation.at(x).values
    if values is None:
        raise RefineError("the closures fail on the refined path", spline=spline)
    X = np.vstack([problem.start_configuration.X, values.X, _solve_goal(problem, values.X[-1], spline(1.0))])
    return Path(problem.robot, problem.independent, spline, nlp.samples, X, problem.held)


def _solve_goal(problem: Problem, near: Array, values: Array) -> Array:
    """Solve the goal from the last sample, so that angles stay unwrapped along the path."""
    return problem.space.solve(values[None, :], near[None, :]).X[0]
