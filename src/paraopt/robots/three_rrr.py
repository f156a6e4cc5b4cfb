"""The planar 3-RRR: a platform on three legs of two bars, driven at the ground."""

from __future__ import annotations

import math

import numpy as np

from paraopt.errors import DefinitionError
from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Mobile, Revolute, Series
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule, Shape

Triple = tuple[float, float, float]
Triangle = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def three_rrr(
    base: Triangle = ((-10.0, -10.0), (10.0, -10.0), (0.0, 10.0)),
    platform: Triangle = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)),
    proximal: Triple = (10.0, 10.0, 10.0),
    distal: Triple = (10.0, 10.0, 10.0),
    pose: Triple = (-6.0, -4.0, 0.3),
    elbows: tuple[int, int, int] = (1, 1, 1),
    radius: float = 0.2,
) -> Robot:
    """Build the 3-RRR.

    Bars and platform run on seven levels and may cross. Lengths have no unit in the source and are called metres.

    Args:
        base: Driven hinges A on the ground.
        platform: Hinges C on the platform, in its frame.
        proximal: Lengths L of the driven bars.
        distal: Lengths M of the bars that hold the platform.
        pose: The platform at home: x, y and theta [rad]; ours.
        elbows: On which side the elbows are at home: 1 where the angle from the driven bar to the other is positive.
        radius: Radius of the bars as solids; ours.

    Returns:
        The robot: 9 variables, 6 equations of rank 6.

    Raises:
        DefinitionError: A leg does not reach the platform at home.

    Source: Chablat1998, 19; Chablat1998, table 7.
    """
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    links: list[Link] = [Base()]
    closures = []
    shapes: dict[str, list[Shape]] = {}
    home = {"x": x, "y": y, "theta": theta}
    for i in range(3):
        (A_x, A_y), (C_x, C_y), L, M = base[i], platform[i], proximal[i], distal[i]
        upper, lower, n = f"proximal {i + 1}", f"distal {i + 1}", i + 1
        links.append(Series(upper, "base", base[i], Revolute(f"alpha{n}")))
        links.append(Series(lower, upper, (L, 0), Revolute(f"beta{n}")))
        closures.append(Coincidence(lower, (M, 0), "platform", platform[i]))
        across, up = x + c * C_x - s * C_y - A_x, y + s * C_x + c * C_y - A_y
        cosine = (across**2 + up**2 - L**2 - M**2) / (2.0 * L * M)
        if not -1.0 < cosine < 1.0:
            raise DefinitionError(
                f"leg {n} of the 3-RRR must span {math.hypot(across, up):.4g} m at home; its bars of {L:g} and {M:g} m "
                "cannot; choose another pose"
            )
        beta = math.copysign(math.acos(cosine), elbows[i])
        alpha = math.atan2(up, across) - math.atan2(M * math.sin(beta), L + M * math.cos(beta))
        home |= {f"alpha{n}": math.remainder(alpha, 2 * math.pi), f"beta{n}": beta}
        for link, length, level in ((upper, L, 2 * n), (lower, M, 2 * n - 1)):
            z = 3.0 * radius * level
            shapes[link] = [Capsule.between((0, 0, z), (length, 0, z), radius)]
    links.append(Mobile("platform"))
    corners = np.column_stack([platform, np.zeros(3)])
    shapes["platform"] = [
        Capsule.between(corners[i], corners[i - 1], radius, f"platform side {i + 1}") for i in range(3)
    ]
    drives = ("alpha1", "alpha2", "alpha3")
    return Robot(
        Mechanism("3-RRR", links, closures, drives, ("x", "y", "theta"), planar=True),
        home=home,
        shapes=shapes,
        limits=Limits(
            velocity=dict.fromkeys(drives, 2.0),
            acceleration=dict.fromkeys(drives, 10.0),
            jerk=dict.fromkeys(drives, 200.0),
        ),
        source="Chablat1998, 3.4.6 (dimensions); drive limits, solids and home are ours",
        # printed: up to six solutions of the direct model and eight of the inverse one; the counts and ranks are ours
        facts={
            "variables": 9, "equations": 6, "rank E": 6, "rank M": 3, "rank N": 3, "rank K": 3, "mobility": 3,
            "idle": 0, "working modes": 8, "assembly modes": 6,
        },
    )  # fmt: skip
