"""The refinement as a nonlinear program over a spline, open to inspection, and its solution by one of two backends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from paraopt.errors import DefinitionError, RefineError
from paraopt.planning.evaluate import SampleEvaluator
from paraopt.planning.nlp_ipopt import Answer, Bridge, Curvature, solve_by_ipopt
from paraopt.planning.nlp_options import NlpOptions, Slack
from paraopt.planning.nlp_spline import SplineSpace, Waypoint, build_space, locate
from paraopt.planning.nlp_sqp import solve_by_sqp
from paraopt.planning.nlp_time import TimeModel
from paraopt.planning.objective import Barriers, Evaluation
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shortfall:
    """Name a constraint that a vector breaks.

    Attributes:
        what: The constraint.
        at: Where on the path, in [0, 1].
        amount: By how much, in the constraint's own scale.
        is_timing: Whether it is a limit of a drive, which a slower law would hold.
    """

    what: str
    at: float
    amount: float
    is_timing: bool = False


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
        """List the constraints that a vector breaks, the worst first, each at its worst place.

        Args:
            x: The vector.
            tolerance: What is let pass.
        """
        g = self.evaluation(np.asarray(x))[2]
        excess = np.maximum(self.lower - g, g - self.upper)
        excess = np.where(np.isnan(excess), np.inf, excess)
        worst: dict[str, Shortfall] = {}
        for row in np.flatnonzero(excess > tolerance):
            what, at = self.describe(int(row))
            if what not in worst or excess[row] > worst[what].amount:
                worst[what] = Shortfall(what, at, float(excess[row]), bool(row >= len(g) - self.evaluation.n_rows))
        return sorted(worst.values(), key=lambda shortfall: -shortfall.amount)

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
        y = space.nearest(_fit(seed, space.knots, degree, samples).c / space.to_physical)
        X = _configurations(problem, seed, space.spline(y), samples[1:-1])
    else:
        y = space.project(near)
        X = near_X if near_X is not None else _configurations(problem, seed, space.spline(y), samples[1:-1])
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
    time, first_b = _time(problem, samples, X, speeds) if options.objective.time > 0 else (None, np.zeros(0))
    evaluation = Evaluation(evaluator, space, options.objective, barriers, balls, time)
    level = np.full(evaluation.n_level, problem.margins.singularity)
    initial = np.concatenate([y, level, first_b])
    low, high, labels = _bounds(problem, evaluation, slack)
    return Nlp(problem, initial, low, high, labels, space, unit, evaluator, evaluation)


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
    assert answer is not None
    stats = {"iterations": iterations, "return_status": answer.status}
    shortfalls = nlp.shortfalls(x, 1e-4) if np.all(np.isfinite(x)) else [Shortfall("the solution", 0.0, np.inf)]
    if any(not shortfall.is_timing for shortfall in shortfalls):  # a retimer cures what is run too fast
        told = "; ".join(f"{s.what} is off its bound by {s.amount:.3g} at s = {s.at:.3f}" for s in shortfalls[:4])
        more = f"; and {len(shortfalls) - 4} others" if len(shortfalls) > 4 else ""
        raise RefineError(
            f"{options.backend} found no feasible path ({answer.status}): {told}{more}",
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


def _time(problem: Problem, samples: Array, X: Array, speeds: tuple[Array, Array] | None) -> tuple[TimeModel, Array]:
    """Build the timing of a path, in units of its first guess, and the squared speeds of that guess."""
    mechanism = problem.robot.mechanism
    names = mechanism.active
    limits = [problem.bounds.of(quantity, names) for quantity in ("velocity", "acceleration")]
    if not np.all(np.isfinite(limits)):
        raise DefinitionError(f"time is to be made short, but not all of {list(names)} have velocity and acceleration "
                              "limits; state them in Limits")  # fmt: skip
    goal = problem.space.solve(problem.goal_values()[None], X[-1:])
    q = np.vstack([problem.start_configuration.X, X, goal.X])[:, mechanism.indices(names)]
    model = TimeModel(samples, limits[0], limits[1], 1.0)
    b = model.guess(q)
    if speeds is not None:  # those of a law are better; lowered until they hold at these samples
        known = np.interp(samples[1:-1], speeds[0], speeds[1])
        b = known / max(1.05, 1.05 * float(np.max(np.abs(model.rows(q, known).values))))
    unit = model.duration(b)[0]
    return TimeModel(samples, limits[0], limits[1], unit), b * unit**2


def _fit(seed: Seed, knots: Array, degree: int, samples: Array) -> BSpline:
    """Fit a spline to the seed's polyline, through both its ends."""
    s = np.linspace(0.0, 1.0, 8 * len(samples))
    weights = np.ones_like(s)
    weights[[0, -1]] = 1e4
    spline = make_lsq_spline(s, seed.at(s), knots, degree, w=weights)
    ends = seed.points[[0, -1]]
    spline.c[0], spline.c[-1] = ends[0], ends[1]
    return spline


def _configurations(problem: Problem, seed: Seed, spline: BSpline, samples: Array) -> Array:
    """Solve the closures at samples of the fitted spline: along the polyline first, then across to the spline."""
    index = problem.index
    arc = seed.arc
    values = seed.at(samples)
    corner = np.clip(np.searchsorted(arc, samples, side="right") - 1, 0, len(arc) - 1)
    X = np.empty((len(samples), len(problem.robot.mechanism.names)))
    # each leg of the polyline is walked by all its samples at once, in equal shares
    X[:] = seed.X[corner]
    for target in (values, np.asarray(spline(samples))):
        origin = X[:, index].copy()
        far = float(np.max(np.abs((target - origin) * problem.metric), initial=0.0))
        steps = max(1, int(np.ceil(far / (0.15 * problem.robot.mechanism.length))))
        for k in range(1, steps + 1):
            T = problem.space.tangent(X)
            goal = origin + (target - origin) * (k / steps)
            predicted = X + np.einsum("nvm,nm->nv", T, goal - X[:, index])
            closed = problem.space.solve(goal, predicted)
            if not np.all(closed.converged):
                i = int(np.argmin(closed.converged))
                raise RefineError(
                    f"the closures fail beside the seed at s = {samples[i]:.3f}: the fitted spline leaves the "
                    "reachable space; take a finer seed or more control points",
                    seed=seed,
                )
            X = closed.X
    return X


def _bounds(problem: Problem, evaluation: Evaluation, slack: Slack) -> tuple[Array, Array, tuple[str, ...]]:
    """Give the bounds of g, and what each row of one sample is."""
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
    return np.concatenate(lows), np.concatenate(highs), labels
