"""The tripod: a platform for machining on three legs of two linear actuators each, which walks by locking joints.

No dimension is printed in the source: those here are ours. The rotation of the platform and of free feet is z-y-x,
`Rz(gamma) Ry(beta) Rx(alpha)`, as in the source.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from paraopt.mechanism import (
    Base,
    Closure,
    Coincidence,
    Fixed,
    Link,
    Mechanism,
    Mobile,
    Prismatic,
    Revolute,
    Series,
    Weld,
)
from paraopt.modes.legged.tripod import LEGS, POSE, TripodGeometry, WalkingTripod
from paraopt.robot import Robot
from paraopt.robots.base import drive_limits
from paraopt.scene import Scene
from paraopt.shapes import Capsule, Cylinder, Shape
from paraopt.spatial import transform

SOLE = 0.03  # height of a foot's frame above what it stands on [m]
BODY = 0.009  # radius of an actuator's body [m]
TOOL = 0.1  # length of the tool below the platform [m]


def tripod(
    geometry: TripodGeometry | None = None,
    free_feet: bool = False,
    ground: Sequence[Shape] | None = None,
    velocity: float = 0.2,
    acceleration: float = 1.0,
    jerk: float = 20.0,
) -> Robot:
    """Build the tripod on its three feet (the source's mode PP).

    Leg i holds the platform at P_L and P_R, at -`half_angle` and +`half_angle` about its direction `(i - 1) 120
    degrees` on a circle; P_C is the middle of both. Its foot frame has the origin A, the axis w_a up, and u_a
    outwards. Which side is L and where u_a points is not said in the source: so chosen, all angles are small at home.

    Its equivalent chain is described as it turns: "q1 i" about w_a, "q2 i" and "q3 i" complete the aim at P_C, "q4 i"
    is the distance from A to P_C, "q5 i" turns in the plane of the actuators, "q6 i" about P_L P_R; then the end of
    the chain is welded to the platform. So all joints that the source locks are variables, passive here. The signs
    are those of its closed forms: q2 and q3 turn about reversed axes, hence the half turns between the links. The
    actuators "qL i" and "qR i" are real chains: both pivot at A about the axis of q3, and end at P_L and P_R; as they
    stay in the leg's plane by construction, one equation in three of each is redundant.

    Level platforms on level ground are regular in this mode. In the source's mode BE, with joints locked, they are not.

    The solids: the actuators of a leg stand side by side on the foot's axle; their rods stay in the bodies at every
    length, and above the axle at the shortest. The frame of a foot is `SOLE` above the ground.

    Args:
        geometry: Dimensions, strokes and ranges of joints; those of `TripodGeometry()` when None.
        free_feet: Whether each foot has a pose of its own, in variables "foot i x" ... "foot i gamma", which are then
            operational, as needed for walking; the feet stand still on the ground else.
        ground: Solids of what it stands on, in the world; a plate under the feet at home when None.
        velocity: Largest speed of an actuator [m/s].
        acceleration: Largest acceleration of an actuator [m/s^2].
        jerk: Largest jerk of an actuator [m/s^3].

    Returns:
        The robot: 36 variables, 54 closure equations of rank 30, mobility 6; with free feet 54 variables and mobility
        24.

    Source: Tripod.
    """
    geometry = geometry or TripodGeometry()
    links: list[Link] = [Base(), Mobile("platform", order="zyx")]
    closures: list[Closure] = []
    home: dict[str, float] = dict(zip(POSE, geometry.home_pose.tolist(), strict=True))
    shapes: dict[str, list[Shape]] = {
        "base": list(ground) if ground is not None else [_plate(1.6 * geometry.foot_radius)],
        "platform": _platform_solids(geometry),
    }
    contacts: dict[tuple[str, str], str] = {}
    operational = list(POSE)
    centre = geometry.centre_radius
    for i in LEGS:
        turn, foot = geometry.azimuth(i), geometry.home_feet[i - 1]
        if free_feet:
            links.append(Mobile(f"foot {i}", prefix=f"foot {i} ", order="zyx"))
            home |= {f"foot {i} {c}": float(value) for c, value in zip(POSE, foot, strict=True)}
            operational += [f"foot {i} {c}" for c in POSE]
        else:
            x, y, z = foot[:3].tolist()
            links.append(Series(f"foot {i}", "base", (x, y, z), Fixed(), rotation=(0, 0, turn)))
        links += _equivalent_chain(i, geometry)
        # the end of the chain has its origin in P_C, x outwards, y towards P_L and z down on the platform
        closures.append(Weld(f"end {i}", "platform", (-centre, 0, 0), (math.pi, 0, -turn), f"end {i} = platform"))
        home |= {f"{q} {i}": value for q, value in geometry.home_joints.items()}
        for side, sign in (("L", 1), ("R", -1)):
            pivot = Revolute(f"pivot {side} {i}", axis="x")
            slide = Prismatic(f"q{side} {i}", axis="z", range=geometry.stroke)
            links.append(Series(f"actuator {side} {i}", f"cross {i}", joint=pivot))
            links.append(Series(f"rod {side} {i}", f"actuator {side} {i}", joint=slide))
            closures.append(Coincidence(f"rod {side} {i}", (0, 0, 0), f"end {i}", (0, sign * geometry.half_width, 0)))
            home |= {f"pivot {side} {i}": 0.0}
            body, rod = _actuator_solids(geometry, sign)
            shapes |= {f"actuator {side} {i}": [body], f"rod {side} {i}": [rod]}
            contacts[f"foot {i}", f"rod {side} {i}"] = "the rod stays in its body, above the foot's axle"
        shapes[f"end {i}"] = _bracket_solids(geometry, i)
        shapes[f"foot {i}"] = [Cylinder.between((0, 0, -SOLE), (0, 0, 0), radius=0.6 * SOLE)]
        contacts["base", f"foot {i}"] = "the foot stands on the ground"
        for one, other in (("actuator L", "rod R"), ("rod L", "actuator R"), ("rod L", "rod R")):
            contacts[f"{one} {i}", f"{other} {i}"] = "they move in parallel planes, side by side on one axle"
    actuators = [f"q{side} {i}" for i in LEGS for side in "LR"]
    mechanism = Mechanism("tripod", links, closures, actuators, operational, characteristic_length=geometry.radius)
    extra = 18 if free_feet else 0
    return Robot(
        mechanism,
        home=home,
        shapes=shapes,
        limits=drive_limits(actuators, velocity, acceleration, jerk),
        masses={
            "platform": 6.0, **{f"foot {i}": 0.5 for i in LEGS},
            **{f"actuator {s} {i}": 0.8 for i in LEGS for s in "LR"},
            **{f"rod {s} {i}": 0.3 for i in LEGS for s in "LR"},
        },
        contacts=contacts,
        tool=("platform", (0, 0, -TOOL)),
        source="Tripod (structure, conventions); all dimensions, strokes, ranges, limits, masses and solids are ours",
        # computed; six actuators and the six motions of a Stewart platform are the source's
        facts={
            "variables": 36 + extra, "equations": 54, "mobility": 6 + extra,
            "rank E": 30, "rank M": 6, "rank N": 24, "rank K": 18 if free_feet else 6, "idle": 0,
        },
    )  # fmt: skip


def walking_tripod(
    geometry: TripodGeometry | None = None,
    obstacles: Sequence[Shape] = (),
    ground: Sequence[Shape] | None = None,
    velocity: float = 0.2,
    acceleration: float = 1.0,
    jerk: float = 20.0,
) -> WalkingTripod:
    """Build the tripod with free feet in its scene, ready to walk and to machine.

    Args:
        geometry: Dimensions, strokes and ranges of joints; those of `TripodGeometry()` when None.
        obstacles: What stands around, in the world.
        ground: Solids of what it stands on; a plate of a metre around home when None.
        velocity: Largest speed of an actuator [m/s].
        acceleration: Largest acceleration of an actuator [m/s^2].
        jerk: Largest jerk of an actuator [m/s^3].

    Returns:
        The machine; the soles of its feet are `SOLE` below their frames.

    Source: Tripod.
    """
    geometry = geometry or TripodGeometry()
    plate = [_plate(geometry.foot_radius + 1.0)] if ground is None else ground
    robot = tripod(geometry, True, plate, velocity, acceleration, jerk)
    return WalkingTripod(geometry, Scene(robot, obstacles), (0.0, 0.0, -SOLE))


def _plate(radius: float) -> Shape:
    return Cylinder(radius=radius, length=0.02, pose=transform((0, 0, -SOLE - 0.01)), name="ground")


def _platform_solids(geometry: TripodGeometry) -> list[Shape]:
    return [
        Cylinder(radius=0.8 * geometry.centre_radius, length=0.016, name="platform"),
        Cylinder.between((0, 0, 0.008), (0, 0, 0.08), radius=0.03, name="spindle"),
        Cylinder.between((0, 0, -0.008), (0, 0, -TOOL), radius=0.006, name="tool"),
    ]


def _bracket_solids(geometry: TripodGeometry, i: int) -> list[Shape]:
    """Give the axle from P_L to P_R and the arm that holds it on the platform."""
    d, inwards = geometry.half_width, -0.25 * geometry.centre_radius
    return [
        Capsule.between((0, -d, 0), (0, d, 0), radius=0.7 * BODY, name=f"axle {i}"),
        Capsule.between((inwards, 0, 0), (0, 0, 0), radius=0.7 * BODY, name=f"arm {i}"),
    ]


def _actuator_solids(geometry: TripodGeometry, sign: int) -> tuple[Shape, Shape]:
    """Give the body and the rod of an actuator, aside of the leg's plane by the body's radius."""
    shortest, longest = geometry.stroke
    aside = sign * BODY
    top = shortest - 2.75 * BODY  # it keeps off the platform's axle at the shortest
    body = Capsule.between((aside, 0, 0), (aside, 0, top), radius=BODY)
    rod = Capsule.between((aside, 0, top - BODY - longest), (aside, 0, 0), radius=0.5 * BODY)
    return body, rod


def _equivalent_chain(i: int, geometry: TripodGeometry) -> list[Link]:
    """Describe the chain q1 ... q6 from foot i to its end in P_C.

    With v3 = unit(u x lc), u from P_L to P_R and lc from A to P_C, the frames have the axes (x, y, z): "turn" after q1
    (projection of v3, ., w_a); "cross" after q2 (-v3, ., w'); "aim" after q3 (-v3, ., lc); "swivel" after q5
    (v3, u, .); "end" after q6 (v_c, -u, .).
    """
    half_turn = math.pi
    ranges = geometry.joint_ranges

    def revolute(name: str, axis: str) -> Revolute:
        return Revolute(f"{name} {i}", axis=axis, range=ranges[name])

    return [
        Series(f"turn {i}", f"foot {i}", joint=revolute("q1", "z")),
        Series(f"cross {i}", f"turn {i}", joint=revolute("q2", "y"), rotation=(0, 0, half_turn)),
        Series(f"aim {i}", f"cross {i}", joint=revolute("q3", "x")),
        Series(f"reach {i}", f"aim {i}", joint=Prismatic(f"q4 {i}", range=ranges["q4"])),
        Series(f"swivel {i}", f"reach {i}", joint=revolute("q5", "x"), rotation=(0, 0, half_turn)),
        Series(f"end {i}", f"swivel {i}", joint=revolute("q6", "y"), rotation=(half_turn, 0, 0)),
    ]
