"""The refinement as a nonlinear program over a spline, open to inspection, and its solution by IPOPT."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from paraopt.errors import DefinitionError, RefineError
from paraopt.planning.evaluate import SampleEvaluator
from paraopt.planning.objective import Bridge, Evaluation, build_length_hessian
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NlpOptions:
    """Choose the spline, the barriers and the solver's bounds of a refinement.

    Attributes:
        controls: Number of control points; chosen from the seed when None.
        degree: Degree of the spline, at least 3.
        samples_per_control: Samples for each control point.
        barrier: Weight of the barriers [1].
        horizon: Distance at which the distance barrier begins [m]; four times the clearance, at least 0.02, when None.
        iterations: Bound on IPOPT's iterations.
        tolerance: Convergence tolerance of IPOPT.
    """

    controls: int | None = None
    degree: int = 3
    samples_per_control: int = 4
    barrier: float = 1e-4
    horizon: float | None = None
    iterations: int = 120
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        if self.degree < 3:
            raise DefinitionError(f"degree of the spline is {self.degree}; accelerations need at least 3")
        if self.controls is not None and self.controls < self.degree + 1:
            raise DefinitionError(f"number of control points is {self.controls}; it must be at least {self.degree + 1}")
        for name in ("samples_per_control", "iterations"):
            if getattr(self, name) < 1:
                raise DefinitionError(f"{name} is {getattr(self, name)}; it must be at least 1")
        if not (np.isfinite(self.barrier) and self.barrier >= 0):
            raise DefinitionError(f"barrier weight is {self.barrier}; it must be finite and not negative")
        for name in ("horizon", "tolerance"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise DefinitionError(f"{name} is {value}; it must be finite and above 0")

    def count_controls(self, seed: Seed) -> int:
        """Give the number of control points for a seed: two more for each of its corners."""
        return self.controls or int(np.clip(8 + 2 * (len(seed.points) - 2), max(8, self.degree + 1), 24))

    def choose_horizon(self, problem: Problem) -> float:
        """Give the distance at which the distance barrier begins [m]."""
        return self.horizon if self.horizon is not None else max(4.0 * problem.margins.clearance, 0.02)


@dataclass(frozen=True)
class Slack:
    """Hold what is added to the margins at the samples so that they hold between them."""

    clearance: float = 0.0
    singularity: float = 0.0
    range: float = 0.0


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
        ends: First and last point of the path, shape (2, m).
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
    ends: Array
    unit: float
    evaluator: SampleEvaluator
    evaluation: Evaluation
    _alive: Any = field(repr=False)  # CasADi does not own what it calls

    def spline(self, x: Array) -> BSpline:
        """Build the spline of a solution vector."""
        inner = np.asarray(x).reshape(-1, len(self.problem.independent)) * self.unit / self.problem.metric
        return BSpline(self.knots, np.vstack([self.ends[0], inner, self.ends[1]]), self.degree)


def build_nlp(
    problem: Problem,
    seed: Seed,
    options: NlpOptions | None = None,
    slack: Slack | None = None,
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
    options, slack = options or NlpOptions(), slack or Slack()
    controls = options.count_controls(seed)
    degree = options.degree
    knots = np.concatenate([np.zeros(degree), np.linspace(0, 1, controls - degree + 1), np.ones(degree)])
    samples = np.linspace(0.0, 1.0, options.samples_per_control * controls + 1)
    unit = max(seed.length, 1e-12)
    first = _fit(seed, knots, degree, samples)
    near = _configurations(problem, seed, first, samples[1:-1])
    clearance = problem.margins.clearance
    horizon = options.choose_horizon(problem)
    pairs = problem.scene.near_pairs(near, horizon) if problem.scene.pairs else np.arange(0)
    if extra_pairs is not None:
        pairs = np.union1d(pairs, extra_pairs)
    evaluator = SampleEvaluator(problem, near, pairs.astype(int))
    basis = BSpline(knots, np.eye(controls), degree)
    evaluation = Evaluation(
        evaluator,
        basis(samples[1:-1]),
        _ends(seed) * problem.metric / unit,
        _energy(basis, knots),
        unit / problem.metric,
        options.barrier,
        horizon,
        max(0.25 * clearance, 0.02 * horizon),
    )
    bridges = {
        "nlp": Bridge("nlp", evaluation, ("f", "g"), False),
        "grad_f": Bridge("grad_f", evaluation, ("f", "grad_f"), True),
        "jac_g": Bridge("jac_g", evaluation, ("g", "jac_g"), True),
    }
    x = ca.MX.sym("x", evaluation.n_x)
    f, g = bridges["nlp"](x)
    low, high, labels = _bounds(problem, evaluator, slack, len(samples) - 2, horizon)
    initial = (first.c[1:-1] * problem.metric / unit).reshape(-1)
    derivatives = {
        "grad_f": bridges["grad_f"],
        "jac_g": bridges["jac_g"],
        "hess_lag": build_length_hessian(evaluation),
    }
    return Nlp(
        problem, {"x": x, "f": f, "g": g}, derivatives, initial, low, high, labels, samples, knots, degree,
        _ends(seed), unit, evaluator, evaluation, bridges,
    )  # fmt: skip


def solve_nlp(nlp: Nlp, options: NlpOptions | None = None, guess: Array | None = None) -> tuple[Array, dict[str, Any]]:
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
    options = options or NlpOptions()
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


def _ends(seed: Seed) -> Array:
    """Give both ends of the path; the seed's, because it may have reached the goal by full turns."""
    return seed.points[[0, -1]]


def _fit(seed: Seed, knots: Array, degree: int, samples: Array) -> BSpline:
    """Fit a spline to the seed's polyline, through both its ends."""
    s = np.linspace(0.0, 1.0, 8 * len(samples))
    weights = np.ones_like(s)
    weights[[0, -1]] = 1e4
    spline = make_lsq_spline(s, seed.at(s), knots, degree, w=weights)
    ends = _ends(seed)
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
    problem: Problem, evaluator: SampleEvaluator, slack: Slack, n: int, horizon: float
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
