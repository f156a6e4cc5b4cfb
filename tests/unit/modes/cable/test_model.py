"""The description of cable robots: what is read, what is refused, and the machine that follows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import paraopt as po
from cable_robots import ipanema, planar
from paraopt.errors import DefinitionError, UnknownNameError
from paraopt.kinematics import report_state
from paraopt.modes.cable import PLATFORM, Drum, Pulley


def test_planar_robot_has_the_facts_of_the_library() -> None:
    facts = po.robots.larm_planar().facts
    robot = planar().robot
    report = report_state(robot.kinematics, robot.home_configuration)
    assert report.n_variables == facts["variables"]
    assert {k: report.ranks[k].value for k in "EMNK"} == {k: facts[f"rank {k}"] for k in "EMNK"}
    assert robot.home_configuration.residual < 1e-12


def test_spatial_robot_is_redundant_and_closed_at_home() -> None:
    robot = ipanema().robot
    assert len(robot.mechanism.active) == 8
    assert len(robot.mechanism.operational) == 6
    assert robot.home_configuration.residual < 1e-12
    assert [cable.name for cable in robot.cables] == [f"cable q{i}" for i in range(1, 9)]
    assert robot.centres[PLATFORM] == (0.0, 0.0, 0.0)


def test_home_far_from_the_axes_is_no_singular_place_of_the_joints() -> None:
    robot = ipanema(home={"x": 1.2, "y": -0.7, "z": 0.4, "alpha": 0.3, "beta": -0.2, "gamma": 0.4}).robot
    home = robot.home_configuration
    angles = [home[v.name] for v in robot.mechanism.variables if v.link.startswith("pulley")]
    assert np.max(np.abs(angles)) < 1e-9  # every cable lies on the third axis of its joint


def test_limits_of_winches_reach_the_robot() -> None:
    robot = ipanema(velocity=2.0, acceleration=[3.0] * 8, jerk=40.0).robot
    assert dict(robot.limits.velocity) == dict.fromkeys(robot.mechanism.active, 2.0)
    assert robot.limits.acceleration["q5"] == 3.0


def test_arrays_are_copied_and_read_only() -> None:
    exits = np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)])
    robot = planar(exits=exits)
    exits[0] = 5.0
    assert robot.exits[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        robot.exits[0, 0] = 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exits": [(0, 0, 0)] * 8}, "must be apart"),
        ({"exits": np.zeros((0, 3)), "attachments": np.zeros((0, 3))}, "no exits"),
        ({"attachments": [(0, 0, 0)] * 7}, "attachments of 'IPAnema 1' have shape"),
        ({"exits": [(0, 0, np.nan)] * 8}, "finite"),
        ({"mass": 0.0}, "mass of 'IPAnema 1' is 0 kg"),
        ({"t_max": -5.0}, "largest tension is -5 N"),
        ({"t_min": [1.0] * 3}, "least tension has 3 values"),
        ({"t_min": 800.0}, "cable 'q1' is in"),
        ({"t_max": [720.0] * 7 + [0.0]}, "largest tension of cable 'q8'"),
        ({"cables": ["a"] * 8}, "8 different names"),
        ({"inertia": np.diag([1.0, 1.0, -1.0])}, "principal values negative"),
        ({"inertia": 3.0}, "in space it must be"),
        ({"load": (1.0, 2.0)}, "load"),
        ({"radius": 0.0}, "radius is 0 m"),
        ({"velocity": "fast"}, "velocity is 'fast'"),
        ({"pulleys": [Pulley(radius=0.1)] * 7}, "8 of Pulley"),
        ({"drums": [None] * 8}, "8 of Drum"),
        ({"lengths": (2.0, 1.0)}, "shortest < longest"),
        ({"ignore": (-0.1, 0.0)}, "none may be negative"),
        ({"characteristic_length": 0.0}, "characteristic length"),
        ({"home": {"x": -1.94, "y": 1.44, "z": 2.0}}, "no length at home"),
        ({"planar": "yes"}, "planar"),
    ],
)
def test_impossible_descriptions_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DefinitionError, match=message):
        ipanema(**changes)


def test_unknown_coordinates_are_named() -> None:
    with pytest.raises(UnknownNameError, match="theta"):
        ipanema(home={"theta": 0.1})
    with pytest.raises(UnknownNameError, match="operational"):
        ipanema(operational=("x", "w"))


def test_points_of_a_planar_robot_have_two_coordinates() -> None:
    with pytest.raises(DefinitionError, match="exits"):
        planar(exits=[(0, 0, 0)] * 4)
    with pytest.raises(DefinitionError, match="no third component"):
        planar(centre=(0, 0, 1))
    with pytest.raises(DefinitionError, match="swivels out of the plane"):
        planar(pulleys=[Pulley(radius=0.01)] * 4)
    assert planar().weight == 0.0  # the plane is level by default
    assert planar(gravity=(0, -9.81)).weight == pytest.approx(9.81)


def test_poses_are_checked() -> None:
    with pytest.raises(DefinitionError, match=r"shape \(k, 6\)"):
        ipanema().check_poses([[0.0] * 5])
    assert ipanema().check_poses([0.0] * 6).shape == (1, 6)


@pytest.mark.parametrize("sign", [1, -1])
def test_drums_turn_lengths_into_angles_and_back(sign: int) -> None:
    drum = Drum(radius=0.05, pitch=0.004, sign=sign, zero_length=1.5)
    lengths = np.linspace(0.5, 4.0, 11)
    assert drum.lengths(drum.angles(lengths)) == pytest.approx(lengths, abs=1e-15)
    one_turn = drum.lengths(2 * np.pi) - 1.5
    assert one_turn == pytest.approx(sign * np.hypot(2 * np.pi * 0.05, 0.004))


def test_parts_of_winches_are_checked() -> None:
    with pytest.raises(DefinitionError, match="radius of a drum"):
        Drum(radius=0.0)
    with pytest.raises(DefinitionError, match="sign"):
        Drum(radius=0.1, sign=2)
    with pytest.raises(DefinitionError, match="zero vector"):
        Pulley(radius=0.1, axis=(0, 0, 0))


def test_a_redundant_robot_is_planned_with_its_cables_as_bodies() -> None:
    robot = ipanema(velocity=2.0, acceleration=10.0, jerk=200.0).robot
    pose = dict.fromkeys(robot.mechanism.operational, 0.0) | {"z": 1.0}
    near = po.Sphere(radius=0.15, pose=po.transform((0.5, 0.75, 1.0)))
    problem = po.Problem(po.Scene(robot, [near]), start=pose | {"x": -0.2}, goal=pose | {"x": 0.6, "y": 0.2})
    plan = po.plan(problem)
    assert plan.certificate.passed
    between = po.Sphere(radius=0.2, pose=po.transform((0.1, 0.45, 1.3)))
    with pytest.raises(po.InfeasibleError, match="obstacle 1 / cable q"):
        po.plan(po.Problem(po.Scene(robot, [between]), start=pose | {"x": -1.0}, goal=pose | {"x": 1.0}))
