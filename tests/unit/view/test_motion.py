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

from motions import TASKS, TOOL_TOP, plan_of, problem_of, turning_problem
from paraopt.view import draw_motion, list_page_bodies, save_figure, write_motion_page
from paraopt.view.motion import trace


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
