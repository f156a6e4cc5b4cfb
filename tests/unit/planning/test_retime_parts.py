"""Paths with corners and jumps of curvature: the motion comes to rest there, and holds its limits between."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_interp_spline

import paraopt as po
from gantry import along, limits, problem, through, worst_share
from paraopt.planning import PathPoints, Retimer
from paraopt.planning.retime_base.parts import cut_path, find_stops

Array = np.ndarray
RETIMERS: tuple[Retimer, ...] = (po.TimeOptimal(), po.JerkLimited())
each_retimer = pytest.mark.parametrize("retimer", RETIMERS, ids=lambda r: type(r).__name__)
CORNERS = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0)])


def polyline(degree: int) -> po.Path:
    """Run straight from corner to corner with an even parameter, a third of it for each leg."""
    inner = np.repeat([1 / 3, 2 / 3], degree)
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    legs = [a + (b - a) * np.linspace(0.0, 1.0, degree + 1)[:, None] for a, b in pairwise(CORNERS)]
    points = np.vstack([legs[0], *[leg[1:] for leg in legs[1:]]])
    return along(BSpline(knots, points, degree))


def rounded() -> po.Path:
    """Run a line of 1 m, then a quarter of a circle of radius 1 m: direction and speed go on, the curvature jumps."""
    s = np.linspace(0.0, 1.0, 41)
    share = 1.0 / (1.0 + 0.5 * np.pi)
    angle = np.clip((s - share) / (1.0 - share), 0.0, 1.0) * 0.5 * np.pi
    points = np.column_stack([np.minimum(s / share, 1.0) + np.sin(angle), 1.0 - np.cos(angle), 0.0 * s])
    before, after = s < share, s > share
    corner = np.array([1.0, 0.0, 0.0])
    slope = np.array([1.0 / share, 0.0, 0.0])
    end = np.array([0.0, 1.0 / share, 0.0])
    first = make_interp_spline(np.append(s[before], share), np.vstack([points[before], corner]), 3)
    second = make_interp_spline(
        np.append(share, s[after]), np.vstack([corner, points[after]]), 3, bc_type=([(1, slope)], [(1, end)])
    )
    knots = np.concatenate([first.t[:-4], [share] * 3, second.t[4:]])
    return along(BSpline(knots, np.vstack([first.c, second.c[1:]]), 3))


@each_retimer
@pytest.mark.parametrize("degree", [1, 3])
def test_a_motion_stops_at_corners_and_holds_its_limits_between(retimer: Retimer, degree: int) -> None:
    path = polyline(degree)
    asked = problem(path, limits(1.0, 1.0, 20.0))
    trajectory = retimer.retime(asked, path)
    assert trajectory.path is path
    assert "2 stops at corners" in trajectory.method
    law, corners = trajectory.law, np.array([1 / 3, 2 / 3])
    at = law.time_at(corners)
    np.testing.assert_allclose(trajectory(at)[:, 3:], CORNERS[1:3], rtol=0, atol=1e-9)
    assert np.max(np.abs(trajectory(at, 1))) < 1e-6
    assert np.all(np.diff(law.breaks) > 0.0)
    assert law(law.duration) == pytest.approx(1.0, abs=1e-12)
    assert worst_share(asked, trajectory, retimer.bounds_jerk) <= 1.001
    # by differences of the positions alone: nothing jumps; beside a corner both sides are within the limit
    t = np.linspace(0.0, trajectory.duration, 40001)
    X, h = trajectory(t), t[1]
    assert np.max(np.abs(np.diff(X, axis=0))) / h <= 1.001
    assert np.max(np.abs(np.diff(X, 2, axis=0))) / h**2 <= 1.01
    # rest to rest over 1 m at 1 m/s^2: 2 s, three times
    if not retimer.bounds_jerk:
        assert trajectory.duration == pytest.approx(6.0, rel=2e-3)
    else:
        assert trajectory.without_jerk == pytest.approx(6.0, rel=2e-3)
        assert trajectory.gap is not None
        assert 1.0 < trajectory.gap < 1.1


def test_where_only_the_curvature_jumps_the_jerk_asks_for_a_stop() -> None:
    path = rounded()
    stop = 1.0 / (1.0 + 0.5 * np.pi)
    assert find_stops(path, 1).size == 0
    np.testing.assert_allclose(find_stops(path, 2), [stop], rtol=0, atol=1e-12)
    asked = problem(path, limits(1.0, 1.0, 20.0))
    passing = po.TimeOptimal().retime(asked, path)
    assert "stop" not in passing.method
    assert passing.law(passing.law.time_at(np.array([stop])), 1)[0] > 0.1
    assert worst_share(asked, passing) <= 1.001
    gentle = po.JerkLimited().retime(asked, path)
    assert "1 stop at corners" in gentle.method
    t = np.linspace(0.0, gentle.duration, 20001)
    third = np.diff(gentle(t), 3, axis=0) / t[1] ** 3
    # of positions good to 1e-15 over (0.3 ms)^3: noise of some 1e-4
    assert np.max(np.abs(third)) <= 20.0 * 1.02


def test_smooth_paths_have_no_stops_whatever_their_knots() -> None:
    smooth = through([(0, 0, 0), (0.4, 0.2, 0), (0.5, -0.1, 0.3), (1, 0, 0)])
    assert find_stops(smooth, 2).size == 0
    # the same curve with a knot that is there three times
    spline = smooth.spline
    for _ in range(2):
        spline = spline.insert_knot(spline.t[4])
    assert np.sum(spline.t == spline.t[4]) == 3
    assert find_stops(along(spline), 2).size == 0
    asked = problem(smooth, limits())
    plain, many = (po.TimeOptimal().retime(asked, path).duration for path in (smooth, along(spline)))
    assert many == pytest.approx(plain, rel=1e-3)


def test_a_part_of_a_path_is_that_part() -> None:
    whole = through([(0, 0, 0), (0.4, 0.2, 0), (0.5, -0.1, 0.3), (1, 0, 0)])
    low, high = 0.21, 0.83
    part = cut_path(whole, low, high)
    u = np.linspace(0.0, 1.0, 101)
    for order in (0, 1, 2):
        expected = whole(low + (high - low) * u, order) * (high - low) ** order
        np.testing.assert_allclose(part(u, order), expected, rtol=0, atol=1e-9)


@each_retimer
def test_stated_rows_see_the_parameter_of_the_whole_path(retimer: Retimer) -> None:
    """No more than 0.25 m/s on the second leg, as a bound of a function of the place on the path."""
    seen: list[Array] = []

    def slow(points: PathPoints) -> tuple[float, Array, float]:
        seen.append(points.s)
        second = (points.s > 1 / 3) & (points.s < 2 / 3)
        speed = np.max(np.abs(points.dX), axis=1)
        return 0.0, np.where(second, speed**2, 0.1 * speed**2), -(0.25**2)

    path = polyline(3)
    asked = problem(path, limits(1.0, 1.0, 20.0))
    bounded = type(retimer)(constraints=[po.RowConstraint("speed on the second leg", slow)])  # type: ignore[call-arg]
    trajectory = bounded.retime(asked, path)
    assert min(s.min() for s in seen) == 0.0
    assert max(s.max() for s in seen) == 1.0
    t = np.linspace(0.0, trajectory.duration, 5001)
    s, speed = trajectory.law(t), np.max(np.abs(trajectory(t, 1)), axis=1)
    second = (s > 1 / 3 + 1e-6) & (s < 2 / 3 - 1e-6)
    assert np.max(speed[second]) <= 0.2501
    assert np.max(speed[second]) > 0.24
    assert np.max(speed[~second]) > 0.6


def test_a_path_that_nearly_stands_still_between_grid_points_is_told_as_such() -> None:
    s = np.linspace(0.0, 1.0, 201)
    cubed = (s - 0.5013) ** 3 + 0.5013**3
    path = along(make_interp_spline(s, np.column_stack([cubed, 0.0 * s, 0.0 * s]), 3))
    with pytest.raises(po.RetimeError, match=r"all but stands still at s = 0\.50\d+.*cusp") as caught:
        po.TimeOptimal().retime(problem(path, limits(0.1, 0.5)), path)
    assert caught.value.evidence["s"] == pytest.approx(0.5013, abs=0.01)
