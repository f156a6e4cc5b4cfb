"""Solve a refinement by sequential quadratic programming with a trust region; the quadratic programs by OSQP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import osqp
import scipy.sparse as sp
from numpy.typing import NDArray

from paraopt.errors import BackendError
from paraopt.planning.nlp_ipopt import Answer
from paraopt.planning.objective import Evaluation

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Step:
    """Hold a step, what its linear constraints still miss, and the multipliers of the constraints."""

    d: Array
    relaxed: float
    multipliers: Array


def solve_by_sqp(
    evaluation: Evaluation,
    bounds: tuple[Array, Array],
    box: tuple[Array, Array],
    guess: Array,
    *,
    multipliers: Array | None,
    iterations: int,
    tolerance: float,
    radius: float = 0.05,
) -> Answer:
    """Minimise `f + penalty * largest violation` by quadratic models.

    Each program minimises the model of f with the curvature of the Lagrangian under the linearised constraints, all
    relaxed by the same amount, which the penalty makes zero where it can be. Steps are bounded in the largest entry;
    the bound follows how well the model foretold the gain.

    Args:
        evaluation: What computes objective, constraints and derivatives.
        bounds: Those of the constraints.
        box: Those of x.
        guess: Where to begin.
        multipliers: Those of the constraints, when the guess is nearly optimal.
        iterations: Bound on the iterations.
        tolerance: Gain in the objective, relative to one, at which the search ends.
        radius: First bound on the entries of a step.

    Source: osqp.
    """
    low, high = bounds
    x = np.clip(guess, *box)
    lam = np.zeros(evaluation.n_g) if multipliers is None else multipliers
    rows, columns = evaluation.pattern

    def violation(g: Array) -> float:
        return float(np.max(np.maximum(low - g, g - high), initial=0.0))

    def solve(shift: Array | float = 0.0) -> _Step:
        return _solve_program(
            H, grad, J, low - g - shift, high - g - shift, (box[0] - x, box[1] - x), radius, penalty, out, lam
        )  # fmt: skip

    def gain(point: tuple[float, Array, Array, Array]) -> float:
        return f - point[0] + penalty * (out - violation(point[2])) if np.isfinite(point[0]) else -np.inf

    f, grad, g, nonzeros = evaluation(x)
    penalty, status, small = 1.0, "bound on the iterations reached", 0
    history: list[float] = []
    for iteration in range(1, iterations + 1):  # noqa: B007 - the count is reported
        J = sp.csr_matrix((nonzeros, (rows, columns)), shape=(evaluation.n_g, evaluation.n_x))
        H = _convex(evaluation.hessian(x, 1.0, lam))
        out = violation(g)
        history.append(out)
        if penalty > 1e4 and len(history) > 12 and min(history[-12:]) > 0.97 * min(history[:-12]) > 1e-5:
            status = "stuck at an infeasible point"  # it costs much, but for twelve iterations it has not come nearer
            break
        step = solve()
        while out > 1e-9 and step.relaxed > 0.5 * out and penalty < 1e5:
            penalty *= 10.0  # feasibility is not yet worth enough
            step = solve()
        penalty = max(penalty, 1.5 * float(np.sum(np.abs(step.multipliers))))
        promised = -(grad @ step.d + 0.5 * step.d @ H @ step.d) + penalty * (out - step.relaxed)
        trial = np.clip(x + step.d, *box)
        new = evaluation(trial)
        gained = gain(new)
        size = float(np.max(np.abs(step.d), initial=0.0))
        if promised <= 0.3 * tolerance and step.relaxed <= 1e-7:
            status, lam = "converged", step.multipliers
            x = trial if gained > 0 else x
            break
        whole = bool(np.isfinite(new[0]))
        for share in (0.4, 0.16):  # beyond a singularity, or out of reach: a part of the step may be good
            if np.isfinite(new[0]):
                break
            trial = np.clip(x + share * step.d, *box)
            new = evaluation(trial)
            gained, radius = gain(new), share * size
        if whole and gained < 0.25 * promised and violation(new[2]) > out:
            # the constraints bend away: once more, with what the linear model missed
            again = solve(new[2] - g - J @ step.d)
            bent = np.clip(x + again.d, *box)
            other = evaluation(bent)
            if gain(other) > gained:
                trial, new, gained = bent, other, gain(other)
        if gained >= 0.05 * promised and gained > -1e-12:
            small = small + 1 if gained < tolerance and violation(new[2]) < 1e-7 else 0
            x, (f, grad, g, nonzeros), lam = trial, new, step.multipliers
            if gained > 0.7 * promised and size > 0.8 * radius:
                radius *= 2.5
            if small >= 2:
                status = "converged: small gains"
                break
        else:
            radius = 0.3 * min(radius, size)
            if radius < 1e-8:
                status = "converged: small steps" if out < 1e-6 else "stuck at an infeasible point"
                break
    return Answer(x, lam, iteration, status)


def _convex(H: Array) -> Array:
    """Lift the negative eigenvalues of a symmetric matrix to small positive ones."""
    try:
        np.linalg.cholesky(H - 1e-6 * np.max(np.abs(np.diag(H)), initial=1.0) * np.eye(len(H)))
        return H
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(0.5 * (H + H.T))
    floor = 1e-6 * max(1.0, float(values[-1]))
    return np.asarray((vectors * np.maximum(values, floor)) @ vectors.T)


def _solve_program(
    H: Array,
    grad: Array,
    J: sp.csr_matrix,
    low: Array,
    high: Array,
    box: tuple[Array, Array],
    radius: float,
    penalty: float,
    out: float,
    guess: Array,
) -> _Step:
    """Solve the quadratic program of a step, first with the rows that it is likely to meet, then those it met."""
    reach = radius * np.asarray(abs(J).sum(axis=1)).ravel()
    rows = (low > -0.3 * reach) | (high < 0.3 * reach)
    while True:
        step = _solve_part(H, grad, J, low, high, box, radius, penalty, out, guess, np.flatnonzero(rows))
        moved = J @ step.d
        left = np.maximum(low - moved, moved - high)
        missed = ~rows & (left > max(step.relaxed, 1e-9))
        if not np.any(missed):
            return step
        rows |= missed


def _solve_part(
    H: Array,
    grad: Array,
    J: sp.csr_matrix,
    low: Array,
    high: Array,
    box: tuple[Array, Array],
    radius: float,
    penalty: float,
    out: float,
    guess: Array,
    rows: NDArray[np.intp],
) -> _Step:
    """Solve the quadratic program of some rows, in units in which steps and rows are about 1."""
    n, count = len(grad), len(rows)
    relaxed = int(out > 1e-9)  # one more variable: the share of the violation that stays
    part = J[rows].toarray() * radius
    scale = 1.0 / np.maximum(np.linalg.norm(part, axis=1), 1e-12)
    size = n + relaxed
    A = np.zeros((count + size, size))
    A[:count, :n] = part * scale[:, None]
    A[count:] = np.eye(size)
    lo = np.concatenate([low[rows] * scale, np.maximum(-1.0, box[0] / radius), np.zeros(relaxed)])
    hi = np.concatenate([high[rows] * scale, np.minimum(1.0, box[1] / radius), np.ones(relaxed)])
    P, q = np.zeros((size, size)), np.full(size, penalty * out)
    P[:n, :n], q[:n] = H * radius**2, grad * radius
    cost = 1.0 / max(float(np.max(np.abs(q), initial=0.0)), 1e-300)
    P, q = cost * P, cost * q
    if relaxed:
        # a violated row may stay violated by the same share as all others
        P[n, n] = 1e-6
        A[:count, n] = np.where(lo[:count] > 0.0, 1.0, np.where(hi[:count] < 0.0, -1.0, 0.0)) * out * scale
    likely = np.concatenate([guess[rows] / np.maximum(scale, 1e-300) * cost, np.zeros(size)])
    exact = _polish(P, q, A, lo, hi, likely, 4) if np.any(likely) else None
    z, y = exact if exact is not None else _solve_quadratic(P, q, A, lo, hi)
    lam = np.zeros(J.shape[0])
    lam[rows] = y[:count] * scale / cost
    moved = part @ z[:n]
    left = np.maximum(low[rows] - moved, moved - high[rows])
    return _Step(np.clip(z[:n] * radius, *box), float(np.max(left, initial=0.0)), lam)


def _solve_quadratic(P: Array, q: Array, A: Array, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Minimise `1/2 z P z + q z` with `lo <= A z <= hi`: by OSQP roughly, then exactly on the active rows.

    Returns:
        z, and the multipliers of the rows, positive at upper bounds.

    Source: osqp.
    """
    z, y = np.zeros(len(q)), np.zeros(len(lo))
    try:
        solver = osqp.OSQP(algebra="builtin")
        solver.setup(
            sp.triu(sp.csc_matrix(P), format="csc"), q, sp.csc_matrix(A), lo, hi,
            verbose=False, polishing=False, eps_abs=1e-3, eps_rel=1e-3, max_iter=4000, check_termination=10, rho=1.0,
        )  # fmt: skip
        for accuracy in (1e-3, 1e-4, 1e-5, 1e-6):
            if accuracy < 1e-3:
                solver.update_settings(eps_abs=accuracy, eps_rel=accuracy)
            answer = solver.solve(raise_error=False)
            if answer.x is None or not np.all(np.isfinite(answer.x)):
                break
            z, y = answer.x, answer.y
            exact = _polish(P, q, A, lo, hi, y)
            if exact is not None:
                return exact
    except (osqp.OSQPException, ValueError) as error:
        raise BackendError(f"OSQP failed on the quadratic program of a step: {error}") from error
    return z, y


def _polish(
    P: Array, q: Array, A: Array, lo: Array, hi: Array, y: Array, rounds: int = 8
) -> tuple[Array, Array] | None:
    """Solve on the active rows, and exchange those of the wrong sign for those that are broken; None where it fails."""
    side = np.where(y > 1e-6, 1, np.where(y < -1e-6, -1, 0))
    n = len(q)
    for _ in range(rounds):
        active = np.flatnonzero(side)
        if len(active) > n:
            return None
        bound = np.where(side > 0, hi, lo)[active]
        K = np.zeros((n + len(active), n + len(active)))
        K[:n, :n] = P
        K[:n, n:] = A[active].T
        K[n:, :n] = A[active]
        K[np.arange(n, len(K)), np.arange(n, len(K))] = -1e-10
        try:
            solution = np.linalg.solve(K, np.concatenate([-q, bound]))
        except np.linalg.LinAlgError:
            return None
        z, multipliers = solution[:n], np.zeros(len(lo))
        multipliers[active] = solution[n:]
        if not np.all(np.isfinite(solution)) or np.max(np.abs(P @ z + q + A.T @ multipliers)) > 1e-6:
            return None  # the active rows depend on each other
        rows = A @ z
        above, below = rows - hi > 1e-8, lo - rows > 1e-8
        wrong = side * multipliers < -1e-9
        if not (np.any(above) or np.any(below) or np.any(wrong)):
            return z, multipliers
        side = np.where(wrong, 0, side)
        worst = np.maximum(rows - hi, lo - rows)
        add = (above | below) & (worst > 0.3 * worst.max())
        side = np.where(add, np.where(above, 1, -1), side)
    return None
