"""Paths with corners: where a derivative jumps no speed can be kept, so the motion comes to rest there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path, PathPoints
from paraopt.planning.problem import Problem
from paraopt.planning.retime_base.rows import PathConstraint, PathRows
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]


class PartRetimer(Protocol):
    """Time a path, with constraints that can be stated anew for a part of it."""

    @property
    def constraints(self) -> Sequence[PathConstraint]:
        """Give the bounds beyond the limits of the problem."""
        ...

    def with_constraints(self, constraints: Sequence[PathConstraint]) -> Self:
        """Give the same retimer with other constraints."""
        ...

    def retime(self, problem: Problem, path: Path) -> Trajectory:
        """Time a path."""
        ...


def find_stops(path: Path, order: int, tolerance: float = 1e-6) -> Array:
    """Find where a motion along a path must come to rest.

    With a speed, a jump of the first derivative would ask for an infinite acceleration, and one of the second for an
    infinite jerk. Where the path itself stands still at a corner, it is a place to stop too.

    Args:
        path: The path.
        order: Highest derivative that must not jump.
        tolerance: Jumps over the largest derivative that are let pass [1].

    Returns:
        Inner parameters, ascending.
    """
    spline = path.spline
    knots, counts = np.unique(spline.t, return_counts=True)
    inner = (counts > spline.k - order) & (knots > 0.0) & (knots < 1.0)
    if not np.any(inner):
        return np.zeros(0)
    s = np.linspace(0.0, 1.0, 257)
    stops = []
    for knot in knots[inner]:
        for derivative in range(1, order + 1):
            before, after = spline(np.array([np.nextafter(knot, 0.0), knot]), derivative)
            most = float(np.max(np.abs(spline(s, derivative)), initial=1e-300))
            stands = derivative == 1 and max(np.max(np.abs(before)), np.max(np.abs(after))) < 1e-9 * most
            if stands or np.max(np.abs(after - before)) > tolerance * most:
                stops.append(float(knot))
                break
    return np.array(stops)


def retime_parts(retimer: PartRetimer, problem: Problem, path: Path, stops: Array) -> Trajectory:
    """Time the parts between stops one by one, each from rest to rest.

    Args:
        retimer: What times a part.
        problem: The problem, with its limits.
        path: The path.
        stops: Inner parameters, ascending.

    Returns:
        The trajectory over the whole path.

    Raises:
        RetimeError: A part cannot be timed.
    """
    edges = np.concatenate([[0.0], stops, [1.0]])
    timed = []
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        constraints = [_OnPart(constraint, low, high) for constraint in retimer.constraints]
        dynamics = [_OnPart(constraint, low, high) for constraint in problem.dynamics]
        part = replace(problem, dynamics=dynamics), cut_path(path, low, high)
        timed.append(retimer.with_constraints(constraints).retime(*part))
    order = max(len(one.law.coefficients) for one in timed)
    breaks, pieces, now = [np.zeros(1)], [], 0.0
    for one, low, high in zip(timed, edges[:-1], edges[1:], strict=True):
        piece = np.zeros((order, one.law.coefficients.shape[1]))
        piece[order - len(one.law.coefficients) :] = one.law.coefficients * (high - low)
        piece[-1] += low
        pieces.append(piece)
        breaks.append(now + one.law.breaks[1:])
        now = float(breaks[-1][-1])
    law = TimeLaw(np.concatenate(breaks), np.hstack(pieces))
    slowed = max(one.slowed for one in timed)
    method = f"{timed[0].method.split(',')[0]}, {len(stops)} stop{'s' * (len(stops) > 1)} at corners"
    if slowed > 1.002:
        method += f", run up to {100 * (slowed - 1.0):.2g} % slower to hold the limits between grid points"
    free = [one.without_jerk for one in timed if one.without_jerk is not None]
    without_jerk = sum(free) if len(free) == len(timed) else None
    if without_jerk is not None:
        method += f", {law.duration / without_jerk:.3f} times the time without jerk limits"
    return Trajectory(path, law, method, slowed, sum(one.n_grid for one in timed), without_jerk)


def cut_path(path: Path, low: float, high: float, count: int = 33) -> Path:
    """Give a part of a path as a path of its own, over [0, 1]."""
    spline = path.spline
    k, inside = spline.k, spline.t[(spline.t > low) & (spline.t < high)]
    knots = np.concatenate([np.full(k + 1, low), inside, np.full(k + 1, high)])
    n = len(knots) - k - 1
    # the part lies in the space of these knots, and so any n fitting points give it exactly
    s = np.array([knots[i + 1 : i + k + 1].mean() for i in range(n)]).clip(low, high)
    values = spline(np.where(s >= high, np.nextafter(high, low), s))
    part = make_interp_spline(s, values, k, t=knots)
    width = high - low
    anchors = np.union1d(np.linspace(low, high, count), path.anchors[(path.anchors > low) & (path.anchors < high)])
    X = path.solve(anchors)
    return replace(path, spline=BSpline((knots - low) / width, part.c, k), anchors=(anchors - low) / width, anchor_X=X)


@dataclass(frozen=True)
class _OnPart:
    """State a constraint of a whole path in the parameter of a part."""

    whole: PathConstraint
    low: float
    high: float

    def rows(self, problem: Problem, points: PathPoints) -> PathRows:
        width = self.high - self.low
        there = replace(points, s=self.low + width * points.s, dX=points.dX / width, ddX=points.ddX / width**2)
        rows = self.whole.rows(problem, there)
        return PathRows(rows.names, rows.a * width, rows.b * width**2, rows.c)
