"""A time law run faster here and slower there: the fastest stretching within limits of speed, acceleration and jerk.

A law s = r(u) from rest to rest is kept, and its own time u is run at a rate that varies: `(du/dt)^2 = y(u)`. Rest at
the ends needs no care, because r rests there, and y stays away from zero, so that all is regular. With derivatives of
r and of a variable q along the path, and `g = q o r`,

    velocity      g' y^(1/2)
    acceleration  g'' y + g' y' / 2
    jerk          y^(1/2) (g''' y + 3/2 g'' y' + g' y'' / 2)

The first two are linear in y. The bound on the third, `|g''' y + ...| <= J y^(-1/2)`, is not, but its right side is
convex: its tangent at a known y lies below it, and gives a linear bound that is on the safe side. So a sequence of
linear programs, each around the result of the one before, goes from one admissible rate to a faster one.

Source: Debrouwere2013.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.interpolate import BPoly, BSpline, PPoly
from scipy.optimize import linprog
from scipy.sparse.linalg import spsolve

from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bounds:
    """Hold what bounds the rate, at the places of a `Chart`.

    Attributes:
        a: Factors of the acceleration of s in rows `a s'' + b s'^2 + c <= 0`, at its places, shape (n, k).
        b: Factors of its squared speed.
        c: What is left at rest.
        dq: First derivatives with respect to s, over their jerk limits, at the sides, shape (k, m).
        ddq: Second derivatives alike.
        dddq: Third derivatives alike.
    """

    a: Array
    b: Array
    c: Array
    dq: Array
    ddq: Array
    dddq: Array


class Chart:
    """Hold the time of a law as a coordinate, and the quadratic splines in it from which a rate is made.

    Args:
        law: The law from rest to rest, piecewise cubic.
        u: Nodes, ascending from 0 to its duration; all breaks of the law, and all places where pieces of the path's
            spline meet, are among them: the jerk jumps there.
    """

    def __init__(self, law: TimeLaw, u: Array) -> None:
        self.law, self.u = law, u
        self.h = np.diff(u)
        self.sides, self.is_first = self._choose_sides()
        # bounds on speed and acceleration: at the nodes and half way between them, and more densely near the ends
        inner = ~np.isin(np.arange(len(self.sides)), self._outer)
        self.places = np.unique(np.concatenate([u, 0.5 * (u[1:] + u[:-1]), self.sides[inner]]))
        # near rest the rate changes too much for one piece of the resulting law to an interval
        ends = [np.linspace(*pair, 9) for pair in ((u[0], u[1]), (u[1], u[2]), (u[-3], u[-2]), (u[-2], u[-1]))]
        self.joints = np.unique(np.concatenate([u, *ends]))
        self.knots = np.concatenate([[u[0], u[0]], u, [u[-1], u[-1]]])
        self.size = len(u) + 1
        self._at_nodes = _design(self.knots, 2, 0, u)
        self._weight = np.zeros(len(u))
        self._weight[:-1] += 0.5 * self.h
        self._weight[1:] += 0.5 * self.h

    @classmethod
    def along(cls, path: Path, law: TimeLaw, count: int) -> Chart:
        """Build a chart of about `count` intervals."""
        T = law.duration
        knots = np.unique(path.spline.t)
        corners = np.unique(np.concatenate([law.breaks, law.time_at(knots[(knots > 0.0) & (knots < 1.0)])]))
        # where both meet within round-off one corner is enough
        corners = corners[np.concatenate([[True], np.diff(corners) > 1e-7 * T])]
        corners[-1] = T
        # as dense in time as along the path, and the phases of the law resolved, however short
        share = 0.5 * (np.diff(corners) / T + np.diff(law(corners)))
        pieces = np.maximum(4, np.ceil(count * share)).astype(int)
        ends = zip(corners[:-1], corners[1:], pieces, strict=True)
        u = np.concatenate([*[np.linspace(low, high, k, endpoint=False) for low, high, k in ends], [T]])
        return cls(law, _grade(u))

    def refined(self, pieces: NDArray[np.intp]) -> Chart:
        """Give the chart with those intervals halved to which some pieces of the law of `run` belong."""
        middles = 0.5 * (self.u[1:] + self.u[:-1])
        intervals = np.unique(np.searchsorted(self.u, 0.5 * (self.joints[1:] + self.joints[:-1])[pieces]) - 1)
        intervals = intervals[self.h[intervals] > 4e-4 * self.law.duration]
        return Chart(self.law, _grade(np.union1d(self.u, middles[intervals])))

    def transfer(self, y: Array, coarser: Chart) -> Array:
        """Write a rate of a chart from which this one was refined as a spline of this one."""
        places = 0.5 * (self.knots[1:-2] + self.knots[2:-1])
        values = BSpline(coarser.knots, y, 2)(places)
        return np.asarray(spsolve(_design(self.knots, 2, 0, places).tocsc(), values))

    def _choose_sides(self) -> tuple[Array, NDArray[np.bool_]]:
        """Choose places at which the jerk is bounded: both sides of every interval, and between them near the ends.

        There the speed is near zero, and nothing but the jerk keeps the rate from rising and falling in one interval.
        """
        n = len(self.h)
        from_end = np.minimum(np.arange(n), np.arange(n)[::-1])
        counts_wanted = np.where(from_end < 2, 25, np.where(from_end < 8, 7, 2))
        parts, firsts = [], []
        for u, h, wanted in zip(self.u[:-1], self.h, counts_wanted, strict=True):
            shares = np.linspace(1e-6, 1.0 - 1e-6, wanted)
            parts.append(u + h * shares)
            firsts.append(shares < 0.5)
        counts = np.array([len(part) for part in parts])
        last = np.cumsum(counts) - 1
        self._outer = np.union1d(last, last - counts + 1)
        return np.concatenate(parts), np.concatenate(firsts)

    def uniform(self, bounds: Bounds) -> Array:
        """Give the fastest rate that is the same everywhere."""
        d1, d2 = (self.law(self.places, order)[:, None] for order in (1, 2))
        moving, held = d2 * bounds.a + d1**2 * bounds.b, bounds.c < 0.0
        share = np.max(moving / np.where(held, -bounds.c, 1.0), initial=0.0, where=held)
        third = np.max(np.abs(self._jerk_terms(bounds)[2]), initial=0.0)
        return np.full(self.size, 1.0 / max(float(share), float(third) ** (2.0 / 3.0), 1e-300))

    def fastest(self, bounds: Bounds, start: Array, iterations: int, enough: float) -> Array:
        """Find the fastest rate by linear programs, each around the result of the one before.

        Args:
            bounds: What bounds it.
            start: Coefficients of an admissible rate; ones for the law as it is.
            iterations: Bound on the number of programs.
            enough: Gain of time that is not worth another one [1].

        Returns:
            Coefficients of the spline y, shape (size,).
        """
        P0, P1 = (_design(self.knots, 2, order, self.places) for order in (0, 1))
        S0, S1, S2 = (_design(self.knots, 2, order, self.sides) for order in (0, 1, 2))
        d1, d2 = (self.law(self.places, order)[:, None] for order in (1, 2))
        base = [_row(d2 * bounds.a + d1**2 * bounds.b, P0, 0.5 * d1 * bounds.a, P1)]
        right = [-bounds.c.T.reshape(-1)]
        g1, g2, g3 = self._jerk_terms(bounds)
        pull = sparse.vstack(
            [
                _scaled(S0, c) + _scaled(S1, 1.5 * b) + _scaled(S2, 0.5 * a)
                for a, b, c in zip(g1.T, g2.T, g3.T, strict=True)
            ]
        )
        k, y, best = g1.shape[1], start, self._time(start)
        for _ in range(iterations):
            here = S0 @ y
            lower = sparse.vstack([_scaled(S0, 0.5 * here**-1.5)] * k)
            level = np.tile(1.5 * here**-0.5, 2 * k)
            gain = self._at_nodes.T @ (0.5 * self._weight * (self._at_nodes @ y) ** -1.5)
            table = sparse.vstack([*base, lower + pull, lower - pull]) @ sparse.diags(y)
            step = _solve_program(gain * y, table.tocsr(), np.concatenate([*right, level]))
            if step is None:
                break
            shares = np.linspace(1.0, 0.0, 20, endpoint=False)
            times = [self._time(y + share * (step - 1.0) * y) for share in shares]
            i = int(np.argmin(times))
            if not times[i] < best:
                break
            y, before, best = y + shares[i] * (step - 1.0) * y, best, times[i]
            if best > before * (1.0 - enough):
                break
        return y

    def run(self, y: Array) -> TimeLaw:
        """Give the law s(t) for a rate: quintic pieces that meet with the speed and acceleration of the rate."""
        spline = BSpline(self.knots, y, 2)
        places, weights = np.polynomial.legendre.leggauss(6)
        u, h = self.joints, np.diff(self.joints)
        inside = u[:-1, None] + 0.5 * h[:, None] * (places + 1.0)
        dt = 0.5 * h * (spline(inside) ** -0.5 @ weights)
        value, slope = spline(u), spline.derivative()(u)
        d1, d2 = (self.law(u, order) for order in (1, 2))
        speed, acceleration = d1 * np.sqrt(value), d2 * value + 0.5 * d1 * slope
        # at rest, whatever round-off says
        speed[[0, -1]] = acceleration[[0, -1]] = 0.0
        t = np.concatenate([[0.0], np.cumsum(dt)])
        states = np.column_stack([self.law(u), speed, acceleration])
        states[0, 0], states[-1, 0] = 0.0, 1.0
        joined = PPoly.from_bernstein_basis(BPoly.from_derivatives(t, states))
        return TimeLaw(joined.x, joined.c)

    def _jerk_terms(self, bounds: Bounds) -> tuple[Array, Array, Array]:
        """Give the first three derivatives of the variables with respect to u, over their jerk limits."""
        d1, d2, d3 = (self.law(self.sides, order)[:, None] for order in (1, 2, 3))
        q1, q2, q3 = bounds.dq, bounds.ddq, bounds.dddq
        return q1 * d1, q2 * d1**2 + q1 * d2, q3 * d1**3 + 3.0 * q2 * d1 * d2 + q1 * d3

    def _time(self, y: Array) -> float:
        values = self._at_nodes @ y
        return float(self._weight @ values**-0.5) if np.all(values > 0.0) else np.inf


def _solve_program(gain: Array, table: sparse.csr_matrix, bound: Array) -> Array | None:
    """Maximise `gain . z` where `table z <= bound` for factors z of the present rate; None where that fails.

    The factors are held within limits, so that the tangents stay close.
    """
    size = np.maximum(np.abs(table).max(axis=1).toarray().reshape(-1), 1e-300)
    kept = size > 1e-9 * np.abs(bound)  # others are rows that no such factors can touch
    scaled = sparse.diags(1.0 / size[kept]) @ table[kept]
    solved = linprog(-gain, A_ub=scaled, b_ub=bound[kept] / size[kept], bounds=(0.05, 4.0), method="highs")
    return np.asarray(solved.x) if solved.status == 0 else None


def _grade(u: Array, most: float = 2.5) -> Array:
    """Halve intervals that are much longer than their neighbours, until none is."""
    while True:
        h = np.diff(u)
        beside = np.minimum(np.append(h[1:], np.inf), np.insert(h[:-1], 0, np.inf))
        wide = h > most * beside
        if not np.any(wide):
            return u
        u = np.union1d(u, 0.5 * (u[1:] + u[:-1])[wide])


def _design(knots: Array, degree: int, order: int, places: Array) -> sparse.csr_matrix:
    """Give the matrix from coefficients of a spline to derivatives at places."""
    step = sparse.identity(len(knots) - degree - 1, format="csr")
    for _ in range(order):
        n = len(knots) - degree - 1
        widths = degree / (knots[degree + 1 : degree + n] - knots[1:n])
        step = sparse.diags([-widths, widths], [0, 1], shape=(n - 1, n)) @ step
        knots, degree = knots[1:-1], degree - 1
    return sparse.csr_matrix(BSpline.design_matrix(places, knots, degree) @ step)


def _scaled(matrix: sparse.csr_matrix, factors: Array) -> sparse.csr_matrix:
    return sparse.csr_matrix(sparse.diags(factors) @ matrix)


def _row(first: Array, A: sparse.csr_matrix, second: Array, B: sparse.csr_matrix) -> sparse.csr_matrix:
    """Stack `diag(first_k) A + diag(second_k) B` for all columns k."""
    return sparse.vstack([_scaled(A, f) + _scaled(B, s) for f, s in zip(first.T, second.T, strict=True)], format="csr")
