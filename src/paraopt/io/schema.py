"""The types that may stand in a file, and the kind of value of each of their fields: one line for each type.

A field's kind follows from its name (`at` is a point, `axis_A` a direction); where one name means different things, the
line of the type says which.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.io.codecs import (
    ByName,
    ByVariable,
    Codec,
    Direction,
    Family,
    Flag,
    Items,
    Names,
    Number,
    Place,
    Record,
    Text,
    Vector,
    Whole,
    is_exactly,
    number_range,
    number_ranges,
)
from paraopt.mechanism import (
    Base,
    ClosingCylindrical,
    ClosingPrismatic,
    ClosingRevolute,
    ClosingSpherical,
    ClosingUniversal,
    Coincidence,
    Coupling,
    Cylindrical,
    Equilibrium,
    Fixed,
    LineContact,
    Mechanism,
    Mobile,
    ParallelAxes,
    ParallelPlanes,
    PerpendicularAxes,
    PlanarContact,
    PointOnLine,
    PointOnPlane,
    Prismatic,
    Revolute,
    Series,
    Spherical,
    Tension,
    Universal,
    Weld,
)
from paraopt.mechanism.links import FREE_COORDINATES
from paraopt.robot import PLATFORM_LIMITS, Limits, Robot
from paraopt.shapes import Box, Cable, Capsule, Cone, ConvexPolyhedron, Cylinder, HalfSpace, Mesh, Sphere
from paraopt.spatial import AXES, segment_pose, transform

POINT = Vector("length", (2, 3))
ANGLES = Vector("angle", (3,))
WORDS = Items(Text(), "an array of strings")
LENGTH = Number("length")
CORNERS = Items(Vector("length", (3,)), "an array of points")

# the kind of a field, by its name, in every type that does not say otherwise
FIELDS: dict[str, Codec] = {
    **{key: Text() for key in ("name", "father", "link_A", "link_B", "prefix", "order")},
    "construction": Text(),
    "axis": Text(AXES),
    "axes": Items((Text(AXES), Text(AXES)), "an array of two axes, such as ['x', 'y']"),
    "names": Names(),
    "coordinates": Items(Text(tuple(FREE_COORDINATES)), "an array of strings"),
    "at": POINT,
    "rotation": ANGLES,
    **{f"point_{side}": POINT for side in "AB"},
    **{f"{word}_{side}": Direction() for word, side in product(("axis", "normal", "direction"), "AB")},
    **{key: LENGTH for key in ("spread", "radius", "length")},
    "size": Vector("length", (3,)),
    "vertices": CORNERS,
    "triangles": Items(Items((Whole(),) * 3, "an array of three whole numbers"), "an array of triangles"),
    "parts": Items(CORNERS, "an array of arrays of points"),
}


def record(cls: type, **special: Codec) -> Record:
    """Describe a type whose fields have the kinds of `FIELDS`, but for those that are given.

    Raises:
        DefinitionError: A field has no kind.
    """
    names = [f.name for f in fields(cls)]
    unknown = [n for n in names if n not in FIELDS and n not in special]
    if unknown:
        raise DefinitionError(f"fields {unknown} of {cls.__name__} have no kind of value; name it in the schema")
    return Record(cls, {n: special.get(n) or FIELDS[n] for n in names}, cls.__name__)


def family(what: str, members: Iterable[Record]) -> Family:
    """Collect types that stand in the same place, by name."""
    return Family(what, {r.tag: r for r in members})


@dataclass(frozen=True)
class Solid(Record):
    """Read a shape: its sizes, and its place as `at` and `rotation`, `between` two points, or the rows of `pose`."""

    @property
    def keys(self) -> list[str]:
        between = ["between"] if hasattr(self.cls, "between") else []
        return [*super().keys, "at", "rotation", *between, "pose"]

    def read(self, value: Any, place: Place, **given: Any) -> Any:
        if not isinstance(value, Mapping) or not {"at", "rotation", "between", "pose"} & set(value):
            return super().read(value, place, **given)
        if unknown := [k for k in value if k not in self.keys]:
            raise place.unknown(f"key of a {self.cls.__name__}", unknown[0], self.keys)
        ways = [k for k in ("at", "rotation", "between", "pose") if k in value]
        if len(ways) > 1 and ways != ["at", "rotation"]:
            raise place.error(f"is placed by {' and '.join(ways)}; use at and rotation, or between, or pose")
        rest = {k: v for k, v in value.items() if k not in ways}
        if ways == ["between"]:
            if "length" in rest:
                raise place.error("has a length and is placed between two points; leave one of them out")
            ends = Items((Vector("length", (3,)),) * 2, "an array of two points").read(
                value["between"], place / "between"
            )
            try:
                pose, length = segment_pose(*ends)
            except DefinitionError as error:
                raise (place / "between").wrap(error) from error
            codecs = {k: c for k, c in self.codecs.items() if k != "length"}
            return Record(self.cls, codecs, self.tag).read(rest, place, pose=pose, length=length, **given)
        if ways == ["pose"]:
            pose = _read_rows(value["pose"], place / "pose")
        else:
            at = Vector("length", (3,)).read(value["at"], place / "at") if "at" in value else (0.0, 0.0, 0.0)
            angles = ANGLES.read(value["rotation"], place / "rotation") if "rotation" in value else (0.0, 0.0, 0.0)
            pose = transform(at, angles)
        return super().read(rest, place, pose=pose, **given)

    def write(self, value: Any, **given: Any) -> dict[str, Any]:
        plain = super().write(value, pose=value.pose, **given)
        if is_exactly(value.pose, np.eye(4)):
            return plain
        if (ends := self._ends(value)) is not None:
            del plain["length"]
            return {**plain, "between": ends}
        at = value.pose[:3, 3].tolist()
        if is_exactly(transform(at), value.pose):
            return {**plain, "at": at}
        angles = _angles(value.pose)
        if is_exactly(transform(at, angles), value.pose):
            return {**plain, "at": at, "rotation": angles}
        return {**plain, "pose": value.pose.tolist()}

    def _ends(self, value: Any) -> list[list[float]] | None:
        """Find the two points between which the shape was placed, if they give it back to the last bit."""
        if not hasattr(self.cls, "between"):
            return None
        half = 0.5 * value.length * value.pose[:3, 2]
        exact = np.stack([value.pose[:3, 3] - half, value.pose[:3, 3] + half])
        for digits in (12, 15, None):  # a person's numbers are short; round-off lengthens them
            ends = exact if digits is None else np.round(exact, digits) + 0.0
            try:
                pose, length = segment_pose(ends[0], ends[1])
            except DefinitionError:  # too near each other to be told apart
                continue
            if length == value.length and is_exactly(pose, value.pose):
                return ends.tolist()
        return None


def _read_rows(value: Any, place: Place) -> NDArray[np.float64]:
    row = Items((*[Number()] * 3, LENGTH), "an array of four numbers")
    last = Items((Number(),) * 4, "an array of four numbers")
    return np.array(Items((row, row, row, last), "four rows of four numbers").read(value, place))


def _angles(X: NDArray[np.float64]) -> list[float]:
    """Give angles of `Rx Ry Rz` near those of a pose, at whole numbers of degrees where these are near."""
    angles = np.array(
        [np.arctan2(-X[1, 2], X[2, 2]), np.arctan2(X[0, 2], np.hypot(X[0, 0], X[0, 1])), np.arctan2(-X[0, 1], X[0, 0])]
    )
    degrees = np.round(np.degrees(angles))
    return [
        float(np.radians(d)) if abs(np.radians(d) - a) < 1e-12 else float(a)
        for d, a in zip(degrees, angles, strict=True)
    ]


def solid(cls: type) -> Solid:
    """Describe a shape: its fields but the pose, which may be stated in several ways."""
    plain = record(cls, pose=Text())
    return Solid(cls, {k: c for k, c in plain.codecs.items() if k != "pose"}, plain.tag)


JOINTS = family(
    "joint",
    [
        record(Fixed),
        record(Revolute, range=number_range("angle")),
        record(Prismatic, range=number_range("length")),
        record(Spherical, ranges=number_ranges("angle", "angle", "angle")),
        record(Universal, ranges=number_ranges("angle", "angle")),
        record(Cylindrical, ranges=number_ranges("angle", "length")),
    ],
)
BY_KIND: dict[Any, Codec] = {"length": Number("length"), "angle": Number("angle"), "force": Number("force")}
RANGE_BY_KIND: dict[Any, Codec] = {
    "length": number_range("length"), "angle": number_range("angle"), "force": number_range("force"),
}  # fmt: skip
LINKS = family(
    "link",
    [
        record(Base),
        record(Series, joint=JOINTS),
        record(Mobile, ranges=ByVariable(RANGE_BY_KIND, {c: kind for c, (kind, _) in FREE_COORDINATES.items()})),
    ],
)
_TENSION = record(Tension, range=number_range("force"))
TENSION = Record(Tension, _TENSION.codecs)  # one type only: it needs no tag
CLOSURES = family(
    "closure",
    [
        record(Coincidence),
        record(ParallelAxes),
        record(ParallelPlanes),
        record(PerpendicularAxes),
        record(PointOnLine),
        record(PointOnPlane),
        record(Weld),
        record(ClosingSpherical),
        record(ClosingUniversal),
        record(ClosingCylindrical),
        record(ClosingRevolute),
        record(ClosingPrismatic),
        record(PlanarContact),
        record(LineContact),
        record(
            Coupling, coefficients=ByName(Number()), radii=ByName(LENGTH), angle=Number("angle"), force=Number("force")
        ),
        record(
            Equilibrium,
            link=Text(),
            tensions=Items(TENSION, "an array of tables"),
            mass=Number("mass"),
            centre=POINT,
            force=Vector("force", (3,)),
            moment=Vector("length", (3,)),
            gravity=Vector("length", (3,)),
            reference_force=Number("force"),
        ),
    ],
)
SHAPES = family(
    "shape",
    [
        solid(Box),
        solid(Sphere),
        solid(Cylinder),
        solid(Capsule),
        solid(Cone),
        solid(HalfSpace),
        solid(ConvexPolyhedron),
        solid(Mesh),
    ],
)


# a cable is of one type only: no key says which
CABLE = replace(record(Cable, ignore=Vector("length", (2,))), tag="")


@dataclass(frozen=True)
class Contacts:
    """Read pairs of links that may touch, each with its reason."""

    def read(self, value: Any, place: Place) -> dict[tuple[str, str], str]:
        if not isinstance(value, list):
            raise place.wrong(value, "an array of tables")
        found = {}
        for i, entry in enumerate(value):
            links, reason = _read_pair(entry, place / i, "contact", {"links": WORDS, "reason": Text()})
            if len(links) != 2:
                raise (place / i / "links").wrong(list(links), "an array of two links")
            if links in found:
                raise (place / i / "links").error(f"{list(links)} appears twice")
            found[links] = reason
        return found

    def write(self, value: Any) -> list[dict[str, Any]]:
        return [{"links": list(links), "reason": str(reason)} for links, reason in value.items()]


@dataclass(frozen=True)
class Tool:
    """Read the link that carries the tool and a point on it."""

    def read(self, value: Any, place: Place) -> tuple[str, tuple[float, ...]]:
        link, point = _read_pair(value, place, "tool", {"link": Text(), "point": POINT})
        return link, point

    def write(self, value: Any) -> dict[str, Any]:
        return {"link": value[0], "point": POINT.write(value[1])}


def _read_pair(value: Any, place: Place, what: str, codecs: Mapping[str, Codec]) -> list[Any]:
    if not isinstance(value, Mapping):
        raise place.wrong(value, f"a table with {' and '.join(codecs)}")
    for key in value:
        if key not in codecs:
            raise place.unknown(f"key of a {what}", key, codecs)
    for key in codecs:
        if key not in value:
            raise place.error(f"lacks {key!r}; a {what} needs it")
    return [codec.read(value[key], place / key) for key, codec in codecs.items()]


LIMITS = Record(
    Limits,
    {
        "position": ByVariable(RANGE_BY_KIND),
        **{k: ByVariable(BY_KIND) for k in ("velocity", "acceleration", "jerk")},
        **{k: Number("length" if k.startswith("linear") else "angle") for k in PLATFORM_LIMITS},
    },
)
MECHANISM = Record(
    Mechanism,
    {
        "name": Text(),
        "planar": Flag(),
        "characteristic_length": LENGTH,
        "active": WORDS,
        "operational": WORDS,
        "links": Items(LINKS, "an array of tables"),
        "closures": Items(CLOSURES, "an array of tables"),
    },
)
ROBOT = Record(
    Robot,
    {
        "source": Text(),
        "home": ByVariable(BY_KIND),
        "tool": Tool(),
        "limits": LIMITS,
        "masses": ByName(Number("mass")),
        "centres": ByName(POINT),
        "facts": ByName(Whole()),
        "contacts": Contacts(),
        "shapes": ByName(Items(SHAPES, "an array of tables")),
        "cables": Items(CABLE, "an array of tables"),
    },
)
OBSTACLES = Items(SHAPES, "an array of tables")
