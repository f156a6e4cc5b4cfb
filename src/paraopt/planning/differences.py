"""Stated derivatives beside differences of what they are derivatives of, though accelerations may jump."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from paraopt.planning.trajectory import Motion

Array = NDArray[np.float64]


def measure_disagreement(
    motion: Motion, t: Array, order: int, values: Array, derivative: Array, unit: Array, bound: float
) -> Array:
    """Tell how far stated derivatives and differences disagree at every sample.

    Every difference must lie among the stated values around it, and every stated value among the differences around
    it. Where several jumps of the acceleration within a few samples confuse this, a closer look decides.

    Args:
        motion: The motion, called again for the closer looks.
        t: Times, equally spaced [s], shape (n,), n >= 5.
        order: Order of the stated derivative, 1 or 2.
        values: What is differenced, shape (n, k).
        derivative: What is stated, shape (n, k).
        unit: What disagreements are divided by, shape (k,).
        bound: Where a disagreement begins to matter [1].

    Returns:
        Disagreements [1], shape (n, k); inf where a value is not a number.
    """
    measured = np.diff(values, axis=0) / float(t[1])
    ahead, behind = 2.0 * measured[:1] - measured[1:2], 2.0 * measured[-1:] - measured[-2:-1]
    between = _outside(_around(derivative, derivative[[0, -1]]), measured) / unit
    at_samples = _outside(_around(np.vstack([ahead, measured, behind]), measured[[0, -1]]), derivative) / unit
    _settle(between, bound, lambda at: _look_inside(motion, t, at, order, measured) / unit)
    _settle(at_samples, bound, lambda at: _look_beside(motion, t, at, order - 1, derivative) / unit)
    return np.maximum(np.vstack([between, between[-1:]]), at_samples)


def _around(values: Array, ends: Array) -> Array:
    """Give the four values around every gap between n values: two before and two after; shape (4, n - 1, k).

    Args:
        values: Values, shape (n, k).
        ends: What stands before the first and after the last, shape (2, k).
    """
    padded = np.vstack([ends[:1], values, ends[1:]])
    return np.stack([padded[:-3], padded[1:-2], padded[2:-1], padded[3:]])


def _outside(window: Array, values: Array) -> Array:
    """Tell how far values lie outside the span of those around them.

    Accelerations may jump inside an interval, so a value is compared with a span and not with a mean.

    Args:
        window: Values around each, shape (w, n, k).
        values: Values, shape (n, k).

    Returns:
        Distances from the spans, shape (n, k); inf where a value is not a number.
    """
    gap = np.maximum(window.min(axis=0) - values, values - window.max(axis=0))
    return np.where(np.isnan(gap), np.inf, np.maximum(gap, 0.0))


def _settle(gap: Array, bound: float, look: Callable[[NDArray[np.intp]], Array], block: int = 20) -> None:
    """Look closer at the rows that break a bound, the worst first, until one stands or all are cleared.

    Args:
        gap: What is judged, shape (n, k); corrected in place. Infinite values are left: nothing can clear them.
        bound: Upper bound.
        look: Gives better values of some rows.
        block: Number of rows that are looked at together.
    """
    worst = np.max(gap, axis=1, initial=0.0)
    suspects = np.flatnonzero((worst > bound) & np.isfinite(worst))
    suspects = suspects[np.argsort(-worst[suspects], kind="stable")]
    for start in range(0, len(suspects), block):
        rows = suspects[start : start + block]
        gap[rows] = np.minimum(gap[rows], look(rows))
        if np.max(gap[rows]) > bound:
            break


def _look_inside(motion: Motion, t: Array, at: NDArray[np.intp], order: int, measured: Array) -> Array:
    """Compare differences over a few intervals with means of what is stated inside them.

    Args:
        motion: The motion.
        t: Times of all samples [s], shape (n,).
        at: Intervals to look at, shape (s,).
        order: Order of the stated derivative.
        measured: Difference quotients of all intervals, shape (n - 1, k).

    Returns:
        Distances of the quotients from the range of the means, shape (s, k).
    """
    times = t[at, None] + (t[at + 1] - t[at])[:, None] * np.linspace(0.0, 1.0, 51)
    stated = np.asarray(motion(times.reshape(-1), order), dtype=float).reshape(*times.shape, -1)
    sides = np.stack([stated[:, :-1], stated[:, 1:]])  # between two instants a jump may come early or late
    means = np.stack([np.mean(sides.min(axis=0), axis=1), np.mean(sides.max(axis=0), axis=1)])
    return _outside(means, measured[at])


def _look_beside(motion: Motion, t: Array, at: NDArray[np.intp], order: int, stated: Array) -> Array:
    """Compare derivatives stated at a few samples with differences over times a hundred times closer.

    Args:
        motion: The motion.
        t: Times of all samples [s], shape (n,).
        at: Samples to look at, shape (s,).
        order: Order of what is differenced.
        stated: Stated derivatives of all samples, shape (n, k).

    Returns:
        Distances of the stated values from the span of the differences around them, shape (s, k).
    """
    step = 0.01 * float(t[1])
    centres = np.clip(t[at], t[0] + 2.0 * step, t[-1] - 2.0 * step)
    times = centres[:, None] + step * np.arange(-2, 3)
    values = np.asarray(motion(times.reshape(-1), order), dtype=float).reshape(*times.shape, -1)
    measured = np.diff(values, axis=1) / step
    ends = 2.0 * measured[:, [0, -1]] - measured[:, [1, -2]]  # at the ends of the motion one side must do
    return _outside(np.concatenate([measured, ends], axis=1).transpose(1, 0, 2), stated[at])
