"""The refinement as a nonlinear program over a spline, open to inspection, and its solution by one of two backends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from paraopt.errors import RefineError
from paraopt.planning.evaluate import SampleEvaluator
from paraopt.planning.nlp_barrier import Barriers
from paraopt.planning.nlp_conflict import Shortfall, list_shortfalls, tell_shortfalls
from paraopt.planning.nlp_ipopt import Answer, Bridge, Curvature, solve_by_ipopt
from paraopt.planning.nlp_options import NlpOptions, Slack
from paraopt.planning.nlp_spline import SplineSpace, Waypoint, build_space, locate
from paraopt.planning.nlp_sqp import solve_by_sqp
from paraopt.planning.nlp_start import fit_spline, guess_speeds, solve_beside
from paraopt.planning.objective import Evaluation
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Nlp:
    """Hold a refinement problem, open to inspection before it is solved.

    Attributes:
        problem: The planning problem.
        initial: First guess of x.
        lower: Lower bounds of g.
        upper: Upper bounds of g.
        labels: What each constraint of one sample is, in the order of g.
        space: The splines.
        unit: Length that x is divided by [m].
        evaluator: What evaluates the samples.
        evaluation: What computes f, g and their derivatives from them.
        measures: What a constraint of one sample that is 1 is in SI, and its unit, in the order of the labels.
    """

    problem: Problem
    initial: Array
    lower: Array
    upper: Array
    labels: tuple[str, ...]
    space: SplineSpace
    unit: float
    evaluator: SampleEvaluator
    evaluation: Evaluation
    measures: tuple[tuple[float, str], ...] = ()

    @cached_property
    def functions(self) -> Mapping[str, ca.MX]:
        """Give CasADi's `{"x", "f", "g"}`.

        x holds the free numbers of the spline over the seed's length, then what the objective adds (see `Evaluation`);
        f is the objective, g are the constraints.
        """
        x = ca.MX.sym("x", self.evaluation.n_x)
        f, g = self._bridges["nlp"](x)
        return {"x": x, "f": f, "g": g}

    @cached_property
    def derivatives(self) -> Mapping[str, ca.Function]:
        """Give exact "grad_f" and "jac_g", CasADi functions of (x, p) that return value and derivative, and "hess_lag".

        The second derivative is that of `Evaluation.hessian`.
        """
        return {name: self._bridges[name] for name in ("grad_f", "jac_g", "hess_lag")}

    @cached_property
    def _bridges(self) -> Mapping[str, ca.Callback]:  # kept here, because CasADi does not own what it calls
        return {
            "nlp": Bridge("nlp", self.evaluation, ("f", "g"), False),
            "grad_f": Bridge("grad_f", self.evaluation, ("f", "grad_f"), True),
            "jac_g": Bridge("jac_g", self.evaluation, ("g", "jac_g"), True),
            "hess_lag": Curvature(self.evaluation),
        }

    @property
    def samples(self) -> Array:
        """Give the parameters of the samples, ends included, shape (n,)."""
        return self.space.samples

    @property
    def knots(self) -> Array:
        """Give the knots of the spline."""
        return self.space.knots

    @property
    def degree(self) -> int:
        """Give the degree of the spline."""
        return self.space.degree

    @property
    def box(self) -> tuple[Array, Array]:
        """Give the bounds of x: squared path speeds are above zero."""
        low, high = np.full(self.evaluation.n_x, -np.inf), np.full(self.evaluation.n_x, np.inf)
        low[self.evaluation.n_x - self.evaluation.n_b :] = 1e-6
        return low, high

    def spline(self, x: Array) -> BSpline:
        """Build the spline of a solution vector."""
        return self.space.spline(np.asarray(x)[: self.space.n_y])

    def speeds(self, x: Array) -> tuple[Array, Array] | None:
        """Give the samples and the squared path speeds there [1/s^2] of a solution vector, where time counts."""
        time = self.evaluation.time
        if time is None:
            return None
        return self.samples, time.full(np.asarray(x)[self.evaluation.n_x - time.n_b :]) / time.unit**2

    def shortfalls(self, x: Array, tolerance: float = 1e-6) -> list[Shortfall]:
        """List the constraints that a vector breaks, each at its worst place.

        First come those that stand most against a better vector near it, where these are known, else the worst.

        Args:
            x: The vector.
            tolerance: What is let pass.
        """
        return list_shortfalls(self, np.asarray(x), tolerance)

    def describe(self, row: int) -> tuple[str, float]:
        """Tell what a row of g is, and where on the path."""
        by_sample = self.evaluation.n * len(self.labels)
        if row < by_sample:
            return self.labels[row % len(self.labels)], float(self.samples[1 + row // len(self.labels)])
        row -= by_sample
        if row < len(self.evaluation.balls):
            return f"distance from waypoint {row + 1} [radii, squared]", float(self.space.places[row])
        row -= len(self.evaluation.balls)
        assert self.evaluation.time is not None
        sample, drive = (int(place[row]) for place in self.evaluation.time.place)
        kind = "velocity" if row < self.evaluation.n_b * len(self.problem.robot.mechanism.active) else "acceleration"
        return f"{kind} of {self.problem.robot.mechanism.active[drive]!r} [limits]", float(self.samples[sample])


def build_nlp(
    problem: Problem,
    seed: Seed,
    options: NlpOptions | None = None,
    slack: Slack | None = None,
    extra_pairs: NDArray[np.intp] | None = None,
    *,
    knots: Array | None = None,
    samples: Array | None = None,
    near: BSpline | None = None,
    near_X: Array | None = None,
    speeds: tuple[Array, Array] | None = None,
    choose_pairs: bool = True,
) -> Nlp:
    """Build the refinement problem of a seed.

    Args:
        problem: The problem.
        seed: Its seed.
        options: Choices; the defaults when None.
        slack: What is added to the margins at the samples.
        extra_pairs: Pairs to hold apart besides those near the seed.
        knots: Knots of the spline; spread evenly when None.
        samples: Parameters of the samples, ends included; spread evenly when None.
        near: A spline to begin with, instead of the seed.
        near_X: Configurations along it at the samples, shape (n, n_variables).
        speeds: Parameters and squared path speeds there [1/s^2] to begin with, where time counts.
        choose_pairs: Whether pairs that are near are held apart, or only the extra ones.

    Returns:
        The nonlinear program with its first guess.

    Raises:
        RefineError: The closures fail along the first spline, or conditions contradict each other.
    """
    options, slack = options or NlpOptions(), slack or Slack()
    degree = options.degree
    controls = options.count_controls(seed)
    if knots is None:
        knots = np.concatenate([np.zeros(degree), np.linspace(0, 1, controls - degree + 1), np.ones(degree)])
    if samples is None:
        samples = np.linspace(0.0, 1.0, options.samples_per_control * controls + 1)
    unit = max(seed.length, 1e-12)
    space = _build_space(problem, seed, options, knots, samples, unit, near)
    if near is None:
        y = space.nearest(fit_spline(seed, space.knots, degree, samples).c / space.to_physical)
        X = solve_beside(problem, seed, space.spline(y), samples[1:-1])
    else:
        y = space.project(near)
        X = near_X if near_X is not None else solve_beside(problem, seed, space.spline(y), samples[1:-1])
    horizon = options.choose_horizon(problem)
    pairs = _choose_pairs(problem, X, horizon, 0.1 * unit) if problem.scene.pairs and choose_pairs else np.arange(0)
    if extra_pairs is not None:
        pairs = np.union1d(pairs, extra_pairs)
    evaluator = SampleEvaluator(problem, X, pairs.astype(int), options.constraints)
    balls = [
        (place, _scaled_centre(problem, w, space), w.radius / unit)
        for place, w in zip(space.places, options.waypoints, strict=True)
        if w.radius > 0
    ]
    barriers = Barriers(
        options.barrier,
        horizon,
        max(0.25 * problem.margins.clearance, 0.02 * horizon),
        serial=not problem.allow_mode_change,
    )
    time, first_b = guess_speeds(problem, samples, X, speeds) if options.objective.time > 0 else (None, np.zeros(0))
    evaluation = Evaluation(evaluator, space, options.objective, barriers, balls, time)
    level = np.full(evaluation.n_level, problem.margins.singularity)
    initial = np.concatenate([y, level, first_b])
    low, high, labels, measures = _bounds(problem, evaluation, slack)
    return Nlp(problem, initial, low, high, labels, space, unit, evaluator, evaluation, measures)


def solve_nlp(
    nlp: Nlp,
    options: NlpOptions | None = None,
    guess: Array | None = None,
    multipliers: Array | None = None,
) -> tuple[Array, dict[str, Any]]:
    """Solve a refinement problem, lowering the weight of the barriers to its final value.

    Args:
        nlp: The problem.
        options: Choices; the defaults when None.
        guess: First guess; the seed's when None.
        multipliers: Those of the constraints, when the guess is nearly optimal; the barriers then begin with their
            final weight.

    Returns:
        The solution vector, and statistics: "iterations", "status", "objective", "multipliers", "weight".

    Raises:
        RefineError: The solver ended without a feasible point; the message gives the worst constraint, where it is
            broken and by how much. Evidence: the program, the last vector x, all "shortfalls", the solver's "stats".
    """
    options = options or NlpOptions()
    x = nlp.initial if guess is None else guess
    weights = options.weights if multipliers is None else options.weights[-1:]
    iterations, answer = 0, None
    for weight in weights:
        nlp.evaluation.weigh(weight)
        last = weight == weights[-1]
        answer = _run(nlp, options, x, multipliers, options.tolerance if last else 100.0 * options.tolerance)
        x, multipliers = answer.x, answer.multipliers
        iterations += answer.iterations
        if answer.is_stuck:  # the weight of the barriers has no say in that
            break
    assert answer is not None
    stats = {"iterations": iterations, "return_status": answer.status}
    shortfalls = nlp.shortfalls(x, 1e-4)
    if any(not shortfall.is_timing for shortfall in shortfalls):  # a retimer cures what is run too fast
        raise RefineError(
            f"{options.backend} found no feasible path ({answer.status}): {tell_shortfalls(shortfalls)}",
            nlp=nlp,
            x=x,
            shortfalls=tuple(shortfalls),
            stats=stats,
        )
    return x, {
        "iterations": iterations,
        "status": answer.status,
        "objective": nlp.evaluation(x)[0],
        "multipliers": answer.multipliers,
        "weight": weights[-1],
    }


def _choose_pairs(problem: Problem, X: Array, horizon: float, capture: float) -> NDArray[np.intp]:
    """Choose the pairs to hold apart: those that are near, and obstacles that may be when the path is straightened."""
    near = problem.scene.near_pairs(X, horizon)
    if not problem.scene.obstacles or capture <= horizon:
        return near
    wide = problem.scene.near_pairs(X, capture)
    return np.union1d(near, wide[[problem.scene.pairs[p].is_external for p in wide]])


def _run(nlp: Nlp, options: NlpOptions, x: Array, multipliers: Array | None, tolerance: float) -> Answer:
    bounds = (nlp.lower, nlp.upper)
    limits: dict[str, Any] = {
        "multipliers": multipliers, "iterations": options.iterations, "tolerance": tolerance,
    }  # fmt: skip
    if options.backend == "sqp":
        return solve_by_sqp(nlp.evaluation, bounds, nlp.box, x, **limits)
    return solve_by_ipopt(nlp.functions, nlp.derivatives, nlp.evaluation, bounds, nlp.box, x, **limits)


def _build_space(
    problem: Problem, seed: Seed, options: NlpOptions, knots: Array, samples: Array, unit: float, near: BSpline | None
) -> SplineSpace:
    """Find where on the seed, or on the spline to begin with, the waypoints and tool paths belong."""
    after = 0.0
    places, spans = [], []
    for waypoint in options.waypoints:
        after = locate(seed if near is None else near, problem, waypoint.values, after)
        places.append((after, waypoint))
    after = -1.0
    for tool in options.tool_paths:
        ends = [dict(zip(tool.names, tool.curve(u), strict=True)) for u in (0.0, 1.0)]
        first = locate(seed if near is None else near, problem, ends[0], after)
        after = locate(seed if near is None else near, problem, ends[1], first)
        first = 0.0 if first < 2e-3 else first
        after = 1.0 if after > 1.0 - 2e-3 else after
        spans.append((first, after, tool))
    return build_space(
        problem, seed.points[[0, -1]], unit, knots, options.degree, samples,
        rest=options.rest, waypoints=places, tool_paths=spans,
    )  # fmt: skip


def _scaled_centre(problem: Problem, waypoint: Waypoint, space: SplineSpace) -> Array:
    values = [waypoint.values.get(name, np.nan) for name in problem.independent]
    return np.array(values) / space.to_physical


def _bounds(
    problem: Problem, evaluation: Evaluation, slack: Slack
) -> tuple[Array, Array, tuple[str, ...], tuple[tuple[float, str], ...]]:
    """Give the bounds of g; what each row of one sample is, and what a row that is 1 is in SI."""
    names, evaluator, n = problem.robot.mechanism.names, evaluation.evaluator, evaluation.n
    conditions = evaluator.conditions
    kinds = ("parallel", "serial")[: evaluation.kinds]
    labels = (
        *(f"range of {names[i]!r} [scaled]" for i in evaluator.bounded),
        "parallel margin",
        "serial margin",
        *(f"{n} [over {c:g}]" if c != 1.0 else n for n, c in zip(conditions.names, conditions.scales, strict=True)),
        *(f"distance {problem.scene.pairs[p].name} [horizons]" for p in evaluator.pairs),
        *(f"{kind} margin over the smallest" for kind in kinds if evaluation.n_level),
    )
    variables = problem.robot.mechanism.variables
    measures = (
        *((float(evaluator.scale[i]), variables[i].unit) for i in evaluator.bounded),
        *((1.0, ""), (1.0, "")),
        *((float(c), "") for c in conditions.scales),
        *((evaluation.barriers.horizon, "m") for _ in evaluator.pairs),
        *((1.0, "") for _ in kinds if evaluation.n_level),
    )
    column = {name: np.broadcast_to(getattr(slack, name), n)[:, None] for name in vars(slack)}
    singular = np.array(
        [problem.margins.singularity, problem.margins.singularity if evaluation.kinds == 2 else -np.inf]
    )
    k, level = len(evaluator.pairs), evaluation.n_level * evaluation.kinds
    low = np.hstack([
        evaluator.low + column["range"],
        singular + column["singularity"],
        conditions.lower + column["condition"],
        np.tile((problem.margins.clearance + column["clearance"]) / evaluation.barriers.horizon, k),
        np.zeros((n, level)),
    ])  # fmt: skip
    high = np.hstack([
        evaluator.high - column["range"], np.full((n, 2), np.inf), conditions.upper - column["condition"],
        np.full((n, k + level), np.inf),
    ])  # fmt: skip
    lows, highs = [low.ravel()], [high.ravel()]
    lows.append(np.full(len(evaluation.balls), -np.inf))
    highs.append(np.ones(len(evaluation.balls)))
    if evaluation.time is not None:
        lows.append(evaluation.time.bounds[0])
        highs.append(evaluation.time.bounds[1])
    return np.concatenate(lows), np.concatenate(highs), labels, measures
