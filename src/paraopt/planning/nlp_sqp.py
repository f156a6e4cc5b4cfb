"""Solve a refinement by sequential quadratic programming with a trust region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from paraopt.planning.nlp_conflict import find_conflict
from paraopt.planning.nlp_ipopt import Answer
from paraopt.planning.nlp_quadratic import QuadraticProgram
from paraopt.planning.objective import Evaluation, Point

Array = NDArray[np.float64]

_DEAREST = 1e5  # of a violation: more drowns the objective in round-off, and helps none


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
    widest: float = 0.5,
) -> Answer:
    """Minimise `f + penalty * largest violation` by quadratic models.

    Each program minimises the model of f with the curvature of the Lagrangian under the linearised constraints, all
    relaxed by the same amount, which the penalty makes zero where it can be. Where it does not, a linear program tells
    how much of the violation a step can take away at all: the penalty is raised until half of that is taken, and where
    there is nothing to take the search ends. Steps are bounded in the largest entry; the bound follows how well the
    model foretold the gain.

    Args:
        evaluation: What computes objective, constraints and derivatives.
        bounds: Those of the constraints.
        box: Those of x.
        guess: Where to begin.
        multipliers: Those of the constraints, when the guess is nearly optimal.
        iterations: Bound on the iterations.
        tolerance: Gain in the objective, relative to one, at which the search ends.
        radius: First bound on the entries of a step.
        widest: Largest bound on them.

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

    def attempt(place: Array) -> tuple[tuple[float, Array, Array, Array], Point]:
        evaluation.recall(here)  # a step that was not taken may have been far off: samples are followed from here
        return evaluation(place), evaluation.at(place)

    f, grad, g, nonzeros = evaluation(x)
    here = evaluation.at(x)
    if not np.isfinite(f):
        return Answer(x, lam, 0, "the loops do not close along the first guess")
    penalty, status, small = 1.0, "bound on the iterations reached", 0
    history: list[float] = []
    for iteration in range(1, iterations + 1):  # noqa: B007 - the count is reported
        J = sp.csr_matrix((nonzeros, (rows, columns)), shape=(evaluation.n_g, evaluation.n_x))
        H = _convex(evaluation.hessian(x, 1.0, lam))
        out = violation(g)
        history.append(out)
        step = solve()
        if out > 1e-6 and step.relaxed > 0.5 * out:
            found = find_conflict(J, low - g, high - g, (box[0] - x, box[1] - x), radius, out)
            if found is not None:
                if found.reachable > 0.98 * out and radius > 0.01:
                    status = Answer.STUCK  # no step takes away more than a little of what is missing
                    break
                while step.relaxed > 0.5 * (out + found.reachable) and penalty < _DEAREST:
                    penalty *= 10.0  # feasibility is not yet worth enough
                    step = solve()
        if len(history) > 8 and min(history[-8:]) > 0.9 * min(history[:-8]) > 1e-5:
            status = Answer.STUCK  # in eight iterations it has hardly come nearer
            break
        penalty = max(penalty, min(1.5 * float(np.sum(np.abs(step.multipliers))), _DEAREST))
        promised = -(grad @ step.d + 0.5 * step.d @ H @ step.d) + penalty * (out - step.relaxed)
        trial = np.clip(x + step.d, *box)
        is_last = promised <= 0.3 * tolerance and step.relaxed <= 1e-7
        if is_last and out <= 1e-9:
            status, lam = "converged", step.multipliers
            break
        new, there = attempt(trial)
        gained = gain(new)
        size = float(np.max(np.abs(step.d), initial=0.0))
        if is_last:
            status, lam = "converged", step.multipliers
            x, here = (trial, there) if gained > 0 else (x, here)
            break
        whole = bool(np.isfinite(new[0]))
        for share in (0.4, 0.16):  # beyond a singularity, or out of reach: a part of the step may be good
            if np.isfinite(new[0]):
                break
            trial = np.clip(x + share * step.d, *box)
            new, there = attempt(trial)
            gained, radius = gain(new), share * size
        if whole and gained < 0.25 * promised and violation(new[2]) > out:
            # the constraints bend away: once more, with what the linear model missed
            again = solve(new[2] - g - J @ step.d)
            bent = np.clip(x + again.d, *box)
            other, beyond = attempt(bent)
            if gain(other) > gained:
                trial, new, there, gained = bent, other, beyond, gain(other)
        if gained >= 0.05 * promised and gained > -1e-12:
            small = small + 1 if gained < tolerance and violation(new[2]) < 1e-7 else 0
            x, (f, grad, g, nonzeros), here, lam = trial, new, there, step.multipliers
            if gained > 0.7 * promised and size > 0.8 * radius:
                radius = min(2.5 * radius, widest)
            if small >= 2:
                status = "converged: small gains"
                break
        else:
            radius = 0.3 * min(radius, size)
            if radius < 1e-8:
                status = "converged: small steps" if out < 1e-6 else Answer.STUCK
                break
    evaluation.recall(here)
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
    upper, lower = high < 0.3 * reach, low > -0.3 * reach
    while True:
        sides = np.flatnonzero(upper), np.flatnonzero(lower)
        step = _solve_part(H, grad, J, low, high, box, radius, penalty, out, guess, sides)
        moved = J @ step.d
        most = max(step.relaxed, 1e-9)
        above, below = ~upper & (moved - high > most), ~lower & (low - moved > most)
        if not (np.any(above) or np.any(below)):
            return step
        upper, lower = upper | above, lower | below


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
    rows: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> _Step:
    """Solve the quadratic program of some upper and some lower bounds, in units in which steps and rows are about 1."""
    n, relaxed = len(grad), int(out > 1e-9)  # one more variable: the share of the violation that stays
    at = np.concatenate(rows)
    sign = np.repeat([1.0, -1.0], [len(side) for side in rows])
    part = sign[:, None] * J[at].toarray() * radius
    bound = np.concatenate([high[rows[0]], -low[rows[1]]])
    scale = 1.0 / np.maximum(np.linalg.norm(part, axis=1), 1e-12)
    size = n + relaxed
    G, h = np.zeros((len(at), size)), bound * scale
    G[:, :n] = part * scale[:, None]
    P, q = np.zeros((size, size)), np.full(size, penalty * out)
    P[:n, :n], q[:n] = H * radius**2, grad * radius
    # at a place where nothing slopes the curvature alone says what is about 1
    sizes = [float(np.max(np.abs(values), initial=0.0)) for values in (q, P)]
    cost = 1.0 / max(sizes[0], 1e-12 * sizes[1], 1e-150)
    P, q = cost * P, cost * q
    if relaxed:
        # a violated row may stay violated by the same share as all others
        P[n, n] = 1e-6
        G[:, n] = np.where(bound < 0.0, -out * scale, 0.0)
    lowest = np.concatenate([np.maximum(-1.0, box[0] / radius), np.zeros(relaxed)])
    highest = np.concatenate([np.minimum(1.0, box[1] / radius), np.ones(relaxed)])
    pushing = sign * guess[at] * cost / scale > 1e-6
    optimum = QuadraticProgram(P, q, G, h, lowest, highest).solve(pushing)
    lam = np.zeros(J.shape[0])
    np.add.at(lam, at, sign * optimum.y * scale / cost)
    d = optimum.z[:n]
    return _Step(np.clip(d * radius, *box), float(np.max(part @ d - bound, initial=0.0)), lam)
