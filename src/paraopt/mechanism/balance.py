"""Closures that tie no links: relations between joint variables, and the static balance of a link under cables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from paraopt.errors import DefinitionError
from paraopt.mechanism.closures import Closure, Point, Vector
from paraopt.mechanism.joints import Range, Unknown, as_range, as_tuple
from paraopt.mechanism.links import as_point
from paraopt.spatial import finite_vector

GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of free fall, downwards along z [m/s^2]."""


@dataclass(frozen=True)
class Coupling(Closure):
    """Relate variables as gears, drums and pulleys do: `sum c_i q_i + sum r_j theta_j = constant`, 1 equation.

    The variables of `coefficients` are all lengths, all angles or all forces. Angles join a relation of lengths by
    their radii: a drum is `Coupling({"cable": 1}, radii={"drum": -0.05}, length=1.2)`, a cable over a pulley
    `Coupling({"free length": 1, "paid out": -1}, radii={"wrap angle": 0.03})`, a pair of gears
    `Coupling({"wheel": 40, "pinion": 20})`.

    Attributes:
        coefficients: Factor of each variable [1].
        radii: Factor of each angle that joins lengths [m].
        length: Constant of a relation of lengths [m].
        angle: Constant of a relation of angles [rad].
        force: Constant of a relation of forces [N].
        name: Name; made of the variables when empty.
    """

    coefficients: Mapping[str, float] = field(default_factory=dict)
    radii: Mapping[str, float] = field(default_factory=dict)
    length: float = 0.0
    angle: float = 0.0
    force: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("coefficients", "radii"):
            given = getattr(self, key)
            if not isinstance(given, Mapping):
                raise DefinitionError(f"{key} of coupling {self.name!r} are {given!r}; they must be a mapping")
            read = {n: as_number(v, f"factor of {n!r} in coupling {self.name!r}") for n, v in given.items()}
            for variable, factor in read.items():
                if factor == 0.0:
                    raise DefinitionError(f"factor of {variable!r} in coupling {self.name!r} is zero; leave it out")
            self._set(key, MappingProxyType(read))
        twice = [n for n in self.coefficients if n in self.radii]
        if twice:
            raise DefinitionError(f"variable {twice[0]!r} has a factor and a radius in coupling {self.name!r}")
        if len(self.related) < 2:
            raise DefinitionError(f"coupling {self.name!r} relates {list(self.related)}; it must relate two or more")
        for key in ("length", "angle", "force"):
            self._set(key, as_number(getattr(self, key), f"{key} of coupling {self.name!r}"))
        self._set("name", self.name or f"coupling of {', '.join(map(str, self.related))}")

    @property
    def related(self) -> tuple[str, ...]:
        return (*self.coefficients, *self.radii)

    def check_kinds(self, kinds: Mapping[str, str]) -> str:
        """Refuse variables whose kinds do not fit, and tell what kind of relation it is.

        Args:
            kinds: Kind of each variable of the mechanism.

        Returns:
            "length", "angle" or "force".

        Raises:
            DefinitionError: The units of the relation do not fit.
        """
        for name in self.radii:
            if kinds[name] != "angle":
                raise DefinitionError(
                    f"{name!r} has a radius in {self.name!r}, but it is a {kinds[name]}; only an angle may"
                )
        found = {"length"} if self.radii else set()
        found |= {kinds[name] for name in self.coefficients}
        if len(found) > 1:
            raise DefinitionError(
                f"{self.name!r} adds variables of different kinds, {sorted(found)}; give angles among lengths a radius"
            )
        (kind,) = found
        for other in ("length", "angle", "force"):
            if other != kind and getattr(self, other) != 0.0:
                raise DefinitionError(
                    f"{self.name!r} relates variables of kind {kind}, but states {other!r}, "
                    f"{getattr(self, other)}; its constant is {kind!r}"
                )
        return kind


@dataclass(frozen=True)
class Tension:
    """Describe the pull of a cable between two points, the value of which is a variable of the mechanism.

    Attributes:
        name: Name of the variable [N], positive where the cable pulls.
        link_A: Name of the link that carries the exit.
        point_A: The exit in its frame [m].
        link_B: Name of the link that carries the attachment.
        point_B: The attachment in its frame [m].
        range: Lowest and highest tension [N].
    """

    name: str
    link_A: str
    point_A: Point
    link_B: str
    point_B: Point
    range: Range = (0.0, np.inf)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise DefinitionError(f"name of a tension is {self.name!r}; it must be a non-empty string")
        for side in "AB":
            link = getattr(self, f"link_{side}")
            if not isinstance(link, str):
                raise DefinitionError(
                    f"link_{side} of tension {self.name!r} is {link!r}; it must be the name of a link"
                )
            point = as_point(getattr(self, f"point_{side}"), f"point_{side} of tension {self.name!r}")
            object.__setattr__(self, f"point_{side}", point)
        if self.link_A == self.link_B:
            raise DefinitionError(f"tension {self.name!r} pulls {self.link_A!r} towards itself")
        object.__setattr__(self, "range", as_range(self.range, f"range of {self.name!r}"))


@dataclass(frozen=True)
class Equilibrium(Closure):
    """Hold a link in static balance under cables, its weight and a constant wrench.

    `sum t_i u_i + m g + f = 0` and `sum t_i (p_i - c) x u_i + (p_f - c) x f + n = 0` with u_i the unit vector from the
    link's end of cable i to its other end, p_i the link's end, c the centre of mass and p_f the point of the force, all
    in the world: 6 equations (3 in the plane). Each tension t_i is a variable that this closure brings with it. What
    else touches the link must not push it: closures that measure the length of a cable do not, a hinge would. Cables
    have no mass.

    With fewer cables than equations the robot hangs: its lengths leave freedoms that these equations decide, tilt
    included, so that it has as many independent coordinates as cables. The matrix of what the lengths leave open,
    [N K], is that of the energy's second variation; where it loses rank, an equilibrium ceases to be unique, at the
    edge of its stability. With more cables than equations the differences are internal forces, which lengths of rigid
    cables do not decide: impose some tensions then.

    Attributes:
        link: Name of the link.
        tensions: The cables that pull it, each by one end; a tension may pull two links that each have an equilibrium.
        mass: Mass of the link and of what it carries [kg].
        centre: Centre of mass in its frame [m].
        force: Constant force in the world [N].
        at: Point of the link at which it acts, in its frame [m].
        moment: Constant moment in the world [N m].
        gravity: Acceleration of free fall in the world [m/s^2].
        reference_force: Unit in which forces are judged [N]; the weight when None, or the size of the constant force
            where nothing has weight.
        name: Name; "equilibrium of" the link when empty.

    Source: Lahouar, IV.2; CarricatoMerlet2013.
    """

    link: str
    tensions: Sequence[Tension]
    mass: float = 0.0
    centre: Point = (0.0, 0.0, 0.0)
    force: Sequence[float] = (0.0, 0.0, 0.0)
    at: Point = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    gravity: Sequence[float] = GRAVITY
    reference_force: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.link, str):
            raise DefinitionError(f"link of an equilibrium is {self.link!r}; it must be the name of a link")
        self._set("name", self.name or f"equilibrium of {self.link}")
        self._set("tensions", as_tuple(self.tensions, f"tensions of {self.name!r}"))
        for tension in self.tensions:
            if not isinstance(tension, Tension):
                raise DefinitionError(f"{self.name!r} has {tension!r} among its tensions; it must be a Tension")
            if self.link not in (tension.link_A, tension.link_B):
                raise DefinitionError(
                    f"tension {tension.name!r} is between {tension.link_A!r} and {tension.link_B!r}; one of them must "
                    f"be {self.link!r}, the link of {self.name!r}"
                )
        names = [t.name for t in self.tensions]
        if not names or len(set(names)) < len(names):
            raise DefinitionError(f"tensions of {self.name!r} are {names}; there must be some, each with its own name")
        self._set("centre", as_point(self.centre, f"centre of mass in {self.name!r}"))
        self._set("at", as_point(self.at, f"point of the force in {self.name!r}"))
        for key in ("force", "moment", "gravity"):
            vector = finite_vector(getattr(self, key), 3, f"{key} in {self.name!r}")
            self._set(key, tuple(vector.tolist()))
        mass = as_number(self.mass, f"mass in {self.name!r}")
        if mass < 0:
            raise DefinitionError(f"mass in {self.name!r} is {mass} kg; it must not be negative")
        self._set("mass", mass)
        if self.reference_force is not None:
            self._set("reference_force", as_number(self.reference_force, f"reference force of {self.name!r}"))
        if not self.scale > 0:
            raise DefinitionError(
                f"{self.name!r} has no weight and no force, so that nothing tells how small a force is; state a "
                "reference_force above 0"
            )

    @property
    def links(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys([self.link, *(end for t in self.tensions for end in (t.link_A, t.link_B))]))

    @property
    def scale(self) -> float:
        """Give the unit in which its forces are judged [N]: stated, or the weight, or the constant force."""
        if self.reference_force is not None:
            return self.reference_force
        weight = self.mass * float(np.linalg.norm(self.gravity))
        return weight or float(np.linalg.norm(self.force))

    @property
    def declared(self) -> tuple[Unknown, ...]:
        return tuple(Unknown(t.name, "force", t.link_B, t.range, self.scale) for t in self.tensions)

    @property
    def related(self) -> tuple[str, ...]:
        return tuple(t.name for t in self.tensions)

    @property
    def points(self) -> tuple[Vector, ...]:
        return tuple(p for t in self.tensions for p in (t.point_A, t.point_B))  # type: ignore[misc]

    def _check_planar(self) -> None:
        flat = {"gravity": self.gravity, "force": self.force, "centre": self.centre, "at": self.at}
        flat |= {f"point_{s} of {t.name!r}": getattr(t, f"point_{s}") for t in self.tensions for s in "AB"}
        for what, vector in flat.items():
            if vector[2] != 0:
                raise DefinitionError(
                    f"{self.name!r} is in the plane z = 0, but its {what} is {tuple(vector)}; the third component must "
                    "be zero"
                )
        if self.moment[0] != 0 or self.moment[1] != 0:
            raise DefinitionError(f"{self.name!r} is in the plane z = 0, but its moment is {self.moment} N m")


def as_number(value: Any, what: str) -> float:
    """Read a finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} is {value!r}; it must be a number") from error
    if isinstance(value, bool) or not np.isfinite(number):
        raise DefinitionError(f"{what} is {value!r}; it must be a finite number")
    return number
