"""A planned motion as figures and as a page."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po
from motions import TASKS, TOOL_TOP, cable_plan, plan_of, problem_of, turning_problem
from paraopt.view import (
    Phase,
    draw_motion,
    list_page_bodies,
    list_page_cables,
    mark_link,
    save_figure,
    style,
    write_motion_page,
)
from paraopt.view.motion import list_cable_ends, trace


@pytest.fixture(scope="module")
def figures() -> dict[str, Any]:
    plan = plan_of("cylinder")
    return draw_motion(plan.problem, plan.seed, plan.trajectory, plan.certificate)


@pytest.mark.parametrize("name", ["path", "actuators", "margins"])
def test_figures_of_a_plan_are_not_blank(figures: dict[str, Any], name: str, tmp_path: Path, looked_at: Any) -> None:
    assert set(figures) == {"path", "actuators", "margins"}
    pixels = looked_at.read_png(save_figure(figures[name], tmp_path / f"{name}.png"))
    assert min(pixels.shape[:2]) > 600
    # curves and letters cover more than half a percent of the white page
    assert np.mean(np.min(pixels, axis=-1) < 0.9) > 0.005
    assert pixels.var() > 1e-3


def test_the_actuators_figure_holds_their_limits(figures: dict[str, Any], looked_at: Any) -> None:
    position, velocity, acceleration = figures["actuators"].axes
    # strokes of 200 mm, 100 mm/s and 500 mm/s^2 both ways
    for axes, values in ((position, (0.0, 200.0)), (velocity, (-100.0, 100.0)), (acceleration, (-500.0, 500.0))):
        for value in values:
            assert looked_at.lines_at(axes, value, 1e-6), (axes.get_ylabel(), value)
    curves = {line.get_label(): line for line in velocity.get_lines()}
    trajectory = plan_of("cylinder").trajectory
    t = np.linspace(0.0, trajectory.duration, 801)
    np.testing.assert_allclose(curves["q1"].get_ydata(), 1e3 * trajectory(t, 1)[:, 0], rtol=0, atol=1e-9)


def test_the_margins_figure_holds_what_was_asked(figures: dict[str, Any], looked_at: Any) -> None:
    above, below = figures["margins"].axes
    assert looked_at.lines_at(above, 5.0, 1e-9)
    assert looked_at.lines_at(below, 0.05)
    certificate = plan_of("cylinder").certificate
    (curve,) = [line for line in above.get_lines() if len(line.get_xdata()) == certificate.n_samples]
    np.testing.assert_allclose(curve.get_ydata(), 1e3 * certificate.clearance, rtol=1e-12)


def test_the_path_figure_holds_seed_path_and_obstacle(figures: dict[str, Any], looked_at: Any) -> None:
    texts = looked_at.texts(figures["path"])
    for word in ("seed", "refined path", "start", "goal", "obstacle", "x [mm]"):
        assert word in texts
    assert len(figures["path"].axes[1].patches) == 2


def test_bodies_have_the_kind_of_their_link() -> None:
    kinds = {body.name: body.kind for body in list_page_bodies(problem_of("cylinder").scene)}
    assert kinds["cylinder"] == "obstacle"
    assert kinds["base plate"] == "base"
    assert kinds["platform"] == kinds["tool"] == "platform"
    assert kinds["rod 1"] == "actuator"
    assert kinds["arm A"] == kinds["forearm B+"] == "robot"
    assert len(kinds) == len(problem_of("cylinder").scene.bodies)


def test_the_line_is_that_of_the_tip_of_the_tool() -> None:
    X = plan_of("box").path(np.linspace(0.0, 1.0, 11))
    # the platform does not turn, by less than 1e-9 rad
    np.testing.assert_allclose(trace(problem_of("box"), X), X[:, -3:] + [0.0, 0.0, TOOL_TOP], rtol=0, atol=1e-9)


def test_without_a_tool_the_line_is_that_of_the_origin() -> None:
    """The 3-RPR names no tool: the origin of the platform, which carries x, y and theta."""
    problem = turning_problem(False)
    X = problem.start_configuration.X[None, :]
    np.testing.assert_allclose(trace(problem, X)[0], [*X[0, -3:-1], 0.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("task", TASKS)
def test_the_page_of_a_plan_carries_its_motion(task: str, tmp_path: Path) -> None:
    plan = plan_of(task)
    path = write_motion_page(
        tmp_path / "motion.html", plan.problem, plan.seed, plan.trajectory, plan.certificate, frames_per_second=20.0
    )
    page = path.read_text(encoding="utf-8")
    assert "<h1>RAF: certified motion</h1>" in page
    match = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    data = json.loads(match[1])
    times = np.frombuffer(base64.b64decode(data["times"]), dtype="<f4")
    assert len(times) == data["count"] == int(np.ceil(plan.trajectory.duration * 20.0)) + 1
    assert times[-1] == pytest.approx(plan.trajectory.duration, rel=1e-6)
    names = [body["name"] for body in data["bodies"]]
    assert "tool" in names
    assert (task in names) == (task != "free")
    # the tool rides on the platform, whose origin is the operational point
    frame = data["bodies"][names.index("tool")]["frame"]
    poses = np.frombuffer(base64.b64decode(data["poses"]), dtype="<f4").reshape(len(times), data["frames"], 7)
    instants = np.clip(times.astype(float), 0.0, plan.trajectory.duration)
    np.testing.assert_allclose(poses[:, frame, :3], plan.trajectory(instants)[:, -3:], rtol=0, atol=1e-6)
    readouts = {readout["name"]: readout for readout in data["readouts"]}
    assert {"parallel margin", "q1", "q2", "q3"} <= set(readouts)
    assert readouts["parallel margin"]["bound"] == 0.05
    assert readouts["clearance"]["bound"] == 5.0
    assert [line["name"] for line in data["paths"]] == ["seed", "refined path"]


def test_a_page_says_when_a_motion_is_not_certified(tmp_path: Path) -> None:
    plan = plan_of("free")
    failed = dataclasses.replace(plan.certificate.checks[0], passed=False)
    certificate = dataclasses.replace(plan.certificate, checks=(failed, *plan.certificate.checks[1:]))
    path = write_motion_page(tmp_path / "motion.html", plan.problem, plan.seed, plan.trajectory, certificate)
    assert "<h1>RAF: NOT certified</h1>" in path.read_text(encoding="utf-8")


def test_the_page_of_a_cable_robot_carries_its_cables_and_its_phases(tmp_path: Path) -> None:
    plan = cable_plan()
    mechanism, end = plan.problem.robot.mechanism, plan.trajectory.duration
    phases = [Phase("first", 0.0, 0.5 * end, [mark_link(mechanism, "held", "platform", (0.1, 0.0))]),
              Phase("second", 0.5 * end, end, [mark_link(mechanism, "free", "platform")])]  # fmt: skip
    path = write_motion_page(
        tmp_path / "motion.html", plan.problem, plan.seed, plan.trajectory, plan.certificate, 20.0, phases
    )
    match = re.search(r'<script id="data" type="application/json">(.*?)</script>', path.read_text("utf-8"), re.DOTALL)
    assert match is not None
    data = json.loads(match[1])
    assert [c["name"] for c in data["cables"]] == [f"cable q{i}" for i in (1, 2, 3, 4)]
    assert [p["name"] for p in data["phases"]] == ["first", "second"]
    platform = next(b["frame"] for b in data["bodies"] if b["name"] == "platform")
    assert [p["marks"][0]["frame"] for p in data["phases"]] == [platform, platform]
    assert data["phases"][0]["marks"][0]["point"] == [0.1, 0.0, 0.0]
    # from their two frames the cables are as long as their variables
    times = np.frombuffer(base64.b64decode(data["times"]), dtype="<f4").astype(float)
    poses = np.frombuffer(base64.b64decode(data["poses"]), dtype="<f4").reshape(len(times), data["frames"], 7)
    X = plan.trajectory(np.clip(times, 0.0, end))
    for k, cable in enumerate(data["cables"]):
        tips = []
        for frame, point in zip(cable["frames"], cable["points"], strict=True):
            turn = 2.0 * np.arctan2(poses[:, frame, 5], poses[:, frame, 6])
            x, y, z = point
            away = [x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z + 0.0 * turn]
            tips.append(poses[:, frame, :3] + np.column_stack(away))
        np.testing.assert_allclose(np.linalg.norm(tips[1] - tips[0], axis=1), X[:, k], rtol=0, atol=1e-6)


def test_ends_of_cables_follow_their_links() -> None:
    plan = cable_plan()
    X = plan.path(np.linspace(0.0, 1.0, 7))
    ends = list_cable_ends(plan.problem.scene, X)
    assert ends.shape == (7, 4, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2), X[:, :4], rtol=0, atol=1e-9)
    lines = list_page_cables(plan.problem.scene)
    assert [line.name for line in lines] == [f"cable q{i}" for i in (1, 2, 3, 4)]
    assert list_cable_ends(problem_of("free").scene, plan_of("free").path([0.5])).shape == (1, 0, 2, 3)
    assert list_page_cables(problem_of("free").scene) == ()
    with pytest.raises(po.UnknownNameError, match=r"link of mark 'held': 'platfrom'.*did you mean 'platform'"):
        mark_link(plan.problem.robot.mechanism, "held", "platfrom")


def test_the_path_figure_of_a_cable_robot_holds_its_cables(looked_at: Any) -> None:
    plan = cable_plan()
    figure = draw_motion(plan.problem, plan.seed, plan.trajectory, plan.certificate)["path"]
    assert "cables" in looked_at.texts(figure)
    drawn = [k for k in figure.axes[1].get_lines() if k.get_color() == style.CABLE]
    assert len(drawn) == 5 * 4  # from start to goal, four cables each
    goal = list_cable_ends(plan.problem.scene, plan.path([1.0]))[0]
    np.testing.assert_allclose([k.get_xydata() for k in drawn[-4:]], 1e3 * goal[:, :, :2], rtol=0, atol=1e-3)
