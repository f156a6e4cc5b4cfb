"""The planar five-bar: two driven proximal bars, two distal bars, and a common end point."""

from __future__ import annotations

import math
from typing import Literal

from paraopt.errors import DefinitionError
from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Mobile, Revolute, Series
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule, Cylinder, Shape

Pair = tuple[float, float]
UNLIMITED = (-math.inf, math.inf)


def five_bar(
    base: float = 9.0,
    proximal: Pair = (8.0, 5.0),
    distal: Pair = (5.0, 8.0),
    ranges: tuple[Pair, Pair] = (UNLIMITED, UNLIMITED),
    tip: Pair = (6.0, 7.0),
    elbows: tuple[int, int] = (-1, 1),
    radius: float = 0.15,
    levels: Literal[2, 4] = 4,
) -> Robot:
    """Build the five-bar RR-RRR.

    The source studies three sets of dimensions L0 ... L4; it gives no unit, and lengths are called metres:

    * 9, 8, 5, 5, 8 without limits: the default;
    * `five_bar(base=8, proximal=(5, 5), distal=(7, 7), ranges=((0, pi), (0, pi)))`, where L3 and L4 are missing in
      print and 7 reproduces the counts of aspects;
    * `five_bar(base=5, proximal=(8, 8), distal=(5, 5), levels=2)`: bars of width 2 `radius` that may meet.

    On four levels nothing meets anything. On two, as the source has them, bars that are joined run on different ones:
    the first driven bar meets the second distal bar, the second driven bar the first distal one, and the posts of the
    driven axes stand through both levels. Radius, speeds and home are ours.

    Args:
        base: Distance between the driven axes L0.
        proximal: Lengths L1 and L2 of the driven bars.
        distal: Lengths L3 and L4 of the bars that carry the end point.
        ranges: Lowest and highest angle of each drive [rad].
        tip: The end point at home.
        elbows: On which side the elbows are at home: 1 where the angle from a driven bar to its distal bar is positive.
        radius: Radius of the bars as solids.
        levels: Number of levels on which the bars run.

    Returns:
        The robot: 6 variables, 4 closure equations.

    Raises:
        DefinitionError: A leg does not reach the end point at home, or there are neither two nor four levels.

    Source: Chablat1998; Lahouar, II.47.
    """
    if levels not in (2, 4):
        raise DefinitionError(f"number of levels of the five-bar is {levels!r}; it must be 2 or 4")
    links: list[Link] = [Base()]
    closures = []
    shapes: dict[str, list[Shape]] = {}
    home = {"x": tip[0], "y": tip[1]}
    gap = 3.0 * radius
    for i in range(2):
        n, at, L, M = i + 1, i * base, proximal[i], distal[i]
        upper, lower = f"proximal {n}", f"distal {n}"
        links.append(Series(upper, "base", (at, 0), Revolute(f"theta{n}", range=ranges[i])))
        links.append(Series(lower, upper, (L, 0), Revolute(f"theta{n + 2}")))
        closures.append(Coincidence(lower, (M, 0), "tip", (0, 0)))
        # along the loop: proximal 1, distal 1, distal 2, proximal 2
        for link, length, place in ((upper, L, 3 * i), (lower, M, 1 + i)):
            z = gap * (place % levels)
            shapes[link] = [Capsule.between((0, 0, z), (length, 0, z), radius)]
        home |= _reach(n, (tip[0] - at, tip[1]), L, M, elbows[i])
    links.append(Mobile("tip", coordinates=("x", "y")))
    if levels == 2:
        for n, at in ((1, 0.0), (2, base)):
            # a link of its own, so that the post of one leg is checked against the driven bar of the other
            links.append(Series(f"post {n}", "base", (at, 0)))
            shapes[f"post {n}"] = [Cylinder.between((0, 0, -radius), (0, 0, gap + radius), radius)]
    drives = ("theta1", "theta2")
    return Robot(
        Mechanism("five-bar", links, closures, active=drives, operational=("x", "y"), planar=True),
        home=home,
        shapes=shapes,
        limits=Limits(
            velocity=dict.fromkeys(drives, 2.0),
            acceleration=dict.fromkeys(drives, 10.0),
            jerk=dict.fromkeys(drives, 200.0),
        ),
        source="Chablat1998 (lengths); radius, levels, drive limits and home are ours",
        # printed: the counts of variables and equations, m = 2, two and four solutions; the ranks of blocks are ours
        facts={
            "variables": 6, "equations": 4, "rank E": 4, "rank M": 2, "rank N": 2, "rank K": 2, "mobility": 2,
            "idle": 0, "working modes": 4, "assembly modes": 2,
        },
    )  # fmt: skip


def _reach(number: int, target: Pair, L: float, M: float, elbow: int) -> dict[str, float]:
    """Give both angles of a leg for a target seen from its driven axis, by the law of cosines."""
    across, up = target
    cosine = (across**2 + up**2 - L**2 - M**2) / (2.0 * L * M)
    if not -1.0 < cosine < 1.0:
        raise DefinitionError(
            f"leg {number} of the five-bar must span {math.hypot(across, up):.4g} m at home; its bars of {L:g} and "
            f"{M:g} m cannot; choose another tip"
        )
    second = math.copysign(math.acos(cosine), elbow)
    first = math.atan2(up, across) - math.atan2(M * math.sin(second), L + M * math.cos(second))
    return {f"theta{number}": math.remainder(first, 2.0 * math.pi), f"theta{number + 2}": second}
