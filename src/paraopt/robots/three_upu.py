"""The 3-UPU: three legs that stretch, each between two universal joints, whose platform only translates.

The platform's rotation is `Rx(alpha) Ry(beta) Rz(gamma)`. The source prints no dimensions: those given here are ours.
"""

from __future__ import annotations

import math

from paraopt.mechanism import Base, ClosingUniversal, Closure, Link, Mechanism, Mobile, Prismatic, Series, Universal
from paraopt.robot import Robot
from paraopt.robots.base import Parts, drive_limits, ring, telescope
from paraopt.shapes import Cylinder
from paraopt.spatial import transform

_THIRDS = tuple(2 * math.pi * k / 3 for k in range(3))


def three_upu(
    base_radius: float = 0.4,
    platform_radius: float = 0.1,
    height: float = 0.4,
    stroke: float = 0.25,
    radius: float = 0.015,
) -> Robot:
    """Build a translational 3-UPU.

    In every leg the axes fixed to base and platform are horizontal, across the radius, and the two axes fixed to the
    leg are parallel to each other. While the platform is parallel to the base each leg withstands turning about one
    direction only, normal to both axes of a universal joint. The platform keeps its orientation while these three
    directions are independent. At home each is the direction of its leg: with legs that lean by the angle psi,
    `tan psi = (base_radius - platform_radius) / height`, their determinant is proportional to `sin^2 psi cos psi`.
    Upright legs, as under a platform of the base's size, and legs in the plane of the base let the platform turn: a
    singularity of the constraints. The dimensions here keep well away from both.

    Args:
        base_radius: Distance of the lower universal joints from the axis [m].
        platform_radius: Distance of the upper ones from the platform's origin [m].
        height: z of the platform at home [m].
        stroke: How much a leg stretches beyond and shrinks below its length at home, as a share of it [1].
        radius: Radius of the legs' bodies [m].

    Returns:
        The robot: 15 variables, 12 closure equations.

    Raises:
        DefinitionError: The stroke is too long for the legs.

    Source: Lahouar, I.2; Tsai1996.
    """
    links: list[Link] = [Base(), Mobile("platform")]
    closures: list[Closure] = []
    parts = Parts(
        shapes={
            "base": [Cylinder(radius=base_radius + 2 * radius, length=radius, pose=transform((0, 0, -0.5 * radius)))],
            "platform": [Cylinder(radius=platform_radius + radius, length=radius)],
        },
        masses={"platform": 2.0},
    )
    feet, ends = ring(base_radius, _THIRDS), ring(platform_radius, _THIRDS)
    length = math.hypot(base_radius - platform_radius, height)
    lengths = ((1 - stroke) * length, (1 + stroke) * length)
    for i, (foot, end, azimuth) in enumerate(zip(feet, ends, _THIRDS, strict=True), start=1):
        cross = Universal(f"leg {i}", ("y", "x"))
        links.append(Series(f"leg {i}", "base", foot, cross, rotation=(0, 0, azimuth)))
        links.append(Series(f"rod {i}", f"leg {i}", joint=Prismatic(f"q{i}", axis="z", range=lengths)))
        across = (-math.sin(azimuth), math.cos(azimuth), 0.0)
        closures.append(ClosingUniversal(f"rod {i}", (0, 0, 0), "x", "platform", end, across))
        start = {f"leg {i}.y": math.atan2(platform_radius - base_radius, height), f"q{i}": length}
        parts += telescope(str(i), lengths, radius) + Parts(start=start)
    drives = ("q1", "q2", "q3")
    return Robot(
        Mechanism("3-UPU", links, closures, drives, ("x", "y", "z")),
        home={**parts.start, "x": 0.0, "y": 0.0, "z": height},
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=0.3, acceleration=2.0, jerk=40.0),
        masses=parts.masses,
        source="Lahouar, I.2 (structure, only translations); dimensions, strokes, limits, masses, solids are ours",
        # computed: nothing but the freedoms is printed
        facts={
            "variables": 15, "equations": 12, "rank E": 12, "rank M": 3, "rank N": 9, "rank K": 3,
            "mobility": 3, "idle": 0,
        },
    )  # fmt: skip
