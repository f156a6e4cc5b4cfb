"""The planar 3-RPR: a platform on three legs of variable length, in the two sets of dimensions that the sources study.

Angles are counted from the x axis of the base. The legs run on three levels, so that they may cross; the platform runs
on a fourth.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Mobile, Prismatic, Revolute, Series
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule, Shape

Triangle = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def three_rpr(
    base: Triangle = ((-37.5, 21.651), (37.5, 21.651), (0.0, -43.301)),
    platform: Triangle = ((0.0, 0.0), (15.0, 0.0), (7.5, 12.990)),
    strokes: tuple[float, float] = (10.0, 200.0),
    pose: tuple[float, float, float] = (20.0, 0.0, 0.3),
    radius: float = 0.4,
    name: str = "3-RPR",
) -> Robot:
    """Build the 3-RPR; the defaults are those of the planning example.

    The example has an equilateral platform of side 15 and an equilateral base of side 75, strokes from 10 to 200, and
    starts at (20, 0, 0.3). Its frames are not recoverable: the default base points downwards, and a path exists from
    there to (-60, 50, 0.6). In the plain reading, `base=((0, 0), (75, 0), (37.5, 64.952))`, start and the goal
    (60, -50, 0.6) lie on opposite sides of the parallel singularity. Lengths have no unit in the source and are called
    metres.

    As solids, a leg is a barrel at the hinge and a rod that never leaves it. With strokes up to 1.7 times the shortest
    the rod stays inside. Two solids cannot span longer strokes otherwise than by one of them sticking out: the rod then
    runs through the barrel, as a rack through its pinion's housing, and out behind the hinge, on the level of its leg.

    Args:
        base: Hinges on the ground.
        platform: Hinges on the platform, in its frame.
        strokes: Shortest and longest leg, as printed.
        pose: The platform at home: x, y and theta [rad].
        radius: Radius of the barrels as solids; ours.
        name: Name of the mechanism.

    Returns:
        The robot: 9 variables, 6 equations of rank 6. A leg has one solution for a pose, since its length is positive.

    Source: Lahouar, II.59; Lahouar, III.3.
    """
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    links: list[Link] = [Base()]
    closures = []
    shapes: dict[str, list[Shape]] = {}
    home = {"x": x, "y": y, "theta": theta}
    for i, (A, b) in enumerate(zip(base, platform, strict=True), start=1):
        links.append(Series(f"leg {i}", "base", A, Revolute(f"phi{i}")))
        links.append(Series(f"rod {i}", f"leg {i}", joint=Prismatic(f"rho{i}", axis="x", range=strokes)))
        closures.append(Coincidence(f"rod {i}", (0, 0), "platform", b))
        level = 3.0 * radius * i
        across, up = x + c * b[0] - s * b[1] - A[0], y + s * b[0] + c * b[1] - A[1]
        home |= {f"rho{i}": math.hypot(across, up), f"phi{i}": math.atan2(up, across)}
        barrel = 0.9 * strokes[0]
        rod = max(barrel, strokes[1] - 0.8 * barrel)  # at the longest a fifth of the barrel still holds the rod
        shapes[f"leg {i}"] = [Capsule.between((0, 0, level), (barrel, 0, level), radius)]
        shapes[f"rod {i}"] = [Capsule.between((-rod, 0, level), (0, 0, level), 0.5 * radius)]
    links.append(Mobile("platform"))
    corners = np.column_stack([platform, np.zeros(3)])
    shapes["platform"] = [
        Capsule.between(corners[i], corners[i - 1], radius, f"platform side {i + 1}") for i in range(3)
    ]
    drives = ("rho1", "rho2", "rho3")
    return Robot(
        Mechanism(name, links, closures, drives, ("x", "y", "theta"), planar=True),
        home=home,
        shapes=shapes,
        limits=Limits(
            velocity=dict.fromkeys(drives, 20.0),
            acceleration=dict.fromkeys(drives, 100.0),
            jerk=dict.fromkeys(drives, 2000.0),
        ),
        source="Lahouar, II.3.3, III.3 (structure, dimensions, strokes); frames, drive limits and solids are ours",
        # printed: N = 9, 6 equations, m = 3; how many assembly modes there are, up to six, depends on the dimensions
        facts={
            "variables": 9, "equations": 6, "rank E": 6, "rank M": 3, "rank N": 3, "rank K": 3, "mobility": 3,
            "idle": 0, "working modes": 1,
        },
    )  # fmt: skip


def three_rpr_innocenti() -> Robot:
    """Build the 3-RPR that changes its assembly mode without a singularity, of Innocenti, Merlet and Chablat.

    A1 is the origin, A2 = (15.9, 0), A3 = (0, 10); the sides of the platform are B1B2 = 17.0, B2B3 = 16.5 and
    B3B1 = 20.8, with B3 to the left of the line from B1 to B2, which is the platform's x axis. Strokes from 10 to 32.
    Home is near the second of the six solutions for the legs 15.0, 15.4, 12.0: far from singularities, and no leg lies
    along a side of the platform.

    Returns:
        The robot, as `three_rpr`.

    Source: Chablat1998, table 2; Chablat1998, table 3.
    """
    B1B2, B2B3, B3B1 = 17.0, 16.5, 20.8
    along = (B1B2**2 + B3B1**2 - B2B3**2) / (2.0 * B1B2)
    robot = three_rpr(
        base=((0.0, 0.0), (15.9, 0.0), (0.0, 10.0)),
        platform=((0.0, 0.0), (B1B2, 0.0), (along, math.sqrt(B3B1**2 - along**2))),
        strokes=(10.0, 32.0),
        pose=(-5.5, -13.9, -0.05),
        radius=0.3,
        name="3-RPR of Innocenti",
    )
    return replace(
        robot,
        source="Chablat1998, tables 2 and 3 (dimensions, strokes); drive limits, solids and home are ours",
        facts={**robot.facts, "assembly modes": 6},  # printed
    )
