"""The certificate: a good motion passes, and one that is spoilt in any dimension is caught by the right check."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline

import paraopt as po
from motions import (
    GOAL,
    OBSTACLES,
    START,
    TASKS,
    VELOCITY,
    Altered,
    jerk_limited_of,
    other_elbow,
    plan_of,
    problem_of,
    raf_problem,
    three_rpr,
)
from paraopt.planning import TimeLaw, differences
from paraopt.planning import verify as verify_function
from support import raf_robot

Array = np.ndarray
JACKS = ("q1", "q2", "q3")
CHECKS = {
    "start reached", "goal reached", "closure residual", "closure velocity", "range exceeded", "velocity / limit",
    "acceleration / limit", "velocity is dX/dt", "acceleration is dV/dt", "at rest at start", "at rest at goal",
    "clearance", "parallel margin", "serial margin", "parallel determinant", "serial determinant",
}  # fmt: skip


def _good() -> po.Trajectory:
    return plan_of("cylinder").trajectory


def _index(name: str) -> int:
    return raf_robot().mechanism.index(name)


def _failures(motion: object, problem: po.Problem | None = None, **options: object) -> dict[str, po.planning.Check]:
    certificate = po.verify(problem or problem_of("cylinder"), motion, **options)  # type: ignore[arg-type]
    assert certificate.passed == (not certificate.failures)
    return {check.name: check for check in certificate.failures}


def _spoilt(change: Callable[[Array, Array, int], Array]) -> dict[str, po.planning.Check]:
    return _failures(Altered(_good(), change))


# --- A good motion


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("timed", [lambda task: plan_of(task).trajectory, jerk_limited_of], ids=["toppra", "ruckig"])
def test_a_good_motion_is_certified(task: str, timed: Callable[[str], po.Trajectory]) -> None:
    certificate = po.verify(problem_of(task), timed(task))
    assert certificate.passed, str(certificate)
    assert certificate.failures == ()
    certificate.check_passed()
    assert {check.name for check in certificate.checks} == CHECKS
    assert str(certificate).startswith("certified, ")


def test_a_motion_that_is_left_alone_passes() -> None:
    """The stub itself spoils nothing: all that follows is due to the changes."""
    assert _spoilt(lambda t, values, order: values) == {}


def test_the_certificate_says_when_and_where() -> None:
    certificate, trajectory = plan_of("cylinder").certificate, _good()
    assert certificate.t[0] == 0.0
    assert certificate.t[-1] == trajectory.duration
    assert len(certificate.t) == certificate.n_samples
    for series in (certificate.clearance, certificate.parallel_margin, certificate.serial_margin):
        assert series.shape == certificate.t.shape
    for name, series in (("clearance", certificate.clearance), ("parallel margin", certificate.parallel_margin)):
        check = certificate[name]
        assert check.value == series.min()
        assert check.time == certificate.t[int(np.argmin(series))]
    assert certificate["clearance"].where == "tool / cylinder"
    assert certificate["velocity / limit"].where in JACKS
    velocity = np.abs(trajectory(certificate["velocity / limit"].time, 1)[:3]) / VELOCITY
    # the same evaluation, alone instead of within a batch
    assert np.max(velocity) == pytest.approx(certificate["velocity / limit"].value, rel=1e-9)


def test_an_unknown_check_is_named_with_the_known_ones() -> None:
    with pytest.raises(po.DefinitionError, match=r"no check is called 'speed'.*'closure residual'"):
        plan_of("free").certificate["speed"]


@pytest.mark.parametrize("task", TASKS)
def test_plans_are_looked_at_ten_times_denser_than_they_were_made(task: str) -> None:
    plan = plan_of(task)
    assert plan.certificate.n_samples >= 10 * plan.refined.n_samples
    assert plan.certificate.n_samples >= 10 * plan.trajectory.n_grid
    assert plan.certificate.period <= 1e-3


def test_the_rate_and_the_number_of_samples_can_be_asked_for() -> None:
    duration = _good().duration
    assert po.verify(problem_of("cylinder"), _good(), rate=5000.0).period <= 1.0 / 5000.0
    assert po.verify(problem_of("cylinder"), _good(), at_least=3210).n_samples == 3211
    slow = po.verify(problem_of("cylinder"), _good(), rate=10.0, at_least=500)
    assert slow.period == pytest.approx(duration / 500, rel=1e-12)


def test_nothing_of_the_makers_is_used() -> None:
    """The judge shares nothing with seed, refiner and retimer but the problem, the kinematics and the scene."""
    sources = [Path(inspect.getfile(part)).read_text(encoding="utf-8") for part in (verify_function, differences)]
    nodes = [node for source in sources for node in ast.walk(ast.parse(source))]
    imported = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    own = {name for name in imported if name.startswith("paraopt")}
    shared = {
        "errors",
        "kinematics",
        "scene",
        "planning.problem",
        "planning.trajectory",
        "planning.path",
        "planning.differences",
    }
    assert own <= {f"paraopt.{name}" for name in shared}


# --- Position


@pytest.mark.parametrize(("end", "check"), [("start", "start reached"), ("goal", "goal reached")])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_missed_end_is_caught(end: str, check: str, axis: str) -> None:
    pose = dict(START if end == "start" else GOAL)
    pose[axis] += 1e-6
    failures = _failures(_good(), raf_problem("cylinder", **{end: pose}))
    assert set(failures) == {check}
    assert failures[check].where == axis
    assert failures[check].time == (0.0 if end == "start" else _good().duration)


def test_a_stated_configuration_must_be_reached_as_a_whole() -> None:
    """The pose is right and the elbow is not: it counts where the goal was a configuration."""
    other = other_elbow("A")
    assert "goal reached" in _failures(_good(), raf_problem("cylinder", goal=other))
    same = problem_of("cylinder").goal_configuration
    assert _failures(_good(), raf_problem("cylinder", goal=same)) == {}


def test_a_motion_beyond_a_range_is_caught() -> None:
    q1 = _good()(plan_of("cylinder").certificate.t)[:, 0]
    narrow = po.Limits(
        position={"q1": (0.0, float(q1.max()) - 1e-6)},
        velocity=raf_robot().limits.velocity,
        acceleration=raf_robot().limits.acceleration,
    )
    failures = _failures(_good(), raf_problem("cylinder", limits=narrow))
    assert set(failures) == {"range exceeded"}
    check = failures["range exceeded"]
    assert check.where == "q1"
    # the excess is 1 um over the characteristic length
    assert check.value == pytest.approx(1e-6 / raf_robot().mechanism.length, rel=0.01)
    assert _good()(check.time)[0] == pytest.approx(q1.max(), abs=1e-9)


def test_a_jump_is_caught_though_the_loops_stay_closed() -> None:
    path, law, duration = _good().path, _good().law, _good().duration

    def jump(t: Array, values: Array, order: int) -> Array:
        if order:
            return values
        # a jump ahead by 1e-4 of the way, some 16 um, that is lost again until the end
        ahead = 1e-4 * (t > 0.5 * duration) * 2.0 * (1.0 - t / duration)
        return path(np.minimum(law(t) + ahead, 1.0))

    failures = _spoilt(jump)
    assert "velocity is dX/dt" in failures
    assert "closure residual" not in failures
    assert failures["velocity is dX/dt"].time == pytest.approx(0.5 * duration, abs=2e-3)


# --- Closure


@pytest.mark.parametrize(
    "name", ["arm A", "cross B-", "forearm A+", "fork B+", "jack 1.x", "jack 3.y", "alpha", "gamma"]
)
def test_a_passive_variable_that_is_off_by_a_microradian_is_caught(name: str) -> None:
    def shift(t: Array, values: Array, order: int) -> Array:
        if order == 0:
            values[:, _index(name)] += 1e-6
        return values

    failures = _spoilt(shift)
    # the start is compared as a whole; nothing else is off
    assert {"closure residual"} <= set(failures) <= {"closure residual", "closure velocity", "start reached"}
    # levers of 4 mm (a fork's pins, aslant) to 0.5 m (a leg)
    assert 3e-9 < failures["closure residual"].value < 1e-6


@pytest.mark.parametrize("name", [*JACKS, "x", "y", "z"])
def test_an_active_or_operational_variable_that_is_off_by_ten_nanometres_is_caught(name: str) -> None:
    def shift(t: Array, values: Array, order: int) -> Array:
        if order == 0:
            values[:, _index(name)] += 1e-8
        return values

    assert "closure residual" in _spoilt(shift)


def test_an_open_loop_for_one_sample_is_caught() -> None:
    def nudge(t: Array, values: Array, order: int) -> Array:
        if order == 0:
            values[333, _index("arm B")] += 1e-8
        return values

    failures = _spoilt(nudge)
    assert "closure residual" in failures
    assert failures["closure residual"].time == pytest.approx(333 * _good().duration / 1000, abs=1e-9)


def test_an_idle_spin_opens_nothing() -> None:
    """The legs may stand at any angle about their own axes."""

    def spin(t: Array, values: Array, order: int) -> Array:
        if order == 0:
            values[:, _index("jack 2.z")] += 1.0
        return values

    assert _spoilt(spin) == {}


def test_velocities_that_open_the_loops_are_caught() -> None:
    def drift(t: Array, values: Array, order: int) -> Array:
        if order == 1:
            values[:, _index("cross A+")] += 1e-4 * np.sin(np.pi * t / _good().duration) ** 2
        return values

    # the wrong share is far below a percent: only the closures tell
    assert set(_spoilt(drift)) == {"closure velocity"}


# --- Velocity


@pytest.mark.parametrize("name", ["q2", "arm A", "x"])
def test_a_wrong_stated_velocity_is_caught(name: str) -> None:
    def scale(t: Array, values: Array, order: int) -> Array:
        if order == 1:
            values[:, _index(name)] *= 1.05
        return values

    failures = _spoilt(scale)
    assert "closure velocity" in failures  # the loops would open
    assert not {"closure residual", "clearance", "goal reached"} & set(failures)


def test_velocities_that_are_wrong_together_are_caught() -> None:
    failures = _spoilt(lambda t, values, order: values * 1.05 if order == 1 else values)
    assert "velocity is dX/dt" in failures
    assert "closure velocity" not in failures  # a multiple of a good velocity closes too


def test_velocities_of_the_opposite_sign_are_caught() -> None:
    assert "velocity is dX/dt" in _spoilt(lambda t, values, order: -values if order == 1 else values)


def _compressed(trajectory: po.Trajectory, share: float) -> po.Trajectory:
    return dataclasses.replace(trajectory, law=trajectory.law.stretched(1.0 / (1.0 + share)))


def test_a_velocity_half_a_percent_above_its_limit_is_caught() -> None:
    """Drives so slow that accelerations do not matter: only the velocity is at its limit."""
    limits = po.Limits(velocity=dict.fromkeys(JACKS, 0.01), acceleration=dict.fromkeys(JACKS, 5.0))
    problem = raf_problem("cylinder", limits=limits)
    trajectory = po.TimeOptimal().retime(problem, plan_of("cylinder").path)
    assert _failures(trajectory, problem) == {}
    failures = _failures(_compressed(trajectory, 0.005), problem)
    assert "velocity / limit" in failures
    assert failures["velocity / limit"].value == pytest.approx(1.005, abs=1e-3)
    assert failures["velocity / limit"].where in JACKS
    assert set(failures) <= {"velocity / limit", "acceleration / limit"}


# --- Acceleration


def test_an_acceleration_above_its_limit_is_caught_after_a_compression_of_half_a_percent() -> None:
    failures = _failures(_compressed(_good(), 0.005))
    assert set(failures) == {"acceleration / limit"}
    # the square of 1.005
    assert failures["acceleration / limit"].value == pytest.approx(1.01, abs=2e-3)
    assert failures["acceleration / limit"].where in JACKS


def test_the_tolerated_excess_is_a_tenth_of_a_percent() -> None:
    used = plan_of("cylinder").certificate["acceleration / limit"].value
    # to 1.0005 and to 1.0015 of the limit
    assert _failures(_compressed(_good(), np.sqrt(1.0005 / used) - 1.0)) == {}
    assert set(_failures(_compressed(_good(), np.sqrt(1.0015 / used) - 1.0))) == {"acceleration / limit"}


@pytest.mark.parametrize("factor", [1.1, 0.9, -1.0, 0.0])
def test_wrong_stated_accelerations_are_caught(factor: float) -> None:
    failures = _spoilt(lambda t, values, order: values * factor if order == 2 else values)
    assert "acceleration is dV/dt" in failures
    assert set(failures) <= {"acceleration is dV/dt", "acceleration / limit"}


@pytest.mark.parametrize("name", ["q1", "arm B", "z"])
def test_one_wrong_stated_acceleration_is_caught(name: str) -> None:
    def shift(t: Array, values: Array, order: int) -> Array:
        if order == 2:
            values[:, _index(name)] += 0.2 * np.max(np.abs(values[:, _index(name)])) + 0.3
        return values

    failures = _spoilt(shift)
    assert failures["acceleration is dV/dt"].where == name


class _Hurried:
    """Play a motion a little faster, but state the derivatives of before."""

    def __init__(self, motion: po.Trajectory, share: float) -> None:
        self.motion, self.share, self.duration = motion, share, motion.duration / (1.0 + share)

    def __call__(self, t: Array, order: int = 0) -> Array:
        return self.motion(np.minimum(np.asarray(t) * (1.0 + self.share), self.motion.duration), order)


@pytest.mark.parametrize("share", [0.002, 0.005])
def test_limits_are_exceeded_behind_stated_derivatives_that_are_slightly_low(share: float) -> None:
    """Played 0.5 % faster, but stating the derivatives of before: the drives really exceed their limits by 1 %."""
    certificate = po.verify(problem_of("cylinder"), _Hurried(_good(), share))
    assert not certificate.passed
    check = certificate["acceleration / limit"]
    assert check.where in {f"{name}, by differences" for name in JACKS}
    # the square, by differences over 1 ms where accelerations jump about every 20 ms
    used = plan_of("cylinder").certificate["acceleration / limit"].value
    assert check.value == pytest.approx(used * (1.0 + share) ** 2, abs=5e-4)


@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
def test_a_velocity_exceeded_behind_stated_ones_is_caught_at_any_rate(rate: float) -> None:
    """Drives so slow that only the velocity is at its limit; at the highest rate round-off shows in differences."""
    limits = po.Limits(velocity=dict.fromkeys(JACKS, 0.01), acceleration=dict.fromkeys(JACKS, 5.0))
    problem = raf_problem("cylinder", limits=limits)
    trajectory = po.TimeOptimal().retime(problem, plan_of("cylinder").path)
    assert _failures(trajectory, problem, rate=rate) == {}
    check = _failures(_Hurried(trajectory, 0.002), problem, rate=rate)["velocity / limit"]
    assert check.where in {f"{name}, by differences" for name in JACKS}
    assert check.value == pytest.approx(1.002, abs=5e-4)


@pytest.mark.parametrize(("task", "rate"), [("cylinder", 100.0), ("box", 100.0), ("box", 5000.0), ("free", 20000.0)])
def test_good_motions_pass_at_any_rate(task: str, rate: float) -> None:
    """Accelerations at the limit that jump several times within a sample, and differences of round-off."""
    assert _failures(plan_of(task).trajectory, problem_of(task), rate=rate, at_least=100) == {}


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_a_motion_without_a_duration_is_refused(duration: float) -> None:
    with pytest.raises(po.DefinitionError, match=r"duration of the trajectory is .* s; it must be finite and above 0"):
        po.verify(problem_of("free"), Altered(_good(), lambda t, values, order: values, duration))


# --- Jerk


def test_a_jump_of_the_acceleration_is_caught_where_jerk_counts() -> None:
    assert _failures(jerk_limited_of("cylinder"), check_jerk=True) == {}
    assert set(_failures(_good(), check_jerk=True)) == {"jerk / limit"}


def test_a_jerk_one_and_a_half_percent_above_its_limit_is_caught() -> None:
    """Jerks so small that nothing else is at its limit."""
    limits = po.Limits(
        velocity=dict.fromkeys(JACKS, 1.0), acceleration=dict.fromkeys(JACKS, 5.0), jerk=dict.fromkeys(JACKS, 5.0)
    )
    problem = raf_problem("cylinder", limits=limits)
    trajectory = po.JerkLimited().retime(problem, plan_of("cylinder").path)
    assert _failures(trajectory, problem, check_jerk=True) == {}
    failures = _failures(_compressed(trajectory, 0.005), problem, check_jerk=True)
    assert set(failures) == {"jerk / limit"}
    # the cube of 1.005, measured by differences
    assert failures["jerk / limit"].value == pytest.approx(1.015, abs=5e-3)


# --- Clearance


@pytest.mark.parametrize("moved", [1e-4, 1e-3])
def test_an_obstacle_that_moved_is_caught(moved: float) -> None:
    """The path passes on the side of negative y, 5 mm from the cylinder."""
    x, y, z = OBSTACLES["cylinder"][0].pose[:3, 3]
    shifted = po.Cylinder(name="cylinder", radius=0.03, length=0.4, pose=po.transform((x, y - moved, z)))
    failures = _failures(_good(), raf_problem(scene=po.Scene(raf_robot(), [shifted])))
    assert set(failures) == {"clearance"}
    check = failures["clearance"]
    assert check.where == "tool / cylinder"
    assert check.bound == 0.005
    # by what it moved, where the path passes closest
    before = plan_of("cylinder").certificate["clearance"].value
    assert check.value == pytest.approx(before - moved, abs=0.1 * moved)
    assert abs(check.time - 0.5 * _good().duration) < 0.2 * _good().duration


def test_an_added_obstacle_is_caught() -> None:
    middle = plan_of("cylinder").path(0.5)[-3:]
    ball = po.Sphere(name="ball", radius=0.004, pose=po.transform((middle[0], middle[1], middle[2] + 0.07)))
    scene = po.Scene(raf_robot(), [*OBSTACLES["cylinder"], ball])
    failures = _failures(_good(), raf_problem(scene=scene))
    assert set(failures) == {"clearance"}
    assert failures["clearance"].where == "tool / ball"
    assert failures["clearance"].value < 0.0


def test_an_obstacle_between_coarse_samples_is_caught() -> None:
    """A needle that the tool passes within a few milliseconds."""
    middle = plan_of("free").path(0.5)[-3:]
    needle = po.Cylinder(
        name="needle", radius=1e-4, length=0.1, pose=po.transform((middle[0], middle[1] + 0.0165, middle[2] + 0.1))
    )
    failures = _failures(plan_of("free").trajectory, raf_problem(scene=po.Scene(raf_robot(), [needle])))
    assert set(failures) == {"clearance"}
    # 16.5 mm from the axis: 4.4 mm from the tool's side
    assert failures["clearance"].value == pytest.approx(0.0044, abs=1e-5)


def test_a_larger_asked_clearance_is_caught() -> None:
    failures = _failures(_good(), raf_problem("cylinder", margins=po.Margins(0.0052, 0.05)))
    assert set(failures) == {"clearance"}


# --- Singularities


@pytest.mark.parametrize(
    ("asked", "expected"), [(0.1815, set()), (0.1825, {"parallel margin"}), (0.4, {"parallel margin", "serial margin"})]
)
def test_a_larger_asked_margin_is_caught_with_its_time(asked: float, expected: set[str]) -> None:
    failures = _failures(_good(), raf_problem("cylinder", margins=po.Margins(0.005, asked)))
    assert set(failures) == expected
    for name in expected:
        # on this way both fall towards the goal
        assert failures[name].time > 0.9 * _good().duration
        assert failures[name].value == plan_of("cylinder").certificate[name].value


def test_a_motion_on_another_branch_is_caught_by_the_determinants() -> None:
    """With the other elbow of arm B the pose, the speeds and the limits are right, and the branch is not."""
    flipped = other_elbow("B", START)
    path, law = plan_of("free").path, plan_of("free").trajectory.law
    other = po.Path.along(path.robot, path.independent, path.spline, flipped.X)
    failures = _failures(po.Trajectory(other, law), problem_of("free"))
    assert {"parallel determinant", "serial determinant"} <= set(failures)
    # its jacks move alike and its arms stay clear: nothing else is wrong but where it starts
    assert set(failures) == {"parallel determinant", "serial determinant", "start reached"}
    assert failures["parallel determinant"].value < 0.0


def test_a_crossed_singularity_is_caught() -> None:
    """The straight line of T1 crosses det A = 0 at t = 0.182 and 0.694; both ends lie on one side.

    Source: models.md, 4, T1.
    """
    base = [(-37.5, 21.651), (37.5, 21.651), (0.0, -43.301)]
    platform = [(0.0, 0.0), (15.0, 0.0), (7.5, 12.990)]
    start, goal = {"x": 20.0, "y": 0.0, "theta": 0.3}, {"x": -60.0, "y": 50.0, "theta": 0.6}
    robot = three_rpr(base, platform, start, (10.0, 200.0))
    problem = po.Problem(po.Scene(robot), start, goal, margins=po.Margins(singularity=0.0))
    spline = BSpline(np.array([0.0, 0.0, 1.0, 1.0]), np.array([list(start.values()), list(goal.values())]), 1)
    path = po.Path.along(robot, problem.independent, spline, problem.start_configuration.X)
    # 3 t^2 - 2 t^3 over 1000 s: from rest to rest, slowly
    law = TimeLaw(np.array([0.0, 1.0]), np.array([[-2.0], [3.0], [0.0], [0.0]])).stretched(1000.0)
    certificate = po.verify(problem, po.Trajectory(path, law), rate=4.0)
    check = {c.name: c for c in certificate.failures}["parallel determinant"]
    assert check.value < 0.0
    assert 0.182 < law(check.time) < 0.694
    # the sign changes where it was recomputed
    signed = problem.determinants(path(law(certificate.t)))[0]
    crossings = law(certificate.t)[np.flatnonzero(np.diff(np.sign(signed)))]
    # samples are 0.25 s apart, up to 3.75e-4 of the way; three digits are given
    np.testing.assert_allclose(crossings, [0.182, 0.694], rtol=0, atol=1e-3)
    # a margin asked for is missed as well
    strict = dataclasses.replace(problem, margins=po.Margins(singularity=0.01))
    assert not po.verify(strict, po.Trajectory(path, law), rate=4.0)["parallel margin"].passed


# --- Rest


def test_a_motion_that_is_cut_off_is_caught() -> None:
    cut = Altered(_good(), lambda t, values, order: values, 0.99 * _good().duration)
    assert set(_failures(cut)) == {"goal reached", "at rest at goal"}


def test_a_motion_that_begins_late_is_caught() -> None:
    late = 0.01 * _good().duration

    class Late:
        duration = _good().duration - late

        def __call__(self, t: Array, order: int = 0) -> Array:
            return _good()(np.minimum(np.asarray(t) + late, _good().duration), order)

    assert set(_failures(Late())) == {"start reached", "at rest at start"}


def test_a_motion_that_stands_still_is_caught() -> None:
    class Still:
        duration = 1.0

        def __call__(self, t: Array, order: int = 0) -> Array:
            first = _good()(0.0)
            return np.tile(first if order == 0 else np.zeros_like(first), (len(t), 1))

    assert set(_failures(Still())) == {"goal reached"}


# --- What is not a number


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("where", ["one entry", "one row", "everything"])
def test_values_that_are_not_numbers_never_pass(order: int, where: str) -> None:
    failures = _spoilt(_overwrite(order, where, float("nan")))
    expected = [{"closure residual", "velocity is dX/dt"}, {"velocity is dX/dt"}, {"acceleration is dV/dt"}][order]
    assert expected <= set(failures)


@pytest.mark.parametrize("value", [float("inf"), float("-inf")])
@pytest.mark.parametrize(
    ("order", "where"),
    [
        *((order, where) for order in (0, 1, 2) for where in ("one row", "everything")),
        (0, "one entry"),
        (1, "one entry"),
        (2, "one entry"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")  # infinities subtracted: what is judged
def test_infinite_values_never_pass(order: int, where: str, value: float) -> None:
    assert _spoilt(_overwrite(order, where, value))


def test_a_spike_in_a_stated_acceleration_is_caught() -> None:
    def spike(t: Array, values: Array, order: int) -> Array:
        if order == 2:
            values[400, _index("arm A")] += 1000.0
        return values

    assert "acceleration is dV/dt" in _spoilt(spike)


def _overwrite(order: int, where: str, value: float) -> Callable[[Array, Array, int], Array]:
    def spoil(t: Array, values: Array, asked: int) -> Array:
        # closer looks ask for few times: what spoils one sample is not among them
        if asked == order and (where == "everything" or len(values) > 400):
            part = {"one entry": (400, _index("arm A")), "one row": 400, "everything": slice(None)}[where]
            values[part] = value
        return values

    return spoil


# --- The verdict


def test_a_failed_certificate_raises_with_all_that_failed() -> None:
    certificate = po.verify(raf_problem("cylinder", margins=po.Margins(0.006, 0.4)), _good())
    with pytest.raises(po.CertificateError) as caught:
        certificate.check_passed()
    message = str(caught.value)
    for name in ("clearance", "parallel margin", "serial margin"):
        assert name in message
    assert "closure residual" not in message
    assert caught.value.evidence["certificate"] is certificate
    assert str(certificate).startswith("NOT certified: 3 check(s) fail")
    assert sum(line.startswith("FAIL") for line in str(certificate).splitlines()) == 3
    assert len(str(certificate).splitlines()) == 1 + len(certificate.checks)


def test_tolerances_move_the_verdict() -> None:
    x_off = raf_problem("cylinder", goal={**GOAL, "x": GOAL["x"] + 1e-6})
    assert "goal reached" in _failures(_good(), x_off)
    assert _failures(_good(), x_off, tolerances=po.Tolerances(ends=1e-4)) == {}
    strict = po.Tolerances(closure=1e-16)
    assert "closure residual" in _failures(_good(), tolerances=strict)
