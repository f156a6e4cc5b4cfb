"""The Delta: three arms that turn, each with a parallelogram of two rods that keeps the platform parallel to the base.

The machine hangs: the base is above, and z points up. Lengths are those of Chablat, without unit there and called
metres here; the distance between the rods of a parallelogram, the direction of z and the solids are ours. The
platform's rotation is `Rx(alpha) Ry(beta) Rz(gamma)`.
"""

from __future__ import annotations

from paraopt.mechanism import Base, Mechanism, Mobile
from paraopt.robot import Robot
from paraopt.robots.base import Parts, delta_legs, drive_limits
from paraopt.shapes import Cylinder
from paraopt.spatial import transform


def delta(
    base_radius: float = 1.8,
    platform_radius: float = 0.3,
    arm_length: float = 2.4,
    rod_length: float = 2.8,
    spacing: float = 0.3,
    height: float = -3.5,
    radius: float = 0.06,
    spherical_elbow: bool = False,
) -> Robot:
    """Build a Delta with real parallelograms: six rods, two from each arm, all of one length.

    The six rods hold the platform's three rotations, which stay zero while the parallelograms do not flatten; nothing
    locks them besides. So the machine is neither over-constrained, nor blind to the singularities in which the
    platform begins to turn. `theta<i>` is 0 where arm i points outwards, level, and grows downwards.

    With the rotations at zero there are 8 working modes, two postures of each arm, and 2 assembly modes. A parallel
    singularity of the translations is where the points `B_i - R2 e_i` (elbows, shifted by the platform's radius towards
    the axis) and the platform's origin P lie in one plane; the source prints the elbows themselves, which holds for
    R2 = 0 only.

    Args:
        base_radius: Distance R1 of the arms' joints from the axis.
        platform_radius: Distance R2 of the rods' ends from the platform's origin.
        arm_length: Length L1 of the arms.
        rod_length: Length L2 of the rods.
        spacing: Distance between the two rods of a parallelogram.
        height: z of the platform at home.
        radius: Radius of the arms as solids; that of the rods is half of it.
        spherical_elbow: Whether both ends of the rods are spherical joints: each rod then spins about itself.

    Returns:
        The robot: 21 variables (27 with spherical elbows), 18 closure equations.

    Raises:
        DefinitionError: The arms cannot reach the platform at home.

    Source: Chablat1998, 3.4.7; Lahouar, I.2; Clavel1988.
    """
    legs = delta_legs(
        "base", "platform", base_radius, platform_radius, arm_length, rod_length, spacing, (0, 0, height), radius,
        spherical_elbow=spherical_elbow,
    )  # fmt: skip
    parts = legs + Parts(
        links=(Base(), Mobile("platform")),
        shapes={
            "base": [Cylinder(radius=base_radius, length=radius, pose=transform((0, 0, 0.5 * radius)))],
            "platform": [Cylinder(radius=platform_radius + radius, length=radius)],
        },
        masses={"platform": 1.0},
    )
    drives = ("theta1", "theta2", "theta3")
    idle = 6 if spherical_elbow else 0
    return Robot(
        Mechanism("Delta", parts.links, parts.closures, drives, ("x", "y", "z")),
        home={**parts.start, "x": 0.0, "y": 0.0, "z": height},
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=3.0, acceleration=30.0, jerk=1000.0),
        masses=parts.masses,
        source="Chablat1998, 3.4.7 (R1, R2, L1, L2); spacing of the rods, limits, masses, solids and home are ours",
        # printed: the modes; the ranks are computed
        facts={
            "variables": 21 + idle, "equations": 18, "rank E": 18, "rank M": 3, "rank N": 15, "rank K": 3,
            "mobility": 3 + idle, "idle": idle, "working modes": 8, "assembly modes": 2,
        },
    )  # fmt: skip
