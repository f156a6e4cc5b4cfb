"""The cable robot of LARM in the plane and in space: four cables hold a platform at two points.

Each cable is a leg of variable length, whose links carry no solids: the robot's cables stand for them, which follow the
exits and the platform. The source prints no dimension: those here are ours.
"""

from __future__ import annotations

import math
from dataclasses import replace

from paraopt.mechanism import (
    Base,
    Coincidence,
    Equilibrium,
    Link,
    Mechanism,
    Mobile,
    Prismatic,
    Revolute,
    Series,
    Tension,
    Universal,
)
from paraopt.mechanism.balance import GRAVITY
from paraopt.robot import Limits, Robot
from paraopt.shapes import Box, Cable, Capsule, Cylinder, Shape, Sphere
from paraopt.spatial import transform

CABLES = ("q1", "q2", "q3", "q4")
TENSIONS = ("t1", "t2", "t3", "t4")


def larm_planar(
    side: float = 1.0,
    half_width: float = 0.1,
    velocity: float = 0.5,
    acceleration: float = 2.0,
    jerk: float = 50.0,
) -> Robot:
    """Build the cable robot in the plane, where four cables hold three motions: fully constrained.

    The exits stand at the corners of a square of side L. The platform's point at -h is held from the two corners of the
    side x = 0, its point at +h from the two of the side x = L: so do the source's bounds on the rotation read, by which
    the line through both points leaves the square between the exits on each side.

    Args:
        side: Side L of the square of the exits [m].
        half_width: Distance h of the attachment points from the platform's origin [m].
        velocity: Largest speed of a cable [m/s].
        acceleration: Largest acceleration of a cable [m/s^2].
        jerk: Largest jerk of a cable [m/s^3].

    Returns:
        The robot: 11 variables, 8 closure equations of rank 8, mobility 3, 4 actuators.

    Source: Lahouar, I.2; Lahouar, IV.1-IV.6.
    """
    links: list[Link] = [Base()]
    closures: list[Coincidence] = []
    home = {"x": 0.5 * side, "y": 0.5 * side, "theta": 0.0}
    for cable, exit_, sign in _cables(side):
        links.append(Series(f"pulley {cable}", "base", exit_[:2], Revolute(f"pulley {cable}")))
        links.append(Series(f"cable {cable}", f"pulley {cable}", joint=_cable(cable, side, "x")))
        closures.append(Coincidence(f"cable {cable}", (0, 0), "platform", (sign * half_width, 0)))
        dx, dy = home["x"] + sign * half_width - exit_[0], home["y"] - exit_[1]
        home |= {cable: math.hypot(dx, dy), f"pulley {cable}": math.atan2(dy, dx)}
    links.append(Mobile("platform"))
    mechanism = Mechanism("LARM, planar", links, closures, CABLES, ("x", "y", "theta"), planar=True)
    return Robot(
        mechanism,
        home=home,
        shapes={
            "base": _frame(side),
            "platform": [
                Box(size=(1.1 * half_width, 0.08 * side, 0.03 * side), name="platform"),
                Capsule.between((-half_width, 0, 0), (half_width, 0, 0), 0.009 * side, name="platform bar"),
            ],
        },
        limits=_limits(velocity, acceleration, jerk, {"x": (half_width, side - half_width), "y": (0.0, side)}),
        masses={"platform": 1.0},
        cables=_list_cables(side, half_width),
        source="Lahouar, IV.2 (structure); all dimensions, drive limits, masses, solids, cables and home are ours",
        # computed; four cables and three motions are the source's
        facts={
            "variables": 11, "equations": 8, "mobility": 3,
            "rank E": 8, "rank M": 4, "rank N": 4, "rank K": 3, "idle": 0,
        },
    )  # fmt: skip


def larm_spatial(
    side: float = 1.0,
    half_width: float = 0.1,
    drop: float = 0.05,
    velocity: float = 0.5,
    acceleration: float = 2.0,
    jerk: float = 50.0,
) -> Robot:
    """Build the cable robot in space, where the platform hangs from a horizontal square: under-constrained.

    The platform has six motions and four cables, so two remain that only its weight decides, and at every pose some
    motion needs no cable: the parallel margin is zero everywhere. One of the two is the turn about the line through the
    attachment points, which no cable feels. The platform's rotation is z-y-x, `Rz(gamma) Ry(beta) Rx(alpha)`, so that
    alpha alone is that turn: it is idle and passive. The operational variables are the five others, position, heading
    gamma and tilt beta; with alpha among them, II.23 could not hold. The source's theta is gamma.

    Args:
        side: Side L of the square of the exits, in the plane z = 0 [m].
        half_width: Distance h of the attachment points from the platform's origin [m].
        drop: Distance of the platform's centre of mass below the line of the attachment points [m].
        velocity: Largest speed of a cable [m/s].
        acceleration: Largest acceleration of a cable [m/s^2].
        jerk: Largest jerk of a cable [m/s^3].

    Returns:
        The robot: 18 variables, 12 closure equations of rank 12, mobility 6 of which one is idle, 4 actuators.

    Source: Lahouar, I.2; Lahouar, IV.1-IV.6.
    """
    links: list[Link] = [Base()]
    closures: list[Coincidence] = []
    home = {"x": 0.5 * side, "y": 0.5 * side, "z": -0.5 * side, "gamma": 0.0, "beta": 0.0}
    for cable, exit_, sign in _cables(side):
        # half a turn about x, so that the length counts downwards
        swing = Universal(f"pulley {cable}", axes=("x", "y"))
        links.append(Series(f"pulley {cable}", "base", exit_, swing, rotation=(math.pi, 0, 0)))
        links.append(Series(f"cable {cable}", f"pulley {cable}", joint=_cable(cable, side, "z")))
        closures.append(Coincidence(f"cable {cable}", (0, 0, 0), "platform", (sign * half_width, 0, 0)))
        home[cable] = math.dist(exit_, (home["x"] + sign * half_width, home["y"], home["z"]))
    ranges = {"x": (half_width, side - half_width), "y": (0.0, side), "z": (-side, -0.02 * side)}
    links.append(Mobile("platform", order="zyx"))
    operational = ("x", "y", "z", "gamma", "beta")
    mechanism = Mechanism("LARM, spatial", links, closures, CABLES, operational)
    # with the mass on the line of the attachment points there is nothing between them
    post = [Cylinder.between((0, 0, -drop), (0, 0, 0), 0.008 * side, name="platform post")] if drop else []
    return Robot(
        mechanism,
        home=home,
        shapes={
            "base": _frame(side),
            "platform": [
                Box(
                    size=(1.2 * half_width, 0.1 * side, 0.04 * side), pose=transform((0, 0, -drop)), name="platform"
                ),
                Capsule.between((-half_width, 0, 0), (half_width, 0, 0), 0.009 * side, name="platform bar"),
                *post,
            ],
        },
        limits=_limits(velocity, acceleration, jerk, ranges),
        masses={"platform": 1.0},
        tool=("platform", (0, 0, -drop)),
        cables=_list_cables(side, half_width),
        source="Lahouar, IV.2 (structure); all dimensions, drive limits, masses, solids, cables and home are ours",
        # computed; "under-constrained" is the source's
        facts={
            "variables": 18, "equations": 12, "mobility": 6,
            "rank E": 12, "rank M": 4, "rank N": 8, "rank K": 5, "idle": 1,
        },
    )  # fmt: skip


def larm_hanging(
    side: float = 1.0,
    half_width: float = 0.1,
    drop: float = 0.05,
    mass: float = 1.0,
    tension: tuple[float, float] = (0.1, 60.0),
    velocity: float = 0.5,
    acceleration: float = 2.0,
    jerk: float = 50.0,
) -> Robot:
    """Build the cable robot in space with its weight: four lengths, and where the platform comes to rest.

    The machine is that of `larm_spatial`. Static balance adds six equations and four tensions t1 ... t4, so that the
    mobility is four, as many as there are winches. The independent coordinates, which are the operational variables,
    are the position x, y, z of the midpoint between the attachment points and the heading gamma. The tilt beta of the
    line through these points and the turn alpha about it follow: the weight decides them. Headed along x, the platform
    is level where x = L/2 and tilted elsewhere, its end at the nearer side of the square up.

    Args:
        side: Side L of the square of the exits, in the plane z = 0 [m].
        half_width: Distance h of the attachment points from the platform's origin [m].
        drop: Distance of the platform's centre of mass below the line of the attachment points [m].
        mass: Mass of the platform [kg].
        tension: Least and largest tension of a cable [N].
        velocity: Largest speed of a cable [m/s].
        acceleration: Largest acceleration of a cable [m/s^2].
        jerk: Largest jerk of a cable [m/s^3].

    Returns:
        The robot: 22 variables, 18 equations of rank 18, mobility 4, 4 actuators.

    Source: Lahouar, IV.2.
    """
    plain = larm_spatial(side, half_width, drop, velocity, acceleration, jerk)
    pulls = [
        Tension(t, "base", exit_, "platform", (sign * half_width, 0, 0), tension)
        for t, (_, exit_, sign) in zip(TENSIONS, _cables(side), strict=True)
    ]
    balance = Equilibrium("platform", pulls, mass=mass, centre=(0, 0, -drop))
    mechanism = replace(
        plain.mechanism,
        name="LARM, hanging",
        closures=(*plain.mechanism.closures, balance),
        operational=("x", "y", "z", "gamma"),
        characteristic_length=plain.mechanism.length,
    )
    home = dict(plain.home)
    for q, t in zip(CABLES, TENSIONS, strict=True):  # each cable carries a quarter of the weight along its slope
        home[t] = 0.25 * mass * abs(GRAVITY[2]) * home[q] / abs(home["z"])
    return replace(
        plain,
        mechanism=mechanism,
        home=home,
        masses={"platform": mass},
        centres={"platform": (0.0, 0.0, -drop)},
        source="Lahouar, IV.2 (structure); all dimensions, limits, masses, tensions, solids, cables and home are ours",
        # computed
        facts={
            "variables": 22, "equations": 18, "mobility": 4,
            "rank E": 18, "rank M": 4, "rank N": 14, "rank K": 4, "idle": 0,
        },
    )  # fmt: skip


def _cables(side: float) -> list[tuple[str, tuple[float, float, float], int]]:
    """List the cables with their exits and the side of the platform that they hold."""
    corners = ((0.0, 0.0), (0.0, side), (side, 0.0), (side, side))
    return [(q, (*corner, 0.0), -1 if corner[0] == 0.0 else 1) for q, corner in zip(CABLES, corners, strict=True)]


def _cable(name: str, side: float, axis: str) -> Prismatic:
    return Prismatic(name, axis=axis, range=(0.02 * side, 2.0 * side))


def _list_cables(side: float, half_width: float) -> list[Cable]:
    """List the cables as bodies, each from its exit to its end of the platform's bar.

    The pulley lies within the length that is ignored at the exit; the bar holds the other end.
    """
    return [
        Cable(
            link_A="base", point_A=exit_, link_B="platform", point_B=(sign * half_width, 0, 0), radius=0.0015 * side,
            ignore=(0.05 * side, 0.0), name=f"cable {q}",
        )
        for q, exit_, sign in _cables(side)
    ]  # fmt: skip


def _frame(side: float) -> list[Shape]:
    """Draw the sides of the square, set back by the size of the pulleys."""
    r = 0.02 * side
    a, b = -3 * r, side + 3 * r
    corners = ((a, a, 0.0), (b, a, 0.0), (b, b, 0.0), (a, b, 0.0))
    sides: list[Shape] = [
        Capsule.between(p, q, r, name=f"frame {i + 1}")
        for i, (p, q) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True))
    ]
    pulleys = [Sphere(radius=0.5 * r, pose=transform(exit_), name=f"exit {q}") for q, exit_, _ in _cables(side)]
    return [*sides, *pulleys]


def _limits(velocity: float, acceleration: float, jerk: float, position: dict[str, tuple[float, float]]) -> Limits:
    return Limits(
        position=position,
        velocity=dict.fromkeys(CABLES, velocity),
        acceleration=dict.fromkeys(CABLES, acceleration),
        jerk=dict.fromkeys(CABLES, jerk),
    )
