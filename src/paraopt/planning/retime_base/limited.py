"""A path with all that bounds the motion along it, at chosen places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, RetimeError
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.retime_base.platform import PlatformMotion
from paraopt.planning.retime_base.rows import PathConstraint, PathRows

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LimitedPath:
    """Hold the limited variables along a path, and further bounds, at fixed parameters.

    Attributes:
        names: Names of the k variables that have a limit: the actuators, and others for which one is stated.
        s: Parameters, shape (n,).
        q: Values of these variables [m or rad], shape (n, k).
        dq: First derivatives with respect to s.
        ddq: Second derivatives.
        velocity: Limits [m/s or rad/s], inf where none is stated, shape (k,).
        acceleration: Limits [m/s^2 or rad/s^2].
        jerk: Limits [m/s^3 or rad/s^3].
        platform: The platform's motion with its bounds; None where none is stated.
        stated: Rows of further constraints.
    """

    names: tuple[str, ...]
    s: Array
    q: Array
    dq: Array
    ddq: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    platform: PlatformMotion | None
    stated: PathRows

    def between(self, s: Array) -> LimitedPath:
        """Give the variables between the places held, by quintic pieces that meet values and both derivatives.

        All knots of the path must be among the places: between them it is smooth, and the pieces are nearly exact.
        Platform and stated rows are left out.
        """
        i = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        h = (self.s[i + 1] - self.s[i])[:, None]
        t = (s - self.s[i])[:, None] / h
        q, d, c = self.q, self.dq[i] * h, self.ddq[i] * h**2
        # what the end asks for beyond the parabola of the beginning
        p = q[i + 1] - q[i] - d - 0.5 * c
        v, a = self.dq[i + 1] * h - d - c, self.ddq[i + 1] * h**2 - c
        k3, k4, k5 = 10.0 * p - 4.0 * v + 0.5 * a, -15.0 * p + 7.0 * v - a, 6.0 * p - 3.0 * v + 0.5 * a
        value = q[i] + t * (d + t * (0.5 * c + t * (k3 + t * (k4 + t * k5))))
        first = d + t * (c + t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)))
        second = c + t * (6.0 * k3 + t * (12.0 * k4 + t * 20.0 * k5))
        return replace(self, s=s, q=value, dq=first / h, ddq=second / h**2, platform=None, stated=PathRows.none(len(s)))

    def rows(self) -> PathRows:
        """Give all bounds but those of the jerk as rows, divided by their limit: at rest they are -1."""
        n = len(self.s)
        parts: list[PathRows] = []
        limited = np.isfinite(self.velocity)
        square = (self.dq[:, limited] / self.velocity[limited]) ** 2
        names = [f"velocity of {name!r}" for name, is_limited in zip(self.names, limited, strict=True) if is_limited]
        parts.append(PathRows(tuple(names), np.zeros_like(square), square, np.full_like(square, -1.0)))
        limited = np.isfinite(self.acceleration)
        a, b = (values[:, limited] / self.acceleration[limited] for values in (self.dq, self.ddq))
        names = [f"acceleration of {m!r}" for m, is_limited in zip(self.names, limited, strict=True) if is_limited]
        bound = np.full_like(a, -1.0)
        parts += [PathRows(tuple(names), a, b, bound), PathRows(tuple(names), -a, -b, bound)]
        parts.append(self.platform.rows() if self.platform else PathRows.none(n))
        return PathRows.join([*parts, self.stated])


def limit_path(problem: Problem, path: Path, s: Array, constraints: Sequence[PathConstraint] = ()) -> LimitedPath:
    """Evaluate a path and collect what bounds the motion along it.

    Args:
        problem: The problem, with its limits.
        path: The path.
        s: Parameters in [0, 1], shape (n,).
        constraints: Bounds beyond the limits and the dynamics of the problem.

    Raises:
        DefinitionError: An actuator has no velocity or acceleration limit.
        RetimeError: The path has no length in the actuators.
    """
    mechanism, limits = problem.robot.mechanism, problem.bounds
    for quantity in ("velocity", "acceleration"):
        values = limits.of(quantity, mechanism.active)
        missing = [n for n, v in zip(mechanism.active, values, strict=True) if not np.isfinite(v)]
        if missing:
            raise DefinitionError(
                f"actuators {missing} have no {quantity} limit; state it in Limits({quantity}=...)", limits=limits
            )
    names = limited_names(problem)
    index = mechanism.indices(names)
    points = path.points(s)
    dq, ddq = points.dX[:, index], points.ddX[:, index]
    # what Newton's method leaves of a path that stands still is far below this share of the machine's size
    scale = problem.robot.kinematics.graph.variable_scale[index]
    if not np.max(np.abs(dq) / scale) > 1e-12:
        raise RetimeError("the actuators do not move along the path: a path of zero length cannot be timed", path=path)
    bounds = limits.platform()
    stated = [constraint.rows(problem, points) for constraint in (*problem.dynamics, *constraints)]
    return LimitedPath(
        names, points.s, points.X[:, index], dq, ddq,
        limits.of("velocity", names), limits.of("acceleration", names), limits.of("jerk", names),
        PlatformMotion.along(problem.robot, points, bounds) if np.any(np.isfinite(bounds)) else None,
        PathRows.join([PathRows.none(len(points.s)), *stated]),
    )  # fmt: skip


def limited_names(problem: Problem) -> tuple[str, ...]:
    """Name the actuators, then the other variables for which a velocity, acceleration or jerk limit is stated."""
    mechanism, limits = problem.robot.mechanism, problem.bounds
    stated = {*limits.velocity, *limits.acceleration, *limits.jerk}
    return (*mechanism.active, *[n for n in mechanism.names if n in stated and n not in mechanism.active])


def third_derivatives(problem: Problem, path: Path, s: Array, width: float = 1e-5) -> tuple[Array, Array]:
    """Differentiate the exact second derivatives of the limited variables once more, by differences in s.

    At the knots of the spline the third derivative jumps: it is taken from either side.

    Args:
        problem: The problem.
        path: The path.
        s: Parameters, ascending, shape (n,).
        width: Distance over which the second derivatives are compared.

    Returns:
        Third derivatives just before and just after each parameter, shape (n, k) each.
    """
    index = problem.robot.mechanism.indices(limited_names(problem))
    knots = np.unique(path.spline.t).clip(0.0, 1.0)
    close = 1e-9
    low = knots[np.clip(np.searchsorted(knots, s - close) - 1, 0, None)]
    high = knots[np.clip(np.searchsorted(knots, s + close), None, len(knots) - 1)]
    # a difference stays within its piece of the spline
    down, up = (np.minimum(width, 0.5 * gap) for gap in (s - low, high - s))
    is_forward = up >= down
    step = np.where(is_forward, up, -down)
    beside = np.where(is_forward, -down, up)
    # away from the knots one difference serves both sides, and at the ends of the path there is no other side
    at_knot = np.flatnonzero((np.min(np.abs(s[:, None] - knots), axis=1) < close) & (beside != 0.0))
    places = np.concatenate([s, s + step, (s + beside)[at_knot]])
    here, there, other = np.split(path.points(places).ddX[:, index], [len(s), 2 * len(s)])
    first = (there - here) / step[:, None]
    second = first.copy()
    second[at_knot] = (other - here[at_knot]) / beside[at_knot, None]
    forward = is_forward[:, None]
    return np.where(forward, second, first), np.where(forward, first, second)
