"""The 2-delta: one Delta places the end effector, a second one turns it; six degrees of freedom.

The machine hangs: the base is above, and z points up. The end effector's rotation is `Rx(alpha) Ry(beta) Rz(gamma)`.
The source says no more than that the first Delta places, that the second one orients, and that position and orientation
are decoupled. How the second one is linked to the end effector, and all dimensions, are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from paraopt.mechanism import Base, Closure, Coincidence, Link, Mechanism, Mobile, Series, Universal
from paraopt.robot import Robot
from paraopt.robots.base import Parts, Point, as_xyz, delta_legs, drive_limits, ring
from paraopt.shapes import Capsule, Cylinder, Shape
from paraopt.spatial import transform

_THIRDS = tuple(2 * math.pi * k / 3 for k in range(3))


def two_delta(
    inner: tuple[float, float, float, float, float] = (0.15, 0.05, 0.25, 0.5, 0.06),
    outer: tuple[float, float, float, float, float] = (0.35, 0.17, 0.35, 0.7, 0.14),
    neck: float = 0.2,
    lever: float = 0.12,
    tie_rise: float = 0.1,
    tie_turn: float = 0.09,
    height: float = -0.7,
    radius: float = 0.01,
) -> Robot:
    """Build a 2-delta.

    The inner Delta moves a carrier; the end effector hangs from the carrier's neck on a ball joint, whose centre is the
    origin of its coordinates: the inner arms alone place it. The outer Delta moves a ring about the neck; three ties,
    rods of constant length, run from the ring down to the end effector, askew: the motion of the ring relative to the
    carrier turns the end effector, sideways motions into roll and pitch, vertical ones into yaw.

    Args:
        inner: Radius of base and of platform, length of arms and of rods, distance between the rods of a parallelogram
            [m], of the Delta that places.
        outer: The same of the Delta that turns.
        neck: Distance from the carrier down to the ball joint [m].
        lever: Distance of the ties from the ball joint [m].
        tie_rise: Height of the ring above the ball joint at home [m].
        tie_turn: How far each tie leans sideways at home [m].
        height: z of the ball joint at home [m].
        radius: Radius of the arms as solids [m].

    Returns:
        The robot: 54 variables, 48 closure equations.

    Raises:
        DefinitionError: The arms cannot reach the carrier or the ring at home.

    Source: Lahouar, I.2.
    """
    parts = Parts(links=(Base(), Mobile("carrier", prefix="carrier."), Mobile("ring", prefix="ring."), Mobile("tool")))
    ring_z = height + tie_rise
    for stage, sizes, platform, z, azimuth in (
        ("a", inner, "carrier", height + neck, 0.0),
        ("b", outer, "ring", ring_z, math.pi / 3),
    ):
        R1, R2, L1, L2, spacing = sizes
        parts += delta_legs("base", platform, R1, R2, L1, L2, spacing, (0, 0, z), radius, stage, azimuth)
    corners = [as_xyz(c.point_B) for c in parts.closures if isinstance(c, Coincidence) and c.link_B == "ring"]
    ends = ring(lever, _THIRDS)
    across = np.array(ring(1.0, [a + math.pi / 2 for a in _THIRDS]))
    holds = [as_xyz(e) for e in np.array(ends) + tie_turn * across]
    length = math.hypot(tie_rise, tie_turn)
    links: list[Link] = []
    closures: list[Closure] = [Coincidence("carrier", (0, 0, -neck), "tool", (0, 0, 0))]
    for i, (hold, end) in enumerate(zip(holds, ends, strict=True), start=1):
        links.append(Series(f"tie {i}", "ring", hold, Universal(f"tie {i}", ("x", "y"))))
        closures.append(Coincidence(f"tie {i}", (0, 0, -length), "tool", end))
        way = (np.array(hold) + np.array((0, 0, tie_rise)) - np.array(end)) / length  # against the rod
        parts += Parts(
            shapes={f"tie {i}": [Capsule.between((0, 0, 0), (0, 0, -length), 0.4 * radius)]},
            start={f"tie {i}.x": math.atan2(-way[1], way[2]), f"tie {i}.y": math.asin(way[0])},
        )
    corners += holds
    wide = max(inner[0], outer[0]) + radius
    parts += Parts(
        tuple(links),
        tuple(closures),
        shapes={
            "base": [Cylinder(radius=wide, length=radius, pose=transform((0, 0, 0.5 * radius)))],
            "carrier": [
                Cylinder(radius=inner[1] + radius, length=radius, name="carrier"),
                Capsule.between((0, 0, 0), (0, 0, -neck), 0.8 * radius, name="neck"),
            ],
            "ring": _ring_solids(corners, radius),
            "tool": [
                Cylinder(radius=lever + 0.5 * radius, length=0.5 * radius, name="tool plate"),
                Capsule.between((0, 0, 0), (0, 0, -0.1), 0.8 * radius, name="tool"),
            ],
        },
        masses={"carrier": 0.5, "ring": 0.5, "tool": 0.5},
        start={"carrier.z": height + neck, "ring.z": ring_z},
    )
    drives = tuple(f"theta {stage}{i}" for stage in "ab" for i in (1, 2, 3))
    return Robot(
        Mechanism("2-delta", parts.links, parts.closures, drives, ("x", "y", "z", "alpha", "beta", "gamma")),
        home={**parts.start, "x": 0.0, "y": 0.0, "z": height, "alpha": 0.0, "beta": 0.0, "gamma": 0.0},
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=3.0, acceleration=30.0, jerk=1000.0),
        masses=parts.masses,
        tool=("tool", (0.0, 0.0, -0.1)),
        source="Lahouar, I.2 (one Delta places, one orients); ties, dimensions, limits, masses and solids are ours",
        # computed: nothing but the six degrees of freedom is printed
        facts={
            "variables": 54, "equations": 48, "rank E": 48, "rank M": 6, "rank N": 42, "rank K": 6,
            "mobility": 6, "idle": 0,
        },
    )  # fmt: skip


def _ring_solids(corners: Sequence[Point], radius: float) -> list[Shape]:
    """Give the bars of a closed polygon about z through points in its plane, whatever their order."""
    ordered = sorted(corners, key=lambda p: math.atan2(p[1], p[0]))
    pairs = zip(ordered, [*ordered[1:], ordered[0]], strict=True)
    return [Capsule.between(p, q, 0.8 * radius, name=f"ring {k}") for k, (p, q) in enumerate(pairs, start=1)]
