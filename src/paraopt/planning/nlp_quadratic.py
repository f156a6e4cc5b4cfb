"""The quadratic program of one step: by OSQP through qpsolvers roughly, then exactly on the rows that push."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import qpsolvers
import scipy.sparse as sp
from numpy.typing import NDArray

from paraopt.errors import BackendError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Optimum:
    """Hold what minimises a quadratic program.

    Attributes:
        z: The minimiser, shape (n,).
        y: Multipliers of the rows, not negative, shape (k,).
        is_exact: Whether it meets the conditions of optimality up to round-off.
    """

    z: Array
    y: Array
    is_exact: bool


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """State `minimise 1/2 z P z + q z` subject to `G z <= h` and `low <= z <= high`.

    Entries of the program, and of its answer, are to be about 1.

    Attributes:
        P: Symmetric positive definite matrix, shape (n, n).
        q: Linear term, shape (n,).
        G: Rows, shape (k, n).
        h: Their upper bounds, shape (k,).
        low: Lower bounds of z, shape (n,).
        high: Upper bounds of z, shape (n,).
    """

    P: Array
    q: Array
    G: Array
    h: Array
    low: Array
    high: Array

    def solve(self, likely: NDArray[np.bool_], accuracies: tuple[float, ...] = (1e-3, 1e-5)) -> Optimum:
        """Solve the program.

        The bounds that push decide the answer, and OSQP need only tell which: so it is asked for little accuracy, and
        not at all where the search that begins at the rows that are likely to push comes to an end soon.

        Args:
            likely: Rows that are likely to push, such as those of the step before, shape (k,).
            accuracies: What OSQP is asked for, one after the other until the bounds that push are known.

        Raises:
            BackendError: OSQP failed.

        Source: osqp.
        """
        n, k = len(self.q), len(self.h)
        none = np.zeros(n, dtype=int)
        if np.any(likely) and (exact := self._exchange(np.concatenate([likely.astype(int), none]), 25)) is not None:
            return exact
        z, y = np.zeros(n), np.zeros(k)
        problem = qpsolvers.Problem(
            sp.csc_matrix(self.P), self.q, G=sp.csc_matrix(self.G), h=self.h, lb=self.low, ub=self.high
        )
        start: Array | None = None
        for accuracy in accuracies:
            try:
                with warnings.catch_warnings():  # an inexact answer is made exact below, or judged by its step
                    warnings.simplefilter("ignore")
                    answer = qpsolvers.solve_problem(
                        problem, solver="osqp", initvals=start, raise_error=False, eps_abs=accuracy, eps_rel=accuracy,
                        max_iter=4000, check_termination=10, rho=1.0, polishing=False,
                    )  # fmt: skip
            except Exception as error:
                raise BackendError(f"OSQP failed on the quadratic program of a step: {error}") from error
            if answer.x is None or not np.all(np.isfinite(answer.x)):
                break
            start = z = np.asarray(answer.x)
            pressure = np.concatenate([np.asarray(answer.z), np.asarray(answer.z_box)])
            y = np.maximum(pressure[:k], 0.0)
            pushing = np.where(pressure > 1e-6, 1, np.where(pressure < -1e-6, -1, 0))
            if (exact := self._exchange(pushing, 60)) is not None:
                return exact
        return Optimum(np.clip(z, self.low, self.high), y, False)

    @cached_property
    def _dual(self) -> tuple[Array, Array, Array]:
        """Give all rows, those of the entries after G; the inverse of P; and `rows P^-1`."""
        rows = np.vstack([self.G, np.eye(len(self.q))])
        inverse = np.asarray(np.linalg.inv(self.P), dtype=float)
        return rows, inverse, np.vstack([self.G @ inverse, inverse])

    def _exchange(self, side: NDArray[np.intp], rounds: int) -> Optimum | None:
        """Hold some rows at their bounds; then let go the one that pulls most, or hold the one that is most broken.

        Args:
            side: 1 or -1 for rows and entries held at their upper or lower bound, else 0, shape (k + n,).
            rounds: Bound on the exchanges.

        Returns:
            The optimum, or None where the exchanges do not come to an end, or the rows held depend on each other.
        """
        rows, inverse, bent = self._dual
        k = len(self.h)
        upper, lower = np.concatenate([self.h, self.high]), np.concatenate([np.full(k, -np.inf), self.low])
        free, met = -inverse @ self.q, -bent @ self.q
        side = side.copy()
        for _ in range(rounds):
            held = np.flatnonzero(side)
            bound = np.where(side > 0, upper, lower)[held]
            try:
                pressure = np.linalg.solve(bent[held] @ rows[held].T, met[held] - bound)
            except np.linalg.LinAlgError:
                return None
            pull = -side[held] * pressure
            if np.max(pull, initial=0.0) > 1e-9:
                side[held[np.argmax(pull)]] = 0
                continue
            value = met - bent @ (rows[held].T @ pressure)
            beyond = np.maximum(value - upper, lower - value)
            worst = int(np.argmax(beyond))
            if beyond[worst] > 1e-8:
                if side[worst]:
                    return None
                side[worst] = 1 if value[worst] > upper[worst] else -1
                continue
            z, y = free - inverse @ (rows[held].T @ pressure), np.zeros(k)
            y[held[held < k]] = np.maximum(pressure[held < k], 0.0)
            slope = self.P @ z + self.q + rows[held].T @ pressure
            size = 1.0 + float(np.max(np.abs(pressure), initial=0.0))
            exact = np.max(np.abs(slope)) <= 1e-6 * size and np.max(np.abs(value[held] - bound), initial=0.0) <= 1e-7
            return Optimum(np.clip(z, self.low, self.high), y, True) if exact else None
        return None
