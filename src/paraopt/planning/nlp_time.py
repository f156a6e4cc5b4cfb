"""The time-optimal law of a path as part of a refinement: the squared path speed at every sample is a variable.

With `b = (ds/dt)^2` at the samples and a constant `d2s/dt2 = (b[k+1] - b[k]) / (2 ds)` between them, the duration is
`sum 2 ds / (sqrt b[k] + sqrt b[k+1])`, a velocity limit reads `q'^2 b <= v^2`, and an acceleration limit
`|q' a + q'' b| <= A` at both ends of every interval. The derivatives q' and q'' of the actuators are differences of
their values at five neighbouring samples, so that all of it is exact in the values and the motions at the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TimeRows:
    """Hold the rows of the drives' limits; each is within [-1, 1], velocities within [0, 1].

    Attributes:
        values: Shape (n_rows,).
        d_q: Derivatives with respect to q' and q'' of the row's sample, shape (n_rows, 2).
        d_b: Derivatives with respect to all squared speeds, shape (n_rows, n).
    """

    values: Array
    d_q: Array
    d_b: Array


@dataclass(frozen=True, eq=False)
class TimeModel:
    """Time a path by its samples.

    Squared speeds are counted in `1 / unit^2`, so that they are near 1; those at both ends are zero.

    Attributes:
        s: Parameters of the samples, ends included, shape (n,).
        velocity: Limits of the actuators [m/s or rad/s], shape (a,).
        acceleration: Limits [m/s^2 or rad/s^2], shape (a,).
        unit: Unit of time [s].
    """

    s: Array
    velocity: Array
    acceleration: Array
    unit: float

    @property
    def n_b(self) -> int:
        """Give the number of squared speeds that are free."""
        return len(self.s) - 2

    @cached_property
    def differences(self) -> tuple[Array, Array]:
        """Give what takes values at the samples to first and second derivatives there, shape (n, n) each."""
        n = len(self.s)
        D1, D2 = np.zeros((n, n)), np.zeros((n, n))
        for k in range(n):
            first = int(np.clip(k - 2, 0, n - 5))
            near = self.s[first : first + 5] - self.s[k]
            width = float(np.max(np.abs(near)))
            powers = np.vander(near / width, 5, increasing=True).T
            inverse = np.linalg.inv(powers)
            D1[k, first : first + 5] = inverse[:, 1] / width
            D2[k, first : first + 5] = 2.0 * inverse[:, 2] / width**2
        return D1, D2

    @cached_property
    def place(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Give the sample and the actuator of every row: velocities, then accelerations at both ends of intervals."""
        n, a = len(self.s), len(self.velocity)
        at = np.concatenate([np.arange(1, n - 1), np.arange(n - 1), np.arange(1, n)])
        return np.repeat(at, a), np.tile(np.arange(a), len(at))

    @property
    def n_rows(self) -> int:
        """Give the number of rows."""
        return len(self.place[0])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Give the bounds of the rows."""
        high = np.ones(self.n_rows)
        low = -high
        low[: self._n_velocity] = -np.inf
        return low, high

    @cached_property
    def _n_velocity(self) -> int:
        return (len(self.s) - 2) * len(self.velocity)

    @cached_property
    def _rates(self) -> Array:
        """Take squared speeds to the path's accelerations of the intervals, shape (n - 1, n)."""
        n = len(self.s)
        rates = np.zeros((n - 1, n))
        half = 0.5 / np.diff(self.s)
        rates[np.arange(n - 1), np.arange(n - 1)] = -half
        rates[np.arange(n - 1), np.arange(1, n)] = half
        return rates

    @cached_property
    def _row_rates(self) -> Array:
        """Give the row of `_rates` that belongs to each row, zero for velocities; shape (n_rows, n)."""
        n, a = len(self.s), len(self.velocity)
        each = np.repeat(np.vstack([self._rates, self._rates]), a, axis=0)
        return np.vstack([np.zeros((self._n_velocity, n)), each])

    def full(self, b: Array) -> Array:
        """Add the ends, where the path rests."""
        return np.concatenate([[0.0], b, [0.0]])

    def duration(self, b: Array) -> tuple[float, Array, Array, Array]:
        """Give the duration over the unit, its gradient, and the diagonal and the next diagonal of its Hessian."""
        root = np.sqrt(np.maximum(self.full(b), 1e-12))
        root[[0, -1]] = 0.0
        total = root[:-1] + root[1:]
        step = 2.0 * np.diff(self.s)
        f = float(np.sum(step / total))
        slope, bend = -step / total**2, 2.0 * step / total**3
        inner = root[1:-1]
        d_root = 0.5 / inner
        gradient = (slope[:-1] + slope[1:]) * d_root
        diagonal = (bend[:-1] + bend[1:]) * d_root**2 - (slope[:-1] + slope[1:]) * 0.25 / inner**3
        off = bend[1:-1] * d_root[:-1] * d_root[1:]
        return f, gradient, diagonal, off

    def rows(self, q: Array, b: Array) -> TimeRows:
        """Evaluate the limits.

        Args:
            q: Actuators at all samples [m or rad], shape (n, a).
            b: Free squared speeds, shape (n - 2,).
        """
        D1, D2 = self.differences
        sample, drive = self.place
        speed = self.full(b)
        dq, ddq = (D1 @ q)[sample, drive], (D2 @ q)[sample, drive]
        v2 = (self.velocity * self.unit)[drive] ** 2
        A = (self.acceleration * self.unit**2)[drive]
        is_velocity = np.arange(self.n_rows) < self._n_velocity
        rate, here = self._row_rates @ speed, speed[sample]
        values = np.where(is_velocity, dq**2 * here / v2, (dq * rate + ddq * here) / A)
        d_dq = np.where(is_velocity, 2.0 * dq * here / v2, rate / A)
        d_ddq = np.where(is_velocity, 0.0, here / A)
        d_b = self._row_rates * (dq / A)[:, None]
        d_b[np.arange(self.n_rows), sample] += np.where(is_velocity, dq**2 / v2, ddq / A)
        return TimeRows(values, np.column_stack([d_dq, d_ddq]), d_b)

    def second(self, q: Array, b: Array, multipliers: Array) -> tuple[Array, Array, Array, Array]:
        """Give the second derivatives of `multipliers . values`.

        Returns:
            With respect to q' twice, shape (n, a); to q' and b, shape (n, a, n); to q'' and b, shape (n, a, n); and
            the first derivatives with respect to q, shape (n, a), which weigh the curvature of q itself.
        """
        D1, D2 = self.differences
        sample, drive = self.place
        n, a = q.shape
        speed = self.full(b)
        dq = (D1 @ q)[sample, drive]
        v2 = (self.velocity * self.unit)[drive] ** 2
        A = (self.acceleration * self.unit**2)[drive]
        is_velocity = np.arange(self.n_rows) < self._n_velocity
        here = np.eye(n)[sample]
        twice = np.zeros((n, a))
        np.add.at(twice, (sample, drive), np.where(is_velocity, 2.0 * speed[sample] / v2, 0.0) * multipliers)
        cross, cross_2 = np.zeros((n, a, n)), np.zeros((n, a, n))
        first = np.where(is_velocity, 2.0 * dq / v2, 0.0)[:, None] * here + self._row_rates / A[:, None]
        np.add.at(cross, (sample, drive), first * multipliers[:, None])
        np.add.at(cross_2, (sample, drive), (np.where(is_velocity, 0.0, 1.0 / A) * multipliers)[:, None] * here)
        d = self.rows(q, b).d_q * multipliers[:, None]
        by_dq, by_ddq = np.zeros((n, a)), np.zeros((n, a))
        np.add.at(by_dq, (sample, drive), d[:, 0])
        np.add.at(by_ddq, (sample, drive), d[:, 1])
        return twice, cross, cross_2, D1.T @ by_dq + D2.T @ by_ddq

    def guess(self, q: Array) -> Array:
        """Give squared speeds within the limits: a tent, lowered until it holds everywhere."""
        tent = np.minimum(self.s, 1.0 - self.s)[1:-1]
        low, high = 1e-12, 1e12
        for _ in range(100):
            middle = np.sqrt(low * high)
            if np.max(np.abs(self.rows(q, middle * tent).values)) < 0.95:
                low = middle
            else:
                high = middle
        return low * tent
