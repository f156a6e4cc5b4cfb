"""What of a hanging platform's inertia no tensions balance: the wrench that makes it swing about its motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.modes.cable.chain import MotionChain
from paraopt.modes.cable.distribution import coordinate_places
from paraopt.modes.cable.facets import scale_moments
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.wrench import cable_functions
from paraopt.planning import Trajectory

Array = NDArray[np.float64]


def pulling_force(robot: CableRobot) -> float:
    """Give the size of weight and load together [N], by which unbalanced wrenches are judged."""
    force = np.zeros(3)
    force[: 2 if robot.planar else 3] = robot.load[: 2 if robot.planar else 3]
    return float(np.linalg.norm(robot.mass * robot.gravity + force))


def unbalanced_part(robot: CableRobot, poses: ArrayLike, wrench: ArrayLike) -> Array:
    """Give what of wrenches no tensions, of whatever sign, balance.

    Args:
        robot: The cable robot.
        poses: Poses, shape (k, dof).
        wrench: Wrenches about the platform's origin [N, N m], shape (k, dof).

    Returns:
        The part, with moments over the characteristic length [N], shape (k, dof).
    """
    W = cable_functions(robot).wrench_matrix(poses)
    A = scale_moments(W.transpose(0, 2, 1), robot.length_scale).transpose(0, 2, 1)
    b = scale_moments(np.asarray(wrench, dtype=float), robot.length_scale)
    return np.asarray(b - np.einsum("kdn,knc,kc->kd", A, np.linalg.pinv(A), b))


def measure_sway(
    robot: CableRobot, trajectory: Trajectory | MotionChain, t: ArrayLike | None = None, count: int = 2001
) -> Array:
    """Measure along a motion what of weight, load and inertia no tensions balance.

    It is the size of what disturbs the platform from its motion, not how far it swings then.

    Args:
        robot: The cable robot.
        trajectory: A motion of its `robot`.
        t: Times [s]; `count` of them, equally far apart, when None.
        count: Number of times when none are given.

    Returns:
        Norms with moments over the characteristic length, over weight and load [1], shape (k,).

    Raises:
        DefinitionError: The trajectory is that of a mechanism without the robot's coordinates.
    """
    times = np.linspace(0.0, trajectory.duration, count) if t is None else np.atleast_1d(np.asarray(t, dtype=float))
    index = coordinate_places(robot, trajectory.robot.mechanism)
    state = trajectory.state(times)
    poses, velocities, accelerations = (v[:, index] for v in (state.X, state.velocity, state.acceleration))
    wrench = cable_functions(robot).dynamic_wrench(poses, velocities, accelerations)
    return np.asarray(np.linalg.norm(unbalanced_part(robot, poses, wrench), axis=1) / pulling_force(robot))
