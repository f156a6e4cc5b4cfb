"""Dimensions of the tripod and the names of its variables, stated once for the robot and for its modes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.legged.tripod.frames import read_angles, read_feet

Array = NDArray[np.float64]
Range = tuple[float, float]

POSE = ("x", "y", "z", "alpha", "beta", "gamma")
LEGS = (1, 2, 3)
SIDES = ("L", "R")
CHAIN = ("q1", "q2", "q3", "q4", "q5", "q6")


@dataclass(frozen=True)
class TripodGeometry:
    """Describe a tripod; no dimension is printed in the source, so the defaults are ours.

    Attributes:
        radius: Radius of the circle of the points of attachment r_p [m].
        half_angle: Angle theta between P_L or P_R and the leg's direction [rad].
        foot_radius: Radius of the circle of the feet at home [m].
        height: Height of the platform above the feet at home [m].
        stroke: Least and greatest length of an actuator [m].
        q1: Range of the turn of a leg about the normal of its foot [rad].
        q2: Range of its lean outwards or inwards [rad].
        q3: Range of its lean to a side [rad].
        q5: Range of the turn of the platform in the plane of the leg's actuators [rad].
        q6: Range of the fold between that plane and the platform [rad].

    Raises:
        DefinitionError: A length is not above zero, the half angle is not between 0 and 60 degrees, a range is empty,
            or home is out of a range.

    Source: Tripod.
    """

    radius: float = 0.15
    half_angle: float = math.radians(20)
    foot_radius: float = 0.26
    height: float = 0.32
    stroke: Range = (0.25, 0.46)
    q1: Range = (-1.2, 1.2)
    q2: Range = (-0.7, 1.2)
    q3: Range = (-0.8, 0.8)
    q5: Range = (-0.8, 0.8)
    q6: Range = (-1.4, 0.8)

    def __post_init__(self) -> None:
        for name in ("radius", "foot_radius", "height"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise DefinitionError(f"{name} of the tripod is {value} m; it must be finite and above 0")
        if not 0 < self.half_angle < math.pi / 3:
            raise DefinitionError(
                f"half angle of the tripod is {self.half_angle} rad; it must lie between 0 and pi/3, where the points "
                "of neighbouring legs meet"
            )
        for name in ("stroke", "q1", "q2", "q3", "q5", "q6"):
            low, high = getattr(self, name)
            if not low < high or (name == "stroke" and low <= 0):
                raise DefinitionError(f"{name} of the tripod is [{low}, {high}]; the first must be below the second")
        home = self.home_joints
        for name, (low, high) in (*self.joint_ranges.items(), ("qL", self.stroke)):
            if not low <= home[name] <= high:
                raise DefinitionError(f"{name} of the tripod is {home[name]:.4g} at home, out of [{low}, {high}]")

    # -- dimensions ------------------------------------------------------------------------------------------------

    @property
    def half_width(self) -> float:
        """Give the distance d from P_C to P_L and P_R [m]."""
        return self.radius * math.sin(self.half_angle)

    @property
    def centre_radius(self) -> float:
        """Give the distance from the platform's origin to each P_C [m]."""
        return self.radius * math.cos(self.half_angle)

    @property
    def joint_ranges(self) -> Mapping[str, Range]:
        """Give the ranges of the joints of the equivalent chain by name, without the leg's number [m or rad]."""
        reach = (0.5 * self.stroke[0], 2 * self.stroke[1])
        return {"q1": self.q1, "q2": self.q2, "q3": self.q3, "q4": reach, "q5": self.q5, "q6": self.q6}

    @property
    def home_joints(self) -> Mapping[str, float]:
        """Give the joints of each leg at home, by name without the leg's number [m or rad]."""
        out = self.foot_radius - self.centre_radius
        lean, length = math.atan2(out, self.height), math.hypot(out, self.height)
        jack = math.hypot(length, self.half_width)
        joints = {"q1": 0.0, "q2": lean, "q3": 0.0, "q4": length, "q5": 0.0, "q6": -lean}
        return joints | {"qL": jack, "qR": jack}

    @property
    def home_pose(self) -> Array:
        """Give the pose of the platform at home: x, y, z, alpha, beta, gamma [m, rad], shape (6,)."""
        return np.array([0.0, 0.0, self.height, 0.0, 0.0, 0.0])

    @property
    def home_feet(self) -> Array:
        """Give the frames of the feet at home: x, y, z, alpha, beta, gamma of each [m, rad], shape (3, 6)."""
        feet = np.zeros((3, 6))
        for i in LEGS:
            turn = self.azimuth(i)
            feet[i - 1, :2] = self.foot_radius * math.cos(turn), self.foot_radius * math.sin(turn)
            feet[i - 1, 5] = turn
        return feet

    def rest_pose(self, feet: ArrayLike) -> Array:
        """Give the pose of the platform that is to feet as at home, as nearly as they let it.

        Args:
            feet: Frames of the feet [m, rad], shape (3, 6).

        Returns:
            Where home goes under the rigid motion that brings the feet at home nearest to the feet, shape (6,).
        """
        there, home = read_feet(feet)[:, :3], self.home_feet[:, :3]
        middle, origin = there.mean(axis=0), home.mean(axis=0)
        U, _, V = np.linalg.svd((home - origin).T @ (there - middle))
        R = V.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(V.T @ U.T))]) @ U.T
        return np.concatenate([middle + R @ (self.home_pose[:3] - origin), read_angles(R)])

    @staticmethod
    def azimuth(leg: int) -> float:
        """Give the direction of a leg about the platform's axis, within half a turn [rad]."""
        check_leg(leg)
        return math.remainder((leg - 1) * 2 * math.pi / 3, 2 * math.pi)


# --- Names of the variables


def check_leg(leg: int) -> None:
    """Refuse a number that is no leg's.

    Raises:
        DefinitionError: It is not 1, 2 or 3.
    """
    if leg not in LEGS:
        raise DefinitionError(f"leg is {leg!r}; the tripod has the legs 1, 2 and 3")


def foot_names(leg: int) -> tuple[str, ...]:
    """Name the six variables of a foot's frame."""
    check_leg(leg)
    return tuple(f"foot {leg} {c}" for c in POSE)


def lock_names(leg: int) -> tuple[str, ...]:
    """Name the joints b_i that are locked while a leg is in the air: q1, q2, q3, q6 of it, q1 of the two others.

    Source: Tripod, 4.1.
    """
    check_leg(leg)
    others = [k for k in LEGS if k != leg]
    return (*(f"{q} {leg}" for q in ("q1", "q2", "q3", "q6")), *(f"q1 {k}" for k in others))


def leg_names(leg: int) -> tuple[str, ...]:
    """Name what the inverse model of a leg gives: q1 ... q6, both actuators, both pivots."""
    check_leg(leg)
    return (*(f"{q} {leg}" for q in CHAIN), *(f"q{s} {leg}" for s in SIDES), *(f"pivot {s} {leg}" for s in SIDES))
