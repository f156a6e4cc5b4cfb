"""Several motions, one after the other, each from rest to rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.planning import State, Trajectory
from paraopt.planning.trajectory import read_times
from paraopt.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotionChain:
    """Run motions of one machine one after the other.

    Attributes:
        parts: The motions.
        tolerance: Largest jump of a variable where two meet [m, rad or N].
        rest: Largest speed of a variable there [m/s, rad/s or N/s].

    Raises:
        DefinitionError: There is none, they are of different mechanisms, or two do not meet at rest; the message names
            the variable and the jump.
    """

    parts: Sequence[Trajectory]
    tolerance: float = 1e-9
    rest: float = 1e-6

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise DefinitionError("a chain of no motions has no place; give at least one")
        names = self.robot.mechanism.names
        for i, part in enumerate(self.parts):
            if part.robot.mechanism.names != names:
                raise DefinitionError(
                    f"motion {i} of the chain is one of {part.robot.name!r}, whose variables are not those of "
                    f"{self.robot.name!r}"
                )
        for what, values, bound in (("jumps", self.jumps, self.tolerance), ("moves", self.speeds, self.rest)):
            if values.size and np.max(values) > bound:
                i, k = divmod(int(np.argmax(values)), values.shape[1])
                raise DefinitionError(
                    f"{names[k]!r} {what} by {values[i, k]:.3g} where motion {i} ends and {i + 1} begins; the bound is "
                    f"{bound:.3g}: let each begin at the end of the one before, and at rest"
                )

    @property
    def robot(self) -> Robot:
        """Give the machine."""
        return self.parts[0].robot

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        return float(self.borders[-1])

    @cached_property
    def borders(self) -> Array:
        """Give the times at which motions begin, and the end [s], shape (n_parts + 1,)."""
        return np.concatenate([[0.0], np.cumsum([part.duration for part in self.parts])])

    @cached_property
    def jumps(self) -> Array:
        """Give the jumps of all variables where motions meet, shape (n_parts - 1, n_variables)."""
        ends = [(one(one.duration), other(0.0)) for one, other in zip(self.parts, self.parts[1:], strict=False)]
        return np.abs(np.array([b - a for a, b in ends])).reshape(len(ends), len(self.robot.mechanism.names))

    @cached_property
    def speeds(self) -> Array:
        """Give the larger speeds of all variables where motions meet, shape (n_parts - 1, n_variables)."""
        ends = [
            np.maximum(np.abs(one(one.duration, 1)), np.abs(other(0.0, 1)))
            for one, other in zip(self.parts, self.parts[1:], strict=False)
        ]
        return np.array(ends).reshape(len(ends), len(self.robot.mechanism.names))

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate all variables, or their derivatives with respect to time.

        Args:
            t: Times in [0, duration] [s], a number or shape (n,).
            order: 0 for values, 1 for velocities, 2 for accelerations; where motions meet, those of the later one.

        Returns:
            Shape (n_variables,) for a number, (n, n_variables) for an array.

        Raises:
            DefinitionError: A time is outside [0, duration].
        """
        times = np.atleast_1d(read_times(t, self.duration))
        running = np.searchsorted(self.borders[1:-1], times, side="right")
        values = np.empty((len(times), len(self.robot.mechanism.names)))
        for k, part in enumerate(self.parts):
            here = running == k
            values[here] = part(np.clip(times[here] - self.borders[k], 0.0, part.duration), order)
        return values[0] if np.ndim(t) == 0 else values

    def state(self, t: ArrayLike) -> State:
        """Evaluate values, velocities and accelerations together."""
        return State(np.asarray(t, dtype=float), self(t), self(t, 1), self(t, 2))
