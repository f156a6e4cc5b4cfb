"""Joints of the tree: each is a sequence of named elementary motions along base axes.

A joint's placement in its father's frame belongs to the link that it carries (`Series.at`, `Series.rotation`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from paraopt.errors import DefinitionError
from paraopt.spatial import AXES

Kind = Literal["angle", "length"]
"""What a motion of a joint changes."""
VariableKind = Literal["angle", "length", "force"]
"""What a variable of the mechanism may be: a motion, or a force that holds it."""
UNITS: Mapping[VariableKind, str] = {"angle": "rad", "length": "m", "force": "N"}
Range = tuple[float, float]
UNLIMITED: Range = (-np.inf, np.inf)


def as_tuple(values: Any, what: str) -> tuple[Any, ...]:
    """Read a sequence; a lone string, a mapping and a set are none."""
    if isinstance(values, (str, bytes, Mapping, Set)) or not isinstance(values, Iterable):
        raise DefinitionError(f"{what} is {values!r}; it must be a sequence")
    try:
        return tuple(values)
    except TypeError as error:  # an array without dimension says that it is iterable
        raise DefinitionError(f"{what} is {values!r}; it must be a sequence") from error


def as_range(values: Any, what: str) -> Range:
    """Read a range: the lowest value [rad or m], then the highest, either of them possibly infinite."""
    try:
        low, high = (float(v) for v in as_tuple(values, what))
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} is {values!r}; it must be two numbers") from error
    if np.isnan(low) or np.isnan(high) or not low < high:
        raise DefinitionError(f"{what} is ({low}, {high}); its low end must be below its high end")
    return low, high


@dataclass(frozen=True)
class Motion:
    """Describe one degree of freedom: a rotation about, or a translation along, a base axis.

    Attributes:
        name: Name of the variable.
        kind: "angle" [rad] or "length" [m].
        axis: "x", "y" or "z" of the frame reached by the motions before it.
        range: Lowest and highest value [rad or m].
    """

    name: str
    kind: Kind
    axis: str
    range: Range = UNLIMITED

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise DefinitionError(f"name of a variable is {self.name!r}; it must be a non-empty string")
        if not isinstance(self.axis, str) or self.axis not in AXES:
            raise DefinitionError(f"axis of {self.name!r} is {self.axis!r}; it must be one of {AXES}")
        if not isinstance(self.kind, str) or self.kind not in ("angle", "length"):
            raise DefinitionError(f"kind of {self.name!r} is {self.kind!r}; it must be 'angle' or 'length'")
        object.__setattr__(self, "range", as_range(self.range, f"range of {self.name!r}"))


@dataclass(frozen=True)
class Unknown:
    """Describe a variable that no joint moves and a closure brings with it, such as the tension of a cable.

    Attributes:
        name: Name of the variable.
        kind: "force" [N], "length" [m] or "angle" [rad].
        link: Name of the link to which it belongs.
        range: Lowest and highest value, in the unit of its kind.
        scale: Unit in which a force is judged [N]; not used for other kinds.
    """

    name: str
    kind: VariableKind
    link: str
    range: Range = UNLIMITED
    scale: float = 1.0


@dataclass(frozen=True)
class Joint:
    """Group the motions that one joint allows; the members of the family fill `motions`."""

    def __post_init__(self) -> None:
        owner = f"{type(self).__name__.lower()} joint {getattr(self, 'name', getattr(self, 'names', ''))!r}"
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name == "range":
                value = as_range(value, f"range of {getattr(self, 'name', None)!r}")
            elif f.name == "ranges" and value is not None:
                value = tuple(as_range(v, f"range of {owner}") for v in as_tuple(value, f"ranges of {owner}"))
            elif f.name == "axes" or (f.name == "names" and not isinstance(value, str)):
                value = as_tuple(value, f"{f.name} of {owner}")
            object.__setattr__(self, f.name, value)
        _ = self.motions  # a faulty description is refused here, not at the first use

    @property
    def motions(self) -> tuple[Motion, ...]:
        """List the elementary motions in the order in which they are applied."""
        raise DefinitionError("a bare Joint has no motions; use Revolute, Prismatic, Spherical, Universal, ...")


@dataclass(frozen=True)
class Fixed(Joint):
    """Attach a link rigidly to its father."""

    @property
    def motions(self) -> tuple[Motion, ...]:
        return ()


@dataclass(frozen=True)
class Revolute(Joint):
    """Rotate about a base axis.

    Attributes:
        name: Name of the angle.
        axis: "x", "y" or "z".
        range: Lowest and highest angle [rad].
    """

    name: str
    axis: str = "z"
    range: Range = UNLIMITED

    @property
    def motions(self) -> tuple[Motion, ...]:
        return (Motion(self.name, "angle", self.axis, self.range),)


@dataclass(frozen=True)
class Prismatic(Joint):
    """Slide along a base axis.

    Attributes:
        name: Name of the stroke.
        axis: "x", "y" or "z".
        range: Lowest and highest stroke [m].
    """

    name: str
    axis: str = "z"
    range: Range = UNLIMITED

    @property
    def motions(self) -> tuple[Motion, ...]:
        return (Motion(self.name, "length", self.axis, self.range),)


def _names(given: str | Sequence[str], suffixes: Sequence[str], joint: str) -> tuple[str, ...]:
    if isinstance(given, str):
        return tuple(f"{given}.{suffix}" for suffix in suffixes)
    names = tuple(given)
    if len(names) != len(suffixes):
        raise DefinitionError(f"{joint} joint has names {names!r}; it needs {len(suffixes)} of them")
    return names


def _ranges(given: Sequence[Range] | None, count: int, joint: str) -> tuple[Range, ...]:
    if given is None:
        return (UNLIMITED,) * count
    if len(given) != count:
        raise DefinitionError(f"{joint} joint has {len(given)} ranges; it needs {count}")
    return tuple(given)


def as_order(order: str, owner: str) -> str:
    """Read the order of three rotations, such as "xyz" or "zyx"."""
    if not isinstance(order, str) or sorted(order) != list(AXES):
        raise DefinitionError(f"order of rotations of {owner} is {order!r}; it must be 'xyz', 'zyx' or another order")
    return order


@dataclass(frozen=True)
class Spherical(Joint):
    """Rotate about x, then y, then z, or in another order; each axis is that of the frame reached before.

    Attributes:
        names: Three names in the order of the rotations, or one stem that becomes `stem.x`, `stem.y`, `stem.z`.
        ranges: Lowest and highest value of each angle [rad] in the order of the rotations; unlimited when None.
        order: Order of the rotations: "xyz" is `Rx Ry Rz`, "zyx" is `Rz Ry Rx`.

    Source: Lahouar, II.1.
    """

    names: str | Sequence[str]
    ranges: Sequence[Range] | None = None
    order: str = "xyz"

    @property
    def motions(self) -> tuple[Motion, ...]:
        order = as_order(self.order, f"spherical joint {self.names!r}")
        names = _names(self.names, tuple(order), "spherical")
        ranges = _ranges(self.ranges, 3, "spherical")
        return tuple(Motion(n, "angle", a, r) for n, a, r in zip(names, order, ranges, strict=True))


@dataclass(frozen=True)
class Universal(Joint):
    """Rotate about one base axis, then about another.

    Attributes:
        names: Two names, or one stem that becomes `stem.<first axis>`, `stem.<second axis>`.
        axes: The two axes, different from each other.
        ranges: Lowest and highest value of each angle [rad]; unlimited when None.
    """

    names: str | Sequence[str]
    axes: tuple[str, str] = ("x", "y")
    ranges: Sequence[Range] | None = None

    @property
    def motions(self) -> tuple[Motion, ...]:
        if len(self.axes) != 2 or not all(isinstance(a, str) for a in self.axes) or self.axes[0] == self.axes[1]:
            raise DefinitionError(f"universal joint {self.names!r} has axes {self.axes!r}; it needs two different axes")
        names, ranges = _names(self.names, self.axes, "universal"), _ranges(self.ranges, 2, "universal")
        return tuple(Motion(n, "angle", a, r) for n, a, r in zip(names, self.axes, ranges, strict=True))


@dataclass(frozen=True)
class Cylindrical(Joint):
    """Rotate about an axis and slide along it.

    Attributes:
        names: Names of the angle and of the stroke, or one stem that becomes `stem.angle`, `stem.stroke`.
        axis: "x", "y" or "z".
        ranges: Lowest and highest angle [rad] and stroke [m]; unlimited when None.
    """

    names: str | Sequence[str]
    axis: str = "z"
    ranges: Sequence[Range] | None = None

    @property
    def motions(self) -> tuple[Motion, ...]:
        names = _names(self.names, ("angle", "stroke"), "cylindrical")
        ranges = _ranges(self.ranges, 2, "cylindrical")
        return (Motion(names[0], "angle", self.axis, ranges[0]), Motion(names[1], "length", self.axis, ranges[1]))
