"""The Logabex: an arm of four Gough-Stewart platforms, each standing on the one below; 24 degrees of freedom.

The rotations of the platforms are `Rx(alpha) Ry(beta) Rz(gamma)`. The source prints no dimensions: those given here are
ours.
"""

from __future__ import annotations

import math

from paraopt.errors import DefinitionError
from paraopt.mechanism import Base, Mechanism, Mobile
from paraopt.robot import Robot
from paraopt.robots.base import Parts, drive_limits, paired_azimuths, ring, six_legs
from paraopt.shapes import Cylinder
from paraopt.spatial import transform


def logabex(
    stages: int = 4,
    width: float = 0.15,
    height: float = 0.35,
    half_angle: float = math.radians(12),
    stroke: float = 0.25,
    radius: float = 0.01,
) -> Robot:
    """Build a stack of Gough-Stewart platforms.

    Every platform is a free link with coordinates in the world, `p<k>.x` to `p<k>.gamma`, and the legs of the next
    stage are its sons. A closure therefore contains the coordinates of two platforms and of one leg, however many
    stages there are: the non-zero entries of E grow with the number of legs. With coordinates from platform to platform
    each closure would contain those of all platforms below.

    The operational variables are the coordinates of *all* platforms: rg K is their number, and with them imposed every
    leg is determined. The coordinates of the last platform alone would also satisfy rg K = r, but they leave
    6 (stages - 1) motions open, which a task has to choose.

    Args:
        stages: Number of platforms.
        width: Radius of the circles of the legs' ends [m].
        height: Distance between two platforms at home [m].
        half_angle: Half the angle between two legs of a pair, seen from the axis [rad].
        stroke: How much a leg stretches beyond and shrinks below its length at home, as a share of it [1].
        radius: Radius of the legs' bodies [m].

    Returns:
        The robot: 24 variables and 18 closure equations for each stage.

    Raises:
        DefinitionError: There is no stage, or the stroke is too long for the legs.

    Source: Lahouar, I.2.
    """
    if stages < 1:
        raise DefinitionError(f"number of stages is {stages}; it must be at least 1")
    pairs = paired_azimuths(half_angle)
    below = paired_azimuths(half_angle, middle=math.pi / 3)
    half = radius  # half the thickness of a platform
    plate = Cylinder(radius=width + radius, length=2 * half)
    parts = Parts(
        links=(Base(),),
        shapes={"base": [Cylinder(radius=1.5 * width, length=half, pose=transform((0, 0, -0.5 * half)))]},
    )
    drives: list[str] = []
    coordinates: list[str] = []
    for k in range(1, stages + 1):
        ground = "base" if k == 1 else f"platform {k - 1}"
        feet = ring(width, [*pairs[1:], pairs[0] + 2 * math.pi], height=0.0 if k == 1 else half)
        ends = ring(width, below, height=-half)
        platform = Mobile(f"platform {k}", prefix=f"p{k}.")
        parts += six_legs(ground, feet, platform.name, ends, height, stroke, radius, stage=f"{k}.")
        names = [m.name for m in platform.motions]
        parts += Parts(
            links=(platform,),
            shapes={platform.name: [plate]},
            masses={platform.name: 1.0},
            start=dict(zip(names, (0.0, 0.0, k * height, 0.0, 0.0, 0.0), strict=True)),
        )
        drives += [f"q{k}.{i}" for i in range(1, 7)]
        coordinates += names
    return Robot(
        Mechanism("Logabex", parts.links, parts.closures, drives, coordinates),
        home=parts.start,
        shapes=parts.shapes,
        limits=drive_limits(drives, velocity=0.2, acceleration=1.0, jerk=20.0),
        masses=parts.masses,
        tool=(f"platform {stages}", (0.0, 0.0, half)),
        source="Lahouar, I.2 (four platforms, 24 freedoms); points, strokes, drive limits, masses and solids are ours",
        # printed: 24 degrees of freedom; the ranks are computed
        facts={
            "variables": 24 * stages, "equations": 18 * stages, "rank E": 18 * stages, "rank M": 6 * stages,
            "rank N": 12 * stages, "rank K": 6 * stages, "mobility": 6 * stages, "idle": 0,
        },
    )  # fmt: skip
