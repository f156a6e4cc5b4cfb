"""The RAF: a translational parallel robot with three jacks and two passive chains that lock the rotations.

Points and axes are those of the source's tables; strokes, drive limits, masses and solids are not printed there and
are ours, chosen plausible. The z axis is taken upwards: the base stands below, the platform above it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Mobile, Prismatic, Revolute, Series, Spherical
from paraopt.robot import Limits, Robot
from paraopt.shapes import Box, Capsule, Cylinder, Shape
from paraopt.spatial import transform

MM = 1e-3
JACK_AT_BASE = ((185, -106, 20), (-185, -106, 20), (0, 214, 20))
JACK_AT_PLATFORM = ((85, -49, -20), (-85, -49, -20), (0, 98, -20))
JACK_BODY, JACK_TIP = 298, 92
FOREARM = 331
ARMS = {"A": ((-50, -180, 25), 0.0), "B": ((-180, 50, 25), -math.pi / 2)}
FOREARM_AT_ARM = {"+": (30, 52, 275), "-": (-30, 52, 275)}
# both ends of the axis by which each forearm holds the platform
FOREARM_AT_PLATFORM = {
    "A+": ((35, -134, -47), (25, -134, -47)),
    "A-": ((-25, -134, -47), (-35, -134, -47)),
    "B+": ((-126, -35, -47), (-126, -25, -47)),
    "B-": ((-126, 25, -47), (-126, 35, -47)),
}


def raf(
    stroke: float = 0.2,
    tool_length: float = 0.08,
    velocity: float = 0.1,
    acceleration: float = 0.5,
    jerk: float = 10.0,
) -> Robot:
    """Build the RAF translational robot.

    Args:
        stroke: Stroke of the jacks [m]; the source prints none.
        tool_length: Height of the tool above the platform's origin [m]; ours.
        velocity: Largest speed of a jack [m/s]; ours.
        acceleration: Largest acceleration of a jack [m/s^2]; ours.
        jerk: Largest jerk of a jack [m/s^3]; ours.

    Returns:
        The robot: 22 links, 32 variables, 33 closure equations of rank 26.

    Source: Lahouar, IV.1; Affi04; Romdhane02.
    """
    links: list[Link] = [Base()]
    closures: list[Coincidence] = []
    shapes: dict[str, list[Shape]] = {"base": [_plate()]}
    for i, (at, end) in enumerate(zip(JACK_AT_BASE, JACK_AT_PLATFORM, strict=True), start=1):
        slide = Prismatic(f"q{i}", axis="z", range=(0.0, stroke))
        links.append(Series(f"jack {i}", "base", _mm(at), Spherical(f"jack {i}")))
        links.append(Series(f"rod {i}", f"jack {i}", _mm((0, 0, JACK_BODY)), slide))
        closures.append(Coincidence(f"rod {i}", _mm((0, 0, JACK_TIP)), "platform", _mm(end)))
        shapes[f"jack {i}"] = [Capsule.between((0, 0, 0.02), _mm((0, 0, JACK_BODY)), radius=0.018)]
        shapes[f"rod {i}"] = [Capsule.between((0, 0, -0.21), _mm((0, 0, JACK_TIP)), radius=0.009)]
    for arm, (at, turn) in ARMS.items():
        links.append(Series(f"arm {arm}", "base", _mm(at), Revolute(f"arm {arm}", axis="x"), rotation=(0, 0, turn)))
        elbow, left, right = _mm((0, 52, 275)), _mm(FOREARM_AT_ARM["-"]), _mm(FOREARM_AT_ARM["+"])
        shapes[f"arm {arm}"] = [
            Capsule.between((0, 0, 0.02), elbow, radius=0.014, name=f"arm {arm}"),
            Capsule.between(left, right, radius=0.01, name=f"arm {arm} fork"),
        ]
        for side, pivot in FOREARM_AT_ARM.items():
            key = arm + side
            links.append(Series(f"cross {key}", f"arm {arm}", _mm(pivot), Revolute(f"cross {key}", axis="x")))
            links.append(Series(f"forearm {key}", f"cross {key}", joint=Revolute(f"forearm {key}", axis="z")))
            end_joint = Revolute(f"fork {key}", axis="z")
            links.append(Series(f"fork {key}", f"forearm {key}", _mm((0, FOREARM, 0)), end_joint))
            shapes[f"forearm {key}"] = [Capsule.between((0, 0, 0), _mm((0, FOREARM, 0)), radius=0.008)]
            for x, hold in zip((5, -5), FOREARM_AT_PLATFORM[key], strict=True):
                closures.append(
                    Coincidence(f"fork {key}", _mm((x, 0, 0)), "platform", _mm(hold), f"fork {key} {x:+d} = platform")
                )
    links.append(Mobile("platform"))
    shapes["platform"] = [
        Cylinder(radius=0.09, length=0.02, pose=transform((0, 0, -0.02)), name="platform"),
        Box(size=(0.08, 0.06, 0.01), pose=transform((0, -0.11, -0.035)), name="platform bracket A"),
        Box(size=(0.06, 0.08, 0.01), pose=transform((-0.1, 0, -0.035)), name="platform bracket B"),
        Cylinder.between((0, 0, -0.01), (0, 0, tool_length), radius=0.012, name="tool"),
    ]
    mechanism = Mechanism("RAF", links, closures, active=("q1", "q2", "q3"), operational=("x", "y", "z"))
    jacks = mechanism.active
    return Robot(
        mechanism,
        home={"x": 0, "y": 0, "z": 0.48, "arm A": 1.0, "arm B": 1.0, "q1": 0.06, "q2": 0.06, "q3": 0.06},
        shapes=shapes,
        limits=Limits(
            velocity=dict.fromkeys(jacks, velocity),
            acceleration=dict.fromkeys(jacks, acceleration),
            jerk=dict.fromkeys(jacks, jerk),
        ),
        masses={
            **{f"jack {i}": 1.2 for i in (1, 2, 3)}, **{f"rod {i}": 0.4 for i in (1, 2, 3)},
            "arm A": 0.6, "arm B": 0.6, **{f"forearm {k}": 0.15 for k in FOREARM_AT_PLATFORM}, "platform": 1.5,
        },
        tool=("platform", (0, 0, tool_length)),
        source="Lahouar, IV.1 (points and axes); strokes, drive limits, masses and solids are ours",
        # all printed; the idle freedoms are the spins of the jacks
        facts={
            "variables": 32, "equations": 33, "rank E": 26, "rank M": 3, "rank N": 23, "rank K": 3,
            "mobility": 6, "idle": 3,
        },
    )  # fmt: skip


def _mm(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (MM * v for v in values)
    return (x, y, z)


def _plate() -> Shape:
    return Cylinder(radius=0.26, length=0.02, pose=transform((0, 0, -0.01)), name="base plate")
