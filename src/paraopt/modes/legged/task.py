"""A walk as a sequence of phases: which feet stand, which joints are locked, and what moves meanwhile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics import Configuration
from paraopt.modes.legged.machine import LeggedMachine
from paraopt.modes.legged.supports import Support
from paraopt.planning import Margins, Retimer
from paraopt.robot import Limits
from paraopt.scene import Scene
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Phase:
    """Describe one phase: from rest to rest, on the same feet, with the same joints locked.

    Attributes:
        name: Name, unique in its task.
        standing: Feet that stand still.
        coordinates: Independent variables that move, as many as the standing feet and the locked joints leave free:
            those of a lifted foot, those of the trunk, or both.
        goal: Their values at the end [m or rad]; one that is left out comes back to where it started.
        locked: Variables that are locked, by name; with a mapping the values at which they must be then [m or rad].
        via: Values of coordinates to pass through, in order, such as a foot's highest place; those left out are free.
        curve: Way of all coordinates over [0, 1], in their order, to be followed exactly instead of planned; it begins
            where the phase does and ends at the goal.
        start: Values at the beginning [m or rad], by name of variable; where stated, they must be those that the phase
            before ends with.
        stability: Smallest support margin [m] that must be kept, see `SupportPolygon`; None where it does not count,
            such as for feet that hold on to the ground.
        retimer: How the phase is timed; as the planner says when None.

    Raises:
        DefinitionError: A number is not finite, a name stands twice, or the goal names what does not move.
    """

    name: str
    standing: Sequence[str]
    coordinates: Sequence[str]
    goal: Mapping[str, float] = field(default_factory=dict)
    locked: Sequence[str] | Mapping[str, float] = ()
    via: Sequence[Mapping[str, float]] = ()
    curve: BSpline | None = None
    start: Mapping[str, float] = field(default_factory=dict)
    stability: float | None = 0.0
    retimer: Retimer | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise DefinitionError(f"name of a phase is {self.name!r}; it must be a non-empty string")
        for what in ("standing", "coordinates"):
            object.__setattr__(self, what, self._read_names(what, getattr(self, what)))
        if isinstance(self.locked, Mapping):
            object.__setattr__(self, "locked", self._read_values("locked", self.locked))
        else:
            object.__setattr__(self, "locked", self._read_names("locked", self.locked))
        if not self.coordinates:
            raise DefinitionError(f"phase {self.name!r} has no coordinates: nothing would move")
        both = [name for name in self.coordinates if name in self.locked]
        if both:
            raise DefinitionError(f"phase {self.name!r} both moves and locks {both}")
        object.__setattr__(self, "via", tuple(self._read_values("via", v) for v in self.via))
        for what in ("goal", "start"):
            object.__setattr__(self, what, self._read_values(what, getattr(self, what)))
        for what, values in (("goal", self.goal), *(("via", v) for v in self.via)):
            for name in values:
                if name not in self.coordinates:
                    raise unknown_name(f"coordinate in the {what} of phase {self.name!r}", name, self.coordinates)
        if self.stability is not None and not np.isfinite(self.stability):
            raise DefinitionError(
                f"support margin asked of phase {self.name!r} is {self.stability!r} m; it must be finite, or None"
            )
        if self.curve is not None:
            self._check_curve(self.curve)

    def held(self, machine: LeggedMachine) -> tuple[str, ...]:
        """Name the variables that keep their values: those of the standing feet, and the locked joints."""
        feet = [name for foot in self.standing for name in machine.foot(foot).variables]
        return tuple(dict.fromkeys([*feet, *self.locked]))

    def lifted(self, machine: LeggedMachine) -> tuple[str, ...]:
        """Name the feet that do not stand."""
        return tuple(name for name in machine.names if name not in self.standing)

    def _check_curve(self, curve: BSpline) -> None:
        shape = np.shape(curve(0.0))
        if shape != (len(self.coordinates),):
            raise DefinitionError(
                f"curve of phase {self.name!r} gives values of shape {shape} for {len(self.coordinates)} coordinates"
            )
        if abs(curve.t[curve.k]) > 1e-12 or abs(curve.t[-curve.k - 1] - 1.0) > 1e-12:
            raise DefinitionError(f"curve of phase {self.name!r} must be given over [0, 1]")
        if self.via:
            raise DefinitionError(f"phase {self.name!r} has a curve and places to pass through; give one of them")
        end = dict(zip(self.coordinates, curve(1.0).tolist(), strict=True))
        for name, value in self.goal.items():
            if not abs(value - end[name]) <= 1e-9:
                raise DefinitionError(
                    f"curve of phase {self.name!r} ends with {name!r} at {end[name]:.9g}, the goal is {value:.9g}"
                )

    def _read_names(self, what: str, names: Any) -> tuple[str, ...]:
        if isinstance(names, str) or not all(isinstance(n, str) for n in names):
            raise DefinitionError(f"{what} of phase {self.name!r} are {names!r}; they must be a sequence of names")
        read = tuple(names)
        doubled = sorted({n for n in read if read.count(n) > 1})
        if doubled:
            raise DefinitionError(f"{what} of phase {self.name!r} name {doubled} twice")
        return read

    def _read_values(self, what: str, values: Any) -> Mapping[str, float]:
        if not isinstance(values, Mapping):
            raise DefinitionError(f"{what} of phase {self.name!r} is {values!r}; it must be values by name")
        read = {}
        for name, value in values.items():
            try:
                read[name] = float(value)
            except (TypeError, ValueError) as error:
                raise DefinitionError(f"{what} of phase {self.name!r} has {name!r} at {value!r}") from error
            if not np.isfinite(read[name]):
                raise DefinitionError(f"{what} of phase {self.name!r} has {name!r} at {value!r}; it must be finite")
        return MappingProxyType(read)


@dataclass(frozen=True, eq=False)
class LeggedTask:
    """Ask a machine to go through phases, one after the other.

    Between phases the machine is at rest: only there feet come off or down, and joints are locked or let go.

    Attributes:
        machine: The machine.
        phases: What it does, in order.
        support: What standing feet stand on.
        start: Where it begins: a configuration, or values of operational variables that differ from home [m or rad].
        scene: The machine among obstacles; without obstacles when None.
        margins: Distances to keep from obstacles and singularities.
        limits: Bounds of the drives; those of the robot when None.
        gravity: Direction of gravity in the world, of any length but zero.
        tipping: Smallest distance from tipping over [m], the inertia of what moves counted; see `TippingConstraint`. It
            slows phases that ask for a support margin, and must be below that margin. When None only weight counts, as
            for a machine that moves slowly; the certificate then tells the distance without judging it.

    Raises:
        DefinitionError: Phases do not fit the machine: an unknown foot or variable, a standing foot that is to move, a
            foot that neither stands nor moves, two phases of one name.
    """

    machine: LeggedMachine
    phases: Sequence[Phase]
    support: Support
    start: Mapping[str, float] | Configuration = field(default_factory=dict)
    scene: Scene | None = None
    margins: Margins = field(default_factory=Margins)
    limits: Limits | None = None
    gravity: ArrayLike = (0.0, 0.0, -1.0)
    tipping: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "phases", tuple(self.phases))
        gravity = finite_vector(self.gravity, 3, "direction of gravity")
        size = float(np.linalg.norm(gravity))
        if size == 0.0:
            raise DefinitionError("direction of gravity is zero; it must be a direction")
        object.__setattr__(self, "gravity", finite_vector(gravity / size, 3, "direction of gravity"))
        if self.tipping is not None and not np.isfinite(self.tipping):
            raise DefinitionError(f"distance from tipping over is {self.tipping!r} m; it must be finite, or None")
        robot = self.machine.robot
        if self.scene is None:
            object.__setattr__(self, "scene", Scene(robot))
        elif self.scene.robot is not robot:
            raise DefinitionError(f"scene of the task holds another robot, {self.scene.robot.name!r}")
        if self.limits is not None:
            self.limits.check_fit(robot.mechanism)
        names = [phase.name for phase in self.phases]
        if not names:
            raise DefinitionError("a task needs at least one phase")
        doubled = sorted({n for n in names if names.count(n) > 1})
        if doubled:
            raise DefinitionError(f"phases {doubled} appear twice; give them different names")
        for phase in self.phases:
            self._check_phase(phase)

    @property
    def down(self) -> Array:
        """Give the unit direction of gravity, shape (3,)."""
        return np.asarray(self.gravity)

    def _check_phase(self, phase: Phase) -> None:
        machine = self.machine
        if self.tipping is not None and phase.stability is not None and not self.tipping < phase.stability:
            raise DefinitionError(
                f"phase {phase.name!r} asks for a support margin of {phase.stability:g} m, and the task for "
                f"{self.tipping:g} m from tipping over, which no speed keeps; ask for less than the support margin"
            )
        known = machine.robot.mechanism.names
        for foot in phase.standing:
            if foot not in machine.names:
                raise unknown_name(f"standing foot of phase {phase.name!r}", foot, machine.names)
        for name in (*phase.coordinates, *phase.locked, *phase.start):
            if name not in known:
                raise unknown_name(f"variable of phase {phase.name!r}", name, known)
        for foot in phase.standing:
            moved = [name for name in machine.foot(foot).variables if name in phase.coordinates]
            if moved:
                raise DefinitionError(
                    f"phase {phase.name!r}: foot {foot!r} stands, but its variables {moved} are to move; let it be "
                    "lifted, or leave them out of the coordinates"
                )
