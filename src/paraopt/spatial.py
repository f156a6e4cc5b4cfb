"""Rotations and homogeneous transforms, written once for numbers and for CasADi symbols.

Poses follow the monogram notation: `X_AB` is the pose of frame B in frame A, `p_AB` the position of B's origin
in A, `R_AB` the rotation, so that `p_A = X_AB p_B`. Angles are in radians, lengths in metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError

AXES = ("x", "y", "z")


def rotation_about(axis: str, angle: Any) -> Any:
    """Build the 3 x 3 rotation about a base axis.

    Args:
        axis: "x", "y" or "z".
        angle: Angle [rad], a number or a CasADi scalar.

    Returns:
        A CasADi matrix, `DM` for a number and `SX` for a symbol.
    """
    c, s = ca.cos(angle), ca.sin(angle)
    if axis == "x":
        rows = [[1, 0, 0], [0, c, -s], [0, s, c]]
    elif axis == "y":
        rows = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    elif axis == "z":
        rows = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    else:
        raise DefinitionError(f"axis is {axis!r}; it must be one of 'x', 'y', 'z'")
    return ca.vertcat(*[ca.horzcat(*row) for row in rows])


def rotation_xyz(alpha: Any, beta: Any, gamma: Any) -> Any:
    """Build `R = Rx(alpha) Ry(beta) Rz(gamma)`.

    Args:
        alpha: First angle [rad].
        beta: Second angle [rad].
        gamma: Third angle [rad].

    Returns:
        The 3 x 3 CasADi matrix.

    Source: Lahouar, II.1 (x-y-z convention).
    """
    return rotation_about("x", alpha) @ rotation_about("y", beta) @ rotation_about("z", gamma)


def transform(position: Sequence[float] = (0.0, 0.0, 0.0), rotation: Sequence[float] = (0.0, 0.0, 0.0)) -> NDArray[Any]:
    """Build a constant homogeneous transform.

    Args:
        position: Origin (x, y, z) [m].
        rotation: Angles (alpha, beta, gamma) [rad] of `Rx Ry Rz`.

    Returns:
        The pose, shape (4, 4).

    Raises:
        DefinitionError: A component is not a finite number, or there are not three of them.
    """
    p, angles = finite_vector(position, 3, "position"), finite_vector(rotation, 3, "rotation")
    X = np.eye(4)
    X[:3, :3] = np.asarray(ca.DM(rotation_xyz(*[float(a) for a in angles])))
    X[:3, 3] = p
    return X


def segment_pose(p_A: Sequence[float], p_B: Sequence[float]) -> tuple[NDArray[Any], float]:
    """Build the pose whose z axis runs from one point to another, centred between them.

    Args:
        p_A: First end [m], shape (3,).
        p_B: Second end [m], shape (3,).

    Returns:
        The pose, shape (4, 4), and the distance between the points [m].

    Raises:
        DefinitionError: The points coincide or are not finite.
    """
    a, b = finite_vector(p_A, 3, "segment end"), finite_vector(p_B, 3, "segment end")
    length = float(np.linalg.norm(b - a))
    if length == 0.0:
        raise DefinitionError(f"segment has zero length: both ends are {tuple(a.tolist())} m")
    z = (b - a) / length
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    X[:3, 3] = 0.5 * (a + b)
    return X, length


def finite_vector(values: Any, size: int | None, what: str) -> NDArray[np.float64]:
    """Copy values into a read-only vector of finite floats.

    Args:
        values: A sequence of numbers.
        size: Required length; any length when None.
        what: How an error calls the vector.

    Returns:
        The vector, shape (size,), read-only.

    Raises:
        DefinitionError: The length is wrong, or a component is not a finite number below 1e150.
    """
    try:
        vector = _real_array(values)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} is {values!r}; it must be numbers") from error
    if vector.ndim != 1 or (size is not None and vector.shape != (size,)):
        wanted = "one-dimensional" if size is None else f"of {size} components"
        raise DefinitionError(f"{what} is {values!r} of shape {vector.shape}; it must be {wanted}")
    if not np.all(np.isfinite(vector)):
        raise DefinitionError(f"{what} is {vector.tolist()}; every component must be finite")
    if np.any(np.abs(vector) >= 1e150):  # their squares would overflow
        raise DefinitionError(f"{what} is {vector.tolist()}; every component must be below 1e150")
    vector.flags.writeable = False
    return vector


def check_pose(X: Any, what: str, tolerance: float = 1e-9) -> NDArray[np.float64]:
    """Copy a homogeneous transform and refuse what is not one.

    Args:
        X: Pose, shape (4, 4).
        what: How an error calls the pose.
        tolerance: Largest allowed departure of `R^T R` from the identity [1].

    Returns:
        The pose, shape (4, 4), read-only.

    Raises:
        DefinitionError: Wrong shape, non-finite entries, or not a right-handed rotation.
    """
    try:
        pose = _real_array(X)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} is {X!r}; it must be a 4 x 4 matrix of numbers") from error
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
        raise DefinitionError(f"{what} must be a finite 4 x 4 matrix; its shape is {pose.shape}")
    if np.any(np.abs(pose) >= 1e150):  # their squares would overflow
        raise DefinitionError(f"{what} has an entry of {np.max(np.abs(pose)):.3g}; all must be below 1e150")
    R = pose[:3, :3]
    error_ = float(np.max(np.abs(R.T @ R - np.eye(3))))
    if error_ > tolerance or np.linalg.det(R) < 0 or np.any(pose[3] != (0.0, 0.0, 0.0, 1.0)):
        raise DefinitionError(f"{what} is not a rigid pose: |R^T R - 1| is {error_:.3g}, det R {np.linalg.det(R):.6g}")
    pose.flags.writeable = False
    return pose


def _real_array(values: Any) -> NDArray[np.float64]:
    if isinstance(values, np.ndarray) and np.iscomplexobj(values):
        raise TypeError("complex numbers have no place here")  # NumPy would drop their imaginary part
    return np.array(values, dtype=float)
