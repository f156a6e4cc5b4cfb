"""Planar platforms with three legs of three joints each: 18 types of legs, 1140 machines, and what decides about them.

A leg is a sequence of revolute (R) and prismatic (P) joints from the base to the platform, one of them driven. The
literature underlines the driven joint; here it stands between underscores, as in plain text: `R_P_R` is a leg with a
driven slide between two free hinges.

Which 18: of the eight sequences PPP cannot turn the platform; seven remain, with 21 choices of the driven joint. With
its drive held, a leg is a chain of the two other joints. When they are RR it pushes the platform along the line through
both hinges, when they are PR or RP along the line through the hinge across the slide. When they are PP (`_R_PP`,
`P_R_P`, `PP_R_`) the leg holds the rotation of the platform and nothing else: the source rejects these three, and six
types of each other kind remain. Three legs are chosen with repetition and without order: C(18 + 2, 3) = 1140.

The source prints no dimensions. Ours are generic: no slides are parallel at home, the triangles of base and platform
are not similar, no leg is stretched out. They were found by a random search for the largest of the smallest margins to
singularities at home over the 1140 machines, legs in the order of `LEG_TYPES`, and then rounded; in another order a
machine is as regular but may stand closer to a singularity at home.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics import Configuration, Kinematics, compute_rank
from paraopt.mechanism import Base, Closure, Joint, Link, Mechanism, Mobile, Prismatic, Revolute, Series, Weld
from paraopt.robot import Limits, Robot
from paraopt.shapes import Capsule, Cylinder, Shape

Point = tuple[float, float]
Triangle = tuple[Point, Point, Point]
Array = NDArray[np.float64]

# The source's table by columns: what remains of the leg when its drive is held is RR, PR, RP.
LEG_TYPES = (
    "_R_RR", "R_R_R", "RR_R_", "_P_RR", "R_P_R", "RR_P_",
    "_R_PR", "P_R_R", "PR_R_", "_P_PR", "P_P_R", "PR_P_",
    "_R_RP", "R_R_P", "RP_R_", "_P_RP", "R_P_P", "RP_P_",
)  # fmt: skip
# What remains is PP: rejected by the source, buildable here to show why.
REJECTED_LEG_TYPES = ("_R_PP", "P_R_P", "PP_R_")

# Where the joints of a leg sit: hinges at A (base), C (elbow) and B (platform), slides a (from A to C) and b (from C
# to B). A leg RPR is straight: its slide runs from A to B.
_PLACES = {"RRR": "ACB", "RPR": "AaB", "RRP": "ACb", "PRR": "aCB", "RPP": "Aab", "PRP": "aCb", "PPR": "abB"}
# Solutions of one leg for a given pose; a stroke and its opposite with the leg turned by half a turn are one.
_WORKING_MODES = {"RRR": 2, "RRP": 2, "PRR": 2, "RPR": 1, "RPP": 1, "PRP": 1, "PPR": 1}


def planar_platform(
    leg_1: str = "R_P_R",
    leg_2: str = "R_P_R",
    leg_3: str = "R_P_R",
    base: Triangle = ((-0.54, -0.07), (0.44, -0.43), (-0.10, 0.55)),
    platform: Triangle = ((-0.12, -0.22), (0.17, -0.16), (-0.19, 0.07)),
    elbows: Triangle = ((0.34, -0.115), (0.44, 0.12), (0.44, 0.105)),
    pose: tuple[float, float, float] = (0.04, 0.02, 0.31),
    radius: float = 0.01,
) -> Robot:
    """Build a planar platform from the types of its three legs.

    Every leg is a chain of three links whose last one is welded to the platform, so that all nine joints are variables:
    leg 1 has `R1.1`, `P1.2`, `R1.3` when it is `R_P_R`. A slide's stroke is the distance between the points that it
    joins. The legs and the platform run on levels of their own and cannot touch each other.

    Args:
        leg_1: Type of the first leg, one of `LEG_TYPES` or `REJECTED_LEG_TYPES`.
        leg_2: Type of the second leg.
        leg_3: Type of the third leg.
        base: Where the legs start, in the base [m].
        platform: Where they end, in the platform [m].
        elbows: Elbow of each leg at home: share of the way from its start to its end, and how far to the left of that
            line in lengths of it; a straight leg RPR has none.
        pose: The platform at home: x [m], y [m], theta [rad].
        radius: Radius of bars and rods [m]; a level is three of them high.

    Returns:
        The robot: 12 variables, 12 equations of rank 9 (a weld of the plane has 4 of rank 3), mobility 3.

    Raises:
        UnknownNameError: A leg has none of the 21 types.
        DefinitionError: A part of a leg has no length.

    Source: Lahouar, I.2.1.2, table I.1 (types of legs).
    """
    x, y, theta = pose
    links: list[Link] = [Base()]
    closures: list[Closure] = []
    shapes: dict[str, list[Shape]] = {}
    active: list[str] = []
    home: dict[str, float] = {"x": x, "y": y, "theta": theta}
    for i, leg in enumerate((leg_1, leg_2, leg_3)):
        if leg not in (*LEG_TYPES, *REJECTED_LEG_TYPES):
            raise unknown_name("type of leg", leg, (*LEG_TYPES, *REJECTED_LEG_TYPES))
        end = np.add((x, y), _turn(platform[i], theta))
        builder = _LegBuilder(i + 1, leg, (base[i], end, elbows[i]), theta, radius)
        closures.append(builder.build(platform[i], links, shapes, home))
        active.append(builder.driven)
    links.append(Mobile("platform"))
    shapes["platform"] = [
        Capsule.between((*platform[i], 0), (*platform[i - 1], 0), 1.2 * radius, f"platform side {i + 1}")
        for i in range(3)
    ]
    mechanism = Mechanism(name_platform(leg_1, leg_2, leg_3), links, closures, active, ("x", "y", "theta"), planar=True)
    slides = [name for name in active if name.startswith("P")]
    sequences = [leg.replace("_", "") for leg in (leg_1, leg_2, leg_3)]
    return Robot(
        mechanism,
        home=home,
        shapes=shapes,
        limits=Limits(
            velocity={name: 0.5 if name in slides else 2.0 for name in active},
            acceleration={name: 2.0 if name in slides else 10.0 for name in active},
            jerk={name: 40.0 if name in slides else 200.0 for name in active},
        ),
        source="Lahouar, I.2.1.2 (types of legs); dimensions, limits and solids are ours",
        # by analysis, none printed; ranks are those of a generic pose
        facts={
            "variables": 12, "equations": 12, "rank E": 9, "rank M": 3, "rank N": 6, "rank K": 3, "mobility": 3,
            "idle": 0, "working modes": math.prod(_WORKING_MODES[s] for s in sequences),
        },
    )  # fmt: skip


def name_platform(*legs: str) -> str:
    """Name a machine by its legs, as "RRR-RRP-RPR driven at 1, 3, 2": joints from the base, and which are driven."""
    joints = "-".join(leg.replace("_", "") for leg in legs)
    return f"{joints} driven at {', '.join(str(leg.index('_') + 1) for leg in legs)}"


def planar_platforms(legs: Iterable[str] = LEG_TYPES) -> Iterator[tuple[str, str, str]]:
    """List the ways to choose three legs with repetition and without order: 1140 for the 18 types.

    Args:
        legs: Types to choose from.

    Yields:
        Types of the three legs.

    Source: Lahouar, I.1.
    """
    yield from combinations_with_replacement(tuple(legs), 3)


def passive_chain(leg: str) -> str:
    """Tell which two joints of a leg stay free when its drive is held: "RR", "PR", "RP" or "PP"."""
    before, _, after = leg.split("_")
    return before + after


@dataclass(frozen=True)
class PlatformReport:
    """Report what is true of a machine at every pose, judged from the largest ranks over random poses.

    Attributes:
        name: Name of the mechanism.
        residual: Largest scaled closure residual at home [1].
        poses: Number of random poses that were reached, home not counted.
        mobility: Degrees of freedom at a generic pose.
        parallel_margin: Distance to a parallel singularity at home [1].
        serial_margin: Distance to a serial singularity at home [1].
        reason: Why the machine is no platform with three degrees of freedom that its drives control; empty if it is.
        drives: Names of the drives that act alike on the platform, when that is the reason.
    """

    name: str
    residual: float
    poses: int
    mobility: int
    parallel_margin: float
    serial_margin: float
    reason: str
    drives: tuple[str, ...] = ()


def analyse_platform(robot: Robot, poses: int = 6, spread: float = 0.15, seed: int = 0) -> PlatformReport:
    """Judge a machine from the ranks of its equations at home and at random poses around it.

    A rank that is lower at every pose than it may be is a property of the architecture, since a generic pose has the
    largest one. In this order: `m = N - rg(E)` must be 3; rg[N K] must be rg(E), else the platform moves while the
    drives are held (an architectural parallel singularity); rg[M N] must be rg(E), else the drives move while the
    platform is held (a serial one).

    Args:
        robot: Any planar machine with the operational variables x, y and theta.
        poses: Number of random poses to reach, from four times as many tries; those that are missing are looked for by
            moving the drives.
        spread: Largest shift from home in characteristic lengths, and largest turn in multiples of 2 rad.
        seed: Seed of the poses.

    Returns:
        What was found, with the reason when the machine is an exception.

    Raises:
        SolveError: The machine cannot be assembled at home.

    Source: Lahouar, II.22; Lahouar, II.26; Lahouar, II.27.
    """
    mechanism = robot.mechanism
    if set(mechanism.operational) != {"x", "y", "theta"}:
        raise DefinitionError(f"operational variables of {robot.name!r} are {mechanism.operational}, not x, y, theta")
    kinematics = Kinematics(mechanism, backend="virtual machine")  # used once: compiling would take longer
    names = mechanism.operational
    home = kinematics.inverse({name: robot.home[name] for name in names}, start=robot.home).configuration
    found = [home, *_sample(kinematics, home, names, poses, spread, seed)]
    if len(found) <= poses:  # where the legs hinder some poses, the drives still move
        found += _sample(kinematics, home, mechanism.active, poses + 1 - len(found), spread, seed)
    # the ranks of a full report of the state, without what else it finds out
    (E,) = kinematics.functions.scaled_jacobian.batch(np.array([configuration.X for configuration in found]))
    drives_end, passive_end = len(mechanism.active), E.shape[2] - len(names)
    columns = (slice(None), slice(drives_end, None), slice(None, passive_end))
    rank, rank_held, rank_still = (max(compute_rank(sample[:, c]).value for sample in E) for c in columns)
    # as for any robot, the smallest singular values of the rows of an orthonormal basis of the motions
    motions = scipy.linalg.null_space(E[0], rcond=1e-9)
    parallel, serial = (
        np.linalg.svd(motions[c], compute_uv=False)[-1] for c in (slice(drives_end), slice(passive_end, None))
    )
    mobility, reason = len(mechanism.names) - rank, ""
    drives: tuple[str, ...] = ()
    if mobility != 3:
        reason = f"it has {mobility} degrees of freedom at every pose"
    elif rank_held < rank:
        drives, turns = _find_conflict(kinematics, found)
        motion = "turns" if turns else "slides without turning"
        reason = f"with its drives held the platform {motion} at every pose ({_freedoms(rank - rank_held)})"
    elif rank_still < rank:
        reason = f"with its platform held the drives move at every pose ({_freedoms(rank - rank_still)})"
    return PlatformReport(
        robot.name, home.residual, len(found) - 1, mobility,
        float(parallel), float(serial), reason, drives,
    )  # fmt: skip


def _sample(
    kinematics: Kinematics, home: Configuration, names: Sequence[str], count: int, spread: float, seed: int
) -> list[Configuration]:
    """Close the loops at random values of some variables around home, from four times as many tries."""
    variables = kinematics.mechanism.variables
    at = kinematics.mechanism.indices(names)
    size = spread * np.array([2.0 if variables[i].kind == "angle" else kinematics.mechanism.length for i in at])
    values = home.X[at] + np.random.default_rng(seed).uniform(-size, size, size=(4 * count, len(at)))
    batch = kinematics.solve_batch(names, values, np.tile(home.X, (len(values), 1)))
    return [kinematics.configuration(X) for X in batch.X[batch.converged][:count]]


def _find_conflict(kinematics: Kinematics, found: Sequence[Configuration]) -> tuple[tuple[str, ...], bool]:
    """Name the drives that push against each other while nothing loads the platform, and tell whether it can turn."""
    mechanism = kinematics.mechanism
    strength = np.zeros(len(mechanism.active))
    turns = False
    for configuration in found:
        M, N, K = kinematics.jacobians(configuration.X)
        held = np.hstack([N, K])
        # forces in the closures that balance on passive joints and platform, hence only drives feel them
        forces = M.T @ scipy.linalg.null_space(held.T, rcond=1e-9)
        strength = np.maximum(strength, np.linalg.norm(forces, axis=1))
        motions = scipy.linalg.null_space(held, rcond=1e-9)
        turns |= bool(np.max(np.abs(motions[N.shape[1] + mechanism.operational.index("theta")])) > 1e-6)
    return tuple(name for name, s in zip(mechanism.active, strength, strict=True) if s > 1e-6), turns


def _freedoms(count: int) -> str:
    return f"{count} freedom" if count == 1 else f"{count} freedoms"


def _turn(point: Sequence[float], angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * point[0] - s * point[1], s * point[0] + c * point[1]])


class _LegBuilder:
    """Lay the joints of one leg along the line from its start over its elbow to its end, as they stand at home."""

    def __init__(
        self, number: int, leg: str, points: tuple[Sequence[float], Array, Point], theta: float, radius: float
    ) -> None:
        self.number, self.theta, self.radius = number, theta, radius
        self.sequence = leg.replace("_", "")
        self.driven = f"{leg[leg.index('_') + 1]}{number}.{leg.index('_') + 1}"
        start, end, (share, aside) = np.asarray(points[0], dtype=float), points[1], points[2]
        line = end - start
        elbow = start + share * line + aside * _turn(line, math.pi / 2)
        straight = self.sequence == "RPR"
        corners = [start, end] if straight else [start, elbow, end]
        self.parts = [b - a for a, b in pairwise(corners)]
        if not all(np.linalg.norm(part) > 1e-9 for part in self.parts):
            raise DefinitionError(f"leg {number}, {leg!r}, has a part of no length; move its elbow or its ends")
        self.stops = "AaB" if straight else "AaCbB"
        # the cursor: link reached so far, where on it, turned how much, and how that link is turned at home
        self.link, self.at, self.turned, self.heading = "base", start, 0.0, 0.0

    def build(self, hold: Point, links: list[Link], shapes: dict[str, list[Shape]], home: dict[str, float]) -> Closure:
        """Add the leg's links, solids and values at home, and give the weld that ties it to the platform."""
        directions = [math.atan2(part[1], part[0]) for part in self.parts] + [self.theta]
        for stop in self.stops:
            place = _PLACES[self.sequence].find(stop)
            if stop.isupper():
                wanted = directions.pop(0)
                if place >= 0:
                    value = math.remainder(wanted - self.heading - self.turned, 2 * math.pi)
                    self._step(Revolute(self._name("R", place)), links, home, value)
                    self.heading = wanted
                else:
                    self.turned = wanted - self.heading
                continue
            part = self.parts[0 if stop == "a" else 1]
            length, level = float(np.linalg.norm(part)), 3 * self.radius * (2 * self.number - (stop == "a"))
            if place >= 0:
                self._add_bar(shapes, self.at, 0.75 * length, self.turned, level)
                # at both ends of the stroke a quarter of the rod is out behind, or still in the barrel
                slide = Prismatic(self._name("P", place), axis="x", range=(0.5 * length, 1.5 * length))
                heading = self.heading + self.turned
                self._step(slide, links, home, length)
                self.heading = heading
                self._add_bar(shapes, np.array([-0.75 * length, 0.0]), 0.75 * length, 0.0, level)
            else:
                self._add_bar(shapes, self.at, length, self.turned, level)
                self.at = self.at + _turn((length, 0.0), self.turned)
        if self.link not in shapes:
            self._add_pin(shapes, level)
        x, y = (self.at - _turn(hold, self.turned)).tolist()
        return Weld(self.link, "platform", at=(x, y), rotation=(0, 0, self.turned))

    def _name(self, kind: str, place: int) -> str:
        return f"{kind}{self.number}.{place + 1}"

    def _step(self, joint: Joint, links: list[Link], home: dict[str, float], value: float) -> None:
        """Add the link that the joint carries, and move the cursor to its origin."""
        (motion,) = joint.motions
        name = f"leg {motion.name[1:]}"
        links.append(Series(name, self.link, self.at.tolist(), joint, rotation=(0, 0, self.turned)))
        home[motion.name] = value
        self.link, self.at, self.turned = name, np.zeros(2), 0.0

    def _add_pin(self, shapes: dict[str, list[Shape]], level: float) -> None:
        """Give the last link, which only carries the hinge on the platform, the piece of its pin at the leg's level."""
        x, y = self.at.tolist()
        low, high = (x, y, level - self.radius), (x, y, level + self.radius)
        shapes[self.link] = [Cylinder.between(low, high, 0.6 * self.radius)]

    def _add_bar(
        self, shapes: dict[str, list[Shape]], start: Array, length: float, direction: float, level: float
    ) -> None:
        end = start + _turn((length, 0.0), direction)
        first, last = ((float(p[0]), float(p[1]), level) for p in (start, end))
        solids = shapes.setdefault(self.link, [])
        solids.append(Capsule.between(first, last, self.radius, f"{self.link} bar {self.number}{len(solids) + 1}"))
