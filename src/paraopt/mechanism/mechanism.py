"""The mechanism: a tree of links, closures between them, and a role for every variable."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from paraopt.errors import DefinitionError, unknown_name
from paraopt.mechanism.balance import Coupling, Equilibrium, Tension
from paraopt.mechanism.closures import Closure, LinkClosure
from paraopt.mechanism.joints import UNITS, Motion, Range, Unknown, VariableKind, as_tuple
from paraopt.mechanism.links import PLANAR_COORDINATES, Base, Link, Mobile, Series

Role = Literal["active", "passive", "operational"]


@dataclass(frozen=True)
class Variable:
    """Describe one variable of the mechanism.

    Attributes:
        name: Name.
        kind: "angle" [rad], "length" [m] or "force" [N].
        role: "active", "passive" or "operational".
        link: Name of the link that it moves or pulls.
        range: Lowest and highest value [rad, m or N].
        scale: Unit in which it is judged: 1 rad, the characteristic length [m], or the force of reference [N].
    """

    name: str
    kind: VariableKind
    role: Role
    link: str
    range: Range
    scale: float = 1.0

    @property
    def unit(self) -> str:
        """Give the unit: "rad", "m" or "N"."""
        return UNITS[self.kind]


@dataclass(frozen=True)
class Mechanism:
    """Describe a machine whose links form closed loops.

    Attributes:
        name: Name of the machine.
        links: One `Base`, and any number of `Series` and `Mobile` links, in any order.
        closures: Conditions that close the loops.
        active: Names of the variables that actuators drive, in the user's order.
        operational: Names of the variables that state the task, in the user's order.
        planar: Whether the machine moves in the plane z = 0; out-of-plane equations are then never built.
        characteristic_length: Length that makes matrices free of units [m]; the mean distance between the points of
            the description when None.

    Raises:
        DefinitionError: The description is faulty; the message names the fault.
    """

    name: str
    links: Sequence[Link]
    closures: Sequence[Closure]
    active: Sequence[str]
    operational: Sequence[str]
    planar: bool = False
    characteristic_length: float | None = None

    def __post_init__(self) -> None:
        for field in ("links", "closures", "active", "operational"):
            object.__setattr__(self, field, as_tuple(getattr(self, field), f"{field} of {self.name!r}"))
        if not isinstance(self.name, str) or not self.name:
            raise DefinitionError(f"name of a mechanism is {self.name!r}; it must be a non-empty string")
        for link in self.links:
            if not isinstance(link, (Base, Series, Mobile)):
                raise DefinitionError(f"{self.name!r} has {link!r} among its links; it must be Base, Series or Mobile")
        if not isinstance(self.planar, (bool, np.bool_)):
            raise DefinitionError(f"planar of {self.name!r} is {self.planar!r}; it must be True or False")
        if self.planar:
            self._complete_planar_links()
        self._check_links()
        self._check_closures()
        self._check_variables()
        if self.characteristic_length is not None:
            stated = self.characteristic_length
            try:
                length = float(stated)
            except (TypeError, ValueError, OverflowError) as error:
                raise DefinitionError(
                    f"characteristic length of {self.name!r} is {stated!r}; it must be a number of metres"
                ) from error
            if not (np.isfinite(length) and length > 0):
                raise DefinitionError(f"characteristic length of {self.name!r} is {length} m; it must be above 0")
            object.__setattr__(self, "characteristic_length", length)

    # -- reading ---------------------------------------------------------------------------------------------------

    @cached_property
    def constraints(self) -> tuple[Closure, ...]:
        """List the simple constraints that the closures are made of, in the order of the closures."""
        return tuple(part for closure in self.closures for part in closure.expand(self.planar))

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """List every variable in the order of X: active, passive, operational."""
        taken = {*self.active, *self.operational}
        declared = {u.name: u for u in self._unknowns}
        passive = [name for name in declared if name not in taken]

        def build(names: Iterable[str], role: Role) -> list[Variable]:
            unknowns = [declared[n] for n in names]
            scales = [{"length": self.length, "angle": 1.0, "force": u.scale}[u.kind] for u in unknowns]
            return [
                Variable(u.name, u.kind, role, u.link, u.range, scale)
                for u, scale in zip(unknowns, scales, strict=True)
            ]

        return tuple(build(self.active, "active") + build(passive, "passive") + build(self.operational, "operational"))

    @cached_property
    def _unknowns(self) -> tuple[Unknown, ...]:
        """List what links and closures declare; two closures may share an unknown."""
        moved = [Unknown(m.name, m.kind, link.name, m.range) for link in self.links for m in link.motions]
        brought = {u.name: u for closure in self.closures for u in closure.declared}
        return (*moved, *brought.values())

    @cached_property
    def names(self) -> tuple[str, ...]:
        """List the names of the variables in the order of X."""
        return tuple(v.name for v in self.variables)

    @property
    def passive(self) -> tuple[str, ...]:
        """List the variables that are neither active nor operational."""
        return tuple(v.name for v in self.variables if v.role == "passive")

    @property
    def base(self) -> Base:
        """Give the base link."""
        return next(link for link in self.links if isinstance(link, Base))

    @cached_property
    def length(self) -> float:
        """Give the characteristic length [m], stated or computed."""
        if self.characteristic_length is not None:
            return float(self.characteristic_length)
        return self.size

    @cached_property
    def size(self) -> float:
        """Give the mean distance between the points of the description [m], 1 where there are none."""
        points = [link.at for link in self.links if isinstance(link, Series)]
        points += [p for c in self.closures for p in c.points]
        distances = [float(np.linalg.norm(p)) for p in points]
        positive = [d for d in distances if d > 0.0]
        return float(np.mean(positive)) if positive else 1.0

    def link(self, name: str) -> Link:
        """Find a link by name.

        Raises:
            UnknownNameError: There is no such link.
        """
        for link in self.links:
            if link.name == name:
                return link
        raise unknown_name(f"link of {self.name!r}", name, (link.name for link in self.links))

    def index(self, name: str) -> int:
        """Find the position of a variable in X.

        Raises:
            UnknownNameError: There is no such variable.
        """
        try:
            return self._positions[name]
        except KeyError:
            raise unknown_name(f"variable of {self.name!r}", name, self.names) from None

    def indices(self, names: Iterable[str]) -> list[int]:
        """Find the positions of several variables in X."""
        return [self.index(name) for name in names]

    @cached_property
    def _positions(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    @cached_property
    def ordered_links(self) -> tuple[Link, ...]:
        """List the links with every father before its sons."""
        place = {link.name: i for i, link in enumerate(self.links)}
        sons: dict[str, list[Link]] = {}
        for link in self.links:
            if isinstance(link, Series):
                sons.setdefault(link.father, []).append(link)
        generation = [link for link in self.links if not isinstance(link, Series)]
        done: dict[str, Link] = {}
        while generation:
            done.update((link.name, link) for link in generation)
            born = [son for link in generation for son in sons.get(link.name, ())]
            generation = sorted(born, key=lambda link: place[link.name])
        waiting = [link for link in self.links if link.name not in done]
        if waiting:
            circle = ", ".join(repr(link.name) for link in waiting)
            raise DefinitionError(f"fathers of {self.name!r} form a cycle among the links {circle}")
        return tuple(done.values())

    # -- checking --------------------------------------------------------------------------------------------------

    def _complete_planar_links(self) -> None:
        links = [
            replace(k, coordinates=PLANAR_COORDINATES) if isinstance(k, Mobile) and k.coordinates is None else k
            for k in self.links
        ]
        object.__setattr__(self, "links", tuple(links))
        for link in links:
            for m in link.motions:
                if (m.kind == "angle") != (m.axis == "z"):
                    raise DefinitionError(
                        f"{self.name!r} is planar, but {m.name!r} of link {link.name!r} is {_describe(m)}; "
                        "rotations must be about z and translations along x or y"
                    )
            at, rotation = getattr(link, "at", (0, 0, 0)), getattr(link, "rotation", (0, 0, 0))
            if at[2] != 0 or rotation[0] != 0 or rotation[1] != 0:
                raise DefinitionError(f"{self.name!r} is planar, but link {link.name!r} is placed out of its plane")

    def _check_links(self) -> None:
        bases = [link.name for link in self.links if isinstance(link, Base)]
        if len(bases) != 1:
            raise DefinitionError(f"{self.name!r} has {len(bases)} base links {bases}; it must have exactly one")
        _check_unique("link", (link.name for link in self.links), self.name)
        known = {link.name for link in self.links}
        for link in self.links:
            if isinstance(link, Series) and link.father not in known:
                raise unknown_name(f"father of link {link.name!r}", link.father, sorted(known - {link.name}))
        _ = self.ordered_links

    def _check_closures(self) -> None:
        known = [link.name for link in self.links]
        for closure in self.closures:
            if not isinstance(closure, Closure):
                raise DefinitionError(f"{self.name!r} has {closure!r} among its closures; it must be a Closure")
            for end in closure.links:
                if end not in known:
                    raise unknown_name(f"link in closure {closure.name!r}", end, known)
            if isinstance(closure, LinkClosure) and closure.link_A == closure.link_B:
                raise DefinitionError(f"closure {closure.name!r} ties {closure.link_A!r} to itself")
        _check_unique("closure", (closure.name for closure in self.closures), self.name)
        _check_unique("constraint", (part.name for part in self.constraints), self.name)

    def _check_variables(self) -> None:
        declared = [u.name for u in self._unknowns]
        _check_unique("variable", declared, self.name)
        self._check_forces()
        for role in ("active", "operational"):
            for name in getattr(self, role):
                if not isinstance(name, str) or name not in declared:
                    raise unknown_name(f"{role} variable of {self.name!r}", name, declared)
            _check_unique(f"{role} variable", getattr(self, role), self.name)
        both = [name for name in self.active if name in self.operational]
        if both:
            raise DefinitionError(f"variable {both[0]!r} of {self.name!r} is both active and operational; choose one")
        kinds: dict[str, str] = {u.name: u.kind for u in self._unknowns}
        for constraint in self.constraints:
            for name in constraint.related:
                if name not in kinds:
                    raise unknown_name(f"variable in closure {constraint.name!r}", name, declared)
            if isinstance(constraint, Coupling):
                constraint.check_kinds(kinds)
        if not self.active:
            raise DefinitionError(f"{self.name!r} has no active variable; name at least one")
        if not self.operational:
            raise DefinitionError(f"{self.name!r} has no operational variable; name at least one")

    def _check_forces(self) -> None:
        """Refuse two equilibria that say different things of one tension, or pull one link twice."""
        balanced = [c for c in self.constraints if isinstance(c, Equilibrium)]
        _check_unique("equilibrium of link", (c.link for c in balanced), self.name)
        known: dict[str, Tension] = {}
        for tension in (t for c in balanced for t in c.tensions):
            if known.setdefault(tension.name, tension) != tension:
                raise DefinitionError(
                    f"tension {tension.name!r} of {self.name!r} is described twice, differently; where a cable pulls "
                    "two links, both equilibria must hold the same"
                )


def _describe(motion: Motion) -> str:
    return f"a rotation about {motion.axis}" if motion.kind == "angle" else f"a translation along {motion.axis}"


def _check_unique(kind: str, names: Iterable[str], owner: str) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise DefinitionError(f"{kind} {name!r} appears twice in {owner!r}; names must be unique")
        seen.add(name)
