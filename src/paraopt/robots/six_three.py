"""The 6-3 platform: six legs that stretch and meet two by two at three points of the platform.

The platform's rotation is `Rx(alpha) Ry(beta) Rz(gamma)`. The source prints no dimensions: those given here are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from paraopt.mechanism import Base, Mechanism, Mobile
from paraopt.robot import Robot
from paraopt.robots.base import Parts, Point, check_count, drive_limits, paired_azimuths, ring, six_legs
from paraopt.shapes import Cylinder
from paraopt.spatial import transform

_PAIRS = paired_azimuths(math.radians(12))
BASE_POINTS = ring(0.5, [*_PAIRS[1:], _PAIRS[0] + 2 * math.pi])
PLATFORM_POINTS = ring(0.3, [math.pi / 3, math.pi, 5 * math.pi / 3])


def six_three(
    base_points: Sequence[Point] = BASE_POINTS,
    platform_points: Sequence[Point] = PLATFORM_POINTS,
    height: float = 0.6,
    stroke: float = 0.25,
    radius: float = 0.02,
    spherical_base: bool = False,
) -> Robot:
    """Build a 6-3 platform: legs 1 and 2, 3 and 4, 5 and 6 hold one point of the platform each.

    With the lengths of its legs given, the platform is held like one of a 3-RPS: each point moves on a circle about the
    line between the feet of its two legs. There are up to 16 assembly modes.

    Args:
        base_points: Feet of the legs on the base [m], shape (6, 3).
        platform_points: Points of the platform [m], shape (3, 3).
        height: Height of the platform's origin at home [m].
        stroke: How much a leg stretches beyond and shrinks below its length at home, as a share of it [1].
        radius: Radius of the legs' bodies [m].
        spherical_base: Whether the feet are spherical joints: each leg then spins about itself.

    Returns:
        The robot: 24 variables (30 with spherical feet), 18 closure equations.

    Raises:
        DefinitionError: There are not six and three points, or the stroke is too long for the legs.

    Source: Lahouar, I.2.
    """
    check_count("platform points", platform_points, 3)
    doubled = [p for p in platform_points for _ in (1, 2)]
    legs = six_legs("base", base_points, "platform", doubled, height, stroke, radius, "", spherical_base)
    wide = max(math.hypot(p[0], p[1]) for p in base_points) + 2 * radius
    narrow = max(math.hypot(p[0], p[1]) for p in platform_points) + radius
    parts = legs + Parts(
        links=(Base(), Mobile("platform")),
        shapes={
            "base": [Cylinder(radius=wide, length=radius, pose=transform((0, 0, -0.5 * radius)))],
            "platform": [Cylinder(radius=narrow, length=radius)],
        },
        masses={"platform": 5.0},
    )
    drives = tuple(f"q{i}" for i in range(1, 7))
    idle = 6 if spherical_base else 0
    return Robot(
        Mechanism("6-3 platform", parts.links, parts.closures, drives, ("x", "y", "z", "alpha", "beta", "gamma")),
        home={**parts.start, "x": 0.0, "y": 0.0, "z": height, "alpha": 0.0, "beta": 0.0, "gamma": 0.0},
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=0.3, acceleration=2.0, jerk=40.0),
        masses=parts.masses,
        contacts={(f"rod {i}", f"rod {i + 1}"): "both end in one joint of the platform" for i in (1, 3, 5)},
        source="Lahouar, I.2 (structure); points, strokes, drive limits, masses and solids are ours",
        # computed: nothing is printed
        facts={
            "variables": 24 + idle, "equations": 18, "rank E": 18, "rank M": 6, "rank N": 12, "rank K": 6,
            "mobility": 6 + idle, "idle": idle,
        },
    )  # fmt: skip
