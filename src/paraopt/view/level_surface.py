"""Where quantities of a problem vanish in the space of its coordinates: levels on a grid, and their zero surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from paraopt.planning import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Levels:
    """Hold what a problem bounds at the nodes of a grid; nan where the closures do not hold.

    Attributes:
        axes: Values of each coordinate [m or rad].
        determinant: Normalised determinant of [N K] [1]; zero at parallel singularities.
        clearance: Smallest distance less the margin [m]; zero where a solid is as near as is allowed.
    """

    axes: tuple[Array, ...]
    determinant: Array
    clearance: Array


def sample_levels(problem: Problem, low: Array, high: Array, counts: Sequence[int]) -> Levels:
    """Sample a problem's bounds on a grid, in a wave that spreads from the start on its branch.

    Args:
        problem: The problem.
        low: Least values of the coordinates [m or rad], shape (m,).
        high: Largest values, shape (m,).
        counts: Number of nodes along each coordinate.

    Returns:
        The levels.
    """
    axes = tuple(np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True))
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    X = np.full((len(nodes), len(problem.robot.mechanism.names)), np.nan)
    start = problem.start_configuration.X
    first = int(np.argmin(np.linalg.norm((nodes - start[problem.index]) * problem.metric, axis=1)))
    shape = tuple(len(axis) for axis in axes)
    strides = np.array([int(np.prod(shape[k + 1 :])) for k in range(len(shape))])
    place = np.stack(np.unravel_index(np.arange(len(nodes)), shape), axis=-1)
    tried = np.zeros(len(nodes), dtype=bool)
    front, origins = np.array([first]), start[None, :]
    while front.size:
        tried[front] = True
        T = problem.space.tangent(origins)
        predicted = origins + np.einsum("nvm,nm->nv", T, nodes[front] - origins[:, problem.index])
        closed = problem.robot.kinematics.solve_batch(problem.independent, nodes[front], predicted)
        good = front[closed.converged]
        X[good] = closed.X[closed.converged]
        fresh: dict[int, int] = {}
        for axis, stride in enumerate(strides):
            for sign in (-1, 1):
                inside = (place[good, axis] + sign >= 0) & (place[good, axis] + sign < shape[axis])
                for here, there in zip(good[inside].tolist(), (good[inside] + sign * stride).tolist(), strict=True):
                    if not tried[there]:
                        fresh.setdefault(there, here)
        front, origins = np.array(list(fresh), dtype=int), X[list(fresh.values())]
    solved = np.flatnonzero(~np.isnan(X[:, 0]))
    determinant, clearance = np.full(len(nodes), np.nan), np.full(len(nodes), np.nan)
    determinant[solved] = problem.determinants(X[solved])[0]
    clearance[solved] = problem.scene.clearances(X[solved])[0] - problem.margins.clearance
    return Levels(axes, determinant.reshape(shape), clearance.reshape(shape))


def trace_zero_surface(axes: Sequence[Array], values: Array) -> Array:
    """Find where values on a grid vanish: each cell is cut into six tetrahedra, each of them by a plane.

    Args:
        axes: Values of the three coordinates.
        values: Values at the nodes, shape (n1, n2, n3); cells with a value that is not finite are left out.

    Returns:
        Triangles, shape (k, 3, 3).
    """
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    triangles: list[Array] = []
    cells = tuple(n - 1 for n in values.shape)
    for order in permutations(range(3)):
        # a way along three edges of the cell, from its first to its last corner
        corner = np.zeros(3, dtype=int)
        corners = [corner.copy()]
        for axis in order:
            corner[axis] = 1
            corners.append(corner.copy())
        parts = [tuple(slice(int(c[k]), int(c[k]) + cells[k]) for k in range(3)) for c in corners]
        f = np.stack([values[part].ravel() for part in parts], axis=1)
        p = np.stack([nodes[part].reshape(-1, 3) for part in parts], axis=1)
        keep = np.all(np.isfinite(f), axis=1) & np.any(f > 0, axis=1) & np.any(f <= 0, axis=1)
        triangles += _cut_tetrahedra(f[keep], p[keep])
    return np.concatenate(triangles) if triangles else np.zeros((0, 3, 3))


def _cut_tetrahedra(f: Array, p: Array) -> list[Array]:
    """Cut tetrahedra whose corners have values of both signs."""
    above = f > 0
    pieces: list[Array] = []

    def crossing(rows: NDArray[np.intp], i: int, j: int) -> Array:
        share = f[rows, i] / (f[rows, i] - f[rows, j])
        return np.asarray(p[rows, i] + share[:, None] * (p[rows, j] - p[rows, i]))

    for alone in range(4):  # one corner on one side
        others = [k for k in range(4) if k != alone]
        rows = np.flatnonzero(np.all(above[:, others] != above[:, [alone]], axis=1))
        pieces.append(np.stack([crossing(rows, alone, k) for k in others], axis=1))
    for i, j in combinations(range(4), 2):  # two corners on each side; each split once
        if i != 0:
            continue
        k, m = (n for n in range(4) if n not in (i, j))
        rows = np.flatnonzero(
            (above[:, i] == above[:, j]) & (above[:, k] == above[:, m]) & (above[:, i] != above[:, k])
        )
        a, b, c, d = (crossing(rows, *edge) for edge in ((i, k), (i, m), (j, m), (j, k)))
        pieces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return [piece for piece in pieces if len(piece)]
