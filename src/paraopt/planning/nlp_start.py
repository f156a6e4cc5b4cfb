"""Where a refinement begins: a spline along the seed, configurations beside it, and a time law on these."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from paraopt.errors import DefinitionError, RefineError
from paraopt.planning.nlp_time import TimeModel
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


def fit_spline(seed: Seed, knots: Array, degree: int, samples: Array) -> BSpline:
    """Fit a spline to the seed's polyline, through both its ends."""
    s = np.linspace(0.0, 1.0, 8 * len(samples))
    weights = np.ones_like(s)
    weights[[0, -1]] = 1e4
    spline = make_lsq_spline(s, seed.at(s), knots, degree, w=weights)
    ends = seed.points[[0, -1]]
    spline.c[0], spline.c[-1] = ends[0], ends[1]
    return spline


def solve_beside(problem: Problem, seed: Seed, spline: BSpline, samples: Array) -> Array:
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


def guess_speeds(
    problem: Problem, samples: Array, X: Array, speeds: tuple[Array, Array] | None
) -> tuple[TimeModel, Array]:
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
