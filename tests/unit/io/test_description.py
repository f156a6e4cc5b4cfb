"""Machines as files: what is written, what may be written by hand, and how faults are told."""

from __future__ import annotations

import dataclasses
import inspect
import math
import os
import re
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po
from paraopt import mechanism as parts
from paraopt import shapes as solids
from paraopt.io.codecs import Text, Whole
from paraopt.io.schema import CLOSURES, FIELDS, JOINTS, LIMITS, LINKS, MECHANISM, ROBOT, SHAPES, record
from support import five_bar_robot, raf_robot

ROOT = Path(__file__).resolve().parents[3]
ROBOTS: dict[str, Callable[[], po.Robot]] = {"five-bar": five_bar_robot, "RAF": raf_robot}

FIVE_BAR = (ROOT / "problems" / "five_bar.toml").read_text(encoding="utf-8")
WITH_CONTACTS = (
    FIVE_BAR
    + """
[[contacts]]
links = ["proximal 1", "proximal 2"]
reason = "bars run on different levels"

[[contacts]]
links = ["distal 1", "proximal 2"]
reason = "bars run on different levels"
"""
)


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str | bytes], Path]:
    """Give a function that puts text into a file."""

    def write(content: str | bytes) -> Path:
        path = tmp_path / "machine.toml"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def assert_same_robot(one: po.Robot, other: po.Robot) -> None:
    """Compare field by field, numbers to the last bit."""
    assert one.mechanism == other.mechanism
    assert repr(one.mechanism) == repr(other.mechanism)  # signs of zero, too
    for field in ("home", "masses", "centres", "contacts", "facts"):
        assert dict(getattr(one, field)) == dict(getattr(other, field)), field
    for quantity in ("position", "velocity", "acceleration", "jerk"):
        assert dict(getattr(one.limits, quantity)) == dict(getattr(other.limits, quantity))
    assert (one.tool, one.source) == (other.tool, other.source)
    assert set(one.shapes) == set(other.shapes)
    assert [k for k, v in one.shapes.items() if v] == [k for k, v in other.shapes.items() if v]
    for link, shapes in one.shapes.items():
        for ours, theirs in zip(shapes, other.shapes[link], strict=True):
            assert_same_shape(ours, theirs)
    assert one.cables == other.cables
    assert repr(one.cables) == repr(other.cables)
    compared = {
        "cables",
        "mechanism",
        "home",
        "masses",
        "centres",
        "contacts",
        "facts",
        "limits",
        "tool",
        "source",
        "shapes",
    }
    assert {f.name for f in dataclasses.fields(po.Robot)} == compared


def assert_same_shape(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    for field in dataclasses.fields(one):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        if field.name in ("pose", "size"):
            assert np.asarray(ours).tobytes() == np.asarray(theirs).tobytes(), (one.name, field.name)
        else:
            assert ours == theirs, (one.name, field.name)


# --- Round trip


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_comes_back(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name]()
    path = po.save_robot(robot, tmp_path / "deep" / "robot.toml")
    assert path == tmp_path / "deep" / "robot.toml"
    assert_same_robot(robot, po.load_robot(path))
    assert po.load_mechanism(path) == robot.mechanism
    assert list(path.parent.iterdir()) == [path]
    # written again, the same bytes
    again = po.save_robot(po.load_robot(path), tmp_path / "again.toml")
    assert again.read_bytes() == path.read_bytes()


def test_everything_that_a_robot_may_state_comes_back(tmp_path: Path) -> None:
    base = five_bar_robot()
    turned = po.transform((1 / 3, -0.0, 2.5), (0.1, 1e-9, math.pi / 2))
    odd = 'a "b" = [#]\n\\ \u00e9\u2028\x7f\x00'
    general = po.Box(size=(0.1, 1 / 3, 3), pose=po.transform(rotation=(0.3, 0.2, 0.7)) @ turned, name="general")
    robot = po.Robot(
        base.mechanism,
        home={**base.home, "theta1": -0.0, "theta2": 5e-324},
        shapes={
            "tip": [po.Sphere(radius=0.1, pose=po.transform((1, 2, 3)), name=odd), general],
            "base": [],
            "distal 1": [
                po.Capsule.between((0.1, 0.2, 0.3), (1 / 7, -3, 8), 0.05),
                po.Cylinder.between((0, 0, -1), (0, 0, 1), 0.05),
                po.Cylinder(radius=1e-3, length=2.0, pose=turned, name="turned"),
            ],
        },
        limits=po.Limits(position={"theta1": (-math.inf, 0.1), "x": (0.0, math.inf)}, velocity={"theta2": 1 / 3}),
        masses={"tip": 0.0, "distal 1": 1e-300},
        centres={"tip": (0.1, -0.0, 1 / 3), "distal 1": (4, 0)},
        contacts={("tip", "base"): odd},
        tool=("tip", (0.1, 0.2, 0.3)),
        source=odd,
        facts={"mobility": 2, "working modes": 4},
        cables=[
            po.Cable(
                link_A="base", point_A=(1 / 3, -0.0, 2), link_B="tip", point_B=(0, 5e-324), radius=1 / 7, name=odd + odd
            ),
            po.Cable(link_A="tip", point_A=(0, 0), link_B="base", point_B=(0, 0), radius=1, ignore=(1 / 9, 0)),
        ],
    )  # fmt: skip
    again = po.load_robot(po.save_robot(robot, tmp_path / "robot.toml"))
    assert_same_robot(robot, again)
    assert math.copysign(1.0, again.home["theta1"]) == -1.0


def test_defaults_are_left_out_and_places_are_readable(tmp_path: Path) -> None:
    text = po.save_robot(raf_robot(), tmp_path / "raf.toml").read_text(encoding="utf-8")
    assert 'joint = {type = "Revolute", name = "arm A", axis = "x"}' in text
    assert 'joint = {type = "Prismatic", name = "q1", range = [0.0, 0.2]}' in text
    assert "between = [[0.0, 0.0, 0.02], [0.0, 0.0, 0.298]]" in text
    assert "at = [0.0, -0.11, -0.035]" in text
    for absent in ("planar", "characteristic_length", "order", "prefix", "pose =", "ranges", "coordinates"):
        assert absent not in text
    data = tomllib.loads(text)
    assert data["links"][0] == {"type": "Base"}
    assert [c["name"] for c in data["closures"] if "name" in c] == [
        c.name for c in raf_robot().mechanism.closures if c.name != f"{c.link_A} = {c.link_B}"
    ]


CABLE = """
[[cables]]
link_A = "base"
point_A = [1, 2]
link_B = "tip"
point_B = [0, 0, 3]
radius = 0.5
"""


def test_cables_are_read_in_the_units_of_the_file(written: Callable[[str], Path], tmp_path: Path) -> None:
    text = FIVE_BAR.replace('length = "m"', 'length = "cm"') + CABLE + "ignore = [4, 5]\n"
    (cable,) = po.load_robot(written(text)).cables
    assert cable == po.Cable(link_A="base", point_A=(0.01, 0.02), link_B="tip", point_B=(0, 0, 0.03), radius=0.005,
                             ignore=(0.04, 0.05), name="cable of base and tip")  # fmt: skip
    (cable,) = po.load_robot(written(FIVE_BAR + CABLE)).cables
    assert cable.ignore == (0.0, 0.0)
    # what has its default is not written
    robot = dataclasses.replace(five_bar_robot(), cables=[cable])
    written_text = po.save_robot(robot, tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert "[[cables]]" in written_text
    assert "ignore" not in written_text
    assert "cable of base and tip" not in written_text
    assert_same_robot(robot, po.load_robot(tmp_path / "robot.toml"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CABLE.replace('link_B = "tip"', 'link_B = "tipp"'), r"link at an end of cable .*'tipp'.*did you mean 'tip'"),
        (CABLE.replace("radius = 0.5", ""), r"cables\[0\].*lacks 'radius'; a Cable needs it"),
        (CABLE.replace("radius = 0.5", "radius = 0"), r"cables\[0\].*radius of cable .* is 0 m; it must be above 0"),
        (CABLE.replace("point_A = [1, 2]", "point_A = [1]"), r"cables\[0\].point_A.*an array of 2 or 3 numbers"),
        (CABLE + "ignore = 3", r"cables\[0\].ignore.* 3.*an array of 2 numbers"),
        (CABLE + "tension = 3", r"cables\[0\]: unknown key of a Cable 'tension'"),
        (CABLE + CABLE, r"'cable of base and tip' .* a name of its own"),
        ("\n[cables]\nlink_A = 'base'", r"cables.*an array of tables"),
    ],
)
def test_faulty_cables_are_told_with_their_place(text: str, words: str, written: Callable[[str], Path]) -> None:
    with pytest.raises(po.DefinitionError, match=words) as caught:
        po.load_robot(written(FIVE_BAR + text))
    assert "machine.toml" in str(caught.value)


def test_the_other_kind_of_machine_is_refused(tmp_path: Path) -> None:
    robot: Any = five_bar_robot()
    with pytest.raises(po.DefinitionError, match="save_robot a Robot"):
        po.save_mechanism(robot, tmp_path / "m.toml")
    with pytest.raises(po.DefinitionError, match="save_mechanism a Mechanism"):
        po.save_robot(robot.mechanism, tmp_path / "m.toml")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    @dataclasses.dataclass(frozen=True)
    class Twist(parts.Joint):
        @property
        def motions(self) -> tuple[parts.Motion, ...]:
            return ()

    path = po.save_robot(five_bar_robot(), tmp_path / "robot.toml")
    before = path.read_bytes()
    mechanism = five_bar_robot().mechanism
    twisted = dataclasses.replace(mechanism, links=[*mechanism.links, po.Series("extra", father="base", joint=Twist())])
    with pytest.raises(po.DefinitionError, match=r"joint .*Twist.* cannot be written; its type must be one of Fixed"):
        po.save_mechanism(twisted, path)
    with pytest.raises(po.DefinitionError, match="lone surrogate"):
        po.save_mechanism(dataclasses.replace(mechanism, name="\ud800"), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


# --- The schema


def members(module: Any, root: type) -> set[str]:
    """Name the classes of a module that a user can build: those with a constructor of their own."""
    found = {n for n, c in vars(module).items() if inspect.isclass(c) and issubclass(c, root) and c is not root}
    return found - {"ClosingJoint", "Link", "LinkClosure", "Motion"}


@pytest.mark.parametrize(
    ("family", "module", "root"),
    [(JOINTS, parts, parts.Joint), (LINKS, parts, parts.Link), (CLOSURES, parts, parts.Closure),
     (SHAPES, solids, solids.Shape)],
    ids=lambda value: getattr(value, "what", ""),
)  # fmt: skip
def test_every_type_has_its_line(family: Any, module: Any, root: type) -> None:
    assert set(family.members) == members(module, root)


def test_every_field_has_its_codec() -> None:
    for family in (JOINTS, LINKS, CLOSURES, SHAPES):
        for member in family.members.values():
            assert {*member.codecs, "pose"} >= {f.name for f in dataclasses.fields(member.cls)}, member.tag
    assert set(MECHANISM.codecs) == {f.name for f in dataclasses.fields(po.Mechanism)}
    assert {*ROBOT.codecs, "mechanism"} == {f.name for f in dataclasses.fields(po.Robot)}
    assert set(LIMITS.codecs) == {f.name for f in dataclasses.fields(po.Limits)}


def test_a_new_type_is_one_line() -> None:
    @dataclasses.dataclass(frozen=True)
    class Screw(parts.Joint):
        name: str
        turns: int = 1

        @property
        def motions(self) -> tuple[parts.Motion, ...]:
            return (parts.Motion(self.name, "angle", "z"),)

    with pytest.raises(po.DefinitionError, match=r"fields \['turns'\] of Screw have no kind"):
        record(Screw)
    screw = record(Screw, turns=Whole())
    assert screw.write(Screw("a", 3)) == {"type": "Screw", "name": "a", "turns": 3}
    assert isinstance(FIELDS["name"], Text)


# --- By hand: units, poses


def test_the_file_of_problems_is_the_robot_of_the_library() -> None:
    read, built = po.load_robot(ROOT / "problems" / "five_bar.toml"), po.robots.five_bar()
    assert read.mechanism == built.mechanism
    assert (read.limits, read.facts, read.contacts, read.source) == (
        built.limits, built.facts, built.contacts, built.source,
    )  # fmt: skip
    # the file rounds the angles of home, from which the same configuration is solved
    np.testing.assert_allclose(read.home_configuration.X, built.home_configuration.X, rtol=0, atol=1e-12)
    for link, carried in built.shapes.items():
        for ours, theirs in zip(read.shapes[link], carried, strict=True):
            assert (type(ours), ours.name, ours.bounding_radius) == (type(theirs), theirs.name, theirs.bounding_radius)
            np.testing.assert_allclose(ours.pose, theirs.pose, rtol=0, atol=1e-15)


UNITS = """
format = 1
units = { length = "mm", angle = "deg" }
name = "arm"
characteristic_length = 250
active = ["turn", "slide", "c.angle"]
operational = ["m.x"]
[[links]]
type = "Base"
at = [10, 20]
rotation = [0, 0, 90]
[[links]]
type = "Series"
name = "a"
father = "base"
joint = { type = "Revolute", name = "turn", range = [-180, inf] }
[[links]]
type = "Series"
name = "b"
father = "a"
joint = { type = "Prismatic", name = "slide", axis = "x", range = [0, 331] }
[[links]]
type = "Series"
name = "c"
father = "b"
joint = { type = "Cylindrical", names = "c", ranges = [[-90, 90], [0, 50]] }
[[links]]
type = "Mobile"
name = "m"
prefix = "m."
ranges = { x = [-8, 8], gamma = [-45, 45] }
[[closures]]
type = "ClosingRevolute"
link_A = "c"
point_A = [1, 2, 3]
axis_A = [0, 0, 5]
link_B = "m"
point_B = [4, 5, 6]
axis_B = "-x"
spread = 12
[home]
"m.x" = 52
turn = 45
[limits]
position = { turn = [-30, 30], slide = [1, 2] }
velocity = { turn = 180, slide = 100 }
jerk = { turn = 360 }
[masses]
a = 3
[tool]
link = "c"
point = [0, 0, 80]
[[shapes.a]]
type = "Box"
size = [10, 20, 30]
at = [1, 2, 3]
rotation = [90, 0, 0]
[[shapes.b]]
type = "Capsule"
radius = 8
between = [[0, 0, 0], [0, 0, 52]]
[[shapes.c]]
type = "Cylinder"
radius = 8
length = 40
pose = [[1, 0, 0, 7], [0, 0, -1, 8], [0, 1, 0, 9], [0, 0, 0, 1]]
"""


def test_units_reach_every_length_and_angle(written: Callable[[str], Path]) -> None:
    robot = po.load_robot(written(UNITS))
    quarter = math.pi / 2
    assert robot.mechanism == po.Mechanism(
        "arm",
        [
            po.Base(at=(0.01, 0.02), rotation=(0, 0, quarter)),
            po.Series("a", "base", joint=po.Revolute("turn", range=(-math.pi, math.inf))),
            po.Series("b", "a", joint=po.Prismatic("slide", "x", (0, 0.331))),
            po.Series("c", "b", joint=po.Cylindrical("c", ranges=((-quarter, quarter), (0, 0.05)))),
            po.Mobile("m", prefix="m.", ranges={"x": (-0.008, 0.008), "gamma": (-quarter / 2, quarter / 2)}),
        ],
        # a direction has no unit
        [po.ClosingRevolute("c", (0.001, 0.002, 0.003), (0, 0, 5), "m", (0.004, 0.005, 0.006), "-x", spread=0.012)],
        ("turn", "slide", "c.angle"),
        ("m.x",),
        characteristic_length=0.25,
    )
    assert dict(robot.home) == {"m.x": 0.052, "turn": quarter / 2}
    assert dict(robot.limits.position) == {"turn": (math.radians(-30), math.radians(30)), "slide": (0.001, 0.002)}
    assert dict(robot.limits.velocity) == {"turn": math.pi, "slide": 0.1}
    assert dict(robot.limits.jerk) == {"turn": 2 * math.pi}
    assert dict(robot.masses) == {"a": 3.0}
    assert robot.tool == ("c", (0, 0, 0.08))
    expected = [
        po.Box(size=(0.01, 0.02, 0.03), pose=po.transform((0.001, 0.002, 0.003), (quarter, 0, 0)), name="a"),
        po.Capsule.between((0, 0, 0), (0, 0, 0.052), 0.008, "b"),
        po.Cylinder(
            radius=0.008,
            length=0.04,
            pose=np.array([[1, 0, 0, 0.007], [0, 0, -1, 0.008], [0, 1, 0, 0.009], [0, 0, 0, 1]]),
            name="c",
        ),
    ]
    for link, shape in zip("abc", expected, strict=True):
        assert_same_shape(robot.shapes[link][0], shape)


@pytest.mark.parametrize("unit", ["m", "cm", "mm"])
def test_a_number_in_any_unit_is_the_number_of_a_person(unit: str, written: Callable[[str], Path]) -> None:
    """52 mm is 0.052 to the last bit; 52 times 1e-3 is not."""
    number = {"m": "0.052", "cm": "5.2", "mm": "52"}[unit]
    path = written(
        f'format = 1\nunits.length = "{unit}"\n[[obstacles]]\ntype = "Sphere"\nradius = {number}\nname = "o"\n'
    )
    assert po.load_obstacles(path)[0].radius == 0.052  # type: ignore[attr-defined]
    assert 52 * 1e-3 != 0.052


def test_obstacles_are_read(written: Callable[[str], Path]) -> None:
    path = written('format = 1\nobstacles = [{ type = "Box", size = [1, 2, 3], at = [0, 0, 1] }]\n')
    (box,) = po.load_obstacles(path)
    assert_same_shape(box, po.Box(size=(1, 2, 3), pose=po.transform((0, 0, 1))))
    assert po.load_obstacles(written("format = 1\nobstacles = []\n")) == ()
    with pytest.raises(po.DefinitionError, match="lacks 'obstacles'"):
        po.load_obstacles(written("format = 1\n"))
    with pytest.raises(po.UnknownNameError, match=r"unknown key 'obstacle' \(did you mean 'obstacles'"):
        po.load_obstacles(written("format = 1\nobstacle = []\n"))


def test_a_byte_order_mark_and_crlf_mean_nothing(written: Callable[[bytes], Path]) -> None:
    path = written(b"\xef\xbb\xbf" + FIVE_BAR.replace("\n", "\r\n").encode())
    assert po.load_mechanism(path) == five_bar_robot().mechanism


def test_the_text_that_is_spoiled_below_is_sound(written: Callable[[str], Path]) -> None:
    assert len(po.load_robot(written(WITH_CONTACTS)).contacts) == 2


# --- Faults are told with file, key, value and what is allowed

# (what is replaced in the five-bar's file, by what, words of the message)
FAULTS: dict[str, tuple[str, str, list[str]]] = {
    "version": ("format = 1", "format = 2", ["format is 2", "'format = 1'"]),
    "version true": ("format = 1", "format = true", ["format is True"]),
    "no version": ("format = 1", "", ["format is missing", "'format = 1'"]),
    "unit": ('length = "m"', 'length = "mil"', ["units.length", "'mil'", "'mm'"]),
    "units": ('{ length = "m", angle = "rad" }', "3", ["units is 3; it must be a table"]),
    "unit kind": ('length = "m"', 'mass = "g"', ["units: unknown key", "'mass'", "'angle'"]),
    "top key": ("planar = true", "planer = true", ["unknown key 'planer' (did you mean 'planar'?)", "'units'"]),
    "flag": ("planar = true", "planar = 1", ["planar is 1; it must be true or false"]),
    "name": ('name = "five-bar"', "name = 5", ["name is 5; it must be a string"]),
    "no name": ('name = "five-bar"', "", ["lacks 'name'; a Mechanism needs it"]),
    "roles": ('active = ["theta1", "theta2"]', 'active = "theta1"', ["active is 'theta1'", "array of strings"]),
    "role": ('active = ["theta1", "theta2"]', 'active = ["theta1", 2]', ["active[1] is 2; it must be a string"]),
    "role name": (
        'active = ["theta1", "theta2"]', 'active = ["theta1", "theta7"]', ["unknown active variable", "'theta7'"],
    ),
    "link type": ('type = "Mobile"', 'type = "mobile"', ["links[5].type", "'mobile' (did you mean 'Mobile'?)"]),
    "no link type": ('type = "Mobile"\n', "", ["links[5] lacks 'type'", "'Base', 'Series', 'Mobile'"]),
    "link type 3": ('type = "Mobile"', "type = 3", ["links[5].type is 3", "a string"]),
    "coordinate": ('["x", "y"]\n\n[[closures]]', '["x", "u"]\n\n[[closures]]', ["links[5].coordinates[1]", "'u'"]),
    "joint type": ('"Revolute", name = "theta3"', '"Revolut", name = "theta3"', [
        "links[2].joint.type: unknown type of a joint 'Revolut' (did you mean 'Revolute'?)", "'Spherical'",
    ]),
    "joint key": ('name = "theta3"', 'name = "theta3", axs = "z"', [
        "links[2].joint: unknown key of a Revolute 'axs' (did you mean 'axis'?)",
    ]),
    "joint axis": ('name = "theta3"', 'name = "theta3", axis = "w"', ["links[2].joint.axis", "'w'", "'x', 'y', 'z'"]),
    "joint axis vector": ('name = "theta3"', 'name = "theta3", axis = [0, 0, 1]', [
        "links[2].joint.axis is [0, 0, 1]; it must be one of 'x', 'y', 'z'",
    ]),
    "out of plane": ('name = "theta3"', 'name = "theta3", axis = "x"', ["planar", "theta3", "about x"]),
    "range size": ('name = "theta3"', 'name = "theta3", range = [1]', ["links[2].joint.range is [1]", "two numbers"]),
    "range order": ('name = "theta3"', 'name = "theta3", range = [1, 0]', [
        "links[2].joint: range of 'theta3' is (1.0, 0.0)",
    ]),
    "range nan": ('name = "theta3"', 'name = "theta3", range = [nan, 0]', ["links[2].joint.range[0] is nan"]),
    "joint string": ('{ type = "Revolute", name = "theta3" }', '"theta3"', [
        "links[2].joint is 'theta3'; it must be a table",
    ]),
    "joint bare": (', name = "theta3"', "", ["links[2].joint lacks 'name'; a Revolute needs it"]),
    "father": ('father = "proximal 1"', 'father = "proximal"', ["'proximal' (did you mean 'proximal"]),
    "no number": ("at = [8, 0]", 'at = [8, "0"]', ["links[2].at[1] is '0'; it must be a finite number"]),
    "boolean": ("at = [8, 0]", "at = [true, 0]", ["links[2].at[0] is true; it must be a finite number"]),
    "nan": ("at = [8, 0]", "at = [nan, 0]", ["links[2].at[0] is nan"]),
    "inf": ("at = [8, 0]", "at = [inf, 0]", ["links[2].at[0] is inf"]),
    "long": ("at = [8, 0]", "at = [8, 0, 0, 0]", ["links[2].at is [8, 0, 0, 0]", "2 or 3 numbers"]),
    "table": ("at = [8, 0]", "at = { x = 8 }", ["links[2].at is a table with 'x'", "2 or 3 numbers"]),
    "huge": ("at = [8, 0]", "at = [1e200, 0]", ["links[2]", "1e+200", "below 1e150"]),
    "huge whole": ("at = [8, 0]", f"at = [1{'0' * 400}, 0]", ["links[2].at[0] is an integer of more than 30 digits"]),
    "endless whole": ("at = [8, 0]", f"at = [1{'0' * 5000}, 0]", ["not valid TOML"]),
    "date": ("at = [8, 0]", "at = 1979-05-27", ["links[2].at is datetime.date(1979, 5, 27)"]),
    "closure link": ('link_A = "distal 2"', 'link_A = "distal 3"', ["'distal 3' (did you mean 'distal"]),
    "closure key": ('link_A = "distal 2"', 'link_a = "distal 2"', ["closures[1]", "'link_a' (did you mean 'link_A'?)"]),
    "home name": ("theta1 = 1.3", "theta_1 = 1.3", ["home: unknown variable 'theta_1' (did you mean 'theta1'?)"]),
    "home value": ("theta1 = 1.3", "theta1 = [1.3]", ["home.theta1 is [1.3]; it must be a finite number"]),
    "home lacks": ("y = 7", "", ["lacks the operational variables ['y']"]),
    "limit": ("velocity = { theta1 = 2", "velocity = { theta1 = -2", ["limits: velocity limit of 'theta1' is -2.0"]),
    "limit name": ("velocity = { theta1 = 2", "velocity = { q = 2", ["limits.velocity: unknown variable 'q'"]),
    "limit key": ("velocity = {", "speed = {", ["limits: unknown key of a Limits 'speed'", "'velocity'"]),
    "contact": ('["proximal 1", "proximal 2"]', '["proximal 1"]', ["contacts[0].links", "an array of two links"]),
    "contact link": ('["proximal 1", "proximal 2"]', '["proximal 1", "p"]', ["link in the contacts", "'p'"]),
    "contact twice": ('["distal 1", "proximal 2"]', '["proximal 1", "proximal 2"]', [
        "contacts[1].links", "appears twice",
    ]),
    "shape link": ('[[shapes."proximal 1"]]', '[[shapes."proximal"]]', ["link that carries shapes", "'proximal'"]),
    "shape ends": ("between = [[0, 0, 0], [8, 0, 0]]", "between = [[0, 0, 0]]", ["[0].between", "two points"]),
    "shape point": ("between = [[0, 0, 0], [8, 0, 0]]", "between = [[0, 0, 0], [0, 0, 0]]", ["zero length"]),
    "shape ways": ("between = [[0, 0, 0], [8, 0, 0]]", "between = [[0, 0, 0], [8, 0, 0]]\nat = [1, 0, 0]", [
        "shapes.'proximal 1'[0] is placed by at and between",
    ]),
    "shape length": ("between = [[0, 0, 0], [8, 0, 0]]", "between = [[0, 0, 0], [8, 0, 0]]\nlength = 3", [
        "shapes.'proximal 1'[0] has a length", "leave one",
    ]),
    "shape pose": ("between = [[0, 0, 0], [8, 0, 0]]",
                   "length = 1\npose = [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
                   ["shapes.'proximal 1'[0]", "not a rigid pose"]),
    "shape rows": ("between = [[0, 0, 0], [8, 0, 0]]", "length = 1\npose = [1, 2, 3]", [
        "shapes.'proximal 1'[0].pose is [1, 2, 3]; it must be four rows",
    ]),
    "shape size": ("radius = 0.15", "radius = 0", ["shapes.'proximal 1'[0]", "radius of capsule"]),
    "shape bare": ("radius = 0.15", "", ["shapes.'proximal 1'[0] lacks 'radius'; a Capsule needs it"]),
    "syntax": ("planar = true", "planar = ", ["not valid TOML", "line", "column"]),
    "twice": ("planar = true", "planar = true\nplanar = true", ["not valid TOML", "line", "column"]),
    "deep array": ("planar = true", f"planar = {'[' * 5000}", ["nested too deeply"]),
    "deep key": ("planar = true", f"{'a.' * 5000}a = 1", ["nested too deeply"]),
    "deep quoted key": ("planar = true", "\"a b\" . 'c' ." * 5000 + " a = 1", ["nested too deeply"]),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_told_where_it_stands(name: str, written: Callable[[str], Path]) -> None:
    old, new, words = FAULTS[name]
    assert old in WITH_CONTACTS, "the fault is not put in"
    path = written(WITH_CONTACTS.replace(old, new, 1))
    with pytest.raises(po.DefinitionError) as caught:
        po.load_robot(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    for word in words:
        assert word in message
    assert len(message) < 1000


def test_an_unreadable_file_is_told(tmp_path: Path, written: Callable[[bytes], Path]) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, words in {
        tmp_path / "absent.toml": "there is no such file",
        tmp_path: "is a folder or a device",
        tmp_path / "pipe": "is a folder or a device",
        Path("/dev/zero"): "is a folder or a device",
        tmp_path / "a\0b": "(cannot be read|no such file)",
        tmp_path / ("a" * 5000): "(cannot be read|no such file)",
        written(b"\xff\xfe\x00"): "is not UTF-8: byte 0 is 0xff",
    }.items():
        for load in (po.load_robot, po.load_mechanism, po.load_obstacles):
            with pytest.raises(po.DefinitionError, match=words) as caught:
                load(path)
            assert str(caught.value).startswith(os.fspath(path))


def test_a_file_without_end_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.toml"
    with path.open("wb") as stream:
        stream.truncate(10**12)  # sparse
    with pytest.raises(po.DefinitionError, match="holds 1000000000000 bytes"):
        po.load_robot(path)


def test_long_names_make_short_messages(written: Callable[[str], Path]) -> None:
    key = "a" * 5000
    for old, new in (("planar", key), ("theta1 = 1.3", f"{key} = 1"), ("[facts]", f"[masses]\n{key} = true\n[facts]")):
        with pytest.raises(po.DefinitionError, match="aaaa") as caught:
            po.load_robot(written(FIVE_BAR.replace(old, new, 1)))
        assert len(str(caught.value)) < 1000


def test_dots_in_text_are_no_depth(written: Callable[[str], Path], tmp_path: Path) -> None:
    text = "a.b-c." * 50 + "\" # ' \n\t."
    robot = dataclasses.replace(five_bar_robot(), source=text)
    assert po.load_robot(po.save_robot(robot, tmp_path / "dots.toml")).source == text
    for quoted in (f"'{'a.' * 50}'", f"""\"\"\"{"a." * 50} \\" \" \n{"b." * 50}\"\"\"""", f"'''{'a.' * 50}\n\\'''"):
        source = f"source = {quoted} # it's {'a.' * 50}"
        hand = po.load_robot(written(re.sub("^source = .*$", lambda _, s=source: s, FIVE_BAR, flags=re.MULTILINE)))
        assert hand.source.startswith("a." * 50)


@pytest.mark.parametrize(
    "text",
    [
        "a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a.a = 1\n",
        "[[links]]\n",
        "a = '",
        '"',
        '"""',
        "[",
        "{a=",
        "a . ",
        "é",
    ],
)
def test_long_files_of_one_kind_end_soon(text: str, written: Callable[[str], Path]) -> None:
    """A few hundred kilobytes; a parser whose time grows with the square needs minutes."""
    path = written("format = 1\n" + text * (300_000 // len(text)))
    start = time.perf_counter()
    with pytest.raises(po.DefinitionError):
        po.load_robot(path)
    assert time.perf_counter() - start < 20.0


def test_a_mechanism_is_no_robot(tmp_path: Path) -> None:
    path = po.save_mechanism(five_bar_robot().mechanism, tmp_path / "m.toml")
    with pytest.raises(po.DefinitionError, match="lacks 'home'; a Robot needs it"):
        po.load_robot(path)
    assert po.load_mechanism(path) == five_bar_robot().mechanism


# --- The page that tells the format


PAGE = (ROOT / "docs" / "file-format.md").read_text(encoding="utf-8")


def test_the_page_shows_the_file() -> None:
    blocks = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.S)
    assert blocks[0] == FIVE_BAR
    assert "".join(blocks[1:]).strip(), "the page shows no other example"


def test_examples_of_the_page_load(written: Callable[[str], Path]) -> None:
    """Each further block is a scene, or keys of a shape, link or closure."""
    blocks = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.S)[1:]
    for block in blocks:
        assert len(po.load_obstacles(written(block))) == block.count("[[obstacles]]") > 0


def test_the_page_names_every_type_and_key() -> None:
    for family in (JOINTS, LINKS, CLOSURES, SHAPES):
        for tag, member in family.members.items():
            rows = [line for line in PAGE.splitlines() if line.startswith(f"| `{tag}` |")]
            assert len(rows) == 1, tag
            told = set(re.findall(r"`(\w+)`", rows[0]))
            places = {"at", "rotation", "between", "pose"} & set(member.keys) if family is SHAPES else set()
            assert told == {*member.codecs, *places, tag}, tag
    for record_ in (MECHANISM, ROBOT, LIMITS):
        for key in record_.codecs:
            assert f"`{key}`" in PAGE, key
