"""GIPO: a dog with four legs of three servos, seen as a parallel robot that stands on its ground.

Points and axes are those of the source's tables IV.3 and IV.4 as deciphered (the printed axes of the carriers are
misprints for translations); x is forward, y to the left, z up. Ranges, drive limits, masses and solids are not printed
there and are ours. The rotation of the trunk is x-y-z, as in the source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from paraopt.errors import unknown_name
from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Mobile, Prismatic, Revolute, Series
from paraopt.mechanism.joints import Range
from paraopt.modes.legged import Foot, LeggedMachine
from paraopt.robot import Robot
from paraopt.robots.base import drive_limits
from paraopt.shapes import Box, Capsule, Shape
from paraopt.spatial import transform

MM = 1e-3
# right legs, millimetres; left legs mirror y. The hip stands in the trunk's frame, each other point in the link before
HIP = {"rear": (58, -50, -38), "front": (118, -50, -38)}
ABDUCTION = (0, -20, 0)
KNEE = {"rear": (-9, -5, -70), "front": (9, -5, -70)}
TIP = {"rear": (-4, 1, -57), "front": (4, 1, -57)}
FOOT_AT_REST = {"rear": (37, -79, -155), "front": (250, -79, -155)}
# with zero angles the tips fit the printed feet best, within 5.5 mm, when the trunk is 10 mm up; there the legs are
# stretched and do not quite reach, so the trunk rests lower; with the printed sign of the rear hips lower still
TRUNK_HEIGHT = {-1: 0, 1: -30}
# name, axis, place, link before
HEAD_AND_TAIL = (
    ("neck 1", "y", (188, 0, 0), "trunk"),
    ("neck 2", "y", (0, 0, 67), "neck 1"),
    ("head", "x", (0, 0, 38), "neck 2"),
    ("jaw", "y", (31, 0, -35), "head"),
    ("tail", "x", (0, 0, 0), "trunk"),
)
LEGS = ("right rear", "right front", "left rear", "left front")
FOOT_RADIUS = 5
# kilograms, guessed: a servo in each joint weighs about 50 g, the trunk carries batteries and controller
MASSES = {
    "trunk": 0.6, "hip": 0.05, "abduction": 0.06, "knee": 0.04,
    "neck 1": 0.05, "neck 2": 0.04, "head": 0.04, "jaw": 0.01, "tail": 0.02,
}  # fmt: skip
# batteries and controller balance the head: the whole stands some 5 mm ahead of the middle of its feet
TRUNK_CENTRE = (5, 0, -20)


def gipo(
    head_and_tail: bool = True,
    rear_hip: Literal[-1, 1] = -1,
    trunk_height: float | None = None,
    swing: float = math.pi / 2,
    lift: float = 0.06,
    depth: float = 0.005,
    masses: Mapping[str, float] | None = None,
    velocity: float = 4.0,
    acceleration: float = 40.0,
    jerk: float = 2000.0,
) -> Robot:
    """Build GIPO on its four feet.

    The ground is the base, the trunk a free link, the legs hang from the trunk, and the tip of each foot coincides
    with a point of a *carrier*, which three translations move over the ground: zero is the foot's place at rest.

    Roles follow the source's way to walk: the pose of the trunk and the places of the four feet are imposed, hence
    operational (18); the servos of the legs follow, hence active (12). The servos of head and tail enter no closure and
    take no part in walking: passive, five idle freedoms that every solve leaves where they are. With every foot held,
    the 12 servos drive the 6 motions of the trunk redundantly; as long as the carriers count as free, 12 servos do not
    hold 18 motions, so the parallel margin is zero everywhere, and II.23 cannot hold (12 equations, 18 operational
    variables). Impose the carriers of the standing feet to ask about a stance.

    Args:
        head_and_tail: Whether head and tail are described.
        rear_hip: Sign of the rear hips' x; +1 is printed, -1 agrees with the printed stance.
        trunk_height: Height of the trunk's origin at home [m], 0 being 155 mm above the tips of the feet; 0 when None,
            or 30 mm lower with `rear_hip=1`.
        swing: Largest angle of a servo to either side [rad].
        lift: Highest place of a foot above the ground [m].
        depth: Deepest place of a foot below the ground at rest [m]; larger for supports that fall away. Not zero, since
            a foot that comes off the ground begins within its range, and not at its end.
        masses: Masses of parts [kg] that differ from ours, by name: "trunk", "hip", "abduction" and "knee" of every
            leg, "neck 1", "neck 2", "head", "jaw", "tail". The source prints none, but that the centre of gravity is
            slightly towards the front; ours are plausible guesses, 1.36 kg in all, with the centre of each part in the
            middle of its solid and that of the trunk so that the whole is some 5 mm ahead of the middle of its feet.
        velocity: Largest speed of a servo [rad/s].
        acceleration: Largest acceleration of a servo [rad/s^2].
        jerk: Largest jerk of a servo [rad/s^3].

    Returns:
        The robot: 35 variables, 12 closure equations of rank 12, mobility 23; without head and tail 30 and 18.

    Source: Lahouar, IV.3.
    """
    servo: Range = (-swing, swing)
    links: list[Link] = [Base("ground"), Mobile("trunk")]
    closures: list[Coincidence] = []
    # the trunk's hips are centred above the feet
    middle = 0.5 * MM * (sum(p[0] for p in FOOT_AT_REST.values()) - rear_hip * HIP["rear"][0] - HIP["front"][0])
    height = MM * TRUNK_HEIGHT[rear_hip] if trunk_height is None else trunk_height
    home = {"x": middle, "y": 0.0, "z": height, "alpha": 0.0, "beta": 0.0, "gamma": 0.0}
    servos: list[str] = []
    carriers: list[str] = []
    shapes: dict[str, Sequence[Shape]] = _trunk(head_and_tail)
    centres: dict[str, Sequence[float]] = _centres_of_trunk(head_and_tail)
    for leg in LEGS:
        side, end = leg.split()
        mirror = 1 if side == "right" else -1
        hip, abduction, knee, rest = (
            _mm((p[0], mirror * p[1], p[2])) for p in (HIP[end], ABDUCTION, KNEE[end], FOOT_AT_REST[end])
        )
        tip = _tip(leg)
        if end == "rear":
            hip = (rear_hip * hip[0], hip[1], hip[2])
        # thighs lean away from the middle, as the points of the tables do
        bend = 0.4 if end == "rear" else -0.4
        home |= {f"{leg} hip": bend, f"{leg} abduction": 0.0, f"{leg} knee": -2 * bend}
        chain = (("hip", "y", hip), ("abduction", "x", abduction), ("knee", "y", knee))
        father = "trunk"
        for name, axis, at in chain:
            links.append(Series(f"{leg} {name}", father, at, Revolute(f"{leg} {name}", axis=axis, range=servo)))
            father = f"{leg} {name}"
            servos.append(father)
        father, place = "ground", rest
        inside = _mm((0, 15 * mirror, 0))  # the servo of the hip reaches into the trunk
        for axis in "xyz":
            reach: Range = (-depth, lift) if axis == "z" else (-1.0, 1.0)
            name = f"{leg} foot {axis}"
            links.append(Series(f"{leg} carrier {axis}", father, place, Prismatic(name, axis=axis, range=reach)))
            father, place = f"{leg} carrier {axis}", (0.0, 0.0, 0.0)
            carriers.append(name)
        closures.append(Coincidence(f"{leg} knee", tip, father, (0, 0, 0)))
        centres |= {
            f"{leg} hip": _middle(inside, abduction),
            f"{leg} abduction": _middle((0, 0, 0), knee),
            f"{leg} knee": _middle((0, 0, 0), tip),
        }
        shapes |= {
            f"{leg} hip": [Capsule.between(inside, abduction, radius=0.009)],
            f"{leg} abduction": [Capsule.between((0, 0, 0), knee, radius=0.01)],
            f"{leg} knee": [
                Capsule.between((0, 0, 0), tip, radius=MM * FOOT_RADIUS, name=f"{leg} shin"),
            ],
        }
    if head_and_tail:
        for name, axis, at, father in HEAD_AND_TAIL:
            links.append(Series(name, father, _mm(at), Revolute(name, axis=axis, range=servo)))
    others = [name for name, *_ in HEAD_AND_TAIL] if head_and_tail else []
    mechanism = Mechanism(
        "GIPO", links, closures, active=servos, operational=("x", "y", "z", "alpha", "beta", "gamma", *carriers)
    )
    extra = len(others)
    return Robot(
        mechanism,
        home={**home, **dict.fromkeys(carriers, 0.0)},
        shapes=shapes,
        limits=drive_limits([*servos, *others], velocity, acceleration, jerk),
        masses=_masses(head_and_tail, masses or {}),
        centres=centres,
        contacts={("ground", f"{leg} knee"): "the foot stands on the ground" for leg in LEGS},
        source="Lahouar, IV.3 (points, axes and stance); ranges, drive limits, masses and solids are ours",
        # variables and equations are counted in the printed tables, the rest is computed
        facts={
            "variables": 30 + extra, "equations": 12, "mobility": 18 + extra,
            "rank E": 12, "rank M": 12, "rank N": 0, "rank K": 12, "idle": extra,
        },
    )  # fmt: skip


def gipo_machine(robot: Robot | None = None) -> LeggedMachine:
    """See GIPO as a legged machine: its four feet, on the carriers that place them.

    Args:
        robot: GIPO as built by `gipo`; with its defaults when None.

    Returns:
        The machine; each foot is a point. Feet at rest stand 155 mm below the origin of the ground.

    Source: Lahouar, IV.3.
    """
    feet = [
        Foot(leg, tuple(f"{leg} foot {axis}" for axis in "xyz"), f"{leg} knee", _tip(leg), carrier=f"{leg} carrier z")
        for leg in LEGS
    ]
    return LeggedMachine(gipo() if robot is None else robot, feet)


def _trunk(head_and_tail: bool) -> dict[str, Sequence[Shape]]:
    """Give the solids of ground, trunk, head and tail."""
    thickness = 0.02
    top = MM * (FOOT_AT_REST["rear"][2] - FOOT_RADIUS)
    floor = Box(size=(0.6, 0.34, thickness), pose=transform((0.14, 0, top - thickness / 2)), name="ground")
    shapes: dict[str, Sequence[Shape]] = {
        "ground": [floor],
        "trunk": [Box(size=(0.265, 0.06, 0.05), pose=transform((0.0575, 0, -0.02)), name="trunk")],
    }
    if head_and_tail:
        shapes |= {
            "neck 1": [Capsule.between((0, 0, 0.01), _mm((0, 0, 67)), radius=0.012)],
            "neck 2": [Capsule.between((0, 0, 0), _mm((0, 0, 38)), radius=0.012)],
            "head": [
                Box(size=(0.07, 0.05, 0.04), pose=transform((0.03, 0, 0.005)), name="head"),
            ],
            "jaw": [Box(size=(0.04, 0.03, 0.008), pose=transform((0.02, 0, 0.017)), name="jaw")],
            "tail": [Capsule.between((-0.07, 0, 0), (-0.13, 0, 0.08), radius=0.006)],
        }
    return shapes


def _centres_of_trunk(head_and_tail: bool) -> dict[str, Sequence[float]]:
    """Give the centres of mass of trunk, head and tail, each in its link."""
    centres: dict[str, Sequence[float]] = {"trunk": _mm(TRUNK_CENTRE)}
    if head_and_tail:
        centres |= {
            "neck 1": _mm((0, 0, 38)), "neck 2": _mm((0, 0, 19)),
            "head": (0.03, 0, 0.005), "jaw": (0.02, 0, 0.017), "tail": (-0.1, 0, 0.04),
        }  # fmt: skip
    return centres


def _masses(head_and_tail: bool, stated: Mapping[str, float]) -> dict[str, float]:
    """Give the mass of each link, those of a part of a leg for every leg."""
    for part in stated:
        if part not in MASSES:
            raise unknown_name("part of GIPO that has a mass", part, MASSES)
    by_part = {**MASSES, **stated}
    masses = {"trunk": by_part["trunk"]}
    masses |= {f"{leg} {part}": by_part[part] for leg in LEGS for part in ("hip", "abduction", "knee")}
    if head_and_tail:
        masses |= {name: by_part[name] for name, *_ in HEAD_AND_TAIL}
    return masses


def _middle(p: Sequence[float], q: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (0.5 * (a + b) for a, b in zip(p, q, strict=True))
    return (x, y, z)


def _tip(leg: str) -> tuple[float, float, float]:
    """Give the tip of a foot in the frame of its knee [m]."""
    side, end = leg.split()
    x, y, z = TIP[end]
    return _mm((x, y if side == "right" else -y, z))


def _mm(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (MM * v for v in values)
    return (x, y, z)
