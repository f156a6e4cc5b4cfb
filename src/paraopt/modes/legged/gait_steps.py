"""Which foot is lifted when, and to where: walks with half steps at both ends, and turns in place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.supports import PlaneSupport, Support, drop_onto, measure_height
from paraopt.spatial import finite_vector, rotation_xyz

Array = NDArray[np.float64]
Part = Literal["start", "cycle", "end", "turn"]


@dataclass(frozen=True)
class Lift:
    """Describe the way of one foot to its next foothold.

    Attributes:
        foot: Name of the foot.
        place: The foothold at which it arrives [m].
        pose: Nominal pose of the trunk on arrival [m, rad].
        part: Part of the gait; the lifts of "cycle" are those that a walk repeats.
    """

    foot: str
    place: tuple[float, ...]
    pose: tuple[float, ...]
    part: Part


@dataclass(frozen=True, eq=False)
class Footfalls:
    """List the lifts of a gait, one foot at a time, and where feet and trunk begin.

    Attributes:
        model: The machine.
        support: What it stands on.
        places: Footholds at the beginning [m], shape (n_feet, 3).
        pose: Pose of the trunk at the beginning [m, rad], shape (6,).
        lifts: What the feet do, in order.
        height: How high a foot is lifted [m].
        is_scalable: Whether steps may be made longer or shorter: all of them are proportional to one length.
        is_periodic: Whether the end is the beginning of the next cycle, so that the trunk's first pose is free.
    """

    model: GaitModel
    support: Support
    places: Array
    pose: Array
    lifts: tuple[Lift, ...]
    height: float
    is_scalable: bool = False
    is_periodic: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.height) and self.height > 0):
            raise DefinitionError(f"lift is {self.height} m; it must be a finite height above 0")
        if not self.lifts:
            raise DefinitionError("a gait needs at least one lift")
        for lift in self.lifts:
            if lift.foot not in self.model.machine.names:
                raise unknown_name("foot that is lifted", lift.foot, self.model.machine.names)

    @cached_property
    def feet(self) -> tuple[int, ...]:
        """Give the number of the lifted foot among the machine's feet, for each lift."""
        names = self.model.machine.names
        return tuple(names.index(lift.foot) for lift in self.lifts)

    @cached_property
    def all_places(self) -> Array:
        """Give all footholds before the first lift and after each [m], shape (n_lifts + 1, n_feet, 3)."""
        found = [np.array(self.places)]
        for foot, lift in zip(self.feet, self.lifts, strict=True):
            here = found[-1].copy()
            here[foot] = lift.place
            found.append(here)
        return np.array(found)

    @cached_property
    def all_poses(self) -> Array:
        """Give the nominal trunk poses before the first lift and after each [m, rad], shape (n_lifts + 1, 6)."""
        return np.vstack([self.pose, [lift.pose for lift in self.lifts]])

    @cached_property
    def cycle(self) -> tuple[int, int]:
        """Give the numbers of the first lift of the cycle and of the first one after it; equal without a cycle."""
        within = [i for i, lift in enumerate(self.lifts) if lift.part == "cycle"]
        return (within[0], within[-1] + 1) if within else (0, 0)

    @cached_property
    def travel(self) -> Array:
        """Give how far the trunk moves in all: change of its pose [m, rad], shape (6,)."""
        return np.asarray(self.all_poses[-1] - self.all_poses[0])

    @cached_property
    def cycle_travel(self) -> Array:
        """Give how far the trunk moves in a cycle: change of its pose [m, rad], shape (6,)."""
        first, last = self.cycle
        return np.asarray(self.all_poses[last] - self.all_poses[first])

    def normals(self) -> Array:
        """Give the direction in which each foot is lifted: mean of the support's at both ends, shape (n_lifts, 3)."""
        index = np.arange(len(self.lifts))
        ends = self.all_places[index, self.feet], self.all_places[index + 1, self.feet]
        mean = sum(self.support.tangent_plane(p)[1] for p in ends)
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))

    def scaled(self, scale: float) -> Footfalls:
        """Give the same footfalls with all steps longer or shorter by a factor.

        Raises:
            DefinitionError: The steps are not proportional to one length.
        """
        if not self.is_scalable:
            raise DefinitionError("steps of these footfalls cannot be scaled; state them anew")
        rest, pose = self.model.rest_places, self.model.rest_pose
        names = self.model.machine.names

        def of_place(foot: int, place: ArrayLike) -> tuple[float, ...]:
            return tuple((rest[foot] + scale * (np.asarray(place) - rest[foot])).tolist())

        def of_pose(value: ArrayLike) -> tuple[float, ...]:
            return tuple((pose + scale * (np.asarray(value) - pose)).tolist())

        lifts = tuple(
            replace(lift, place=of_place(names.index(lift.foot), lift.place), pose=of_pose(lift.pose))
            for lift in self.lifts
        )
        places = np.array([of_place(i, p) for i, p in enumerate(self.places)])
        return replace(self, places=places, pose=np.array(of_pose(self.pose)), lifts=lifts)


def build_walk(
    model: GaitModel,
    support: Support,
    order: Sequence[str] | None = None,
    step: float = 0.06,
    lift: float = 0.02,
    heading: float = 0.0,
    ends: bool = True,
) -> Footfalls:
    """Build the lifts of a walk: a start, one cycle that may be repeated, and an end that is the rest stance again.

    In the start the first half of the feet take half a step; the cycle goes on with the other half, whole steps all;
    in the end that other half takes half a step. The trunk's nominal way is as long as that of the feet: a share of
    `step / n_feet` for a whole step, half of it for a half step; the whole share everywhere, as printed, would take it
    farther than the feet.

    Args:
        model: The machine; an even number of feet.
        support: What it stands on.
        order: Names of the feet in the order in which they are lifted; as listed in the machine when None.
        step: Length of a step [m].
        lift: Height to which a foot is lifted [m].
        heading: Direction of the walk from the trunk's x towards y [rad]: pi / 2 walks sideways.
        ends: Whether start and end are listed; without them the cycle stands alone, for steady walking.

    Returns:
        The footfalls.

    Raises:
        DefinitionError: The order does not name every foot once; the machine at rest does not stand on the support.

    Source: Lahouar, IV.3.2.
    """
    names = model.machine.names
    order = tuple(names if order is None else order)
    if sorted(order) != sorted(names):
        raise DefinitionError(f"order of the feet is {list(order)}; it must name each of {list(names)} once")
    if len(names) % 2:
        raise DefinitionError(f"{len(names)} feet cannot be halved into start and end; a walk needs an even number")
    if not (math.isfinite(step) and step > 0):
        raise DefinitionError(f"step is {step} m; it must be a finite length above 0")
    first, second = order[: len(order) // 2], order[len(order) // 2 :]
    sequence: list[tuple[str, float, Part]] = [(foot, 0.5, "start") for foot in first]
    sequence += [(foot, 1.0, "cycle") for foot in (*second, *first)]
    sequence += [(foot, 0.5, "end") for foot in second]
    turn = float(model.rest_pose[5]) + heading
    lifts: list[Lift] = []
    places, pose = _check_rest(model, support), model.rest_pose.copy()
    begin = places.copy(), pose.copy()
    for foot, share, part in sequence:
        k = names.index(foot)
        places[k] = _place_on(support, places[k] + share * step * _along(support, places[k], turn), places[k])
        pose[:3] += share * step / len(names) * _along(support, pose[:3], turn)
        if part == "start" and not ends:
            begin = places.copy(), pose.copy()
            continue
        if part == "end" and not ends:
            continue
        lifts.append(Lift(foot, tuple(places[k].tolist()), tuple(pose.tolist()), part))
    return Footfalls(model, support, *begin, tuple(lifts), lift, isinstance(support, PlaneSupport), not ends)


def build_turn(
    model: GaitModel,
    support: Support,
    angle: float = math.radians(15),
    lift: float = 0.02,
    pivot: Sequence[float] | None = None,
    largest: float = math.radians(20),
) -> Footfalls:
    """Build the lifts of a turn in place, nearest feet first.

    The new footholds are those of the rest stance, turned with the trunk about the support's normal. A turn that is
    larger than one round of lifts allows is made in equal rounds.

    Args:
        model: The machine.
        support: What it stands on.
        angle: Angle of the turn, positive to the left [rad].
        lift: Height to which a foot is lifted [m].
        pivot: Point about which the machine turns [m]; the origin of the trunk at rest when None.
        largest: Largest angle of one round [rad].

    Returns:
        The footfalls.

    Raises:
        DefinitionError: An angle is no finite number, or zero; the machine at rest does not stand on the support.

    Source: Lahouar, IV.3.3.
    """
    if not (math.isfinite(angle) and angle != 0.0 and math.isfinite(largest) and largest > 0):
        raise DefinitionError(f"turn of {angle} rad in rounds of at most {largest} rad; both must be finite, not 0")
    rounds = math.ceil(abs(angle) / largest - 1e-9)
    about = finite_vector(model.rest_pose[:3] if pivot is None else pivot, 3, "pivot of the turn")
    _, normal = support.tangent_plane(about)
    places = _check_rest(model, support)
    rest, count = places.copy(), len(places)
    lifts: list[Lift] = []
    for done in range(rounds):
        R = _rotation(normal, angle * (done + 1) / rounds)
        targets = np.array([_place_on(support, about + R @ (p - about), p) for p in rest])
        distances = np.linalg.norm(targets - places, axis=1)
        # mirrored feet are as near but for rounding; of these the one on the outside of the turn comes first, so that
        # turns to either side are mirrored too
        across = _rotation(normal, 0.5 * math.pi) @ _along(support, about, float(model.rest_pose[5]))
        outside = math.copysign(1.0, angle) * ((rest - about) @ across)
        nearest = sorted(range(count), key=lambda k: (round(float(distances[k]), 9), round(float(outside[k]), 9), k))
        for i, k in enumerate(nearest):
            share = angle * (done + (i + 1) / count) / rounds
            pose = _turn_pose(model.rest_pose, about, _rotation(normal, share), share)
            lifts.append(Lift(model.machine.names[k], tuple(targets[k].tolist()), tuple(pose.tolist()), "turn"))
        places = targets
    return Footfalls(model, support, rest, model.rest_pose.copy(), tuple(lifts), lift)


def tilt_gravity(slope: float, heading: float = 0.0) -> Array:
    """Give the direction of gravity for a machine on a slope, in the frame of the ground it stands on.

    Args:
        slope: Angle of rise [rad].
        heading: Direction of the steepest rise, from x towards y [rad].

    Returns:
        Unit direction, shape (3,).
    """
    return np.array([-math.sin(slope) * math.cos(heading), -math.sin(slope) * math.sin(heading), -math.cos(slope)])


def _check_rest(model: GaitModel, support: Support) -> Array:
    """Give the footholds at rest, where the machine stands on the support."""
    places = model.rest_places.copy()
    heights = measure_height(support, places)
    spread = float(np.ptp(heights))
    if spread > 1e-6:
        worst = int(np.argmax(np.abs(heights - np.median(heights))))
        raise DefinitionError(
            f"at rest foot {model.machine.names[worst]!r} is {1e3 * heights[worst]:.3g} mm above support "
            f"{support.name!r}, the others {1e3 * np.median(heights):.3g} mm; let the rest stance stand on it, or tilt "
            "gravity instead of the support"
        )
    return places


def _along(support: Support, point: Array, turn: float) -> Array:
    """Give the unit direction of a heading in the support's plane near a point."""
    _, normal = support.tangent_plane(point)
    level = np.array([math.cos(turn), math.sin(turn), 0.0])
    level -= (level @ normal) * normal
    return np.asarray(level / np.linalg.norm(level))


def _place_on(support: Support, place: Array, before: Array) -> Array:
    """Bring a foothold to the height above the support that the foot had before."""
    _, normal = support.tangent_plane(place)
    height = float(measure_height(support, before))
    return np.asarray(drop_onto(support, place, -normal) + height * normal)


def _rotation(axis: Array, angle: float) -> Array:
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K)


def _turn_pose(pose: Array, about: Array, R: Array, angle: float) -> Array:
    """Turn a trunk pose about a point; its angle gamma keeps count of whole turns."""
    turned = R @ np.asarray(rotation_xyz(*pose[3:]))
    beta = math.asin(max(-1.0, min(1.0, turned[0, 2])))
    alpha, gamma = math.atan2(-turned[1, 2], turned[2, 2]), math.atan2(-turned[0, 1], turned[0, 0])
    wanted = pose[5] + angle
    gamma += 2.0 * math.pi * round((wanted - gamma) / (2.0 * math.pi))
    return np.array([*(about + R @ (pose[:3] - about)), alpha, beta, gamma])
