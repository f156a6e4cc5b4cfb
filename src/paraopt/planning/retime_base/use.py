"""How much of what bounds a motion a time law uses, between the points on which it was computed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.planning.retime_base.limited import LimitedPath

Array = NDArray[np.float64]


def choose_times(path: Path, law: TimeLaw, count: int = 10) -> Array:
    """Choose times at which a law is judged: within each of its pieces, and where pieces of the path meet.

    At the knots of the path's spline its second derivative has corners, and the accelerations their peaks.

    Args:
        path: The path.
        law: The time law.
        count: Number of intervals in each piece of the law.

    Returns:
        Times in ascending order [s].
    """
    shares = np.arange(count) / count
    within = law.breaks[:-1, None] + np.diff(law.breaks)[:, None] * shares
    knots = law.time_at(np.unique(path.spline.t).clip(0.0, 1.0))
    return np.unique(np.concatenate([within.reshape(-1), law.breaks, knots]))


@dataclass(frozen=True, eq=False)
class LimitUse:
    """Hold the largest share of each limit that a time law uses; 1 is the limit.

    Attributes:
        velocity: Largest |velocity| / limit, of variables and platform.
        acceleration: Largest |acceleration| / limit, of variables and platform.
        jerk: Largest |jerk| / limit; 0 when none is asked for.
        stated: Largest share of the stated rows that hold at rest.
        excess: Largest excess of the stated rows that ask for motion, as a share of their size; slowing cures none.
        excess_row: Name of that row.
        stretch_at: Factor on time that brings the largest share to 1, for each time looked at, shape (n,).
    """

    velocity: float
    acceleration: float
    jerk: float
    stated: float
    excess: float
    excess_row: str
    stretch_at: Array

    @property
    def stretch(self) -> float:
        """Give the factor on time that brings the largest share to 1."""
        return float(np.max(self.stretch_at))


def measure_use(limited: LimitedPath, law: TimeLaw, times: Array, third: tuple[Array, Array] | None = None) -> LimitUse:
    """Measure how much of the limits a law uses at times whose parameters are `limited.s`.

    Args:
        limited: The path at `law(times)`.
        law: The time law.
        times: Times [s], shape (n,).
        third: Third derivatives of the variables with respect to s before and after; no jerk when None.

    Returns:
        The largest shares. Where the acceleration of the law jumps, both sides count.
    """
    n = len(times)
    shares = np.zeros((4, n))
    stated, needs = limited.stated, limited.stated.c >= 0.0
    excess, excess_row = 0.0, ""
    for side, shift in enumerate((-1e-9 * law.duration, 1e-9 * law.duration)):
        # the first and the last piece have one side
        beside = np.clip(times + shift, 0.5e-9 * law.duration, law.duration * (1.0 - 0.5e-9))
        ds, dds = law(times, 1), law(beside, 2)
        velocity = np.abs(limited.dq) * ds[:, None] / limited.velocity
        acceleration = np.abs(limited.ddq * ds[:, None] ** 2 + limited.dq * dds[:, None]) / limited.acceleration
        shares[0] = np.maximum(shares[0], np.max(velocity, axis=1))
        shares[1] = np.maximum(shares[1], np.max(acceleration, axis=1))
        if limited.platform:
            v, a = limited.platform.shares(ds, dds)
            shares[0] = np.maximum(shares[0], np.max(v, axis=1))
            shares[1] = np.maximum(shares[1], np.max(a, axis=1))
        if third is not None:
            q3, d1, d2, d3 = third[side], ds[:, None], dds[:, None], law(beside, 3)[:, None]
            jerk = np.abs(q3 * d1**3 + 3.0 * limited.ddq * d1 * d2 + limited.dq * d3) / limited.jerk
            shares[2] = np.maximum(shares[2], np.max(jerk, axis=1))
        if stated.count:
            moving = stated(ds, dds) - stated.c
            share = np.where(needs, 0.0, moving / np.where(needs, 1.0, -stated.c))
            shares[3] = np.maximum(shares[3], np.max(share, axis=1))
            size = np.max(np.abs(moving) + np.abs(stated.c), axis=0)
            beyond = np.where(needs, moving + stated.c, 0.0) / np.where(size > 0.0, size, 1.0)
            k = int(np.argmax(np.max(beyond, axis=0)))
            if (worst := float(np.max(beyond[:, k]))) > excess:
                excess, excess_row = worst, stated.names[k]
    stretch = np.max([shares[0], np.sqrt(shares[1]), np.cbrt(shares[2]), np.sqrt(shares[3])], axis=0)
    most = [float(np.max(row)) for row in shares]
    return LimitUse(most[0], most[1], most[2], most[3], excess, excess_row, stretch)
