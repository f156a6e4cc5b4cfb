"""The joints of a platform whose pose and drives are known: each leg closes by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.legs import find_legs
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.multistart import SearchOptions, bound_starts, close_rows
from paraopt.kinematics.platform import passive_coordinates
from paraopt.kinematics.postures import PostureReader, turn_towards

Array = NDArray[np.float64]


def close_legs(
    kinematics: Kinematics,
    X: Array,
    target: Array,
    options: SearchOptions,
    reader: PostureReader | None = None,
    tries: int = 16,
) -> Array:
    """Find, for given drives and poses, the passive joints that are nearest to a target.

    With drives and coordinates of free links imposed the equations fall apart into legs. Each is started at the target
    and from a few other places; of what closes, joints within their ranges come first, then the nearest.

    Args:
        kinematics: The mechanism's functions.
        X: Drives and poses, and any other values, shape (n, n_variables).
        target: Values to be near to, shape (n_variables,).
        options: Tolerances of the solves.
        reader: When given, X is closed, and only the angles may change, not the posture.
        tries: Number of starts for each leg.

    Returns:
        The values with the joints of the legs; those of a leg that does not close are left as they are, shape
        (n, n_variables).
    """
    mechanism = kinematics.mechanism
    n = len(X)
    random = np.random.default_rng(options.seed)
    # a pose may be far away, and a leg is small: long steps do no harm
    far = replace(options, step_limit=max(options.step_limit, 30.0))
    X = turn_towards(kinematics, X, target)
    marks = None if reader is None else reader(X)
    low, high = (np.array([v.range[k] for v in mechanism.variables]) for k in (0, 1))
    for leg in find_legs(kinematics.graph, [*mechanism.active, *passive_coordinates(kinematics)]):
        columns = np.array(mechanism.indices(leg.variables), dtype=int)
        free = np.zeros(X.shape[1])
        free[columns] = 1.0
        a, b = bound_starts(mechanism, X[0], columns)
        starts = a + (b - a) * random.random((tries, len(columns)))
        starts[0] = target[columns]
        rows = np.repeat(X, tries, axis=0)
        rows[:, columns] = np.tile(starts, (n, 1))
        closed, residual = close_rows(kinematics, rows, free, leg.rows, far)
        closed = turn_towards(kinematics, closed, target)
        # the poses are exact to round-off of their own: closed is what is near enough to be polished with them
        good = residual <= max(1e-7, options.tolerance)
        if marks is not None and reader is not None:
            good &= np.max(np.abs(reader(closed) - np.repeat(marks, tries, axis=0)), axis=1) < options.merge_distance
        part = closed[:, columns]
        outside = np.sum((part < low[columns] - 1e-9) | (part > high[columns] + 1e-9), axis=1)
        distance = np.linalg.norm((part - target[columns]) / kinematics.graph.variable_scale[columns], axis=1)
        cost = np.where(good, distance + 1e6 * outside, np.inf).reshape(n, tries)
        best = np.argmin(cost, axis=1)
        found = np.isfinite(cost[np.arange(n), best])
        X[np.ix_(found, columns)] = part.reshape(n, tries, -1)[found, best[found]]
    return X
