"""How each kind of value of a description stands in a file: read with units, checked, and written back exactly.

A codec has two methods: `read` turns what TOML holds into what a constructor takes, `write` turns a field into what
TOML can hold. Every refusal names the file, the path of the key, the value, and what it must be.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from decimal import Decimal
from typing import Any, Literal, Protocol

import numpy as np

from paraopt.errors import DefinitionError, unknown_name
from paraopt.mechanism.closures import as_direction
from paraopt.mechanism.joints import VariableKind

Unit = Literal["length", "angle", "mass", "force", "none"]
# by how many places the decimal point moves towards metres
LENGTHS: Mapping[str, int] = {"m": 0, "cm": 2, "mm": 3}
ANGLES = ("rad", "deg")


@dataclass(frozen=True)
class Units:
    """State the units of a file.

    Attributes:
        length: One of `LENGTHS`.
        angle: One of `ANGLES`.
    """

    length: str = "m"
    angle: str = "rad"

    def to_si(self, value: float, unit: Unit) -> float:
        """Convert a number of the file to m or rad."""
        if unit == "length" and LENGTHS[self.length]:
            # 5.2 cm are the number that a person calls 0.052 m; a quotient may be its neighbour
            return float(Decimal(repr(value)).scaleb(-LENGTHS[self.length]))
        return math.radians(value) if unit == "angle" and self.angle == "deg" else value


@dataclass(frozen=True)
class Place:
    """Say where in a file a value stands, and how it is to be understood.

    Attributes:
        file: Name of the file.
        path: Path of the key, such as `links[3].joint.axis`; empty at the top.
        units: Units of the file.
        kinds: Kind of each variable of the mechanism, known once it is read.
    """

    file: str
    path: str = ""
    units: Units = field(default_factory=Units)
    kinds: Mapping[str, VariableKind] = field(default_factory=dict)

    def __truediv__(self, key: str | int) -> Place:
        if isinstance(key, int):
            return replace(self, path=f"{self.path}[{key}]")
        plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
        word = key if plain and len(key) < 60 else shorten(key)
        return replace(self, path=f"{self.path}.{word}" if self.path else word)

    def __str__(self) -> str:
        return f"{self.file}: {self.path}" if self.path else self.file

    def error(self, message: str) -> DefinitionError:
        """Build an error about the thing that stands here."""
        return DefinitionError(f"{self} {message}" if self.path else f"{self}: {message}")

    def wrong(self, value: Any, wanted: str) -> DefinitionError:
        """Build the error for a value of the wrong kind."""
        return self.error(f"is {shorten(value)}; it must be {wanted}")

    def unknown(self, kind: str, name: str, valid: Iterable[str]) -> DefinitionError:
        """Build the error for a name that does not exist."""
        return self.wrap(unknown_name(kind, name if len(name) < 60 else f"{name[:50]}...", valid))

    def wrap(self, error: DefinitionError) -> DefinitionError:
        """Put the place before the words of a constructor, keeping the type of the error."""
        return type(error)(f"{self}: {error}")


class Codec(Protocol):
    """Read and write one kind of value."""

    def read(self, value: Any, place: Place) -> Any:
        """Turn a value of the file into what a constructor takes."""

    def write(self, value: Any) -> Any:
        """Turn a field into what the file can hold."""


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 60


def shorten(value: Any) -> str:
    """Name a value of a file in a message, in the words of TOML, never too long and however deep it is."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return f"a table with {', '.join(_SHORT.repr(k) for k in list(value)[:4])}" if value else "an empty table"
    if isinstance(value, int) and abs(value) >= 10**30:
        return "an integer of more than 30 digits"
    return _SHORT.repr(value)


@dataclass(frozen=True)
class Text:
    """Read a string, one of some words where these are given."""

    words: tuple[str, ...] = ()

    def read(self, value: Any, place: Place) -> str:
        if not isinstance(value, str):
            raise place.wrong(value, f"one of {', '.join(map(repr, self.words))}" if self.words else "a string")
        if self.words and value not in self.words:
            raise place.unknown("word", value, self.words)
        return value

    def write(self, value: Any) -> str:
        return str(value)


@dataclass(frozen=True)
class Flag:
    """Read true or false."""

    def read(self, value: Any, place: Place) -> bool:
        if not isinstance(value, bool):
            raise place.wrong(value, "true or false")
        return value

    def write(self, value: Any) -> bool:
        return bool(value)


@dataclass(frozen=True)
class Whole:
    """Read a whole number."""

    def read(self, value: Any, place: Place) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or abs(value) >= 2**63:
            raise place.wrong(value, "a whole number below 2^63")
        return value

    def write(self, value: Any) -> int:
        return int(value)


@dataclass(frozen=True)
class Number:
    """Read a number; `infinite` allows inf, which opens a range."""

    unit: Unit = "none"
    infinite: bool = False

    def read(self, value: Any, place: Place) -> float:
        wanted = "a number" if self.infinite else "a finite number"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise place.wrong(value, wanted)
        try:
            number = float(value)
        except OverflowError as error:
            raise place.wrong(value, f"{wanted} below 1.8e308") from error
        if math.isnan(number) or not (self.infinite or math.isfinite(number)):
            raise place.wrong(value, wanted)
        return place.units.to_si(number, self.unit)

    def write(self, value: Any) -> float:
        return float(value)


@dataclass(frozen=True)
class Items:
    """Read an array whose members are of one kind, or of one kind each."""

    members: Codec | Sequence[Codec]
    what: str

    def read(self, value: Any, place: Place) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise place.wrong(value, self.what)
        codecs = self._codecs(len(value))
        if len(codecs) != len(value):
            raise place.wrong(value, self.what)
        return tuple(codec.read(v, place / i) for i, (v, codec) in enumerate(zip(value, codecs, strict=True)))

    def write(self, value: Any) -> list[Any]:
        values = list(value)
        return [codec.write(v) for v, codec in zip(values, self._codecs(len(values)), strict=True)]

    def _codecs(self, count: int) -> Sequence[Codec]:
        return self.members if isinstance(self.members, Sequence) else [self.members] * count


@dataclass(frozen=True)
class Vector:
    """Read an array of numbers of one unit, of an allowed length."""

    unit: Unit
    sizes: tuple[int, ...]

    def read(self, value: Any, place: Place) -> tuple[float, ...]:
        wanted = f"an array of {' or '.join(map(str, self.sizes))} numbers"
        if not isinstance(value, list) or len(value) not in self.sizes:
            raise place.wrong(value, wanted)
        return tuple(Number(self.unit).read(v, place / i) for i, v in enumerate(value))

    def write(self, value: Any) -> list[float]:
        return [float(v) for v in value]


@dataclass(frozen=True)
class Direction:
    """Read "x", "-y", or the components of a direction."""

    def read(self, value: Any, place: Place) -> str | tuple[float, ...]:
        if isinstance(value, str):
            return Text(("x", "y", "z", "-x", "-y", "-z")).read(value, place)
        if isinstance(value, list):
            return Vector("none", (2, 3)).read(value, place)
        raise place.wrong(value, "'x', 'y', 'z', '-' before it allowed, or an array of 2 or 3 numbers")

    def write(self, value: Any) -> str | list[float]:
        plain = Vector("none", (3,)).write(value)
        for word in ("x", "y", "z", "-x", "-y", "-z"):
            if is_same(plain, list(as_direction(word, "direction"))):
                return word
        return plain


@dataclass(frozen=True)
class Names:
    """Read an array of names, or the stem that a joint makes them of."""

    def read(self, value: Any, place: Place) -> str | tuple[str, ...]:
        if isinstance(value, str):
            return value
        names: tuple[str, ...] = Items(Text(), "a string, or an array of strings").read(value, place)
        return names

    def write(self, value: Any) -> str | list[str]:
        return value if isinstance(value, str) else [str(v) for v in value]


@dataclass(frozen=True)
class ByName:
    """Read a table from names to values of one kind; `valid` lists the names where only these are allowed."""

    values: Codec
    valid: tuple[str, ...] = ()

    def read(self, value: Any, place: Place) -> dict[str, Any]:
        for key in _table(value, place):
            if self.valid and key not in self.valid:
                raise place.unknown("key", key, self.valid)
        return {k: self.values.read(v, place / k) for k, v in value.items()}

    def write(self, value: Any) -> dict[str, Any]:
        return {str(k): self.values.write(v) for k, v in value.items()}


@dataclass(frozen=True)
class ByVariable:
    """Read a table from variables to values whose unit is that of the variable.

    `kinds` holds the kind of each name; those of the mechanism when None.
    """

    codecs: Mapping[VariableKind, Codec]
    kinds: Mapping[str, VariableKind] | None = None

    def read(self, value: Any, place: Place) -> dict[str, Any]:
        kinds = place.kinds if self.kinds is None else self.kinds
        for key in _table(value, place):
            if key not in kinds:
                raise place.unknown("variable", key, kinds)
        return {k: self.codecs[kinds[k]].read(v, place / k) for k, v in value.items()}

    def write(self, value: Any) -> dict[str, Any]:
        return {str(k): self.codecs["length"].write(v) for k, v in value.items()}


def number_range(unit: Unit) -> Items:
    """Build the codec of a range: lowest and highest value, either of them may be infinite."""
    return Items((Number(unit, infinite=True),) * 2, "an array of two numbers, lowest and highest")


def number_ranges(*units: Unit) -> Items:
    """Build the codec of the ranges of a composite joint."""
    return Items([number_range(u) for u in units], f"an array of {len(units)} ranges [lowest, highest]")


@dataclass(frozen=True)
class Record:
    """Read a table whose keys are the fields of a dataclass.

    Attributes:
        cls: The dataclass.
        codecs: Codec of each field, by name.
        tag: Value of the key `type` that stands with the fields; no such key when empty.
    """

    cls: type
    codecs: Mapping[str, Codec]
    tag: str = ""

    @property
    def keys(self) -> list[str]:
        """List the keys that may stand in the table."""
        return [*(["type"] if self.tag else []), *self.codecs]

    @property
    def required(self) -> list[str]:
        """List the keys that must stand in the table."""
        return [
            f.name
            for f in fields(self.cls)
            if f.name in self.codecs and f.default is MISSING and f.default_factory is MISSING
        ]

    def read(self, value: Any, place: Place, **given: Any) -> Any:
        """Read the table and build the thing; `given` are fields that do not stand in it."""
        for key in _table(value, place):
            if key not in self.keys:
                raise place.unknown(f"key of a {self.cls.__name__}", key, self.keys)
        missing = [k for k in self.required if k not in value]
        if missing:
            raise place.error(f"lacks {', '.join(map(repr, missing))}; a {self.cls.__name__} needs it")
        arguments = {k: codec.read(value[k], place / k) for k, codec in self.codecs.items() if k in value}
        return self.build({**arguments, **given}, place)

    def build(self, arguments: Mapping[str, Any], place: Place) -> Any:
        """Call the constructor."""
        try:
            return self.cls(**arguments)
        except DefinitionError as error:
            raise place.wrap(error) from error

    def write(self, value: Any, **given: Any) -> dict[str, Any]:
        """Write the fields, without those that the constructor would give by itself."""
        kept = {k: getattr(value, k) for k in self.codecs}
        for name in [k for k in kept if k not in self.required]:
            rest = {k: v for k, v in kept.items() if k != name}
            if kept[name] is None or self._implies({**rest, **given}, name, kept[name]):
                kept = rest
        tag = {"type": self.tag} if self.tag else {}
        return {**tag, **{k: self.codecs[k].write(v) for k, v in kept.items()}}

    def _implies(self, arguments: Mapping[str, Any], name: str, value: Any) -> bool:
        try:
            given = getattr(self.cls(**arguments), name)
        except DefinitionError:  # without the field the others make no sense: it must be written
            return False
        return given is not None and is_same(self.codecs[name].write(given), self.codecs[name].write(value))


@dataclass(frozen=True)
class Family:
    """Read a table whose key `type` names one of several dataclasses."""

    what: str
    members: Mapping[str, Record]

    def read(self, value: Any, place: Place) -> Any:
        name = _table(value, place).get("type")
        if name is None:
            raise place.error(f"lacks 'type'; it must name a {self.what}: {', '.join(map(repr, self.members))}")
        if not isinstance(name, str):
            raise (place / "type").wrong(name, f"a string that names a {self.what}")
        if name not in self.members:
            raise (place / "type").unknown(f"type of a {self.what}", name, self.members)
        return self.members[name].read(value, place)

    def write(self, value: Any) -> dict[str, Any]:
        record = self.members.get(type(value).__name__)
        if record is None or record.cls is not type(value):
            raise DefinitionError(
                f"{self.what} {shorten(value)} cannot be written; its type must be one of {', '.join(self.members)}"
            )
        return record.write(value)


def is_same(one: Any, other: Any) -> bool:
    """Tell whether two written values are the same to the last bit, signs of zero included."""
    return repr(one) == repr(other)


def _table(value: Any, place: Place) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise place.wrong(value, "a table")
    return value


def is_exactly(one: Any, other: Any) -> bool:
    """Tell whether two arrays of numbers are the same to the last bit."""
    return np.asarray(one, dtype=float).tobytes() == np.asarray(other, dtype=float).tobytes()
