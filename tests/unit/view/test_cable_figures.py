"""Figures of cable robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import paraopt as po
from cable_robots import ipanema, planar
from paraopt.errors import DefinitionError
from paraopt.modes.cable import distribute_batch, dynamic_tensions, map_workspace
from paraopt.view import save_figure
from paraopt.view.cable_figures import draw_cable_workspace, draw_lengths, draw_tensions


def test_workspace_is_one_picture_with_its_slices(tmp_path: Path) -> None:
    found = map_workspace(ipanema(t_min=10.0), count=13)
    figure = draw_cable_workspace(found, slices=2)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert sum(title.startswith("z = ") for title in titles) == 2
    assert figure.axes[0].collections  # the surface
    assert save_figure(figure, tmp_path / "workspace.png").stat().st_size > 10_000


def test_planar_workspace_is_drawn_flat() -> None:
    figure = draw_cable_workspace(map_workspace(planar(), count=21, orientation={"theta": 0.1}))
    assert figure.axes[0].get_xlabel() == "x [m]"
    assert "theta = 5.73°" in figure._suptitle.get_text()  # type: ignore[attr-defined]


def test_an_empty_workspace_is_refused() -> None:
    with pytest.raises(DefinitionError, match="nothing to draw"):
        draw_cable_workspace(map_workspace(ipanema(), {"z": [3.0, 4.0]}, count=5))


def test_tensions_and_lengths_in_time() -> None:
    robot = planar(gravity=(0, -9.81), velocity=0.5, acceleration=2.0)
    pose = {"x": 0.4, "y": 0.4, "theta": 0.0}
    trajectory = po.plan(po.Problem(po.Scene(robot.robot), pose, pose | {"x": 0.6})).trajectory
    tensions = dynamic_tensions(robot, trajectory, count=101)
    figure = draw_tensions(tensions)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert np.asarray(lines["q3"].get_ydata()) == pytest.approx(tensions.values[:, 2])
    lengths = draw_lengths(robot, trajectory)
    drawn = {line.get_label(): np.asarray(line.get_ydata()) for line in lengths.axes[0].lines}
    assert drawn["q1"][0] == pytest.approx(np.hypot(0.3, 0.4))
    with pytest.raises(DefinitionError, match="no times"):
        draw_tensions(distribute_batch(robot, [[0.5, 0.5, 0.0]]))
