"""Working modes: all postures of each leg, their product, names and signs, and where two of them merge."""

from __future__ import annotations

import functools
import inspect
import itertools
from dataclasses import replace
from math import prod

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics.multistart import estimate_missing
from paraopt.kinematics.postures import PostureReader, turn_towards
from paraopt.robots.planar_platform import planar_platform
from support import five_bar_robot

Array = np.ndarray
# ranges cut postures off; the facts count all of them
EVERYWHERE = po.WorkingModeOptions(respect_ranges=False)
COUNTED = (
    "two_rpr", "five_bar", "three_rpr", "three_rpr_innocenti", "three_rrr", "planar_platform", "delta", "hexa",
    "gosselin_wrist", "serial_2r", "serial_2rp",
)  # fmt: skip


@functools.cache
def robot_of(name: str) -> po.Robot:
    return getattr(po.robots, name)()


def home_pose(robot: po.Robot) -> dict[str, float]:
    return {n: robot.home_configuration[n] for n in robot.mechanism.operational}


# --- Counts


def test_all_that_state_a_count_are_counted() -> None:
    built = {n: getattr(po.robots, n) for n in po.robots.__all__ if n not in COUNTED}
    stated = [n for n, build in built.items() if callable(build) and "working modes" in _source_of(build)]
    assert stated == []


def _source_of(build: object) -> str:
    code = inspect.getsource(build)  # type: ignore[arg-type]
    return code if "facts=" in code else ""


@pytest.mark.parametrize("name", COUNTED)
def test_counts_of_the_library(name: str) -> None:
    robot = robot_of(name)
    modes = robot.kinematics.working_modes(home_pose(robot), robot.home_configuration, EVERYWHERE)
    assert modes.count == len(modes) == robot.facts["working modes"] == prod(leg.count for leg in modes.legs)
    assert modes.merged == ()
    assert modes.reason == ""


@pytest.mark.parametrize("name", ["five_bar", "three_rrr", "delta", "hexa", "raf", "gosselin_wrist", "lee"])
def test_every_mode_closes_all_loops_in_a_posture_of_its_own(name: str) -> None:
    robot = robot_of(name)
    kinematics, home = robot.kinematics, robot.home_configuration
    modes = kinematics.working_modes(home_pose(robot), home)
    found = list(modes)
    X = np.array([c.X for c in found])
    assert len(X) == modes.count
    assert np.max(kinematics.scaled_residual(X)) < 1e-12
    assert_allclose(X[:, kinematics.mechanism.indices(kinematics.mechanism.operational)],
                    np.tile(home.operational, (len(X), 1)), rtol=0, atol=0)  # fmt: skip
    marks = PostureReader(kinematics)(X)
    for a, b in itertools.combinations(range(len(X)), 2):
        assert np.max(np.abs(marks[a] - marks[b])) > 1e-3
    labels = list(modes.labels)
    assert len(set(labels)) == modes.count
    assert [modes.label_of(c) for c in found] == labels
    # the first mode is that of the start
    assert_allclose(X[0], home.X, rtol=0, atol=1e-9)
    assert modes.label_of(home) == labels[0]


def test_modes_are_counted_and_not_built() -> None:
    """Fifteen million combinations and more cost nothing until they are asked for."""
    robot = robot_of("hexa")
    modes = robot.kinematics.working_modes(home_pose(robot))
    assert next(iter(modes.labels)) in set(itertools.islice(modes.labels, 3))
    assert modes.missing_probability < 1 - (1 - po.SearchOptions().missing_probability) ** 6


def test_ranges_cut_postures_off() -> None:
    limited = po.robots.five_bar(base=8, proximal=(5, 5), distal=(7, 7), ranges=((0, np.pi), (0, np.pi)), tip=(4, 4))
    kinematics = po.Kinematics(limited.mechanism, backend="virtual machine")
    pose = {"x": 4.0, "y": 4.0}
    assert kinematics.working_modes(pose, options=EVERYWHERE).count == 4
    inside = kinematics.working_modes(pose)
    # by hand: elbows above the base line only
    angles = [c["theta1"] for c in kinematics.working_modes(pose, options=EVERYWHERE)]
    expected = sum(0 <= a <= np.pi for a in sorted(set(np.round(angles, 9)))) ** 2
    assert inside.count == expected < 4


def test_angles_are_those_nearest_to_the_start() -> None:
    robot = five_bar_robot()
    home = robot.home_configuration
    start = home.X.copy()
    start[:2] += 4 * np.pi
    first = next(iter(robot.kinematics.working_modes(home_pose(robot), start)))
    assert_allclose(first.X, start, rtol=0, atol=1e-9)
    # inside a range, where that is possible
    limited = po.robots.five_bar(ranges=((0, 2 * np.pi), (0, 2 * np.pi)))
    kinematics = po.Kinematics(limited.mechanism, backend="virtual machine")
    turned = turn_towards(kinematics, np.array([[-1.0, 7.0, 0, 0, 0, 0]]), np.zeros(6))
    assert_allclose(turned[0, :2], [2 * np.pi - 1, 7 - 2 * np.pi], rtol=0, atol=1e-12)


# --- Names


def test_a_mode_is_reached_by_its_name() -> None:
    robot = robot_of("three_rrr")
    kinematics, pose = robot.kinematics, home_pose(robot)
    modes = kinematics.working_modes(pose)
    assert set(modes.labels) == {"".join(s) for s in itertools.product("+-", repeat=3)}
    for signs in itertools.product((1, -1), repeat=3):
        found = kinematics.inverse(pose, mode=signs)
        assert found.status is po.Status.CONVERGED
        elbows = np.sign(np.sin([found.configuration[f"beta{i}"] for i in (1, 2, 3)]))
        # det of a leg RR is L M sin(beta): the sign is the side of the elbow
        assert tuple(elbows) == signs or tuple(-elbows) == signs
        assert modes.signs(signs) == signs
        assert modes.label_of(found.configuration) == "".join("+" if s > 0 else "-" for s in signs)


def test_signs_are_those_of_the_block_determinants() -> None:
    robot = five_bar_robot()
    kinematics = robot.kinematics
    modes = kinematics.working_modes(home_pose(robot))
    for label, configuration in zip(modes.labels, modes, strict=True):
        M, N, _ = kinematics.jacobians(configuration.X)
        block = np.hstack([M, N])
        for leg, sign in zip(kinematics.legs, label, strict=True):
            columns = kinematics.mechanism.indices(leg.variables)
            assert np.sign(np.linalg.det(block[np.ix_(leg.rows, columns)])) == {"+": 1, "-": -1}[sign]


@pytest.mark.parametrize(
    ("robot", "path"),
    [
        pytest.param(planar_platform("R_P_R", "_R_PR", "R_P_R"), {"theta": 2 * np.pi}, id="weld, a whole turn"),
        pytest.param(po.robots.delta(), {"x": 0.4, "y": -0.3, "z": -0.2}, id="held rotations"),
        pytest.param(po.robots.gosselin_wrist(), {"alpha": 0.3, "beta": 0.2, "gamma": 0.4}, id="points on a sphere"),
    ],
)
def test_a_motion_without_serial_singularity_keeps_its_mode(robot: po.Robot, path: dict[str, float]) -> None:
    """Also where a leg has more equations than unknowns: the sign does not hang on which of them are taken."""
    kinematics, here = robot.kinematics, robot.home_configuration
    pose = home_pose(robot)
    first, seen = None, 0
    for step in np.linspace(0.0, 1.0, 25):
        target = {n: pose[n] + step * path.get(n, 0.0) for n in pose}
        solution = kinematics.inverse(target, here)
        if solution.status is not po.Status.CONVERGED:
            break
        here = solution.configuration
        modes = kinematics.working_modes(target, here, EVERYWHERE)
        # 1 radian and more would be another branch
        assert np.max(np.abs(next(iter(modes)).X - here.X)) < 1e-8
        label = modes.label_of(here)
        first = first or label
        assert label == first
        assert all(set(leg.labels) in ({"+", "-"}, {"+"}, {"-"}) for leg in modes.legs)
        seen += 1
    assert seen > 8


# --- Serial singularities


@pytest.mark.parametrize("offset", [0.0, 1e-13])
def test_two_modes_merge_where_a_leg_is_stretched(offset: float) -> None:
    robot = five_bar_robot()
    modes = robot.kinematics.working_modes({"x": 13.0 - offset, "y": 0.0})
    assert modes.merged == ("theta1",)
    assert modes.legs[0].labels == ("0",)
    assert modes.legs[0].margins[0] < 1e-5
    assert modes.count == 2
    assert set(modes.labels) == {"0+", "0-"}
    assert modes.signs("0+") == (0, 1)
    stretched = robot.kinematics.inverse({"x": 13.0, "y": 0.0}, mode=(0, 1))
    assert abs(stretched.X[robot.mechanism.index("theta3")]) < 1e-5


def test_modes_are_apart_next_to_a_singularity() -> None:
    modes = five_bar_robot().kinematics.working_modes({"x": 13.0 - 1e-6, "y": 0.0})
    assert modes.merged == ()
    assert modes.count == 4


def test_a_leg_of_no_length_is_one_singular_posture() -> None:
    mechanism = po.robots.two_rpr().mechanism
    kinematics = po.Kinematics(mechanism, backend="virtual machine")
    modes = kinematics.working_modes({"x": 0.0, "y": 0.0}, options=EVERYWHERE)
    assert modes.merged == ("rho1",)
    assert modes.count == 1


# --- Failures


def test_a_pose_out_of_reach_says_which_leg() -> None:
    kinematics = five_bar_robot().kinematics
    modes = kinematics.working_modes({"x": -12.0, "y": 0.0})
    assert (modes.count, list(modes), list(modes.labels)) == (0, [], [])
    assert "leg 'theta2' does not close" in modes.reason
    assert "theta1" not in modes.reason
    with pytest.raises(po.SolveError, match="leg 'theta2' of 'five-bar' has no posture '\\+'") as caught:
        kinematics.inverse({"x": -12.0, "y": 0.0}, mode="++")
    assert caught.value.evidence["modes"].count == 0


def test_ranges_are_named_when_they_are_the_reason() -> None:
    robot = po.robots.two_rpr()
    kinematics = po.Kinematics(robot.mechanism, backend="virtual machine")
    modes = kinematics.working_modes({"x": 5.0, "y": 30.0})
    assert modes.count == 0
    assert modes.reason.startswith("leg 'rho1' would leave the ranges of rho1; leg 'rho2'")


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ("+", "names 1 postures; it must name 2"),
        ("+++", "names 3"),
        ("+q", "posture 'q' of leg 'theta2' is unknown"),
        ((1, 2), "sign of a leg is 2"),
        ((1, float("nan")), "sign of a leg is nan"),
    ],
)
def test_names_that_mean_nothing_are_refused(mode: object, message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        five_bar_robot().kinematics.inverse({"x": 6.0, "y": 7.0}, mode=mode)  # type: ignore[arg-type]


def test_a_sign_that_several_postures_share_is_not_enough() -> None:
    robot = robot_of("raf")
    modes = robot.kinematics.working_modes(home_pose(robot), robot.home_configuration)
    labels = next(iter(modes.labels)).split()
    assert modes[" ".join(labels)].X[0] == pytest.approx(robot.home_configuration.X[0])
    with pytest.raises(po.DefinitionError, match=r"has 2 postures of sign '[+-]'; name one of"):
        modes[[label[0] for label in labels]]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "high", None])
def test_values_must_be_finite_numbers(value: object) -> None:
    with pytest.raises(po.DefinitionError, match="'x'"):
        five_bar_robot().kinematics.working_modes({"x": value, "y": 7.0})  # type: ignore[dict-item]


def test_the_pose_must_be_complete() -> None:
    kinematics = five_bar_robot().kinematics
    with pytest.raises(po.DefinitionError, match="missing \\['y'\\]"):
        kinematics.working_modes({"x": 6.0})
    with pytest.raises(po.DefinitionError, match="not operational \\['theta1'\\]"):
        kinematics.inverse({"x": 6.0, "y": 7.0, "theta1": 0.0}, mode="++")


def test_a_configuration_in_no_mode_is_seen() -> None:
    kinematics = five_bar_robot().kinematics
    modes = kinematics.working_modes({"x": 6.0, "y": 7.0})
    other = kinematics.inverse({"x": 6.3, "y": 7.0}, mode="+-").configuration
    with pytest.raises(po.SolveError, match="leg 'theta1' of the configuration is in none of its 2 postures"):
        modes.label_of(other)


def test_a_pose_that_violates_an_equation_without_joints_has_no_mode() -> None:
    mechanism = po.robots.two_rpr().mechanism
    rail = po.PointOnLine("tip", (0, 0), "base", (0, 7), "x", "rail")
    kinematics = po.Kinematics(replace(mechanism, closures=[*mechanism.closures, rail]), backend="virtual machine")
    assert kinematics.working_modes({"x": 5.0, "y": 7.0}).count == 1
    off = kinematics.working_modes({"x": 5.0, "y": 6.9})
    assert (off.count, list(off), list(off.labels)) == (0, [], [])
    assert off.reason.startswith("the pose violates 'rail")
    with pytest.raises(po.SolveError, match="the pose violates 'rail"):
        off["++"]


def test_a_quantity_read_off_a_leg_does_not_disturb_its_modes() -> None:
    reach = po.Gauge("reach", lambda values, poses: values["theta1"] + values["theta3"], kind="angle")
    kinematics = po.Kinematics(five_bar_robot().mechanism, backend="virtual machine", gauges=[reach])
    modes = kinematics.working_modes({"x": 6.0, "y": 7.0})
    assert modes.count == 4
    for configuration in modes:
        assert configuration["reach"] == pytest.approx(configuration["theta1"] + configuration["theta3"])


# --- Coordinates that are held


def test_rotations_of_a_delta_are_held_by_themselves() -> None:
    robot = robot_of("delta")
    modes = robot.kinematics.working_modes(home_pose(robot), robot.home_configuration)
    assert dict(modes.held) == {"alpha": 0.0, "beta": 0.0, "gamma": 0.0}
    assert [leg.leg.active for leg in modes.legs] == [("theta1",), ("theta2",), ("theta3",)]


def test_without_a_hold_the_block_is_coupled_and_has_more_solutions() -> None:
    robot = robot_of("delta")
    options = po.WorkingModeOptions(hold=(), search=po.SearchOptions(max_starts=4000))
    modes = robot.kinematics.working_modes(home_pose(robot), robot.home_configuration, options)
    assert [leg.leg.active for leg in modes.legs] == [("theta1", "theta2", "theta3")]
    unturned = [c for c in modes if max(abs(c["alpha"]), abs(c["beta"]), abs(c["gamma"])) < 1e-9]
    assert 1 <= len(unturned) <= 8 < modes.count


def test_a_hold_that_contradicts_the_equations_closes_nothing() -> None:
    robot = robot_of("delta")
    start = {**robot.home, "gamma": 0.4}
    options = po.WorkingModeOptions(hold=("alpha", "beta", "gamma"))
    pose = home_pose(robot)
    X = robot.home_configuration.X.copy()
    X[robot.mechanism.index("gamma")] = 0.4
    modes = robot.kinematics.working_modes(pose, start, options)
    for configuration in modes:
        assert configuration.residual < 1e-10  # what is found is closed, whatever was held


@pytest.mark.parametrize(("name", "message"), [("theta1", "only passive variables can"), ("twist", "unknown variable")])
def test_only_passive_variables_are_held(name: str, message: str) -> None:
    robot = robot_of("delta")
    with pytest.raises(po.DefinitionError, match=message):
        robot.kinematics.working_modes(home_pose(robot), options=po.WorkingModeOptions(hold=(name,)))


# --- What may be missing


def test_the_estimate_by_hand() -> None:
    """One solution in ten draws: P(complete) = 8/10; two in ten: 8/10 x 7/11."""
    assert estimate_missing(10, 1) == pytest.approx(1 - 8 / 10)
    assert estimate_missing(10, 2) == pytest.approx(1 - 8 / 10 * 7 / 11)
    assert estimate_missing(3, 1) == 1.0
    assert estimate_missing(0, 0) == 1.0
    falling = [estimate_missing(n, 5) for n in (10, 100, 1000, 10000)]
    assert falling == sorted(falling, reverse=True)
    assert falling[-1] < 0.005


@pytest.mark.parametrize(
    "wrong", [{"missing_probability": 0.0}, {"missing_probability": 1.5}, {"max_starts": float("nan")}, {"batch": -1}]
)
def test_options_are_checked(wrong: dict[str, float]) -> None:
    with pytest.raises(po.DefinitionError, match=next(iter(wrong))):
        po.SearchOptions(**wrong)  # type: ignore[arg-type]


def test_any_size_of_batch_is_allowed() -> None:
    options = po.WorkingModeOptions(search=po.SearchOptions(batch=100))
    assert five_bar_robot().kinematics.working_modes({"x": 6.0, "y": 7.0}, options=options).count == 4
