"""The contract of the family of retimers, then what each promises on its own."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.interpolate import BSpline

import paraopt as po
from motions import ACCELERATION, JERK, TASKS, VELOCITY, plan_of, problem_of, raf_problem, turning_problem
from paraopt.planning import Retimer, State
from paraopt.planning.retime_base import choose_times

RETIMERS: tuple[Retimer, ...] = (po.TimeOptimal(), po.JerkLimited())
JACKS = ("q1", "q2", "q3")
PROBLEMS = (*TASKS, "3-RPR")

each_retimer = pytest.mark.parametrize("retimer", RETIMERS, ids=lambda r: type(r).__name__)
each_problem = pytest.mark.parametrize("name", PROBLEMS)


@functools.cache
def _problem(name: str) -> po.Problem:
    return turning_problem(True) if name == "3-RPR" else problem_of(name)


@functools.cache
def _path(name: str) -> po.Path:
    if name != "3-RPR":
        return plan_of(name).path
    return po.SplineRefiner().refine(_problem(name), po.MixedSearch().seed(_problem(name))).path


@functools.cache
def _timed(retimer: Retimer, name: str) -> po.Trajectory:
    return retimer.retime(_problem(name), _path(name))


@functools.cache
def _state(retimer: Retimer, name: str) -> State:
    """Look ten times denser than the retimer did, whose own check is ten times denser than its grid."""
    trajectory = _timed(retimer, name)
    return trajectory.state(np.linspace(0.0, trajectory.duration, 10 * 10 * trajectory.n_grid + 11))


# --- The contract


@each_retimer
@each_problem
def test_a_timed_path_runs_from_rest_to_rest(retimer: Retimer, name: str) -> None:
    trajectory = _timed(retimer, name)
    law = trajectory.law
    assert trajectory.path is _path(name)
    assert trajectory.method
    assert trajectory.n_grid > 0
    assert law(0.0) == 0.0
    # pieces follow one another by sums: round-off of some hundred of them
    assert law(law.duration) == pytest.approx(1.0, abs=1e-12)
    fastest = float(np.max(law(np.linspace(0, law.duration, 1001), 1)))
    assert abs(law(0.0, 1)) < 1e-9 * fastest
    assert abs(law(law.duration, 1)) < 1e-6 * fastest
    # it never turns back
    assert np.all(np.diff(law(_state(retimer, name).t)) >= 0.0)
    assert np.all(np.diff(law.breaks) > 0.0)


@each_retimer
@each_problem
def test_position_and_speed_are_continuous(retimer: Retimer, name: str) -> None:
    law = _timed(retimer, name).law
    inner, gap = law.breaks[1:-1], 1e-9 * law.duration
    top = [float(np.max(np.abs(law(np.linspace(0, law.duration, 4001), k)))) for k in (1, 2)]
    # over twice the gap the next derivative moves them by no more than this, and rounding adds 1e-12
    assert np.all(np.abs(law(inner + gap) - law(inner - gap)) <= 2.1 * gap * top[0] + 1e-12)
    assert np.all(np.abs(law(inner + gap, 1) - law(inner - gap, 1)) <= 2.1 * gap * top[1] + 1e-9 * top[0])


@each_retimer
@each_problem
def test_limits_hold_ten_times_denser(retimer: Retimer, name: str) -> None:
    state, problem = _state(retimer, name), _problem(name)
    drives, step = problem.robot.mechanism.active, float(state.t[1])
    for quantity, stated, integral in (
        ("velocity", state.velocity, state.X),
        ("acceleration", state.acceleration, state.velocity),
    ):
        limit = problem.bounds.of(quantity, drives)
        # never above the limit by more than 0.1 %, as stated and as measured: a mean cannot exceed the largest value
        for values in (stated, np.diff(integral, axis=0) / step):
            assert np.max(np.abs(values[:, : len(drives)]) / limit) <= 1.001


@each_retimer
@each_problem
def test_some_limit_is_reached(retimer: Retimer, name: str) -> None:
    """A time law that leaves all drives slack could be run faster."""
    state, problem = _state(retimer, name), _problem(name)
    drives = problem.robot.mechanism.active
    jerk = np.diff(state.acceleration, axis=0) / float(state.t[1]) if retimer.bounds_jerk else np.zeros((1, 3))
    used = [
        np.max(np.abs(values[:, :3]) / problem.bounds.of(quantity, drives))
        for quantity, values in (("velocity", state.velocity), ("acceleration", state.acceleration), ("jerk", jerk))
    ]
    assert max(used) >= 0.995


@each_retimer
@each_problem
def test_no_drive_can_be_faster_than_its_own_bounds(retimer: Retimer, name: str) -> None:
    """From rest to rest over a distance d: at least 2 sqrt(d / a), and at least d / v."""
    trajectory, problem = _timed(retimer, name), _problem(name)
    drives = problem.robot.mechanism.active
    q = trajectory.path(np.linspace(0.0, 1.0, 401))[:, :3]
    distance = np.ptp(q, axis=0)
    bounds = problem.bounds
    assert trajectory.duration >= float(np.max(distance / bounds.of("velocity", drives)))
    assert trajectory.duration >= float(np.max(2.0 * np.sqrt(distance / bounds.of("acceleration", drives)))) * 0.9995


@each_retimer
@each_problem
def test_the_certificate_agrees(retimer: Retimer, name: str) -> None:
    trajectory = _timed(retimer, name)
    certificate = po.verify(_problem(name), trajectory, at_least=10 * trajectory.n_grid, check_jerk=retimer.bounds_jerk)
    assert certificate.passed, str(certificate)


@each_retimer
def test_the_same_path_gives_the_same_law(retimer: Retimer) -> None:
    again, first = retimer.retime(problem_of("box"), plan_of("box").path), _timed(retimer, "box")
    np.testing.assert_array_equal(again.law.breaks, first.law.breaks)
    np.testing.assert_array_equal(again.law.coefficients, first.law.coefficients)


@each_retimer
@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_a_missing_limit_is_named(retimer: Retimer, quantity: str) -> None:
    values = {"velocity": VELOCITY, "acceleration": ACCELERATION, "jerk": JERK}
    stated = {q: dict.fromkeys(JACKS, value) for q, value in values.items()}
    del stated[quantity]["q2"]
    with pytest.raises(po.DefinitionError, match=rf"actuators \['q2'\] have no {quantity} limit.*Limits\({quantity}="):
        retimer.retime(raf_problem(limits=po.Limits(**stated)), plan_of("free").path)


@each_retimer
def test_a_path_of_no_length_is_refused(retimer: Retimer) -> None:
    problem = problem_of("free")
    here = problem.start_configuration.X[-3:]
    spline = BSpline(np.array([0.0] * 4 + [1.0] * 4), np.tile(here, (4, 1)), 3)
    path = po.Path.along(problem.robot, problem.independent, spline, problem.start_configuration.X, count=8)
    with pytest.raises(po.RetimeError, match="path of zero length cannot be timed") as caught:
        retimer.retime(problem, path)
    assert caught.value.evidence["path"] is path


@each_retimer
@pytest.mark.parametrize("name", ["cylinder", "box"])
def test_limits_hold_at_the_knots_of_the_path(retimer: Retimer, name: str) -> None:
    """There the second derivative of the path has its corners, and an acceleration may have its peak."""
    trajectory, problem = _timed(retimer, name), _problem(name)
    knots = np.unique(trajectory.path.spline.t)
    times = choose_times(trajectory.path, trajectory.law, 50)
    assert np.max(np.min(np.abs(trajectory.law(times)[:, None] - knots), axis=0)) < 1e-12
    assert set(trajectory.law.breaks) <= set(times)
    acceleration = np.abs(trajectory(trajectory.law.time_at(knots), 2)[:, :3])
    assert np.max(acceleration / problem.bounds.of("acceleration", JACKS)) <= 1.0


@each_retimer
def test_slower_drives_take_longer(retimer: Retimer) -> None:
    # speeds by k, accelerations by k^2, jerks by k^3: the same law in k times the time
    slow = po.Limits(
        velocity=dict.fromkeys(JACKS, VELOCITY / 2),
        acceleration=dict.fromkeys(JACKS, ACCELERATION / 4),
        jerk=dict.fromkeys(JACKS, JERK / 8),
    )
    trajectory = retimer.retime(raf_problem("box", limits=slow), plan_of("box").path)
    # the solvers' own tolerances are absolute
    assert trajectory.duration == pytest.approx(2.0 * _timed(retimer, "box").duration, rel=1e-3)


# --- Time-optimal


@each_problem
def test_the_time_optimal_law_is_always_at_some_limit(name: str) -> None:
    """Between switching points one drive runs at a limit of its velocity or its acceleration."""
    trajectory, problem = _timed(po.TimeOptimal(), name), _problem(name)
    drives = problem.robot.mechanism.active
    state = trajectory.state(np.linspace(0.0, trajectory.duration, 2001))
    share = np.maximum(
        np.max(np.abs(state.velocity[:, :3]) / problem.bounds.of("velocity", drives), axis=1),
        np.max(np.abs(state.acceleration[:, :3]) / problem.bounds.of("acceleration", drives), axis=1),
    )
    # on the grid's intervals the acceleration of s is constant, so limits are reached at one of their ends
    assert np.median(share) > 0.98
    assert np.mean(share > 0.9) > 0.9


@each_problem
def test_limiting_the_jerk_costs_time(name: str) -> None:
    assert _timed(po.JerkLimited(), name).duration > _timed(po.TimeOptimal(), name).duration


def test_a_finer_grid_does_not_change_the_time_much() -> None:
    coarse, fine = (po.TimeOptimal(n_grid=n).retime(problem_of("box"), plan_of("box").path) for n in (100, 800))
    assert fine.n_grid >= 800
    assert fine.duration == pytest.approx(coarse.duration, rel=0.01)


def _cusp(problem: po.Problem) -> po.Path:
    """Stop in the middle: four control points in one place, where the first two derivatives vanish."""
    points = np.array([[-0.06, 0.0, 0.48], [-0.04, 0.0, 0.48], [-0.02, 0.0, 0.48], *[[0.0, 0.0, 0.48]] * 4,
                       [0.0, 0.02, 0.48], [0.0, 0.04, 0.48], [0.0, 0.06, 0.48]])  # fmt: skip
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, len(points) - 2), np.ones(3)])
    spline = BSpline(knots, points, 3)
    return po.Path.along(problem.robot, problem.independent, spline, problem.start_configuration.X)


def test_a_cusp_is_refused() -> None:
    """Where a path turns a corner with repeated points, no finite speed of the parameter follows it."""
    path = _cusp(problem_of("free"))
    with pytest.raises(po.RetimeError) as caught:
        po.TimeOptimal().retime(problem_of("free"), path)
    assert caught.value.evidence["path"] is path


def test_a_cusp_is_named() -> None:
    with pytest.raises(po.RetimeError, match=r"at s = 0\.[45].*(cusp|repeated points)"):
        po.TimeOptimal().retime(problem_of("free"), _cusp(problem_of("free")))


@pytest.mark.parametrize("n_grid", [3, 0, -1])
def test_a_grid_too_coarse_is_refused(n_grid: int) -> None:
    with pytest.raises(po.DefinitionError, match=f"n_grid is {n_grid}"):
        po.TimeOptimal(n_grid=n_grid)


# --- Jerk-limited


@each_problem
def test_the_jerk_stays_below_its_limit(name: str) -> None:
    state, problem = _state(po.JerkLimited(), name), _problem(name)
    step, steps = float(state.t[1]), np.diff(state.acceleration[:, :3], axis=0)
    limit = problem.bounds.of("jerk", problem.robot.mechanism.active)
    # a mean over an interval cannot exceed the largest jerk in it
    assert np.max(np.abs(steps) / limit) / step <= 1.001


@each_problem
def test_the_time_optimal_law_jerks(name: str) -> None:
    """The check above can fail: without the jerk limit it does."""
    state, problem = _state(po.TimeOptimal(), name), _problem(name)
    step, steps = float(state.t[1]), np.diff(state.acceleration[:, :3], axis=0)
    assert np.max(np.abs(steps) / problem.bounds.of("jerk", problem.robot.mechanism.active)) / step > 2.0


def test_a_missing_jerk_limit_is_named() -> None:
    limits = po.Limits(
        velocity=dict.fromkeys(JACKS, VELOCITY),
        acceleration=dict.fromkeys(JACKS, ACCELERATION),
        jerk={"q1": JERK, "q3": JERK},
    )
    with pytest.raises(po.DefinitionError, match=r"actuators \['q2'\] have no jerk limit"):
        po.JerkLimited().retime(raf_problem(limits=limits), plan_of("free").path)
    # without jerk limits the other retimer has all it needs
    assert po.TimeOptimal().retime(raf_problem(limits=limits), plan_of("free").path).duration > 0.0


@pytest.mark.parametrize("options", [{"n_grid": 7}, {"candidates": 0}])
def test_faulty_options_are_refused(options: dict[str, int]) -> None:
    with pytest.raises(po.DefinitionError, match="at least 8 and 1 are needed"):
        po.JerkLimited(**options)
