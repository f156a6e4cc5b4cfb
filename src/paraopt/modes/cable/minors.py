"""Facets of many zonotopes at once: minors by dynamic programming, side by side over poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class MinorPlan:
    """Hold the order in which minors are computed, each from smaller ones.

    The minors of order m are taken over sets of rows that are the first m + 1 but one: no others are needed for the
    minors of dof - 1 rows. Each is expanded along the last of its rows, over its columns; that is row m of all sets but
    the last, whose last row is m - 1.

    Attributes:
        columns: Sets of dof - 1 columns, shape (n_pairs, dof - 1).
        steps: For each order from 2 on, the columns of each set, and where the set without each of them is among those
            of the order before, both of shape (order, n_sets).
        others: For each pair, the columns that do not span it, shape (n_pairs, n - dof + 1).
        signs: Signs of the components of a normal, shape (dof,).
    """

    columns: Index
    steps: tuple[tuple[Index, Index], ...]
    others: Index
    signs: Array

    @property
    def n_pairs(self) -> int:
        """Give the number of sets of dof - 1 columns."""
        return len(self.columns)

    def normals(self, W: Array) -> Array:
        """Give the vectors of minors for W of shape (dof, n, k); shape (dof, n_pairs, k)."""
        minors = W[1::-1]  # of order one, as the sets of rows come: without row 0, without row 1
        for columns, without in self.steps:
            order, n_sets = columns.shape
            grown = np.empty((order + 1, n_sets, W.shape[2]))
            smaller = np.empty((order, n_sets, W.shape[2]))
            for i in range(order):
                np.take(minors, without[i], axis=1, out=smaller, mode="clip")
                factor = W[order, columns[i]]
                last = W[order - 1, columns[i]] * smaller[-1]
                np.multiply(smaller, factor, out=smaller)
                if i == 0:
                    first = (-1.0) ** (order - 1)
                    np.multiply(smaller, first, out=grown[:-1])
                    np.multiply(last, first, out=grown[-1])
                elif (order - 1 + i) % 2 == 0:
                    grown[:-1] += smaller
                    grown[-1] += last
                else:
                    grown[:-1] -= smaller
                    grown[-1] -= last
            minors = grown
        return np.asarray(minors * self.signs[:, None, None])

    def evaluate(self, W: Array, low: Array, high: Array, flat: float) -> tuple[Array, Array, Array]:
        """Give unit normals (dof, n_pairs, k) and the largest and least products with wrenches of the cables."""
        c = self.normals(W)
        norms = np.sqrt(np.einsum("dpk,dpk->pk", c, c))
        sizes = np.sqrt(np.einsum("dnk,dnk->nk", W, W))
        is_flat = norms <= flat * np.prod(sizes[self.columns], axis=1)
        c *= np.where(is_flat, 0.0, 1.0 / np.where(is_flat, 1.0, norms))
        upper, lower = np.zeros_like(norms), np.zeros_like(norms)
        for i in range(self.others.shape[1]):
            j = self.others[:, i]
            along = np.einsum("dpk,dpk->pk", c, W[:, j])
            positive = np.maximum(along, 0.0)
            negative = along - positive
            upper += positive * high[j] + negative * low[j]
            lower += positive * low[j] + negative * high[j]
        return c, upper, lower

    def margin(self, W: Array, w: Array, low: Array, high: Array, flat: float) -> Array:
        """Give the least distance over all facets; shape (k,).

        Where the set has no inside it is negative; inf where no columns span a hyperplane.
        """
        c, upper, lower = self.evaluate(W, low, high, flat)
        along = np.einsum("dpk,dk->pk", c, w)
        levels = np.minimum(upper + along, -along - lower)
        is_flat = ~np.any(c, axis=0)
        levels[find_thin(upper, lower, is_flat, float(np.max(high)))] -= loss(float(np.max(high)))
        levels[is_flat] = np.inf
        return np.asarray(np.min(levels, axis=0))


def find_thin(upper: Array, lower: Array, is_flat: NDArray[np.bool_], largest: float) -> NDArray[np.bool_]:
    """Tell between which pairs of facets there is nothing but round-off: the cables do not feel their normal.

    Args:
        upper: Largest products of normals and wrenches [N].
        lower: Least products, same shape.
        is_flat: Which pairs are none, same shape.
        largest: Largest tension [N].
    """
    return np.asarray((upper - lower <= 1e-12 * largest) & ~is_flat)


def loss(largest: float) -> float:
    """Give the margin that is lacking at least where the cables do not feel some direction [N].

    It is a millionth of the largest tension: no solver's tolerance then takes the pose for one that is held.
    """
    return 1e-6 * largest


@lru_cache(maxsize=16)
def plan_minors(dof: int, n: int) -> MinorPlan:
    """Give the order in which the minors of dof - 1 columns of matrices (dof, n) are computed.

    Args:
        dof: Number of rows, at least 2.
        n: Number of columns, at least dof.

    Returns:
        The plan, made once for each size.
    """
    steps = []
    for order in range(2, dof):
        places = {c: i for i, c in enumerate(combinations(range(n), order - 1))}
        sets = list(combinations(range(n), order))
        without = [[places[c[:i] + c[i + 1 :]] for c in sets] for i in range(order)]
        steps.append((np.array(sets).T.copy(), np.array(without)))
    spanning = list(combinations(range(n), dof - 1))
    others = [[j for j in range(n) if j not in s] for s in spanning]
    signs = np.array([(-1.0) ** (dof - 1 + i) for i in range(dof)])
    return MinorPlan(np.array(spanning), tuple(steps), np.array(others), signs)
