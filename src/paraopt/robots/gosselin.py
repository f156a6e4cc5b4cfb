"""Gosselin's wrist: a plate turned about a fixed centre by three legs of three revolute joints, all axes concurrent.

The source shows it in a picture and prints no dimension: those here are ours. The rotation of the plate is x-y-z; the
centre is the origin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from paraopt.mechanism import Base, Coincidence, Fixed, Link, Mechanism, Mobile, Revolute, Series
from paraopt.robot import Robot
from paraopt.robots.base import drive_limits
from paraopt.shapes import Capsule, Cylinder, Shape

Point = tuple[float, float, float]


def gosselin_wrist(
    arcs: tuple[float, float] = (math.radians(80), math.radians(80)),
    base_cone: float = math.acos(1 / math.sqrt(3)),
    plate_cone: float = math.acos(1 / math.sqrt(3)),
    radius: float = 0.1,
    velocity: float = 2.0,
    acceleration: float = 10.0,
    jerk: float = 200.0,
) -> Robot:
    """Build Gosselin's spherical wrist.

    Every link only turns about the centre, so the plate is a free link of three angles whose centre is at rest, and
    each leg is closed by the coincidence of its last pivot with that of the plate. Both points are at the same
    distance from the centre, hence three equations of rank 2 a leg. In the description with six coordinates for the
    plate and a revolute joint of rank 5 a leg, the machine would be over-constrained by six: a condition on its
    manufacture, not on its motion. Parallel axes instead of coincident points would also allow opposite axes, and so
    count postures that the machine has not.

    With the default cones the three axes of the base, and those of the plate, are orthogonal. Arcs of 90 degrees would
    make the Agile Eye, which has isotropic postures, but in four of its eight assembly modes the plate stays at rest
    whatever the drives do; with 80 degrees all eight are regular.

    Args:
        arcs: Angles of the proximal and of the distal links between their axes [rad].
        base_cone: Angle between the driven axes and the downward vertical [rad].
        plate_cone: Angle between the plate's axes and the plate's own z [rad].
        radius: Radius of the sphere of the distal links [m].
        velocity: Largest speed of a drive [rad/s].
        acceleration: Largest acceleration of a drive [rad/s^2].
        jerk: Largest jerk of a drive [rad/s^3].

    Returns:
        The robot: 9 variables, 9 closure equations of rank 6, mobility 3.

    Source: Lahouar, I.2; GosselinSefriouiRichard1994; BonevChablatWenger2006.
    """
    proximal, distal = arcs
    outer, inner = 1.3 * radius, 0.75 * radius
    links: list[Link] = [Base()]
    closures: list[Coincidence] = []
    shapes: dict[str, list[Shape]] = {"base": [], "plate": []}
    for i in range(1, 4):
        turn = (i - 1) * 2 * math.pi / 3
        axis = _cone(math.pi - base_cone, turn)
        hold = _cone(plate_cone, turn + math.pi / 3)
        links += [
            Series(f"seat {i}", "base", joint=Fixed(), rotation=(0, 0, turn)),
            # z along the driven axis, which points down and outwards
            Series(f"proximal {i}", f"seat {i}", joint=Revolute(f"q{i}"), rotation=(0, math.pi - base_cone, 0)),
            Series(f"distal {i}", f"proximal {i}", joint=Revolute(f"elbow {i}"), rotation=(proximal, 0, 0)),
        ]
        pivot = _scaled(_arc(distal), radius)
        closures.append(Coincidence(f"distal {i}", pivot, "plate", _scaled(hold, radius)))
        motor = Cylinder.between(_scaled(axis, 1.42 * radius), _scaled(axis, 1.9 * radius), 0.22 * radius)
        shapes["base"].append(motor)
        # the arcs run on two spheres, so that the legs may pass over each other
        elbow = Capsule.between(_scaled(_arc(proximal), outer), _scaled(_arc(proximal), radius), 0.04 * radius)
        shaft = Capsule.between((0, 0, outer), (0, 0, 1.5 * radius), 0.05 * radius)
        shapes[f"proximal {i}"] = [*_solid_arc(proximal, outer, 0.06 * radius), elbow, shaft]
        tip = Capsule.between(pivot, _scaled(_arc(distal), inner), 0.04 * radius)
        shapes[f"distal {i}"] = [*_solid_arc(distal, radius, 0.06 * radius), tip]
        shapes["plate"].append(Capsule.between((0, 0, 0), _scaled(hold, inner), 0.05 * radius))
    shapes["plate"].append(Cylinder.between((0, 0, 0), (0, 0, 0.7 * radius), 0.1 * radius, name="tool"))
    angles = ("alpha", "beta", "gamma")
    links.append(Mobile("plate", coordinates=angles))
    mechanism = Mechanism("Gosselin's wrist", links, closures, active=("q1", "q2", "q3"), operational=angles)
    drives = mechanism.active
    return Robot(
        mechanism,
        home={
            "alpha": 0.0, "beta": 0.0, "gamma": -0.4,
            **dict.fromkeys(mechanism.active, 2.76), **{f"elbow {i}": 1.75 for i in (1, 2, 3)},
        },
        shapes=shapes,
        limits=drive_limits(drives, velocity, acceleration, jerk),
        masses={
            **{f"proximal {i}": 0.25 for i in (1, 2, 3)}, **{f"distal {i}": 0.15 for i in (1, 2, 3)}, "plate": 0.3,
        },
        tool=("plate", (0, 0, radius)),
        source="Lahouar, I.2 (structure); all dimensions, drive limits, masses, solids and home are ours",
        # the modes are the largest numbers of the literature, and are met with these dimensions; the rest is computed
        facts={
            "variables": 9, "equations": 9, "mobility": 3,
            "rank E": 6, "rank M": 3, "rank N": 3, "rank K": 3, "idle": 0, "working modes": 8, "assembly modes": 8,
        },
    )  # fmt: skip


def _cone(angle: float, turn: float) -> Point:
    """Give the direction at an angle from z, turned about z."""
    return (math.sin(angle) * math.cos(turn), math.sin(angle) * math.sin(turn), math.cos(angle))


def _arc(angle: float) -> Point:
    """Give the direction that a turn about x makes of z."""
    return (0.0, -math.sin(angle), math.cos(angle))


def _scaled(direction: Sequence[float], length: float) -> Point:
    x, y, z = (length * c for c in direction)
    return (x, y, z)


def _solid_arc(angle: float, radius: float, thickness: float, pieces: int = 4) -> list[Shape]:
    """Fill an arc about x, from z on, by chords."""
    points = [_scaled(_arc(a), radius) for a in np.linspace(0.0, angle, pieces + 1)]
    return [Capsule.between(p, q, thickness) for p, q in pairwise(points)]
