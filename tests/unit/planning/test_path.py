"""Paths: closed at every point, with exact derivatives, and picky about what they are asked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

import paraopt as po
from motions import TASKS, plan_of, problem_of, turning_problem
from support import finite_difference, raf_robot


def _between_knots(path: po.Path, count: int = 12) -> np.ndarray:
    """Give parameters away from the knots, where the third derivative of a cubic spline jumps."""
    s = np.random.default_rng(1).uniform(0.01, 0.99, 4 * count)
    knots = np.unique(path.spline.t)
    return s[np.min(np.abs(s[:, None] - knots), axis=1) > 2e-3][:count]


def _paths() -> dict[str, po.Path]:
    problem = turning_problem(True)
    turning = po.SplineRefiner().refine(problem, po.MixedSearch().seed(problem)).path
    return {**{task: plan_of(task).path for task in TASKS}, "3-RPR": turning}


@pytest.mark.parametrize("name", ["cylinder", "box", "3-RPR"])
def test_derivatives_are_exact(name: str) -> None:
    path = _paths()[name]
    scale = path.robot.kinematics.graph.variable_scale
    for s in _between_knots(path):
        first = finite_difference(lambda p: path(float(p[0])) / scale, [s], 1e-4)[:, 0]
        second = finite_difference(lambda p: path(float(p[0]), 1) / scale, [s], 1e-4)[:, 0]
        # values are solved to some 1e-13 of the scale: over a step of 1e-4 that is 1e-9
        np.testing.assert_allclose(path(float(s), 1) / scale, first, rtol=0, atol=1e-8)
        # quartic terms of the spline's pieces are absent, those of the closures small: 1e-4^4 of them
        np.testing.assert_allclose(path(float(s), 2) / scale, second, rtol=0, atol=1e-7)
    assert np.max(np.abs(path(_between_knots(path), 2) / scale)) > 0.1  # not zero against the tolerance


@pytest.mark.parametrize("name", [*TASKS, "3-RPR"])
def test_the_closures_hold_everywhere(name: str) -> None:
    path = _paths()[name]
    X = path(np.random.default_rng(2).uniform(0.0, 1.0, 500))
    assert np.max(path.robot.kinematics.scaled_residual(X)) <= 1e-12
    # and the velocities do not open them: E dX = 0, both from the same factors
    s = np.linspace(0.0, 1.0, 50)
    X, dX = path(s), path(s, 1)
    slip = [np.column_stack(path.robot.kinematics.jacobians(x)) @ d for x, d in zip(X, dX, strict=True)]
    assert np.max(np.abs(slip)) < 1e-10


@pytest.mark.parametrize("name", [*TASKS, "3-RPR"])
def test_the_independent_coordinates_are_the_spline(name: str) -> None:
    path = _paths()[name]
    index = path.robot.mechanism.indices(path.independent)
    s = np.linspace(0.0, 1.0, 101)
    for order in (0, 1, 2):
        # order 0 is imposed; the others pass through the tangent's columns, which are unit vectors there
        np.testing.assert_allclose(path(s, order)[:, index], path.spline(s, order), rtol=1e-12, atol=1e-12)


def test_shapes_follow_the_parameter() -> None:
    path = plan_of("cylinder").path
    n = len(path.robot.mechanism.names)
    for order in (0, 1, 2):
        assert path(0.5, order).shape == (n,)
        assert path(np.float64(0.5), order).shape == (n,)
        assert path([0.5], order).shape == (1, n)
        assert path(np.linspace(0, 1, 7), order).shape == (7, n)
        # a single point, and the same within others: the solves see the same start
        np.testing.assert_allclose(path([0.1, 0.5, 0.9], order)[1], path(0.5, order), rtol=0, atol=1e-9)


def test_points_give_everything_at_once() -> None:
    path, s = plan_of("box").path, np.linspace(0.0, 1.0, 9)
    points = path.points(s)
    np.testing.assert_array_equal(points.s, s)
    for order, values in enumerate((points.X, points.dX, points.ddX)):
        np.testing.assert_array_equal(values, path(s, order))
    np.testing.assert_allclose(np.einsum("nvm,nm->nv", points.T, path.spline(s, 1)), points.dX, rtol=0, atol=1e-14)


def test_the_ends_are_those_of_the_problem() -> None:
    for task in TASKS:
        problem, path = problem_of(task), plan_of(task).path
        # solved again to 1e-12 of the residual, amplified at most by 1 / margin, some 20
        np.testing.assert_allclose(path(0.0), problem.start_configuration.X, rtol=0, atol=1e-10)
        np.testing.assert_allclose(path(1.0), problem.goal_configuration.X, rtol=0, atol=1e-10)


@pytest.mark.parametrize("s", [-1e-6, 1.0 + 1e-6, float("nan"), float("inf"), [0.5, 2.0], [0.5, float("nan")]])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_parameters_out_of_range_are_refused(s: float, order: int) -> None:
    with pytest.raises(po.DefinitionError, match=r"path parameter .*must be in \[0, 1\]"):
        plan_of("free").path(s, order)


def test_parameters_off_by_round_off_are_accepted() -> None:
    path = plan_of("free").path
    np.testing.assert_array_equal(path(np.array([-1e-12, 1.0 + 1e-12])), path(np.array([0.0, 1.0])))


@pytest.mark.parametrize("order", [3, -1, 1.5, "first"])
def test_other_orders_are_refused(order: int) -> None:
    with pytest.raises(po.DefinitionError, match=r"order is .*0, 1 or 2"):
        plan_of("free").path(0.5, order)


def test_the_length_is_measured_in_the_metric() -> None:
    path = plan_of("free").path
    # a straight line of 0.12 m along x, but for a micrometre
    assert path.length(np.ones(3)) == pytest.approx(0.12, rel=1e-9)
    assert path.length(np.array([2.0, 1.0, 1.0])) == pytest.approx(0.24, rel=1e-9)
    # across y and z it goes nowhere, but for what the barriers move
    assert path.length(np.array([0.0, 1.0, 1.0])) < 1e-6


# --- Following a spline


def _line(first: list[float], last: list[float]) -> BSpline:
    return BSpline(np.array([0.0, 0.0, 1.0, 1.0]), np.array([first, last]), 1)


def test_a_spline_is_followed_from_a_configuration() -> None:
    start = problem_of("free").start_configuration
    path = po.Path.along(raf_robot(), ("x", "y", "z"), _line([-0.06, 0.0, 0.48], [0.06, 0.0, 0.48]), start.X)
    s = np.linspace(0.0, 1.0, 33)
    assert np.max(raf_robot().kinematics.scaled_residual(path(s))) <= 1e-12
    np.testing.assert_allclose(path(1.0), problem_of("free").goal_configuration.X, rtol=0, atol=1e-10)
    np.testing.assert_allclose(path(s, 2)[:, -3:], 0.0, rtol=0, atol=1e-12)  # the platform runs evenly
    assert np.max(np.abs(path(s, 2))) > 1e-3  # the joints do not


def test_a_spline_that_leaves_the_reach_is_refused_with_the_place() -> None:
    start = problem_of("free").start_configuration
    with pytest.raises(po.SolveError, match=r"closures of 'RAF' fail on the path at s = 0\.\d+") as caught:
        po.Path.along(raf_robot(), ("x", "y", "z"), _line([-0.06, 0.0, 0.48], [-0.06, 0.0, 1.0]), start.X)
    # the passive chains end below z = 0.676 m (models.md, 3): at s < (0.676 - 0.48) / 0.52
    assert 0.1 < caught.value.evidence["s"] < 0.40
