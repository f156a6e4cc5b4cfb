"""Distances to singularities along many configurations: signed determinants, margins, and their exact gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.orientation import ParallelOrientation
from paraopt.kinematics.ranks import compute_rank, independent_rows
from paraopt.kinematics.solve import ClosureSolution, SolveOptions

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Determinants:
    """Evaluate signed determinants of [N K] and [M N] on a fixed choice of rows and columns.

    Rows are independent equations and columns leave out idle variables, both chosen at a regular configuration. The
    values are divided by the volume of the chosen rows, `sqrt(det(E E^T))`, which makes them free of the choice of
    equations: they lie in [-1, 1], and zero means singular.

    Where equations repeat others, as those of a weld do, the chosen ones may come to depend on each other far from
    where they were chosen, though the machine is regular there. Both determinants then change their signs together.
    Where that is seen they are evaluated again on combinations of the equations that stay independent at all poses.

    Attributes:
        kinematics: The mechanism's functions.
        rows: Chosen equations.
        columns: Columns that are neither idle nor locked.
        parallel_columns: Chosen columns of [N K].
        serial_columns: Chosen columns of [M N].
        reference: The regular configuration, shape (n_variables,).
    """

    kinematics: Kinematics
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    parallel_columns: NDArray[np.intp]
    serial_columns: NDArray[np.intp]
    reference: Array

    @classmethod
    def at(
        cls,
        kinematics: Kinematics,
        configuration: Configuration,
        operational: Sequence[str] | None = None,
        held: Sequence[str] = (),
    ) -> Determinants:
        """Choose rows and columns at a regular configuration.

        Args:
            kinematics: The mechanism's functions.
            configuration: A regular configuration.
            operational: Variables that state the task; those of the mechanism when None.
            held: Variables that are locked: their columns are in no matrix.
        """
        (E,) = kinematics.functions.scaled_jacobian(configuration.X)
        mechanism = kinematics.mechanism
        locked = mechanism.indices(held)
        active = mechanism.indices(mechanism.active)
        task = mechanism.indices(mechanism.operational if operational is None else operational)
        used = np.setdiff1d(np.flatnonzero(np.max(np.abs(E), axis=0, initial=0.0) > 1e-12), locked)
        free = E.copy()
        free[:, locked] = 0.0
        parallel, serial = np.setdiff1d(used, active), np.setdiff1d(used, task)
        return cls(kinematics, independent_rows(free), used, parallel, serial, configuration.X.copy())

    @property
    def has_parallel(self) -> bool:
        """Tell whether the chosen [N K] is square."""
        return len(self.parallel_columns) == len(self.rows)

    @property
    def has_serial(self) -> bool:
        """Tell whether the chosen [M N] is square."""
        return len(self.serial_columns) == len(self.rows)

    def __call__(self, X: ArrayLike) -> tuple[Array, Array]:
        """Evaluate at n points.

        Args:
            X: Values, shape (n, n_variables).

        Returns:
            Normalised determinants of [N K] and of [M N] [1], shape (n,) each; nan where not square.
        """
        X = np.atleast_2d(np.asarray(X, dtype=float))
        values = self._values(self._chosen_rows(X))
        turned = self._turned(np.sign(values))
        if turned.size:
            values[:, turned] = self._sense[:, None] * self._values(self._combined_rows(X[turned]))
        return values[0], values[1]

    def signs(self, X: ArrayLike) -> tuple[Array, Array]:
        """Evaluate the signs of both determinants at n points, shape (n,) each; nan where not square."""
        X = np.atleast_2d(np.asarray(X, dtype=float))
        (parallel, _), (serial, _) = self._factors(self._chosen_rows(X))
        signs = np.array([parallel, serial])
        turned = self._turned(signs)
        if turned.size:
            signs[:, turned] = self._sense[:, None] * [
                sign for sign, _ in self._factors(self._combined_rows(X[turned]))
            ]
        return signs[0], signs[1]

    def _values(self, chosen: Array) -> Array:
        """Give both determinants over the volume of the rows, shape (2, n)."""
        whole = chosen[:, :, self.columns]
        volume = 0.5 * np.linalg.slogdet(whole @ whole.transpose(0, 2, 1))[1]
        return np.array([sign * np.exp(logarithm - volume) for sign, logarithm in self._factors(chosen)])

    def _turned(self, signs: Array) -> NDArray[np.intp]:
        """Give the points at which both signs differ from the reference's, where that may be the rows' doing."""
        if not (self.has_parallel and self.has_serial) or self._orientation is None:
            return np.arange(0)
        return np.flatnonzero(np.all(signs == -self._first[:, None], axis=0))

    @cached_property
    def _first(self) -> Array:
        """Give both signs at the reference."""
        return np.array([sign[0] for sign, _ in self._factors(self._chosen_rows(self.reference[None]))])

    @cached_property
    def _orientation(self) -> ParallelOrientation | None:
        """Give combinations of the equations that stay independent; none where none repeats others, or not enough."""
        if len(self.rows) == self.kinematics.graph.F.numel():
            return None
        found = ParallelOrientation.at(self.kinematics, self.reference)
        combined = found.rows(self.reference[None])[0]
        is_complete = len(combined) == len(self.rows)
        return found if is_complete and compute_rank(combined[:, self.columns]).value == len(self.rows) else None

    @cached_property
    def _sense(self) -> Array:
        """Give the signs on chosen rows over those on combined ones, at the reference, shape (2,)."""
        return self._first * [sign[0] for sign, _ in self._factors(self._combined_rows(self.reference[None]))]

    def _combined_rows(self, X: Array) -> Array:
        assert self._orientation is not None
        return self._orientation.rows(X)

    def _chosen_rows(self, X: Array) -> Array:
        (E,) = self.kinematics.functions.scaled_jacobian.batch(X)
        return E[:, self.rows, :]

    def _factors(self, chosen: Array) -> list[tuple[Array, Array]]:
        """Give sign and logarithm of both determinants from their LU factors."""
        nan = np.full(len(chosen), np.nan)
        result: list[tuple[Array, Array]] = []
        for columns, square in ((self.parallel_columns, self.has_parallel), (self.serial_columns, self.has_serial)):
            if square:
                sign, logarithm = np.linalg.slogdet(chosen[:, :, columns])
                result.append((np.asarray(sign, dtype=float), np.asarray(logarithm, dtype=float)))
            else:
                result.append((nan, nan))
        return result


@dataclass(frozen=True, eq=False)
class Margins:
    """Hold distances to singularities along n configurations.

    Attributes:
        parallel: Smallest singular value of the active rows of an orthonormal basis of the motions [1], shape (n,).
        serial: Same for the operational rows, shape (n,).
        log_parallel: Logarithm of the volume of the active rows, shape (n,).
        log_serial: Logarithm of the volume of the operational rows, shape (n,).
    """

    parallel: Array
    serial: Array
    log_parallel: Array
    log_serial: Array


class MotionSpace:
    """Judge singularities from the motions that the closures allow.

    Let the columns of V be an orthonormal basis of the scaled motions, `E V = 0` (idle ones left out). The smallest
    singular value of its active rows V_a is zero exactly where [N K] loses rank: some motion needs no actuator. It
    lies in [0, 1], does not depend on how the equations are written, and says that actuator motions are amplified into
    motions of the whole at most 1 / margin times. The operational rows V_x tell serial singularities alike. With as
    many actuators as motions, |det V_a| is the normalised determinant of [N K]. Forces among the variables count in
    their force of reference, so that a margin shrinks, too, where small motions of the actuators change tensions much.

    Args:
        kinematics: The mechanism's functions.
        independent: Coordinates that parametrise the motions; the operational ones when None.
        operational: Coordinates that state the task, whose loss is a serial singularity; those of the mechanism when
            None.
        held: Variables that are locked, such as the joints and the standing feet of a legged machine. A locked actuator
            does not move anything.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        independent: Sequence[str] | None = None,
        operational: Sequence[str] | None = None,
        held: Sequence[str] = (),
    ) -> None:
        self.kinematics = kinematics
        mechanism = kinematics.mechanism
        self.independent = tuple(independent) if independent is not None else tuple(mechanism.operational)
        self.held = tuple(held)
        self.index = np.asarray(mechanism.indices(self.independent), dtype=np.intp)
        self._active = mechanism.indices(mechanism.active)
        self._operational = mechanism.indices(mechanism.operational if operational is None else operational)

    @cached_property
    def _pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        k, j = np.triu_indices(len(self.independent))
        return k, j

    def tangent(self, X: ArrayLike) -> Array:
        """Give `T = dX / d independent` [unscaled], shape (n, n_variables, m)."""
        return self.kinematics.tangent(X, self.independent, self.held)

    def curvature(self, X: ArrayLike, V: ArrayLike, W: ArrayLike) -> Array:
        """Give the second-order motion for pairs of velocities; see `Kinematics.curvature`."""
        return self.kinematics.curvature(X, V, W, self.independent, self.held)

    def solve(self, values: ArrayLike, starts: ArrayLike, options: SolveOptions | None = None) -> ClosureSolution:
        """Solve the closures at n places, locked variables as in the starts.

        Args:
            values: Independent coordinates [m or rad], shape (n, m).
            starts: A configuration near each, shape (n, n_variables).
            options: Tolerances; those of the kinematics when None.
        """
        return self.kinematics.solve_batch(self.independent, values, starts, options, self.held)

    def margins(self, X: ArrayLike, T: Array | None = None) -> Margins:
        """Compute the margins at n closed configurations.

        Args:
            X: Closed configurations, shape (n, n_variables).
            T: Their tangents, when already known.

        Returns:
            Margins and log-volumes.
        """
        T = self.tangent(X) if T is None else T
        V = np.linalg.qr(T / self.kinematics.graph.variable_scale[:, None])[0]
        parallel, log_parallel = smallest_and_volume(V[:, self._active])
        serial, log_serial = smallest_and_volume(V[:, self._operational])
        lost = self._is_lost(np.atleast_2d(np.asarray(X, dtype=float)), T)
        if set(self._active) == set(self.index):
            return Margins(np.where(lost, 0.0, parallel), serial, np.where(lost, -np.inf, log_parallel), log_serial)
        return Margins(parallel, np.where(lost, 0.0, serial), log_parallel, np.where(lost, -np.inf, log_serial))

    def _is_lost(self, X: Array, T: Array) -> NDArray[np.bool_]:
        """Tell where the coordinates cannot be moved one by one, exactly: there T opens the loops.

        Near a singularity of theirs T grows without bound, and the margins see it. On one, as in many a pose of
        symmetry, no such motion exists, and the damped solve gives one that the closures do not allow.
        """
        (E,) = self.kinematics.functions.scaled_jacobian.batch(X)
        S = T / self.kinematics.graph.variable_scale[:, None]
        opening = np.max(np.abs(E @ S), axis=(1, 2), initial=0.0)
        return np.asarray(opening > 1e-6 * np.max(np.abs(S), axis=(1, 2), initial=1e-300))

    def margin_gradients(self, X: ArrayLike, T: Array) -> tuple[Margins, Array, Array, Array, Array]:
        """Compute the margins and their exact gradients with respect to the independent coordinates.

        Args:
            X: Closed configurations, shape (n, n_variables).
            T: Their tangents, shape (n, n_variables, m).

        Returns:
            The margins, and the gradients of parallel, serial, log_parallel and log_serial, shape (n, m) each.
        """
        n, _, m = T.shape
        scale = self.kinematics.graph.variable_scale[:, None]
        k, j = self._pairs
        H = self.curvature(X, T[:, :, k], T[:, :, j]) / scale
        S = T / scale
        dS = np.empty((n, S.shape[1], m, m))  # [sample, variable, column j, along coordinate k]
        dS[:, :, k, j] = H
        dS[:, :, j, k] = H
        flat = dS.reshape(n, -1, m)
        gram = S.transpose(0, 2, 1) @ S
        # d log sqrt(det(S^T S)) = tr((S^T S)^-1 S^T dS)
        d_log_all = ((S @ np.linalg.inv(gram)).reshape(n, 1, -1) @ flat)[:, 0]
        log_all = np.linalg.slogdet(gram)[1]
        results: list[Array] = []
        values: list[Array] = []
        for rows in (self._active, self._operational):
            A, dA = S[:, rows], dS[:, rows].reshape(n, -1, m)
            gram_rows = A.transpose(0, 2, 1) @ A
            sigma2, w = _smallest_generalised(gram_rows, gram)
            Aw, Sw = (B @ w[:, :, None] * w[:, None, :] for B in (A, S))  # (B w) w^T
            d_sigma2 = 2.0 * (Aw.reshape(n, 1, -1) @ dA)[:, 0]
            d_sigma2 -= 2.0 * sigma2[:, None] * (Sw.reshape(n, 1, -1) @ flat)[:, 0]
            sigma = np.sqrt(np.maximum(sigma2, 1e-300))
            ridge = 1e-15 * np.trace(gram_rows, axis1=1, axis2=2)[:, None, None] * np.eye(m)
            d_log_rows = ((A @ np.linalg.inv(gram_rows + ridge)).reshape(n, 1, -1) @ dA)[:, 0]
            values += [sigma, 0.5 * (np.linalg.slogdet(gram_rows)[1] - log_all)]
            results += [d_sigma2 / (2.0 * sigma[:, None]), d_log_rows - d_log_all]
        margins = Margins(values[0], values[2], values[1], values[3])
        return margins, results[0], results[2], results[1], results[3]


def smallest_and_volume(rows: Array) -> tuple[Array, Array]:
    """Give the smallest singular value and the logarithm of the volume of stacks of rows of a basis of motions.

    Args:
        rows: Chosen rows [1], shape (n, n_rows, n_motions).

    Returns:
        Smallest singular values, zero where the rows are fewer than the motions, and log-volumes; shape (n,) each.
    """
    if rows.shape[2] == 0:  # nothing moves: nothing can be lost
        return np.ones(len(rows)), np.zeros(len(rows))
    if rows.shape[1] < rows.shape[2]:  # fewer imposed variables than motions: some motion is always free
        return np.zeros(len(rows)), np.full(len(rows), -np.inf)
    values = np.asarray(np.linalg.svd(rows, compute_uv=False), dtype=float)
    return values[:, -1], np.sum(np.log(np.maximum(values, 1e-300)), axis=1)


def _smallest_generalised(A: Array, B: Array) -> tuple[Array, Array]:
    """Give the smallest eigenvalue of `A w = lambda B w` with `w^T B w = 1`, for stacks of symmetric matrices."""
    L = np.linalg.cholesky(B)
    inverse = np.linalg.inv(L)
    values, vectors = np.linalg.eigh(inverse @ A @ inverse.transpose(0, 2, 1))
    w: Array = np.einsum("nba,nb->na", inverse, vectors[:, :, 0])
    smallest: Array = values[:, 0]
    return smallest, w
