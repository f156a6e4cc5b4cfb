"""The machine: a mechanism with shapes on its links, limits of its drives, masses, and a home configuration."""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics import Configuration, Kinematics
from paraopt.mechanism import Mechanism
from paraopt.mechanism.joints import Range
from paraopt.mechanism.links import as_point
from paraopt.shapes import Cable, Shape, check_cables, check_solids

PLATFORM_LIMITS = ("linear_velocity", "angular_velocity", "linear_acceleration", "angular_acceleration")


@dataclass(frozen=True)
class Limits:
    """Bound the motion, by name of variable, active or not, and that of the platform as a whole.

    The tool point is that of `Robot.tool`, or the origin of the link that carries the operational variables.

    Attributes:
        position: Lowest and highest value [m or rad]; narrows the ranges of the joints.
        velocity: Largest speed [m/s or rad/s].
        acceleration: Largest acceleration [m/s^2 or rad/s^2].
        jerk: Largest jerk [m/s^3 or rad/s^3].
        linear_velocity: Largest speed of the tool point [m/s], no bound when None.
        angular_velocity: Largest angular speed of the link that carries it [rad/s].
        linear_acceleration: Largest acceleration of the tool point [m/s^2].
        angular_acceleration: Largest angular acceleration of its link [rad/s^2].

    Raises:
        DefinitionError: A bound is not a finite number above zero, or a range is empty.
    """

    position: Mapping[str, Range] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)
    acceleration: Mapping[str, float] = field(default_factory=dict)
    jerk: Mapping[str, float] = field(default_factory=dict)
    linear_velocity: float | None = None
    angular_velocity: float | None = None
    linear_acceleration: float | None = None
    angular_acceleration: float | None = None

    def __post_init__(self) -> None:
        for quantity in PLATFORM_LIMITS:
            value = getattr(self, quantity)
            if value is not None and not (_is_finite(value) and value > 0):
                raise DefinitionError(
                    f"{quantity} limit of the platform is {value!r}; it must be finite and above 0, or None",
                    limits=self,
                )
            object.__setattr__(self, quantity, None if value is None else float(value))
        for quantity in ("velocity", "acceleration", "jerk"):
            values = _as_mapping(getattr(self, quantity), f"{quantity} limits")
            for name, value in values.items():
                if not (_is_finite(value) and value > 0):
                    raise DefinitionError(
                        f"{quantity} limit of {name!r} is {value!r}; it must be finite and above 0", limits=values
                    )
                values[name] = float(value)
            object.__setattr__(self, quantity, MappingProxyType(values))
        ranges = _as_mapping(self.position, "position limits")
        for name, bounds in ranges.items():
            try:
                low, high = (float(b) for b in bounds)
            except (TypeError, ValueError, OverflowError) as error:
                raise DefinitionError(
                    f"position limit of {name!r} is {bounds!r}; it must be two numbers, lowest and highest value",
                    limits=ranges,
                ) from error
            if not low < high:
                raise DefinitionError(
                    f"position limit of {name!r} is ({low}, {high}); its low end must be below its high end",
                    limits=ranges,
                )
            ranges[name] = (low, high)
        object.__setattr__(self, "position", MappingProxyType(ranges))

    def check_fit(self, mechanism: Mechanism) -> None:
        """Refuse limits of variables that do not exist, and those that leave a joint no place to be.

        Args:
            mechanism: The mechanism.

        Raises:
            UnknownNameError: A name is not a variable of the mechanism.
            DefinitionError: A position limit and the range of its joint have nothing in common.
        """
        for quantity in ("position", "velocity", "acceleration", "jerk"):
            for name in getattr(self, quantity):
                if name not in mechanism.names:
                    raise unknown_name(f"variable in the {quantity} limits", name, mechanism.names)
        for variable, low, high in zip(mechanism.variables, *self.bounds(mechanism), strict=True):
            if low > high:
                raise DefinitionError(
                    f"position limit of {variable.name!r} is {self.position[variable.name]} {variable.unit}, which is "
                    f"apart from the range {variable.range} {variable.unit} of its joint; let them overlap",
                    limits=self,
                    mechanism=mechanism,
                )

    def bounds(self, mechanism: Mechanism) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Give the lowest and the highest value of every variable: ranges of the joints narrowed by these limits.

        Args:
            mechanism: The mechanism.

        Returns:
            Two arrays of shape (n_variables,) [m or rad].
        """
        low = [max(v.range[0], self.position.get(v.name, v.range)[0]) for v in mechanism.variables]
        high = [min(v.range[1], self.position.get(v.name, v.range)[1]) for v in mechanism.variables]
        return np.array(low), np.array(high)

    def of(self, quantity: str, names: Sequence[str]) -> NDArray[np.float64]:
        """Give the bounds of one quantity for several variables; inf where nothing is stated."""
        values: Mapping[str, float] = getattr(self, quantity)
        return np.array([values.get(name, np.inf) for name in names])

    def platform(self) -> NDArray[np.float64]:
        """Give the bounds of the platform, in the order of `PLATFORM_LIMITS`; inf where none is stated, shape (4,)."""
        values = [getattr(self, quantity) for quantity in PLATFORM_LIMITS]
        return np.array([np.inf if value is None else value for value in values])


@dataclass(frozen=True, eq=False)
class Robot:
    """Describe a machine.

    Attributes:
        mechanism: Links, joints, closures and roles.
        home: Values by name [m or rad] from which the home configuration is solved; the operational ones are imposed,
            the others choose the branch.
        shapes: Solids carried by each link, by name of link.
        limits: Bounds of the drives.
        masses: Mass of each link [kg], by name of link.
        centres: Centre of mass of a link in its own frame [m], by name of link; its origin where nothing is said.
        contacts: Pairs of links that may touch, with the reason, beyond those joined by a joint or a closure.
        tool: Name of a link and a point on it [m], whose way in space is drawn; the origin of the link that carries the
            operational variables when None.
        source: Where the description comes from, and what is ours.
        facts: What is known of the mechanism, as whole numbers by name: "variables", "equations", "rank E", "rank M",
            "rank N", "rank K", "mobility", "idle", "working modes", "assembly modes"; those that are known.
        cables: Cables stretched between points of its links; their ends follow the links. Each has a name of its own.
    """

    mechanism: Mechanism
    home: Mapping[str, float]
    shapes: Mapping[str, Sequence[Shape]] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)
    masses: Mapping[str, float] = field(default_factory=dict)
    contacts: Mapping[tuple[str, str], str] = field(default_factory=dict)
    tool: tuple[str, Sequence[float]] | None = None
    source: str = ""
    facts: Mapping[str, int] = field(default_factory=dict)
    centres: Mapping[str, Sequence[float]] = field(default_factory=dict)
    cables: Sequence[Cable] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, Mechanism):
            raise DefinitionError(f"the robot's mechanism is {self.mechanism!r}; it must be a Mechanism")
        if not isinstance(self.limits, Limits):
            raise DefinitionError(f"limits of {self.name!r} are {self.limits!r}; they must be Limits")
        if not isinstance(self.source, str):
            raise DefinitionError(f"source of {self.name!r} is {self.source!r}; it must be a string")
        for mapping in ("home", "shapes", "masses", "contacts", "facts", "centres"):
            read = _as_mapping(getattr(self, mapping), f"{mapping} of {self.name!r}")
            object.__setattr__(self, mapping, MappingProxyType(read))
        known = [link.name for link in self.mechanism.links]
        named: dict[str, tuple[Shape, ...]] = {}
        for link, shapes in self.shapes.items():
            if link not in known:
                raise unknown_name("link that carries shapes", link, known)
            solids = check_solids(shapes, f"shapes of link {link!r}")
            named[link] = tuple(
                s if s.name else replace(s, name=link if len(solids) == 1 else f"{link} {i + 1}")
                for i, s in enumerate(solids)
            )
        names = [s.name for shapes in named.values() for s in shapes]
        doubled = {n for n in names if names.count(n) > 1}
        if doubled:
            raise DefinitionError(f"shape names {sorted(doubled)} appear twice on {self.mechanism.name!r}")
        self._check_cables(known, names)
        for link, mass in self.masses.items():
            if link not in known:
                raise unknown_name("link that has a mass", link, known)
            if not (_is_finite(mass) and mass >= 0):
                raise DefinitionError(f"mass of link {link!r} is {mass!r} kg; it must be finite and not negative")
        centres: dict[str, tuple[float, float, float]] = {}
        for link, point in self.centres.items():
            if link not in known:
                raise unknown_name("link that has a centre of mass", link, known)
            centres[link] = as_point(point, f"centre of mass of link {link!r}")
        for pair, reason in self.contacts.items():
            if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(reason, str)):
                raise DefinitionError(
                    f"contacts of {self.name!r} have {pair!r}: {reason!r}; they must map two links to the reason"
                )
            for link in pair:
                if link not in known:
                    raise unknown_name("link in the contacts", link, known)
        if self.tool is not None:
            if not (isinstance(self.tool, (tuple, list)) and len(self.tool) == 2):
                raise DefinitionError(f"tool of {self.name!r} is {self.tool!r}; it must be a link and a point on it")
            link, point = self.tool
            if link not in known:
                raise unknown_name("link that carries the tool", link, known)
            object.__setattr__(self, "tool", (link, as_point(point, f"tool point on {link!r}")))
        for name, value in self.home.items():
            variable = self.mechanism.variables[self.mechanism.index(name)]
            if not _is_finite(value):
                raise DefinitionError(
                    f"home value of {name!r} is {value!r} {variable.unit}; it must be a finite number"
                )
        for fact, value in self.facts.items():
            if not isinstance(fact, str) or isinstance(value, bool) or not isinstance(value, numbers.Integral):
                raise DefinitionError(f"fact {fact!r} of {self.name!r} is {value!r}; it must be a whole number")
        missing = [n for n in self.mechanism.operational if n not in self.home]
        if missing:
            raise DefinitionError(f"home of {self.mechanism.name!r} lacks the operational variables {missing}")
        self.limits.check_fit(self.mechanism)
        object.__setattr__(self, "shapes", MappingProxyType(named))
        object.__setattr__(self, "centres", MappingProxyType(centres))

    def _check_cables(self, links: Sequence[str], solids: Sequence[str]) -> None:
        """Refuse cables whose ends are on no link, and names that another body has."""
        cables = check_cables(self.cables, f"cables of {self.name!r}")
        taken = set(solids)
        for cable in cables:
            for link in cable.links:
                if link not in links:
                    raise unknown_name(f"link at an end of {cable.label}:", link, links)
            if cable.name in taken:
                raise DefinitionError(
                    f"name {cable.name!r} of a cable is that of another solid or cable of {self.name!r}; "
                    "give every cable a name of its own"
                )
            taken.add(cable.name)
        object.__setattr__(self, "cables", cables)

    @property
    def name(self) -> str:
        """Give the name of the mechanism."""
        return self.mechanism.name

    @cached_property
    def kinematics(self) -> Kinematics:
        """Give the compiled functions of the mechanism, built at the first use."""
        return Kinematics(self.mechanism)

    @cached_property
    def home_configuration(self) -> Configuration:
        """Give the home configuration.

        Raises:
            SolveError: The loops cannot be closed at home.
        """
        imposed = {name: self.home[name] for name in self.mechanism.operational}
        return self.kinematics.inverse(imposed, start=self.home).configuration


def _as_mapping(values: Any, what: str) -> dict[Any, Any]:
    if not isinstance(values, Mapping):
        raise DefinitionError(f"{what} are {values!r}; they must be a mapping")
    return dict(values)


def _is_finite(value: Any) -> bool:
    """Tell whether a value is a finite real number, of Python or NumPy."""
    try:
        return isinstance(value, numbers.Real) and bool(np.isfinite(float(value)))
    except OverflowError:  # a whole number that no float holds
        return False
