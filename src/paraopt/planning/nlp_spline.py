"""Splines whose control points obey linear conditions: ends, points to pass through, parts that are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly, make_interp_spline, make_lsq_spline

from paraopt.errors import DefinitionError, RefineError, unknown_name
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Waypoint:
    """Ask a path to pass through a place.

    Attributes:
        values: Independent coordinates by name [m or rad]; those left out are free.
        radius: How far from the place the path may pass, in the problem's metric [m]; 0 passes through it exactly.
    """

    values: Mapping[str, float]
    radius: float = 0.0

    def __post_init__(self) -> None:
        if not self.values or not all(np.isfinite(v) for v in self.values.values()):
            raise DefinitionError(f"waypoint {dict(self.values)} must state finite values of at least one coordinate")
        if not (np.isfinite(self.radius) and self.radius >= 0):
            raise DefinitionError(f"radius of a waypoint is {self.radius} m; it must be finite and not negative")


@dataclass(frozen=True, eq=False)
class ToolPath:
    """Ask a path to follow a given curve exactly over a part of itself, as in machining.

    The curve gives some of the independent coordinates, or all of them; what it leaves out, the redundancy, is chosen
    by the refiner, and so is the timing. To give the way of a tool's tip, let the operational variables be those of a
    link whose origin is the tip.

    Attributes:
        names: Independent coordinates that the curve gives.
        curve: Their spline over [0, 1], of a degree not above the refiner's, smooth inside.
    """

    names: Sequence[str]
    curve: BSpline

    def __post_init__(self) -> None:
        shape = np.shape(self.curve(0.0))
        if not self.names or shape != (len(self.names),):
            raise DefinitionError(f"tool path gives values of shape {shape} for the coordinates {list(self.names)}")
        if abs(self.curve.t[self.curve.k]) > 1e-12 or abs(self.curve.t[-self.curve.k - 1] - 1.0) > 1e-12:
            raise DefinitionError("curve of a tool path must be given over [0, 1]")


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """Hold the splines that obey the linear conditions of a refinement: `controls = offset + directions @ y`.

    Lengths and angles are scaled: multiplied by the metric and divided by `unit`.

    Attributes:
        knots: Knots.
        degree: Degree.
        samples: Parameters at which a path is judged, ends included, shape (n,).
        ends: First and last point [m or rad], shape (2, m).
        to_physical: What multiplies scaled coordinates, shape (m,).
        offset: Scaled control points for y = 0, shape (controls, m).
        directions: Shape (controls, m, n_y).
        places: Parameter of each waypoint.
        spans: First and last parameter of each tool path.
    """

    knots: Array
    degree: int
    samples: Array
    ends: Array
    to_physical: Array
    offset: Array
    directions: Array
    places: tuple[float, ...] = ()
    spans: tuple[tuple[float, float], ...] = ()

    @property
    def n_y(self) -> int:
        """Give the number of free numbers."""
        return int(self.directions.shape[2])

    @cached_property
    def basis(self) -> BSpline:
        """Give all basis functions."""
        return BSpline(self.knots, np.eye(len(self.offset)), self.degree)

    def motions(self, s: Array, order: int = 0) -> tuple[Array, Array]:
        """Give the scaled points at parameters for y = 0, shape (n, m), and their change with y, shape (n, m, n_y)."""
        values = self.basis(s, order)
        return values @ self.offset, np.einsum("nc,cmy->nmy", values, self.directions)

    def energy(self, order: int) -> Array:
        """Integrate products of the basis functions' derivatives exactly; shape (controls, controls)."""
        return integrate_products(self.basis, self.knots, order)

    def controls(self, y: Array) -> Array:
        """Give the scaled control points, shape (controls, m)."""
        return self.offset + self.directions @ np.asarray(y)

    def spline(self, y: Array) -> BSpline:
        """Give the spline [m or rad]."""
        controls = self.controls(y) * self.to_physical
        controls[[0, -1]] = self.ends  # to the last bit
        return BSpline(self.knots, controls, self.degree)

    def project(self, spline: BSpline) -> Array:
        """Find the y whose spline is nearest to a given one, in the sense of least squares at its samples."""
        s = np.linspace(0.0, 1.0, 8 * len(self.samples))
        weights = np.ones_like(s)
        fitted = make_lsq_spline(s, spline(s), self.knots, self.degree, w=weights)
        return self.nearest(fitted.c / self.to_physical)

    def nearest(self, controls: Array) -> Array:
        """Find the y whose control points are nearest to given scaled ones."""
        flat = self.directions.reshape(-1, self.n_y)
        return np.asarray(np.linalg.lstsq(flat, (controls - self.offset).ravel(), rcond=None)[0])


def build_space(
    problem: Problem,
    ends: Array,
    unit: float,
    knots: Array,
    degree: int,
    samples: Array,
    *,
    rest: bool = False,
    waypoints: Sequence[tuple[float, Waypoint]] = (),
    tool_paths: Sequence[tuple[float, float, ToolPath]] = (),
) -> SplineSpace:
    """Build the space of splines that obey the conditions.

    Args:
        problem: The problem.
        ends: First and last point, shape (2, m).
        unit: What scaled lengths are divided by [m].
        knots: Knots; the ends of tool paths and their own knots are added.
        degree: Degree.
        samples: Parameters at which a path is judged.
        rest: Whether the first derivative vanishes at both ends.
        waypoints: Exact and near ones with their parameters; near ones set no linear condition.
        tool_paths: Tool paths with their spans.

    Raises:
        RefineError: The conditions contradict each other.
    """
    m = len(problem.independent)
    to_physical = unit / problem.metric
    for first, last, tool in tool_paths:
        inner = np.unique(tool.curve.t)[1:-1] * (last - first) + first
        knots = knots[(knots <= first + 1e-9) | (knots >= last - 1e-9)]
        knots = np.sort(np.concatenate([knots, inner]))
        for edge in (first, last):
            if 1e-9 < edge < 1.0 - 1e-9:
                knots = knots[np.abs(knots - edge) > 1e-9]
                knots = np.sort(np.concatenate([knots, np.full(degree, edge)]))
    basis = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    n = basis.c.shape[0]
    conditions = _Conditions(n, m)
    for i, end in enumerate(ends / to_physical):
        conditions.fix(np.eye(n)[-i], end)
        if rest:
            conditions.fix(np.eye(n)[1 - 3 * i], end)
    for place, waypoint in waypoints:
        index = _indices(problem, waypoint.values)
        if waypoint.radius == 0.0:
            wanted = np.array(list(waypoint.values.values())) / to_physical[index]
            conditions.fix(basis(place), wanted, index)
    for first, last, tool in tool_paths:
        index = _indices(problem, tool.names)
        place = int(np.flatnonzero(knots <= first + 1e-9)[-1]) - degree
        inner = knots[(knots > first + 1e-9) & (knots < last - 1e-9)]
        local = np.concatenate([np.full(degree + 1, first), inner, np.full(degree + 1, last)])
        for i, control in enumerate(_refit(tool, local, degree, first, last) / to_physical[index]):
            conditions.fix(np.eye(n)[place + i], control, index)
        for edge in (first, last):
            if 1e-9 < edge < 1.0 - 1e-9:
                for jump in _jumps(basis, edge, degree):
                    conditions.fix(jump, np.zeros(m))
    offset, directions = conditions.solve()
    return SplineSpace(
        knots, degree, samples, ends, to_physical, offset, directions,
        tuple(place for place, _ in waypoints), tuple((first, last) for first, last, _ in tool_paths),
    )  # fmt: skip


class _Conditions:
    """Collect linear conditions on control points and solve them for as many as they fix."""

    def __init__(self, n: int, m: int) -> None:
        self.n, self.m = n, m
        self.rows: list[Array] = []
        self.values: list[float] = []

    def fix(self, weights: Array, value: Array, index: Sequence[int] | None = None) -> None:
        """Ask that `weights @ controls[:, j]` has a value, for some coordinates j."""
        for j, wanted in zip(range(self.m) if index is None else index, value, strict=True):
            row = np.zeros((self.n, self.m))
            row[:, j] = weights
            self.rows.append(row.ravel())
            self.values.append(float(wanted))

    def solve(self) -> tuple[Array, Array]:
        """Eliminate a control point with each condition; the others stay free, so that the result stays sparse."""
        A, b = np.array(self.rows), np.array(self.values)
        size = A.shape[1]
        pivots: list[tuple[int, int]] = []
        for i in range(len(A)):
            column = int(np.argmax(np.abs(A[i])))
            if abs(A[i, column]) < 1e-9:
                if abs(b[i]) > 1e-7:
                    raise RefineError(
                        f"the ends, waypoints and tool paths contradict each other by {abs(b[i]):.2g} of the length"
                    )
                continue
            b[i] /= A[i, column]
            A[i] /= A[i, column]
            for other in np.flatnonzero(A[:, column]):
                if other != i:
                    b[other] -= A[other, column] * b[i]
                    A[other] -= A[other, column] * A[i]
            A[:, column] = 0.0
            A[i, column] = 1.0
            pivots.append((i, column))
        rows, fixed = np.array(pivots, dtype=int).reshape(-1, 2).T
        free = np.setdiff1d(np.arange(size), fixed)
        offset, directions = np.zeros(size), np.zeros((size, len(free)))
        directions[free, np.arange(len(free))] = 1.0
        offset[fixed] = b[rows]
        directions[fixed] = -A[np.ix_(rows, free)]
        return offset.reshape(self.n, self.m), directions.reshape(self.n, self.m, -1)


def _indices(problem: Problem, names: Sequence[str] | Mapping[str, float]) -> list[int]:
    known = list(problem.independent)
    for name in names:
        if name not in known:
            raise unknown_name("independent coordinate", name, known)
    return [known.index(name) for name in names]


def _refit(tool: ToolPath, knots: Array, degree: int, first: float, last: float) -> Array:
    """Write a curve on finer knots and of a higher degree; shape (controls, k)."""
    n = len(knots) - degree - 1
    s = np.clip([knots[i + 1 : i + degree + 1].mean() for i in range(n)], first, last)
    u = np.clip((s - first) / (last - first), 0.0, 1.0)
    fitted = make_interp_spline(s, tool.curve(u), degree, t=knots)
    between = np.linspace(first, last, 97)
    error = np.max(np.abs(fitted(between) - tool.curve((between - first) / (last - first))))
    if error > 1e-9 * max(1.0, float(np.max(np.abs(fitted.c)))):
        raise DefinitionError(
            f"the curve of a tool path, of degree {tool.curve.k}, is no smooth spline of degree {degree} (off by "
            f"{error:.2g}); raise the refiner's degree or smooth the curve"
        )
    return np.asarray(fitted.c)


def _jumps(basis: BSpline, edge: float, degree: int) -> list[Array]:
    """Give the jumps of the first two derivatives of all basis functions at a knot."""
    single = [PPoly.from_spline(BSpline(basis.t, column, degree)) for column in basis.c.T]
    breaks, coefficients = single[0].x, np.stack([piece.c for piece in single], axis=2)
    inside = np.flatnonzero(np.diff(breaks) > 0)
    left = inside[np.flatnonzero(np.abs(breaks[inside + 1] - edge) < 1e-9)[0]]
    right = inside[np.flatnonzero(np.abs(breaks[inside] - edge) < 1e-9)[0]]
    width = breaks[left + 1] - breaks[left]
    rows = []
    for order in (1, 2):
        powers = np.arange(degree, -1, -1)
        factor = np.where(powers >= order, np.prod([powers - i for i in range(order)], axis=0), 0.0)
        reach = np.where(powers >= order, width ** np.maximum(powers - order, 0), 0.0)
        before = (factor * reach) @ coefficients[:, left]
        after = factor[degree - order] * coefficients[degree - order, right]
        row = before - after
        rows.append(row / np.max(np.abs(row)))
    return rows


def integrate_products(basis: BSpline, knots: Array, order: int) -> Array:
    """Integrate products of derivatives of basis functions exactly; shape (controls, controls)."""
    points, weights = np.polynomial.legendre.leggauss(basis.k + 1)
    edges = np.unique(knots)
    mid, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    s = (mid[:, None] + half[:, None] * points).reshape(-1)
    w = (half[:, None] * weights).reshape(-1)
    slopes = basis(s, order)
    return np.asarray(slopes.T @ (w[:, None] * slopes))


def locate(line: Seed | BSpline, problem: Problem, values: Mapping[str, float], after: float) -> float:
    """Find where a seed or a spline passes nearest to a place.

    Args:
        line: The seed, by shares of its length, or the spline.
        problem: The problem.
        values: Independent coordinates by name [m or rad].
        after: Parameter before which it is not looked for.

    Returns:
        The parameter.

    Raises:
        RefineError: Nothing is left of the line.
    """
    index = _indices(problem, values)
    s = np.linspace(0.0, 1.0, 2001)
    s = s[s > after + 1e-3]
    if not s.size:
        raise RefineError(f"the path ends before {dict(values)}; list waypoints and tool paths in their order")
    points = line.at(s) if isinstance(line, Seed) else line(s)
    gap = (points[:, index] - np.array(list(values.values()))) * problem.metric[index]
    return float(s[np.argmin(np.linalg.norm(gap, axis=1))])
