"""A path of imposed values: a function of s in [0, 1], or waypoints joined by straight lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics.configuration import Configuration
from paraopt.mechanism import Mechanism

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ImposedPath:
    """Give imposed values along a path.

    Attributes:
        names: Imposed variables.
        function: From s in [0, 1] to their values [m or rad], shape (n_imposed,).
        corners: Places where the path may turn sharply, ascending, the last one being 1; shape (n,).
    """

    names: tuple[str, ...]
    function: Callable[[float], Array]
    corners: Array

    def __call__(self, s: float) -> Array:
        return self.function(s)

    def next_corner(self, s: float) -> float:
        """Give the first corner after s."""
        return float(self.corners[min(int(np.searchsorted(self.corners, s, side="right")), len(self.corners) - 1)])


def read_path(mechanism: Mechanism, start: Configuration, path: Any, names: Sequence[str] | None) -> ImposedPath:
    """Read a path of imposed values.

    Args:
        mechanism: The mechanism.
        start: Where the path begins.
        path: A function of s, or waypoints by name.
        names: Names for a function that gives arrays.

    Returns:
        The path.

    Raises:
        UnknownNameError: A name does not exist.
        DefinitionError: The path is neither, or its values do not fit its names.
    """
    if isinstance(path, Mapping):
        return _join_waypoints(mechanism, start, path)
    if not callable(path):
        raise DefinitionError(f"path is {path!r}; it must be a function of s, or waypoints by name")
    first = path(0.0)
    if isinstance(first, Mapping):
        names = tuple(first)
    elif names is None:
        raise DefinitionError("path gives values without names; state `names`, or give values by name")
    _check_names(mechanism, names)
    order = tuple(names)

    def evaluate(s: float) -> Array:
        values = path(s)
        if isinstance(values, Mapping):
            if set(values) != set(order):
                raise DefinitionError(f"path imposes {list(values)} at s = {s:.6g}, but {list(order)} at s = 0")
            values = [values[name] for name in order]
        try:
            array = np.array(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise DefinitionError(f"path gives {values!r} at s = {s:.6g}; it must give numbers") from error
        if array.shape != (len(order),):
            raise DefinitionError(f"path gives shape {array.shape} at s = {s:.6g}; its names are {list(order)}")
        return array

    _ = evaluate(0.0)
    return ImposedPath(order, evaluate, np.array([1.0]))


def _join_waypoints(mechanism: Mechanism, start: Configuration, waypoints: Mapping[str, Any]) -> ImposedPath:
    names = tuple(waypoints)
    _check_names(mechanism, names)
    try:
        columns = [np.atleast_1d(np.array(waypoints[name], dtype=float)) for name in names]
    except (TypeError, ValueError) as error:
        raise DefinitionError(f"waypoints are {dict(waypoints)!r}; they must be numbers or lists of numbers") from error
    sizes = {column.shape for column in columns}
    if len(sizes) > 1 or len(next(iter(sizes))) != 1 or not columns[0].size:
        raise DefinitionError(f"waypoints have shapes {sorted(sizes)}; each variable needs as many as the others")
    points = np.array(columns).T
    here = np.array([start[name] for name in names])
    if len(points) == 1 or not np.allclose(points[0], here, rtol=1e-9, atol=1e-9 * mechanism.length):
        points = np.vstack([here, points])
    knots = np.linspace(0.0, 1.0, len(points))

    def evaluate(s: float) -> Array:
        k = min(int(np.searchsorted(knots, s, side="right")), len(knots) - 1)
        share = (s - knots[k - 1]) / (knots[k] - knots[k - 1])
        return np.asarray((1.0 - share) * points[k - 1] + share * points[k])

    return ImposedPath(names, evaluate, knots[1:])


def _check_names(mechanism: Mechanism, names: Sequence[str]) -> None:
    if not len(names):
        raise DefinitionError("path imposes nothing; name at least one variable")
    _ = mechanism.indices(names)
    if len(set(names)) != len(names):
        raise DefinitionError(f"path imposes {list(names)}: one variable is doubled")
