"""Geometry of cables: what is left of them without the lengths at their ends, and how their points move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def shorten_segments(A: Array, B: Array, ignore: Array) -> Array:
    """Take from segments the lengths that are not looked at.

    A cable shorter than what is left out shrinks to one point, which parts it in the ratio of the two lengths.

    Args:
        A: First ends [m], shape (..., 3).
        B: Second ends [m], shape (..., 3).
        ignore: Lengths left out at both ends [m], shape (..., 2).

    Returns:
        Ends of what is left [m], shape (..., 2, 3).
    """
    span = B - A
    length = np.linalg.norm(span, axis=-1)
    share = ignore / np.maximum(np.maximum(length, ignore.sum(axis=-1)), 1e-300)[..., None]
    return np.stack([A + share[..., :1] * span, B - share[..., 1:] * span], axis=-2)


def move_witnesses(A: Array, B: Array, dA: Array, dB: Array, ignore: Array, witness: Array) -> Array:
    """Give the motion of the points of cables that are nearest to something.

    The shortened segment has ends `A + a u` and `B - b u` with u the unit vector from A to B. The nearest point keeps
    its share of the shortened segment: what it does along the segment does not change a smallest distance.

    Args:
        A: First ends [m], shape (k, 3).
        B: Second ends [m], shape (k, 3).
        dA: Their derivatives, shape (k, m, 3).
        dB: Idem.
        ignore: Lengths left out [m], shape (k, 2).
        witness: Points on the cables [m], shape (k, 3).

    Returns:
        Derivatives of the points, shape (k, m, 3).
    """
    ends = shorten_segments(A, B, ignore)
    core = ends[:, 1] - ends[:, 0]
    square = np.einsum("kc,kc->k", core, core)
    along = np.einsum("kc,kc->k", witness - ends[:, 0], core)
    share = np.clip(along / np.maximum(square, 1e-300), 0.0, 1.0)
    span = B - A
    length = np.linalg.norm(span, axis=1)
    whole = length > ignore.sum(axis=1)
    u = span / np.maximum(length, 1e-300)[:, None]
    # shrunk to a point: its place is a fixed share of the way
    fixed = ignore[:, 0] / np.maximum(ignore.sum(axis=1), 1e-300)
    share = np.where(whole, share, fixed)
    turn = dB - dA
    turn = turn - np.einsum("kmc,kc->km", turn, u)[:, :, None] * u[:, None, :]
    shift = np.where(whole, (1.0 - share) * ignore[:, 0] - share * ignore[:, 1], 0.0) / np.maximum(length, 1e-300)
    return np.asarray((1.0 - share)[:, None, None] * dA + share[:, None, None] * dB + shift[:, None, None] * turn)
