"""Ways out: the motion along which a singular value grows fastest, also where several singular values agree.

A singular value that stands alone has a gradient. Symmetric poses and multiple singularities have several that agree:
then the smallest of them counts, whichever that is, and it has no gradient but a fastest direction all the same.

With U and W the singular vectors of the values that agree, and `P(d) = U^T dA(d) W` along a motion d, the values split
to first order as the eigenvalues of the symmetric part of P(d), or, from zero, as the singular values of P(d).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Agreeing:
    """Hold the singular values of a matrix that agree with one of them.

    Attributes:
        value: The singular value [1]; 0 where it is below the tolerance.
        left: Left vectors, shape (n_rows, c); where the value is zero all that the matrix does not reach.
        right: Right vectors, shape (n_columns, c or other); where the value is zero all that it maps to zero.
        count: How many values agree; where they are zero how many ranks are lost.
    """

    value: float
    left: Array
    right: Array
    count: int

    @property
    def is_zero(self) -> bool:
        """Tell whether the values are zero, hence can only grow."""
        return self.value == 0.0


def find_agreeing(matrix: Array, place: int, zero: float, spread: float = 3e-7) -> Agreeing:
    """Find the singular values that agree with one of a matrix.

    Args:
        matrix: Scaled matrix [1].
        place: Which singular value, the largest being number 1; as a rule the general rank of the matrix.
        zero: Value below which it counts as zero [1].
        spread: Difference within which values agree [1]: more than what the tolerance of closing the loops leaves of a
            symmetry.

    Returns:
        The values and their vectors.
    """
    U, values, Vt = np.linalg.svd(matrix, full_matrices=True)
    value = float(values[place - 1])
    if value < zero:
        kept = int(np.count_nonzero(values[:place] >= zero))
        return Agreeing(0.0, U[:, kept:], Vt[kept:].T, place - kept)
    first = int(np.argmax(values[:place] - value <= spread))
    return Agreeing(value, U[:, first:place], Vt[first:place].T, place - first)


def find_fastest(P: Array, agreeing: Agreeing) -> tuple[Array, float, Array]:
    """Find the motion along which the smallest of some singular values grows fastest.

    Args:
        P: `U^T dA W` for unit steps along each of m motions, shape (m, c, c or other).
        agreeing: The values.

    Returns:
        Direction among the motions, shape (m,), of length one; growth along it [1], not above zero where the value
        grows along none; and what becomes of `right` there: the combination of the right vectors that belongs to the
        smallest value, shape (n,).
    """
    if not P.size:
        return np.zeros(len(P)), 0.0, np.eye(P.shape[2])[0]
    if not agreeing.is_zero:
        d, rate = _raise_smallest_eigenvalue(P)
        return d, rate, np.linalg.eigh(_symmetric(np.tensordot(d, P, axes=1)))[1][:, 0]
    k = agreeing.count
    best, d_best = -1.0, np.zeros(len(P))
    for start in _starts(P):
        d, rate = start, -1.0
        for _ in range(200):
            # the polar factor of the largest k values turns the growth into that of an eigenvalue, from below
            U, values, Vt = np.linalg.svd(np.tensordot(d, P, axes=1))
            if values[k - 1] <= rate * (1 + 1e-12):
                break
            rate = float(values[k - 1])
            d = _raise_smallest_eigenvalue(U[:, :k].T @ P @ Vt[:k].T)[0]
        if rate > best:
            best, d_best = rate, d
    U, values, Vt = np.linalg.svd(np.tensordot(d_best, P, axes=1))
    return d_best, float(values[k - 1]), Vt[k - 1]


def find_fastest_on_branches(Q: Array) -> tuple[Array, float]:
    """Find the motion along which a lost constraint comes back fastest.

    Where the closures lose one rank, their second-order terms `d^T Q d = 0` choose the motions that really exist among
    those that the first order allows; the singular value grows by `|Q d|` along them. With the weights of d in the
    eigenvectors of Q this is a linear program, solved by the largest and the smallest eigenvalue.

    Args:
        Q: Second-order terms along m motions, symmetric, shape (m, m).

    Returns:
        Direction among the motions, shape (m,), and the growth; zero where only higher orders decide.
    """
    values, vectors = np.linalg.eigh(_symmetric(Q))
    low, high = float(values[0]), float(values[-1])
    if not low < 0 < high:
        return np.zeros(len(Q)), 0.0
    d = np.sqrt(-low / (high - low)) * vectors[:, -1] + np.sqrt(high / (high - low)) * vectors[:, 0]
    return d, float(np.sqrt(-low * high))


def _symmetric(P: Array) -> Array:
    return 0.5 * (P + np.swapaxes(P, -1, -2))


def _starts(P: Array) -> list[Array]:
    """Give directions from which to climb: those of the largest entries of P, and some random ones."""
    random = np.random.default_rng(0)
    flat = P.reshape(len(P), -1)
    found = [*np.linalg.svd(flat, full_matrices=False)[0].T[:4], *random.normal(size=(8, len(P)))]
    return [d / np.linalg.norm(d) for d in found]


def _raise_smallest_eigenvalue(P: Array) -> tuple[Array, float]:
    """Find the direction d of length one with the largest smallest eigenvalue of the symmetric part of P(d).

    It is a concave problem; its dual is the shortest vector `g_j = <P_j, R>` over the matrices R >= 0 of trace one.
    """
    S = _symmetric(P)
    c = S.shape[1]
    if c == 1:
        g = S[:, 0, 0]
    else:

        def dual(entries: Array) -> tuple[float, Array]:
            L = entries.reshape(c, c)
            R = L @ L.T
            size = float(np.trace(R))
            g = np.tensordot(S, R / size, axes=2)
            slope = np.tensordot(g, S, axes=1)  # of |g|^2 / 2 along R / size
            along = 2.0 * (slope @ L) / size - (2.0 * np.sum(slope * R) / size**2) * L
            return 0.5 * float(g @ g), along.ravel()

        scale = max(float(np.max(np.abs(S))), 1e-300)
        S = S / scale
        start = np.eye(c) + 0.1 * np.random.default_rng(0).normal(size=(c, c))
        found = scipy.optimize.minimize(
            dual, start.ravel(), jac=True, method="BFGS", options={"gtol": 1e-12, "maxiter": 500}
        )
        L = found.x.reshape(c, c)
        R = L @ L.T
        g = np.tensordot(S, R / np.trace(R), axes=2)
        S = S * scale
    length = float(np.linalg.norm(g))
    if length == 0.0:
        return np.zeros(len(S)), 0.0
    d = g / length
    return d, float(np.linalg.eigvalsh(np.tensordot(d, S, axes=1))[0])
