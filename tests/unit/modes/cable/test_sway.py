"""What of inertia no tensions balance: measured against the laws of motion, bounded along a path by rows."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import paraopt as po
from cable_robots import draw_poses, hanging, ipanema
from paraopt.errors import DefinitionError
from paraopt.modes.cable import SwayLimits, TensionLimits, cable_functions, measure_sway, read_hanging
from paraopt.modes.cable.sway import unbalanced_part


@functools.cache
def task() -> tuple[po.Problem, po.Path]:
    robot = po.robots.larm_hanging(acceleration=5.0)
    start = {"x": 0.3, "y": 0.4, "z": -0.7, "gamma": 0.0}
    goal = {"x": 0.65, "y": 0.6, "z": -0.5, "gamma": 0.3}
    problem = po.Problem(po.Scene(robot), start, goal, po.Margins(clearance=0.001, singularity=0.01))
    return problem, po.plan(problem).path


def test_the_unbalanced_part_is_what_least_squares_leave() -> None:
    robot = hanging()
    poses = draw_poses(robot, 20, seed=1)
    poses[:, 2] = -0.5
    wrench = np.random.default_rng(2).normal(size=(20, 6))
    scale = np.array([1, 1, 1, *[1 / robot.length_scale] * 3])
    for pose, w, part in zip(poses, wrench, unbalanced_part(robot, poses, wrench), strict=True):
        A = scale[:, None] * cable_functions(robot).wrench_matrix(pose)[0]
        assert part == pytest.approx(scale * w + A @ np.linalg.lstsq(A, -scale * w, rcond=None)[0], abs=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.05, 0.02])
def test_a_timed_motion_sways_no_more_than_is_allowed(share: float) -> None:
    problem, path = task()
    robot = read_hanging(problem.robot)
    constraints = (TensionLimits(robot), SwayLimits(robot, share))
    assert np.max(measure_sway(robot, po.TimeOptimal(constraints=constraints[:1]).retime(problem, path))) > 0.12
    timed = po.TimeOptimal(constraints=constraints).retime(problem, path)
    largest = np.max(measure_sway(robot, timed, count=20001))
    # the polygon of 16 sides leaves out two parts in a hundred of the radius, and a retimer's rows two thousandths
    assert 0.95 * share <= largest <= share


def test_rows_are_the_size_of_what_is_unbalanced() -> None:
    """All sides together: the norm, up to the polygon, for any speed and acceleration."""
    problem, path = task()
    robot = read_hanging(problem.robot)
    points = path.points(np.linspace(0.0, 1.0, 50))
    rows = SwayLimits(robot, share=0.1, sides=64).rows(problem, points)
    assert rows.count == 64
    random = np.random.default_rng(3)
    speed, acceleration = random.uniform(0.0, 3.0, 50), random.normal(size=50) * 5.0
    places = problem.robot.mechanism.indices(robot.coordinates)
    X, dX, ddX = (v[:, places] for v in (points.X, points.dX, points.ddX))
    A = dX * acceleration[:, None] + ddX * speed[:, None] ** 2
    wrench = cable_functions(robot).dynamic_wrench(X, dX * speed[:, None], A)
    size = np.linalg.norm(unbalanced_part(robot, X, wrench), axis=1) / (0.1 * 9.81)
    found = np.max(rows(speed, acceleration), axis=1) + 1.0
    assert found == pytest.approx(size, rel=4e-3, abs=1e-6)
    assert np.ptp(size) > 1.0


def test_up_and_down_below_the_centre_nothing_sways() -> None:
    robot = po.robots.larm_hanging(acceleration=5.0)
    start = {"x": 0.5, "y": 0.5, "z": -0.8, "gamma": 0.0}
    problem = po.Problem(po.Scene(robot), start, start | {"z": -0.5}, po.Margins(clearance=0.001, singularity=0.01))
    held = read_hanging(robot)
    free = po.plan(problem)
    assert np.max(measure_sway(held, free.trajectory)) < 1e-6
    slow = po.TimeOptimal(constraints=(SwayLimits(held, 0.01),)).retime(problem, free.path)
    assert slow.duration == pytest.approx(free.trajectory.duration, rel=1e-3)


def test_arguments_are_checked() -> None:
    with pytest.raises(DefinitionError, match="does not sway"):
        SwayLimits(ipanema())
    with pytest.raises(DefinitionError, match="share of the weight is 0"):
        SwayLimits(hanging(), share=0.0)
    with pytest.raises(DefinitionError, match="sides is 3"):
        SwayLimits(hanging(), sides=3)
