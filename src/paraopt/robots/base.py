"""What several spatial robots of the library are made of: legs that stretch, arms that turn and push rods, plates.

Every builder returns `Parts`: links, closures, solids, and values from which the loops can be closed at home. Angles
of a leg are chosen so that they are regular where the machine works: a leg that stands upright turns about x, then y;
a rod that hangs from an arm turns about the axis of the arm's joint first, then across it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.mechanism import Closure, Coincidence, Joint, Link, Prismatic, Revolute, Series, Spherical, Universal
from paraopt.robot import Limits
from paraopt.shapes import Capsule, Shape

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Parts:
    """Hold a piece of a machine.

    Attributes:
        links: Its links.
        closures: The closures that tie it to the rest.
        shapes: Solids by name of link.
        masses: Masses by name of link [kg].
        start: Values of its variables near home [m or rad].
    """

    links: tuple[Link, ...] = ()
    closures: tuple[Closure, ...] = ()
    shapes: Mapping[str, Sequence[Shape]] = field(default_factory=dict)
    masses: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)

    def __add__(self, other: Parts) -> Parts:
        return Parts(
            self.links + other.links,
            self.closures + other.closures,
            {**self.shapes, **other.shapes},
            {**self.masses, **other.masses},
            {**self.start, **other.start},
        )


def as_xyz(values: Sequence[float] | NDArray[np.float64]) -> Point:
    """Read three coordinates [m]."""
    x, y, z = (float(v) for v in values)
    return (x, y, z)


def ring(radius: float, azimuths: Sequence[float], height: float = 0.0) -> tuple[Point, ...]:
    """Place points on a circle about z.

    Args:
        radius: Radius of the circle [m].
        azimuths: Angle of each point from x about z [rad].
        height: Their z [m].
    """
    return tuple((radius * math.cos(a), radius * math.sin(a), height) for a in azimuths)


def paired_azimuths(half_angle: float, middle: float = 0.0) -> tuple[float, ...]:
    """List the azimuths of three pairs of points [rad], 120 degrees apart, as two for each pair: minus, plus.

    Args:
        half_angle: Half the angle between the points of a pair [rad].
        middle: Azimuth of the middle of the first pair [rad].
    """
    thirds = [middle + 2 * math.pi * k / 3 for k in range(3)]
    return tuple(t + s * half_angle for t in thirds for s in (-1.0, 1.0))


def aim_upright(direction: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
    """Give the angles a, b with `Rx(a) Ry(b) e_z` along a direction whose z is not negative [rad]."""
    x, y, z = np.asarray(direction) / np.linalg.norm(direction)
    return math.atan2(-y, z), math.asin(x)


def drive_limits(names: Sequence[str], velocity: float, acceleration: float, jerk: float) -> Limits:
    """Give the same limits to several drives."""
    return Limits(
        velocity=dict.fromkeys(names, velocity),
        acceleration=dict.fromkeys(names, acceleration),
        jerk=dict.fromkeys(names, jerk),
    )


def check_count(what: str, given: Sequence[object], wanted: int) -> None:
    """Refuse a list of the wrong size.

    Raises:
        DefinitionError: There are not as many as wanted.
    """
    if len(given) != wanted:
        raise DefinitionError(f"there are {len(given)} {what}; the machine needs {wanted}")


# --- Legs that stretch


def telescope(
    key: str, lengths: tuple[float, float], radius: float, body_mass: float = 1.0, rod_mass: float = 0.4
) -> Parts:
    """Give the solids and masses of a jack: `leg <key>` holds the body, `rod <key>` what slides in it.

    The jack runs along z from its joint; the origin of the rod is its tip. The body is 0.9 of the shortest length, and
    the rod as long as it must be to stay in the body at the longest: at the shortest its end keeps off the joint.

    Args:
        key: What follows "leg" and "rod" in the names.
        lengths: Shortest and longest distance from the joint to the tip [m]; the second at most 1.7 times the first.
        radius: Radius of the body [m]; the rod's is half of it.
        body_mass: Mass of the body [kg].
        rod_mass: Mass of the rod [kg].

    Raises:
        DefinitionError: The lengths do not fit into one another.
    """
    shortest, longest = lengths
    body = 0.9 * shortest
    reach = longest - 0.9 * body
    if not 0 < shortest < longest <= 1.7 * shortest:
        raise DefinitionError(
            f"lengths of leg {key!r} are {lengths} m; the longest must lie between 1 and 1.7 times the shortest"
        )
    return Parts(
        shapes={
            f"leg {key}": [Capsule.between((0, 0, 0), (0, 0, body), radius)],
            f"rod {key}": [Capsule.between((0, 0, -reach), (0, 0, 0), 0.5 * radius)],
        },
        masses={f"leg {key}": body_mass, f"rod {key}": rod_mass},
    )


def upright_leg(
    key: str,
    base: str,
    at: Point,
    platform: str,
    point: Point,
    towards: Sequence[float] | NDArray[np.float64],
    lengths: tuple[float, float],
    radius: float,
    spherical_base: bool = False,
) -> Parts:
    """Build a leg that stretches: `Rx Ry` at the base, a prismatic joint along z, a coincidence at the platform.

    The stroke `q<key>` is the length of the leg.

    Args:
        key: What follows "leg", "rod" and "q" in the names.
        base: Name of the link that it stands on.
        at: Its foot on that link [m].
        platform: Name of the link that it holds.
        point: Its end on that link [m].
        towards: Way from the foot to the end at home, in the frame of `base` [m].
        lengths: Shortest and longest length [m].
        radius: Radius of the body [m].
        spherical_base: Whether the foot may also spin about the leg: an idle freedom.

    Source: Lahouar, II.3; Lahouar, annex B.
    """
    stem = f"leg {key}"
    foot: Joint = Spherical(stem) if spherical_base else Universal(stem, ("x", "y"))
    a, b = aim_upright(towards)
    built = Parts(
        links=(
            Series(stem, base, at, foot),
            Series(f"rod {key}", stem, joint=Prismatic(f"q{key}", axis="z", range=lengths)),
        ),
        closures=(Coincidence(f"rod {key}", (0, 0, 0), platform, point),),
        start={f"{stem}.x": a, f"{stem}.y": b, f"q{key}": float(np.linalg.norm(towards))},
    )
    return built + telescope(key, lengths, radius)


def six_legs(
    base: str,
    base_points: Sequence[Point],
    platform: str,
    platform_points: Sequence[Point],
    rise: float,
    stroke: float,
    radius: float,
    stage: str = "",
    spherical_base: bool = False,
) -> Parts:
    """Build six legs that stretch between two links.

    Args:
        base: Name of the lower link.
        base_points: Feet of the legs on it [m], six of them.
        platform: Name of the upper link.
        platform_points: Ends of the legs on it [m], six of them.
        rise: Height of the platform's origin above the base's at home [m].
        stroke: How much each leg stretches beyond and shrinks below its length at home, as a share of it [1].
        radius: Radius of the bodies [m].
        stage: Put before the number of each leg.
        spherical_base: See `upright_leg`.

    Raises:
        DefinitionError: There are not six points, or the stroke is too long for the legs.
    """
    check_count("base points", base_points, 6)
    check_count("platform points", platform_points, 6)
    built = Parts()
    for i, (at, point) in enumerate(zip(base_points, platform_points, strict=True), start=1):
        way = np.asarray(point) + np.array((0, 0, rise)) - np.asarray(at)
        length = float(np.linalg.norm(way))
        lengths = ((1 - stroke) * length, (1 + stroke) * length)
        built += upright_leg(f"{stage}{i}", base, at, platform, point, way, lengths, radius, spherical_base)
    return built


# --- Arms that turn, and the rods that they push


def name_drive(symbol: str, key: str) -> str:
    """Name a variable by its symbol and the key of its leg: "theta1", but "theta a1"."""
    return f"{symbol} {key}" if key[:1].isalpha() else f"{symbol}{key}"


def arm_with_rods(
    key: str,
    base: str,
    at: Point,
    azimuth: float,
    arm_length: float,
    platform: str,
    rods: Mapping[str, tuple[float, Sequence[float] | NDArray[np.float64]]],
    rod_length: float,
    shift: Sequence[float] | NDArray[np.float64],
    radius: float,
    spherical_elbow: bool = False,
    elbow_out: bool = True,
) -> Parts:
    """Build an arm that turns about a horizontal axis, and rods that hang from its elbow and hold the platform.

    The frame of the arm has x along the arm and y along the axis of its joint. At `theta<key> = 0` the arm points
    outwards, level; it goes down as the angle grows. A rod hangs along -z of its frame, which turns about y and x.

    Args:
        key: What follows "arm" and "theta" in the names, after "theta" with a space when it begins with a letter.
        base: Name of the link that carries the arm.
        at: Its joint on that link [m].
        azimuth: Direction in which the arm points, about z [rad].
        arm_length: Distance from the joint to the elbow [m].
        platform: Name of the link that the rods hold.
        rods: For each rod the name, its place on the elbow's axis (along y of the arm) [m] and its point on the
            platform [m].
        rod_length: Length of the rods [m].
        shift: Origin of the platform in the frame of `base` at home, where both are parallel [m].
        radius: Radius of the arm [m]; the rods' is half of it.
        spherical_elbow: Whether the rods may also spin about themselves: idle freedoms.
        elbow_out: Which of the two postures the home is in: the elbow further from the axis of the machine or nearer.

    Raises:
        DefinitionError: The arm and a rod cannot reach the platform at home.
    """
    stem, drive = f"arm {key}", name_drive("theta", key)
    ey, ez = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    ex = np.cross(ey, ez)
    links: list[Link] = [Series(stem, base, at, Revolute(drive, axis="y"), rotation=(0, 0, azimuth))]
    closures: list[Closure] = []
    shapes: dict[str, list[Shape]] = {stem: [Capsule.between((0, 0, 0), (arm_length, 0, 0), radius, name=stem)]}
    places = [place for place, _ in rods.values()]
    if max(places) > min(places):
        bar = Capsule.between((arm_length, min(places), 0), (arm_length, max(places), 0), 0.75 * radius, f"{stem} bar")
        shapes[stem].append(bar)
    start: dict[str, float] = {}
    for name, (place, point) in rods.items():
        rod = f"rod {name}"
        elbow: Joint = Spherical(rod, order="yxz") if spherical_elbow else Universal(rod, ("y", "x"))
        links.append(Series(rod, stem, (arm_length, place, 0), elbow))
        closures.append(Coincidence(rod, (0, 0, -rod_length), platform, as_xyz(point)))
        shapes[rod] = [Capsule.between((0, 0, 0), (0, 0, -rod_length), 0.5 * radius)]
        way = np.asarray(shift) + np.asarray(point) - np.asarray(at)
        u, v, w = float(way @ ex), float(way @ ey) - place, float(way @ ez)
        # in the plane of the arm: two circles about its joint and about the rod's end
        flat2, far = rod_length**2 - v**2, math.hypot(u, w)
        cosine = (arm_length**2 + far**2 - flat2) / (2 * arm_length * far) if far > 0 else math.inf
        if flat2 <= 0 or not abs(cosine) <= 1:
            raise DefinitionError(
                f"arm {key!r} of {arm_length} m and rod {name!r} of {rod_length} m cannot reach the platform at home, "
                f"{math.hypot(far, v):.6g} m from the arm's joint"
            )
        towards, opening = math.atan2(-w, u), math.acos(cosine)
        theta = min((towards - opening, towards + opening), key=math.cos)
        if elbow_out:
            theta = max((towards - opening, towards + opening), key=math.cos)
        along, down = u - arm_length * math.cos(theta), -w - arm_length * math.sin(theta)
        start |= {
            drive: theta,
            # Ry(theta + a) Rx(b) (-e_z) = (-sin(theta + a) cos b, sin b, -cos(theta + a) cos b)
            f"{rod}.y": math.atan2(-along, down) - theta,
            f"{rod}.x": math.asin(v / rod_length),
        }
    masses = {stem: 1.0, **{f"rod {name}": 0.2 for name in rods}}
    return Parts(tuple(links), tuple(closures), shapes, masses, start)


def delta_legs(
    base: str,
    platform: str,
    base_radius: float,
    platform_radius: float,
    arm_length: float,
    rod_length: float,
    spacing: float,
    shift: Sequence[float],
    radius: float,
    stage: str = "",
    azimuth: float = 0.0,
    spherical_elbow: bool = False,
) -> Parts:
    """Build the three arms of a Delta with their parallelograms: two rods of equal length from each elbow.

    Args:
        base: Name of the link that carries the arms.
        platform: Name of the link that the rods hold.
        base_radius: Distance of the arms' joints from the axis of the machine [m].
        platform_radius: Distance of the middle between two rods' ends from the platform's origin [m].
        arm_length: Length of the arms [m].
        rod_length: Length of the rods [m].
        spacing: Distance between the rods of a parallelogram [m].
        shift: Origin of the platform in the frame of `base` at home [m].
        radius: Radius of the arms [m].
        stage: Put before the number of each arm.
        azimuth: Azimuth of the first arm [rad].
        spherical_elbow: See `arm_with_rods`.
    """
    built = Parts()
    for i in (1, 2, 3):
        turn = azimuth + 2 * math.pi * (i - 1) / 3
        out, across = np.array(ring(1.0, (turn, turn + math.pi / 2)))
        rods = {
            f"{stage}{i}{side}": (0.5 * sign * spacing, platform_radius * out + 0.5 * sign * spacing * across)
            for side, sign in (("+", 1.0), ("-", -1.0))
        }
        built += arm_with_rods(
            f"{stage}{i}", base, as_xyz(base_radius * out), turn, arm_length, platform, rods, rod_length, shift, radius,
            spherical_elbow,
        )  # fmt: skip
    return built
