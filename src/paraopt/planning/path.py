"""A path: a spline in the independent coordinates; everything else follows from the closures at every point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline

from paraopt.errors import DefinitionError, SolveError
from paraopt.kinematics import MotionSpace, SolveOptions
from paraopt.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PathPoints:
    """Hold a path and its derivatives at n parameters.

    Attributes:
        s: Parameters in [0, 1], shape (n,).
        X: Values of all variables, shape (n, n_variables).
        dX: First derivatives with respect to s.
        ddX: Second derivatives with respect to s.
        T: Motions `dX / d independent`, shape (n, n_variables, m).
    """

    s: Array
    X: Array
    dX: Array
    ddX: Array
    T: Array


@dataclass(frozen=True, eq=False)
class Path:
    """Describe a geometric path of a robot over s in [0, 1].

    Calling it gives values or derivatives of *all* variables: the independent ones from the spline, the others by
    solving the closures, and their derivatives by the implicit-function theorem. Closure thus holds at every point.

    Attributes:
        robot: The machine.
        independent: Names of the independent coordinates, one for each column of the spline.
        spline: The spline over [0, 1].
        anchors: Parameters at which the configuration is known, ascending from 0 to 1, shape (k,).
        anchor_X: Closed configurations there, on one branch, shape (k, n_variables).
        held: Names of the variables that keep the values of the first anchor all along.
    """

    robot: Robot
    independent: Sequence[str]
    spline: BSpline
    anchors: Array
    anchor_X: Array
    held: Sequence[str] = ()

    @classmethod
    def along(
        cls,
        robot: Robot,
        independent: Sequence[str],
        spline: BSpline,
        start: ArrayLike,
        count: int = 64,
        held: Sequence[str] = (),
    ) -> Path:
        """Build a path by following the spline from a closed configuration at s = 0.

        Args:
            robot: The machine.
            independent: Names of the independent coordinates.
            spline: Their spline over [0, 1].
            start: Closed configuration at s = 0, shape (n_variables,).
            count: Number of anchors.
            held: Names of the variables that stay as they are at the start.

        Returns:
            The path.

        Raises:
            SolveError: The closures fail somewhere on the spline; the message says where.
        """
        s = np.linspace(0.0, 1.0, count)
        X = np.empty((count, len(robot.mechanism.names)))
        here = np.asarray(start, dtype=float)
        names = tuple(independent)
        space = MotionSpace(robot.kinematics, names, held=held)
        for i, values in enumerate(np.asarray(spline(s)).reshape(count, -1)):
            closed = space.solve(values[None, :], here[None, :])
            if not closed.converged[0]:
                raise SolveError(
                    f"the closures of {robot.name!r} fail on the path at s = {s[i]:.3f} "
                    f"(scaled residual {closed.residual[0]:.2g})",
                    s=float(s[i]),
                    values=values,
                )
            X[i] = here = closed.X[0]
        return cls(robot, names, spline, s, X, tuple(held))

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Evaluate all variables, or their derivatives with respect to s.

        Args:
            s: Parameters in [0, 1], a number or shape (n,).
            order: 0 for values, 1 or 2 for derivatives.

        Returns:
            Shape (n_variables,) for a number, (n, n_variables) for an array; [m or rad] per unit of s.

        Raises:
            DefinitionError: The order is not 0, 1 or 2, or s is outside [0, 1].
            SolveError: The closures fail at some s.
        """
        if order not in (0, 1, 2):
            raise DefinitionError(f"order is {order!r}; it must be 0, 1 or 2")
        parameters = np.atleast_1d(np.asarray(s, dtype=float))
        if order == 0:
            values = self.solve(parameters)
        else:
            points = self.points(parameters)
            values = points.dX if order == 1 else points.ddX
        return values[0] if np.ndim(s) == 0 else values

    def solve(self, s: Array) -> Array:
        """Solve the closures at n parameters; shape (n, n_variables)."""
        s = self._check(s)
        guess = self._guess(s)
        guess[:, self._held_index] = self.anchor_X[0, self._held_index]  # exactly: no spline through constants
        closed = self._space.solve(self.spline(s), guess, SolveOptions(iterations=30))
        if not np.all(closed.converged):
            i = int(np.argmin(closed.converged))
            raise SolveError(
                f"the closures of {self.robot.name!r} fail on the path at s = {s[i]:.4f} "
                f"(scaled residual {closed.residual[i]:.2g})",
                s=float(s[i]),
            )
        return closed.X

    def points(self, s: Array) -> PathPoints:
        """Evaluate values and both derivatives at n parameters."""
        s = self._check(s)
        X = self.solve(s)
        T = self._space.tangent(X)
        dX = np.einsum("nvm,nm->nv", T, self.spline(s, 1))
        curved = self._space.curvature(X, dX[:, :, None], dX[:, :, None])[:, :, 0]
        ddX = np.einsum("nvm,nm->nv", T, self.spline(s, 2)) + curved
        return PathPoints(s, X, dX, ddX, T)

    def length(self, metric: ArrayLike, count: int = 2001) -> float:
        """Measure the path in the independent coordinates.

        Args:
            metric: Weight of each coordinate [1 or m/rad], shape (m,).
            count: Number of samples.

        Returns:
            Length [m].
        """
        values = self.spline(np.linspace(0.0, 1.0, count)) * np.asarray(metric)
        return float(np.sum(np.linalg.norm(np.diff(values, axis=0), axis=1)))

    @cached_property
    def _space(self) -> MotionSpace:
        return MotionSpace(self.robot.kinematics, self.independent, held=self.held)

    @cached_property
    def _held_index(self) -> list[int]:
        return self.robot.mechanism.indices(self.held)

    @cached_property
    def _guess(self) -> CubicSpline:
        return CubicSpline(self.anchors, self.anchor_X, axis=0)

    def _check(self, s: Array) -> Array:
        s = np.asarray(s, dtype=float)
        if s.size and not (np.all(np.isfinite(s)) and s.min() >= -1e-9 and s.max() <= 1 + 1e-9):
            raise DefinitionError(f"path parameter is in [{s.min()}, {s.max()}]; it must be in [0, 1]")
        return np.clip(s, 0.0, 1.0)
