"""The serial arm 2R of the plane, described the serial way: a mobile link is tied to the end of the chain."""

from __future__ import annotations

import math

from paraopt.mechanism import Base, Coincidence, Mechanism, Mobile, Revolute, Series
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule, Cylinder


def serial_2r(lengths: tuple[float, float] = (0.5, 0.4), radius: float = 0.02) -> Robot:
    """Build the planar arm with two hinges, `x = l1 cos q1 + l2 cos(q1 + q2)`, `y` alike.

    The second angle is taken from the first bar. Only the position of the end matters, so the mobile link has no angle
    and is tied by a point. The bars run on two levels. The end reaches the ring between |l1 - l2| and l1 + l2.

    Args:
        lengths: Lengths l1 and l2 of the bars [m]; the source prints none.
        radius: Radius of the bars as solids [m].

    Returns:
        The robot: 4 variables, 2 equations, elbow on either side.

    Source: Lahouar, I.3; Lahouar, I.4.
    """
    first, second = lengths
    level = 3.0 * radius
    mechanism = Mechanism(
        name="2R",
        planar=True,
        links=[
            Base(),
            Series("upper arm", father="base", joint=Revolute("q1")),
            Series("forearm", father="upper arm", at=(first, 0), joint=Revolute("q2")),
            Mobile("tool", coordinates=("x", "y")),
        ],
        closures=[Coincidence("forearm", (second, 0), "tool", (0, 0))],
        active=("q1", "q2"),
        operational=("x", "y"),
    )
    # an elbow bent by 1.2 rad is far from both edges of the ring, whatever the lengths
    return Robot(
        mechanism,
        home=_pose(lengths, 0.4, 1.2),
        shapes={
            "base": [Cylinder.between((0, 0, -3 * level), (0, 0, -level), 2.0 * radius)],
            "upper arm": [Capsule.between((0, 0, 0), (first, 0, 0), radius)],
            "forearm": [Capsule.between((0, 0, level), (second, 0, level), radius)],
        },
        limits=Limits(
            velocity=dict.fromkeys(mechanism.active, 2.0),
            acceleration=dict.fromkeys(mechanism.active, 10.0),
            jerk=dict.fromkeys(mechanism.active, 200.0),
        ),
        source="Lahouar, I.3.1 (structure); lengths, drive limits, solids and home are ours",
        # printed: up to two solutions of the inverse model, one of the direct one; the ranks are ours
        facts={
            "variables": 4, "equations": 2, "rank E": 2, "rank M": 2, "rank N": 0, "rank K": 2, "mobility": 2,
            "idle": 0, "working modes": 2, "assembly modes": 1,
        },
    )  # fmt: skip


def _pose(lengths: tuple[float, float], q1: float, q2: float) -> dict[str, float]:
    x = lengths[0] * math.cos(q1) + lengths[1] * math.cos(q1 + q2)
    y = lengths[0] * math.sin(q1) + lengths[1] * math.sin(q1 + q2)
    return {"q1": q1, "q2": q2, "x": x, "y": y}
