"""Ranks of scaled matrices, with the gap that says how far they can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]
RANK_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Rank:
    """Hold a numerical rank.

    Attributes:
        value: Number of singular values above the cut.
        smallest_kept: Smallest singular value that counts [1].
        largest_dropped: Largest singular value that does not count [1].
        cut: Where the line between them is drawn [1].
    """

    value: int
    smallest_kept: float
    largest_dropped: float
    cut: float

    @property
    def gap(self) -> float:
        """Give the smallest value that counts over the largest that does not; inf when none is left."""
        return self.smallest_kept / self.largest_dropped if self.largest_dropped > 0 else np.inf

    @property
    def is_doubtful(self) -> bool:
        """Tell whether the rank hangs on where the cut is drawn: a singular value is within a factor of 100 of it."""
        return (self.value > 0 and self.smallest_kept < 100.0 * self.cut) or self.largest_dropped > 0.01 * self.cut


def compute_rank(matrix: Array, tolerance: float = RANK_TOLERANCE, whole: Array | None = None) -> Rank:
    """Count the singular values above a fraction of the largest one.

    Args:
        matrix: Scaled matrix [1].
        tolerance: Fraction of the largest singular value below which a value counts as zero [1].
        whole: Matrix of which the first is a part, and whose largest singular value is meant: columns that hold
            nothing but round-off then count as zero. The matrix itself when None.

    Returns:
        The rank with the cut and the values on both sides of it.
    """
    if matrix.size == 0:
        return Rank(0, 0.0, 0.0, 0.0)
    values = _singular_values(matrix)
    if whole is None:
        largest = values[0]
    elif values[-1] > tolerance * math.sqrt(np.vdot(whole, whole)):
        largest = values[0]  # all values count: what sums up all of the whole one's is no smaller than its largest
    else:
        largest = np.linalg.norm(whole, 2)
    cut = tolerance * max(float(largest), 1e-300)
    count = int(np.count_nonzero(values > cut))
    kept, dropped = values[:count], values[count:]
    return Rank(count, float(kept[-1]) if count else 0.0, float(dropped[0]) if dropped.size else 0.0, cut)


def _singular_values(matrix: Array) -> Array:
    """Give the singular values, largest first: NumPy's, without what NumPy spends around small matrices."""
    values: Array
    _, values, _, failed = lapack.dgesdd(matrix, compute_uv=0)
    if failed:
        values = np.asarray(np.linalg.svd(matrix, compute_uv=False), dtype=float)
    return values


def independent_rows(matrix: Array, tolerance: float = RANK_TOLERANCE) -> NDArray[np.intp]:
    """Choose rows that span all rows, by QR with column pivoting of the transpose.

    Args:
        matrix: Scaled matrix [1], shape (n_rows, n_columns).
        tolerance: Fraction of the largest pivot below which a row counts as dependent [1].

    Returns:
        Indices of the chosen rows in ascending order; as many as the rank.
    """
    if matrix.size == 0:
        return np.arange(0)
    _, R, order = scipy.linalg.qr(matrix.T, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    count = int(np.count_nonzero(pivots > tolerance * max(pivots[0], 1e-300)))
    return np.sort(order[:count])


def null_space(matrix: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Give an orthonormal basis of the motions that a matrix maps to zero.

    Args:
        matrix: Scaled matrix [1], shape (n_rows, n_columns).
        tolerance: See `compute_rank`.

    Returns:
        The basis, shape (n_columns, n_columns - rank).
    """
    if matrix.shape[0] == 0 or matrix.shape[1] == 0:
        return np.eye(matrix.shape[1])
    _, values, Vt = np.linalg.svd(matrix, full_matrices=True)
    return Vt[int(np.count_nonzero(values > tolerance * max(values[0], 1e-300))) :].T
