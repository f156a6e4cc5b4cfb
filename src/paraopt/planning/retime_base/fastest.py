"""The fastest time law on a grid, from toppra, and why there is none."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint
from numpy.typing import NDArray
from scipy.optimize import linprog

from paraopt.errors import BackendError, RetimeError
from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.retime_base.limited import LimitedPath, limit_path
from paraopt.planning.retime_base.rows import PathConstraint, PathRows

Array = NDArray[np.float64]

# toppra reports its failures as warnings of its log; here they become errors that name their cause
logging.getLogger("toppra").setLevel(logging.CRITICAL)


def find_fastest(
    problem: Problem, path: Path, s: Array, constraints: Sequence[PathConstraint] = ()
) -> tuple[LimitedPath, PathRows, TimeLaw]:
    """Find the fastest time law whose limits hold at grid points.

    Args:
        problem: The problem, with its limits.
        path: The path.
        s: Grid points, ascending from 0 to 1.
        constraints: Further bounds.

    Returns:
        The path on the grid, which is completed near the ends where the motion needs it, all bounds there, and the law.

    Raises:
        DefinitionError: A limit is missing.
        RetimeError: There is no time law; the message names the cause and the place.

    Source: toppra.
    """
    limited = limit_path(problem, path, s, constraints)
    rows = limited.rows()
    scales = _Scales.of(rows)
    finer = _add_near_ends(s, scales)
    if len(finer) > len(s):
        s = finer
        limited = limit_path(problem, path, s, constraints)
        rows = limited.rows()
        scales = _Scales.of(rows)
    _check_moves(path, s, rows)
    speed = _call_toppra(path, s, rows, scales)
    means = 0.5 * (speed[1:] + speed[:-1])
    stopped = np.flatnonzero(means <= 1e-7 * np.sqrt(scales.x))
    if stopped.size:
        i = int(stopped[0])
        raise RetimeError(
            f"the path speed falls to zero at s = {s[i]:.4f} and stays there: {_tightest(rows, i)!r} leaves no "
            "speed; smooth the path there, or raise that limit",
            path=path,
            s=float(s[i]),
        )
    dt = np.diff(s) / means
    breaks = np.concatenate([[0.0], np.cumsum(dt)])
    return limited, rows, TimeLaw(breaks, np.vstack([0.5 * np.diff(speed) / dt, speed[:-1], s[:-1]]))


# --- The grid


def spread_grid(path: Path, n: int) -> Array:
    """Spread grid points, denser towards the ends, where the motion is slow, so that they are more even in time.

    The path's second derivative has its corners at the knots: they are grid points too.
    """
    u = np.linspace(0.0, 1.0, n + 1)
    spread = 0.3 * u + 0.7 * 0.5 * (1.0 - np.cos(np.pi * u))
    knots = np.unique(path.spline.t).clip(0.0, 1.0)
    near = np.min(np.abs(spread[:, None] - knots), axis=1) <= 0.1 / n
    return np.union1d(spread[~near], knots)


def refine_grid(s: Array, violated: Array) -> Array:
    """Halve the intervals in which a limit is exceeded, and their neighbours."""
    marked = np.zeros(len(s) - 1, dtype=bool)
    marked[np.clip(np.searchsorted(s, violated, side="right") - 1, 0, len(s) - 2)] = True
    wide = marked.copy()
    wide[1:] |= marked[:-1]
    wide[:-1] |= marked[1:]
    middles = 0.5 * (s[1:] + s[:-1])
    wide &= np.diff(s) > 1e-9
    return np.union1d(s, middles[wide])


@dataclass(frozen=True)
class _Scales:
    """Hold the size of squared speeds `x` and accelerations `u` of the parameter on this path.

    toppra's tolerances are absolute: it sees both divided by these, whatever the units of machine and path.
    """

    x: float
    u: float

    @classmethod
    def of(cls, rows: PathRows) -> _Scales:
        bound = np.where(rows.c < 0.0, -rows.c, np.inf)
        steepest = float(np.max(np.abs(rows.a) / bound))
        u = 1.0 / steepest if steepest > 0.0 else np.inf
        slopes = np.max(np.abs(rows.b) / bound, axis=1)
        x = float(1.0 / np.median(slopes)) if np.median(slopes) > 0.0 else np.inf
        if not np.isfinite(u):
            u = x
        # over a path of length one no more speed than this is ever gained
        return cls(min(x, u) if np.isfinite(u) else 1.0, u if np.isfinite(u) else 1.0)

    @property
    def stretch(self) -> float:
        """Give the length of the path in stretches over which the speed is gained; at least one."""
        return self.u / self.x


def _add_near_ends(s: Array, scales: _Scales) -> Array:
    """Add grid points near the ends where the speed is gained within few intervals."""
    gain = 0.5 / scales.stretch
    first = max(s[1], 1.0 - s[-2])
    if gain > 4.0 * first:
        return s
    steps = np.geomspace(max(0.1 * gain, 1e-9), max(4.0 * first, 1e-8), 24)
    more = np.concatenate([steps, 1.0 - steps])
    more = more[np.min(np.abs(more[:, None] - s), axis=1) > 0.02 * gain]
    return np.union1d(s, more)


# --- toppra


class _Rows(toppra.constraint.LinearConstraint):
    """Show rows at the grid points to toppra, on both ends of every interval."""

    def __init__(self, rows: PathRows, top: Array) -> None:
        super().__init__()
        self.discretization_type = toppra.constraint.DiscretizationType.Interpolation
        self.identical = True
        self._rows, self._top = rows, top

    def compute_constraint_params(self, path: Any, gridpoints: Array) -> tuple[Any, ...]:
        # toppra's own interpolation scheme, written out: a grid of few hundred points has no time for its Python loops
        rows, k = self._rows, self._rows.count
        deltas = np.diff(gridpoints)[:, None]
        a, b, c = (np.hstack([values, np.vstack([values[1:], values[-1:]])]) for values in (rows.a, rows.b, rows.c))
        a[:-1, k:] += 2.0 * deltas * rows.b[1:]
        bound = np.column_stack([np.zeros(len(self._top)), self._top])
        return a, b, c, np.eye(2 * k), np.zeros(2 * k), None, bound


class _Interval(toppra.interpolator.AbstractGeometricPath):
    """Tell toppra how long the path is; the rows hold all else."""

    def __init__(self, length: float) -> None:
        self.length = length

    def __call__(self, path_positions: Any, order: int = 0) -> Array:
        raise BackendError("toppra asked for the path itself")

    @property
    def dof(self) -> int:
        return 1

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, self.length])


def _call_toppra(path: Path, s: Array, rows: PathRows, scales: _Scales) -> Array:
    """Compute the speeds of the parameter at the grid points.

    Raises:
        RetimeError: There is no time law; the message names the cause.
    """
    bounds_speed = np.all(rows.a == 0.0, axis=0) & np.all(rows.b >= 0.0, axis=0) & np.all(rows.c < 0.0, axis=0)
    ratio = -rows.b[:, bounds_speed] / rows.c[:, bounds_speed]
    fastest = np.max(ratio, axis=1, initial=0.0)
    top = np.minimum(1.0 / np.maximum(fastest * scales.x, 1e-7), 1e7)
    a, b, c = (values[:, ~bounds_speed] * f for values, f in ((rows.a, scales.u), (rows.b, scales.x), (rows.c, 1.0)))
    size = np.max(np.abs(c), axis=0, initial=0.0)
    size = np.where(size > 0.0, size, np.maximum(np.max(np.abs(a), axis=0), np.max(np.abs(b), axis=0)))
    names = tuple(name for name, is_speed in zip(rows.names, bounds_speed, strict=True) if not is_speed)
    failed = None
    for relief in (0.0, 1e-8, 1e-6):  # its linear programs of two variables may fail by round-off
        tried = PathRows(names, a / size, b / size, c / size - relief)
        try:
            instance = toppra.algorithm.TOPPRA(
                [_Rows(tried, top)], _Interval(scales.stretch), gridpoints=scales.stretch * s, solver_wrapper="seidel",
                parametrizer="ParametrizeConstAccel",
            )  # fmt: skip
            _, speed, _, controllable = instance.compute_parameterization(0.0, 0.0, return_data=True)
        except ZeroDivisionError:  # a row of zeros that cannot hold: the reason is found below
            break
        except (ValueError, RuntimeError, FloatingPointError) as error:
            raise BackendError(f"toppra failed: {error}", path=path) from error
        if speed is not None and np.all(np.isfinite(speed)):
            return np.asarray(speed) * np.sqrt(scales.x)
        lost = np.flatnonzero(np.any(np.isnan(controllable), axis=1))
        failed = int(lost[-1]) if lost.size else int(np.argmax(np.isnan(speed))) if speed is not None else 0
    raise _explain(path, s, rows, scales, failed or 0)


# --- Why it failed


def _check_moves(path: Path, s: Array, rows: PathRows) -> None:
    """Refuse a path that stands still at an inner parameter, so that no bound tells how fast to pass.

    At a turning point one variable may stand still, but then its second derivative bounds the speed.
    """
    holding = _holding(rows)
    stalled = np.flatnonzero(holding[1:-1] <= 1e-9 * np.max(holding)) + 1
    if stalled.size:
        place = float(s[stalled[0]])
        raise RetimeError(
            f"the path stands still at s = {place:.4f}, where no speed of the parameter can follow it (a cusp, or "
            "repeated points); move the control points apart",
            path=path,
            s=place,
        )


def _holding(rows: PathRows) -> Array:
    """Give the inverse of the squared speed that the tightest bound which holds at rest leaves at each place."""
    size = np.maximum(np.abs(rows.c), 1e-300)
    return np.asarray(np.max(np.abs(rows.b) / size, axis=1, where=rows.c < 0.0, initial=0.0))


def _tightest(rows: PathRows, i: int) -> str:
    """Name the row that leaves least speed at a grid point."""
    slope = np.where(rows.c[i] < 0.0, rows.b[i] / np.where(rows.c[i] < 0.0, -rows.c[i], 1.0), np.inf)
    return rows.names[int(np.argmax(slope))]


def _explain(path: Path, s: Array, rows: PathRows, scales: _Scales, failed: int) -> RetimeError:
    """Find out why there is no time law: a row that cannot hold, at rest or at any speed, or a way between that fails.

    Args:
        path: The path.
        s: Grid points.
        rows: Bounds there.
        scales: Sizes of speed and acceleration.
        failed: Grid point at which toppra gave up.
    """
    for i, label in ((0, "start"), (len(s) - 1, "goal")):
        k, lack = _infeasible_row(rows, i, scales, at_rest=True)
        if lack > 1e-9:
            return RetimeError(
                f"{rows.names[k]!r} cannot hold at rest at the {label}: whatever the acceleration, it is exceeded by "
                f"{lack:.3g} of its size; choose another {label}, or loosen the bound",
                path=path, s=float(s[i]), row=rows.names[k],
            )  # fmt: skip
    suspects = np.flatnonzero(np.any(rows.c > 0.0, axis=1))
    for i in suspects[np.argsort(np.abs(suspects - failed), kind="stable")]:
        k, lack = _infeasible_row(rows, int(i), scales, at_rest=False)
        if lack > 1e-9:
            return RetimeError(
                f"no speed and no acceleration satisfy {rows.names[k]!r} at s = {s[i]:.4f} together with the "
                f"other bounds: it is exceeded by {lack:.3g} of its size; change the path there, or loosen the bound",
                path=path, s=float(s[i]), row=rows.names[k],
            )  # fmt: skip
    if suspects.size:
        return RetimeError(
            f"no time law reaches the goal from s = {s[failed]:.4f}: each place alone has speeds within all bounds, "
            f"but the accelerations between them do not; the tightest bound there is {_tightest(rows, failed)!r}",
            path=path, s=float(s[failed]), row=_tightest(rows, failed),
        )  # fmt: skip
    holding = _holding(rows)
    beside = slice(max(failed - 2, 1), failed + 3)
    slowest = beside.start + int(np.argmin(holding[beside]))
    if holding[slowest] < 0.03 * np.median(holding):
        return RetimeError(
            f"the path all but stands still at s = {s[slowest]:.4f}, where hardly any bound tells how fast to pass "
            "(nearly a cusp, or repeated points); move the control points apart",
            path=path,
            s=float(s[slowest]),
        )
    return RetimeError(
        f"toppra found no time law beyond s = {s[failed]:.4f}, though a slow one exists: its linear programs failed by "
        "round-off; change n_grid a little",
        path=path,
        s=float(s[failed]),
    )


def _infeasible_row(rows: PathRows, i: int, scales: _Scales, at_rest: bool) -> tuple[int, float]:
    """Give the row that is exceeded most at the least exceeding speed and acceleration, and by which share."""
    a, b, c = rows.a[i] * scales.u, rows.b[i] * scales.x, rows.c[i]
    size = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.maximum(np.abs(c), 1e-300))
    a, b, c = a / size, b / size, c / size
    table = np.column_stack([a, b, -np.ones(len(c))])
    solved = linprog(
        [0.0, 0.0, 1.0], A_ub=table, b_ub=-c, bounds=[(-1e6, 1e6), (0.0, 0.0 if at_rest else 1e6), (-1.0, None)]
    )
    if solved.status != 0:
        return 0, 0.0
    # among the rows that touch, the one that asks for motion is the cause
    touching = np.flatnonzero(table @ solved.x + c >= -1e-9)
    k = int(touching[np.argmax(c[touching])]) if touching.size else 0
    return k, float(solved.x[2])
