"""Jerk-limited retiming: a rest-to-rest profile of ruckig for the path parameter, scaled to the actuators' limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ruckig
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, RetimeError
from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.retime_base import DrivePath, choose_times, measure_use, sample_drives
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JerkLimited:
    """Time a path with limited velocity, acceleration and jerk of every actuator.

    The speed, acceleration and jerk of the path parameter are bounded by constants that are safe everywhere on the
    path; among several such triples the fastest is kept, and the profile is then scaled in time until one actuator
    just reaches one of its limits on a dense check.

    Attributes:
        n_grid: Number of intervals at which the path is examined.
        candidates: Number of speeds and of accelerations that are tried.
        reserve: Share of the time that is added so that the limits also hold between the points of the check [1].

    Source: ruckig.
    """

    bounds_jerk: ClassVar[bool] = True
    n_grid: int = 200
    candidates: int = 10
    reserve: float = 3e-4

    def __post_init__(self) -> None:
        if self.n_grid < 8 or self.candidates < 1:
            raise DefinitionError(f"n_grid is {self.n_grid}, candidates {self.candidates}; at least 8 and 1 are needed")

    def retime(self, problem: Problem, path: Path) -> Trajectory:
        """Time a path.

        Args:
            problem: The problem, with limits of velocity, acceleration and jerk of the actuators.
            path: The path.

        Returns:
            A trajectory from rest to rest that holds all three limits on a check ten times denser than the grid.

        Raises:
            DefinitionError: A limit is missing.
            RetimeError: ruckig found no profile.
        """
        s = np.linspace(0.0, 1.0, self.n_grid + 1)
        drives = sample_drives(problem, path, s)
        missing = [n for n, j in zip(drives.names, drives.jerk, strict=True) if not np.isfinite(j)]
        if missing:
            raise DefinitionError(
                f"actuators {missing} have no jerk limit; state it in Limits(jerk=...)", limits=problem.bounds
            )
        third = _third(path, s, len(drives.names))
        laws = [_profile(*triple) for triple in self._triples(drives, third)]
        # each profile is safe by construction; scaling it to the limits tells which one is really the fastest
        scaled = [self._scale(problem, path, law, 2 * self.n_grid + 3) for law in laws]
        best = min(range(len(laws)), key=lambda i: scaled[i].duration)
        final = self._scale(problem, path, laws[best], 10 * self.n_grid + 7).stretched(1.0 + self.reserve)
        return Trajectory(path, final, "jerk-limited (ruckig)", 1.0, self.n_grid)

    def _triples(self, drives: DrivePath, third: Array) -> list[tuple[float, float, float]]:
        """List bounds (speed, acceleration, jerk) of the parameter that keep every actuator within its limits."""
        d1, d2, d3 = np.abs(drives.dq), np.abs(drives.ddq), np.abs(third)
        tiny = 1e-12 * np.max(d1)
        top = float(np.min(drives.velocity / np.max(d1, axis=0).clip(tiny)))
        triples = []
        shares = [*np.linspace(1.0, 0.0, self.candidates, endpoint=False), *np.geomspace(0.05, 1e-4, 6)]
        for share in shares:
            V = share * top
            room = drives.acceleration - d2 * V**2
            if np.any(room <= 0.0):
                continue
            A_top = float(np.min(room / d1.clip(tiny)))
            for fraction in np.linspace(1.0, 0.0, max(self.candidates // 2, 1), endpoint=False):
                A = fraction * A_top
                left = drives.jerk - 3.0 * d2 * V * A - d3 * V**3
                if np.all(left > 0.0):
                    triples.append((V, A, float(np.min(left / d1.clip(tiny)))))
        if not triples:
            raise RetimeError("no speed keeps the actuators within their limits on this path", drives=drives)
        # the scaling that follows is the costly part: keep the few that ruckig itself finds fastest
        return sorted(triples, key=lambda triple: _profile(*triple).duration)[:3]

    def _scale(self, problem: Problem, path: Path, law: TimeLaw, count: int) -> TimeLaw:
        times = choose_times(path, law, count)
        s = law(times)
        drives = sample_drives(problem, path, s)
        return law.stretched(measure_use(drives, law, times, _third(path, s, len(drives.names))).stretch)


def _third(path: Path, s: Array, n_active: int, width: float = 1e-5) -> Array:
    """Differentiate the exact second derivatives of the actuators once more, by central differences in s.

    At the knots of a cubic spline the third derivative jumps; the larger side counts.
    """
    low, high = np.clip(s - width, 0.0, 1.0), np.clip(s + width, 0.0, 1.0)
    here = path.points(s).ddX[:, :n_active]
    before, after = path.points(low).ddX[:, :n_active], path.points(high).ddX[:, :n_active]
    left = (here - before) / np.where(s > low, s - low, np.inf)[:, None]
    right = (after - here) / np.where(high > s, high - s, np.inf)[:, None]
    return np.where(np.abs(left) > np.abs(right), left, right)


def _profile(speed: float, acceleration: float, jerk: float) -> TimeLaw:
    """Compute ruckig's fastest profile from rest at 0 to rest at 1, in a unit of time near the duration."""
    unit = max(1.0 / speed, acceleration**-0.5, jerk ** (-1.0 / 3.0))
    inputs = ruckig.InputParameter(1)
    inputs.current_position, inputs.target_position = [0.0], [1.0]
    inputs.current_velocity = inputs.target_velocity = [0.0]
    inputs.current_acceleration = inputs.target_acceleration = [0.0]
    inputs.max_velocity, inputs.max_acceleration = [speed * unit], [acceleration * unit**2]
    inputs.max_jerk = [jerk * unit**3]
    trajectory = ruckig.Trajectory(1)
    result = ruckig.Ruckig(1).calculate(inputs, trajectory)
    if result != ruckig.Result.Working:
        raise RetimeError(
            f"ruckig found no profile ({result}) for speed {speed:.3g}/s, acceleration {acceleration:.3g}/s^2, "
            f"jerk {jerk:.3g}/s^3 of the path parameter"
        )
    profile = trajectory.profiles[0][0]
    times = np.array(profile.t)
    kept = np.flatnonzero(times > 1e-12)
    p, v, a, j = (np.array(getattr(profile, k))[kept] for k in ("p", "v", "a", "j"))
    breaks = np.concatenate([[0.0], np.cumsum(times[kept])])
    return TimeLaw(breaks, np.vstack([j / 6.0, a / 2.0, v, p])).stretched(unit)
