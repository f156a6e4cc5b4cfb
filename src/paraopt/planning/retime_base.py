"""What the retimers share: the limits of the drives along a path, and how much of them a time law uses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, RetimeError
from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]


class Retimer(Protocol):
    """Give a path its time law.

    Attributes:
        bounds_jerk: Whether the jerk limits hold too.
    """

    bounds_jerk: ClassVar[bool]

    def retime(self, problem: Problem, path: Path) -> Trajectory:
        """Time a path within the limits of the drives, or raise an error that names the cause."""
        ...


@dataclass(frozen=True, eq=False)
class DrivePath:
    """Hold the actuators along a path, at fixed parameters.

    Attributes:
        names: Names of the actuators.
        s: Parameters, shape (n,).
        q: Values [m or rad], shape (n, n_active).
        dq: First derivatives with respect to s.
        ddq: Second derivatives with respect to s.
        velocity: Limits [m/s or rad/s], shape (n_active,).
        acceleration: Limits [m/s^2 or rad/s^2], shape (n_active,).
        jerk: Limits [m/s^3 or rad/s^3], inf where none is stated, shape (n_active,).
    """

    names: tuple[str, ...]
    s: Array
    q: Array
    dq: Array
    ddq: Array
    velocity: Array
    acceleration: Array
    jerk: Array


def sample_drives(problem: Problem, path: Path, s: Array) -> DrivePath:
    """Evaluate the actuators along a path and collect their limits.

    Raises:
        DefinitionError: An actuator has no velocity or acceleration limit.
        RetimeError: The path has no length in the actuators.
    """
    names = tuple(problem.robot.mechanism.active)
    limits = problem.bounds
    for quantity in ("velocity", "acceleration"):
        missing = [n for n, v in zip(names, limits.of(quantity, names), strict=True) if not np.isfinite(v)]
        if missing:
            raise DefinitionError(
                f"actuators {missing} have no {quantity} limit; state it in Limits({quantity}=...)", limits=limits
            )
    points = path.points(s)
    a = len(names)
    dq = points.dX[:, :a]
    if not np.max(np.abs(dq)) > 1e-12:
        raise RetimeError("the actuators do not move along the path: a path of zero length cannot be timed", path=path)
    return DrivePath(
        names, s, points.X[:, :a], dq, points.ddX[:, :a],
        limits.of("velocity", names), limits.of("acceleration", names), limits.of("jerk", names),
    )  # fmt: skip


def choose_times(path: Path, law: TimeLaw, count: int) -> Array:
    """Choose times at which a law is judged: evenly spread, where its pieces meet, and where those of the path do.

    At the knots of the path's spline its second derivative has corners, and the accelerations their peaks.

    Args:
        path: The path.
        law: The time law.
        count: Number of evenly spread times.

    Returns:
        Times in ascending order [s].
    """
    knots = law.time_at(np.unique(path.spline.t).clip(0.0, 1.0))
    return np.unique(np.concatenate([np.linspace(0.0, law.duration, count), law.breaks, knots]))


@dataclass(frozen=True)
class LimitUse:
    """Hold the largest share of each limit that a time law uses; 1 is the limit.

    Attributes:
        velocity: Largest |velocity| / limit.
        acceleration: Largest |acceleration| / limit.
        jerk: Largest |jerk| / limit; 0 when no jerk limit is stated.
    """

    velocity: float
    acceleration: float
    jerk: float = 0.0

    @property
    def stretch(self) -> float:
        """Give the factor on time that brings the largest share to 1."""
        return float(max(self.velocity, np.sqrt(self.acceleration), np.cbrt(self.jerk)))


def measure_use(drives: DrivePath, law: TimeLaw, times: Array, path_third: Array | None = None) -> LimitUse:
    """Measure how much of the limits a law uses at times whose parameters are `drives.s`.

    Args:
        drives: The actuators at `law(times)`.
        law: The time law.
        times: Times [s], shape (n,).
        path_third: Third derivatives of the actuators with respect to s, shape (n, n_active); no jerk when None.

    Returns:
        The largest shares. Where the acceleration of the law jumps, both sides count.
    """
    inside = 1e-9 * law.duration
    ds = law(times, 1)[:, None]
    velocity = np.abs(drives.dq * ds) / drives.velocity
    acceleration = np.zeros_like(velocity)
    for shift in (-inside, inside):
        dds = law(times + shift, 2)[:, None]
        acceleration = np.maximum(acceleration, np.abs(drives.ddq * ds**2 + drives.dq * dds) / drives.acceleration)
    jerk = 0.0
    if path_third is not None:
        for shift in (-inside, inside):
            dds, ddds = law(times + shift, 2)[:, None], law(times + shift, 3)[:, None]
            value = path_third * ds**3 + 3.0 * drives.ddq * ds * dds + drives.dq * ddds
            jerk = max(jerk, float(np.max(np.abs(value) / drives.jerk)))
    return LimitUse(float(np.max(velocity)), float(np.max(acceleration)), jerk)
