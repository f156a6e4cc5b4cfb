"""Objective and constraints of a refinement as one vector function, with exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, ParaoptError
from paraopt.planning.evaluate import SampleEvaluator, SampleValues
from paraopt.planning.nlp_barrier import Barriers
from paraopt.planning.nlp_spline import SplineSpace
from paraopt.planning.nlp_time import TimeModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Objective:
    """Weigh what a path should be good at; all terms are without unit, about 1 for the seed.

    Attributes:
        length: Weight of the energy `integral |dx/ds|^2 / D^2`, least for the shortest path run evenly; D is the
            length of the seed.
        bending: Weight of `integral |d2x/ds2|^2 / D^2`.
        margin: Weight of the smallest singularity margin on the path, which is made large.
        time: Weight of the duration over that of the first guess, under the velocity and acceleration limits.
        evenness: Weight of `integral |dx/ds|^2 / D^2 - (integral |dx/ds| / D)^2`, zero for a path run evenly; it has no
            say in the shape. Of use where the length does not spread the samples.
    """

    length: float = 1.0
    bending: float = 0.0
    margin: float = 0.0
    time: float = 0.0
    evenness: float = 0.0

    def __post_init__(self) -> None:
        for name in ("length", "bending", "margin", "time", "evenness"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise DefinitionError(f"weight of {name} is {value}; it must be finite and not negative")
        if not self.length + self.bending + self.time > 0:
            raise DefinitionError("length, bending and time all weigh nothing: no path is better than another")

    @property
    def is_length(self) -> bool:
        """Tell whether only the length counts."""
        return self.bending == self.margin == self.time == 0.0


@dataclass(frozen=True, eq=False)
class Point:
    """Hold all that is known at one vector."""

    x: Array
    f: float
    grad_f: Array
    g: Array
    jac_g: Array
    values: SampleValues | None
    bend: Array | None = None  # second derivatives of the barriers at the samples


class Evaluation:
    """Compute objective, constraints and their exact derivatives for a vector x.

    x holds the free numbers of the spline; then, where asked for, the smallest margin, and the squared path speeds. The
    constraints are those of every inner sample (ranges, margins, user's own, distances, margin over the smallest one),
    sample by sample; then those of waypoints with a radius; then the limits of the drives. The last result is kept,
    because solvers ask for values and derivatives in separate calls.

    Args:
        evaluator: What evaluates the samples.
        space: The splines.
        objective: What counts.
        barriers: What keeps off the bounds.
        balls: Parameter, scaled centre (m,) with nan where it is free, and scaled radius of each near waypoint.
        time: How the path is timed, where time counts.
    """

    def __init__(
        self,
        evaluator: SampleEvaluator,
        space: SplineSpace,
        objective: Objective,
        barriers: Barriers,
        balls: Sequence[tuple[float, Array, float]] = (),
        time: TimeModel | None = None,
    ) -> None:
        self.evaluator, self.space, self.objective, self.barriers = evaluator, space, objective, barriers
        self.to_physical, self.time = space.to_physical, time
        self.points, self.moves = space.motions(space.samples[1:-1])
        self.n, self.m = self.points.shape
        self.n_y, self.n_level = space.n_y, int(objective.margin > 0)
        self.kinds = 2 if barriers.serial else 1
        self.per_sample = (
            len(evaluator.bounded) + 2 + len(evaluator.conditions) + len(evaluator.pairs) + self.n_level * self.kinds
        )
        self.balls = [(*space.motions(np.array([place])), centre, radius) for place, centre, radius in balls]
        self.n_b = time.n_b if time is not None else 0
        self.n_rows = time.n_rows if time is not None else 0
        self.n_x = self.n_y + self.n_level + self.n_b
        self.n_g = self.n * self.per_sample + len(self.balls) + self.n_rows
        self._flat = self.moves.reshape(self.n * self.m, self.n_y)
        self._thin = sp.csr_matrix(self._flat.T)  # a sample moves with few control points
        self._start_b = self.n_y + self.n_level
        energy = objective.length * space.energy(1)
        if objective.bending:
            energy = energy + objective.bending * space.energy(2)
        flat = space.directions.reshape(-1, self.n_y)
        self._energy = flat.T @ np.kron(energy, np.eye(self.m)) @ flat
        bent = (energy @ space.offset).ravel()
        self._linear = flat.T @ bent
        self._constant = float(space.offset.ravel() @ bent)
        self._rows, self._columns = self._list_entries()
        self._order = np.lexsort((self._rows, self._columns))  # columns first, as CasADi stores them
        self.pattern = (self._rows[self._order], self._columns[self._order])
        self.error: ParaoptError | None = None
        self._last: Point | None = None

    # -- structure -------------------------------------------------------------------------------------------------

    @cached_property
    def _touching(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """List which sample feels which free number: only control points whose basis functions reach it."""
        sample, column = np.nonzero(np.any(np.abs(self.moves) > 1e-14, axis=1))
        return sample, column

    def _list_entries(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        sample, column = self._touching
        shape = (len(sample), self.per_sample)
        rows = [np.broadcast_to(sample[:, None] * self.per_sample + np.arange(self.per_sample), shape).ravel()]
        columns = [np.broadcast_to(column[:, None], shape).ravel()]
        if self.n_level:
            each = np.arange(self.n)[:, None] * self.per_sample + np.arange(
                self.per_sample - self.kinds, self.per_sample
            )
            rows.append(each.ravel())
            columns.append(np.full(each.size, self.n_y))
        below = self.n * self.per_sample
        dense = [len(self.balls) * (self.n_y > 0), self.n_rows]
        for count in dense:
            rows.append(np.repeat(below + np.arange(count), self.n_y))
            columns.append(np.tile(np.arange(self.n_y), count))
            below += count
        if self.time is not None:
            r, c = self._time_pattern
            rows.append(below - self.n_rows + r)
            columns.append(self._start_b + c)
        return np.concatenate(rows), np.concatenate(columns)

    @cached_property
    def _time_pattern(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """List which limit feels which squared speed: those at the ends of its interval."""
        assert self.time is not None
        sample, _ = self.time.place
        row, column = np.nonzero(np.abs(np.arange(1, self.n_b + 1)[None, :] - sample[:, None]) <= 1)
        return row, column

    # -- values ----------------------------------------------------------------------------------------------------

    def __call__(self, x: Array) -> tuple[float, Array, Array, Array]:
        """Return objective, its gradient, constraints, and the nonzeros of their Jacobian."""
        point = self.at(x)
        return point.f, point.grad_f, point.g, point.jac_g

    def weigh(self, weight: float) -> None:
        """Change the weight of the barriers, as they are driven down."""
        if weight != self.barriers.weight:
            self.barriers = replace(self.barriers, weight=weight)
            if self._last is not None:  # the samples are where they were
                self._last = self._compute(self._last.x, self._last.values)

    def at(self, x: Array) -> Point:
        """Evaluate at x, or recall the last result."""
        if self._last is None or not np.array_equal(x, self._last.x):
            self._last = self._compute(np.array(x))
        return self._last

    def recall(self, point: Point) -> None:
        """Go back to an earlier result, so that the samples are followed from where they were then."""
        self._last = point
        if point.values is not None:
            self.evaluator.follow_from(point.values)

    def _compute(self, x: Array, known: SampleValues | None = None) -> Point:
        y, v = x[: self.n_y], known
        if v is None and np.all(np.isfinite(x)):
            v = self.evaluator((self.points + self.moves @ y) * self.to_physical)
        if v is None or not v.converged:  # the solver takes a shorter step
            nan = np.full(len(self.pattern[0]), np.nan)
            return Point(x, np.nan, np.full(self.n_x, np.nan), np.full(self.n_g, np.nan), nan, None)
        barrier, d_barrier, bend = self.barriers(v, self.evaluator)
        half = self._energy @ y
        f = float(y @ half + 2.0 * self._linear @ y) + self._constant + barrier
        d_f = np.zeros(self.n_x)
        if self.objective.evenness:
            uneven, d_uneven, _ = self._evenness(y)
            f += self.objective.evenness * uneven
            d_f[: self.n_y] = self.objective.evenness * d_uneven
        d_f[: self.n_y] += 2.0 * (half + self._linear) + (d_barrier * self.to_physical).ravel() @ self._flat
        g = [v.bounded, v.margins, v.conditions, v.distances / self.barriers.horizon]
        d_g = [v.d_bounded, v.d_margins, v.d_conditions, v.d_distances / self.barriers.horizon]
        if self.n_level:
            f -= self.objective.margin * float(x[self.n_y])
            d_f[self.n_y] = -self.objective.margin
            g.append(v.margins[:, : self.kinds] - x[self.n_y])
            d_g.append(v.d_margins[:, : self.kinds])
        by_sample = np.concatenate(d_g, axis=1) * self.to_physical
        sample, column = self._touching
        reach = self.moves[sample, :, column]
        entries = [np.einsum("pgm,pm->pg", by_sample[sample], reach).ravel()]
        values = [np.hstack(g).ravel()]
        if self.n_level:
            entries.append(np.full(self.n * self.kinds, -1.0))
        for point, move, centre, radius in self.balls:
            gap = np.nan_to_num(point[0] + move[0] @ y - centre)
            values.append(np.array([gap @ gap / radius**2]))
            entries.append(2.0 * gap @ move[0] / radius**2)
        if self.time is not None:
            b = x[self._start_b :]
            duration, d_duration, _, _ = self.time.duration(b)
            f += self.objective.time * duration
            d_f[self._start_b :] = self.objective.time * d_duration
            q, dq_dy = self._drives(v)
            rows = self.time.rows(q, b)
            D1, D2 = self.time.differences
            s, a = self.time.place
            ddq, dddq = np.tensordot(D1, dq_dy, 1)[s, a], np.tensordot(D2, dq_dy, 1)[s, a]
            values.append(rows.values)
            entries.append((rows.d_q[:, :1] * ddq + rows.d_q[:, 1:] * dddq).ravel())
            r, c = self._time_pattern
            entries.append(rows.d_b[r, c + 1])
        return Point(x, f, d_f, np.concatenate(values), np.concatenate(entries)[self._order], v, bend)

    @cached_property
    def _active(self) -> NDArray[np.intp]:
        mechanism = self.evaluator.problem.robot.mechanism
        return np.asarray(mechanism.indices(mechanism.active))

    def _drives(self, v: SampleValues) -> tuple[Array, Array]:
        """Give the actuators at all samples, ends included, shape (n, a), and their derivatives, shape (n, a, n_y)."""
        problem = self.evaluator.problem
        first = problem.start_configuration.X[self._active]
        last = self._last_drives(v)
        q = np.vstack([first, v.X[:, self._active], last])
        dq = np.zeros((self.n + 2, len(self._active), self.n_y))
        dq[1:-1] = (v.T[:, self._active] * self.to_physical) @ self.moves
        return q, dq

    def _last_drives(self, v: SampleValues) -> Array:
        """Solve the goal from the last sample, so that actuators that turn stay unwrapped."""
        problem = self.evaluator.problem
        closed = problem.space.solve(self.space.ends[1][None], v.X[-1:])
        return closed.X[0, self._active]

    # -- second derivatives ----------------------------------------------------------------------------------------

    def hessian(self, x: Array, weight_f: float, multipliers: Array) -> Array:
        """Give the second derivative of `weight_f f + multipliers . g`, shape (n_x, n_x).

        Length, bending, ranges, margins, the user's own constraints, waypoints and limits of the drives are exact;
        barriers enter by Gauss-Newton; distances by differences of their gradients.
        """
        H = np.zeros((self.n_x, self.n_x))
        y = slice(0, self.n_y)
        H[y, y] = 2.0 * weight_f * self._energy
        if self.objective.evenness:
            H[y, y] += weight_f * self.objective.evenness * self._evenness(x[: self.n_y])[2]
        point = self.at(x)
        v = point.values
        if v is None or point.bend is None:
            return H
        by_sample = multipliers[: self.n * self.per_sample].reshape(self.n, self.per_sample)
        b, u = len(self.evaluator.bounded), len(self.evaluator.conditions)
        W = weight_f * point.bend
        on_range, on_conditions = by_sample[:, :b], by_sample[:, b + 2 : b + 2 + u]
        on_margins = by_sample[:, b : b + 2].copy()
        if self.n_level:
            on_margins[:, : self.kinds] += by_sample[:, self.per_sample - self.kinds :]
        W = W + self.evaluator.bend_margins(v.X, v.T, on_margins)
        first = b + 2 + u
        on_distances = by_sample[:, first : first + len(self.evaluator.pairs)]
        W = W + self.evaluator.bend_distances(v.X, v.T, on_distances / self.barriers.horizon)
        weights = np.zeros_like(v.X)
        weights[:, self.evaluator.bounded] = on_range / self.evaluator.scale[self.evaluator.bounded]
        after = self.n * self.per_sample
        for k, (_, move, centre, radius) in enumerate(self.balls):
            counted = move[0][np.isfinite(centre)]
            H[y, y] += multipliers[after + k] * 2.0 / radius**2 * counted.T @ counted
        if self.time is not None:
            weights[:, self._active] += self._add_time(H, x, v, weight_f, multipliers[after + len(self.balls) :])
        is_bent = bool(np.any(np.abs(weights) > 1e-12))
        if u or is_bent:
            second = self.evaluator.second(v.X, v.T)
            if is_bent:
                W = W + np.einsum("nv,nvij->nij", weights, second)
            if u and np.any(on_conditions):
                W = W + self.evaluator.conditions.curvature(v.X, v.T, second, on_conditions)
        scaled = W * self.to_physical[:, None] * self.to_physical
        H[y, y] += self._thin @ (scaled @ self.moves).reshape(self.n * self.m, self.n_y)
        return H

    def _add_time(self, H: Array, x: Array, v: SampleValues, weight_f: float, multipliers: Array) -> Array:
        """Add the duration's and the limits' second derivatives; return what weighs the curvature of the actuators."""
        assert self.time is not None
        first, last = self._start_b, self.n_x
        b = x[first:]
        _, _, diagonal, off = self.time.duration(b)
        k = np.arange(first, last)
        H[k, k] += weight_f * self.objective.time * diagonal
        H[k[:-1], k[1:]] += weight_f * self.objective.time * off
        H[k[1:], k[:-1]] += weight_f * self.objective.time * off
        q, dq_dy = self._drives(v)
        twice, cross, cross_2, on_q = self.time.second(q, b, multipliers)
        D1, D2 = self.time.differences
        first_y, second_y = np.tensordot(D1, dq_dy, 1), np.tensordot(D2, dq_dy, 1)
        H[: self.n_y, : self.n_y] += np.einsum("kai,ka,kaj->ij", first_y, twice, first_y, optimize=True)
        size = -1, self.n_y
        mixed = first_y.reshape(size).T @ cross.reshape(-1, len(self.time.s))
        mixed += second_y.reshape(size).T @ cross_2.reshape(-1, len(self.time.s))
        H[: self.n_y, first:] += mixed[:, 1:-1]
        H[first:, : self.n_y] += mixed[:, 1:-1].T
        return on_q[1:-1]

    # -- evenness ------------------------------------------------------------------------------------------------

    @cached_property
    def _quadrature(self) -> tuple[Array, Array, Array]:
        """Give weights of points between the knots, slopes there for y = 0, and their change with y."""
        nodes, weights = np.polynomial.legendre.leggauss(4)
        edges = np.unique(self.space.knots)
        mid, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
        s = (mid[:, None] + half[:, None] * nodes).ravel()
        return (half[:, None] * weights).ravel(), *self.space.motions(s, 1)

    def _evenness(self, y: Array) -> tuple[float, Array, Array]:
        """Give the variance of the speed of s, its gradient, and its second derivative for a nearly even path."""
        weights, slopes, moves = self._quadrature
        slope = slopes + moves @ y
        speed = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
        length = float(weights @ speed)
        along = np.einsum("qm,qmy->qy", slope / speed[:, None], moves)
        d_length = weights @ along
        value = float(weights @ speed**2) - length**2
        gradient = 2.0 * np.einsum("q,qm,qmy->y", weights, slope, moves) - 2.0 * length * d_length
        return value, gradient, 2.0 * (along.T @ (weights[:, None] * along) - np.outer(d_length, d_length))
