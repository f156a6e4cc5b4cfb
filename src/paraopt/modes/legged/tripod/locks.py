"""What holds the platform while a leg is in the air: the matrix of the locks, its rank, and what escapes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import InfeasibleError
from paraopt.kinematics import Kinematics
from paraopt.modes.legged.tripod.chain import TripodModel
from paraopt.modes.legged.tripod.frames import read_feet, read_frame, rotations
from paraopt.modes.legged.tripod.geometry import (
    LEGS,
    POSE,
    check_leg,
    foot_names,
    lock_names,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LockReport:
    """Tell how well the locks of a leg hold the platform at a pose.

    Attributes:
        leg: The leg in the air.
        pose: Pose of the platform [m, rad], shape (6,).
        matrix: B = d b / d pose, lengths in r_p [1], shape (6, 6).
        singular_values: Those of B, falling, shape (6,).
        rank: Number of them above the tolerance.
        direction: Motion of the platform that the locks feel least, of length 1 in r_p and radians, shape (6,).
        slide: Cosine between that motion and a slide of the platform along the leg in the air, from A to P_C [1].
        level: Largest `|u . w_a|` of the standing legs [1]: where it is zero, P_L P_R of both is square to the normal
            of its foot, and the locks have rank 5.
    """

    leg: int
    pose: Array
    matrix: Array
    singular_values: Array
    rank: int
    direction: Array
    slide: float
    level: float

    @property
    def smallest(self) -> float:
        """Give the smallest singular value [1]."""
        return float(self.singular_values[-1])

    @property
    def free_motion(self) -> str:
        """Say what the locks feel least, and why."""
        if self.slide > 0.999:
            how = f"the platform slides along lc of leg {self.leg}, from its foot to P_C"
        else:
            parts = ", ".join(f"{c} {v:+.2f}" for c, v in zip(POSE, self.direction, strict=True))
            how = f"the platform moves along ({parts}), lengths in r_p"
        how += ", with all locked joints unchanged"
        if self.level < 1e-6:
            how += "; P_L P_R of both standing legs is square to the normal of its foot, as on a level platform"
        return how

    @property
    def reason(self) -> str:
        """Say how many motions the locks hold, and which they do not."""
        return f"rank {self.rank} of 6: {self.free_motion}" if self.rank < 6 else f"nearly rank 5: {self.free_motion}"


def report_locks(model: TripodModel, leg: int, pose: ArrayLike, feet: ArrayLike, tolerance: float = 1e-8) -> LockReport:
    """Analyse the locks of a leg at a pose.

    Args:
        model: The closed forms.
        leg: The leg that is to come off.
        pose: Pose of the platform [m, rad], shape (6,).
        feet: Frames of the feet [m, rad], shape (3, 6).
        tolerance: Singular value, of the greatest, below which it counts as zero [1].

    Returns:
        The report.

    Source: Tripod, 4.1.
    """
    check_leg(leg)
    pose, feet = read_frame(pose), read_feet(feet)
    B = model.locks(leg, pose, feet).B[0]
    _, values, V = np.linalg.svd(B)
    R = rotations(pose)[0]
    turn = model.geometry.azimuth(leg)
    way = (
        pose[:3] + R @ (model.geometry.centre_radius * np.array([np.cos(turn), np.sin(turn), 0.0])) - feet[leg - 1, :3]
    )
    along = np.concatenate([way / np.linalg.norm(way), np.zeros(3)])
    level = 0.0
    for k in LEGS:
        if k != leg:
            u = R @ np.array([-np.sin(model.geometry.azimuth(k)), np.cos(model.geometry.azimuth(k)), 0.0])
            level = max(level, abs(float(u @ rotations(feet[k - 1])[0, :, 2])))
    direction = V[-1] * np.sign(V[-1] @ along or 1.0)
    rank = int(np.count_nonzero(values > tolerance * values[0]))
    return LockReport(leg, pose, B, values, rank, direction, float(abs(V[-1] @ along)), level)


def check_locks(
    model: TripodModel, leg: int, pose: ArrayLike, feet: ArrayLike, margin: float = 0.01, phase: str = ""
) -> LockReport:
    """Refuse a pose at which the locks of a leg do not hold the platform.

    Args:
        model: The closed forms.
        leg: The leg that is to come off.
        pose: Pose of the platform [m, rad], shape (6,).
        feet: Frames of the feet [m, rad], shape (3, 6).
        margin: Smallest allowed singular value of the matrix of the locks [1].
        phase: How messages call the phase.

    Returns:
        The report.

    Raises:
        InfeasibleError: It is below the margin; the message says what stays free. Evidence: "report".
    """
    report = report_locks(model, leg, pose, feet)
    if report.smallest < margin:
        what = f"phase {phase!r}: " if phase else ""
        raise InfeasibleError(
            f"{what}foot {leg} cannot come off: the locks do not hold the platform (smallest singular value "
            f"{report.smallest:.3g}, asked {margin:g}); {report.reason}. Tilt the platform first, about "
            f"P_L P_R of leg {leg}",
            report=report,
            leg=leg,
            margin=report.smallest,
        )
    return report


# --- By the general kinematics, which know nothing of the closed forms


def lock_matrix(kinematics: Kinematics, leg: int, X: ArrayLike, length: float) -> Array:
    """Give B = d b / d pose from the general closures.

    Args:
        kinematics: Those of the tripod with free feet.
        leg: The leg in the air.
        X: Configurations, shape (n, n_variables).
        length: What a length is divided by [m].

    Returns:
        Shape (n, 6, 6).
    """
    T = kinematics.tangent(X, kinematics.mechanism.operational)
    columns = [kinematics.mechanism.operational.index(n) for n in POSE]
    rows = kinematics.mechanism.indices(lock_names(leg))
    return np.asarray(T[:, rows][:, :, columns] * np.array([length] * 3 + [1.0] * 3))


def smallest_of_columns(kinematics: Kinematics, leg: int, X: ArrayLike) -> Array:
    """Give the smallest singular value of the scaled columns of E that feet and locks leave to be solved for.

    Args:
        kinematics: Those of the tripod with free feet.
        leg: The leg in the air.
        X: Configurations, shape (n, n_variables).

    Returns:
        Shape (n,); zero where the platform is not held.
    """
    (E,) = kinematics.functions.scaled_jacobian.batch(np.atleast_2d(np.asarray(X, dtype=float)))
    mechanism = kinematics.mechanism
    imposed = {*(n for i in LEGS for n in foot_names(i)), *lock_names(leg)}
    free = [i for i, n in enumerate(mechanism.names) if n not in imposed]
    return np.asarray(np.linalg.svd(E[:, :, free], compute_uv=False)[:, -1])
