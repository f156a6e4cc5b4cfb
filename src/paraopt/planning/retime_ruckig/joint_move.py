"""Moves from point to point of the actuators, with limited jerk; the platform follows on its branch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.kinematics import Configuration, FollowOptions, follow
from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.retime_base import choose_times, limit_path, measure_use
from paraopt.planning.retime_ruckig.profile import solve_profiles
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]
Via = Mapping[str, float] | Configuration


@dataclass(frozen=True)
class JointMove:
    """Move the actuators from point to point within their limits of velocity, acceleration and jerk.

    Each phase between two points is the fastest of ruckig's profiles in which all actuators arrive together. A via
    point is a stop, or is passed with a speed: that share of the mean speed of an actuator around the point which makes
    the whole move shortest, zero where the actuator turns back. The platform is followed along its branch; where the
    branch ends there is no such move. Obstacles are not looked at: `verify` does.

    Attributes:
        straight: Whether the actuators keep to straight lines between the points, and so stop at via points; else each
            moves as it likes, and may be slower than it could where another one needs the time.
        blend: Largest share of the mean speed with which via points are passed, in [0, 2]; 0 stops there.
        reserve: Share of the time that is added where limits of other variables or of the platform slow the move [1].

    Raises:
        DefinitionError: The blend is outside its range, or asked for on straight lines.

    Source: ruckig.
    """

    straight: bool = False
    blend: float = 0.0
    reserve: float = 3e-4

    def __post_init__(self) -> None:
        if not 0.0 <= self.blend <= 2.0:
            raise DefinitionError(f"blend is {self.blend}; it must be in [0, 2]")
        if self.straight and self.blend > 0.0:
            raise DefinitionError(f"blend is {self.blend}, but straight lines stop at their corners; set one of both")

    def move(self, problem: Problem, via: Sequence[Via] = ()) -> Trajectory:
        """Move from the start to the goal of a problem.

        Args:
            problem: The problem.
            via: Points between: operational values by name, solved on the branch of the point before, or
                configurations.

        Returns:
            A trajectory whose independent coordinates are the actuators.

        Raises:
            DefinitionError: A limit is missing.
            InfeasibleError: The branch of the start ends on the way, or leads to another configuration than the goal.
            RetimeError: ruckig found no profile, or nothing moves.
        """
        robot, bounds = problem.robot, problem.bounds
        names = tuple(robot.mechanism.active)
        limits = [bounds.of(quantity, names) for quantity in ("velocity", "acceleration", "jerk")]
        for quantity, values in zip(("velocity", "acceleration", "jerk"), limits, strict=True):
            missing = [n for n, v in zip(names, values, strict=True) if not np.isfinite(v)]
            if missing:
                raise DefinitionError(
                    f"actuators {missing} have no {quantity} limit; state it in Limits({quantity}=...)", limits=bounds
                )
        points = self._points(problem, via)
        motion = self._join(np.diff(points, axis=0), limits, names)
        spline = _as_spline(motion, points[0])
        path = self._follow(problem, names, spline)
        duration = float(motion.x[-1])
        law = TimeLaw(np.array([0.0, duration]), np.array([[1.0 / duration], [0.0]]))
        # other variables and the platform follow: where they have limits of their own the whole move is run slower
        times = choose_times(path, law, 2000)
        use = measure_use(limit_path(problem, path, law(times)), law, times)
        factor = use.stretch * (1.0 + self.reserve) if use.stretch > 1.0 + self.reserve else 1.0
        method = "point to point (ruckig)"
        if factor > 1.0:
            method += f", run {100 * (factor - 1.0):.2g} % slower for the platform or the passive joints"
        return Trajectory(path, law.stretched(factor), method, factor, len(times))

    def _points(self, problem: Problem, via: Sequence[Via]) -> Array:
        """Give the values of the actuators at all points, angles without end turned the short way."""
        mechanism, kinematics = problem.robot.mechanism, problem.robot.kinematics
        here = problem.start_configuration
        known = [here]
        for point in via:
            if not isinstance(point, Configuration):
                solution = kinematics.inverse(point, start=here)
                if solution.residual > 1e-9 or any(
                    abs(solution.X[mechanism.index(n)] - v) > 1e-9 for n, v in point.items()
                ):
                    raise InfeasibleError(f"via point is out of reach: {solution.summary}", solution=solution)
                point = solution.configuration
            here = point
            known.append(here)
        known.append(problem.goal_configuration)
        index = mechanism.indices(mechanism.active)
        values = np.array([configuration.X[index] for configuration in known])
        low, high = problem.bounds.bounds(mechanism)
        kinds = np.array([v.kind == "angle" for v in mechanism.variables])[index]
        endless = kinds & ~np.isfinite(low[index]) & ~np.isfinite(high[index])
        steps = np.diff(values, axis=0)
        steps = np.where(endless, (steps + np.pi) % (2.0 * np.pi) - np.pi, steps)
        return np.vstack([values[:1], values[:1] + np.cumsum(steps, axis=0)])

    def _join(self, steps: Array, limits: Sequence[Array], names: tuple[str, ...]) -> PPoly:
        """Put phases one after the other, with the speeds at via points that make the whole shortest."""
        steps = steps[np.any(steps != 0.0, axis=1)] if np.any(steps != 0.0) else steps[:1]
        rest = np.zeros((len(steps) + 1, steps.shape[1]))
        best = self._chain(steps, rest, limits, names)
        if self.blend == 0.0 or len(steps) < 2:
            return best
        durations = [self._chain(step[None], rest[:2], limits, names).x[-1] for step in steps]
        means = np.abs(steps) / np.array(durations)[:, None]
        onward = np.sign(steps[1:]) == np.sign(steps[:-1])
        speeds = rest.copy()
        speeds[1:-1] = np.where(onward, np.sign(steps[1:]) * np.minimum(means[1:], means[:-1]), 0.0)
        for share in np.linspace(0.0, self.blend, 11)[1:]:
            passing = np.clip(share * speeds, -limits[0], limits[0])
            joined = self._chain(steps, passing, limits, names)
            if joined.x[-1] < best.x[-1]:
                best = joined
        return best

    def _chain(self, steps: Array, passing: Array, limits: Sequence[Array], names: tuple[str, ...]) -> PPoly:
        """Ask for one phase after the other, with given velocities at the points between."""
        breaks, pieces, done = [np.zeros(1)], [], np.zeros(steps.shape[1])
        for step, before, after in zip(steps, passing[:-1], passing[1:], strict=True):
            times, part = solve_profiles(
                step, limits, straight=self.straight, names=names, passing=None if self.straight else (before, after)
            )
            part[3] += done
            breaks.append(breaks[-1][-1] + times[1:])
            pieces.append(part)
            done = done + step
        return PPoly(np.concatenate(pieces, axis=1), np.concatenate(breaks))

    def _follow(self, problem: Problem, names: tuple[str, ...], spline: BSpline) -> Path:
        """Follow the branch of the start along the actuators, as far as the goal."""
        robot = problem.robot
        kinematics, start = robot.kinematics, problem.start_configuration
        followed = follow(kinematics, start, spline, names, FollowOptions(first_step=0.01, largest_step=1.0 / 48))
        if not followed.arrived:
            raise InfeasibleError(
                f"the actuators cannot move from start to goal of {robot.name!r} on their branch: {followed.detail}; "
                "take another way by via points, or plan a path of the platform",
                followed=followed,
            )
        gap = followed.X[-1] - problem.goal_configuration.X
        angles = np.array([v.kind == "angle" for v in robot.mechanism.variables])
        gap = np.where(angles, (gap + np.pi) % (2.0 * np.pi) - np.pi, gap) / kinematics.graph.variable_scale
        judged = [i for i, n in enumerate(robot.mechanism.names) if n not in kinematics.idle]
        worst = max(judged, key=lambda i: abs(gap[i]))
        if abs(gap[worst]) > 1e-6:
            raise InfeasibleError(
                f"the actuators reach the goal in another assembly: {robot.mechanism.names[worst]!r} is "
                f"{followed.X[-1][worst]:.6g} instead of {problem.goal_configuration.X[worst]:.6g}; state that "
                "configuration as the goal, or plan a path of the platform",
                followed=followed,
            )
        return Path(robot, names, spline, followed.s, followed.X)


def _as_spline(motion: PPoly, origin: Array) -> BSpline:
    """Write a motion as a spline over [0, 1]: exactly, by the polar forms of its pieces at their knots."""
    T = float(motion.x[-1])
    knots = np.concatenate([[0.0] * 4, motion.x[1:-1] / T, [1.0] * 4])
    count = len(knots) - 4
    triples = np.stack([knots[1 : count + 1], knots[2 : count + 2], knots[3 : count + 3]])
    piece = np.clip(np.searchsorted(motion.x / T, triples[1], side="right") - 1, 0, len(motion.x) - 2)
    x, y, z = (triples - motion.x[piece] / T)[:, :, None] * T
    c3, c2, c1, c0 = (row[piece] for row in motion.c)
    polar = c3 * x * y * z + c2 * (x * y + y * z + z * x) / 3.0 + c1 * (x + y + z) / 3.0 + c0
    return BSpline(knots, polar + origin, 3)
