"""The quadratic program of one step, behind the door of qpsolvers: any installed solver, by name."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import qpsolvers
import scipy.optimize
import scipy.sparse as sp
from numpy.typing import NDArray

from paraopt.errors import BackendError, MissingBackendError

Array = NDArray[np.float64]
# What a solver needs to be asked for beyond its defaults, which are made for larger and looser problems
_SETTINGS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000, "polishing": True, "check_termination": 10},
    "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9},
    "proxqp": {"eps_abs": 1e-10},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 1e-10, "eps_duality_gap_abs": 1e-10, "eps_duality_gap_rel": 1e-10},
    "clarabel": {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11},
    "ecos": {"abstol": 1e-10, "reltol": 1e-10},
}


def check_solver(name: str) -> None:
    """Refuse a solver that is not installed.

    Raises:
        MissingBackendError: It is unknown or not installed; the message lists those that are.
    """
    if name not in qpsolvers.available_solvers:
        raise MissingBackendError(
            f"QP solver {name!r} is not installed or does not exist; installed: "
            f"{', '.join(map(repr, qpsolvers.available_solvers)) or 'none'}"
        )


@dataclass(frozen=True, eq=False)
class Answer:
    """Hold an answer of a program.

    Attributes:
        c: The minimiser, shape (m,).
        held: Rows whose bounds push, counted from 1, negative for lower bounds; shape (n_held,).
    """

    c: Array
    held: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Program:
    """State `minimise 1/2 c^T P c - p^T c` subject to `low <= R c <= high`.

    Attributes:
        P: Symmetric positive definite matrix, shape (m, m).
        p: Linear term, shape (m,).
        R: Rows, shape (n_rows, m).
        low: Lower bounds, may be -inf, shape (n_rows,).
        high: Upper bounds, may be inf, shape (n_rows,).
    """

    P: Array
    p: Array
    R: Array
    low: Array
    high: Array

    def excess(self, c: Array) -> float:
        """Give the largest violation of a bound."""
        value = self.R @ c
        return float(np.max(np.maximum(value - self.high, self.low - value), initial=0.0))

    def solve(self, solver: str, guess: Array, tried: NDArray[np.intp]) -> Answer | None:
        """Solve the program.

        Its answer is unique, and known by its conditions of optimality: so the guess, which minimises without bounds,
        is the answer where it meets the bounds; and the minimiser with some rows held at their bounds is the answer
        where it meets the others and no held row pulls. Only where neither holds a solver is asked, and what it finds
        is made exact by holding the rows that it found to push.

        Args:
            solver: Name of an installed solver.
            guess: Minimiser without bounds, shape (m,).
            tried: Rows that may be the held ones, as in `Answer.held`, such as those of the step before.

        Returns:
            The answer, or None where the solver says that there is none.

        Raises:
            BackendError: The solver failed in another way.
        """
        if self.excess(guess) <= 0.0:
            return Answer(guess, np.arange(0))
        exact = self._hold(tried)
        if exact is not None:
            return Answer(exact, tried)
        c = self._ask(solver, max(float(np.linalg.norm(guess)), 1e-6))
        return None if c is None else self.sharpen(c)

    def sharpen(self, c: Array) -> Answer:
        """Make an approximate answer exact, by holding the rows that push at it."""
        held = np.arange(0)
        for width in (1e-3, 1e-4, 1e-5):  # interior methods stay away from the bounds that push
            held = self._find_held(c, width)
            exact = self._hold(held)
            if exact is not None:
                return Answer(exact, held)
        return Answer(c, held)

    def _ask(self, solver: str, unit: float) -> Array | None:
        """Ask a solver; velocities are divided by a unit, so that its tolerances mean the same for all speeds."""
        upper, lower = np.isfinite(self.high), np.isfinite(self.low)
        G = np.vstack([self.R[upper], -self.R[lower]])
        h = np.concatenate([self.high[upper], -self.low[lower]]) / unit
        dense = solver not in qpsolvers.sparse_solvers
        problem = qpsolvers.Problem(
            self.P if dense else _as_sparse(self.P), -self.p / unit, G=G if dense else _as_sparse(G), h=h
        )
        with warnings.catch_warnings():  # what the solver has to say is in its status, and the answer is checked below
            warnings.simplefilter("ignore")
            try:
                answer = qpsolvers.solve_problem(problem, solver=solver, **_SETTINGS.get(solver, {}))
            except Exception as error:
                raise BackendError(f"QP solver {solver!r} failed: {error}", problem=problem) from error
        if answer.x is None or not answer.found or not np.all(np.isfinite(answer.x)):
            return None
        c = unit * np.asarray(answer.x, dtype=float)
        return c if self.excess(c) <= 1e-6 * unit else None

    def _hold(self, held: NDArray[np.intp]) -> Array | None:
        """Minimise with some rows at their bounds; None where that is not the answer of the program."""
        n, m = len(held), len(self.p)
        if not n or n > m or int(np.max(np.abs(held))) > len(self.R):
            return None
        rows, sides = np.abs(held) - 1, np.sign(held)
        bounds = np.where(sides > 0, self.high[rows], self.low[rows])
        if not np.all(np.isfinite(bounds)):
            return None
        A = sides[:, None] * self.R[rows]
        matrix = np.zeros((m + n, m + n))
        matrix[:m, :m], matrix[:m, m:], matrix[m:, :m] = self.P, A.T, A
        try:
            solution = np.linalg.solve(matrix, np.concatenate([self.p, sides * bounds]))
        except np.linalg.LinAlgError:  # the rows depend on each other
            return None
        c, multipliers = solution[:m], solution[m:]
        unit = max(float(np.linalg.norm(c)), 1e-6)
        if not np.all(multipliers >= 0.0) or not self.excess(c) <= 1e-11 * unit:
            return None
        return np.asarray(c)

    def _find_held(self, c: Array, width: float) -> NDArray[np.intp]:
        """Find the rows whose bounds push at an answer: they carry the multipliers that balance the slope."""
        slope = self.P @ c - self.p
        size = float(np.linalg.norm(slope))
        unit = max(float(np.linalg.norm(c)), float(np.linalg.norm(self.p)), 1e-12)
        value, norms = self.R @ c, np.maximum(np.linalg.norm(self.R, axis=1), 1e-12)
        near = width * unit * norms + 1e-9
        at_high, at_low = np.flatnonzero(self.high - value <= near), np.flatnonzero(value - self.low <= near)
        held = np.concatenate([at_high + 1, -at_low - 1])
        if not held.size or size <= 1e-9 * unit:
            return np.arange(0)
        rows = np.abs(held) - 1
        normals = np.sign(held)[:, None] * self.R[rows] / norms[rows][:, None]
        multipliers, _ = scipy.optimize.nnls(normals.T, -slope)
        return np.asarray(held[multipliers > 1e-6 * size])

    def relax(self, soft_low: Array, soft_high: Array, room: Array) -> Program:
        """Give the program in (c, t) in which soft bounds give way in proportion to their room, as little as may be.

        Args:
            soft_low: Lower soft bounds, may be -inf, shape (n_rows,).
            soft_high: Upper soft bounds, may be inf, shape (n_rows,).
            room: By how much each soft bound gives way beside the others, shape (n_rows,).
        """
        m = len(self.p)
        P = np.zeros((m + 1, m + 1))
        # a slope that outweighs all that the command could gain, and no more: solvers do not like wide spans
        weight = max(float(np.trace(self.P)), 1e-12)
        push = 10.0 * (weight + float(np.linalg.norm(self.p)))
        P[:m, :m], P[m, m] = self.P, weight
        soft = np.isfinite(soft_low) | np.isfinite(soft_high)
        count = int(np.count_nonzero(soft))
        give, none = room[soft] / np.max(room[soft], initial=1e-300), np.full(count, np.inf)
        rows = np.vstack([
            np.column_stack([self.R, np.zeros(len(self.R))]),
            np.column_stack([self.R[soft], -give]),
            np.column_stack([self.R[soft], give]),
            np.eye(m + 1)[m:],
        ])  # fmt: skip
        low = np.concatenate([self.low, -none, soft_low[soft], [0.0]])
        high = np.concatenate([self.high, soft_high[soft], none, [np.inf]])
        return Program(P, np.append(self.p, -push), rows, low, high)


def _as_sparse(matrix: Array) -> sp.csc_matrix:
    """Store all entries by columns; nothing is searched for zeros."""
    rows, columns = matrix.shape
    indices = np.tile(np.arange(rows, dtype=np.int32), columns)
    return sp.csc_matrix((matrix.ravel(order="F"), indices, np.arange(0, rows * columns + 1, rows)), shape=matrix.shape)
