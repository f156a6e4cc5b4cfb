"""Time-optimal retiming with toppra, checked between its grid points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, RetimeError
from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.retime_base import (
    LimitedPath,
    LimitUse,
    PathConstraint,
    choose_times,
    find_fastest,
    find_stops,
    limit_path,
    measure_use,
    refine_grid,
    retime_parts,
    spread_grid,
)
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TimeOptimal:
    """Time a path as fast as the limits of speed and acceleration allow.

    Limited are the actuators, all other variables for which a limit is stated, the platform, and whatever further
    constraints say. All enter through exact first and second derivatives of the path. The time law is checked at ten
    times the density of the grid, and the grid is refined where a limit is exceeded; what little remains is removed by
    running the whole motion uniformly slower, which the trajectory reports.

    Attributes:
        n_grid: Number of grid intervals at first.
        refinements: How often the grid is refined where the limits are exceeded between its points.
        tolerated: Excess between grid points that is removed by uniform slowing instead [1].
        reserve: Share of the time that is added so that the limits also hold between the points of the check [1].
        constraints: Bounds beyond the limits of the problem; see `RowConstraint`.

    Source: toppra.
    """

    bounds_jerk: ClassVar[bool] = False
    n_grid: int = 100
    refinements: int = 4
    tolerated: float = 3e-3
    reserve: float = 3e-4
    constraints: Sequence[PathConstraint] = field(default=())

    def __post_init__(self) -> None:
        if self.n_grid < 4:
            raise DefinitionError(f"n_grid is {self.n_grid}; it must be at least 4")
        if self.refinements < 0:
            raise DefinitionError(f"refinements is {self.refinements}; it must not be negative")
        object.__setattr__(self, "constraints", tuple(self.constraints))

    def retime(self, problem: Problem, path: Path) -> Trajectory:
        """Time a path.

        Args:
            problem: The problem, with its limits.
            path: The path.

        Returns:
            A trajectory from rest to rest whose limits hold on a check ten times denser than the grid. It stops at
            corners of the path, where the first derivative jumps.

        Raises:
            DefinitionError: A limit is missing.
            RetimeError: There is no time law; the message names the cause and the place.
        """
        if (stops := find_stops(path, 1)).size:
            return retime_parts(self, problem, path, stops)
        s = spread_grid(path, self.n_grid)
        for attempt in range(self.refinements + 1):
            grid, rows, law = find_fastest(problem, path, s, self.constraints)
            s, n = grid.s, len(grid.s) - 1
            times = choose_times(path, law)
            limited = self._look_between(problem, path, grid, law, law(times))
            use = measure_use(limited, law, times)
            # where a bound asks for motion the law cannot be run slower: the grid must do alone
            can_slow = bool(np.all(rows.c <= 0.0) and np.all(limited.stated.c <= 0.0))
            holds = use.excess <= 1e-3 and use.stretch <= 1.0 + (self.tolerated if can_slow else 5e-4)
            if holds or attempt == self.refinements:
                break
            # a grid too coarse at one place is a little too coarse everywhere; after that only where it matters
            violated = use.stretch_at > 1.0 + 0.5 * self.tolerated if attempt else np.ones(len(times), dtype=bool)
            s = refine_grid(s, limited.s[violated])
        return self._finish(path, law, use, n, can_slow)

    def with_constraints(self, constraints: Sequence[PathConstraint]) -> Self:
        """Give the same retimer with other constraints."""
        return replace(self, constraints=constraints)

    def _look_between(self, problem: Problem, path: Path, grid: LimitedPath, law: TimeLaw, s: Array) -> LimitedPath:
        """Evaluate the path between grid points: through the closures, or by quintic pieces where these are as good.

        How good they are is measured in the middle of every interval, where they are worst.
        """
        if grid.platform is None and not grid.stated.count:
            middles = 0.5 * (grid.s[1:] + grid.s[:-1])
            exact, near = limit_path(problem, path, middles), grid.between(middles)
            speed = np.append(law.coefficients[1], 0.0)
            square = 0.5 * (speed[1:] ** 2 + speed[:-1] ** 2)[:, None]
            error = max(
                float(np.max(np.abs(exact.dq - near.dq) * np.sqrt(square) / grid.velocity)),
                float(np.max(np.abs(exact.ddq - near.ddq) * square / grid.acceleration)),
            )
            if error <= 0.2 * self.reserve:
                return grid.between(s)
        return limit_path(problem, path, s, self.constraints)

    def _finish(self, path: Path, law: TimeLaw, use: LimitUse, n: int, can_slow: bool) -> Trajectory:
        if use.excess > 1e-3 or (use.stretch > 1.0 + 1e-3 and not can_slow):
            raise RetimeError(
                f"the time law exceeds the bound {use.excess_row or 'of a velocity or acceleration'!r} between the "
                f"points of its grid by {100 * max(use.excess, use.stretch**2 - 1.0):.2g} %, and running it slower "
                f"cures nothing; raise n_grid ({self.n_grid}) or refinements ({self.refinements})",
                path=path,
                use=use,
            )
        factor = use.stretch * (1.0 + self.reserve) if can_slow else 1.0
        slowed = max(factor, 1.0)
        method = "time-optimal (toppra)"
        if slowed > 1.002:
            method += f", run {100 * (slowed - 1.0):.2g} % slower to hold the limits between grid points"
        return Trajectory(path, law.stretched(factor), method, slowed, n)
