"""The tripod: a platform for machining on three legs of two linear actuators each, which walks by locking joints.

No dimension is printed in the source: those here are ours. The rotation of the platform and of free feet is z-y-x,
`Rz(gamma) Ry(beta) Rx(alpha)`, as in the source.
"""

from __future__ import annotations

import math

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
from paraopt.robot import Robot
from paraopt.robots.base import drive_limits
from paraopt.shapes import Capsule, Cylinder, Shape, Sphere
from paraopt.spatial import transform

POSE = ("x", "y", "z", "alpha", "beta", "gamma")
LEGS = (1, 2, 3)


def tripod(
    radius: float = 0.15,
    half_angle: float = math.radians(20),
    foot_radius: float = 0.26,
    height: float = 0.32,
    stroke: tuple[float, float] = (0.25, 0.46),
    free_feet: bool = False,
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

    Args:
        radius: Radius of the circle of the points of attachment r_p [m].
        half_angle: Angle theta between P_L or P_R and the leg's direction [rad].
        foot_radius: Radius of the circle of the feet at home [m].
        height: Height of the platform above the feet at home [m].
        stroke: Least and greatest length of an actuator [m].
        free_feet: Whether each foot has a pose of its own, in variables "foot i x" ... "foot i gamma", which are then
            operational, as needed for walking; the feet stand still on the ground else.
        velocity: Largest speed of an actuator [m/s].
        acceleration: Largest acceleration of an actuator [m/s^2].
        jerk: Largest jerk of an actuator [m/s^3].

    Returns:
        The robot: 36 variables, 54 closure equations of rank 30, mobility 6; with free feet 54 variables and mobility
        24.

    Source: Tripod.
    """
    links: list[Link] = [Base(), Mobile("platform", order="zyx")]
    closures: list[Closure] = []
    home: dict[str, float] = {**dict.fromkeys(POSE, 0.0), "z": height}
    shapes: dict[str, list[Shape]] = {
        "base": [Cylinder(radius=1.6 * foot_radius, length=0.02, pose=transform((0, 0, -0.024)), name="ground")],
        "platform": [
            Cylinder(radius=0.9 * radius, length=0.02, name="platform"),
            Cylinder.between((0, 0, 0.01), (0, 0, 0.08), radius=0.03, name="spindle"),
            Cylinder.between((0, 0, -0.01), (0, 0, -0.1), radius=0.006, name="tool"),
        ],
    }
    operational = list(POSE)
    half_width = radius * math.sin(half_angle)
    centre = radius * math.cos(half_angle)
    length = math.hypot(foot_radius - centre, height)
    body = 0.9 * stroke[0]
    rod = stroke[1] - 0.95 * body  # at the longest the end of the body still holds it
    for i in LEGS:
        turn = (i - 1) * 2 * math.pi / 3
        at = (foot_radius * math.cos(turn), foot_radius * math.sin(turn), 0.0)
        if free_feet:
            links.append(Mobile(f"foot {i}", prefix=f"foot {i} ", order="zyx"))
            pose = (*at, 0.0, 0.0, math.remainder(turn, 2 * math.pi))
            home |= {f"foot {i} {c}": value for c, value in zip(POSE, pose, strict=True)}
            operational += [f"foot {i} {c}" for c in POSE]
        else:
            links.append(Series(f"foot {i}", "base", at, Fixed(), rotation=(0, 0, turn)))
        links += _equivalent_chain(i, stroke)
        # the end of the chain has its origin in P_C, x outwards, y towards P_L and z down on the platform
        closures.append(Weld(f"end {i}", "platform", (-centre, 0, 0), (math.pi, 0, -turn), f"end {i} = platform"))
        lean = math.atan2(foot_radius - centre, height)
        home |= {f"q1 {i}": 0.0, f"q2 {i}": lean, f"q3 {i}": 0.0}
        home |= {f"q4 {i}": length, f"q5 {i}": 0.0, f"q6 {i}": -lean}
        for side, sign in (("L", 1), ("R", -1)):
            pivot = Revolute(f"pivot {side} {i}", axis="x")
            slide = Prismatic(f"q{side} {i}", axis="z", range=stroke)
            links.append(Series(f"actuator {side} {i}", f"cross {i}", joint=pivot))
            links.append(Series(f"rod {side} {i}", f"actuator {side} {i}", joint=slide))
            closures.append(Coincidence(f"rod {side} {i}", (0, 0, 0), f"end {i}", (0, sign * half_width, 0)))
            home |= {f"pivot {side} {i}": 0.0, f"q{side} {i}": math.hypot(length, half_width)}
            shapes[f"actuator {side} {i}"] = [Capsule.between((0, 0, 0), (0, 0, body), radius=0.012)]
            shapes[f"rod {side} {i}"] = [Capsule.between((0, 0, -rod), (0, 0, 0), radius=0.006)]
        shapes[f"foot {i}"] = [Sphere(radius=0.014)]
    actuators = [f"q{side} {i}" for i in LEGS for side in "LR"]
    mechanism = Mechanism("tripod", links, closures, actuators, operational)
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
        contacts={("base", f"foot {i}"): "the foot stands on the ground" for i in LEGS},
        tool=("platform", (0, 0, -0.1)),
        source="Tripod (structure, conventions); all dimensions, strokes, drive limits, masses and solids are ours",
        # computed; six actuators and the six motions of a Stewart platform are the source's
        facts={
            "variables": 36 + extra, "equations": 54, "mobility": 6 + extra,
            "rank E": 30, "rank M": 6, "rank N": 24, "rank K": 18 if free_feet else 6, "idle": 0,
        },
    )  # fmt: skip


def _equivalent_chain(i: int, stroke: tuple[float, float]) -> list[Link]:
    """Describe the chain q1 ... q6 from foot i to its end in P_C.

    With v3 = unit(u x lc), u from P_L to P_R and lc from A to P_C, the frames have the axes (x, y, z): "turn" after q1
    (projection of v3, ., w_a); "cross" after q2 (-v3, ., w'); "aim" after q3 (-v3, ., lc); "swivel" after q5
    (v3, u, .); "end" after q6 (v_c, -u, .).
    """
    half_turn = math.pi
    return [
        Series(f"turn {i}", f"foot {i}", joint=Revolute(f"q1 {i}")),
        Series(f"cross {i}", f"turn {i}", joint=Revolute(f"q2 {i}", axis="y"), rotation=(0, 0, half_turn)),
        Series(f"aim {i}", f"cross {i}", joint=Revolute(f"q3 {i}", axis="x")),
        Series(f"reach {i}", f"aim {i}", joint=Prismatic(f"q4 {i}", range=(0.5 * stroke[0], 2 * stroke[1]))),
        Series(f"swivel {i}", f"reach {i}", joint=Revolute(f"q5 {i}", axis="x"), rotation=(0, 0, half_turn)),
        Series(f"end {i}", f"swivel {i}", joint=Revolute(f"q6 {i}", axis="y"), rotation=(half_turn, 0, 0)),
    ]
