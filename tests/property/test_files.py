"""Descriptions of any kind: machines of every type come back from their files, junk is refused by errors of ours."""

from __future__ import annotations

import copy
import dataclasses
import math
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import paraopt as po
from paraopt import mechanism as parts
from paraopt.io.schema import CLOSURES, JOINTS, LINKS, SHAPES
from paraopt.mechanism.closing_joints import perpendicular
from paraopt.mechanism.closures import as_direction
from paraopt.shapes import HalfSpace
from support import five_bar_robot, raf_robot

# one example takes a millisecond or a few, and there are many ways to be wrong
MANY = settings(max_examples=min(10 * settings().max_examples, 1000))
# a file of a hundred lines takes milliseconds: this bound only tells a hang from a busy machine
LONGEST = 10.0  # s


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Name a file that every example may overwrite."""
    return tmp_path_factory.mktemp("files") / "machine.toml"


# --- Valid machines of every type

numbers = st.floats(-1e9, 1e9) | st.sampled_from([0.0, -0.0, 5e-324, 0.1, 1 / 3, 1e149, -1e149])
positive = st.floats(1e-9, 1e9)
texts = st.text(st.characters(codec="utf-8"), min_size=1, max_size=8)
letters = st.sampled_from("xyz")
orders = st.permutations("xyz").map("".join)
angles = st.tuples(*[numbers] * 3)
ranges = st.tuples(numbers | st.just(-math.inf), numbers | st.just(math.inf)).filter(lambda r: r[0] < r[1])


def points(planar: bool) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(numbers, numbers, *([] if planar else [numbers]))


def directions(planar: bool) -> st.SearchStrategy[Any]:
    named = [sign + axis for sign in ("", "-") for axis in ("xy" if planar else "xyz")]
    return st.sampled_from(named) | points(planar).filter(lambda v: np.linalg.norm(v) > 1e-100)


@st.composite
def joints(draw: st.DrawFn, name: str, planar: bool) -> parts.Joint:
    """Draw a joint of any registered type."""
    if planar:
        kind = draw(st.sampled_from(["Fixed", "Revolute", "Prismatic"]))
        axis = {"Revolute": "z", "Prismatic": draw(st.sampled_from("xy"))}.get(kind)
        return parts.Fixed() if axis is None else JOINTS.members[kind].cls(name, axis, draw(ranges))
    cls = draw(st.sampled_from([m.cls for m in JOINTS.members.values()]))
    count = {"Spherical": 3, "Universal": 2, "Cylindrical": 2}.get(cls.__name__, 0)
    axis = draw(letters)
    values = {
        "name": name,
        "names": draw(st.sampled_from([name, [f"{name}/{i}" for i in range(count)]])),
        "axis": axis,
        "axes": draw(st.permutations("xyz"))[:2],
        "range": draw(ranges),
        "ranges": draw(st.none() | st.lists(ranges, min_size=count, max_size=count)),
        "order": draw(orders),
    }
    return cls(**{f.name: values[f.name] for f in dataclasses.fields(cls)})


@st.composite
def equilibria(draw: st.DrawFn, name: str, first: str, second: str, planar: bool) -> parts.Equilibrium:
    """Draw the balance of a link under one to three cables."""

    def vector() -> tuple[float, ...]:
        return (draw(numbers), draw(numbers), 0.0 if planar else draw(numbers))

    tensions = []
    for i in range(draw(st.integers(1, 3))):
        (link_A, link_B), limits = draw(st.permutations([first, second])), draw(ranges)
        tensions.append(parts.Tension(f"{name} {i}", link_A, vector(), link_B, vector(), limits))
    return parts.Equilibrium(
        first, tensions, draw(st.just(0.0) | positive), vector(), vector(), vector(), (0.0, 0.0, draw(numbers)),
        vector(), draw(positive), name,
    )  # fmt: skip


@st.composite
def couplings(draw: st.DrawFn, name: str, moved: dict[str, str]) -> parts.Coupling:
    """Draw a relation of two or three variables, angles among lengths by their radii."""
    turning = [n for n, kind in moved.items() if kind == "angle"]
    sliding = [n for n, kind in moved.items() if kind == "length"]
    if len(turning) >= 2 and draw(st.booleans()):
        return parts.Coupling({turning[0]: draw(positive), turning[1]: -draw(positive)}, angle=draw(numbers), name=name)
    radii = {n: draw(positive) for n in turning[: 1 if sliding else 2]}
    factors = {n: -draw(positive) for n in sliding[: 1 if radii else 2]}
    return parts.Coupling(factors, radii, length=draw(numbers), name=name)


@st.composite
def closures(draw: st.DrawFn, name: str, links: list[str], planar: bool, moved: dict[str, str]) -> parts.Closure:
    """Draw a closure of any registered type, or of any that has a meaning in the plane."""
    spatial_only = {"PerpendicularAxes", "ParallelPlanes", "ClosingSpherical", "ClosingUniversal", "ClosingCylindrical",
                    "PlanarContact", "LineContact"}  # fmt: skip
    members = [m.cls for n, m in CLOSURES.members.items() if not (planar and n in spatial_only)]
    cls = draw(st.sampled_from(members))
    first, second = draw(st.permutations(links))[:2]
    if cls is parts.Equilibrium:
        return draw(equilibria(name, first, second, planar))
    if cls is parts.Coupling:
        return draw(couplings(name, moved))
    values: dict[str, Any] = {"link_A": first, "link_B": second, "name": name}
    for field in dataclasses.fields(cls):
        kind = field.name.split("_")[0]
        if kind in ("point", "at"):
            values[field.name] = draw(points(planar))
        elif kind in ("axis", "normal"):
            turns = planar and cls is parts.ClosingRevolute
            values[field.name] = draw(st.sampled_from(["z", "-z"]) if turns else directions(planar))
        elif kind == "rotation":
            values[field.name] = (0.0, 0.0, draw(numbers)) if planar else draw(angles)
        elif kind == "construction":
            values[field.name] = draw(st.sampled_from(cls.constructions))
        elif kind == "spread":
            values[field.name] = draw(st.none() | positive)
        elif kind == "direction" and not planar:
            axis = as_direction(values[f"axis_{field.name[-1]}"], "axis")
            values[field.name] = draw(st.none() | st.sampled_from(perpendicular(axis)))
        elif kind == "direction":
            values[field.name] = draw(st.none() | st.just((0.0, 0.0, -1.0)))
    # the plane forbids what a stated default of space does
    assume(not (planar and cls is parts.ClosingPrismatic and values.get("direction_A") is None))
    return cls(**values)


@st.composite
def mechanisms(draw: st.DrawFn) -> po.Mechanism:
    """Draw a machine of any registered types; its loops need not close."""
    planar = draw(st.booleans())

    def rotation() -> tuple[float, ...]:
        return (0.0, 0.0, draw(numbers)) if planar else draw(angles)

    names = draw(st.lists(texts, min_size=4, max_size=7, unique=True))
    links: list[parts.Link] = [po.Base(names[0], draw(points(planar)), rotation())]
    links.append(po.Series(names[1], names[0], joint=po.Revolute("first", "z")))
    for i, name in enumerate(names[2:]):
        if draw(st.integers(0, 2)) == 0:
            free = ["x", "y", "theta"] if planar else draw(st.permutations(["x", "y", "z", "alpha", "beta", "theta"]))
            chosen = draw(st.none() | st.integers(1, len(free)).map(lambda n, f=free: f[:n]))
            known = chosen or (free if planar else ["x", "gamma"])
            bounds = draw(st.dictionaries(st.sampled_from(known), ranges, max_size=2))
            if planar and chosen is None:
                chosen = free
            links.append(po.Mobile(name, chosen, f"{i}{draw(texts)}", bounds, draw(orders)))
        else:
            father = draw(st.sampled_from([link.name for link in links]))
            links.append(po.Series(name, father, draw(points(planar)), draw(joints(f"j{i}", planar)), rotation()))
    moved = {m.name: m.kind for link in links for m in link.motions}
    variables = list(moved)
    assume(len(variables) >= 2)
    cut = draw(st.integers(1, len(variables) - 1))
    shuffled = draw(st.permutations(variables))
    ties = [draw(closures(f"tie {k}", names, planar, moved)) for k in range(draw(st.integers(0, 4)))]
    balanced = {tie.link: tie for tie in ties if isinstance(tie, parts.Equilibrium)}  # one of each link
    ties = [tie for tie in ties if not isinstance(tie, parts.Equilibrium) or balanced[tie.link] is tie]
    if ties:  # one may bear the name that it has by itself
        ties[0] = dataclasses.replace(ties[0], name="")
    return po.Mechanism(
        draw(texts), draw(st.permutations(links)), ties, shuffled[:cut], shuffled[cut:][: draw(st.integers(1, 3))],
        planar, draw(st.none() | positive),
    )  # fmt: skip


@MANY
@given(mechanism=mechanisms())
def test_a_mechanism_comes_back_to_the_last_bit(mechanism: po.Mechanism, file: Path) -> None:
    again = po.load_mechanism(po.save_mechanism(mechanism, file))
    assert again == mechanism
    assert repr(again) == repr(mechanism)  # signs of zero, too


def test_the_machines_are_of_every_type() -> None:
    """The strategies above draw from the registry: each type is drawn within some hundred examples."""
    seen: set[str] = set()

    @settings(max_examples=400, database=None)
    @given(mechanism=mechanisms())
    def draw(mechanism: po.Mechanism) -> None:
        seen.update(type(link).__name__ for link in mechanism.links)
        seen.update(type(link.joint).__name__ for link in mechanism.links if isinstance(link, po.Series))
        seen.update(type(closure).__name__ for closure in mechanism.closures)

    draw()
    assert seen == {*LINKS.members, *JOINTS.members, *CLOSURES.members}


BOX_TRIANGLES = np.array(
    [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
     (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)]
)  # fmt: skip


@st.composite
def boxes(draw: st.DrawFn) -> np.ndarray:
    """Draw the corners of a box, those of low x, y, z first."""
    corners = np.array(np.meshgrid(*[(0.0, 1.0)] * 3, indexing="ij")).reshape(3, -1).T
    return corners * draw(st.tuples(*[st.floats(1e-3, 1e3)] * 3)) + draw(st.tuples(*[st.floats(-10, 10)] * 3))


@st.composite
def shapes(draw: st.DrawFn, name: str) -> Any:
    """Draw a shape of any registered type, placed in any way."""
    cls = draw(st.sampled_from([m.cls for m in SHAPES.members.values()]))
    values: dict[str, Any] = {"name": name}
    for field in dataclasses.fields(cls):
        if field.name == "size":
            values["size"] = draw(st.tuples(positive, positive, positive))
        elif field.name in ("radius", "length"):
            values[field.name] = draw(positive)
        elif field.name == "vertices":
            values["vertices"] = draw(boxes())
        elif field.name == "triangles":
            values["triangles"] = BOX_TRIANGLES
        elif field.name == "parts":
            values["parts"] = draw(st.sampled_from([[], [values["vertices"]]]))
    small = st.floats(-10, 10)
    vectors = st.tuples(small, small, small)
    way = draw(st.sampled_from(["nowhere", "at", "turned", "general", "between"]))
    if way == "between" and hasattr(cls, "between"):
        first, second = draw(vectors), draw(vectors)
        assume(np.linalg.norm(np.subtract(first, second)) > 1e-6)
        return cls.between(first, second, values["radius"], name)
    if way == "at":
        values["pose"] = po.transform(draw(vectors))
    elif way == "turned":
        values["pose"] = po.transform(draw(vectors), draw(vectors))
    elif way == "general":
        values["pose"] = po.transform(draw(vectors), draw(vectors)) @ po.transform(draw(vectors), draw(vectors))
    return cls(**values)


@st.composite
def cables(draw: st.DrawFn, links: list[str], name: str) -> po.Cable:
    """Draw a cable between any points of two links."""
    one, other = draw(st.permutations(links))[:2]
    point, length = st.tuples(numbers, numbers, numbers), st.floats(0.0, 1e9)
    return po.Cable(
        link_A=one, point_A=draw(point), link_B=other, point_B=draw(point), radius=draw(positive),
        ignore=draw(st.tuples(length, length)), name=draw(st.sampled_from([name, ""])) if name == "cable 0" else name,
    )  # fmt: skip


@st.composite
def robots(draw: st.DrawFn) -> po.Robot:
    """Draw what a robot adds to a mechanism."""
    base = five_bar_robot()
    links, names = [k.name for k in base.mechanism.links], st.sampled_from(base.mechanism.names)
    kinds = st.dictionaries
    return po.Robot(
        base.mechanism,
        home={**draw(kinds(names, numbers)), "x": draw(numbers), "y": draw(numbers)},
        shapes={
            link: [draw(shapes(f"{link} {i}")) for i in range(draw(st.integers(0, 2)))]
            for link in draw(st.lists(st.sampled_from(links), unique=True))
        },
        limits=po.Limits(
            draw(kinds(names, ranges)), draw(kinds(names, positive)), draw(kinds(names, positive)),
            draw(kinds(names, positive)), *[draw(st.none() | positive) for _ in range(4)],
        ),
        masses=draw(kinds(st.sampled_from(links), st.floats(0, 1e9))),
        contacts=draw(kinds(st.permutations(links).map(lambda p: (p[0], p[1])), texts, max_size=3)),
        tool=draw(st.none() | st.tuples(st.sampled_from(links), st.tuples(numbers, numbers, numbers))),
        source=draw(texts | st.just("")),
        facts=draw(kinds(st.sampled_from(["rank E", "mobility"]), st.integers(0, 99))),
        cables=[draw(cables(links, f"cable {i}")) for i in range(draw(st.integers(0, 2)))],
    )  # fmt: skip


def words_of(robot: po.Robot) -> str:
    """Write out everything that a robot holds, numbers to the last bit."""
    bodies = {
        link: [
            {f.name: [np.asarray(part).tolist() for part in v] if f.name == "parts"
             else v if f.name == "name" else np.asarray(v).tolist() for f in dataclasses.fields(s)
             for v in [getattr(s, f.name)]} | {"type": type(s).__name__}
            for s in carried
        ]
        for link, carried in sorted(robot.shapes.items())
    }  # fmt: skip
    rest = {f.name: getattr(robot, f.name) for f in dataclasses.fields(robot) if f.name != "shapes"}
    return repr(bodies) + repr(rest)


@MANY
@given(robot=robots())
def test_a_robot_comes_back_to_the_last_bit(robot: po.Robot, file: Path) -> None:
    assert words_of(po.load_robot(po.save_robot(robot, file))) == words_of(robot)


# --- Broken files

junk = st.recursive(
    st.booleans() | st.integers() | st.just(10**400) | st.floats() | st.text(max_size=5)
    | st.sampled_from(["x", "-y", "base", "Revolute", "Weld", "deg", "", 0.0, -1.0, 1e308, 1e-320, math.inf, math.nan]),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.sampled_from(["type", "name", "axis", "x", "at"]) | st.text(max_size=3), inner, max_size=4),
    max_leaves=8,
)  # fmt: skip


def load_or_refuse(content: bytes, file: Path) -> None:
    """Load; what is accepted comes back from its own file, what is not is refused in a sentence, neither takes long."""
    file.write_bytes(content)
    start = time.perf_counter()
    told = str(file)
    try:
        robot = po.load_robot(file)
    except po.ParaoptError as error:
        told = str(error)
    else:
        assert words_of(po.load_robot(po.save_robot(robot, file))) == words_of(robot)
    assert told.startswith(str(file))
    assert len(told) < 4000
    assert time.perf_counter() - start < LONGEST


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Give the text of valid files."""
    folder = tmp_path_factory.mktemp("valid")
    return [
        po.save_robot(robot, folder / f"{robot.name}.toml").read_text(encoding="utf-8")
        for robot in (five_bar_robot(), raf_robot())
    ]


@MANY
@given(data=st.data())
def test_a_file_with_spoiled_lines_is_read_or_refused(data: st.DataObject, originals: list[str], file: Path) -> None:
    lines = data.draw(st.sampled_from(originals)).splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        i, j = (data.draw(st.integers(0, len(lines) - 1)) for _ in range(2))
        match data.draw(st.sampled_from(["delete", "double", "swap", "value", "insert", "cut"])):
            case "delete":
                del lines[i]
            case "double":
                lines.insert(j, lines[i])
            case "swap":
                lines[i], lines[j] = lines[j], lines[i]
            case "value":  # the key of one line with the value of another
                lines[i] = lines[i].partition("=")[0] + "=" + lines[j].partition("=")[2]
            case "insert":
                k = data.draw(st.integers(0, len(lines[i])))
                lines[i] = lines[i][:k] + data.draw(st.text(st.characters(codec="utf-8"), max_size=4)) + lines[i][k:]
            case "cut":
                lines[i] = lines[i][: data.draw(st.integers(0, len(lines[i])))]
        lines = lines or [""]
    load_or_refuse("\n".join(lines).encode(), file)


@MANY
@given(data=st.data())
def test_a_file_with_spoiled_bytes_is_read_or_refused(data: st.DataObject, originals: list[str], file: Path) -> None:
    content = bytearray(data.draw(st.sampled_from(originals)).encode())
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.integers(0, len(content) - 1))
        content[i : i + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    load_or_refuse(bytes(content), file)


@given(content=st.binary(max_size=200) | st.text(st.characters(codec="utf-8")).map(str.encode))
def test_anything_is_refused(content: bytes, file: Path) -> None:
    file.write_bytes(content)
    with pytest.raises(po.DefinitionError):
        po.load_robot(file)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Walk through all keys of nested tables and arrays."""
    if path:
        yield path
    for key, entry in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(entry, (*path, key))


@MANY
@given(data=st.data())
def test_a_file_with_spoiled_values_is_read_or_refused(data: st.DataObject, originals: list[str], file: Path) -> None:
    table: Any = copy.deepcopy(tomllib.loads(data.draw(st.sampled_from(originals))))
    for _ in range(data.draw(st.integers(1, 2))):
        *path, key = data.draw(st.sampled_from(list(places(table))))
        holder = table
        for step in path:
            holder = holder[step]
        match data.draw(st.sampled_from(["replace", "delete", "add"])):
            case "replace":
                holder[key] = data.draw(junk)
            case "delete":
                del holder[key]
            case "add":
                name = data.draw(st.text(max_size=4))
                if isinstance(holder, dict):
                    holder[name] = data.draw(junk)
                else:
                    holder.append(data.draw(junk))
    load_or_refuse(tomlkit.dumps(table).encode("utf-8", "surrogatepass"), file)


# --- Broken descriptions in Python


class Odd:
    """Something that no field expects."""


ODD: list[Callable[[], Any]] = [
    lambda: None, Odd, lambda: Odd, lambda: 10**400, lambda: b"x", lambda: 1j, lambda: {"x"}, lambda: range(3),
    lambda: iter([1, 2]), lambda: np.array(1.0), lambda: np.zeros(3), lambda: np.ones((2, 2)),
    lambda: np.array(["x", "y"]),
    lambda: np.float64(2), lambda: np.array([1, None], dtype=object), lambda: [[1, 2], [3]], lambda: [None] * 3,
    lambda: [10**400] * 3, lambda: [1e308] * 3, lambda: [1e-200, 0, 0], lambda: {"x": (0, 10**400)}, lambda: {1: 2},
    lambda: po.Fixed(), lambda: [po.Fixed()], lambda: [["a"], "b"], lambda: "\ud800", lambda: ("x", "x"), lambda: float,
]  # fmt: skip
VALID: dict[str, Any] = {
    "name": "a", "names": "a", "father": "base", "link_A": "base", "link_B": "arm",
    **{f"point_{s}": (1, 0, 0) for s in "AB"}, **{f"{w}_{s}": "z" for w in ("axis", "normal") for s in "AB"},
}  # fmt: skip
PARTS = [m.cls for family in (JOINTS, LINKS, CLOSURES) for m in family.members.values()]


@MANY
@given(cls=st.sampled_from(PARTS), data=st.data(), planar=st.booleans())
def test_junk_in_a_part_is_refused_or_used(cls: type, data: st.DataObject, planar: bool) -> None:
    fields = dataclasses.fields(cls)
    values = {f.name: VALID[f.name] for f in fields if f.default is f.default_factory is dataclasses.MISSING}
    for field in data.draw(st.lists(st.sampled_from([f.name for f in fields]), min_size=1, max_size=2) if fields else
                           st.just([])):  # fmt: skip
        values[field] = data.draw(junk | st.sampled_from(ODD).map(lambda make: make()))
    links: list[Any] = [po.Base(), po.Series("arm", "base", (1, 0), po.Revolute("v")), po.Mobile("free", ["x"], "w")]
    try:
        part = cls(**values)
        ties = [part] if isinstance(part, parts.Closure) else []
        if isinstance(part, parts.Joint):
            links.append(po.Series("more", "arm", joint=part))
        elif isinstance(part, po.Base):
            links[0] = part
            links[1] = po.Series("arm", part.name, (1, 0), po.Revolute("v"))
        elif isinstance(part, parts.Link):
            links.append(part)
        mechanism = po.Mechanism("m", links, ties, ("v",), ("wx",), planar)
    except po.DefinitionError:
        pass  # refused: anything else would end the test
    else:
        assert math.isfinite(mechanism.length)
        assert mechanism.constraints is not None
        assert len(mechanism.variables) == sum(len(link.motions) for link in mechanism.links)


@MANY
@given(data=st.data())
def test_junk_in_a_mechanism_is_refused_or_used(data: st.DataObject) -> None:
    good = five_bar_robot().mechanism
    values = {f.name: getattr(good, f.name) for f in dataclasses.fields(good)}
    for field in data.draw(st.lists(st.sampled_from(sorted(values)), min_size=1, max_size=2)):
        odd = junk | st.sampled_from(ODD).map(lambda make: make())
        spoiled = data.draw(odd)
        if field in ("links", "closures", "active", "operational") and data.draw(st.booleans()):
            spoiled = [*values[field], spoiled] if isinstance(values[field], (tuple, list)) else spoiled
        values[field] = spoiled
    try:
        mechanism = po.Mechanism(**values)
    except po.DefinitionError:
        pass  # refused: anything else would end the test
    else:
        assert math.isfinite(mechanism.length)


ODD_OF_ROBOTS: list[Callable[[], Any]] = [
    lambda: {"tip": [1]}, lambda: {"tip": po.Sphere(radius=1)}, lambda: {("a", "b"): "c"}, lambda: {("tip", "base"): 3},
    lambda: {"x": "a", "y": 1}, lambda: {"x": 10**400, "y": 0}, lambda: {"x": np.zeros(2), "y": 0}, lambda: {"x": None},
    lambda: {"x": (0, math.nan)}, lambda: {"x": (0, 10**400)}, lambda: {"tip": "1"}, lambda: {"tip": math.nan},
    lambda: ("tip",), lambda: ("tip", 1), lambda: (["tip"], (1, 2)), lambda: {"rank E": 1.5}, lambda: {"mobility": 2},
    lambda: {3: "a"},
]  # fmt: skip
odd_of_robots = junk | st.sampled_from(ODD + ODD_OF_ROBOTS).map(lambda make: make())


@MANY
@given(data=st.data())
def test_junk_in_a_robot_is_refused_or_used(data: st.DataObject) -> None:
    good = five_bar_robot()
    values = {f.name: getattr(good, f.name) for f in dataclasses.fields(good)}
    for field in data.draw(st.lists(st.sampled_from(sorted(values)), min_size=1, max_size=2)):
        values[field] = data.draw(odd_of_robots)
    if data.draw(st.booleans()):
        quantity = data.draw(st.sampled_from(["position", "velocity", "acceleration", "jerk"]))
        values["limits"] = lambda: po.Limits(**{quantity: data.draw(odd_of_robots)})
    try:
        made = {k: v() if k == "limits" and callable(v) and not isinstance(v, type) else v for k, v in values.items()}
        robot = po.Robot(**made)
    except po.DefinitionError:
        pass  # refused: anything else would end the test
    else:
        low, high = robot.limits.bounds(robot.mechanism)
        assert np.all(low <= high)
        assert len(po.Scene(robot).bodies) == sum(map(len, robot.shapes.values())) + len(robot.cables)


@MANY
@given(cls=st.sampled_from([m.cls for m in SHAPES.members.values()]), data=st.data())
def test_junk_in_a_shape_is_refused_or_used(cls: type, data: st.DataObject) -> None:
    values: dict[str, Any] = {"size": (1, 1, 1), "radius": 1.0, "length": 1.0, "name": "a", "pose": np.eye(4)}
    values |= {"vertices": np.array(np.meshgrid(*[(0.0, 1.0)] * 3, indexing="ij")).reshape(3, -1).T, "parts": ()}
    values["triangles"] = BOX_TRIANGLES
    values = {f.name: values[f.name] for f in dataclasses.fields(cls)}
    poses = [np.eye(3), 1j * np.eye(4), 1e200 * np.eye(4), np.full((4, 4), 1e308), np.diag([1.0, 1.0, -1.0, 1.0])]
    for field in data.draw(st.lists(st.sampled_from(sorted(values)), min_size=1, max_size=2)):
        values[field] = data.draw(odd_of_robots | st.sampled_from(poses))
    try:
        scene = po.Scene(five_bar_robot(), [cls(**values)])
    except po.DefinitionError:
        pass  # refused: anything else would end the test
    else:
        assert (0.0 < scene.obstacles[0].bounding_radius < math.inf) or cls is HalfSpace
