"""Refinement: the shortest spline near a seed, kept from obstacles and singularities by barriers and hard bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from paraopt.errors import DefinitionError, ParaoptError, RefineError
from paraopt.planning.evaluate import SampleEvaluator
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Nlp:
    """Hold a refinement problem, open to inspection before it is solved.

    Attributes:
        problem: The planning problem.
        functions: CasADi's `{"x", "f", "g"}`: inner control points over the seed's length, objective, constraints.
        derivatives: Exact "grad_f" and "jac_g", CasADi functions of (x, p) that return the value and the derivative,
            and "hess_lag", the exact second derivative of the length term; the curvature of barriers and constraints is
            left out.
        initial: First guess of x.
        lower: Lower bounds of g.
        upper: Upper bounds of g.
        labels: What each constraint of one sample is, in the order of g.
        samples: Parameters of the samples, ends included, shape (n,).
        knots: Knots of the spline.
        degree: Degree of the spline.
        unit: Length that x is divided by [m].
        evaluator: What evaluates the samples.
        evaluation: What computes f, g and their derivatives from them.
    """

    problem: Problem
    functions: Mapping[str, ca.MX]
    derivatives: Mapping[str, ca.Function]
    initial: Array
    lower: Array
    upper: Array
    labels: tuple[str, ...]
    samples: Array
    knots: Array
    degree: int
    unit: float
    evaluator: SampleEvaluator
    evaluation: _Evaluation
    _alive: Any = field(repr=False)  # CasADi does not own what it calls

    def spline(self, x: Array) -> BSpline:
        """Build the spline of a solution vector."""
        inner = np.asarray(x).reshape(-1, len(self.problem.independent)) * self.unit / self.problem.metric
        ends = _ends(self.problem)
        return BSpline(self.knots, np.vstack([ends[0], inner, ends[1]]), self.degree)


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
class SplineRefiner:
    """Refine a seed into a spline of least length.

    `minimise integral |dx/ds|^2 / D^2 + weight * mean over samples of [ -log|det V_a| - log|det V_x| + sum phi(d) ]`

    subject to `d >= clearance`, both singularity margins and the ranges at every sample. D is the seed's length,
    phi(d) = -log(d/h) + d/h - 1 below the horizon h and zero beyond it. The first term is least for the shortest path
    run at constant speed. First derivatives are exact: implicit-function theorem, witness points, and
    d log|det A| = tr(A^-1 dA).

    Attributes:
        controls: Number of control points; chosen from the seed when None.
        degree: Degree of the spline, at least 3.
        samples_per_control: Samples for each control point.
        barrier: Weight of the barriers [1].
        horizon: Distance at which the distance barrier begins [m]; four times the clearance, at least 0.02, when None.
        iterations: Bound on IPOPT's iterations in one round.
        rounds: Bound on the optimisations: after each one the path is checked densely, and bounds are tightened where
            it fails between the samples.
        tolerance: Convergence tolerance of IPOPT.

    Source: ipopt.
    """

    controls: int | None = None
    degree: int = 3
    samples_per_control: int = 4
    barrier: float = 1e-4
    horizon: float | None = None
    iterations: int = 120
    rounds: int = 6
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        if self.degree < 3:
            raise DefinitionError(f"degree of the spline is {self.degree}; accelerations need at least 3")
        if self.controls is not None and self.controls < self.degree + 1:
            raise DefinitionError(f"number of control points is {self.controls}; it must be at least {self.degree + 1}")
        for name in ("samples_per_control", "iterations", "rounds"):
            if getattr(self, name) < 1:
                raise DefinitionError(f"{name} is {getattr(self, name)}; it must be at least 1")
        if not (np.isfinite(self.barrier) and self.barrier >= 0):
            raise DefinitionError(f"barrier weight is {self.barrier}; it must be finite and not negative")

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
        options, slack = self, _Slack(clearance=self._sag(problem, seed))
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
            if violation is None:  # the barriers pushed it past the seed's length: let them push less
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
        n = self.samples_per_control * _count_controls(self, seed)
        return (seed.length / n) ** 2 / (8.0 * _choose_horizon(self, problem))

    def _path(self, nlp: Nlp, x: Array) -> Path:
        problem = nlp.problem
        spline = nlp.spline(x)
        values = nlp.evaluator(spline(nlp.samples[1:-1]))
        if not values.converged:
            raise RefineError("the closures fail on the refined path", spline=spline)
        X = np.vstack([problem.start_configuration.X, values.X, _solve_goal(problem, values.X[-1], spline(1.0))])
        return Path(problem.robot, problem.independent, spline, nlp.samples, X)


@dataclass(frozen=True)
class _Slack:
    """Hold what is added to the margins at the samples so that they hold between them."""

    clearance: float = 0.0
    singularity: float = 0.0
    range: float = 0.0


@dataclass(frozen=True, eq=False)
class _Violation:
    """Hold the worst violations of a dense check, zero where there is none."""

    clearance: float
    singularity: float
    range: float
    pairs: NDArray[np.intp]
    summary: str

    def tighten(self, slack: _Slack) -> _Slack:
        return _Slack(
            slack.clearance + 1.3 * self.clearance + (1e-7 if self.clearance else 0.0),
            slack.singularity + 1.3 * self.singularity + (1e-7 if self.singularity else 0.0),
            slack.range + 1.3 * self.range + (1e-9 if self.range else 0.0),
        )


def build_nlp(
    problem: Problem,
    seed: Seed,
    options: SplineRefiner | None = None,
    slack: _Slack | None = None,
    extra_pairs: NDArray[np.intp] | None = None,
) -> Nlp:
    """Build the refinement problem of a seed.

    Args:
        problem: The problem.
        seed: Its seed.
        options: Choices; the defaults when None.
        slack: What is added to the margins at the samples.
        extra_pairs: Pairs to hold apart besides those near the seed.

    Returns:
        The nonlinear program with its first guess.
    """
    options, slack = options or SplineRefiner(), slack or _Slack()
    controls = _count_controls(options, seed)
    degree = options.degree
    knots = np.concatenate([np.zeros(degree), np.linspace(0, 1, controls - degree + 1), np.ones(degree)])
    samples = np.linspace(0.0, 1.0, options.samples_per_control * controls + 1)
    unit = max(seed.length, 1e-12)
    first = _fit(seed, knots, degree, samples)
    near = _configurations(problem, seed, first, samples[1:-1])
    clearance = problem.margins.clearance
    horizon = _choose_horizon(options, problem)
    pairs = problem.scene.near_pairs(near, horizon) if problem.scene.pairs else np.arange(0)
    if extra_pairs is not None:
        pairs = np.union1d(pairs, extra_pairs)
    evaluator = SampleEvaluator(problem, near, pairs.astype(int))
    basis = BSpline(knots, np.eye(controls), degree)
    evaluation = _Evaluation(
        evaluator,
        basis(samples[1:-1]),
        _ends(problem) * problem.metric / unit,
        _energy(basis, knots),
        unit / problem.metric,
        options.barrier,
        horizon,
        max(0.25 * clearance, 0.02 * horizon),
    )
    bridges = {
        "nlp": _Bridge("nlp", evaluation, ("f", "g"), False),
        "grad_f": _Bridge("grad_f", evaluation, ("f", "grad_f"), True),
        "jac_g": _Bridge("jac_g", evaluation, ("g", "jac_g"), True),
    }
    x = ca.MX.sym("x", evaluation.n_x)
    f, g = bridges["nlp"](x)
    low, high, labels = _bounds(problem, evaluator, slack, len(samples) - 2, horizon)
    initial = (first.c[1:-1] * problem.metric / unit).reshape(-1)
    derivatives = {
        "grad_f": bridges["grad_f"],
        "jac_g": bridges["jac_g"],
        "hess_lag": _length_hessian(evaluation),
    }
    return Nlp(
        problem, {"x": x, "f": f, "g": g}, derivatives, initial, low, high, labels, samples, knots, degree, unit,
        evaluator, evaluation, bridges,
    )  # fmt: skip


def solve_nlp(
    nlp: Nlp, options: SplineRefiner | None = None, guess: Array | None = None
) -> tuple[Array, dict[str, Any]]:
    """Solve a refinement problem with IPOPT.

    Args:
        nlp: The problem.
        options: Choices; the defaults when None.
        guess: First guess; the seed's when None.

    Returns:
        The solution vector, and statistics: "iterations", "status", "objective".

    Raises:
        RefineError: IPOPT ended without a feasible point; the message gives its status.
    """
    options = options or SplineRefiner()
    settings = {
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "max_iter": options.iterations,
            "tol": options.tolerance,
            "acceptable_tol": 30 * options.tolerance,
            "acceptable_iter": 5,
            "acceptable_obj_change_tol": 1e-5,
            "mu_init": 1e-3,
            "constr_viol_tol": 1e-7,
        },
        "print_time": False,
        "error_on_fail": False,
        "no_nlp_grad": True,
        **nlp.derivatives,
    }

    solver = ca.nlpsol("refine", "ipopt", dict(nlp.functions), settings)
    answer = solver(x0=nlp.initial if guess is None else guess, lbg=nlp.lower, ubg=nlp.upper)
    if nlp.evaluation.error is not None:
        raise nlp.evaluation.error
    stats = solver.stats()
    x = np.asarray(answer["x"]).reshape(-1)
    g = np.asarray(answer["g"]).reshape(-1)
    excess = np.maximum(nlp.lower - g, g - nlp.upper)
    worst = int(np.argmax(excess)) if excess.size else -1
    if not np.all(np.isfinite(x)) or (excess.size and not excess[worst] < 1e-4):
        at = nlp.samples[1 + worst // max(len(nlp.labels), 1)]
        raise RefineError(
            f"IPOPT found no feasible path ({stats['return_status']}): {nlp.labels[worst % len(nlp.labels)]} is off "
            f"its bound by {excess[worst]:.3g} at s = {at:.3f}",
            nlp=nlp,
            x=x,
            stats=stats,
        )
    return x, {
        "iterations": int(stats["iter_count"]),
        "status": stats["return_status"],
        "objective": float(answer["f"]),
    }


class _Evaluation:
    """Compute objective, constraints and their exact derivatives for a vector of inner control points.

    The last result is kept, because IPOPT asks for values and derivatives in separate calls.

    Args:
        evaluator: What evaluates the samples.
        basis: Values of all basis functions at the samples, shape (n, controls).
        ends: First and last control point over the unit, shape (2, m).
        energy: Integrals of products of the basis functions' slopes, shape (controls, controls).
        to_physical: What multiplies scaled coordinates, shape (m,).
        weight: Weight of the barriers.
        horizon: Distance at which the distance barrier begins [m].
        floor: Distance below which it goes on as a parabola [m].
    """

    def __init__(
        self,
        evaluator: SampleEvaluator,
        basis: Array,
        ends: Array,
        energy: Array,
        to_physical: Array,
        weight: float,
        horizon: float,
        floor: float,
    ) -> None:
        self.evaluator, self.basis, self.ends, self.energy = evaluator, basis, ends, energy
        self.to_physical, self.weight, self.horizon, self.floor = to_physical, weight, horizon, floor
        self.n, self.controls = basis.shape
        self.m = ends.shape[1]
        self.per_sample = len(evaluator.bounded) + 2 + len(evaluator.pairs)
        self.n_x, self.n_g = (self.controls - 2) * self.m, self.n * self.per_sample
        # each sample feels only the inner control points whose basis functions reach it
        sample, control = np.nonzero(basis[:, 1:-1])
        self._sample, self._control = sample, control
        shape = (len(sample), self.per_sample, self.m)
        rows = np.broadcast_to((sample[:, None] * self.per_sample + np.arange(self.per_sample))[:, :, None], shape)
        columns = np.broadcast_to((control[:, None] * self.m + np.arange(self.m))[:, None, :], shape)
        self._order = np.lexsort((rows.ravel(), columns.ravel()))  # CasADi stores columns first
        self.pattern = ca.Sparsity.triplet(self.n_g, self.n_x, rows.ravel().tolist(), columns.ravel().tolist())
        self.error: ParaoptError | None = None
        self._key: bytes | None = None
        self._value: tuple[float, Array, Array, Array] | None = None

    def __call__(self, x: Array) -> tuple[float, Array, Array, Array]:
        """Return objective, its gradient, constraints, and the nonzeros of their Jacobian."""
        key = x.tobytes()
        if key != self._key or self._value is None:
            self._value = self._compute(x)
            self._key = key
        return self._value

    def _compute(self, x: Array) -> tuple[float, Array, Array, Array]:
        controls = np.vstack([self.ends[0], x.reshape(-1, self.m), self.ends[1]])
        v = self.evaluator(self.basis @ controls * self.to_physical)
        if not v.converged:  # IPOPT takes a shorter step
            return np.nan, np.full(self.n_x, np.nan), np.full(self.n_g, np.nan), np.full(self.pattern.nnz(), np.nan)
        phi, slope = self._barrier(v.distances)
        barrier = float(np.sum(phi) - np.sum(v.logarithms)) / self.n
        d_barrier = (np.einsum("nk,nkm->nm", slope, v.d_distances) - np.sum(v.d_logarithms, axis=1)) / self.n
        half = self.energy @ controls
        f = float(np.sum(controls * half)) + self.weight * barrier
        d_f = 2.0 * half + self.weight * (self.basis.T @ (d_barrier * self.to_physical))
        g = np.hstack([v.bounded, v.margins, v.distances / self.horizon])
        d_g = np.concatenate([v.d_bounded, v.d_margins, v.d_distances / self.horizon], axis=1) * self.to_physical
        reach = self.basis[:, 1:-1][self._sample, self._control]
        nonzeros = (d_g[self._sample] * reach[:, None, None]).ravel()[self._order]
        return f, d_f[1:-1].ravel(), g.ravel(), nonzeros

    def _barrier(self, d: Array) -> tuple[Array, Array]:
        """Evaluate phi and its derivative: logarithmic between floor and horizon, quadratic below, zero beyond."""
        h, e = self.horizon, self.floor
        inside = np.clip(d, e, h)
        phi, slope = -np.log(inside / h) + inside / h - 1.0, -1.0 / inside + 1.0 / h
        below = np.minimum(d - e, 0.0)
        phi += slope * below + 0.5 * below**2 / e**2
        slope = slope + below / e**2
        return phi, np.where(d < h, slope, 0.0)


class _Bridge(ca.Callback):
    """Give results of an evaluation to CasADi.

    Args:
        name: Name of the function.
        evaluation: The evaluation.
        outputs: Which of "f", "grad_f", "g", "jac_g" it returns.
        takes_parameters: Whether it has CasADi's second, empty, input.
    """

    def __init__(self, name: str, evaluation: _Evaluation, outputs: Sequence[str], takes_parameters: bool) -> None:
        ca.Callback.__init__(self)
        self.evaluation, self.outputs, self.takes_parameters = evaluation, tuple(outputs), takes_parameters
        self.patterns = {
            "f": ca.Sparsity.dense(1, 1),
            "grad_f": ca.Sparsity.dense(evaluation.n_x, 1),
            "g": ca.Sparsity.dense(evaluation.n_g, 1),
            "jac_g": evaluation.pattern,
        }
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 2 if self.takes_parameters else 1

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.evaluation.n_x, 1) if i == 0 else ca.Sparsity(0, 0)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self.patterns[self.outputs[i]]

    def eval(self, arguments: list[ca.DM]) -> list[ca.DM]:
        try:
            results = self.evaluation(np.array(arguments[0].nonzeros()))
        except ParaoptError as error:  # CasADi would turn it into a warning: it is raised again after the solve
            self.evaluation.error = error
            raise
        by_name = dict(zip(("f", "grad_f", "g", "jac_g"), results, strict=True))
        return [ca.DM(self.patterns[k], by_name[k]) if k == "jac_g" else ca.DM(by_name[k]) for k in self.outputs]


def _length_hessian(evaluation: _Evaluation) -> ca.Function:
    x, p = ca.MX.sym("x", evaluation.n_x), ca.MX.sym("p", 0, 0)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", evaluation.n_g)
    H = np.triu(2.0 * np.kron(evaluation.energy[1:-1, 1:-1], np.eye(evaluation.m)))
    return ca.Function("hess_lag", [x, p, lam_f, lam_g], [lam_f * ca.sparsify(ca.DM(H))])


def _count_controls(options: SplineRefiner, seed: Seed) -> int:
    return options.controls or int(np.clip(8 + 2 * (len(seed.points) - 2), 8, 24))


def _choose_horizon(options: SplineRefiner, problem: Problem) -> float:
    return options.horizon if options.horizon is not None else max(4.0 * problem.margins.clearance, 0.02)


def _ends(problem: Problem) -> Array:
    start = problem.start_configuration.X[problem.robot.mechanism.indices(problem.independent)]
    return np.vstack([start, problem.goal_values()])


def _fit(seed: Seed, knots: Array, degree: int, samples: Array) -> BSpline:
    """Fit a spline to the seed's polyline, through both its ends."""
    s = np.linspace(0.0, 1.0, 8 * len(samples))
    weights = np.ones_like(s)
    weights[[0, -1]] = 1e4
    spline = make_lsq_spline(s, seed.at(s), knots, degree, w=weights)
    ends = _ends(seed.problem)
    spline.c[0], spline.c[-1] = ends[0], ends[1]
    return spline


def _configurations(problem: Problem, seed: Seed, spline: BSpline, samples: Array) -> Array:
    """Solve the closures at samples of the fitted spline: along the polyline first, then across to the spline."""
    kinematics, names = problem.robot.kinematics, problem.independent
    index = problem.robot.mechanism.indices(names)
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
            closed = kinematics.solve_batch(names, goal, predicted)
            if not np.all(closed.converged):
                i = int(np.argmin(closed.converged))
                raise RefineError(
                    f"the closures fail beside the seed at s = {samples[i]:.3f}: the fitted spline leaves the "
                    "reachable space; take a finer seed or more control points",
                    seed=seed,
                )
            X = closed.X
    return X


def _solve_goal(problem: Problem, near: Array, values: Array) -> Array:
    """Solve the goal from the last sample, so that angles stay unwrapped along the path."""
    return problem.robot.kinematics.solve_batch(problem.independent, values[None, :], near[None, :]).X[0]


def _energy(basis: BSpline, knots: Array) -> Array:
    """Integrate products of the basis functions' derivatives exactly; shape (controls, controls)."""
    points, weights = np.polynomial.legendre.leggauss(basis.k + 1)
    edges = np.unique(knots)
    mid, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    s = (mid[:, None] + half[:, None] * points).reshape(-1)
    w = (half[:, None] * weights).reshape(-1)
    slopes = basis(s, 1)
    return slopes.T @ (w[:, None] * slopes)


def _bounds(
    problem: Problem, evaluator: SampleEvaluator, slack: _Slack, n: int, horizon: float
) -> tuple[Array, Array, tuple[str, ...]]:
    names = problem.robot.mechanism.names
    labels = (
        *(f"range of {names[i]!r} [scaled]" for i in evaluator.bounded),
        "parallel margin",
        "serial margin",
        *(f"distance {problem.scene.pairs[p].name} [horizons]" for p in evaluator.pairs),
    )
    return (
        np.tile(
            np.concatenate(
                [
                    evaluator.low + slack.range,
                    np.full(2, problem.margins.singularity + slack.singularity),
                    np.full(len(evaluator.pairs), (problem.margins.clearance + slack.clearance) / horizon),
                ]
            ),
            n,
        ),
        np.tile(np.concatenate([evaluator.high - slack.range, np.full(2 + len(evaluator.pairs), np.inf)]), n),
        labels,
    )


def _check_densely(problem: Problem, path: Path, count: int) -> _Violation | None:
    """Look for violations at many points of a path; None when there is none."""
    X = path.solve(np.linspace(0.0, 1.0, count + 1))
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    scale = problem.robot.kinematics.graph.variable_scale
    beyond = float(np.max(np.maximum(low - X, X - high) / scale, initial=0.0))
    margins = problem.space.margins(X)
    short = problem.margins.singularity - float(np.min([margins.parallel, margins.serial]))
    distance, pair = problem.scene.clearances(X)
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
