"""Searches drawn in the space of their coordinates, with the surfaces that bound them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import paraopt as po
from motions import problem_of, turning_problem
from paraopt.view.level_surface import sample_levels, trace_zero_surface
from support import five_bar_robot


def test_the_zero_surface_of_a_sphere_is_its_surface() -> None:
    axes = [np.linspace(-1.5, 1.5, n) for n in (24, 25, 26)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    triangles = trace_zero_surface(axes, x**2 + y**2 + z**2 - 1.0)
    # corners lie on the surface up to the curvature of the values along an edge of the grid
    assert np.max(np.abs(np.linalg.norm(triangles, axis=-1) - 1.0)) < 0.03
    a, b, c = np.moveaxis(triangles, 1, 0)
    area = 0.5 * np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    assert area == pytest.approx(4.0 * np.pi, rel=0.02)


def test_cells_without_values_are_left_out() -> None:
    axes = [np.linspace(-1.0, 1.0, 6)] * 3
    x, _, _ = np.meshgrid(*axes, indexing="ij")
    values = x - 0.1
    whole = trace_zero_surface(axes, values)
    np.testing.assert_allclose(whole[..., 0], 0.1, atol=1e-15)
    values[:, 3:] = np.nan
    assert 0 < len(trace_zero_surface(axes, values)) < len(whole)
    assert trace_zero_surface(axes, np.abs(x) + 1.0).shape == (0, 3, 3)


def test_levels_are_those_of_solved_poses() -> None:
    problem = turning_problem(True)
    low, high = np.array([-0.3, -0.3, 2.8]), np.array([0.3, 0.3, 3.4])
    levels = sample_levels(problem, low, high, (5, 4, 3))
    assert levels.determinant.shape == levels.clearance.shape == (5, 4, 3)
    for i, j, k in ((0, 0, 0), (4, 3, 2), (2, 1, 1)):
        pose = {"x": levels.axes[0][i], "y": levels.axes[1][j], "theta": levels.axes[2][k]}
        solved = problem.robot.kinematics.inverse(pose, start=problem.start_configuration).configuration
        assert levels.determinant[i, j, k] == pytest.approx(problem.determinants(solved.X)[0][0], abs=1e-10)
        distance = problem.scene.clearance(solved).distance - problem.margins.clearance
        assert levels.clearance[i, j, k] == pytest.approx(distance, abs=1e-10)


def test_a_search_is_drawn_with_all_that_it_saw() -> None:
    seed = po.MixedSearch().seed(problem_of("cylinder"))
    figure = po.view.draw_search(seed, title="round the cylinder", nodes=8)
    (axes,) = figure.axes
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    # positions that wait are not drawn as explored, too
    waiting = set(map(tuple, seed.queued.tolist()))
    assert f"explored ({sum(tuple(p) not in waiting for p in seed.explored.tolist())})" in labels
    assert f"queued ({len(seed.queued)})" in labels
    assert {"path", "straight", "start", "goal", "obstacle"} <= set(labels)
    assert axes.get_xlabel() == "x [m]"
    assert figure.get_suptitle() == "round the cylinder"
    path = next(line for line in axes.lines if line.get_label() == "path")
    np.testing.assert_array_equal(np.array(path.get_data_3d()).T, seed.points)


def test_a_problem_alone_is_drawn() -> None:
    problem = replace(turning_problem(False))
    figure = po.view.draw_search(None, problem, title="free", nodes=6)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "path" not in labels
    assert {"straight", "start", "goal"} <= set(labels)
    assert figure.axes[0].get_zlabel() == "theta [rad]"


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="neither a seed nor a problem"):
        po.view.draw_search(None, title="nothing")
    flat = po.Problem(po.Scene(five_bar_robot()), {"x": 6.0, "y": 7.0}, {"x": 5.0, "y": 7.0})
    with pytest.raises(po.DefinitionError, match=r"in 2 coordinates .* must be in 3"):
        po.view.draw_search(None, flat, title="flat")
