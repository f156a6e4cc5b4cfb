"""Time laws: the path parameter as a function of time, piecewise polynomial."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from paraopt.errors import DefinitionError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """Hold s(t), from 0 at t = 0 to 1 at the end, as a piecewise polynomial.

    Attributes:
        breaks: Times at which the pieces meet [s], shape (k + 1,).
        coefficients: Coefficients of each piece, the highest power first, shape (order + 1, k).
    """

    breaks: Array
    coefficients: Array

    @property
    def duration(self) -> float:
        """Give the last time [s]."""
        return float(self.breaks[-1])

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate s [1] or its derivative [1/s^order] at times [s]."""
        times = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        values = self._polynomial(times) if order == 0 else self._polynomial.derivative(order)(times)
        return np.clip(values, 0.0, 1.0) if order == 0 else np.asarray(values)

    def time_at(self, s: ArrayLike) -> Array:
        """Tell when parameters are reached.

        Args:
            s: Parameters in [0, 1], shape (n,).

        Returns:
            Times [s], shape (n,); the law must not run backwards.
        """
        wanted = np.asarray(s, dtype=float)
        low, high = np.zeros_like(wanted), np.full_like(wanted, self.duration)
        for _ in range(60):  # halving down to round-off
            middle = 0.5 * (low + high)
            before = self(middle) < wanted
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return 0.5 * (low + high)

    def stretched(self, factor: float) -> TimeLaw:
        """Return the same law run in `factor` times the time: speeds fall by it, accelerations by its square.

        Raises:
            DefinitionError: The factor is not finite and above 0.
        """
        if not (np.isfinite(factor) and factor > 0):
            raise DefinitionError(f"factor of a time law is {factor}; it must be finite and above 0")
        powers = np.arange(len(self.coefficients) - 1, -1, -1)
        return TimeLaw(self.breaks * factor, self.coefficients / factor ** powers[:, None])

    @cached_property
    def _polynomial(self) -> PPoly:
        return PPoly(self.coefficients, self.breaks)
