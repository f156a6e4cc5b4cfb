"""The one act of every model: impose some variables, solve for the rest.

`solve_closure` works on a batch: damped Newton on all rows at once, each sample with its own damping. `solve_nearest`
answers where no exact solution exists: sequential quadratic programming on the distance to the imposed values, subject
to the closures and the joint ranges.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from enum import Enum

import numpy as np
import qpsolvers
import scipy.sparse as sp
from numpy.typing import NDArray

from paraopt.kinematics.functions import FunctionSet
from paraopt.kinematics.ranks import null_space

Array = NDArray[np.float64]


class Status(Enum):
    """Say how a solve ended."""

    CONVERGED = "converged: the loops close with the imposed values"
    NEAREST = "nearest: no exact solution was found; the loops close as near to the imposed values as possible"
    SINGULAR = "singular: the loops close with the imposed values, but the solution is not unique"
    FAILED = "failed: the loops could not be closed"


@dataclass(frozen=True)
class SolveOptions:
    """Choose how the loops are closed.

    Attributes:
        tolerance: Bound on the scaled closure residual of a converged solution [1].
        iterations: Bound on the number of Newton iterations.
        damping: First damping of the Levenberg-Marquardt step [1].
        step_limit: Largest change of a variable in one iteration, in characteristic lengths or radians.
        nearest_iterations: Bound on the iterations of the search for the nearest values.
        nearest_tolerance: Scaled step at which the search for the nearest values ends [1].
        interior_iterations: Bound on IPOPT's iterations, where the search for the nearest values did not settle.
    """

    tolerance: float = 1e-12
    iterations: int = 60
    damping: float = 1e-8
    step_limit: float = 0.5
    nearest_iterations: int = 80
    nearest_tolerance: float = 1e-8
    interior_iterations: int = 500


@dataclass(frozen=True, eq=False)
class ClosureSolution:
    """Hold the outcome of a batch solve.

    Attributes:
        X: Final values [m or rad], shape (n, n_variables).
        residual: Largest scaled closure residual of each sample [1], shape (n,).
        converged: Whether each residual is below the tolerance, shape (n,).
        iterations: Number of iterations that the slowest sample took.
    """

    X: Array
    residual: Array
    converged: NDArray[np.bool_]
    iterations: int


def solve_closure(
    functions: FunctionSet, X: Array, free: Array, options: SolveOptions | None = None
) -> ClosureSolution:
    """Close the loops from given starts by moving the free variables only.

    A step that increases the residual is taken back and its damping raised, sample by sample. Near the solution
    the damping vanishes and convergence is quadratic.

    Args:
        functions: Compiled functions of the mechanism.
        X: Starts that already hold the imposed values [m or rad], shape (n, n_variables).
        free: 1 for the variables that may move, 0 for the imposed ones; shape (n_variables,).
        options: Tolerances and bounds.

    Returns:
        Final values with residual and verdict for every sample; samples with non-finite starts do not converge.

    Source: Marquardt1963; Lahouar, II.3.
    """
    options = options or SolveOptions()
    X = np.array(X, dtype=float, ndmin=2)
    n = len(X)
    if functions.newton.is_compiled:  # the same iteration
        best, best_residual, counts = functions.newton(
            X, free, options.tolerance, options.iterations, options.damping, options.step_limit
        )
        return ClosureSolution(best, best_residual, best_residual <= options.tolerance, int(counts.max()) if n else 0)
    scale = functions.graph.variable_scale
    best = X.copy()
    best_residual = np.full(n, np.inf)
    damping = np.full(n, options.damping)
    step = np.zeros_like(X)
    active = np.flatnonzero(np.all(np.isfinite(X), axis=1))
    iterations = 0
    for iterations in range(1, options.iterations + 1):  # noqa: B007 - the count is reported
        if not active.size:
            break
        trial = best[active] + step[active]
        dX, f = functions.step.batch(trial, free, damping[active][:, None])
        residual = np.max(np.abs(f), axis=1, initial=0.0)
        better = residual < best_residual[active]
        # not better: the step was too bold (or round-off is reached); damp it, from the best point
        kept, lost = active[better], active[~better]
        best[kept], best_residual[kept] = trial[better], residual[better]
        damping[kept] = np.maximum(damping[kept] * 0.1, 1e-14)
        size = np.max(np.abs(dX[better]) / scale, axis=1, initial=0.0)
        step[kept] = dX[better] * np.minimum(1.0, options.step_limit / np.maximum(size, 1e-300))[:, None]
        damping[lost] = np.maximum(damping[lost] * 30.0, 1e-8)
        step[lost] *= 0.25
        stuck = np.max(np.abs(step[active]) / scale, axis=1, initial=0.0) < 1e-15
        active = active[~((best_residual[active] <= options.tolerance) | stuck)]
    return ClosureSolution(best, best_residual, best_residual <= options.tolerance, iterations)


def solve_nearest(
    functions: FunctionSet,
    start: Array,
    target: Array,
    weight: Array,
    lower: Array,
    upper: Array,
    options: SolveOptions | None = None,
) -> tuple[Array, int, bool]:
    """Find the closed configuration nearest to wanted values, within the joint ranges.

    `minimise 1/2 sum w_i^2 (X_i - target_i)^2 / s_i^2  subject to  F(X) = 0,  lower <= X <= upper`

    by Newton steps in the motions that the closures allow: each is a quadratic program with the second derivatives of
    the Lagrangian, solved by OSQP in a trust region, and followed by closing the loops again.

    Args:
        functions: Compiled functions of the mechanism.
        start: A closed configuration [m or rad], shape (n_variables,).
        target: Wanted values; entries of zero weight are ignored.
        weight: Weight of each variable [1], zero where nothing is wanted.
        lower: Lowest values, may be -inf.
        upper: Highest values, may be inf.
        options: Tolerances and bounds.

    Returns:
        The final values, the number of iterations, and whether the search settled.

    Source: Lahouar, II.3; osqp.
    """
    options = options or SolveOptions()
    scale = functions.graph.variable_scale
    low, high = lower / scale, upper / scale
    wanted = np.where(weight > 0, target, 0.0) / scale
    bounded = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
    everything = np.ones_like(scale)

    def merit(point: Array) -> float:
        outside = np.maximum(np.maximum(low - point, point - high), 0.0)
        return float(0.5 * np.sum((weight * (point - wanted)) ** 2) + 10.0 * np.sum(outside))

    z = start / scale
    value, radius, settled = merit(z), options.step_limit, 0
    push = np.zeros_like(z)  # multipliers of the ranges
    for iteration in range(1, options.nearest_iterations + 1):
        (E,) = functions.scaled_jacobian(z * scale)
        Z = null_space(E)
        if Z.shape[1] == 0:  # nothing can move
            return z * scale, iteration, True
        gradient = weight**2 * (z - wanted)
        multipliers = np.linalg.lstsq(E.T, -(gradient + push), rcond=1e-10)[0]
        (curvature,) = functions.closure_hessian(z * scale, multipliers)
        R = Z.T @ (np.diag(weight**2) + curvature) @ Z
        R += max(0.0, 1e-7 - float(np.min(np.linalg.eigvalsh(R), initial=1.0))) * np.eye(Z.shape[1])
        y, duals = _solve_step(R, Z.T @ gradient, Z[bounded], (low - z)[bounded], (high - z)[bounded], radius)
        push = np.zeros_like(z)
        push[bounded] = duals
        closed = solve_closure(functions, (z + Z @ y) * scale, everything, options)
        trial = closed.X[0] / scale
        size = float(np.max(np.abs(y), initial=0.0))
        if closed.converged[0] and merit(trial) <= value + 1e-14:
            z, value = trial, merit(trial)
            radius = min(2.0 * max(radius, size), options.step_limit)
        else:
            radius = 0.25 * min(radius, max(size, 1e-12))
        settled = settled + 1 if size < options.nearest_tolerance or radius < 1e-11 else 0
        if settled == 2:  # once more, with the multipliers of the ranges known
            return z * scale, iteration, True
    return z * scale, options.nearest_iterations, False


def _solve_step(R: Array, q: Array, G: Array, low: Array, high: Array, radius: float) -> tuple[Array, Array]:
    """Solve `min 1/2 y^T R y + q^T y` with `low <= G y <= high` and `|y| <= radius`.

    Returns:
        y, and the multipliers of the rows of G (positive at the upper bound).
    """
    # rows that are already outside are asked to come back as far as the trust region allows
    reach = radius * np.sum(np.abs(G), axis=1)
    upper, lower = np.maximum(high, -0.9 * reach), np.minimum(low, 0.9 * reach)
    rows = np.vstack([G[np.isfinite(high)], -G[np.isfinite(low)]])
    bounds = np.concatenate([upper[np.isfinite(high)], -lower[np.isfinite(low)]])
    problem = qpsolvers.Problem(
        sp.csc_matrix(0.5 * (R + R.T)),
        q,
        G=sp.csc_matrix(rows) if len(rows) else None,
        h=bounds if len(rows) else None,
        lb=np.full(len(q), -radius),
        ub=np.full(len(q), radius),
    )
    with warnings.catch_warnings():  # an inexact step is judged by the merit function
        warnings.simplefilter("ignore")
        answer = qpsolvers.solve_problem(problem, solver="osqp", eps_abs=1e-10, eps_rel=1e-10, max_iter=20000)
    if answer.x is None or not np.all(np.isfinite(answer.x)):
        return np.zeros_like(q), np.zeros(len(G))
    duals = np.zeros(len(G))
    if len(rows) and answer.z is not None:
        n_upper = int(np.count_nonzero(np.isfinite(high)))
        duals[np.isfinite(high)] += answer.z[:n_upper]
        duals[np.isfinite(low)] -= answer.z[n_upper:]
    return np.clip(answer.x, -radius, radius), duals
