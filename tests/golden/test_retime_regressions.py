"""Inputs on which other retimers were reported to fail: each is timed within its limits, or refused with its cause.

The threads: toppra 13, 14, 15, 17, 21, 26, 44, 56, 104, 183, 226 (round-off in programs of two variables, nearly equal
inputs, path velocity that goes to zero, excess between grid points, failures without a word); moveit2 2600, 3778
(acceleration above its limit); drake 20619 (smooth spline, dense grid); ruckig 19, 27, 90, 201 (units far from one).
Numbers are those of the threads where they print them, in three axes instead of six or seven.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import paraopt as po
from gantry import controlled, gantry, limits, line, problem, through, worst_share
from paraopt.planning import Retimer

RETIMERS: tuple[Retimer, ...] = (po.TimeOptimal(), po.JerkLimited())
each_retimer = pytest.mark.parametrize("retimer", RETIMERS, ids=lambda r: type(r).__name__)
RANDOM = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3))


def timed(path: po.Path, bounds: po.Limits, retimer: Retimer) -> po.Trajectory:
    asked = problem(path, bounds)
    trajectory = retimer.retime(asked, path)
    assert worst_share(asked, trajectory, retimer.bounds_jerk) <= 1.001
    assert np.isfinite(trajectory.duration)
    assert trajectory.duration > 0.0
    return trajectory


# --- Nearly equal inputs, and motions of next to no length


NEAR: dict[str, tuple[Any, Any]] = {
    # toppra 14, 21: there and back by 1e-8
    "there and back": ([[0, 0, 0], [1e-8, 0, 0], [0, 0, 0]], limits(10.0, 4.0, 100.0)),
    # toppra 17: two points almost in one place
    "almost in place": (
        [[-9.089468271438139e-07, -0.46400441351211447, -0.5760014655483718], [0.0, -0.464, -0.576]],
        limits(3.0, 4.0, 50.0),
    ),
    # toppra 15: always 0.2 s, whatever the limits
    "gripper": ([[-0.2, 0.2, -0.2], [-0.200001, 0.200001, -0.2], [-0.2, 0.2, -0.2]], limits(3.0, 4.0, 50.0)),
}


@each_retimer
@pytest.mark.parametrize("name", NEAR)
def test_motions_of_next_to_no_length(retimer: Retimer, name: str) -> None:
    waypoints, bounds = NEAR[name]
    path = through(waypoints)
    trajectory = timed(path, bounds, retimer)
    # no bound of a solver shows: at most twice the time from rest to rest over the way, with both limits' closed forms
    way = float(np.max(np.sum(np.abs(np.diff(path(np.linspace(0, 1, 201))[:, :3], axis=0)), axis=0)))
    least = 4.0 * (way / 100.0) ** (1.0 / 3.0) if retimer.bounds_jerk else 2.0 * np.sqrt(way / 4.0)
    assert trajectory.duration <= 2.0 * least


@each_retimer
def test_nearly_equal_inputs_give_nearly_equal_times(retimer: Retimer) -> None:
    """toppra 14: `allclose` waypoints, of which one set was timed and the other was not."""
    bounds = limits(1.0, 1.0, 5.0)
    first = timed(through(RANDOM), bounds, retimer)
    for seed in range(5):
        noise = np.random.default_rng(seed).uniform(-1e-9, 1e-9, RANDOM.shape)
        assert timed(through(RANDOM + noise), bounds, retimer).duration == pytest.approx(first.duration, rel=1e-4)


# --- Path velocity that goes to zero


@each_retimer
def test_a_path_that_nearly_stops_is_timed(retimer: Retimer) -> None:
    """toppra 44: high limits, a short step between long ones, and the path velocity went to zero."""
    waypoints = [[0, 0, 0], [0.2, 0.1, 0], [0.4, 0.1, 0.1], [0.41, 0.1, 0.1], [0.2, 0, 0.1], [0, 0, 0]]
    trajectory = timed(through(waypoints), limits(4 * np.pi, 100 * np.pi, 1e5), retimer)
    inner = np.linspace(0.02, 0.98, 501) * trajectory.duration
    assert np.min(trajectory.law(inner, 1)) > 0.0


@each_retimer
def test_one_axis_that_turns_back_is_timed(retimer: Retimer) -> None:
    """moveit2 2600, 3778: at the turning point the acceleration rose to a thousand times its limit."""
    x = np.array([0.0, 0.3, 0.6, 0.8, 0.9, 0.9, 0.8, 0.6, 0.3, 0.0])
    trajectory = timed(through(np.column_stack([x, np.zeros(10)])), limits(0.2, 0.2, 2.0, axes=2), retimer)
    # there and back over some 0.9 m at 0.2 m/s
    assert trajectory.duration < 15.0


@each_retimer
@pytest.mark.parametrize("repeated", [3, 4, 7])
def test_repeated_control_points_are_refused(retimer: Retimer, repeated: int) -> None:
    points = [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], *[[0.3, 0, 0]] * repeated, [0.3, 0.1, 0], [0.3, 0.2, 0]]
    path = controlled(points)
    with pytest.raises(po.RetimeError, match=r"stands still at s = 0\.\d+.*(cusp|repeated points)") as caught:
        retimer.retime(problem(path, limits()), path)
    still = np.max(np.abs(path(caught.value.evidence["s"], 1)))
    assert still < 1e-9


@each_retimer
def test_duplicated_waypoints_are_timed(retimer: Retimer) -> None:
    """toppra 104: a spline through the same waypoint twice swings to and fro, but moves on."""
    timed(through([[0, 0, 0], [0.3, 0.1, 0], [0.3, 0.1, 0], [0.6, 0, 0.2]]), limits(1.0, 1.0, 10.0), retimer)


@each_retimer
def test_ends_where_the_parameter_stands_still_are_timed(retimer: Retimer) -> None:
    """toppra 104: repeated points at the ends give zero derivatives there."""
    points = [*[[0, 0, 0]] * 3, [0.2, 0.1, 0], *[[0.3, 0.2, 0]] * 3]
    timed(controlled(points), limits(1.0, 1.0, 10.0), retimer)


@each_retimer
def test_a_path_of_no_length_is_refused(retimer: Retimer) -> None:
    path = controlled([[0.1, 0.2, 0.3]] * 6)
    with pytest.raises(po.RetimeError, match="zero length"):
        retimer.retime(problem(path, limits()), path)


# --- Dense grids


@pytest.mark.parametrize("n_grid", [50, 400, 3000])
def test_a_smooth_spline_is_timed_on_any_grid(n_grid: int) -> None:
    """drake 20619, toppra 13, 183: a smooth spline through many points failed on dense grids."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    waypoints = np.column_stack([np.cos(turn), np.sin(2.0 * turn), 0.1 * np.sin(7.0 * turn)])
    trajectory = timed(through(waypoints), limits(1.0, 1.0), po.TimeOptimal(n_grid=n_grid))
    # a grid of 3000 intervals is as good as any; a coarse one costs up to two percent
    assert trajectory.duration == pytest.approx(13.90, rel=0.02)


@pytest.mark.parametrize("n_grid", [9, 17, 40, 101])
def test_limits_hold_between_grid_points_of_a_coarse_grid(n_grid: int) -> None:
    """toppra 56: 28 % above the acceleration limit between the points of the grid."""
    waypoints = np.random.default_rng(3).uniform(-1.0, 1.0, (12, 3))
    timed(through(waypoints), limits(0.87, 0.8), po.TimeOptimal(n_grid=n_grid))


# --- Units far from one


@each_retimer
@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
def test_units_of_length_do_not_matter(retimer: Retimer, unit: float) -> None:
    """The same motion in micrometres and in megametres takes the same time."""
    first = timed(through(RANDOM), limits(1.0, 1.0, 5.0), retimer).duration
    again = timed(through(unit * RANDOM), limits(unit, unit, 5.0 * unit), retimer).duration
    assert again == pytest.approx(first, rel=1e-4)


@each_retimer
@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1e3, 1e6])
def test_one_limit_far_from_the_others(retimer: Retimer, quantity: str, factor: float) -> None:
    values = {"velocity": 1.0, "acceleration": 1.0, "jerk": 5.0}
    values[quantity] *= factor
    timed(through(RANDOM), limits(**values), retimer)


@each_retimer
def test_axes_of_very_different_limits(retimer: Retimer) -> None:
    """ruckig 90: one axis is limited to 2.8e-8, and its way is shorter still."""
    waypoints = np.column_stack([[0.0, 0.1, 0.19], [0.82, 0.75, 0.70], [0.0, 1e-9, 2e-9]])
    bounds = limits([2.66, 1.56, 2.8e-8], [49.4, 41.4, 133.6], [772.5, 647.3, 2087.9])
    timed(through(waypoints), bounds, retimer)


# --- Point to point


LONG: dict[str, tuple[Any, Any, float]] = {
    # ruckig 27: fast axes in millimetres; all phases: d / v + v / a + a / j
    "millimetres": ([900.0, 0.0, 0.0], (2000.0, 18000.0, 190000.0), 900 / 2000 + 2000 / 18000 + 18000 / 190000),
    # ruckig 201: more than 7600 s with limits of one gave zeros
    "far": ([1e6, 1e6, 0.0], (1.0, 1.0, 1.0), 1e6 + 2.0),
    # ruckig 19: targets quite close to where the axes are; only the jerk counts: 4 (d / 2 j)^(1/3)
    "near": ([-0.00349, 0.00387, -0.0031], (1.0, 4.0, 40.0), 4.0 * (0.00387 / 80.0) ** (1.0 / 3.0)),
    "very near": ([1e-12, 2e-12, 0.0], (1.0, 4.0, 40.0), 4.0 * (2e-12 / 80.0) ** (1.0 / 3.0)),
}


@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize("name", LONG)
def test_point_to_point_moves_in_any_units(name: str, straight: bool) -> None:
    goal, (v, a, j), expected = LONG[name]
    size = 10.0 ** max(0.0, float(np.ceil(np.log10(np.max(np.abs(goal))))))
    robot = gantry(3, size)
    asked = po.Problem(
        po.Scene(robot), dict.fromkeys("xyz", 0.0), dict(zip("xyz", goal, strict=True)), limits=limits(v, a, j)
    )
    trajectory = po.JointMove(straight=straight).move(asked)
    assert worst_share(asked, trajectory) <= 1.001
    # limits that would be reached within next to no time are lowered, for ruckig's digits: it costs 0.2 % at most
    assert trajectory.duration == pytest.approx(expected, rel=3e-3)
    np.testing.assert_allclose(trajectory(trajectory.duration)[3:], goal, rtol=1e-9, atol=1e-15)


@each_retimer
def test_a_straight_line_takes_the_time_of_its_closed_form(retimer: Retimer) -> None:
    """Along a line of 1 m: d/v + v/a = 1.5 s without jerk limits, and a/j = 0.1 s more with them."""
    duration = timed(line((1.0, 0.5, 0.2)), limits(1.0, 2.0, 20.0), retimer).duration
    assert duration == pytest.approx(1.6 if retimer.bounds_jerk else 1.5, rel=1.5e-3)
