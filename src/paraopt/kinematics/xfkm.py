"""Impose values, come as near to them as possible: Newton's method, then quadratic programs, then IPOPT (XFKM)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.functions import FunctionSet
from paraopt.kinematics.interior import solve_interior
from paraopt.kinematics.ranks import compute_rank, independent_rows
from paraopt.kinematics.solution import Solution
from paraopt.kinematics.solve import SolveOptions, Status, solve_closure, solve_nearest
from paraopt.mechanism import Mechanism

Array = NDArray[np.float64]

# scaled distance to imposed values below which they are tried exactly again, and to a range's end that counts as there
_NEARLY = 1e-6


@dataclass(frozen=True, eq=False)
class Question:
    """Hold what is imposed on a mechanism, and answer it.

    Attributes:
        functions: Functions of the mechanism.
        used: Whether each variable enters an equation, shape (n_variables,).
        impose: Imposed values by name [m or rad].
        weights: Weight of each imposed variable [1].
        options: Tolerances.
        within_ranges: Whether an exact solution outside the joint ranges is no answer.
    """

    functions: FunctionSet
    used: NDArray[np.bool_]
    impose: Mapping[str, float]
    weights: Mapping[str, float]
    options: SolveOptions
    within_ranges: bool

    def answer(self, origins: Array) -> Solution:
        """Answer from given starts, tried in their order.

        Args:
            origins: Starts of all variables [m or rad], shape (n, n_variables); what is not exact starts at the first.

        Returns:
            The solution; it is never a point whose loops are open without saying so.

        Source: Lahouar, II.3; Tripod.
        """
        starts = origins.copy()
        starts[:, self.index] = self._values
        exact = solve_closure(self.functions, starts, self.free, self.options)
        spent = exact.iterations
        best = next((k for k in exact.converged.nonzero()[0].tolist() if self._is_allowed(exact.X[k])), None)
        if best is not None:
            return self._conclude(exact.X[best], exact.residual[best], spent, Status.CONVERGED, "newton")
        closed = solve_closure(self.functions, origins[0], np.ones(len(self.free)), self.options)
        X, iterations, settled = self._program(closed.X[0])
        by_programs = self._judge(X, settled, spent + iterations, "sqp")
        if by_programs.status is not Status.FAILED:
            return by_programs
        X, more, settled = self._interior(closed.X[0], bool(closed.converged[0]))
        by_interior = self._judge(X, settled, spent + iterations + more, "ipopt")
        return by_programs if by_interior.status is Status.FAILED else by_interior

    # -- solvers ---------------------------------------------------------------------------------------------------

    def _program(self, start: Array) -> tuple[Array, int, bool]:
        target, weight = self._target(start)
        return solve_nearest(self.functions, start, target, weight, *self.ranges, self.options)

    def _interior(self, start: Array, is_closed: bool) -> tuple[Array, int, bool]:
        target, weight = self._target(start)
        (E,) = self.functions.scaled_jacobian(start)
        # where the loops are open, dependent equations look independent
        rows = independent_rows(E) if is_closed else np.arange(len(E))
        limit = self.options.interior_iterations
        X, iterations, word = solve_interior(self.functions, start, target, weight, *self.ranges, rows, limit)
        return X, iterations, word in ("Solve_Succeeded", "Solved_To_Acceptable_Level")

    # -- judging ---------------------------------------------------------------------------------------------------

    def _judge(self, X: Array, settled: bool, iterations: int, solver: str) -> Solution:
        """Close the loops at what a solver found, and say what it is."""
        modest = replace(self.options, step_limit=0.05)
        polished = solve_closure(self.functions, X, np.ones(len(X)), modest)
        final = polished.X[0]
        miss = self._miss(final)
        closes = bool(polished.converged[0]) and self._is_allowed(final, 1e-7)
        if closes and np.max(np.abs(miss), initial=0.0) < _NEARLY:
            again = final.copy()
            again[self.index] = self._values
            exact = solve_closure(self.functions, again, self.free, self.options)
            if exact.converged[0] and self._is_allowed(exact.X[0]):
                return self._conclude(exact.X[0], exact.residual[0], iterations, Status.CONVERGED, solver)
        status = Status.NEAREST if closes and settled else Status.FAILED
        answer = self._conclude(final, polished.residual[0], iterations, status, solver)
        if not closes:
            return answer
        lower, upper = self.ranges
        near = np.minimum(final - lower, upper - final) / self._scale < _NEARLY
        held = tuple(n for n, b in zip(self._mechanism.names, near, strict=True) if b)
        weight = np.array([self.weights[name] for name in self.impose])
        return replace(answer, at_bound=held, distance=float(np.linalg.norm(weight * miss)))

    def _conclude(self, X: Array, residual: float, iterations: int, status: Status, solver: str) -> Solution:
        """Add ranks, and tell a solution that is not unique."""
        (E,) = self.functions.scaled_jacobian(X)
        # a column that is empty at this place only is a motion that nothing holds
        solved = self.used & (self.free > 0)
        rank = compute_rank(E[:, solved], whole=E)
        undetermined = int(np.count_nonzero(solved)) - rank.value
        if status is Status.CONVERGED and undetermined > 0:
            mobility = int(np.count_nonzero(self.used)) - compute_rank(E).value
            if undetermined > max(mobility - len(self.impose), 0):
                status = Status.SINGULAR
        obtained = X[self.index] - self._values
        return Solution(
            mechanism=self._mechanism,
            X=X,
            status=status,
            residual=float(residual),
            rank=rank,
            undetermined=undetermined,
            imposed=dict(self.impose),
            deviation=dict(zip(self.impose, obtained.tolist(), strict=True)),
            out_of_range=self._outside(X),
            iterations=iterations,
            solver=solver,
        )

    def _is_allowed(self, X: Array, tolerance: float = 1e-9) -> bool:
        return not (self.within_ranges and self._outside(X, tolerance))

    def _outside(self, X: Array, tolerance: float = 1e-9) -> tuple[str, ...]:
        """Name the variables outside their ranges, up to a tolerance [m or rad]."""
        lower, upper = self.ranges
        within = (lower - tolerance <= X) & (upper + tolerance >= X)  # no number is not
        if within.all():
            return ()
        return tuple(n for n, w in zip(self._mechanism.names, within, strict=True) if not w)

    def _miss(self, X: Array) -> Array:
        """Give the scaled difference between obtained and imposed values, shape (n_imposed,)."""
        return (X[self.index] - self._values) / self._scale[self.index]

    def _target(self, start: Array) -> tuple[Array, Array]:
        target, weight = start.copy(), np.zeros_like(start)
        target[self.index] = self._values
        weight[self.index] = [self.weights[name] for name in self.impose]
        return target, weight

    @property
    def _mechanism(self) -> Mechanism:
        return self.functions.graph.mechanism

    @property
    def _scale(self) -> Array:
        return self.functions.graph.variable_scale

    @cached_property
    def index(self) -> list[int]:
        """Give the positions of the imposed variables."""
        return self._mechanism.indices(self.impose)

    @cached_property
    def _values(self) -> Array:
        return np.array(list(self.impose.values()), dtype=float)

    @cached_property
    def free(self) -> Array:
        """Give 1 for the variables that are solved for, 0 for the imposed ones, shape (n_variables,)."""
        free = np.ones(len(self._mechanism.names))
        free[self.index] = 0.0
        return free

    @property
    def ranges(self) -> tuple[Array, Array]:
        """Give the lowest and the highest value of every variable [m or rad], shape (n_variables,) each."""
        return self.functions.ranges
