"""A trajectory: a path run by a time law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.robot import Robot

Array = NDArray[np.float64]


class Motion(Protocol):
    """Give all variables in time: what a certificate needs of a trajectory."""

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        ...

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate values (order 0), velocities (1) or accelerations (2)."""
        ...


@dataclass(frozen=True, eq=False)
class State:
    """Hold the state of all variables at n times (or one).

    Attributes:
        t: Times [s], shape (n,) or a number.
        X: Values [m or rad], shape (n, n_variables) or (n_variables,).
        velocity: First derivatives [m/s or rad/s], same shape.
        acceleration: Second derivatives [m/s^2 or rad/s^2], same shape.
    """

    t: Array
    X: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Describe the motion of all variables in time.

    Attributes:
        path: The geometric path.
        law: The path parameter in time.
        method: How it was timed.
        slowed: Factor by which it was slowed uniformly to hold the limits between grid points; 1 when it was not.
        n_grid: Number of points on which the time law was computed.
        without_jerk: Duration of the time-optimal law under the same limits but those of the jerk, as found on the
            grid [s]; none when it was not computed. A finer grid finds a law that is up to one percent faster.
    """

    path: Path
    law: TimeLaw
    method: str = ""
    slowed: float = 1.0
    n_grid: int = 0
    without_jerk: float | None = None

    @property
    def robot(self) -> Robot:
        """Give the machine."""
        return self.path.robot

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        return self.law.duration

    @property
    def gap(self) -> float | None:
        """Give the duration over that without jerk limits [1]; none when it was not computed."""
        return None if self.without_jerk is None else self.duration / self.without_jerk

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate all variables, or their derivatives with respect to time.

        Args:
            t: Times in [0, duration] [s], a number or shape (n,).
            order: 0 for values, 1 for velocities, 2 for accelerations.

        Returns:
            Shape (n_variables,) for a number, (n, n_variables) for an array.

        Raises:
            DefinitionError: A time is outside [0, duration], or the order is not 0, 1 or 2.
        """
        if order not in (0, 1, 2):
            raise DefinitionError(f"order is {order!r}; it must be 0, 1 or 2")
        if order == 0:
            s = self.law(self._check(t))
            return self.path(s, 0)
        state = self.state(t)
        return state.velocity if order == 1 else state.acceleration

    def state(self, t: ArrayLike) -> State:
        """Evaluate values, velocities and accelerations together."""
        times = self._check(t)
        flat = np.atleast_1d(times)
        s, ds, dds = self.law(flat), self.law(flat, 1)[:, None], self.law(flat, 2)[:, None]
        points = self.path.points(s)
        velocity, acceleration = points.dX * ds, points.ddX * ds**2 + points.dX * dds
        if np.ndim(times) == 0:
            return State(times, points.X[0], velocity[0], acceleration[0])
        return State(times, points.X, velocity, acceleration)

    def sample(self, period: float) -> State:
        """Sample at a constant period [s], the end included."""
        return self.state(spread_times(period, self.duration))

    def at(self, t: float) -> Mapping[str, float]:
        """Give the values by name at one time [s]."""
        return dict(zip(self.robot.mechanism.names, self(float(t)).tolist(), strict=True))

    def _check(self, t: ArrayLike) -> Array:
        return read_times(t, self.duration)


def read_times(t: ArrayLike, duration: float) -> Array:
    """Read times of a motion; what round-off puts beyond its ends is put on them.

    Args:
        t: Times [s], a number or any shape.
        duration: Length of the motion [s].

    Returns:
        The times in [0, duration], same shape.

    Raises:
        DefinitionError: A time is outside [0, duration].
    """
    times = np.asarray(t, dtype=float)
    slack = 1e-9 * max(duration, 1.0)
    if times.size and not (np.all(np.isfinite(times)) and times.min() >= -slack and times.max() <= duration + slack):
        raise DefinitionError(f"time is in [{times.min()}, {times.max()}] s; it must be in [0, {duration:.6g}] s")
    return np.clip(times, 0.0, duration)


def spread_times(period: float, duration: float) -> Array:
    """Spread times at a constant period over a motion, its end included.

    Args:
        period: Time between samples [s].
        duration: Length of the motion [s].

    Returns:
        The times [s], shape (n,).

    Raises:
        DefinitionError: The period is not finite and above 0.
    """
    if not (np.isfinite(period) and period > 0):
        raise DefinitionError(f"sampling period is {period} s; it must be finite and above 0")
    times = period * np.arange(int(np.floor(duration / period + 1e-9)) + 1)
    if duration - times[-1] > 1e-9:
        times = np.append(times, duration)
    return np.minimum(times, duration)
