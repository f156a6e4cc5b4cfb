"""A cable robot: a platform held by cables over fixed exit points, each with a winch.

A cable is a straight line without mass that pulls and never pushes; `sag.py` judges whether its own weight may be
left out. The platform's frame B carries the attachment points and the centre of mass; the world is W.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.mechanism import Mechanism, Mobile
from paraopt.mechanism.joints import Range, as_tuple
from paraopt.mechanism.links import PLANAR_COORDINATES
from paraopt.modes.cable.build import PLATFORM, build_bodies, build_mechanism, build_platform, build_robot
from paraopt.modes.cable.read import read_for_cables, read_number, read_table
from paraopt.modes.cable.winch import Drum, Pulley
from paraopt.robot import Robot
from paraopt.shapes import Cable, check_solids
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]
Given = Any
"""What a person states, numbers or sequences; read into read-only arrays and tuples when the robot is built."""

__all__ = ["PLATFORM", "CableRobot"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CableRobot:
    """Describe a cable robot: geometry, inertia, limits of tensions and winches.

    In the plane, points have two coordinates, the pose is (x, y, theta) and wrenches are (fx, fy, mz).

    Attributes:
        name: Name.
        exits: Points at which the cables leave the frame, in the world [m], shape (n, 3), in the plane (n, 2).
        attachments: Points of the platform that they hold, in its frame [m], same shape.
        mass: Mass of the platform and of what it carries [kg].
        t_max: Largest tension [N], one for all or one for each cable.
        t_min: Least tension [N] that keeps a cable taut, one for all or one for each.
        home: Pose from which a robot starts, by name of coordinate [m or rad]; those not given are zero.
        centre: Centre of mass in the platform's frame [m].
        inertia: Inertia about the centre of mass in axes of the platform's frame [kg m^2], shape (3, 3); in the plane
            the number about the normal. Zero, a point mass, when not given.
        planar: Whether the robot moves in the plane z = 0.
        gravity: Acceleration of free fall [m/s^2] in the world. A planar robot feels what lies in its plane: none by
            default, where the plane is level; (0, -9.81) for one that stands upright.
        load: Constant wrench on the platform at its origin, in axes of the world [N, N m]: (fx, fy, fz, mx, my, mz),
            in the plane (fx, fy, mz).
        cables: Names of the cables, which are also those of the lengths; q1, q2, ... when not given.
        operational: Coordinates of the pose that are asked of a motion; all of them when None. A robot with fewer
            cables than coordinates leaves some to gravity.
        order: Order of the platform's rotations, see `Mobile`.
        radius: Radius of a cable's body [m], one for all or one for each.
        pulleys: Pulley of each cable, None where it leaves through an eye; no pulleys when None.
        drums: Drum of each cable's winch; None when not known.
        velocity: Largest speed of the lengths [m/s], one for all or one for each; no bound when None.
        acceleration: Largest acceleration of the lengths [m/s^2]; no bound when None.
        jerk: Largest jerk of the lengths [m/s^3]; no bound when None.
        lengths: Shortest and longest distance from exit to attachment [m], for all cables; a hundredth of the robot's
            size and four times it when None.
        ranges: Lowest and highest value of coordinates of the pose [m or rad], by name.
        solids: Solids of the platform, in its frame.
        frame: Solids of the frame, in the world.
        ignore: Lengths of a cable at its exit and at its attachment that do not count as touching [m].
        tool: Point of the platform whose way is drawn, in its frame [m]; its origin when None.
        characteristic_length: Length by which moments are divided to be compared with forces, and what an angle of one
            radian counts [m]; when None the root mean square distance of the attachments from the platform's origin,
            or a tenth of the frame's size where they all lie there.
        source: Where the numbers come from, and what is ours.

    Raises:
        DefinitionError: A number or a shape is not possible; the message names it.
        UnknownNameError: A coordinate of the pose is not one.
    """

    name: str
    exits: Given
    attachments: Given
    mass: float
    t_max: Given
    t_min: Given = 0.0
    home: Mapping[str, float] = field(default_factory=dict)
    centre: Given = (0.0, 0.0, 0.0)
    inertia: Given = None
    planar: bool = False
    gravity: Given = (0.0, 0.0, -9.81)
    load: Given = None
    cables: Given = None
    operational: Given = None
    order: str = "xyz"
    radius: Given = 2e-3
    pulleys: Given = None
    drums: Given = None
    velocity: Given = None
    acceleration: Given = None
    jerk: Given = None
    lengths: Given = None
    ranges: Mapping[str, Range] = field(default_factory=dict)
    solids: Given = ()
    frame: Given = ()
    ignore: Given = (0.0, 0.0)
    tool: Given = None
    characteristic_length: float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        for key in ("name", "source"):
            if not isinstance(getattr(self, key), str):
                raise DefinitionError(f"{key} of a cable robot is {getattr(self, key)!r}; it must be a string")
        if not isinstance(self.planar, bool):
            raise DefinitionError(f"planar of {self.name!r} is {self.planar!r}; it must be True or False")
        self._read_points()
        self._read_cables()
        self._read_body()
        self._read_pose()
        size = float(np.max(np.ptp(self.exits, axis=0)))
        lengths = (0.01 * size, 4.0 * size) if self.lengths is None else self.lengths
        low, high = read_table(lengths, (2,), f"lengths of {self.name!r}")
        if not 0.0 < low < high:
            raise DefinitionError(f"lengths of {self.name!r} are ({low:g}, {high:g}) m; need 0 < shortest < longest")
        self._set(lengths=(float(low), float(high)))
        _ = self.mechanism  # what the language of mechanisms refuses is refused here

    # --- Reading

    def _set(self, **values: Any) -> None:
        for key, value in values.items():
            object.__setattr__(self, key, value)

    def _read_points(self) -> None:
        width = 2 if self.planar else 3
        exits = read_table(self.exits, (None, width), f"exits of {self.name!r}")
        if len(exits) == 0:
            raise DefinitionError(f"{self.name!r} has no exits; a cable robot needs at least one cable")
        points = read_table(self.attachments, (len(exits), width), f"attachments of {self.name!r}")
        if float(np.max(np.ptp(exits, axis=0))) == 0.0:
            raise DefinitionError(f"exits of {self.name!r} all lie at {exits[0].tolist()} m; they must be apart")
        self._set(exits=exits, attachments=points)

    def _read_cables(self) -> None:
        n = len(self.exits)
        names = tuple(f"q{i + 1}" for i in range(n)) if self.cables is None else as_tuple(self.cables, "cables")
        if len(names) != n or not all(isinstance(c, str) and c for c in names) or len(set(names)) != n:
            raise DefinitionError(f"cables of {self.name!r} are {list(names)}; it must be {n} different names")
        self._set(cables=names)
        for key, what, unit in (("t_min", "least tension", "N"), ("radius", "radius", "m")):
            bounds = {"lowest": 0.0} if key == "t_min" else {"above": 0.0}
            self._set(**{key: read_for_cables(getattr(self, key), names, what, unit, **bounds)})
        self._set(t_max=read_for_cables(self.t_max, names, "largest tension", "N", above=0.0))
        for c, low, high in zip(names, self.t_min, self.t_max, strict=True):
            if not low < high:
                raise DefinitionError(
                    f"tension of cable {c!r} is in [{low:g}, {high:g}] N; t_min must be below t_max", robot=self.name
                )
        for key, unit in (("velocity", "m/s"), ("acceleration", "m/s^2"), ("jerk", "m/s^3")):
            if getattr(self, key) is not None:
                self._set(**{key: read_for_cables(getattr(self, key), names, key, unit, above=0.0)})
        for key, kind in (("pulleys", Pulley), ("drums", Drum)):
            parts = getattr(self, key)
            if parts is None:
                continue
            parts = as_tuple(parts, f"{key} of {self.name!r}")
            allowed = (Pulley, type(None)) if kind is Pulley else (Drum,)
            if len(parts) != n or not all(isinstance(part, allowed) for part in parts):
                raise DefinitionError(f"{key} of {self.name!r} are {parts!r}; it must be {n} of {kind.__name__}")
            if kind is Pulley and self.planar and any(p is not None and p.axis[2] != 0.0 for p in parts):
                raise DefinitionError(f"a pulley of {self.name!r} swivels out of the plane; its axis must lie in it")
            self._set(**{key: parts})
        ignore = read_table(self.ignore, (2,), f"ignored lengths of {self.name!r}")
        if np.any(ignore < 0.0):
            raise DefinitionError(f"ignored lengths of {self.name!r} are {ignore.tolist()} m; none may be negative")
        self._set(ignore=tuple(ignore.tolist()))

    def _read_body(self) -> None:
        self._set(mass=read_number(self.mass, f"mass of {self.name!r}", "kg", above=0.0))
        self._set(centre=self._in_space(self.centre, f"centre of mass of {self.name!r}"))
        self._set(gravity=self._in_space(self.gravity, f"gravity of {self.name!r}", drop_normal=True))
        if self.inertia is not None and np.ndim(self.inertia) == 0:
            value = read_number(self.inertia, f"inertia of {self.name!r}", "kg m^2", lowest=0.0)
            if not self.planar:
                raise DefinitionError(f"inertia of {self.name!r} is {value:g} kg m^2; in space it must be (3, 3)")
            self._set(inertia=np.diag([0.0, 0.0, value]))
        table = np.zeros((3, 3)) if self.inertia is None else self.inertia
        inertia = read_table(table, (3, 3), f"inertia of {self.name!r}")
        spread = max(float(np.max(np.abs(inertia))), 1e-300)
        least = float(np.min(np.linalg.eigvalsh(0.5 * (inertia + inertia.T))))
        if np.max(np.abs(inertia - inertia.T)) > 1e-9 * spread or least < -1e-9 * spread:
            raise DefinitionError(
                f"inertia of {self.name!r} is {inertia.tolist()} kg m^2; it must be symmetric, and none of its "
                f"principal values negative (the least is {least:.3g})"
            )
        self._set(inertia=inertia)
        size = 3 if self.planar else 6
        self._set(load=finite_vector(np.zeros(size) if self.load is None else self.load, size, "load"))
        for key in ("solids", "frame"):
            self._set(**{key: check_solids(getattr(self, key), f"{key} of {self.name!r}")})
        if self.characteristic_length is not None:
            value = read_number(self.characteristic_length, f"characteristic length of {self.name!r}", "m", above=0.0)
            self._set(characteristic_length=value)
        if self.tool is not None:
            self._set(tool=tuple(self._in_space(self.tool, f"tool of {self.name!r}").tolist()))

    def _read_pose(self) -> None:
        free = Mobile(PLATFORM, order=self.order).motions  # refuses an order that is none
        coordinates = PLANAR_COORDINATES if self.planar else tuple(m.name for m in free)
        for key in ("home", "ranges"):
            given = getattr(self, key)
            if not isinstance(given, Mapping):
                raise DefinitionError(f"{key} of {self.name!r} is {given!r}; it must be a mapping")
            for coordinate in given:
                if coordinate not in coordinates:
                    raise unknown_name(f"coordinate in {key} of {self.name!r}", coordinate, coordinates)
        home = {c: read_number(self.home.get(c, 0.0), f"home value of {c!r}", "m or rad") for c in coordinates}
        self._set(home=MappingProxyType(home), ranges=MappingProxyType(dict(self.ranges)))
        asked = coordinates if self.operational is None else as_tuple(self.operational, "operational coordinates")
        for coordinate in asked:
            if coordinate not in coordinates:
                raise unknown_name(f"operational coordinate of {self.name!r}", coordinate, coordinates)
        self._set(operational=asked)

    def _in_space(self, values: Any, what: str, drop_normal: bool = False) -> Array:
        """Read a vector of three, or in the plane of two, components."""
        vector = finite_vector(values, None, what)
        if vector.size == 2 and self.planar:
            vector = np.append(vector, 0.0)
        if vector.size != 3:
            raise DefinitionError(f"{what} is {vector.tolist()}; it must have {2 if self.planar else 3} components")
        if self.planar and vector[2] != 0.0:
            if not drop_normal:
                raise DefinitionError(f"{what} is {vector.tolist()}; a planar robot's has no third component")
            vector = np.array([vector[0], vector[1], 0.0])
        vector = np.array(vector)
        vector.flags.writeable = False
        return vector

    # --- What follows

    @property
    def n_cables(self) -> int:
        """Give the number of cables."""
        return len(self.exits)

    @property
    def dof(self) -> int:
        """Give the number of motions of the free platform: 6, in the plane 3."""
        return 3 if self.planar else 6

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Name the coordinates of the pose, in the order in which arrays of poses hold them."""
        return tuple(self.home)

    @property
    def wrench_names(self) -> tuple[str, ...]:
        """Name the components of a wrench, in the order in which arrays of wrenches hold them."""
        return ("fx", "fy", "mz") if self.planar else ("fx", "fy", "fz", "mx", "my", "mz")

    @property
    def home_pose(self) -> Array:
        """Give the home pose [m or rad], shape (dof,)."""
        return np.array(list(self.home.values()))

    @property
    def weight(self) -> float:
        """Give the weight of the platform [N]: mass by the gravity that it feels."""
        return float(self.mass * np.linalg.norm(self.gravity))

    @cached_property
    def length_scale(self) -> float:
        """Give the length in force by which moments are divided to be compared with forces [m]."""
        if self.characteristic_length is not None:
            return self.characteristic_length
        span = float(np.sqrt(np.mean(np.sum(np.square(self.attachments), axis=1))))
        return span if span > 0.0 else 0.1 * float(np.max(np.ptp(self.exits, axis=0)))

    def exits_in_space(self) -> Array:
        """Give the exits with three coordinates [m], shape (n, 3)."""
        return self._padded(self.exits)

    def attachments_in_space(self) -> Array:
        """Give the attachments in the platform's frame with three coordinates [m], shape (n, 3)."""
        return self._padded(self.attachments)

    def _padded(self, points: Any) -> Array:
        table = np.asarray(points, dtype=float)
        return np.hstack([table, np.zeros((len(table), 3 - table.shape[1]))])

    def check_poses(self, poses: ArrayLike) -> Array:
        """Read one pose or several as shape (k, dof).

        Raises:
            DefinitionError: The shape is another, or a number is not finite.
        """
        try:
            table = np.atleast_2d(np.asarray(poses, dtype=float))
        except (TypeError, ValueError) as error:
            raise DefinitionError(f"poses of {self.name!r} are {poses!r}; they must be numbers") from error
        if table.ndim != 2 or table.shape[1] != self.dof or not np.all(np.isfinite(table)):
            raise DefinitionError(
                f"poses of {self.name!r} have shape {np.shape(poses)}; they must be finite, shape (k, {self.dof}) of "
                f"{', '.join(self.coordinates)}"
            )
        return table

    @property
    def platform(self) -> Mobile:
        """Give the link that the cables hold."""
        return build_platform(self)

    @cached_property
    def mechanism(self) -> Mechanism:
        """Give the mechanism: for each cable a pulley that swings and a straight line of variable length."""
        return build_mechanism(self)

    @cached_property
    def robot(self) -> Robot:
        """Give the machine for scenes and planning, with the cables as bodies.

        Its lengths run from exit to attachment: a pulley's arc belongs to the winch, see `CableFunctions.lengths`.
        """
        return build_robot(self)

    def bodies(self) -> tuple[Cable, ...]:
        """Give the cables as bodies of a scene, from exit to attachment."""
        return build_bodies(self)
