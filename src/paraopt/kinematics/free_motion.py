"""A motion that the closures allow, told as velocities by name and as a twist of the platform."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.model import Kinematics

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """Hold a velocity of the whole mechanism that the closures allow, of length one in scaled units.

    Attributes:
        velocities: Velocity of every variable by name [m/s, rad/s or N/s].
        twist: Linear velocity of the platform's origin [m/s] and its angular velocity [rad/s] in the world, shape (6,).
        moving: Names of the variables that move by more than a thousandth of the largest, largest first.
    """

    velocities: Mapping[str, float]
    twist: Array
    moving: tuple[str, ...]


def describe_motion(kinematics: Kinematics, X: Array, motion: Array) -> FreeMotion:
    """Tell a motion of all variables by name, with the twist of the link that carries the last operational variable.

    Args:
        kinematics: The mechanism's functions.
        X: Where the mechanism is [m or rad], shape (n_variables,).
        motion: Velocities in characteristic lengths, radians and weights, shape (n_variables,).

    Returns:
        The motion in metres, radians and newtons.
    """
    mechanism = kinematics.mechanism
    largest = float(np.max(np.abs(motion), initial=0.0))
    order = np.argsort(-np.abs(motion), kind="stable")
    moving = tuple(mechanism.names[i] for i in order if largest > 0 and abs(motion[i]) > 1e-3 * largest)
    velocity = motion * kinematics.graph.variable_scale
    platform = [link.name for link in mechanism.links].index(mechanism.variables[-1].link)
    X_W = kinematics.poses(X)[0, platform]
    dX_W = kinematics.pose_velocity(X, velocity[None, :, None])[0, 0, platform]
    spin = dX_W[:, :3] @ X_W[:3, :3].T
    twist = np.concatenate([dX_W[:, 3], [spin[2, 1], spin[0, 2], spin[1, 0]]])
    return FreeMotion(dict(zip(mechanism.names, velocity.tolist(), strict=True)), twist, moving)
