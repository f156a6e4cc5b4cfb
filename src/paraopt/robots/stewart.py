"""The platform of Gough and Stewart, 6-6: six legs that stretch between a base and a platform.

The platform's rotation is `Rx(alpha) Ry(beta) Rz(gamma)`. The source prints no dimensions: those given here are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from paraopt.mechanism import Base, Mechanism, Mobile
from paraopt.robot import Robot
from paraopt.robots.base import Parts, Point, drive_limits, paired_azimuths, ring, six_legs
from paraopt.shapes import Cylinder
from paraopt.spatial import transform

HALF_ANGLE = math.radians(12)
_PAIRS = paired_azimuths(HALF_ANGLE)
# leg by leg round the machine: neighbours in a pair below part to different pairs above
BASE_POINTS = ring(0.5, [*_PAIRS[1:], _PAIRS[0] + 2 * math.pi])
PLATFORM_POINTS = ring(0.3, paired_azimuths(HALF_ANGLE, middle=math.pi / 3))


def stewart(
    base_points: Sequence[Point] = BASE_POINTS,
    platform_points: Sequence[Point] = PLATFORM_POINTS,
    height: float = 0.6,
    stroke: float = 0.25,
    radius: float = 0.02,
    spherical_base: bool = False,
) -> Robot:
    """Build a Gough-Stewart platform; a semi-regular one by default.

    A platform whose points are a scaled copy of those of the base is singular at every pose when these lie in a plane
    and on a conic, such as a circle. There are up to 40 assembly modes for general points.

    Args:
        base_points: Feet of the legs on the base [m], shape (6, 3).
        platform_points: Ends of the legs on the platform [m], shape (6, 3).
        height: Height of the platform's origin at home [m].
        stroke: How much a leg stretches beyond and shrinks below its length at home, as a share of it [1].
        radius: Radius of the legs' bodies [m].
        spherical_base: Whether the feet are spherical joints: each leg then spins about itself.

    Returns:
        The robot: 24 variables (30 with spherical feet), 18 closure equations.

    Raises:
        DefinitionError: There are not six points, or the stroke is too long for the legs.

    Source: Lahouar, II.3; Lahouar, annex B; Stewart1965; GoughWhitehall1962.
    """
    legs = six_legs("base", base_points, "platform", platform_points, height, stroke, radius, "", spherical_base)
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
        Mechanism("Stewart", parts.links, parts.closures, drives, ("x", "y", "z", "alpha", "beta", "gamma")),
        home={**parts.start, "x": 0.0, "y": 0.0, "z": height, "alpha": 0.0, "beta": 0.0, "gamma": 0.0},
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=0.3, acceleration=2.0, jerk=40.0),
        masses=parts.masses,
        source="Lahouar, II.3 and annex B (structure); points, strokes, drive limits, masses and solids are ours",
        # printed: sizes of F and of M, N, K; the ranks are computed
        facts={
            "variables": 24 + idle, "equations": 18, "rank E": 18, "rank M": 6, "rank N": 12, "rank K": 6,
            "mobility": 6 + idle, "idle": idle,
        },
    )  # fmt: skip
