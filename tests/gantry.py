"""Two or three sliding axes whose positions are the coordinates themselves: retiming without kinematics in the way.

Tests import it as `from gantry import ...`; pytest puts this folder on the path.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, CubicSpline

import paraopt as po

NAMES = ("x", "y", "z")


@functools.cache
def gantry(axes: int = 3, size: float = 1.0) -> po.Robot:
    """Build a machine of some size [m]: each drive is one coordinate of a free block; do not change it."""
    names = NAMES[:axes]
    links: list[object] = [po.Base()]
    father = "base"
    for name in names:
        links.append(po.Series(f"slide {name}", father, joint=po.Prismatic(f"q_{name}", axis=name)))
        father = f"slide {name}"
    links.append(po.Mobile("block", coordinates=names))
    mechanism = po.Mechanism(
        f"gantry {axes}",
        links,
        [po.Coincidence(father, (0.0,) * axes, "block", (0.0,) * axes)],
        active=tuple(f"q_{name}" for name in names),
        operational=names,
        planar=axes == 2,
        characteristic_length=size,
    )
    return po.Robot(mechanism, home={v: 0.0 for v in mechanism.names})


def limits(
    velocity: ArrayLike = 1.0, acceleration: ArrayLike = 1.0, jerk: ArrayLike = 1.0, axes: int = 3, **others: float
) -> po.Limits:
    """State limits of the axes: one number for all, or one for each."""
    drives = gantry(axes).mechanism.active
    values = [np.broadcast_to(np.asarray(v, dtype=float), (axes,)).tolist() for v in (velocity, acceleration, jerk)]
    first, second, third = (dict(zip(drives, v, strict=True)) for v in values)
    return po.Limits(velocity=first, acceleration=second, jerk=third, **others)


def problem(path: po.Path, bounds: po.Limits) -> po.Problem:
    """Ask for the motion from one end of a path to the other."""
    robot, names = path.robot, path.robot.mechanism.operational
    ends = path(np.array([0.0, 1.0]))[:, robot.mechanism.indices(names)]
    start, goal = (dict(zip(names, values.tolist(), strict=True)) for values in ends)
    return po.Problem(po.Scene(robot), start, goal, limits=bounds)


def along(spline: BSpline) -> po.Path:
    """Build the path of a spline in two or three coordinates."""
    axes = spline.c.shape[1]
    # powers of ten, so that few machines are built
    size = 10.0 ** float(np.ceil(np.log10(max(np.max(np.ptp(spline.c, axis=0)), 1e-3))))
    robot = gantry(axes, max(size, 1.0))
    place = np.tile(spline(0.0), 2)
    return po.Path.along(robot, robot.mechanism.operational, spline, place)


def through(waypoints: ArrayLike, at: Sequence[float] | None = None) -> po.Path:
    """Build the cubic spline through waypoints of shape (n, axes), as toppra's and Drake's users do."""
    points = np.asarray(waypoints, dtype=float)
    places = np.linspace(0.0, 1.0, len(points)) if at is None else np.asarray(at)
    return along(as_spline(CubicSpline(places, points)))


def as_spline(cubic: CubicSpline) -> BSpline:
    """Write a cubic spline with two continuous derivatives in the other basis, by polar forms."""
    x = cubic.x
    knots = np.concatenate([[x[0]] * 4, x[1:-1], [x[-1]] * 4])
    count = len(knots) - 4
    triple = np.stack([knots[1 : count + 1], knots[2 : count + 2], knots[3 : count + 3]])
    piece = np.clip(np.searchsorted(x, triple[1], side="right") - 1, 0, len(x) - 2)
    u, v, w = (triple - x[piece])[:, :, None]
    c3, c2, c1, c0 = (row[piece] for row in cubic.c)
    return BSpline(knots, c3 * u * v * w + c2 * (u * v + v * w + w * u) / 3.0 + c1 * (u + v + w) / 3.0 + c0, 3)


def controlled(points: ArrayLike) -> po.Path:
    """Build the cubic spline with given control points and even knots."""
    c = np.asarray(points, dtype=float)
    return along(BSpline(np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, len(c) - 2), [1.0] * 3]), c, 3))


def line(goal: Sequence[float]) -> po.Path:
    """Build a straight line from the origin, with an even parameter."""
    return controlled(np.linspace(0.0, 1.0, 4)[:, None] * np.asarray(goal, dtype=float))


def worst_share(asked: po.Problem, trajectory: po.Trajectory, jerk: bool = False) -> float:
    """Look at a trajectory ten times denser than its grid: the largest share of a limit of the drives."""
    drives = asked.robot.mechanism.active
    a = len(drives)
    # as dense in each piece of the law, however short
    pieces = np.linspace(0.0, 1.0, 23)[:-1]
    breaks = trajectory.law.breaks
    t = np.union1d((breaks[:-1, None] + np.diff(breaks)[:, None] * pieces).reshape(-1), breaks)
    state = trajectory.state(t)
    bounds = asked.bounds
    shares = [
        np.abs(state.velocity[:, :a]) / bounds.of("velocity", drives),
        np.abs(state.acceleration[:, :a]) / bounds.of("acceleration", drives),
    ]
    if jerk:
        even = trajectory.state(np.linspace(0.0, trajectory.duration, 20 * trajectory.n_grid + 3))
        shares.append(np.abs(np.diff(even.acceleration[:, :a], axis=0)) / even.t[1] / bounds.of("jerk", drives))
    return max(float(np.max(share)) for share in shares)
