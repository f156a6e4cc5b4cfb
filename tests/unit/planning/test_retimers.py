"""The contract of the family of retimers, then what each promises on its own."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

import gantry
import paraopt as po
from motions import ACCELERATION, JERK, TASKS, VELOCITY, other_elbow, plan_of, problem_of, raf_problem, turning_problem
from paraopt.io import describe
from paraopt.planning import PathConstraint, PathPoints, Retimer, State
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


# --- Limits of passive joints and of the platform


def _with(name: str, **limits: object) -> po.Problem:
    """Give a problem with further limits."""
    bounds = _problem(name).bounds
    stated = {q: {**getattr(bounds, q)} for q in ("velocity", "acceleration", "jerk")}
    for quantity, values in limits.items():
        if quantity in stated:
            stated[quantity].update(values)  # type: ignore[call-overload]
    others = {q: v for q, v in limits.items() if q not in stated}
    return replace(_problem(name), limits=po.Limits(**stated, **others))  # type: ignore[arg-type]


def _platform(problem: po.Problem, trajectory: po.Trajectory, count: int) -> dict[str, np.ndarray]:
    """Measure the platform's motion by differences of poses alone."""
    t = np.linspace(0.0, trajectory.duration, count)
    step, links = float(t[1]), [link.name for link in problem.robot.mechanism.links]
    link, point = problem.robot.tool or ("platform", (0.0, 0.0, 0.0))
    poses = problem.robot.kinematics.poses(trajectory(t))[:, links.index(link)]
    place, turned = poses[:, :3, :3] @ np.asarray(point) + poses[:, :3, 3], poses[:, :3, :3]
    velocity = np.diff(place, axis=0) / step
    steps = Rotation.from_matrix(turned[1:] @ turned[:-1].transpose(0, 2, 1)).as_rotvec() / step
    return {
        "linear_velocity": velocity,
        "angular_velocity": steps,
        "linear_acceleration": np.diff(velocity, axis=0) / step,
        "angular_acceleration": np.diff(steps, axis=0) / step,
    }


@each_retimer
@pytest.mark.parametrize(
    ("name", "quantity"),
    [  # the RAF's platform does not turn
        ("cylinder", "linear_velocity"),
        ("cylinder", "linear_acceleration"),
        ("3-RPR", "linear_velocity"),
        ("3-RPR", "angular_velocity"),
        ("3-RPR", "linear_acceleration"),
        ("3-RPR", "angular_acceleration"),
    ],
)
def test_the_platform_keeps_its_limits(retimer: Retimer, name: str, quantity: str) -> None:
    free = _timed(retimer, name)
    largest = float(np.max(np.linalg.norm(_platform(_problem(name), free, 4001)[quantity], axis=1)))
    bound = 0.6 * largest
    problem = _with(name, **{quantity: bound})
    slower = retimer.retime(problem, _path(name))
    used = np.max(np.linalg.norm(_platform(problem, slower, 4001)[quantity], axis=1)) / bound
    # means over short times cannot exceed the limit, and the polygon in the disc gives half a percent away
    assert used <= 1.001
    assert used >= 0.97
    assert slower.duration > free.duration
    assert po.verify(problem, slower, check_jerk=retimer.bounds_jerk).passed
    # and a certificate of the motion without this limit fails on this line alone
    failures = po.verify(problem, free, check_jerk=retimer.bounds_jerk).failures
    assert [check.name for check in failures] == [quantity.replace("_", " ")]


@each_retimer
@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_passive_joints_keep_their_limits(retimer: Retimer, quantity: str) -> None:
    problem = _problem("3-RPR")
    passive = problem.robot.mechanism.passive[0]
    i = problem.robot.mechanism.index(passive)
    state = _state(retimer, "3-RPR")
    bound = 0.5 * float(np.max(np.abs(getattr(state, quantity)[:, i])))
    asked = _with("3-RPR", **{quantity: {passive: bound}})
    slower = retimer.retime(asked, _path("3-RPR"))
    again = slower.state(np.linspace(0.0, slower.duration, 20001))
    assert 0.97 <= np.max(np.abs(getattr(again, quantity)[:, i])) / bound <= 1.001
    assert slower.duration > _timed(retimer, "3-RPR").duration
    assert po.verify(asked, slower, check_jerk=retimer.bounds_jerk).passed


def test_a_passive_joint_keeps_its_jerk_limit() -> None:
    passive = _problem("3-RPR").robot.mechanism.passive[0]
    i = _problem("3-RPR").robot.mechanism.index(passive)
    state = _state(po.JerkLimited(), "3-RPR")
    step = float(state.t[1])
    bound = 0.3 * float(np.max(np.abs(np.diff(state.acceleration[:, i])))) / step
    slower = po.JerkLimited().retime(_with("3-RPR", jerk={passive: bound}), _path("3-RPR"))
    again = slower.state(np.linspace(0.0, slower.duration, len(state.t)))
    assert np.max(np.abs(np.diff(again.acceleration[:, i]))) / again.t[1] <= 1.001 * bound


# --- Further bounds, linear in the acceleration and the squared speed of the parameter


def test_a_stated_row_is_described_without_the_address_of_its_function() -> None:
    stated = po.RowConstraint("speed", lambda points: (0.0, points.dX[:, 0] ** 2, -0.25))
    assert repr(stated) == "RowConstraint(names='speed')"
    told = describe(po.TimeOptimal(constraints=[stated]))["constraints"][0]
    assert told["names"] == "speed"
    assert " at 0x" not in str(told)
    assert told["function"].endswith("<lambda>")


def _timed_line(constraint: PathConstraint, retimer: type[Retimer] = po.TimeOptimal) -> po.Trajectory:
    """Time a straight line of 1 m under loose limits of the drives."""
    path = gantry.line((1.0, 0.0, 0.0))
    asked = gantry.problem(path, gantry.limits(10.0, 10.0, 1000.0))
    return retimer(constraints=[constraint]).retime(asked, path)  # type: ignore[call-arg]


@pytest.mark.parametrize("retimer", [po.TimeOptimal, po.JerkLimited])
def test_a_stated_row_bounds_the_speed(retimer: type[Retimer]) -> None:
    slow = po.RowConstraint("speed", lambda points: (0.0, points.dX[:, 0] ** 2, -0.25))  # |dx/dt| <= 0.5 m/s
    trajectory = _timed_line(slow, retimer)
    state = trajectory.state(np.linspace(0.0, trajectory.duration, 3001))
    assert 0.495 <= np.max(state.velocity[:, 0]) <= 0.5
    assert trajectory.duration == pytest.approx(1.0 / 0.5 + 0.5 / 10.0, rel=0.01)


def test_stated_rows_bound_a_force() -> None:
    """A body of 2 kg with drag 3 N/(m/s)^2 and a drive of 4 N: from the equation of motion, 2 x'' + 3 x'^2 <= 4."""

    def force(points: PathPoints) -> tuple[np.ndarray, np.ndarray, float]:
        d, c = points.dX[:, 0], points.ddX[:, 0]
        return 2.0 * d, 2.0 * c + 3.0 * d**2, -4.0

    trajectory = _timed_line(po.RowConstraint("force of the drive", force))
    state = trajectory.state(np.linspace(0.0, trajectory.duration, 3001))
    used = 2.0 * state.acceleration[:, 0] + 3.0 * state.velocity[:, 0] ** 2
    assert 0.99 * 4.0 <= np.max(used) <= 4.0 * 1.001
    # it speeds up with the whole force: v' = 2 - 1.5 v^2
    early = state.t < 0.5 * trajectory.duration
    top = np.sqrt(4.0 / 3.0)
    np.testing.assert_allclose(state.velocity[early, 0], top * np.tanh(1.5 * top * state.t[early]), atol=0.02)


def test_a_row_that_no_speed_satisfies_is_named() -> None:
    def impossible(points: PathPoints) -> tuple[float, float, np.ndarray]:
        return 0.0, 0.0, np.where(np.abs(points.s - 0.5) < 0.1, 1.0, -1.0)

    with pytest.raises(po.RetimeError, match=r"'tension of cable 3' at s = 0\.[45]") as caught:
        _timed_line(po.RowConstraint("tension of cable 3", impossible))
    assert 0.39 < caught.value.evidence["s"] < 0.61
    assert caught.value.evidence["row"] == "tension of cable 3"


def test_a_row_that_cannot_hold_at_rest_is_named() -> None:
    always_moving = po.RowConstraint("least speed", lambda points: (0.0, -(points.dX[:, 0] ** 2), 0.01))
    with pytest.raises(po.RetimeError, match=r"'least speed' cannot hold at rest at the start"):
        _timed_line(always_moving)


def test_a_row_may_ask_for_speed_inside() -> None:
    """Between rest and rest a least speed is kept where it is asked for."""

    def least(points: PathPoints) -> tuple[float, np.ndarray, np.ndarray]:
        inside = np.abs(points.s - 0.5) < 0.2
        return 0.0, np.where(inside, -(points.dX[:, 0] ** 2), 0.0), np.where(inside, 0.25, -1.0)

    trajectory = _timed_line(po.RowConstraint("least speed", least))
    t = np.linspace(0.0, trajectory.duration, 2001)
    inside = np.abs(trajectory.law(t) - 0.5) < 0.2
    assert np.min(trajectory(t, 1)[inside, 0]) >= 0.5


@pytest.mark.parametrize(
    ("values", "message"),
    [((0.0, np.nan, -1.0), "b of the row 'odd' is not finite"), ((np.zeros((3, 2)), 0.0, -1.0), "must be")],
)
def test_faulty_rows_are_refused(values: tuple[object, ...], message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        _timed_line(po.RowConstraint("odd", lambda points: values))  # type: ignore[arg-type, return-value]


# --- How near the jerk-limited law comes to the one without jerk limits


@each_problem
def test_loose_jerk_limits_cost_next_to_nothing(name: str) -> None:
    bounds = _problem(name).bounds
    loose = replace(bounds, jerk={n: 1e3 * v for n, v in bounds.jerk.items()})
    trajectory = po.JerkLimited().retime(replace(_problem(name), limits=loose), _path(name))
    fastest = _timed(po.TimeOptimal(), name).duration
    assert trajectory.duration <= 1.03 * fastest
    assert trajectory.gap == pytest.approx(trajectory.duration / fastest, rel=0.02)
    assert po.verify(replace(_problem(name), limits=loose), trajectory, check_jerk=True).passed


@each_problem
def test_the_gap_is_stated(name: str) -> None:
    trajectory = _timed(po.JerkLimited(), name)
    assert trajectory.gap is not None
    assert trajectory.gap == trajectory.duration / trajectory.without_jerk
    assert f"{trajectory.gap:.3f} times the time without jerk limits" in trajectory.method
    assert _timed(po.TimeOptimal(), name).gap is None


def test_uniform_slowing_is_told() -> None:
    """On a grid that may not be refined the excess between its points is removed by running slower."""
    trajectory = po.TimeOptimal(n_grid=20, refinements=0).retime(_problem("box"), _path("box"))
    assert trajectory.slowed > 1.001
    assert f"run {100 * (trajectory.slowed - 1.0):.2g} % slower" in trajectory.method
    assert po.verify(_problem("box"), trajectory).passed


# --- Point to point


@pytest.mark.parametrize("straight", [True, False])
def test_a_joint_move_stays_on_its_branch(straight: bool) -> None:
    problem = _problem("free")
    trajectory = po.JointMove(straight=straight).move(problem)
    certificate = po.verify(problem, trajectory, check_jerk=True)
    assert certificate.passed, str(certificate)
    # the slowest drive alone decides: its closed form needs no retimer
    distance = np.abs(problem.goal_configuration.active - problem.start_configuration.active)
    assert trajectory.duration >= np.max(distance) / VELOCITY
    assert trajectory.path.independent == JACKS


@pytest.mark.parametrize("straight", [True, False])
def test_all_drives_arrive_together(straight: bool) -> None:
    trajectory = po.JointMove(straight=straight).move(_problem("free"))
    speeds = np.abs(trajectory(np.linspace(0.0, trajectory.duration, 2001), 1)[:, :3])
    last = [int(np.flatnonzero(v > 1e-4 * np.max(v))[-1]) for v in speeds.T if np.max(v) > 1e-6]
    assert min(last) > 1900
    if straight:
        q = trajectory(np.linspace(0.0, trajectory.duration, 101))[:, :3]
        moves = np.abs(q[-1] - q[0]) > 1e-6  # by symmetry one of the three stands still
        done = (q[:, moves] - q[0, moves]) / (q[-1, moves] - q[0, moves])
        assert done.shape[1] >= 2
        np.testing.assert_allclose(done, np.tile(done[:, :1], (1, done.shape[1])), atol=1e-9)


def test_via_points_are_passed_without_a_stop_where_that_is_asked_for() -> None:
    robot = gantry.gantry()
    asked = po.Problem(
        po.Scene(robot), dict.fromkeys("xyz", 0.0), {"x": 1.0, "y": 0.5, "z": 0.0}, limits=gantry.limits(1.0, 2.0, 20.0)
    )
    via = [{"x": 0.4, "y": 0.3, "z": 0.0}, {"x": 0.7, "y": 0.4, "z": 0.0}]
    stops, passes = (po.JointMove(blend=blend).move(asked, via) for blend in (0.0, 2.0))
    assert passes.duration < 0.9 * stops.duration
    for trajectory, stands in ((stops, True), (passes, False)):
        t = np.linspace(0.0, trajectory.duration, 20001)
        q, speed = trajectory(t)[:, :3], np.linalg.norm(trajectory(t, 1)[:, :3], axis=1)
        for point in via:
            gap = np.linalg.norm(q - list(point.values()), axis=1)
            assert np.min(gap) < 1e-3
            assert bool(speed[int(np.argmin(gap))] < 0.05) is stands
        assert po.verify(asked, trajectory, check_jerk=True).passed


def test_a_joint_move_that_leaves_its_branch_is_refused() -> None:
    """The goal in another working mode of the same assembly: straight there the loops open, or end elsewhere."""
    problem = raf_problem(goal=other_elbow("A"))
    with pytest.raises(po.InfeasibleError, match=r"another assembly|on their branch"):
        po.JointMove().move(problem)


@pytest.mark.parametrize("options", [{"blend": -0.1}, {"blend": 2.5}, {"blend": 1.0, "straight": True}])
def test_faulty_moves_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(po.DefinitionError, match="blend is"):
        po.JointMove(**options)  # type: ignore[arg-type]


def test_a_slow_platform_slows_a_joint_move() -> None:
    problem = _with("free", linear_velocity=0.05)
    trajectory = po.JointMove().move(problem)
    assert trajectory.slowed > 1.1
    assert "slower for the platform" in trajectory.method
    assert po.verify(problem, trajectory, check_jerk=True).passed
