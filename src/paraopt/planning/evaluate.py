"""All that a refiner needs at n samples of a path, with exact first derivatives, in batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.planning.condition import PathBound, PathCondition, read_conditions
from paraopt.planning.problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SampleValues:
    """Hold values and gradients at n samples; gradients are with respect to the independent coordinates.

    Attributes:
        converged: Whether the closures hold at every sample, on the branch of the start.
        X: Configurations, shape (n, n_variables).
        T: Motions `dX / d independent`, shape (n, n_variables, m).
        bounded: Variables with a finite range, in lengths or radians over their scale [1], shape (n, b).
        d_bounded: Shape (n, b, m).
        margins: Parallel and serial margin [1], shape (n, 2).
        d_margins: Shape (n, 2, m).
        logarithms: Logarithms of both normalised determinants [1], shape (n, 2).
        d_logarithms: Shape (n, 2, m).
        conditions: Quantities under conditions over their scales, shape (n, u); the problem's come first.
        d_conditions: Shape (n, u, m).
        distances: Signed distances of the near pairs [m], shape (n, k).
        d_distances: Shape (n, k, m).
    """

    converged: bool
    X: Array
    T: Array
    bounded: Array
    d_bounded: Array
    margins: Array
    d_margins: Array
    logarithms: Array
    d_logarithms: Array
    conditions: Array
    d_conditions: Array
    distances: Array
    d_distances: Array


class SampleEvaluator:
    """Evaluate samples of a path from a known neighbouring configuration of each.

    Args:
        problem: The problem.
        X: A configuration near each sample, shape (n, n_variables); follows the samples as they move.
        pairs: Near pairs whose distances are wanted.
        constraints: Conditions besides those of the problem.
        reach: Largest way from the prediction of a sample to where its closures hold, in characteristic lengths or
            radians; beyond it the loops may have closed on another solution.
    """

    def __init__(
        self,
        problem: Problem,
        X: Array,
        pairs: NDArray[np.intp],
        constraints: Sequence[PathBound | PathCondition] = (),
        reach: float = 0.5,
    ) -> None:
        self.problem, self.pairs, self.reach = problem, pairs, reach
        mechanism = problem.robot.mechanism
        low, high = problem.bounds.bounds(mechanism)
        self.bounded = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
        self.scale = problem.robot.kinematics.graph.variable_scale
        self.low, self.high = (low / self.scale)[self.bounded], (high / self.scale)[self.bounded]
        graph = problem.robot.kinematics.graph
        self.conditions = read_conditions(graph, (*problem.conditions, *constraints))
        self.n_barred = len(problem.condition_set)
        self._near = X.copy()
        self._near_T = problem.space.tangent(X)
        self._signs = np.sign(self._orientation(self._near_T))
        self.evaluations = 0

    def _orientation(self, T: Array) -> Array:
        """Give the determinant of the motions of the actuators where it is square; its sign tells the branch.

        Where the actuators are the coordinates it is 1: crossing a serial singularity is no change of branch.
        """
        rows = T[:, self.problem.robot.mechanism.indices(self.problem.robot.mechanism.active)]
        return np.linalg.det(rows) if rows.shape[1] == rows.shape[2] else np.ones(len(rows))

    @property
    def near(self) -> Array:
        """Give the configurations of the last evaluation that converged, shape (n, n_variables)."""
        return self._near

    def follow_from(self, values: SampleValues) -> None:
        """Predict the next samples from earlier ones."""
        self._near, self._near_T = values.X, values.T

    def __call__(self, values: Array) -> SampleValues:
        """Evaluate at n samples of the independent coordinates, shape (n, m)."""
        self.evaluations += 1
        problem = self.problem
        predicted = self._near + np.einsum("nvm,nm->nv", self._near_T, values - self._near[:, problem.index])
        closed = problem.space.solve(values, predicted)
        X = closed.X
        departure = np.max(np.abs(X - predicted) / self.scale, initial=0.0)
        good = bool(np.all(closed.converged) and departure <= self.reach)
        T = problem.space.tangent(X)
        margins, dp, ds, dlp, dls = problem.space.margin_gradients(X, T)
        serial, log_serial = margins.serial, margins.log_serial
        if problem.allow_mode_change:  # serial singularities may be crossed: nothing pushes away from them
            serial, log_serial = np.ones_like(serial), np.zeros_like(log_serial)
            ds, dls = np.zeros_like(ds), np.zeros_like(dls)
        good = good and bool(np.all(np.sign(self._orientation(T)) == self._signs))
        distances = problem.scene.distances(X, self.pairs, T)
        conditions, d_conditions = self.conditions(X, T)
        if good:
            self._near, self._near_T = X, T
        return SampleValues(
            good,
            X,
            T,
            (X / self.scale)[:, self.bounded],
            (T / self.scale[:, None])[:, self.bounded],
            np.column_stack([margins.parallel, serial]),
            np.stack([dp, ds], axis=1),
            np.column_stack([margins.log_parallel, log_serial]),
            np.stack([dlp, dls], axis=1),
            conditions,
            d_conditions,
            distances.values,
            distances.gradients,
        )

    def second(self, X: Array, T: Array) -> Array:
        """Give the second derivatives of all variables with respect to the independent coordinates.

        Args:
            X: Closed configurations, shape (n, n_variables).
            T: Motions there, shape (n, n_variables, m).

        Returns:
            Shape (n, n_variables, m, m).
        """
        m = T.shape[2]
        k, j = np.triu_indices(m)
        upper = self.problem.space.curvature(X, T[:, :, k], T[:, :, j])
        H = np.empty((*T.shape, m))
        H[:, :, k, j] = upper
        H[:, :, j, k] = upper
        return H

    def bend_margins(self, X: Array, T: Array, weights: Array, step: float = 1e-6) -> Array:
        """Give second derivatives of `weights . margins`, by central differences of the exact gradients.

        Args:
            X: Closed configurations, shape (n, n_variables).
            T: Motions there, shape (n, n_variables, m).
            weights: Those of the parallel and the serial margin, shape (n, 2).
            step: Step in the independent coordinates, in characteristic lengths or radians.

        Returns:
            Shape (n, m, m); zero where the weights are.
        """

        def gradients(X: Array, T: Array, of: NDArray[np.intp]) -> Array:
            _, parallel, serial, _, _ = self.problem.space.margin_gradients(X, T)
            return np.stack([parallel, serial], axis=1)[:, of]

        return self._bend(gradients, X, T, weights, step)

    def bend_distances(self, X: Array, T: Array, weights: Array, step: float = 5e-4) -> Array:
        """Give second derivatives of `weights . distances`, by central differences of the exact gradients.

        The step is long against the precision of witness points; where the nearest points leap from one corner to
        another within it, the mean bend over the step is given.

        Args:
            X: Closed configurations, shape (n, n_variables).
            T: Motions there, shape (n, n_variables, m).
            weights: Those of the near pairs [1/m], shape (n, k).
            step: Step in the independent coordinates, in characteristic lengths or radians.

        Returns:
            Shape (n, m, m); zero where the weights are.
        """

        def gradients(X: Array, T: Array, of: NDArray[np.intp]) -> Array:
            return self.problem.scene.distances(X, self.pairs[of], T).gradients

        return self._bend(gradients, X, T, weights, step)

    def _bend(
        self,
        gradients: Callable[[Array, Array, NDArray[np.intp]], Array],
        X: Array,
        T: Array,
        weights: Array,
        step: float,
    ) -> Array:
        """Difference the gradients of weighty quantities, shape (n, k, m), where they weigh something."""
        n, _, m = T.shape
        bent = np.zeros((n, m, m))
        weighty = np.abs(weights) > max(1e-3 * float(np.max(np.abs(weights), initial=0.0)), 1e-15)
        at, of = np.flatnonzero(np.any(weighty, axis=1)), np.flatnonzero(np.any(weighty, axis=0))
        if not at.size:
            return bent
        problem, scale = self.problem, self.scale[self.problem.index]
        moves = step * np.vstack([np.diag(scale), -np.diag(scale)])
        near = (X[at, None, :] + np.einsum("avm,km->akv", T[at], moves)).reshape(-1, X.shape[1])
        closed = problem.space.solve(near[:, problem.index], near)
        slopes = gradients(closed.X, problem.space.tangent(closed.X), of).reshape(len(at), 2, m, len(of), m)
        second = (slopes[:, 0] - slopes[:, 1]) / (2.0 * step * scale[:, None, None])
        found = np.einsum("ajkm,ak->ajm", second, weights[np.ix_(at, of)])
        found[~np.all(closed.converged.reshape(len(at), -1), axis=1)] = 0.0
        bent[at] = 0.5 * (found + found.transpose(0, 2, 1))
        return bent
