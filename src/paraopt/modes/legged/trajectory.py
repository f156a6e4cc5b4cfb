"""The motion through all phases: one trajectory after the other, at rest where they meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.planning import State
from paraopt.planning.trajectory import Motion, read_times, spread_times
from paraopt.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PhaseMark:
    """Tell when a phase runs, and on what.

    Attributes:
        name: Name of the phase.
        start: When it begins [s].
        end: When it ends [s].
        standing: Names of the feet that stand.
        lifted: Names of those that do not.
        locked: Names of the locked variables.
    """

    name: str
    start: float
    end: float
    standing: tuple[str, ...]
    lifted: tuple[str, ...]
    locked: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        return self.end - self.start


@dataclass(frozen=True, eq=False)
class LeggedTrajectory:
    """Describe the motion of all variables through all phases.

    Attributes:
        robot: The machine.
        parts: Motion of each phase, in its own time.
        marks: When each phase runs.

    Raises:
        DefinitionError: There are not as many parts as marks, or a mark does not begin where the last ends.
    """

    robot: Robot
    parts: Sequence[Motion]
    marks: Sequence[PhaseMark]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        object.__setattr__(self, "marks", tuple(self.marks))
        if not self.parts or len(self.parts) != len(self.marks):
            raise DefinitionError(f"there are {len(self.parts)} parts and {len(self.marks)} marks; give one for each")
        for before, after in pairwise(self.marks):
            if abs(after.start - before.end) > 1e-9:
                raise DefinitionError(
                    f"phase {after.name!r} begins at {after.start} s, but {before.name!r} ends at {before.end} s"
                )
        for part, mark in zip(self.parts, self.marks, strict=True):
            if not abs(part.duration - mark.duration) <= 1e-9 * max(part.duration, 1.0):
                raise DefinitionError(
                    f"phase {mark.name!r} is marked for {mark.duration} s, its motion takes {part.duration} s"
                )

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        return self.marks[-1].end

    @cached_property
    def borders(self) -> Array:
        """Give the times at which phases begin, and the end [s], shape (n_phases + 1,)."""
        return np.array([self.marks[0].start, *(mark.end for mark in self.marks)])

    def phase_at(self, t: ArrayLike) -> NDArray[np.intp]:
        """Give the place of the phase that runs at times [s]; where two meet, that of the later one."""
        inside = np.searchsorted(self.borders[1:-1], np.asarray(t, dtype=float), side="right")
        return np.asarray(inside, dtype=np.intp)

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate all variables, or their derivatives with respect to time.

        Args:
            t: Times in [0, duration] [s], a number or shape (n,).
            order: 0 for values, 1 for velocities, 2 for accelerations; where phases meet, that of the later one.

        Returns:
            Shape (n_variables,) for a number, (n, n_variables) for an array.

        Raises:
            DefinitionError: A time is outside [0, duration].
        """
        times = np.atleast_1d(read_times(t, self.duration))
        values = np.empty((len(times), len(self.robot.mechanism.names)))
        running = self.phase_at(times)
        for k in np.unique(running).tolist():
            here = running == k
            local = np.clip(times[here] - self.marks[k].start, 0.0, self.parts[k].duration)
            values[here] = self.parts[k](local, order)
        return values[0] if np.ndim(t) == 0 else values

    def state(self, t: ArrayLike) -> State:
        """Evaluate values, velocities and accelerations together."""
        times = np.asarray(t, dtype=float)
        return State(times, self(times), self(times, 1), self(times, 2))

    def sample(self, period: float) -> State:
        """Sample at a constant period [s], the end included."""
        return self.state(spread_times(period, self.duration))

    def at(self, t: float) -> Mapping[str, float]:
        """Give the values by name at one time [s]."""
        return dict(zip(self.robot.mechanism.names, self(float(t)).tolist(), strict=True))
