"""Time-optimal retiming with toppra, checked between its grid points."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint
from numpy.typing import NDArray

from paraopt.errors import BackendError, DefinitionError, RetimeError
from paraopt.planning.law import TimeLaw
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.retime_base import DrivePath, choose_times, measure_use, sample_drives
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]

# toppra reports its failures as warnings of its log; here they become errors that name their cause
logging.getLogger("toppra").setLevel(logging.CRITICAL)


class _GridPath(toppra.interpolator.AbstractGeometricPath):
    """Show the actuators at the grid points to toppra, with exact derivatives.

    The parameter is stretched by `unit`, so that the speeds toppra sees are near 1 whatever the units of the machine:
    its tolerances are absolute.
    """

    def __init__(self, drives: DrivePath, unit: float) -> None:
        self.drives, self.unit = drives, unit

    def __call__(self, path_positions: Any, order: int = 0) -> Array:
        wanted = np.atleast_1d(np.asarray(path_positions, dtype=float)) / self.unit
        middles = 0.5 * (self.drives.s[1:] + self.drives.s[:-1])
        index = np.searchsorted(middles, wanted)
        if not np.allclose(self.drives.s[index], wanted, rtol=0.0, atol=1e-12):
            raise BackendError("toppra asked for the path between its grid points")
        values = (self.drives.q, self.drives.dq, self.drives.ddq)[order][index] / self.unit**order
        return values[0] if np.ndim(path_positions) == 0 else values

    @property
    def dof(self) -> int:
        return len(self.drives.names)

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, self.unit])


@dataclass(frozen=True)
class TimeOptimal:
    """Time a path as fast as the velocity and acceleration limits of the actuators allow.

    Attributes:
        n_grid: Number of grid intervals at first.
        refinements: How often the grid is doubled when the limits are exceeded between its points.
        tolerated: Excess between grid points that is removed by uniform slowing instead [1].
        reserve: Share of the time that is added so that the limits also hold between the points of the check [1].

    Source: toppra.
    """

    bounds_jerk: ClassVar[bool] = False
    n_grid: int = 100
    refinements: int = 3
    tolerated: float = 0.01
    reserve: float = 3e-4

    def __post_init__(self) -> None:
        if self.n_grid < 4:
            raise DefinitionError(f"n_grid is {self.n_grid}; it must be at least 4")

    def retime(self, problem: Problem, path: Path) -> Trajectory:
        """Time a path.

        Args:
            problem: The problem, with the limits of the actuators.
            path: The path.

        Returns:
            A trajectory from rest to rest whose limits hold on a check ten times denser than the grid.

        Raises:
            DefinitionError: A limit is missing.
            RetimeError: toppra found no time law; the message names the cause.
        """
        n = self.n_grid
        for attempt in range(self.refinements + 1):
            law = self._solve(problem, path, n)
            times = choose_times(path, law, 10 * n + 7)  # offset from the grid points
            use = measure_use(sample_drives(problem, path, law(times)), law, times)
            if use.stretch <= 1.0 + self.tolerated or attempt == self.refinements:
                factor = use.stretch * (1.0 + self.reserve)
                return Trajectory(path, law.stretched(factor), "time-optimal (toppra)", max(factor, 1.0), n)
            n *= 2
        raise AssertionError("unreachable: the last attempt returns")

    def _solve(self, problem: Problem, path: Path, n: int) -> TimeLaw:
        # denser towards the ends, where the motion is slow, so that the points are spread more evenly in time;
        # the path's second derivative has its corners at the knots: they are grid points too
        u = np.linspace(0.0, 1.0, n + 1)
        spread = 0.3 * u + 0.7 * 0.5 * (1.0 - np.cos(np.pi * u))
        knots = np.unique(path.spline.t)
        near = np.min(np.abs(spread[:, None] - knots), axis=1) <= 0.1 / n
        s = np.union1d(spread[~near], knots)
        drives = sample_drives(problem, path, s)
        still = np.max(np.abs(drives.dq) / drives.velocity, axis=1)
        self._check_moves(path, s, still <= 1e-9 * np.max(still))
        unit = float(np.max(np.abs(drives.dq) / drives.velocity))
        scheme = toppra.constraint.DiscretizationType.Interpolation
        constraints = [
            toppra.constraint.JointVelocityConstraint(np.column_stack([-drives.velocity, drives.velocity])),
            toppra.constraint.JointAccelerationConstraint(
                np.column_stack([-drives.acceleration, drives.acceleration]), discretization_scheme=scheme
            ),
        ]
        try:
            instance = toppra.algorithm.TOPPRA(
                constraints,
                _GridPath(drives, unit),
                gridpoints=unit * s,
                solver_wrapper="seidel",
                parametrizer="ParametrizeConstAccel",
            )
            _, speed, _ = instance.compute_parameterization(0.0, 0.0)
        except (ValueError, RuntimeError, FloatingPointError) as error:
            raise BackendError(f"toppra failed: {error}", path=path) from error
        if speed is None or not np.all(np.isfinite(speed)):
            raise RetimeError(f"toppra found no time law: {instance.problem_data.return_code.value}", path=path)
        speed = speed / unit
        means = 0.5 * (speed[1:] + speed[:-1])
        self._check_moves(path, s, means <= 1e-10 / unit)
        dt = np.diff(s) / means
        acceleration = np.diff(speed) / dt
        breaks = np.concatenate([[0.0], np.cumsum(dt)])
        return TimeLaw(breaks, np.vstack([0.5 * acceleration, speed[:-1], s[:-1]]))

    def _check_moves(self, path: Path, s: Array, still: NDArray[np.bool_]) -> None:
        """Refuse a path that cannot be followed at some of the parameters s."""
        stalled = np.flatnonzero(still)
        if stalled.size:
            place = float(s[stalled[0]])
            raise RetimeError(
                f"the path speed falls to zero at s = {place:.4f}, where no speed of the parameter can follow the path "
                "(a cusp, or repeated points); move the control points apart",
                path=path,
                s=place,
            )
