"""Limits of a motion as rows on its coordinates: speeds, accelerations, ways that are left, and margins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics.motion_place import MotionPlace
from paraopt.mechanism import Mechanism

Array = NDArray[np.float64]
# Bounds are drawn in by this part, so that the answer of an iterative solver keeps them
_TIGHTER = 1e-6


@dataclass(frozen=True, eq=False)
class LimitRows:
    """Hold bounds `low <= R c <= high` on the scaled rates of limited variables, then of margins.

    Attributes:
        R: Rows on the coordinates of the motion, shape (n_rows, mobility).
        low: Lower bounds, all together [1/s], shape (n_rows,).
        high: Upper bounds, all together.
        hard_low: Lower bounds of speeds, ranges and margins.
        hard_high: Upper bounds of them.
        soft_low: Lower bounds of accelerations.
        soft_high: Upper bounds of them.
        room: Change of rate that each acceleration allows in one step [1/s]; 1 where there is none.
        speed: Largest rates by the limits of speed alone, to tell them from ranges.
        index: Limited variables.
        labels: Name of each row.
        kinds: Kinds of singularity of the last rows.
    """

    R: Array
    low: Array
    high: Array
    hard_low: Array
    hard_high: Array
    soft_low: Array
    soft_high: Array
    room: Array
    speed: Array
    index: NDArray[np.intp]
    labels: tuple[str, ...]
    kinds: tuple[str, ...]

    def shifted(self, added: Array) -> LimitRows:
        """Take from the bounds what the closing of the loops adds to the rates."""
        return replace(self, low=self.low - added, high=self.high - added)

    def realise(self, place: MotionPlace, after: MotionPlace, period: float) -> Array:
        """Give the rates that a step really had: changes over its duration [1/s], shape (n_rows,)."""
        values = (after.X - place.X)[self.index] / place.frame.scale[self.index]
        margins = [after.margin(kind) - place.margin(kind) for kind in self.kinds]
        return np.concatenate([values, margins]) / period

    def excess(self, rates: Array, hard_only: bool = False) -> float:
        """Give by how much rates pass the bounds, beyond what an iterative solver is forgiven; 0 if they do not."""
        low, high = (self.hard_low, self.hard_high) if hard_only else (self.low, self.high)
        forgiven = 0.5 * _TIGHTER * np.minimum(np.minimum(self.speed, self.room), 0.02) + 1e-10
        return float(np.max(np.maximum(np.maximum(rates - high, low - rates) - forgiven, 0.0), initial=0.0))

    def names(self, rows: NDArray[np.intp], rates: Array) -> tuple[str, ...]:
        """Name what holds at some rows: the tightest bound on the side where the rate is."""
        found = []
        for i in rows:
            if i >= len(self.index):
                found.append(self.labels[i])
                continue
            above = self.high[i] - rates[i] <= rates[i] - self.low[i]
            hard, soft = (self.hard_high[i], self.soft_high[i]) if above else (-self.hard_low[i], -self.soft_low[i])
            by_speed = hard >= self.speed[i] * (1.0 - 1e-9)
            kind = "acceleration" if soft < hard else "velocity" if by_speed else "position"
            found.append(f"{kind} of {self.labels[i]}")
        return tuple(dict.fromkeys(found))

    def gave_way(self, rates: Array) -> tuple[str, ...]:
        """Name the accelerations that rates pass."""
        passed = np.maximum(rates - self.soft_high, self.soft_low - rates) > 1e-6 * self.room
        return tuple(f"acceleration of {self.labels[i]}" for i in np.flatnonzero(passed))

    def relaxation(self, rates: Array) -> float:
        """Give by which part of themselves accelerations pass their limits [1]."""
        return float(np.max(np.maximum(rates - self.soft_high, self.soft_low - rates) / self.room, initial=0.0))

    def near(self, rates: Array) -> NDArray[np.intp]:
        """Find the rows whose bounds rates come near."""
        width = np.minimum(self.speed, self.room)
        way = np.minimum(self.high - rates, rates - self.low)
        return np.flatnonzero(way <= 1e-2 * np.where(np.isfinite(width), width, 1.0))


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Hold the limited variables of a mechanism; all numbers are scaled.

    Attributes:
        index: Limited variables, shape (n,).
        labels: Their names in quotes.
        lower: Lowest values, may be -inf.
        upper: Highest values, may be inf.
        speed: Largest rates [1/s], may be inf.
        acceleration: Largest changes of rate [1/s^2], may be inf.
        period: Duration of a step [s].
        gain: Largest rate of approach [1/s].
    """

    index: NDArray[np.intp]
    labels: tuple[str, ...]
    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    period: float
    gain: float

    @classmethod
    def read(cls, mechanism: Mechanism, scale: Array, limits: Any, period: float, gain: float) -> MotionLimits:
        """Gather the ranges of the joints and the limits by name.

        Args:
            mechanism: The mechanism.
            scale: Unit of each variable.
            limits: Bounds by name: `position`, `velocity`, `acceleration`; or None.
            period: Duration of a step [s].
            gain: Largest rate of approach to an end of a range [1/s].

        Raises:
            UnknownNameError: A name is not a variable of the mechanism.
            DefinitionError: A bound is not above zero, or a range is empty.
        """
        lower = np.array([v.range[0] for v in mechanism.variables])
        upper = np.array([v.range[1] for v in mechanism.variables])
        bounds = {q: np.full(len(scale), np.inf) for q in ("velocity", "acceleration")}
        if limits is not None:
            for quantity in ("position", "velocity", "acceleration"):
                for name, value in getattr(limits, quantity).items():
                    if name not in mechanism.names:
                        raise unknown_name(f"variable in the {quantity} limits", name, mechanism.names)
                    i = mechanism.index(name)
                    if quantity == "position":
                        lower[i], upper[i] = max(lower[i], value[0]), min(upper[i], value[1])
                        if not lower[i] < upper[i]:
                            raise DefinitionError(
                                f"position limit of {name!r} is {value}; it leaves nothing of its range"
                            )
                    elif not value > 0:
                        raise DefinitionError(f"{quantity} limit of {name!r} is {value!r}; it must be above 0")
                    else:
                        bounds[quantity][i] = value
        speed, acceleration = bounds["velocity"] / scale, bounds["acceleration"] / scale
        limited = np.isfinite(lower) | np.isfinite(upper) | np.isfinite(speed) | np.isfinite(acceleration)
        index = np.flatnonzero(limited)
        labels = tuple(repr(mechanism.names[i]) for i in index)
        lower, upper = lower / scale, upper / scale
        return cls(index, labels, lower[index], upper[index], speed[index], acceleration[index], period, gain)

    def _approach(self, way: Array, gain: float) -> Array:
        """Give the largest rates towards ends of ranges.

        With an acceleration a the speed n a h can be braked in steps of h over `a h^2 n (n + 1) / 2`; between these
        speeds the way grows evenly. A hundredth of a is kept for what the closing of the loops adds.
        """
        limited = np.isfinite(self.acceleration) & np.isfinite(way) & (way > 0)
        unit = np.where(limited, 0.99 * self.acceleration * self.period**2, 1.0)
        steps = np.where(limited, way, 0.0) / unit
        n = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * steps) - 1.0))
        braked = unit / self.period * (n + (steps - 0.5 * n * (n + 1.0)) / (n + 1.0))
        return np.asarray(np.where(limited, braked, gain * way))

    def rows(self, place: MotionPlace, before: Array, margins: Mapping[str, float], buffer: float) -> LimitRows:
        """State the bounds of one step.

        Args:
            place: Where it begins.
            before: Scaled rates of all variables in the step before [1/s], shape (n_variables,).
            margins: Bounds kept from singularities, by kind.
            buffer: Distance at which an end of a range or a margin already counts as reached.

        Returns:
            The rows.
        """
        h, last, z = self.period, before[self.index], (place.X / place.frame.scale)[self.index]
        braking = float(np.max(np.abs(last) / self.acceleration, initial=0.0))
        gain = min(self.gain, 1.0 / (braking + 3.0 * h))
        tight = 1.0 - _TIGHTER
        hard_high = np.minimum(tight * self.speed, self._approach(_way_left(self.upper - z, buffer), gain))
        hard_low = -np.minimum(tight * self.speed, self._approach(_way_left(z - self.lower, buffer), gain))
        change = tight * h * self.acceleration
        kinds, slopes, floors = [], [], []
        for kind, bound in margins.items():
            value = place.margin(kind)
            if value < 1e-9:  # at the singularity itself every way leads out
                continue
            kinds.append(kind)
            slopes.append(place.slope(kind))
            floors.append(-gain * float(_way_left(np.array(value - bound), buffer)))
        none = np.full(len(kinds), np.inf)
        hard_low, hard_high = np.append(hard_low, floors), np.append(hard_high, none)
        soft_low, soft_high = np.append(last - change, -none), np.append(last + change, none)
        return LimitRows(
            R=np.vstack([place.V[self.index], *slopes]),
            low=np.maximum(hard_low, soft_low),
            high=np.minimum(hard_high, soft_high),
            hard_low=hard_low,
            hard_high=hard_high,
            soft_low=soft_low,
            soft_high=soft_high,
            room=np.append(np.where(np.isfinite(change), change, 1.0), np.ones(len(kinds))),
            speed=np.append(tight * self.speed, none),
            index=self.index,
            labels=(*self.labels, *(f"{kind} singularity" for kind in kinds)),
            kinds=tuple(kinds),
        )


def _way_left(distance: Array, buffer: float) -> Array:
    """Give the way up to the buffer before an end.

    Inside the buffer nothing leads on, and in its inner half one is led back, so that round-off does not creep through
    it. Far outside nothing leads further out, and nothing is forced back in.
    """
    way = np.maximum(distance - buffer, 0.0)
    return np.where(np.abs(distance) < 0.5 * buffer, distance - 0.5 * buffer, way)
