"""Frames of platform and feet: x, y, z and alpha, beta, gamma of `Rz(gamma) Ry(beta) Rx(alpha)`."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics import CompiledFunction
from paraopt.spatial import rotation_about

Array = NDArray[np.float64]


def rotation_zyx(alpha: Any, beta: Any, gamma: Any) -> Any:
    """Build `R = Rz(gamma) Ry(beta) Rx(alpha)`, numbers or CasADi scalars; the 3 x 3 CasADi matrix.

    Source: Tripod, 4.1.
    """
    return rotation_about("z", gamma) @ rotation_about("y", beta) @ rotation_about("x", alpha)


@cache
def _batch() -> CompiledFunction:
    angles = ca.SX.sym("angles", 3)
    return CompiledFunction(ca.Function("tripod_rotation", [angles], [rotation_zyx(*ca.vertsplit(angles))]))


def rotations(frames: ArrayLike) -> Array:
    """Give the rotations of n frames (n, 6), shape (n, 3, 3)."""
    return _batch().batch(np.atleast_2d(np.asarray(frames, dtype=float))[:, 3:])[0]


def read_angles(R: ArrayLike) -> Array:
    """Read alpha, beta, gamma off a rotation (3, 3), beta within a quarter turn [rad], shape (3,)."""
    R = np.asarray(R, dtype=float)
    return np.array(
        [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1.0, 1.0)), np.arctan2(R[1, 0], R[0, 0])]
    )


def read_frame(frame: ArrayLike, what: str = "pose of the platform") -> Array:
    """Read x, y, z, alpha, beta, gamma [m, rad], shape (6,).

    Args:
        frame: The six numbers.
        what: How messages call them.

    Returns:
        A copy.

    Raises:
        DefinitionError: There are not six finite numbers.
    """
    array = np.array(frame, dtype=float)
    if array.shape != (6,) or not np.all(np.isfinite(array)):
        raise DefinitionError(f"{what} has shape {array.shape}; it must be six finite numbers")
    return array


def read_feet(feet: ArrayLike) -> Array:
    """Read the frames of the three feet.

    Args:
        feet: x, y, z, alpha, beta, gamma of each foot [m, rad], shape (3, 6).

    Returns:
        A copy.

    Raises:
        DefinitionError: The shape is another one, or a value is not finite.
    """
    array = np.array(feet, dtype=float)
    if array.shape != (3, 6) or not np.all(np.isfinite(array)):
        raise DefinitionError(f"feet have shape {array.shape}; they must be three frames of six finite numbers")
    return array


def move_frames(frames: ArrayLike, shift: ArrayLike = (0.0, 0.0, 0.0), turn: float = 0.0) -> Array:
    """Move frames together: turn them about the vertical through their middle, then shift them.

    Args:
        frames: The frames [m, rad], shape (n, 6).
        shift: Way [m], shape (3,).
        turn: Angle about z [rad].

    Returns:
        The new frames, shape (n, 6).
    """
    moved = np.array(frames, dtype=float, ndmin=2)
    R, middle = np.asarray(rotation_about("z", turn)), moved[:, :3].mean(axis=0)
    moved[:, :3] = middle + (moved[:, :3] - middle) @ R.T + np.asarray(shift, dtype=float)
    moved[:, 5] += turn
    return moved


def tilt_frame(frame: ArrayLike, azimuth: float, angle: float) -> Array:
    """Tilt a frame about a line in its own plane of x and y.

    Args:
        frame: The frame [m, rad], shape (6,).
        azimuth: Direction that goes down [rad], from x towards y; the line is square to it.
        angle: Angle of the tilt [rad].

    Returns:
        The frame, shape (6,).
    """
    tilted = read_frame(frame)
    turn = np.asarray(rotation_about("z", azimuth))
    R = rotations(tilted)[0] @ turn @ np.asarray(rotation_about("y", angle)) @ turn.T
    tilted[3:] = read_angles(R)
    return tilted
