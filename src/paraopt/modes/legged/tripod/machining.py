"""Machining: a way of the tool in position and orientation, followed exactly on three feet."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, make_interp_spline

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.kinematics import MotionSpace
from paraopt.modes.legged.tripod.frames import read_feet, rotations
from paraopt.modes.legged.tripod.geometry import LEGS, POSE, foot_names
from paraopt.modes.legged.tripod.walker import WalkingTripod

Array = NDArray[np.float64]


def follow_tool(
    frames: Callable[[Array], Array],
    tool: ArrayLike,
    tolerance: float = 1e-6,
    most_knots: int = 512,
) -> BSpline:
    """Give the way of the platform along which the tool's tip follows a given way.

    A cubic spline through points of the way, as many as are needed.

    Args:
        frames: From s in [0, 1], shape (n,), to x, y, z, alpha, beta, gamma of a frame at the tip [m, rad], parallel to
            that of the platform, shape (n, 6).
        tool: The tip in the platform's frame [m], shape (3,).
        tolerance: How far the tip may be from its way between the points [m]; a radian counts as a metre.
        most_knots: Bound on the number of intervals.

    Returns:
        Spline of x ... gamma of the platform over [0, 1].

    Raises:
        DefinitionError: The way cannot be followed within the tolerance by so many intervals, such as one with corners.
    """
    tip = np.asarray(tool, dtype=float)

    def platform(s: Array) -> Array:
        given = np.asarray(frames(s), dtype=float)
        if given.shape != (len(s), 6) or not np.all(np.isfinite(given)):
            raise DefinitionError(f"way of the tool gives shape {given.shape} for {len(s)} places; it must give (n, 6)")
        poses = given.copy()
        poses[:, :3] -= np.einsum("nij,j->ni", rotations(given), tip)
        return poses

    n, worst = 8, np.inf
    while n <= most_knots:
        s = np.linspace(0.0, 1.0, n + 1)
        spline = make_interp_spline(s, platform(s), k=3)
        between = np.linspace(0.0, 1.0, 10 * n + 1)
        worst = float(np.max(np.abs(spline(between) - platform(between))))
        if worst <= tolerance:
            return spline
        n *= 2
    raise DefinitionError(
        f"way of the tool is missed by {worst:.2g} m (or rad), asked {tolerance:g}, with {n // 2} intervals; give it "
        "without corners, or as several ways"
    )


def lean_round(
    radius: float, lean: float, height: float, centre: Sequence[float] = (0.0, 0.0, 0.0), turn: float = 0.0
) -> Callable[[Array], Array]:
    """Give the frames of a tool that goes once round a circle and leans to all sides: a work that needs six axes.

    Args:
        radius: Radius of the circle [m].
        lean: Angle of the tool to the circle's axis [rad].
        height: Height of the tip above the centre [m].
        centre: Centre of the work [m], shape (3,).
        turn: Turn of the whole work about the vertical [rad].

    Returns:
        A way for `follow_tool`.
    """
    x, y, z = (float(c) for c in centre)

    def frames(s: Array) -> Array:
        a, one = 2 * np.pi * s, np.ones_like(s)
        where = [x + radius * np.cos(a + turn), y + radius * np.sin(a + turn), (z + height) * one]
        return np.column_stack([*where, lean * np.sin(a), lean * np.cos(a), turn * one])

    return frames


def check_machining(
    walker: WalkingTripod,
    curve: BSpline,
    feet: ArrayLike,
    *,
    clearance: float = 0.005,
    standing_margin: float = 0.05,
    count: int = 401,
    phase: str = "machining",
) -> Array:
    """Check a way of the platform on three feet against ranges, distances of bodies and singularities.

    Args:
        walker: The machine.
        curve: Spline of x ... gamma of the platform over [0, 1].
        feet: Frames of the feet [m, rad], shape (3, 6).
        clearance: Distance that checked bodies keep [m].
        standing_margin: Distance to parallel and to serial singularities [1].
        count: Number of places.
        phase: How messages call it.

    Returns:
        Configurations along it, shape (count, n_variables).

    Raises:
        InfeasibleError: A bound is broken; the message names the phase, what breaks it most, and where.
    """
    s = np.linspace(0.0, 1.0, count)
    X = walker.configurations(curve(s), read_feet(feet))
    mechanism, (low, high) = walker.robot.mechanism, walker.ranges
    angle = np.array([v.kind == "angle" for v in mechanism.variables])
    over = np.maximum(low - X, X - high) / np.where(angle, 1.0, walker.geometry.radius)
    k, v = np.unravel_index(int(np.argmax(over)), over.shape)
    if over[k, v] > 0:
        variable = mechanism.variables[v]
        raise InfeasibleError(
            f"phase {phase!r}: {variable.name!r} would be {X[k, v]:.4g} {variable.unit} at s = {s[k]:.3f}, out of "
            f"[{low[v]:.4g}, {high[v]:.4g}]",
            s=float(s[k]),
            variable=variable.name,
            margin=-float(over[k, v]),
        )
    distances, pairs = walker.scene.clearances(X)
    k = np.argmin(distances)
    if distances[k] < clearance:
        raise InfeasibleError(
            f"phase {phase!r}: {walker.scene.pairs[pairs[k]].name} are {1e3 * distances[k]:.3g} mm apart at "
            f"s = {s[k]:.3f}, asked {1e3 * clearance:g} mm",
            s=float(s[k]),
            margin=float(distances[k]),
        )
    held = [n for i in LEGS for n in foot_names(i)]
    margins = MotionSpace(walker.robot.kinematics, POSE, POSE, held).margins(X)
    for kind, values in (("parallel", margins.parallel), ("serial", margins.serial)):
        k = np.argmin(values)
        if values[k] < standing_margin:
            raise InfeasibleError(
                f"phase {phase!r}: the distance to {kind} singularities is {values[k]:.3g} at s = {s[k]:.3f}, asked "
                f"{standing_margin:g}",
                s=float(s[k]),
                margin=float(values[k]),
            )
    return X
