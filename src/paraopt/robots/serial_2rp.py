"""The serial arm 2RP of the plane, described the serial way: a mobile link is welded to the last link."""

from __future__ import annotations

import math

from paraopt.mechanism import Base, Mechanism, Mobile, Prismatic, Revolute, Series, Weld
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule, Cylinder


def serial_2rp(length: float = 0.5, stroke: tuple[float, float] = (0.3, 0.5), radius: float = 0.02) -> Robot:
    """Build the planar arm with two hinges and a slide, the example of a serial Jacobian.

    The slide runs along the second bar, from the second hinge: `x = l1 cos q1 + q3 cos(q1 + q2)`, `y` alike, and
    `theta = q1 + q2`. The figure and most of the Jacobian are lost in the copy consulted; what is left, the order of
    the joints and the sine and cosine of q1 and of q1 + q2, agrees with this. The arm is singular where q2 is a right
    angle: turning about the first hinge alone then moves the second one along the slide.

    Args:
        length: Length l1 of the first bar [m]; the source prints none.
        stroke: Shortest and longest distance q3 from the second hinge to the tool [m]; ours. Up to 1.8
            times the shortest, the rod stays in its barrel.
        radius: Radius of the bars as solids [m].

    Returns:
        The robot: 6 variables, 4 equations of rank 3.

    Source: Lahouar, I.18; Lahouar, I.19.
    """
    shortest, longest = stroke
    level = 3.0 * radius
    mechanism = Mechanism(
        name="2RP",
        planar=True,
        links=[
            Base(),
            Series("upper arm", father="base", joint=Revolute("q1")),
            Series("barrel", father="upper arm", at=(length, 0), joint=Revolute("q2")),
            Series("rod", father="barrel", joint=Prismatic("q3", axis="x", range=stroke)),
            Mobile("tool"),
        ],
        closures=[Weld("rod", "tool")],
        active=("q1", "q2", "q3"),
        operational=("x", "y", "theta"),
    )
    q1, q2, q3 = 0.4, 0.7, 0.5 * (shortest + longest)
    return Robot(
        mechanism,
        home={
            "q1": q1, "q2": q2, "q3": q3, "theta": q1 + q2,
            "x": length * math.cos(q1) + q3 * math.cos(q1 + q2), "y": length * math.sin(q1) + q3 * math.sin(q1 + q2),
        },
        shapes={
            "base": [Cylinder.between((0, 0, -3 * level), (0, 0, -level), 2.0 * radius)],
            "upper arm": [Capsule.between((0, 0, 0), (length, 0, 0), radius)],
            "barrel": [Capsule.between((0, 0, level), (0.9 * shortest, 0, level), radius)],
            "rod": [Capsule.between((-0.9 * shortest, 0, level), (0, 0, level), 0.5 * radius)],
        },
        limits=Limits(
            velocity={"q1": 2.0, "q2": 2.0, "q3": 0.5},
            acceleration={"q1": 10.0, "q2": 10.0, "q3": 2.0},
            jerk={"q1": 200.0, "q2": 200.0, "q3": 40.0},
        ),
        source="Lahouar, I.4.1 (structure); lengths, strokes, drive limits, solids and home are ours",
        # none is printed; without limits of the stroke the second hinge has two places on the tool's line
        facts={
            "variables": 6, "equations": 4, "rank E": 3, "rank M": 3, "rank N": 0, "rank K": 3, "mobility": 3,
            "idle": 0, "working modes": 2, "assembly modes": 1,
        },
    )  # fmt: skip
