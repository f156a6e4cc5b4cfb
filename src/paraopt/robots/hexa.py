"""The Hexa: six arms that turn, each with one rod that holds the platform; six degrees of freedom.

The machine hangs: the base is above, and z points up. The platform's rotation is `Rx(alpha) Ry(beta) Rz(gamma)`. The
sources print no dimensions: those given here are ours.
"""

from __future__ import annotations

import math

import numpy as np

from paraopt.mechanism import Base, Mechanism, Mobile
from paraopt.robot import Robot
from paraopt.robots.base import Parts, arm_with_rods, as_xyz, drive_limits, ring
from paraopt.shapes import Cylinder
from paraopt.spatial import transform


def hexa(
    base_radius: float = 0.3,
    base_spacing: float = 0.2,
    platform_radius: float = 0.1,
    platform_spacing: float = 0.12,
    arm_length: float = 0.3,
    rod_length: float = 0.6,
    height: float = -0.6,
    radius: float = 0.012,
    spherical_elbow: bool = False,
) -> Robot:
    """Build a Hexa: a Delta whose six rods are pushed each by its own arm.

    The arms come in three pairs, 120 degrees apart; those of a pair turn about one line. `theta<i>` is 0 where arm i
    points outwards, level, and grows downwards. Each arm has two postures, hence 64 working modes; with given arms
    there are up to 40 assembly modes, as for six legs.

    Args:
        base_radius: Distance of the line through the joints of a pair from the axis [m].
        base_spacing: Distance between the two arms of a pair [m].
        platform_radius: Distance of the line through the ends of a pair's rods from the platform's origin [m].
        platform_spacing: Distance between these ends [m].
        arm_length: Length of the arms [m].
        rod_length: Length of the rods [m].
        height: z of the platform at home [m].
        radius: Radius of the arms as solids [m]; that of the rods is half of it.
        spherical_elbow: Whether both ends of the rods are spherical joints: each rod then spins about itself.

    Returns:
        The robot: 24 variables (30 with spherical elbows), 18 closure equations.

    Raises:
        DefinitionError: An arm cannot reach the platform at home.

    Source: Lahouar, I.2; Chablat1998, 3.2.2; PierrotDauchezFournier1991.
    """
    legs = Parts()
    for i in range(1, 7):
        azimuth = 2 * math.pi * ((i - 1) // 2) / 3
        side = -0.5 if i % 2 else 0.5
        out, across = np.array(ring(1.0, (azimuth, azimuth + math.pi / 2)))
        end = platform_radius * out + side * platform_spacing * across
        legs += arm_with_rods(
            f"{i}", "base", as_xyz(base_radius * out + side * base_spacing * across), azimuth, arm_length, "platform",
            {f"{i}": (0.0, end)}, rod_length, (0, 0, height), radius, spherical_elbow,
        )  # fmt: skip
    wide = math.hypot(base_radius, 0.5 * base_spacing) + radius
    narrow = math.hypot(platform_radius, 0.5 * platform_spacing) + radius
    parts = legs + Parts(
        links=(Base(), Mobile("platform")),
        shapes={
            "base": [Cylinder(radius=wide, length=radius, pose=transform((0, 0, 0.5 * radius)))],
            "platform": [Cylinder(radius=narrow, length=radius)],
        },
        masses={"platform": 1.0},
    )
    drives = tuple(f"theta{i}" for i in range(1, 7))
    idle = 6 if spherical_elbow else 0
    return Robot(
        Mechanism("Hexa", parts.links, parts.closures, drives, ("x", "y", "z", "alpha", "beta", "gamma")),
        home={**parts.start, "x": 0.0, "y": 0.0, "z": height, "alpha": 0.0, "beta": 0.0, "gamma": 0.0},
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=5.0, acceleration=50.0, jerk=2000.0),
        masses=parts.masses,
        source="Lahouar, I.2; Chablat1998, 3.2.2 (structure); dimensions, limits, masses, solids and home are ours",
        # printed: the working modes (Chablat1998, 3.2.2); the ranks are computed
        facts={
            "variables": 24 + idle, "equations": 18, "rank E": 18, "rank M": 6, "rank N": 12, "rank K": 6,
            "mobility": 6 + idle, "idle": idle, "working modes": 64,
        },
    )  # fmt: skip
