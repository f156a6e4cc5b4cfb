"""What is singular at a pose, how far cables sag, where the platform can be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from cable_robots import hanging, ipanema, planar
from paraopt.errors import DefinitionError, InfeasibleError, UnknownNameError
from paraopt.modes.cable import (
    CableRobot,
    Pulley,
    StateOptions,
    cable_functions,
    capacity_margins,
    estimate_sag,
    has_wrench_closure,
    map_workspace,
    report_cable_state,
)


def test_a_regular_pose_has_no_findings() -> None:
    state = report_cable_state(ipanema(t_min=10.0), [0.1, 0.0, 0.9, 0.0, 0.0, 0.0])
    assert not state.is_singular
    assert state.stability is None
    assert "regular" in str(state)
    assert state.margin == capacity_margins(ipanema(t_min=10.0), [0.1, 0.0, 0.9, 0.0, 0.0, 0.0])[0]


def test_lost_rank_is_reported_with_its_direction() -> None:
    """All lines of action meet the axis through both attachments: no moment about it."""
    robot = ipanema(attachments=[(-0.1, 0, 0), (0.1, 0, 0)] * 4, characteristic_length=0.1)
    state = report_cable_state(robot, [0.1, 0.2, 1.0, 0.0, 0.0, 0.0])
    assert state.loses_rank
    assert np.abs(state.lost[0]) == pytest.approx([0, 0, 0, 1, 0, 0], abs=1e-9)
    assert any("loses rank" in finding and "mx" in finding for finding in state.findings)
    # an off-centre mass needs that moment
    shifted = ipanema(attachments=robot.attachments, centre=(0, 0.05, 0), characteristic_length=0.1)
    state = report_cable_state(shifted, [0.1, 0.2, 1.0, 0.0, 0.0, 0.0])
    assert not state.balanced
    assert np.isnan(state.least_tension)


def test_rank_is_lost_where_planar_lines_meet() -> None:
    """Three cables whose lines meet in a point give no moment about it."""
    robot = CableRobot(
        name="three", exits=[(-1, 0), (1, 0), (0, 1)], attachments=[(-0.1, 0), (0.1, 0), (0, 0.1)], mass=1.0,
        t_max=10.0, planar=True, home={"y": 0.3},
    )  # fmt: skip
    assert not report_cable_state(robot, [0.2, 0.3, 0.1]).loses_rank

    def determinant(theta: float) -> float:
        return float(np.linalg.det(cable_functions(robot).wrench_matrix([0.2, 0.3, theta])[0]))

    theta = brentq(determinant, -0.6, 0.6, xtol=1e-15)
    state = report_cable_state(robot, [0.2, 0.3, theta])
    assert state.loses_rank
    assert len(state.lost) == 1


def test_a_tension_that_reaches_zero_names_its_cable() -> None:
    """A hanging platform is moved sideways in balance until one side's cables carry nothing."""
    robot = CableRobot(
        name="two", exits=[(0, 0), (1, 0)], attachments=[(0, 0), (0, 0)], mass=1.0, t_max=50.0, planar=True,
        gravity=(0, -9.81), home={"x": 0.5, "y": -0.5}, characteristic_length=0.1,
    )  # fmt: skip
    inside = report_cable_state(robot, [0.3, -0.5, 0.0])
    assert inside.slack == ()
    below_exit = report_cable_state(robot, [0.0, -0.5, 0.0])
    assert below_exit.slack == ("q2",)
    assert any("the tension of cable 'q2' reaches zero" in finding for finding in below_exit.findings)
    beyond = report_cable_state(robot, [-0.1, -0.5, 0.0])
    assert beyond.slack == ("q2",)
    assert any("cable 'q2' would have to push" in finding for finding in beyond.findings)


def test_the_least_tension_has_no_upper_limit() -> None:
    """Two cables nearly on one line pull hard, and neither pushes; cables that pull against each other have no end."""
    robot = CableRobot(
        name="two", exits=[(0, 0), (1, 0)], attachments=[(0, 0), (0, 0)], mass=1.0, t_max=50.0, planar=True,
        gravity=(0, -9.81), home={"x": 0.5, "y": -0.5}, characteristic_length=0.1,
    )  # fmt: skip
    for height in (0.5, 1e-3, 1e-6):
        state = report_cable_state(robot, [0.5, -height, 0.0])
        assert state.least_tension == pytest.approx(9.81 * np.hypot(0.5, height) / (2 * height), rel=1e-6)
        assert state.slack == ()
    assert report_cable_state(planar(), [0.5, 0.5, 0.1]).least_tension == np.inf
    upright = planar(gravity=(0, -9.81))
    state = report_cable_state(upright, [0.5, 0.5, 1.2])  # turned too far for wrench closure
    assert not has_wrench_closure(upright, [0.5, 0.5, 1.2])[0]
    assert np.isfinite(state.least_tension)


def test_an_equilibrium_that_is_lost_is_reported() -> None:
    pose = hanging().home_pose
    assert report_cable_state(hanging(drop=0.05), pose).findings == ()
    state = report_cable_state(hanging(drop=-0.05), pose)  # a mass above the line of the attachments falls over
    assert state.balanced
    assert state.stability is not None
    assert not state.stability.is_stable
    assert any("unstable" in finding for finding in state.findings)
    # that its tensions exceed their limits is another finding
    weak = report_cable_state(hanging(drop=-0.05, t_max=1.0), pose)
    assert [any(words in finding for finding in weak.findings) for words in ("limits", "unstable")] == [True, True]
    # where a cable would have to push there is no equilibrium to judge
    beyond = report_cable_state(hanging(drop=0.0), [0.5, -0.1, -0.5, 0.0, 0.0, 0.0])
    assert not any("equilibrium" in finding for finding in beyond.findings)
    assert any("push" in finding for finding in beyond.findings)
    # between both it is neutral
    assert any("neutral" in finding for finding in report_cable_state(hanging(drop=0.0), pose).findings)


def test_options_of_states_are_checked() -> None:
    with pytest.raises(DefinitionError, match="slack tolerance"):
        StateOptions(slack=0.0)


def test_sag_of_a_level_cable_is_that_of_the_catenary() -> None:
    """Two level cables of 4 m each hold a light platform between them; the catenary is solved for the same tension."""
    robot = CableRobot(
        name="line", exits=[(-4, 0, 0), (4, 0, 0)], attachments=[(0, 0, 0)] * 2, mass=1.0, t_max=1e4,
        characteristic_length=0.1, home={"x": 0.0},
    )  # fmt: skip
    tension, density, span = 400.0, 0.1, 4.0
    weight = 9.81 * density
    sag = estimate_sag(robot, [0.0] * 6, [tension, 2 * tension], density)
    parameter = tension / weight  # the tension at the lowest point
    exact = parameter * (np.cosh(0.5 * span / parameter) - 1.0)
    assert sag.deflections[0, 0] == pytest.approx(exact, rel=1e-4)
    assert sag.deflections[0, 1] == pytest.approx(0.5 * sag.deflections[0, 0])
    assert sag.ratios[0, 0] == pytest.approx(sag.deflections[0, 0] / span)
    assert sag.check(0.006) is sag
    with pytest.raises(InfeasibleError, match=r"cable 'q1' hangs .* mm"):
        sag.check(0.004)


def test_sag_depends_on_the_slope() -> None:
    robot = ipanema()
    upright = CableRobot(
        name="upright", exits=[(0, 0, 2), (3, 0, 2)], attachments=[(0, 0, 0)] * 2, mass=1.0, t_max=10.0,
        characteristic_length=0.1, home={"z": 0.0},
    )  # fmt: skip
    sag = estimate_sag(upright, [0.0] * 6, 10.0, 0.01)
    assert sag.deflections[0, 0] == 0.0  # a cable that hangs down is straight
    assert sag.deflections[0, 1] == pytest.approx(0.01 * 9.81 * np.hypot(3, 2) * 3 / 80)
    assert np.isinf(estimate_sag(robot, robot.home_pose, 0.0, 0.01).deflections).all()
    for tensions in ([1.0] * 3, [np.nan] * len(upright.cables), "taut"):
        with pytest.raises(DefinitionError, match="tensions"):
            estimate_sag(upright, upright.home_pose, tensions, 0.01)
    level = estimate_sag(planar(), [0.5, 0.5, 0.0], 10.0, 0.01)  # gravity bends cables of a level plane
    assert np.all(level.deflections > 0.0)


def test_workspace_is_the_verdict_at_every_place() -> None:
    robot = ipanema(t_min=10.0, pulleys=[Pulley(radius=0.05)] * 8)
    found = map_workspace(robot, {"z": [0.5, 1.0, 1.5]}, {"gamma": 0.1}, count=9, margin=20.0)
    assert found.margins.shape == (9, 9, 3)
    pose = [found.axes["x"][2], found.axes["y"][5], 1.0, 0.0, 0.0, 0.1]
    assert found.margins[2, 5, 1] == pytest.approx(capacity_margins(robot, pose)[0])
    assert found.feasible[2, 5, 1] == (found.margins[2, 5, 1] >= 20.0)
    assert 0.0 < found.share < 1.0
    cell = np.prod([np.diff(v)[0] for v in found.axes.values()])
    assert found.volume == pytest.approx(np.sum(found.feasible) * cell)


def test_symmetric_robot_has_a_symmetric_workspace() -> None:
    margins = map_workspace(ipanema(t_min=10.0), count=15).margins
    assert margins == pytest.approx(margins[::-1], rel=1e-6, abs=1e-6)
    assert margins == pytest.approx(margins[:, ::-1], rel=1e-6, abs=1e-6)


def test_planar_workspace_without_gravity_is_that_of_wrench_closure() -> None:
    robot = planar()
    found = map_workspace(robot, count=21)
    mesh = np.meshgrid(*found.axes.values(), indexing="ij")
    poses = np.column_stack([m.ravel() for m in mesh] + [np.zeros(21 * 21)])
    assert np.array_equal(found.margins.ravel() > 1e-9, has_wrench_closure(robot, poses))


def test_maps_are_checked() -> None:
    with pytest.raises(UnknownNameError, match="axis"):
        map_workspace(ipanema(), {"w": [0.0, 1.0]})
    with pytest.raises(UnknownNameError, match="angle"):
        map_workspace(ipanema(), orientation={"x": 0.0})
    with pytest.raises(DefinitionError, match="growing"):
        map_workspace(ipanema(), {"x": [1.0, 0.0]})
    with pytest.raises(DefinitionError, match="give its axis"):
        map_workspace(ipanema(exits=[(x, y, 2) for x, y in ((-2, 1), (2, 1), (2, -1), (-2, -1))] * 2))
    with pytest.raises(DefinitionError, match="at least 2"):
        map_workspace(ipanema(), count=1)
    with pytest.raises(DefinitionError, match="whole number"):
        map_workspace(ipanema(), count=2.5)  # type: ignore[arg-type]
    for values in (["low", "high"], [0.0, np.nan], [0.0, np.inf]):
        with pytest.raises(DefinitionError, match="axis 'x'"):
            map_workspace(ipanema(), {"x": values})
    with pytest.raises(DefinitionError, match="wrenches have shape"):
        map_workspace(ipanema(), count=3, wrench=[1.0])
