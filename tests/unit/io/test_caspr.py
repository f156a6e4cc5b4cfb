"""CASPR's models: the published one, models written to the format, and what is refused, by name."""

from __future__ import annotations

import contextlib
import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from paraopt.errors import DefinitionError, ParaoptError, UnknownNameError
from paraopt.io.caspr import CasprModel, load_caspr
from paraopt.io.caspr_motion import CasprTrajectory
from paraopt.io.xml_tree import Element, read_xml
from paraopt.modes.cable.wrench import lay_over_pulley

Array = NDArray[np.float64]
DATA = Path(__file__).parents[2] / "data" / "caspr"

# --- Models in the words of the format


def bodies(joint: str = 'type="SPATIAL_EULER_XYZ" q_initial="0 0 1 0 0 0"', **parts: str) -> str:
    numbers = {
        "mass": "<mass>2</mass>", "com": "0 0 0", "end": "0 0 0", "ref": "com",
        "place": "0 0 0", "num": "0", "after": "",
    } | parts  # fmt: skip
    entries = {"Ixx": 0.3, "Iyy": 0.4, "Izz": 0.5, "Ixy": 0.01, "Ixz": 0.02, "Iyz": 0.03}
    inertia = "".join(f"<{k}>{v}</{k}>" for k, v in entries.items())
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE bodies_system SYSTEM "../../../../templates/bodies.dtd">
<bodies_system>
  <links display_range="-5 5 -4 4 -0.5 4" view_angle="-37 32">
    <link_rigid num="1" name="tray">
      <joint {joint}/>
      <physical>{numbers["mass"]} <!-- a guess -->
        <com_location>{numbers["com"]}</com_location><end_location>{numbers["end"]}</end_location>
        <inertia ref="{numbers["ref"]}">{inertia}</inertia>
      </physical>
      <parent><num>{numbers["num"]}</num><location>{numbers["place"]}</location></parent>
    </link_rigid>{numbers["after"]}
  </links>
</bodies_system>"""


def cable(name: str, *points: str, kind: str = "cable_ideal", reference: str = "joint", more: str = "") -> str:
    return f"""<{kind} name="{name}" attachment_reference="{reference}">
      <properties>{more}<force_min>1</force_min><force_max>50</force_max></properties>
      <attachments>{"".join(points)}</attachments></{kind}>"""


def at(link: int, place: str) -> str:
    return f"<attachment><link>{link}</link><location>{place}</location></attachment>"


def cables(*members: str, default: str = "one", name: str = "one") -> str:
    return f"""<?xml version="1.0"?>
<!DOCTYPE cables [
  <!ATTLIST cable_set id ID #REQUIRED>
]>
<cables default_cable_set="{default}"><cable_set id="{name}">{"".join(members)}</cable_set></cables>"""


CORNERS = [(sx, sy) for sx in (-2, 2) for sy in (-1, 1)]
FOUR = [cable(f"c{i}", at(0, f"{x} {y} 3"), at(1, f"{0.1 * x} {0.2 * y} 0")) for i, (x, y) in enumerate(CORNERS)]


def trajectories(*members: str, old: bool = False, group: str = "joint_trajectories") -> str:
    inner = f"<{group}>{''.join(members)}</{group}>"
    return inner if old else f"<trajectories>{inner}</trajectories>"


def motion(kind: str, *points: str, name: str = "m", times: str = "relative", more: str = "") -> str:
    inner = "".join(points)
    return f'<{kind} id="{name}" time_definition="{times}" time_step="0.01" {more}><points>{inner}</points></{kind}>'


def point(q: str, v: str | None = None, a: str | None = None, letter: str = "q", **attributes: str) -> str:
    rest = (f"<{letter}_dot>{v}</{letter}_dot>" if v else "") + (f"<{letter}_ddot>{a}</{letter}_ddot>" if a else "")
    head = "".join(f' {k}="{w}"' for k, w in attributes.items())
    return f"<point{head}><{letter}>{q}</{letter}>{rest}</point>"


def model(folder: Path, body: str | None = None, ropes: str | None = None, **files: str) -> CasprModel:
    contents = {"bodies": body or bodies(), "cables": ropes or cables(*FOUR)} | files
    for key, text in contents.items():
        (folder / f"tray_{key}.xml").write_text(text, encoding="utf-8")
    return load_caspr(folder)


# --- The published model


def test_ipanema_is_read() -> None:
    read = load_caspr(DATA / "IPAnema_1")
    robot = read.robot
    assert (robot.name, robot.mass, robot.n_cables, robot.planar) == ("IPAnema 1 (Fraunhofer IPA)", 25.0, 8, False)
    np.testing.assert_array_equal(robot.home_pose, [0, 0, 1, 0, 0, 0])
    np.testing.assert_array_equal(robot.inertia, 14 * np.eye(3))
    np.testing.assert_array_equal(robot.exits[[0, 7]], [[-2, 1.5, 2], [-2, -1.5, 0]])
    np.testing.assert_array_equal(robot.attachments[5], [0.06, 0.06, 0])
    np.testing.assert_array_equal(np.column_stack([robot.t_min, robot.t_max]), [[0, 720]] * 8)
    assert robot.ranges["y"] == (-3.5, 3.5)
    assert robot.gravity.tolist() == [0, 0, -9.81]
    assert (read.cable_set, read.ignored, dict(read.spaces)) == ("original", (), {})
    assert list(read.trajectories) == ["traj_1", "traj_z_up"]
    assert read.trajectories["traj_1"].names == robot.coordinates


def test_another_set_of_cables_is_taken_by_name() -> None:
    robot = load_caspr(DATA / "IPAnema_1", cable_set="IROS_CASPR_2016").robot
    assert robot.t_max[5] == 200.0
    np.testing.assert_array_equal(robot.exits[0], [-2, 3, 5])
    with pytest.raises(UnknownNameError, match=r"'orig' \(did you mean 'original'\?\); valid names"):
        load_caspr(DATA / "IPAnema_1", cable_set="orig")


def test_limits_that_caspr_does_not_know_are_given_afterwards() -> None:
    robot = replace(load_caspr(DATA / "IPAnema_1").robot, velocity=2.0, acceleration=10.0)
    assert robot.robot.limits.velocity["cable 3"] == 2.0


# --- Conventions


def test_the_pose_is_the_joint(tmp_path: Path) -> None:
    # the joint sits away from the base's origin: the robot's world is moved there, and the cables keep their lengths
    joint = 'type="SPATIAL_EULER_XYZ" q_initial="0.1 0.2 1 0.3 -0.2 0.4"'
    read = model(tmp_path, bodies(joint, place="0.5 -0.25 1"))
    np.testing.assert_array_equal(read.origin, [0.5, -0.25, 1])
    np.testing.assert_allclose(read.robot.home_pose, [0.1, 0.2, 1, 0.3, -0.2, 0.4])
    R = Rotation.from_euler("XYZ", [0.3, -0.2, 0.4]).as_matrix()  # Rx Ry Rz
    held = np.array([0.5, -0.25, 1]) + [0.1, 0.2, 1] + R @ [-0.2, -0.2, 0]
    expected = np.linalg.norm(held - [-2, -1, 3])
    assert read.robot.robot.home["c0"] == pytest.approx(expected, abs=1e-12)


def test_a_quaternion_has_its_real_part_first(tmp_path: Path) -> None:
    w, x, y, z = np.roll(Rotation.from_euler("XYZ", [0.3, -0.2, 0.4]).as_quat(), 1)
    limits = 'q_min="0 0 0 -1 -1 -1 -1" q_max="1 1 2 1 1 1 1"'
    read = model(tmp_path, bodies(f'type="SPATIAL_QUATERNION" q_initial="0.1 0.2 1 {w} {x} {y} {z}" {limits}'))
    np.testing.assert_allclose(read.robot.home_pose, [0.1, 0.2, 1, 0.3, -0.2, 0.4], atol=1e-15)
    assert [w for w in read.ignored if "ranges of the quaternion" in w]


def test_references_of_attachments_and_inertia(tmp_path: Path) -> None:
    by_com = cables(
        *(cable(f"c{i}", at(0, f"{x} {y} 3"), at(1, "0.1 0 0"), reference="com") for i, (x, y) in enumerate(CORNERS))
    )
    read = model(tmp_path, bodies(com="0.1 0.2 0.3", ref="joint", end="0 0 -0.4"), by_com)
    np.testing.assert_allclose(read.robot.attachments, [[0.2, 0.2, 0.3]] * 4)
    np.testing.assert_allclose(read.robot.exits, [(x, y, 3) for x, y in CORNERS])  # the base has no centre of mass
    I_O = np.array([[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])
    c = np.array([0.1, 0.2, 0.3])
    shift = -np.cross(c, np.cross(c, np.eye(3)))  # c^2 - c c^T
    np.testing.assert_allclose(read.robot.inertia, I_O - 2 * shift, atol=1e-15)
    assert read.robot.tool == (0.0, 0.0, -0.4)


@pytest.mark.parametrize(
    ("kind", "place", "gravity", "inertia", "sign"),
    [
        ("PLANAR_XY", "{a} {b} 0", (0, 0), 0.5, 1),
        ("PLANAR_XZ", "{a} 0 {b}", (0, -9.81), 0.4, -1),
        ("PLANAR_YZ", "0 {a} {b}", (0, -9.81), 0.3, 1),
    ],
)
def test_planes(tmp_path: Path, kind: str, place: str, gravity: tuple[float, float], inertia: float, sign: int) -> None:
    members = [
        cable(f"c{i}", at(0, place.format(a=a, b=b)), at(1, place.format(a=a / 10, b=b / 5)))
        for i, (a, b) in enumerate(CORNERS)
    ]
    joint = f'type="{kind}" q_initial="0.1 0.2 0.3" q_min="-1 -1 -2" q_max="1 1 3"'
    two = motion("linear_spline_trajectory", point("0.1 0.2 0.3"), point("0.3 0.2 -0.1", time="2"))
    read = model(tmp_path, bodies(joint), cables(*members), trajectories=trajectories(two))
    robot = read.robot
    assert robot.planar
    assert tuple(robot.gravity[:2]) == gravity
    assert robot.inertia[2, 2] == inertia
    np.testing.assert_allclose(robot.home_pose, [0.1, 0.2, sign * 0.3])
    assert robot.ranges["theta"] == ((-2, 3) if sign > 0 else (-3, 2))
    # CASPR's own matrices of the three joints, about z, y and x
    axis = {"PLANAR_XY": "z", "PLANAR_XZ": "y", "PLANAR_YZ": "x"}[kind]
    keep = [i for i in range(3) if "{" in place.split()[i]]
    R = Rotation.from_euler(axis, 0.3).as_matrix()[np.ix_(keep, keep)]
    for i, (a, b) in enumerate(CORNERS):
        expected = np.linalg.norm([0.1, 0.2] + R @ [a / 10, b / 5] - [a, b])
        assert robot.robot.home[f"c{i}"] == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(read.trajectories["m"](1.0), [0.2, 0.2, sign * 0.1])


def test_a_pulley_of_the_base(tmp_path: Path) -> None:
    wheel = (
        "<base_rotating_pulley><fixed_location>2 1 3</fixed_location><pulley_radius>0.05</pulley_radius>"
        "<cable_entry_vector>0 0 2</cable_entry_vector></base_rotating_pulley>"
    )
    read = model(tmp_path, ropes=cables(*FOUR[:3], cable("p", wheel, at(1, "0.2 0.2 0"))))
    assert read.robot.pulleys[:3] == (None, None, None)
    assert read.robot.pulleys[3].radius == 0.05
    assert read.robot.pulleys[3].axis == (0.0, 0.0, 1.0)
    np.testing.assert_array_equal(read.robot.exits[3], [2, 1, 3])


@pytest.mark.parametrize("seed", range(5))
def test_a_cable_runs_over_its_pulley_as_in_caspr(tmp_path: Path, seed: int) -> None:
    """CASPR's way: centre beside the entry towards the attachment, leaving point, arc by the angle between radii."""
    rng = np.random.default_rng(seed)
    v, F, radius = rng.normal(size=3), np.array([2.0, 1.0, 3.0]), 0.05
    wheel = (
        f"<base_rotating_pulley><fixed_location>2 1 3</fixed_location><pulley_radius>{radius}</pulley_radius>"
        f"<cable_entry_vector>{' '.join(map(repr, v.tolist()))}</cable_entry_vector></base_rotating_pulley>"
    )
    pulley = model(tmp_path, ropes=cables(*FOUR[:3], cable("p", wheel, at(1, "0.2 0.2 0")))).robot.pulleys[3]
    span = ca.SX.sym("span", 3)
    lay = ca.Function("lay", [span], list(lay_over_pulley(span, F, pulley)))
    B = F + rng.normal(size=3)
    normal = np.cross(v, B - F) / np.linalg.norm(np.cross(v, B - F))
    beside = np.cross(normal, v)
    C = F + radius * beside / np.linalg.norm(beside)
    share = radius / np.linalg.norm(B - C)
    A = C + share**2 * (B - C) - share * np.sqrt(1 - share**2) * np.cross(normal, B - C)
    arc = radius * np.arccos((F - C) @ (A - C) / radius**2)
    length, _, leaving = lay(B - F)
    np.testing.assert_allclose(np.array(leaving).ravel(), A, atol=1e-12)
    # CASPR's arc is the shorter one; the way round is longer where the cable turns by more than half a circle
    turned = np.cross(F - C, A - C) @ normal
    arc = arc if turned > 0 else 2 * np.pi * radius - arc
    assert float(length) == pytest.approx(arc + np.linalg.norm(B - A), abs=1e-12)


def test_harmless_parts_are_listed(tmp_path: Path) -> None:
    ropes = cables(
        *FOUR[:2],
        cable("soft", at(0, "2 -1 3"), at(1, "0.2 -0.2 0"), kind="cable_linear_spring", more="<K>1000</K>"),
        cable("long", at(0, "2 1 0"), at(0, "2 1 3"), at(1, "0.2 0.2 0")),
    )
    ropes = ropes.replace('name="c1"', 'name="c0"')
    away = '<file_trajectory id="samples" filename="x.traj"/>'
    still = motion("linear_spline_trajectory", point("0 0 0 0 0 0"), point("0 0 1 0 0 0", time="1"))
    read = model(tmp_path, ropes=ropes, trajectories=trajectories(away, still, still, old=True))
    told = " | ".join(read.ignored)
    assert "stiffness of cable_linear_spring 'soft'" in told
    assert "the part of 'long' that stays on the base" in told
    assert "file_trajectory 'samples'" in told
    assert "a further <linear_spline_trajectory> 'm'" in told
    assert "name 'c0' stands twice; here 'c0 (2)'" in told
    assert len(read.ignored) == 5
    assert read.robot.cables == ("c0", "c0 (2)", "soft", "long")
    np.testing.assert_array_equal(read.robot.exits[3], [2, 1, 3])
    assert list(read.trajectories) == ["m"]


def test_operational_spaces(tmp_path: Path) -> None:
    text = """<operational_spaces default_operational_set="tip"><operational_set id="tip">
      <position marker_id="1" name="tip"><link>1</link><offset>0 0 -0.2</offset><axes active_axes="xz"/></position>
      <pose_euler_xyz marker_id="2" name="all"><link>1</link><axes active_axes="xyzabg"/></pose_euler_xyz>
    </operational_set></operational_spaces>"""
    task = motion(
        "quintic_spline_trajectory",
        point("0 1", "0 0", "0 0", "y"),
        point("2 0", "0 0", "0 0", "y", time="2"),
        name="t",
    )
    group = trajectories(task, group="operational_trajectories")
    read = model(tmp_path, operational_spaces=text, trajectories=group)
    tip, pose = read.spaces["tip"]
    assert (tip.kind, tip.offset, tip.axes) == ("position", (0, 0, -0.2), ("x", "z"))
    assert (pose.kind, pose.offset, pose.axes) == ("pose_euler_xyz", (0, 0, 0), tuple("xyzabg"))
    assert read.trajectories == {}
    np.testing.assert_allclose(read.operational_trajectories["t"](1.0), [1.0, 0.5])


# --- Trajectories

REST = "0 0 0 0 0 0"
TURNING = {
    "linear_spline_trajectory": "",
    "cubic_spline_trajectory": "",
    "quintic_spline_trajectory": "",
    "cubic_spline_average_velocity_trajectory": "",
    "parabolic_blend_trajectory": 'blend_time_default="0.4"',
}


@pytest.fixture(scope="module", params=TURNING)
def turning(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, CasprTrajectory]:
    kind, v, a = str(request.param), "0.1 0.2 0 0 0 0", "0 0 0.5 0 0 0"
    text = motion(
        kind, point("0 0 1 0.2 -0.4 0.1", v, a), point("1 0.5 0.5 1.3 0 -0.2", REST, REST, time="1"),
        point("1 -1 2 -0.5 0.6 2", v, a, time="3"), more=TURNING[kind], times="absolute",
    )  # fmt: skip
    read = model(tmp_path_factory.mktemp("caspr"), trajectories=trajectories(text))
    return kind, read.trajectories["m"]


def test_a_trajectory_passes_its_points(turning: tuple[str, CasprTrajectory]) -> None:
    _, way = turning
    points = [[0, 0, 1, 0.2, -0.4, 0.1], [1, 0.5, 0.5, 1.3, 0, -0.2], [1, -1, 2, -0.5, 0.6, 2]]
    np.testing.assert_allclose(way([0, 1, 3]), points, atol=1e-12)
    np.testing.assert_allclose(way(1.0), points[1], atol=1e-12)
    assert way.duration == 3.0


def test_derivatives_are_those_of_the_values(turning: tuple[str, CasprTrajectory]) -> None:
    _, way = turning
    t, h = np.concatenate([np.linspace(0.02, 0.98, 97), np.linspace(1.02, 2.98, 99)]), 1e-5
    t = t[np.min(np.abs(t[:, None] - [0.4, 0.6, 1.4, 2.6]), axis=1) > 1e-3]  # a blend's ends have jumps
    for order in (0, 1):
        slope = (way(t + h, order) - way(t - h, order)) / (2 * h)
        np.testing.assert_allclose(way(t, order + 1), slope, atol=2e-7)


def test_given_derivatives_are_kept(turning: tuple[str, CasprTrajectory]) -> None:
    kind, way = turning
    ends = np.array([[0.1, 0.2, 0, 0, 0, 0]] * 2)
    if kind in ("cubic_spline_trajectory", "quintic_spline_trajectory", "cubic_spline_average_velocity_trajectory"):
        np.testing.assert_allclose(way([0, 3], 1), ends, atol=1e-12)
    if kind == "quintic_spline_trajectory":
        np.testing.assert_allclose(way([0, 3], 2), np.array([[0, 0, 0.5, 0, 0, 0]] * 2), atol=1e-11)
    if kind == "cubic_spline_average_velocity_trajectory":  # mean of the slopes 1 and 0, 0.5 and -0.75, -0.5 and 0.75
        np.testing.assert_allclose(way(1.0, 1)[:3], [0.5, -0.125, 0.125], atol=1e-12)
    if kind == "parabolic_blend_trajectory":
        assert np.ptp(way(np.linspace(0.41, 0.59, 9), 1)[:, 0]) < 1e-12


def test_an_orientation_turns_about_one_axis(turning: tuple[str, CasprTrajectory]) -> None:
    _, way = turning
    turns = Rotation.from_euler("XYZ", way(np.linspace(0, 1, 21))[:, 3:])
    axes = (turns[0].inv() * turns[1:]).as_rotvec()
    units = axes / np.linalg.norm(axes, axis=1)[:, None]
    np.testing.assert_allclose(units, np.tile(units[-1], (20, 1)), atol=1e-9)


def test_an_orientation_passes_a_right_second_angle(tmp_path: Path) -> None:
    ends = point("0 0 1 0 1.2707963267948966 0"), point("0 0 1 0 1.8707963267948966 0", time="1")
    way = model(tmp_path, trajectories=trajectories(motion("linear_spline_trajectory", *ends))).trajectories["m"]
    t = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # pi/2 half way
    expected = Rotation.from_euler("Y", (1.2707963267948966 + 0.6 * t)[:, None]).as_matrix()
    np.testing.assert_allclose(Rotation.from_euler("XYZ", way(t)[:, 3:]).as_matrix(), expected, atol=1e-7)
    np.testing.assert_allclose(way([0.25, 0.75], 1)[:, 4], [0.6, -0.6])  # beyond, the same pose has other angles
    with pytest.raises(DefinitionError, match="turns through a second angle of pi/2"):
        way(0.5, 1)


@pytest.mark.parametrize("t", [-0.1, 1.1, float("nan")])
def test_times_outside_are_refused(t: float) -> None:
    with pytest.raises(DefinitionError, match=r"trajectory 'traj_1' lasts from 0 to 1 s"):
        load_caspr(DATA / "IPAnema_1").trajectories["traj_1"](t)


# --- What is refused

ARM = '<link_rigid num="2" name="arm"/>'
ONE = [at(0, "2 1 3"), at(1, "0 0 0")]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (bodies(after=ARM), r"<links>: has 2 links \('tray', 'arm'\); a chain of links is not read"),
        (bodies(after="<link_soft/>"), "<link_soft>: is not read; links are link_rigid"),
        (bodies('type="R_Z" q_initial="0"'), "type R_Z carries forces of its own"),
        (bodies('type="T_XYZ" q_initial="0 0 0"'), "type T_XYZ carries forces of its own"),
        (bodies('type="PLANAR_ZY" q_initial="0 0 0"'), r"'PLANAR_ZY' \(did you mean"),
        (bodies('q_initial="0 0 0"'), "<joint>: has no attribute type"),
        (bodies('type="SPATIAL_EULER_XYZ" q_initial="0 0 1"'), "has 3 values; joint type SPATIAL_EULER_XYZ has 6"),
        (bodies('type="SPATIAL_QUATERNION" q_initial="0 0 1 0 0 0 0"'), "the quaternion zero"),
        (bodies('type="SPATIAL_EULER_XYZ" q_initial="0 0 1 0 0 0" actuated="true"'), "is actuated"),
        (bodies('type="SPATIAL_EULER_XYZ" q_initial="0 0 1 0 0 0" q_min="0 0 0 0 0 0"'), "has no attribute q_max"),
        (bodies(num="3"), "a platform's parent is the base, link 0"),
        (bodies(mass=""), "<physical>: has no <mass>"),
        (bodies(mass="<mass>heavy</mass>"), "<mass>: is 'heavy': could not convert"),
        (bodies(mass="<mass>1</mass><mass>2</mass>"), "<mass>: stands twice in <physical>"),
        (bodies(mass="<mass>nan</mass>"), "<mass>: is 'nan'; it must hold finite numbers"),
        (bodies(mass="<mass>-2</mass>"), "tray_bodies.xml with cable set 'one': mass of 'tray' is -2 kg"),
        (bodies(com="0 0"), "<com_location>: is '0 0': 2 numbers; it must hold 3 numbers"),
        (bodies(ref="tip"), "<inertia>: ref is 'tip'; it must be com or joint"),
        (bodies()[:-5], "unclosed token"),
        ("", "no element found"),
    ],
)
def test_bodies_that_are_refused(tmp_path: Path, body: str, words: str) -> None:
    (tmp_path / "tray_bodies.xml").write_text(body)
    (tmp_path / "tray_cables.xml").write_text(cables(*FOUR))
    with pytest.raises(DefinitionError, match=words) as caught:
        load_caspr(tmp_path)
    assert "tray_bodies.xml" in str(caught.value)


@pytest.mark.parametrize(
    ("ropes", "words"),
    [
        (cables(cable("s", *ONE, kind="cable_passive_linear_spring")), "'s' is not read: a passive spring pulls"),
        (cables(cable("h", *ONE, kind="muscle_hill_type")), "'h' is not read: a muscle has a law of its own"),
        (cables(cable("r", *ONE, kind="rope")), "unknown kind of cable 'rope'"),
        (cables(cable("c", *ONE, reference="tip")), "attachment_reference is 'tip'"),
        (cables(cable("c", at(0, "2 1 3"), at(2, "0 0 0"))), "<link>: cable 'c' holds link 2"),
        (cables(cable("c", at(0, "2 1 3"), at(1, "0 0 0"), at(0, "1 1 1"))), r"'c' runs over links \[0, 1, 0\]"),
        (cables(cable("c", at(0, "2 1 3"), at(1, "0 0 0"), at(1, "1 0 0"))), r"'c' runs over links \[0, 1, 1\]"),
        (cables(cable("c", at(0, "2 1 3"))), r"'c' runs over links \[0\]"),
        (
            cables(cable("c", "<screw_base_rotating_pulley/>", at(1, "0 0 0"))),
            "<screw_base_rotating_pulley>: of cable 'c'",
        ),
        (cables(cable("c", at(0.5, "2 1 3"), at(1, "0 0 0"))), "<link>: is '0.5'; it must be a whole number"),  # type: ignore[arg-type]
        (cables(), "<cable_set>: has no cable"),
        (cables(*FOUR).replace("<force_max>50", "<force_max>0.5", 1), r"tension of cable 'c0' is in \[1, 0.5\] N"),
        (cables(*FOUR).replace("<force_max>50</force_max>", "", 1), "<properties>: has no <force_max>"),
        ("<cables/>", "<cables>: has no <cable_set>"),
        (cables(*FOUR, default="two"), "unknown cable set .* 'two'"),
    ],
)
def test_cables_that_are_refused(tmp_path: Path, ropes: str, words: str) -> None:
    with pytest.raises(DefinitionError, match=words) as caught:
        model(tmp_path, ropes=ropes)
    assert "tray_cables.xml" in str(caught.value) or "tray_bodies.xml" in str(caught.value)


def test_a_cable_that_leaves_its_plane_is_named(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match=r"cable 'c0' leaves the plane of joint type PLANAR_XY by 3 m"):
        model(tmp_path, bodies('type="PLANAR_XY" q_initial="0 0 0"'))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (motion("spline", point(REST), point(REST, time="1")), "unknown kind of trajectory 'spline'"),
        (motion("linear_spline_trajectory", point(REST)), "has 1 points; it needs at least two"),
        (motion("linear_spline_trajectory", point(REST), point(REST)), "<point>: has no attribute time"),
        (motion("linear_spline_trajectory", point(REST), point(REST, time="0")), "stands at 0 s, not after"),
        (motion("linear_spline_trajectory", point(REST), point("0 0", time="1")), "<q>: has 2 values; joint type"),
        (motion("linear_spline_trajectory", point(REST), point(REST, time="1"), times="late"), "'late'; it must be"),
        (motion("cubic_spline_trajectory", point(REST), point(REST, time="1")), "<point>: has no <q_dot>"),
        (
            motion("cubic_spline_trajectory", point(REST, "0 0 0 0 0 1"), point(REST, time="1")),
            "<q_dot>: the orientation",
        ),
        (motion("quintic_spline_trajectory", point(REST, REST), point(REST, REST, time="1")), "has no <q_ddot>"),
        (
            motion("parabolic_blend_trajectory", point(REST), point(REST, time="1"), more='blend_time_default="0.5"'),
            "has a blend time of 0.5 s; it must be above 0 and twice below 1 s",
        ),
    ],
)
def test_trajectories_that_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(DefinitionError, match=words) as caught:
        model(tmp_path, trajectories=trajectories(text))
    assert re.search(r"tray_trajectories\.xml, line \d+, <", str(caught.value))


def test_missing_and_ambiguous_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match="a model needs a file of bodies and one of cables; found none"):
        load_caspr(tmp_path)
    for name in ("a_bodies.xml", "b_bodies.xml"):
        (tmp_path / name).write_text(bodies())
    with pytest.raises(DefinitionError, match=r"2 files of bodies: a_bodies\.xml, b_bodies\.xml"):
        load_caspr(tmp_path)
    (tmp_path / "a_cables.xml").write_text(cables(*FOUR))
    assert load_caspr(tmp_path, bodies=tmp_path / "b_bodies.xml").robot.n_cables == 4


# --- XML of strangers


@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE a [<!ENTITY x "xxxxxxxxxx"><!ENTITY y "&x;&x;&x;&x;&x;&x;">]>',
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]>',
        '<!DOCTYPE a [<!ENTITY % x SYSTEM "file:///etc/hostname"> %x;]>',
    ],
)
def test_entities_are_refused(tmp_path: Path, head: str) -> None:
    path = tmp_path / "x.xml"
    path.write_text(f"{head}<a>&x;</a>")
    with pytest.raises(DefinitionError, match=r"x\.xml, line 1: declares the entity '[xy]'; entities are not read"):
        read_xml(path)


def test_an_entity_of_a_foreign_doctype_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    path.write_text('<!DOCTYPE a SYSTEM "nowhere.dtd"><a>&x;</a>')
    with pytest.raises(DefinitionError, match="refers to the entity 'x'"):
        read_xml(path)


def test_depth_and_encodings_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    path.write_text("<a>" * 100000)
    with pytest.raises(DefinitionError, match="more than 32 elements deep"):
        read_xml(path)
    path.write_bytes(b'<?xml version="1.0" encoding="shift_jis"?><a/>')
    with pytest.raises(DefinitionError, match=r"x\.xml"):
        read_xml(path)


MODEL = {
    "bodies": bodies(), "cables": cables(*FOUR),
    "trajectories": trajectories(motion("linear_spline_trajectory", point(REST), point(REST, time="1"))),
    "operational_spaces": '<operational_spaces default_operational_set="t"><operational_set id="t"><position '
    'marker_id="1" name="p"><link>1</link><axes active_axes="xz"/></position></operational_set></operational_spaces>',
}  # fmt: skip


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damaged_files_are_refused_or_read(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Cut out, double or overwrite a piece anywhere: an error of ours, or a model."""
    folder = tmp_path_factory.mktemp("fuzz")
    spoilt = data.draw(st.sampled_from(sorted(MODEL)))
    for key, text in MODEL.items():
        if key == spoilt:
            start = data.draw(st.integers(0, len(text)))
            stop = min(len(text), start + data.draw(st.integers(0, 40)))
            pieces = ["", text[start:stop] * 2, "1e999", "-1", "<", "&amp;", "nan", "0 0", " id=''", "\0"]
            new = data.draw(st.sampled_from(pieces))
            text = text[:start] + new + text[stop:]
        (folder / f"m_{key}.xml").write_text(text)
    message = ""
    try:
        load_caspr(folder)
    except ParaoptError as error:
        message = str(error)
    assert not message or "m_" in message or str(folder) in message


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused_or_read(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("bytes") / "x.xml"
    path.write_bytes(content)
    with contextlib.suppress(DefinitionError):  # anything else that is raised fails
        assert isinstance(read_xml(path), Element)
