"""Models on arrays: many poses at once, each row with a status of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.functions import FunctionSet
from paraopt.kinematics.ranks import RANK_TOLERANCE
from paraopt.kinematics.solve import SolveOptions, Status, solve_closure
from paraopt.kinematics.xfkm import Question

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BatchSolution:
    """Hold the answers of a model for n rows.

    Attributes:
        X: Final values [m or rad], shape (n, n_variables).
        status: How each row ended, `Status` by row, shape (n,).
        residual: Largest scaled closure residual of each row [1], shape (n,); inf where the input is not finite.
        undetermined: Motions that the imposed variables leave free, beyond idle ones, shape (n,).
        distance: Weighted distance between imposed and obtained values, in characteristic lengths and radians [1],
            shape (n,); zero where the values are met.
    """

    X: Array
    status: NDArray[np.object_]
    residual: Array
    undetermined: NDArray[np.intp]
    distance: Array

    @property
    def is_exact(self) -> NDArray[np.bool_]:
        """Tell which rows meet the imposed values, shape (n,)."""
        return (self.status == Status.CONVERGED) | (self.status == Status.SINGULAR)

    def count(self, status: Status) -> int:
        """Count the rows of one status."""
        return int(np.count_nonzero(self.status == status))


def answer_exactly(question: Question, values: Array, starts: Array) -> BatchSolution:
    """Impose the same variables on n rows; rows that cannot meet their values are FAILED.

    Args:
        question: Variables that are imposed, and tolerances; its values are not used.
        values: Imposed values [m or rad], shape (n, n_imposed); rows that are not finite fail.
        starts: Starts [m or rad], shape (n, n_variables).

    Returns:
        The answers.
    """
    X = np.array(starts)
    X[:, question.index] = values
    closed = solve_closure(question.functions, X, question.free, question.options)
    status = np.full(len(X), Status.FAILED, dtype=object)
    undetermined = np.zeros(len(X), dtype=int)
    good = closed.converged
    if np.any(good):
        undetermined[good], mobility = _count_undetermined(question, closed.X[good])
        lost = np.zeros(len(X), dtype=bool)
        lost[good] = undetermined[good] > np.maximum(mobility - len(question.index), 0)
        status[good], status[lost] = Status.CONVERGED, Status.SINGULAR
    return BatchSolution(closed.X, status, closed.residual, undetermined, np.where(good, 0.0, np.nan))


def answer_nearest(question: Question, values: Array, starts: Array) -> BatchSolution:
    """Bring n rows as near to their imposed values as closures and joint ranges allow (XFKM).

    Args:
        question: Variables that are imposed, their weights, and tolerances; its values are not used.
        values: Imposed values [m or rad], shape (n, n_imposed); rows that are not finite fail.
        starts: Starts [m or rad], shape (n, n_variables).

    Returns:
        The answers.
    """
    exact = answer_exactly(question, values, starts)
    X, status, residual = exact.X.copy(), exact.status.copy(), exact.residual.copy()
    undetermined, distance = exact.undetermined.copy(), exact.distance.copy()
    lower, upper = question.ranges
    met = exact.is_exact & np.all((lower - 1e-9 <= X) & (upper + 1e-9 >= X), axis=1)
    finite = np.all(np.isfinite(values), axis=1) & np.all(np.isfinite(starts), axis=1)
    rows = np.flatnonzero(finite & ~met)
    if not rows.size:
        return exact
    functions, index, scale = question.functions, question.index, question.functions.graph.variable_scale
    closed = solve_closure(functions, starts[rows], np.ones(X.shape[1]), question.options)
    inside = closed.converged & np.all((lower <= closed.X) & (upper >= closed.X), axis=1)
    target = np.zeros_like(closed.X)
    target[:, index] = values[rows]
    weight = np.zeros(X.shape[1])
    weight[index] = list(question.weights.values())
    found, settled = closed.X, np.zeros(len(rows), dtype=bool)
    found[inside], settled[inside] = _approach(
        functions, found[inside], target[inside], weight, lower, upper, question.options
    )
    X[rows], residual[rows] = found, solve_closure(functions, found, np.zeros(X.shape[1]), question.options).residual
    status[rows] = np.where(settled, Status.NEAREST, Status.FAILED)  # type: ignore[call-overload]
    # few: the start is open or outside the ranges, or the steps did not settle
    for k in np.flatnonzero(~settled):
        imposed = dict(zip(question.impose, values[rows[k]].tolist(), strict=True))
        answer = replace(question, impose=imposed).answer(starts[rows[k]][None, :].copy())
        X[rows[k]], status[rows[k]], residual[rows[k]] = answer.X, answer.status, answer.residual
    distance[rows] = np.linalg.norm(weight[index] * (X[rows][:, index] - values[rows]) / scale[index], axis=1)
    reached = rows[(distance[rows] < 1e-9) & (status[rows] == Status.NEAREST)]
    status[reached] = Status.CONVERGED
    undetermined[rows], _ = _count_undetermined(question, X[rows])
    return BatchSolution(X, status, residual, undetermined, distance)


def _count_undetermined(question: Question, X: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Count the motions that the imposed variables leave free, and the mobility, by row; idle ones are not counted."""
    (E,) = question.functions.scaled_jacobian.batch(X)
    largest = np.asarray(np.linalg.norm(E, 2, axis=(1, 2)), dtype=float) if E.size else np.zeros(len(X))
    counts = []
    for columns in (question.used & (question.free > 0), question.used):
        values = np.linalg.svd(E[:, :, columns], compute_uv=False) if np.any(columns) else np.zeros((len(X), 0))
        rank = np.count_nonzero(values > RANK_TOLERANCE * np.maximum(largest, 1e-300)[:, None], axis=1)
        counts.append(np.count_nonzero(columns) - rank)
    return counts[0], counts[1]


def _approach(
    functions: FunctionSet,
    X: Array,
    target: Array,
    weight: Array,
    lower: Array,
    upper: Array,
    options: SolveOptions,
) -> tuple[Array, NDArray[np.bool_]]:
    """Move n closed configurations as near to wanted values as closures and ranges allow, all at once.

    `minimise 1/2 sum w_i^2 (X_i - target_i)^2 / s_i^2` by Newton steps in the motions that closures and active ranges
    leave, with the second derivatives of the Lagrangian; each step is cut where a variable meets the end of its range,
    and the loops are closed after it. Ranges become active where a step meets them, and are left when their multiplier
    pushes inwards.

    Args:
        functions: Functions of the mechanism.
        X: Closed configurations within the ranges [m or rad], shape (n, n_variables).
        target: Wanted values, shape (n, n_variables); entries of zero weight are ignored.
        weight: Weight of each variable [1], shape (n_variables,).
        lower: Lowest values, may be -inf.
        upper: Highest values, may be inf.
        options: Tolerances; `nearest_iterations` and `nearest_tolerance` apply.

    Returns:
        The final values, and which rows settled at a stationary point within the ranges.
    """
    scale = functions.graph.variable_scale
    low, high = lower / scale, upper / scale
    wanted = np.where(weight > 0, target, 0.0) / scale
    n, width = X.shape
    z, settled, everything = X / scale, np.zeros(n, dtype=bool), np.ones(width)
    held = np.zeros((n, width), dtype=bool)
    shift = np.full(n, 1e-9)  # keeps the steps' matrix positive; grows where a step did not help
    waiting = np.arange(n)
    for _ in range(options.nearest_iterations):
        if not waiting.size:
            break
        here = z[waiting]
        (E,) = functions.scaled_jacobian.batch(here * scale)
        gradient = weight**2 * (here - wanted[waiting])
        rows = np.concatenate([E, held[waiting][:, :, None] * np.eye(width)], axis=1)
        inverse = np.linalg.pinv(rows, rcond=RANK_TOLERANCE)
        multipliers = -(inverse.transpose(0, 2, 1) @ gradient[:, :, None])[:, :, 0]
        # a range whose multiplier pulls inwards is left
        push = multipliers[:, E.shape[1] :]
        inwards = held[waiting] & (np.where(here - low < high - here, -push, push) < -1e-12)
        if np.any(inwards):
            held[waiting] &= ~inwards
            rows = np.concatenate([E, held[waiting][:, :, None] * np.eye(width)], axis=1)
            inverse = np.linalg.pinv(rows, rcond=RANK_TOLERANCE)
            multipliers = -(inverse.transpose(0, 2, 1) @ gradient[:, :, None])[:, :, 0]
        project = np.eye(width) - inverse @ rows
        (curvature,) = functions.closure_hessian.batch(here * scale, multipliers[:, : E.shape[1]])
        R = project @ (np.diag(weight**2) + curvature) @ project + (np.eye(width) - project)
        R = 0.5 * (R + R.transpose(0, 2, 1))
        lift = np.maximum(0.0, 1e-6 - np.linalg.eigvalsh(R)[:, 0]) + shift[waiting]
        reduced = project @ gradient[:, :, None]
        step = -(project @ np.linalg.solve(R + lift[:, None, None] * np.eye(width), reduced))[:, :, 0]
        # what is held returns to the end of its range, from which closing the loops has moved it
        end = np.where(here - low < high - here, low, high)
        drift = np.where(held[waiting], here - np.where(held[waiting], end, 0.0), 0.0)
        step -= (inverse[:, :, E.shape[1] :] @ drift[:, :, None])[:, :, 0]
        size = np.max(np.abs(step), axis=1, initial=0.0)
        step *= np.minimum(1.0, options.step_limit / np.maximum(size, 1e-300))[:, None]
        room = np.where(step > 0, high - here, np.where(step < 0, low - here, np.inf))
        share = np.where(held[waiting] | (np.abs(step) < 1e-15), np.inf, room / np.where(step == 0, 1.0, step))
        first = np.argmin(share, axis=1)
        cut = np.clip(share[np.arange(len(waiting)), first], 0.0, 1.0)
        trial = here + cut[:, None] * step
        closed = solve_closure(functions, trial * scale, everything, options)
        there = closed.X / scale
        inside = np.all((there >= low - 1e-7) & (there <= high + 1e-7), axis=1)
        old, new = (0.5 * np.sum((weight * (p - wanted[waiting])) ** 2, axis=1) for p in (here, there))
        good = closed.converged & inside & (new <= old + 1e-14)
        z[waiting[good]] = np.clip(there[good], low, high)
        met = waiting[good & (cut < 1.0)]
        blocking = first[good & (cut < 1.0)]
        gap = np.minimum(z[met, blocking] - low[blocking], high[blocking] - z[met, blocking])
        held[met, blocking] |= gap < 1e-6  # closing the loops may have moved it away again
        shift[waiting[good]] = np.maximum(shift[waiting[good]] * 0.1, 1e-9)
        shift[waiting[~good]] = np.maximum(shift[waiting[~good]] * 100.0, 1e-4)
        still = np.max(np.abs(reduced[:, :, 0]), axis=1, initial=0.0) < options.nearest_tolerance
        done = still & ~np.any(inwards, axis=1) & (np.max(np.abs(drift), axis=1, initial=0.0) < 1e-7)
        settled[waiting[done]] = True
        lost = shift[waiting] > 1e8
        waiting = waiting[~done & ~lost]
    return z * scale, settled
