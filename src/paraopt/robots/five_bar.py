"""The planar five-bar: two driven proximal bars, two distal bars, and a common end point."""

from __future__ import annotations

from paraopt.mechanism import Base, Coincidence, Mechanism, Mobile, Revolute, Series
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule


def five_bar(
    base: float = 9.0,
    proximal: tuple[float, float] = (8.0, 5.0),
    distal: tuple[float, float] = (5.0, 8.0),
    radius: float = 0.15,
) -> Robot:
    """Build the five-bar RR-RRR.

    The source gives no unit: lengths are taken as printed and called metres. Radius, speeds and home are ours.

    Args:
        base: Distance between the driven axes L0.
        proximal: Lengths L1 and L2 of the driven bars.
        distal: Lengths L3 and L4 of the bars that carry the end point.
        radius: Radius of the bars as solids.

    Returns:
        The robot: 6 variables, 4 closure equations.

    Source: Chablat1998; Lahouar, II.47.
    """
    mechanism = Mechanism(
        name="five-bar",
        planar=True,
        links=[
            Base(),
            Series("proximal 1", father="base", at=(0, 0), joint=Revolute("theta1")),
            Series("distal 1", father="proximal 1", at=(proximal[0], 0), joint=Revolute("theta3")),
            Series("proximal 2", father="base", at=(base, 0), joint=Revolute("theta2")),
            Series("distal 2", father="proximal 2", at=(proximal[1], 0), joint=Revolute("theta4")),
            Mobile("tip", coordinates=("x", "y")),
        ],
        closures=[
            Coincidence("distal 1", (distal[0], 0), "tip", (0, 0)),
            Coincidence("distal 2", (distal[1], 0), "tip", (0, 0)),
        ],
        active=("theta1", "theta2"),
        operational=("x", "y"),
    )
    lengths = {"proximal 1": proximal[0], "distal 1": distal[0], "proximal 2": proximal[1], "distal 2": distal[1]}
    return Robot(
        mechanism,
        home={"x": 6.0, "y": 7.0, "theta1": 1.3, "theta3": -1.2, "theta2": 0.3, "theta4": 1.5},
        shapes={name: [Capsule.between((0, 0, 0), (length, 0, 0), radius)] for name, length in lengths.items()},
        limits=Limits(
            velocity=dict.fromkeys(("theta1", "theta2"), 2.0),
            acceleration=dict.fromkeys(("theta1", "theta2"), 10.0),
            jerk=dict.fromkeys(("theta1", "theta2"), 200.0),
        ),
        contacts={
            ("proximal 1", "proximal 2"): "bars run on different levels",
            ("distal 1", "proximal 2"): "bars run on different levels",
            ("distal 2", "proximal 1"): "bars run on different levels",
        },
        source="Chablat1998 (lengths); radius, drive limits and home are ours",
    )
