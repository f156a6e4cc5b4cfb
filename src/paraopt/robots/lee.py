"""The manipulator of Lee: three legs hinged at the base, stretching, with ball joints at the platform (3-RPS).

Its platform has one translation, along z, and two rotations, alpha and beta; x, y and gamma follow from them. The
platform's rotation is `Rx(alpha) Ry(beta) Rz(gamma)`. The source prints no dimensions: those given here are ours.
"""

from __future__ import annotations

import math

from paraopt.mechanism import Base, Closure, Coincidence, Link, Mechanism, Mobile, Prismatic, Revolute, Series
from paraopt.robot import Robot
from paraopt.robots.base import Parts, drive_limits, ring, telescope
from paraopt.shapes import Cylinder
from paraopt.spatial import transform

_THIRDS = tuple(2 * math.pi * k / 3 for k in range(3))


def lee(
    base_radius: float = 0.35,
    platform_radius: float = 0.2,
    height: float = 0.5,
    stroke: float = 0.25,
    radius: float = 0.015,
) -> Robot:
    """Build Lee's manipulator.

    The axis of each hinge is horizontal and across the radius, so that leg i moves in the vertical plane at azimuth
    2 pi (i - 1) / 3, and its end with it: three conditions, from which `tan gamma = -sin alpha sin beta / (cos alpha +
    cos beta)`, `x = r (R11 - R22) / 2` and `y = -r R21` follow, r being the platform's radius.

    Args:
        base_radius: Distance of the hinges from the axis [m].
        platform_radius: Distance of the ball joints from the platform's origin [m].
        height: z of the platform at home [m].
        stroke: How much a leg stretches beyond and shrinks below its length at home, as a share of it [1].
        radius: Radius of the legs' bodies [m].

    Returns:
        The robot: 12 variables, 9 closure equations.

    Raises:
        DefinitionError: The stroke is too long for the legs.

    Source: Lahouar, I.2; LeeShah1988.
    """
    links: list[Link] = [Base(), Mobile("platform")]
    closures: list[Closure] = []
    parts = Parts(
        shapes={
            "base": [Cylinder(radius=base_radius + 2 * radius, length=radius, pose=transform((0, 0, -0.5 * radius)))],
            "platform": [Cylinder(radius=platform_radius + radius, length=radius)],
        },
        masses={"platform": 3.0},
    )
    feet, ends = ring(base_radius, _THIRDS), ring(platform_radius, _THIRDS)
    length = math.hypot(base_radius - platform_radius, height)
    lengths = ((1 - stroke) * length, (1 + stroke) * length)
    for i, (foot, end, azimuth) in enumerate(zip(feet, ends, _THIRDS, strict=True), start=1):
        hinge = Revolute(f"leg {i}", axis="y")
        links.append(Series(f"leg {i}", "base", foot, hinge, rotation=(0, 0, azimuth)))
        links.append(Series(f"rod {i}", f"leg {i}", joint=Prismatic(f"q{i}", axis="z", range=lengths)))
        closures.append(Coincidence(f"rod {i}", (0, 0, 0), "platform", end))
        start = {f"leg {i}": math.atan2(platform_radius - base_radius, height), f"q{i}": length}
        parts += telescope(str(i), lengths, radius) + Parts(start=start)
    drives = ("q1", "q2", "q3")
    return Robot(
        Mechanism("Lee's manipulator", links, closures, drives, ("z", "alpha", "beta")),
        home={**parts.start, "z": height, "alpha": 0.0, "beta": 0.0},
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=0.3, acceleration=2.0, jerk=40.0),
        masses=parts.masses,
        source="Lahouar, I.2 (one translation, roll and pitch); dimensions, strokes, limits, masses, solids are ours",
        # computed: nothing but the freedoms is printed
        facts={
            "variables": 12, "equations": 9, "rank E": 9, "rank M": 3, "rank N": 6, "rank K": 3,
            "mobility": 3, "idle": 0,
        },
    )  # fmt: skip
