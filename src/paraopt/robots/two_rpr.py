"""The planar 2-RPR: two legs of variable length from the ground to a common point."""

from __future__ import annotations

import math

from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Mobile, Prismatic, Revolute, Series
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule, Shape


def two_rpr(base: float = 10.0, strokes: tuple[float, float] = (6.0, 11.0), radius: float = 0.15) -> Robot:
    """Build the 2-RPR, the smallest closed loop of the sources.

    Both sources leave its dimensions as letters: base, strokes, radius and home are ours. Lengths of the legs are
    distances, so each leg has one solution for a given point; the two assembly modes mirror each other in the line of
    the base. Parallel singularity: y = 0, legs along one line; serial: a leg without length, which the strokes exclude.

    Args:
        base: Distance L between the two hinges on the ground.
        strokes: Shortest and longest leg, above zero. Up to 1.8 times the shortest, the rods stay in their barrels.
        radius: Radius of the barrels as solids.

    Returns:
        The robot: 6 variables, 4 equations of rank 4.

    Source: Lahouar, II.34; Chablat1998, 5.
    """
    shortest = strokes[0]
    links: list[Link] = [Base()]
    closures = []
    shapes: dict[str, list[Shape]] = {}
    height = 0.7 * base
    home: dict[str, float] = {"x": 0.55 * base, "y": height}
    for i, at in ((1, 0.0), (2, base)):
        level = 3.0 * radius * i
        links.append(Series(f"leg {i}", "base", (at, 0), Revolute(f"phi{i}")))
        links.append(Series(f"rod {i}", f"leg {i}", joint=Prismatic(f"rho{i}", axis="x", range=strokes)))
        closures.append(Coincidence(f"rod {i}", (0, 0), "tip", (0, 0)))
        shapes[f"leg {i}"] = [Capsule.between((0, 0, level), (0.9 * shortest, 0, level), radius)]
        shapes[f"rod {i}"] = [Capsule.between((-0.9 * shortest, 0, level), (0, 0, level), 0.5 * radius)]
        home |= {f"rho{i}": math.hypot(home["x"] - at, height), f"phi{i}": math.atan2(height, home["x"] - at)}
    links.append(Mobile("tip", coordinates=("x", "y")))
    mechanism = Mechanism("2-RPR", links, closures, ("rho1", "rho2"), ("x", "y"), planar=True)
    return Robot(
        mechanism,
        home=home,
        shapes=shapes,
        limits=Limits(
            velocity=dict.fromkeys(mechanism.active, 5.0),
            acceleration=dict.fromkeys(mechanism.active, 20.0),
            jerk=dict.fromkeys(mechanism.active, 400.0),
        ),
        source="Lahouar, II.3.1; Chablat1998, 2.3.2 (structure); dimensions, drive limits, solids and home are ours",
        # printed: 6 variables, 4 equations, m = 2, two solutions of the direct model and one of the inverse one
        facts={
            "variables": 6, "equations": 4, "rank E": 4, "rank M": 2, "rank N": 2, "rank K": 2, "mobility": 2,
            "idle": 0, "working modes": 1, "assembly modes": 2,
        },
    )  # fmt: skip
