"""Jerk-limited retiming: a profile of ruckig for the path parameter, run as fast at each place as the limits allow."""

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
    retime_parts,
    spread_grid,
    third_derivatives,
)
from paraopt.planning.retime_ruckig.profile import drop_slivers, solve_profile
from paraopt.planning.retime_ruckig.stretch import Bounds, Chart
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]

_SLIVER = 2e-3  # of the duration: in shorter intervals the third derivatives of the law drown in round-off


@dataclass(frozen=True)
class JerkLimited:
    """Time a path with limited velocity, acceleration and jerk of every actuator.

    First the speed, acceleration and jerk of the path parameter are bounded by constants that are safe everywhere on
    the path, and ruckig gives the fastest profile from rest to rest within them. Then the time of this profile is
    stretched and shrunk from place to place, as far as the limits allow; see `Chart`. The result is checked at ten
    times the density of the grid, which is refined where a limit is exceeded, and what little remains is removed by
    running the whole motion uniformly slower.

    The jerk of all other variables is limited too where a limit of it is stated, and so is all that `TimeOptimal`
    limits.

    Attributes:
        n_grid: Number of intervals, about.
        candidates: Number of speeds and of accelerations that are tried for the first profile.
        iterations: Bound on the number of linear programs.
        refinements: How often the grid is refined where the limits are exceeded between its points.
        tolerated: Excess between grid points that is removed by uniform slowing instead [1].
        enough: Gain of time that is not worth another one [1].
        reserve: Share of the time that is added so that the limits also hold between the points of the check [1].
        constraints: Bounds beyond the limits of the problem; see `RowConstraint`.

    Source: ruckig.
    """

    bounds_jerk: ClassVar[bool] = True
    n_grid: int = 200
    candidates: int = 10
    iterations: int = 12
    refinements: int = 2
    tolerated: float = 3e-3
    enough: float = 2e-3
    reserve: float = 3e-4
    constraints: Sequence[PathConstraint] = field(default=())

    def __post_init__(self) -> None:
        if self.n_grid < 8 or self.candidates < 1:
            raise DefinitionError(f"n_grid is {self.n_grid}, candidates {self.candidates}; at least 8 and 1 are needed")
        if self.iterations < 0:
            raise DefinitionError(f"iterations is {self.iterations}; it must not be negative")
        object.__setattr__(self, "constraints", tuple(self.constraints))

    def retime(self, problem: Problem, path: Path) -> Trajectory:
        """Time a path.

        Args:
            problem: The problem, with limits of velocity, acceleration and jerk of the actuators.
            path: The path.

        Returns:
            A trajectory from rest to rest that holds all limits on a check ten times denser than the grid. Its
            `without_jerk` is the duration of the fastest law without jerk limits. It stops where the first or the
            second derivative of the path jumps, as from a line to an arc.

        Raises:
            DefinitionError: A limit is missing.
            RetimeError: There is no time law; the message names the cause.
        """
        active = problem.robot.mechanism.active
        missing = [n for n, j in zip(active, problem.bounds.of("jerk", active), strict=True) if not np.isfinite(j)]
        if missing:
            raise DefinitionError(
                f"actuators {missing} have no jerk limit; state it in Limits(jerk=...)", limits=problem.bounds
            )
        if (stops := find_stops(path, 2)).size:
            return retime_parts(self, problem, path, stops)
        # without jerk limits there must be a law too: its failure names the cause
        _, rows, fastest = find_fastest(problem, path, spread_grid(path, self.n_grid), self.constraints)
        first = self._first_profile(problem, path)
        chart = Chart.along(path, first, self.n_grid)
        y = None
        for attempt in range(self.refinements + 1):
            bounds = self._bounds(problem, path, chart)
            y = chart.fastest(bounds, chart.uniform(bounds) if y is None else y, self.iterations, self.enough)
            law, n = chart.run(y), len(chart.joints) - 1
            use, times, held = self._measure(problem, path, law)
            violated = use.stretch_at > 1.0 + 0.5 * self.tolerated
            if use.stretch <= 1.0 + self.tolerated or attempt == self.refinements:
                break
            finer = chart.refined(np.unique(np.clip(np.searchsorted(law.breaks, times[violated]) - 1, 0, n - 1)))
            # a little slower the rate is admissible where it was not
            y, chart = finer.transfer(y, chart) / use.stretch**2, finer
        if use.excess > 1e-3 or (np.any(rows.c > 0.0) and use.stretch > 1.0 + 1e-3):
            raise RetimeError(
                f"no law with limited jerk was found that holds {use.excess_row or 'all bounds'!r}: it asks for "
                "motion, so running slower cures nothing; loosen it, or raise the jerk limits",
                path=path,
                use=use,
            )
        factor = use.stretch * (1.0 + self.reserve) if held else 1.0
        gap = law.duration * factor / fastest.duration
        method = f"jerk-limited (ruckig), {gap:.3f} times the time without jerk limits"
        slowed = max(factor, 1.0)
        if slowed > 1.002:
            method += f", run {100 * (slowed - 1.0):.2g} % slower to hold the limits between grid points"
        return Trajectory(path, law.stretched(factor), method, slowed, n, fastest.duration)

    def with_constraints(self, constraints: Sequence[PathConstraint]) -> Self:
        """Give the same retimer with other constraints."""
        return replace(self, constraints=constraints)

    def _measure(self, problem: Problem, path: Path, law: TimeLaw) -> tuple[LimitUse, Array, bool]:
        """Check a law at ten times the density of the grid, and tell whether it may be run slower."""
        times = choose_times(path, law)
        limited = limit_path(problem, path, law(times), self.constraints)
        use = measure_use(limited, law, times, third_derivatives(problem, path, law(times)))
        return use, times, bool(np.all(limited.stated.c <= 0.0))

    def _first_profile(self, problem: Problem, path: Path) -> TimeLaw:
        """Give the fastest profile of ruckig within constant bounds that are safe everywhere on the path."""
        s = np.linspace(0.0, 1.0, self.n_grid + 1)
        limited = limit_path(problem, path, s, self.constraints)
        third = np.max(np.abs(third_derivatives(problem, path, s)), axis=0)
        triples = self._triples(limited, third)
        if not triples:
            raise RetimeError("no speed keeps the actuators within their limits on this path", path=path)
        chosen, T = min(((t, solve_profile(*t).duration) for t in triples), key=lambda pair: pair[1])
        # phases so short that the grid would not resolve them are made longer, or left out; the stretching takes up
        # the time, and makes up for what is exceeded
        phase = 5.0 * _SLIVER * T
        speed = chosen[0]
        acceleration = min(chosen[1], speed / phase)
        jerk = min(chosen[2], acceleration / phase)
        laws = [
            drop_slivers(solve_profile(share * speed, acceleration, jerk), _SLIVER)
            for share in np.linspace(1.0, 0.8, 9)
        ]
        # the jerk jumps where phases meet and at the knots of the path: both should be the same or well apart
        knots = np.unique(path.spline.t)[1:-1].clip(0.0, 1.0)
        return next(
            (law for law in laws if _distance(law, knots) > _SLIVER), max(laws, key=lambda o: _distance(o, knots))
        )

    def _triples(self, limited: LimitedPath, third: Array) -> list[tuple[float, float, float]]:
        """List bounds (speed, acceleration, jerk) of the parameter that keep all within their limits."""
        rows = limited.rows()
        bound = np.where(rows.c < 0.0, -rows.c, np.inf)
        a, b = np.abs(rows.a) / bound, np.abs(rows.b) / bound
        d1, d2, d3 = (np.abs(d) / limited.jerk for d in (limited.dq, limited.ddq, third))
        only_speed = np.all(a == 0.0, axis=0)
        # the speed at which nothing is left of a speed limit, of an acceleration limit, of a jerk limit
        top = 1.0 / float(
            max(
                np.max(b[:, only_speed], initial=0.0) ** 0.5,
                1.001 * np.max(b[:, ~only_speed], initial=0.0) ** 0.5,
                1.001 * np.max(d3, initial=0.0) ** (1.0 / 3.0),
                1e-300,
            )
        )
        a, b = a[:, ~only_speed], b[:, ~only_speed]
        triples = []
        for share in [*np.linspace(1.0, 0.0, self.candidates, endpoint=False), *np.geomspace(0.05, 1e-4, 6)]:
            V = share * top
            room, left = 1.0 - b * V**2, 1.0 - d3 * V**3
            A_top = 1.0 / max(float(np.max(a / room)), float(np.max(3.0 * d2 * V / left)))
            for fraction in np.linspace(1.0, 0.0, max(self.candidates // 2, 1), endpoint=False):
                A = fraction * A_top
                rest = left - 3.0 * d2 * V * A
                if np.all(rest > 0.0):
                    triples.append((V, A, 1.0 / float(np.max(d1 / rest))))
        return triples

    def _bounds(self, problem: Problem, path: Path, chart: Chart) -> Bounds:
        """Collect what bounds the rate at the nodes and sides of a chart."""
        rows = limit_path(problem, path, chart.law(chart.places), self.constraints).rows()
        sides = chart.law(chart.sides)
        limited = limit_path(problem, path, sides)
        before, after = third_derivatives(problem, path, sides)
        # at the first place of an interval the piece after it counts, at the last one that before it
        third = np.where(chart.is_first[:, None], after, before)
        jerks = np.isfinite(limited.jerk)
        scale = limited.jerk[jerks]
        return Bounds(rows.a, rows.b, rows.c, *[d[:, jerks] / scale for d in (limited.dq, limited.ddq, third)])


def _distance(law: TimeLaw, knots: Array) -> float:
    """Tell how near a phase of a law ends to a knot of the path without ending there, as a share of the duration."""
    if not knots.size:
        return np.inf
    gaps = np.abs(law.time_at(knots)[:, None] - law.breaks[1:-1]) / law.duration
    return float(np.min(gaps, initial=np.inf, where=gaps > 1e-7))
