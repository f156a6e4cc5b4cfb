"""Profiles of ruckig, from rest to rest, in units in which its numbers are near one.

ruckig is asked from state to state only: intermediate positions would be sent to a service elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ruckig
from numpy.typing import NDArray

from paraopt.errors import BackendError, RetimeError
from paraopt.planning.law import TimeLaw

Array = NDArray[np.float64]

# Limits of speed, acceleration and jerk in units of distance and duration: higher ones are lowered to these, which is
# safe and costs next to no time, but saves the digits of ruckig's equations.
_HIGHEST = (1e2, 1e4, 1e6)


def solve_profile(speed: float, acceleration: float, jerk: float) -> TimeLaw:
    """Compute the fastest profile from rest at 0 to rest at 1.

    Args:
        speed: Bound on the speed [1/s].
        acceleration: Bound on the acceleration [1/s^2].
        jerk: Bound on the jerk [1/s^3].

    Returns:
        The profile.

    Raises:
        RetimeError: ruckig found none.

    Source: ruckig.
    """
    breaks, pieces = solve_profiles(np.ones(1), [np.array([v]) for v in (speed, acceleration, jerk)], straight=True)
    return TimeLaw(breaks, pieces[:, :, 0])


def drop_slivers(law: TimeLaw, share: float) -> TimeLaw:
    """Leave out the phases of a profile that take less than a share of its duration, and scale the rest to reach 1.

    A profile from rest to rest is its own mirror image: what is left comes to rest too. Its limits are exceeded a
    little.
    """
    durations, jerks = np.diff(law.breaks), 6.0 * law.coefficients[0]
    kept = durations >= share * law.duration
    pieces, p, v, a = [], 0.0, 0.0, 0.0
    for h, j in zip(durations[kept], jerks[kept], strict=True):
        pieces.append([j / 6.0, a / 2.0, v, p])
        p, v, a = p + h * (v + h * (a / 2.0 + h * j / 6.0)), v + h * (a + h * j / 2.0), a + h * j
    return TimeLaw(np.concatenate([[0.0], np.cumsum(durations[kept])]), np.array(pieces).T / p)


def solve_profiles(
    distance: Array,
    limits: Sequence[Array],
    *,
    straight: bool,
    names: Sequence[str] = (),
    passing: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Compute the fastest profiles of several axes that arrive at the same time, without acceleration at the ends.

    Args:
        distance: Signed distances, shape (k,).
        limits: Bounds on speeds, accelerations and jerks, shape (k,) each.
        straight: Whether all axes have done the same share of their distance at all times, so that they move on a
            straight line; else each only arrives with the slowest one.
        names: Names of the axes, for messages.
        passing: Velocities at the start and at the end, shape (k,) each; rest when None. They point along the
            distances, and are zero on a straight line.

    Returns:
        Times at which pieces meet [s], shape (p + 1,), and coefficients of the axes, highest power first, shape
        (4, p, k).

    Raises:
        RetimeError: ruckig found no profile, or nothing moves.

    Source: ruckig.
    """
    size = np.abs(distance)
    moves = size > 0.0
    if not np.any(moves):
        raise RetimeError("no axis moves: a motion of zero length cannot be timed", distance=distance)
    bounds = np.stack(limits)[:, moves] / size[moves]
    if straight:
        # one profile for the share of the distance that is done
        breaks, pieces = _ask(np.min(bounds, axis=1, keepdims=True), np.zeros((2, 1)), names)
        return breaks, pieces * distance
    ends = np.zeros((2, len(distance))) if passing is None else np.stack(passing)
    moving = [n for n, m in zip(names, moves, strict=True) if m] if names else ()
    breaks, pieces = _ask(bounds, ends[:, moves] / distance[moves], moving)
    full = np.zeros((4, pieces.shape[1], len(distance)))
    full[:, :, moves] = pieces * distance[moves]
    return breaks, full


def _ask(limits: Array, speeds: Array, names: Sequence[str]) -> tuple[Array, Array]:
    """Ask for axes that all go from 0 to 1, with limits of shape (3, k) and speeds at the ends of shape (2, k)."""
    k = limits.shape[1]
    orders = np.arange(1, 4)[:, None]
    # the duration lies within a small factor of this
    unit = float(np.max(limits ** (-1.0 / orders)))
    scaled = np.minimum(limits * unit**orders, np.array(_HIGHEST)[:, None])
    inputs = ruckig.InputParameter(k)
    zero, one = [0.0] * k, [1.0] * k
    inputs.current_position, inputs.current_acceleration = zero, zero
    inputs.target_position, inputs.target_acceleration = one, zero
    inputs.current_velocity, inputs.target_velocity = (row.tolist() for row in np.minimum(speeds * unit, scaled[0]))
    inputs.max_velocity, inputs.max_acceleration, inputs.max_jerk = (row.tolist() for row in scaled)
    inputs.synchronization = ruckig.Synchronization.Time
    trajectory = ruckig.Trajectory(k)
    try:
        result = ruckig.Ruckig(k).calculate(inputs, trajectory)
    except ruckig.RuckigError as error:
        raise BackendError(f"ruckig failed: {error}", limits=limits) from error
    if result != ruckig.Result.Working:
        raise RetimeError(
            f"ruckig found no profile ({result}) for {', '.join(names) or 'the path parameter'}; speeds, accelerations "
            f"and jerks over the distances are {limits.tolist()}",
            limits=limits,
        )
    profiles = trajectory.profiles[0]
    starts = [np.concatenate([[0.0], np.cumsum(profile.t)]) for profile in profiles]
    breaks = np.unique(np.concatenate(starts))
    # pieces shorter than round-off of the duration are left out
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-12 * breaks[-1]])]
    breaks[-1] = max(float(start[-1]) for start in starts)
    middle = 0.5 * (breaks[1:] + breaks[:-1])
    pieces = np.empty((4, len(middle), k))
    for axis, (start, profile) in enumerate(zip(starts, profiles, strict=True)):
        p, v, a, j = (np.array(getattr(profile, letter), dtype=float) for letter in "pvaj")
        # the piece of this axis that holds each common one
        i = np.clip(np.searchsorted(start, middle, side="right") - 1, 0, 6)
        t = breaks[:-1] - start[i]
        pieces[0, :, axis] = j[i] / 6.0
        pieces[1, :, axis] = (a[i] + t * j[i]) / 2.0
        pieces[2, :, axis] = v[i] + t * (a[i] + t * j[i] / 2.0)
        pieces[3, :, axis] = p[i] + t * (v[i] + t * (a[i] / 2.0 + t * j[i] / 6.0))
    powers = np.arange(3, -1, -1)[:, None, None]
    return breaks * unit, pieces / unit**powers
