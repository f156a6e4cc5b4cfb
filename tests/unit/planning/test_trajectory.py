"""Trajectories: a path in time, asked at any instant."""

from __future__ import annotations

import numpy as np
import pytest

import paraopt as po
from motions import jerk_limited_of, plan_of
from support import finite_difference

TRAJECTORIES = {
    "time-optimal": lambda: plan_of("cylinder").trajectory,
    "jerk-limited": lambda: jerk_limited_of("box"),
}
over_methods = pytest.mark.parametrize("name", TRAJECTORIES)


def _between_breaks(trajectory: po.Trajectory, count: int = 12) -> np.ndarray:
    """Give instants away from those where the law's pieces meet and the path passes a knot."""
    t = np.random.default_rng(6).uniform(0.01, 0.99, 8 * count) * trajectory.duration
    corners = trajectory.law.breaks
    fine = np.linspace(0.0, trajectory.duration, 20001)
    knots = np.interp(np.unique(trajectory.path.spline.t), trajectory.law(fine), fine)
    away = [np.min(np.abs(t[:, None] - c), axis=1) > 4e-4 for c in (corners, knots)]
    chosen = t[away[0] & away[1]][:count]
    assert len(chosen) >= count // 2
    return chosen


@over_methods
def test_velocities_and_accelerations_are_derivatives(name: str) -> None:
    trajectory = TRAJECTORIES[name]()
    scale = trajectory.robot.kinematics.graph.variable_scale
    for t in _between_breaks(trajectory):
        for order in (0, 1):
            measured = finite_difference(lambda p, o=order: trajectory(float(p[0]), o) / scale, [t], 1e-4)[:, 0]
            # values are solved to some 1e-13 of their scale: over 1e-4 s that is 1e-9; the rest is truncation
            np.testing.assert_allclose(trajectory(float(t), order + 1) / scale, measured, rtol=0, atol=1e-6)


@over_methods
def test_a_state_holds_all_three(name: str) -> None:
    trajectory = TRAJECTORIES[name]()
    t = np.linspace(0.0, trajectory.duration, 23)
    state = trajectory.state(t)
    for order, values in enumerate((state.X, state.velocity, state.acceleration)):
        np.testing.assert_array_equal(values, trajectory(t, order))
    single = trajectory.state(float(t[7]))
    assert single.X.shape == single.velocity.shape == single.acceleration.shape == state.X.shape[1:]
    # alone or among others, the same up to the solve
    np.testing.assert_allclose(single.X, state.X[7], rtol=0, atol=1e-10)


@over_methods
def test_it_starts_and_ends_at_rest(name: str) -> None:
    trajectory = TRAJECTORIES[name]()
    for t in (0.0, trajectory.duration):
        # s' is a difference of equal numbers there
        assert np.max(np.abs(trajectory(t, 1))) < 1e-9
    assert np.max(np.abs(trajectory(0.5 * trajectory.duration, 1))) > 0.01


def test_shapes_follow_the_time() -> None:
    trajectory = plan_of("free").trajectory
    n = len(trajectory.robot.mechanism.names)
    for order in (0, 1, 2):
        assert trajectory(0.1, order).shape == (n,)
        assert trajectory([0.1], order).shape == (1, n)
        assert trajectory(np.array([0.1, 0.2, 0.3]), order).shape == (3, n)


@pytest.mark.parametrize("t", [-1e-3, 1e3, float("nan"), float("-inf"), [0.1, 1e3]])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_times_out_of_range_are_refused(t: float, order: int) -> None:
    with pytest.raises(po.DefinitionError, match=r"time is in .* s; it must be in \[0, 0\.\d+\] s"):
        plan_of("free").trajectory(t, order)


def test_times_off_by_round_off_are_accepted() -> None:
    trajectory = plan_of("free").trajectory
    late = np.nextafter(trajectory.duration, 2.0)
    np.testing.assert_array_equal(trajectory(late), trajectory(trajectory.duration))


@pytest.mark.parametrize("order", [3, -1, 0.5, None])
def test_other_orders_are_refused(order: int) -> None:
    with pytest.raises(po.DefinitionError, match=r"order is .*0, 1 or 2"):
        plan_of("free").trajectory(0.1, order)


@pytest.mark.parametrize("period", [1e-3, 0.01, 0.1, 0.4, 5.0])
def test_samples_come_at_the_period_with_the_end(period: float) -> None:
    trajectory = plan_of("cylinder").trajectory
    t = trajectory.sample(period).t
    assert t[0] == 0.0
    assert t[-1] == trajectory.duration
    steps = np.diff(t)
    # multiples of the period: one rounding each; the last step may be shorter
    np.testing.assert_allclose(steps[:-1], period, rtol=0, atol=1e-14)
    assert 0.0 < steps[-1] <= period * (1.0 + 1e-12)


def test_a_period_that_divides_the_duration_gives_no_sliver() -> None:
    trajectory = plan_of("cylinder").trajectory
    t = trajectory.sample(trajectory.duration / 7.0).t
    assert len(t) == 8
    np.testing.assert_allclose(np.diff(t), trajectory.duration / 7.0, rtol=1e-12)


@pytest.mark.parametrize("period", [0.0, -1e-3, float("nan"), float("inf")])
def test_faulty_periods_are_refused(period: float) -> None:
    with pytest.raises(po.DefinitionError, match="sampling period is"):
        plan_of("free").trajectory.sample(period)


def test_values_by_name() -> None:
    trajectory = plan_of("free").trajectory
    values = trajectory.at(trajectory.duration)
    assert set(values) == set(trajectory.robot.mechanism.names)
    # the goal, up to the end of the law, which is 1 up to round-off
    assert values["x"] == pytest.approx(0.06, abs=1e-12)
    assert all(type(value) is float for value in values.values())
