"""Hayward's wrist: a plate on a ball joint, turned by four linear actuators, one more than it has motions.

The source shows it in a picture and prints no dimension: those here are ours. The rotation of the plate is x-y-z.
"""

from __future__ import annotations

import math

from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Prismatic, Series, Spherical, Universal
from paraopt.robot import Robot
from paraopt.robots.base import drive_limits
from paraopt.shapes import Capsule, Cylinder, Shape, Sphere
from paraopt.spatial import transform


def hayward_wrist(
    height: float = 0.2,
    base_radius: float = 0.1,
    plate_radius: float = 0.08,
    twist: float = 0.6,
    tilt: float = 0.8,
    velocity: float = 0.2,
    acceleration: float = 2.0,
    jerk: float = 50.0,
) -> Robot:
    """Build Hayward's wrist.

    Four actuators stand between the ground and the plate at quarters of a turn. Their feet are turned about the
    vertical by `twist`, alternately to one side and to the other, so that opposite actuators turn the plate about the
    same vertical direction and neighbours about opposite ones. Pulling all four alike presses the plate on its ball
    and moves nothing: that is the use of the fourth.

    Args:
        height: Height of the ball's centre above the ground [m].
        base_radius: Radius of the circle of the actuators' feet [m].
        plate_radius: Radius of the circle of the actuators' ends on the plate [m].
        twist: Angle by which each foot is turned away from its end on the plate [rad]; not zero, else nothing
            holds the turn about the vertical.
        tilt: Largest value of each of the plate's angles [rad].
        velocity: Largest speed of an actuator [m/s].
        acceleration: Largest acceleration of an actuator [m/s^2].
        jerk: Largest jerk of an actuator [m/s^3].

    Returns:
        The robot: 15 variables, 12 closure equations of rank 12, mobility 3, 4 actuators.

    Source: Lahouar, I.2.
    """
    angles = ("alpha", "beta", "gamma")
    links: list[Link] = [
        Base(),
        Series("plate", "base", (0, 0, height), Spherical(angles, ranges=((-tilt, tilt),) * 3)),
    ]
    closures: list[Coincidence] = []
    shapes: dict[str, list[Shape]] = {
        "base": [
            Cylinder(radius=1.15 * base_radius, length=0.01, pose=transform((0, 0, -0.012)), name="ground"),
            Cylinder.between((0, 0, -0.015), (0, 0, height - 0.005), radius=0.008, name="post"),
            Sphere(radius=0.012, pose=transform((0, 0, height)), name="ball"),
        ],
        "plate": [
            Cylinder(radius=1.1 * plate_radius, length=0.008, pose=transform((0, 0, 0.004)), name="plate"),
        ],
    }
    reach = math.sqrt(
        height**2 + base_radius**2 + plate_radius**2 - 2 * base_radius * plate_radius * math.cos(twist)
    )  # fmt: skip
    lengths = (0.7 * reach, 1.19 * reach)
    body = 0.9 * lengths[0]
    rod = lengths[1] - 0.9 * body  # at the longest a tenth of the body still holds it
    for i in range(1, 5):
        quarter = (i - 1) * math.pi / 2
        turn = quarter + (twist if i % 2 else -twist)
        foot = (base_radius * math.cos(turn), base_radius * math.sin(turn), 0.0)
        end = (plate_radius * math.cos(quarter), plate_radius * math.sin(quarter), 0.0)
        stroke = Prismatic(f"q{i}", axis="z", range=lengths)
        links.append(Series(f"cylinder {i}", "base", foot, Universal(f"cylinder {i}", axes=("x", "y"))))
        links.append(Series(f"rod {i}", f"cylinder {i}", joint=stroke))
        closures.append(Coincidence(f"rod {i}", (0, 0, 0), "plate", end))
        shapes[f"cylinder {i}"] = [Capsule.between((0, 0, 0), (0, 0, body), radius=0.008)]
        shapes[f"rod {i}"] = [Capsule.between((0, 0, -rod), (0, 0, 0), radius=0.004)]
    mechanism = Mechanism(
        "Hayward's wrist", links, closures, active=tuple(f"q{i}" for i in range(1, 5)), operational=angles
    )
    actuators = mechanism.active
    return Robot(
        mechanism,
        home={**dict.fromkeys(angles, 0.0), **dict.fromkeys(actuators, reach)},
        shapes=shapes,
        limits=drive_limits(actuators, velocity, acceleration, jerk),
        masses={
            "plate": 0.4, **{f"cylinder {i}": 0.2 for i in range(1, 5)}, **{f"rod {i}": 0.08 for i in range(1, 5)},
        },
        tool=("plate", (0, 0, 0.05)),
        source="Lahouar, I.2 (structure); all dimensions, ranges, drive limits, masses and solids are ours",
        # computed; only the number of actuators and the three rotations are in the source
        facts={
            "variables": 15, "equations": 12, "mobility": 3,
            "rank E": 12, "rank M": 4, "rank N": 8, "rank K": 3, "idle": 0,
        },
    )  # fmt: skip
