"""The Lynx: a serial arm of five revolute joints, closed by welding a free link to its tool.

Axes and points are those of the source's table A.1; ranges, drive limits, masses and solids are not printed there and
are ours. The rotation of the tool is x-y-z, as in the source.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from paraopt.mechanism import Base, Link, Mechanism, Mobile, Revolute, Series, Weld
from paraopt.robot import Robot
from paraopt.robots.base import drive_limits
from paraopt.shapes import Box, Capsule, Cylinder, Shape
from paraopt.spatial import transform

MM = 1e-3
# axis of each joint and its place in the link before it
JOINTS = (("z", (0, 0, 60)), ("y", (0, 0, 13)), ("y", (0, 0, 121)), ("y", (116, 0, 0)), ("x", (55, 0, 0)))
TOOL = (135, 0, 0)


def lynx(swing: float = math.pi / 2, velocity: float = 2.0, acceleration: float = 10.0, jerk: float = 200.0) -> Robot:
    """Build the Lynx arm.

    Five joints cannot reach all six coordinates of the tool: its axis t always stays in the vertical plane that holds
    the first joint's axis and the tool's point, so that `x t_y = y t_x`. With all six as operational variables the
    choice would not be minimal (five motions only). The five are the position and the first two angles; the third
    follows from `x cos(alpha) sin(gamma) = (y cos(beta) - x sin(alpha) sin(beta)) cos(gamma)` and is passive. It is
    undetermined only where both factors vanish. The other choices that keep the position are worse: without beta the
    reach inside the arm's plane is lost, without alpha the roll is lost wherever beta = 0.

    Args:
        swing: Largest angle of each servo to either side [rad]; the source prints none.
        velocity: Largest speed of a servo [rad/s]; ours.
        acceleration: Largest acceleration of a servo [rad/s^2]; ours.
        jerk: Largest jerk of a servo [rad/s^3]; ours.

    Returns:
        The robot: 11 variables, 12 closure equations of rank 6, mobility 5.

    Source: Lahouar, A.1.
    """
    links: list[Link] = [Base()]
    father = "base"
    for i, (axis, at) in enumerate(JOINTS, start=1):
        links.append(Series(f"link {i}", father, _mm(at), Revolute(f"q{i}", axis=axis, range=(-swing, swing))))
        father = f"link {i}"
    links.append(Mobile("tool"))
    mechanism = Mechanism(
        "Lynx",
        links,
        [Weld("link 5", "tool", at=_mm(TOOL))],
        active=tuple(f"q{i}" for i in range(1, 6)),
        operational=("x", "y", "z", "alpha", "beta"),
    )
    servos = mechanism.active
    return Robot(
        mechanism,
        home={
            "x": 0.22, "y": 0.0, "z": 0.1, "alpha": 0.0, "beta": 0.6, "gamma": 0.0,
            "q1": 0.0, "q2": -0.3, "q3": 0.4, "q4": 0.5, "q5": 0.0,
        },
        shapes=_solids(),
        limits=drive_limits(servos, velocity, acceleration, jerk),
        masses={"link 1": 0.12, "link 2": 0.1, "link 3": 0.1, "link 4": 0.06, "link 5": 0.12},
        tool=("tool", (0, 0, 0)),
        source="Lahouar, annex A (axes and points); ranges, drive limits, masses, solids and home are ours",
        # variables and equations are printed, of which 6 are needed; the other ranks are computed
        facts={
            "variables": 11, "equations": 12, "mobility": 5,
            "rank E": 6, "rank M": 5, "rank N": 1, "rank K": 5, "idle": 0,
        },
    )  # fmt: skip


def _solids() -> dict[str, Sequence[Shape]]:
    """Give slender solids along the links; the fingers of the gripper end at the tool's point."""
    return {
        "base": [Cylinder(radius=0.05, length=0.04, pose=transform((0, 0, 0.02)), name="base")],
        "link 1": [Cylinder.between((0, 0, -0.02), (0, 0, 0.013), radius=0.035)],
        "link 2": [Capsule.between((0, 0, 0), _mm((0, 0, 121)), radius=0.015)],
        "link 3": [Capsule.between((0, 0, 0), _mm((116, 0, 0)), radius=0.013)],
        "link 4": [Capsule.between((0, 0, 0), _mm((50, 0, 0)), radius=0.013)],
        "link 5": [
            Box(size=(0.05, 0.06, 0.03), pose=transform((0.025, 0, 0)), name="gripper"),
            Box(size=(0.085, 0.006, 0.02), pose=transform((0.0925, 0.022, 0)), name="left finger"),
            Box(size=(0.085, 0.006, 0.02), pose=transform((0.0925, -0.022, 0)), name="right finger"),
        ],
    }


def _mm(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (MM * v for v in values)
    return (x, y, z)
