"""Bounds on a motion along a path that are linear in the acceleration and the squared speed of its parameter.

Velocities, accelerations, and through the equations of motion forces and tensions, depend on the time law s(t) only in
this way, at a given place of the path.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.planning.path import PathPoints
from paraopt.planning.problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PathRows:
    """Hold bounds `a s'' + b s'^2 + c <= 0` at n places of a path; s' and s'' are derivatives with respect to time.

    Attributes:
        names: What each row bounds, k of them.
        a: Factor of the acceleration of the parameter, shape (n, k).
        b: Factor of its squared speed, shape (n, k).
        c: What is left at rest, shape (n, k); below zero where the bound holds at rest.

    Raises:
        DefinitionError: The shapes do not fit, or a number is not finite.
    """

    names: tuple[str, ...]
    a: Array
    b: Array
    c: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        wanted = (np.shape(self.a)[0] if np.ndim(self.a) else 0, len(self.names))
        for letter in "abc":
            values = np.asarray(getattr(self, letter), dtype=float)
            if values.shape != wanted:
                raise DefinitionError(
                    f"{letter} of the rows {list(self.names)} has shape {values.shape}; it must be {wanted}, one row "
                    "for each place and one column for each name"
                )
            if not np.all(np.isfinite(values)):
                k = int(np.argmin(np.all(np.isfinite(values), axis=0)))
                raise DefinitionError(f"{letter} of the row {self.names[k]!r} is not finite everywhere on the path")
            object.__setattr__(self, letter, values)

    def __call__(self, speed: Array, acceleration: Array) -> Array:
        """Evaluate `a s'' + b s'^2 + c` for speeds and accelerations of shape (n,); shape (n, k)."""
        return np.asarray(self.a * acceleration[:, None] + self.b * speed[:, None] ** 2 + self.c)

    @property
    def count(self) -> int:
        """Give the number of rows at each place."""
        return len(self.names)

    @classmethod
    def none(cls, n: int) -> PathRows:
        """Give no rows at n places."""
        empty = np.zeros((n, 0))
        return cls((), empty, empty, empty)

    @classmethod
    def join(cls, parts: Sequence[PathRows]) -> PathRows:
        """Put rows at the same places side by side."""
        return cls(
            tuple(name for part in parts for name in part.names),
            *[np.hstack([getattr(part, letter) for part in parts]) for letter in "abc"],
        )


class PathConstraint(Protocol):
    """Bound the motion along a path, beyond the limits that the problem states.

    Where the rows are stricter than what is meant, as sides of a polygon in a disc are, a second method `judge` of the
    same form says what a motion is certified by; its points have time as their parameter.
    """

    def rows(self, problem: Problem, points: PathPoints) -> PathRows:
        """Give the bounds at places of a path, whose first and second derivatives are exact."""
        ...


@dataclass(frozen=True)
class RowConstraint:
    """Bound the motion along a path by functions of its points: `a s'' + b s'^2 + c <= 0`.

    Attributes:
        names: What each row bounds.
        function: From n points of the path to a, b and c, each of shape (n, k), or (n,) for one row; numbers and
            vectors of shape (k,) hold everywhere.
    """

    names: Sequence[str]
    function: Callable[[PathPoints], tuple[ArrayLike, ArrayLike, ArrayLike]] = field(repr=False)

    def rows(self, problem: Problem, points: PathPoints) -> PathRows:
        """Evaluate the functions.

        Raises:
            DefinitionError: What they give has another shape than the names ask for, or is not finite.
        """
        names = (self.names,) if isinstance(self.names, str) else tuple(self.names)
        shape = (len(points.s), len(names))

        def fill(values: ArrayLike) -> Array:
            array = np.asarray(values, dtype=float)
            if array.shape == shape[:1] and shape[1] == 1:
                array = array[:, None]
            try:
                return np.array(np.broadcast_to(array, shape))
            except ValueError as error:
                raise DefinitionError(f"rows {list(names)} have shape {array.shape}; it must be {shape}") from error

        a, b, c = (fill(values) for values in self.function(points))
        return PathRows(names, a, b, c)
