"""Iso-conditioning maps: condition numbers of A and B over a grid of operational positions, in one working mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics import Configuration, Determinants, Kinematics
from paraopt.kinematics.conditioning import condition_numbers
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConditioningMap:
    """Hold the condition numbers over a grid.

    Attributes:
        axes: Values of each operational variable [m or rad], in the order of the mechanism.
        X: Configurations [m or rad], nan where the branch does not reach; shape (*grid, n_variables).
        condition_A: Condition number of A [1], nan where not reached; shape of the grid.
        condition_B: Condition number of B [1], same.
    """

    axes: Mapping[str, Array]
    X: Array
    condition_A: Array
    condition_B: Array

    @property
    def is_reached(self) -> NDArray[np.bool_]:
        """Tell which positions of the grid the branch reaches; shape of the grid."""
        return np.isfinite(self.X[..., 0])


def map_conditioning(kinematics: Kinematics, axes: Mapping[str, ArrayLike], start: Configuration) -> ConditioningMap:
    """Compute condition numbers over a grid, on the branch of a configuration.

    The grid is filled as a wave: every position is solved from a neighbour that is solved, and belongs to the map when
    the determinant of [M N] keeps its sign (the working mode). Parallel singularities are crossed.

    Args:
        kinematics: The mechanism's functions.
        axes: Increasing values of every operational variable [m or rad], at least one each.
        start: Configuration whose branch is meant; the wave starts at the position of the grid nearest to it.

    Returns:
        The map.

    Raises:
        DefinitionError: The axes are not those of the operational variables, or not increasing.

    Source: Chablat1998.
    """
    mechanism = kinematics.mechanism
    if set(axes) != set(mechanism.operational):
        raise DefinitionError(
            f"axes of the map are {list(axes)}; they must be the operational variables {list(mechanism.operational)}"
        )
    values = {name: finite_vector(axes[name], None, f"axis {name!r} of the map") for name in mechanism.operational}
    for name, axis in values.items():
        if not axis.size or np.any(np.diff(axis) <= 0):
            raise DefinitionError(f"axis {name!r} of the map must be increasing and not empty; it is {axis.tolist()}")
    shape = tuple(len(v) for v in values.values())
    positions = np.stack(np.meshgrid(*values.values(), indexing="ij"), axis=-1).reshape(-1, len(shape))
    X = _fill(kinematics, positions, shape, start)
    reached = np.isfinite(X[:, 0])
    A, B = np.full(len(X), np.nan), np.full(len(X), np.nan)
    if np.any(reached):
        A[reached], B[reached] = condition_numbers(kinematics, X[reached])
    return ConditioningMap(values, X.reshape(*shape, -1), A.reshape(shape), B.reshape(shape))


def _fill(kinematics: Kinematics, positions: Array, shape: tuple[int, ...], start: Configuration) -> Array:
    """Solve the positions of a grid outwards from a start; shape (n_positions, n_variables), nan where not reached."""
    names = kinematics.mechanism.operational
    scale = kinematics.graph.variable_scale[kinematics.mechanism.indices(names)]
    determinants = Determinants.at(kinematics, start)
    mode = determinants.signs(start.X)[1][0]
    neighbours = _neighbours(shape)
    X = np.full((len(positions), len(start.X)), np.nan)
    tried = np.zeros(len(positions), dtype=bool)
    first = int(np.argmin(np.linalg.norm((positions - start.operational) / scale, axis=1)))
    wave, origins = np.array([first]), start.X[None, :]
    while wave.size:
        tried[wave] = True
        solved = kinematics.solve_batch(names, positions[wave], origins)
        good = solved.converged
        if np.isfinite(mode):
            good = good & (determinants.signs(solved.X)[1] == mode)
        X[wave[good]] = solved.X[good]
        pairs = [(k, i) for i in wave[good] for k in neighbours[i] if not tried[k]]
        chosen = dict(pairs)
        wave = np.array(list(chosen), dtype=int)
        origins = X[list(chosen.values())] if chosen else np.empty((0, X.shape[1]))
    return X


def _neighbours(shape: tuple[int, ...]) -> list[list[int]]:
    """List the neighbours along the axes of every position of a grid."""
    index = np.arange(int(np.prod(shape))).reshape(shape)
    found: list[list[int]] = [[] for _ in range(index.size)]
    for axis in range(len(shape)):
        low = np.take(index, range(shape[axis] - 1), axis=axis).ravel()
        high = np.take(index, range(1, shape[axis]), axis=axis).ravel()
        for a, b in zip(low.tolist(), high.tolist(), strict=True):
            found[a].append(b)
            found[b].append(a)
    return found
