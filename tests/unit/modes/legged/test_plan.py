"""A planned walk: its motion, its certificate, and that the certificate sees what goes wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

import paraopt as po
from paraopt.modes.legged import (
    FrameSupport,
    LeggedCertificate,
    LeggedPlan,
    LeggedTask,
    LeggedTolerances,
    LeggedTrajectory,
    Phase,
    PhaseMark,
    PlaneSupport,
    measure_centre,
    plan_legged,
    verify_legged,
)
from paraopt.planning.trajectory import Motion

Array = NDArray[np.float64]
TRUNK = ("x", "y", "z", "alpha", "beta", "gamma")


# --- The plan


def test_a_lift_is_certified(plan: LeggedPlan) -> None:
    certificate = plan.certificate
    assert certificate.passed
    assert certificate.smallest_margin > 0.002
    assert certificate["standing feet move"].value < 1e-9
    assert certificate["locked joints move"].value == 0.0
    assert certificate["contacts change at rest"].value < 1e-6
    assert certificate["pose jumps"].value < 1e-9
    assert certificate["lifted feet in the ground"].value < 1e-6
    names = {check.name for check in certificate.checks}
    assert names >= {"support margin", "standing feet off support"}
    assert str(certificate).startswith("certified, 3 phases")
    for phase, checked in zip(plan.phases, certificate.phases, strict=True):  # ten times as dense as the planner
        assert checked.n_samples >= 10 * max(phase.refined.n_samples, phase.trajectory.n_grid)
    assert "certified motion" in plan.summary
    assert set(plan.timings) == {"prepare", "seed", "refine", "retime", "verify"}


def test_the_foot_passes_its_highest_place(plan: LeggedPlan) -> None:
    task = plan.task
    swing = plan.trajectory.parts[1]
    X = swing(np.linspace(0.0, swing.duration, 4001))
    foot = task.machine.contacts(X)[0][:, 0]
    way = foot - [0.037, -0.079, -0.155]
    assert np.min(np.linalg.norm(way - [0.01, 0.0, 0.02], axis=1)) < 1e-4  # samples are up to 0.1 mm apart
    assert_allclose(way[[0, -1]], [[0, 0, 0], [0.02, 0, 0]], atol=1e-9)
    assert np.min(way[:, 2]) > -1e-6
    trunk = X[:, task.machine.robot.mechanism.indices(TRUNK)]
    assert np.all(trunk == trunk[0])


def test_the_trajectory_is_one_motion(plan: LeggedPlan) -> None:
    trajectory = plan.trajectory
    assert [mark.name for mark in trajectory.marks] == ["shift", "swing", "back"]
    assert trajectory.marks[1].lifted == ("right rear",)
    assert trajectory.marks[1].locked == TRUNK
    assert trajectory.duration == pytest.approx(sum(part.duration for part in trajectory.parts))
    assert trajectory.phase_at([0.0, trajectory.borders[1], trajectory.duration]).tolist() == [0, 1, 2]
    before, after = trajectory.borders[1] + np.array([-1e-9, 1e-9])
    assert_allclose(trajectory(before), trajectory(after), atol=1e-8)  # at rest: nothing moves within a nanosecond
    assert_allclose(trajectory(trajectory.borders, 1), 0.0, atol=1e-6)
    t = trajectory.borders[1] + 0.5 * trajectory.parts[1].duration
    step = 1e-5
    assert_allclose(trajectory(t, 1), (trajectory(t + step) - trajectory(t - step)) / (2 * step), atol=1e-4)
    assert_allclose(trajectory(t, 2), (trajectory(t + step, 1) - trajectory(t - step, 1)) / (2 * step), atol=1e-2)
    assert trajectory(t).shape == (35,)
    assert trajectory.at(t)["right rear foot z"] == pytest.approx(
        trajectory(t)[trajectory.robot.mechanism.index("right rear foot z")]
    )
    state = trajectory.sample(0.1)
    assert state.t[-1] == trajectory.duration
    assert state.X.shape == (len(state.t), 35)
    for wrong in (-0.1, trajectory.duration + 0.1, np.nan):
        with pytest.raises(po.DefinitionError, match="time is"):
            trajectory(wrong)
    with pytest.raises(po.DefinitionError, match="period"):
        trajectory.sample(0.0)


def test_marks_must_follow_each_other(plan: LeggedPlan) -> None:
    trajectory = plan.trajectory
    first, second, third = trajectory.marks
    for marks, match in (
        ((first, second), "3 parts and 2 marks"),
        ((first, replace(second, start=second.start + 0.1), third), "begins at"),
        ((replace(first, start=-0.1), second, third), "is marked for"),
    ):
        with pytest.raises(po.DefinitionError, match=match):
            LeggedTrajectory(trajectory.robot, trajectory.parts, marks)


def test_no_plan_is_given_that_its_certificate_contradicts(task: LeggedTask, shift: Phase) -> None:
    short = replace(task, phases=(shift,))
    strict = LeggedTolerances(rest=1e-300)  # no motion that numbers describe is so much at rest
    with pytest.raises(po.CertificateError, match="contacts change at rest"):
        plan_legged(short, retimer=po.TimeOptimal(), accept=strict)
    failed = plan_legged(short, retimer=po.TimeOptimal(), accept=strict, allow_failed=True)
    assert not failed.certificate.passed
    assert "NOT certified" in failed.summary


def test_the_same_task_gives_the_same_motion(plan: LeggedPlan) -> None:
    again = plan_legged(plan.task, retimer=po.TimeOptimal())
    t = np.linspace(0.0, plan.trajectory.duration, 50)
    assert again.trajectory.duration == plan.trajectory.duration
    assert np.array_equal(again.trajectory(t), plan.trajectory(t))


def test_a_curve_is_followed_exactly(task: LeggedTask, shift: Phase, swing: Phase) -> None:
    """The foot goes over an arch while the trunk rises, each as a spline says."""
    names = (*swing.coordinates, "z")
    controls = np.zeros((6, 4))
    controls[:, 0] = np.linspace(0.0, 0.02, 6)
    controls[2:4, 2] = 0.03
    controls[:, 3] = [-0.01, -0.01, -0.01, -0.006, -0.006, -0.006]
    curve = BSpline([0, 0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1, 1], controls, 3)
    locked = tuple(name for name in TRUNK if name != "z")
    follow = replace(swing, coordinates=names, goal={}, via=(), curve=curve, locked=locked, retimer=po.TimeOptimal())
    plan = plan_legged(replace(task, phases=(replace(shift, retimer=po.TimeOptimal()), follow)))
    path = plan.phases[1].refined.path
    s = np.linspace(0.0, 1.0, 33)
    index = task.machine.robot.mechanism.indices(names)
    assert_allclose(path(s)[:, index], curve(s), atol=1e-12)
    assert plan.phases[1].seed is None
    assert plan.certificate.passed
    # a curve that does not begin where the phase before ends, and one that leaves the support polygon
    late = BSpline(curve.t, controls + np.array([0.0, 0.0, 0.0, 1e-6]), 3)
    with pytest.raises(po.DefinitionError, match="'swing' has a curve that begins with 'z'"):
        plan_legged(replace(task, phases=(shift, replace(follow, curve=late))))
    side = np.column_stack([controls[:, :3], 0.025 - np.array([0, 0, 0.05, 0.05, 0, 0])])
    tips = replace(
        follow, coordinates=(*swing.coordinates, "y"), locked=tuple(n for n in TRUNK if n != "y"),
        curve=BSpline(curve.t, side, 3),
    )  # fmt: skip
    with pytest.raises(
        po.RefineError, match=r"'swing' \(lifting 'right rear'\).*curve breaks a bound: .*support margin"
    ):
        plan_legged(replace(task, phases=(replace(shift, retimer=po.TimeOptimal()), tips)))


def test_feet_step_onto_frames_and_slopes(task: LeggedTask, shift: Phase, swing: Phase, back: Phase) -> None:
    """A foothold 4 mm higher and leaning by 5 degrees, and gravity that leans, too."""
    places = task.machine.contacts(task.machine.robot.home_configuration.X)[1][0]
    frames = [po.transform(place) for place in places]
    frames.append(po.transform(places[0] + [0.02, 0.0, 0.004], (0.0, np.radians(5.0), 0.0)))
    up = replace(swing, goal={"right rear foot x": 0.02, "right rear foot z": 0.004})
    uneven = replace(task, phases=(shift, up, back), support=FrameSupport(frames), gravity=(-0.05, 0.0, -1.0))
    plan = plan_legged(uneven, retimer=po.TimeOptimal())
    assert plan.certificate.passed
    assert plan.certificate["standing feet off support"].value < 1e-9
    # uphill the centre of gravity, which is above the feet, comes nearer to the rear feet
    level = plan_legged(replace(uneven, gravity=(0.0, 0.0, -1.0)), retimer=po.TimeOptimal())
    assert plan.certificate.smallest_margin < level.certificate.smallest_margin
    with pytest.raises(po.InfeasibleError, match=r"'swing'.*foot 'right rear' is 3\.985 mm in 'ground'"):
        plan_legged(replace(uneven, phases=(shift, swing, back)))


@dataclass(frozen=True)
class Bump:
    """Level ground with a smooth rise of 4 mm across the way of the right rear foot, half way of its step."""

    name: str = "bump"
    z: float = -0.155

    def tangent_plane(self, p_W: ArrayLike) -> tuple[Array, Array]:
        points = np.asarray(p_W, dtype=float)
        u = np.clip((points[..., 0] - 0.047) / 0.009, -1.0, 1.0)
        beside = points[..., 1] > -0.05  # the other feet stand on level ground
        rise = np.where(beside, 0.0, 0.004 * np.cos(0.5 * np.pi * u) ** 2)
        slope = np.where(beside, 0.0, -0.004 * 0.5 * np.pi / 0.009 * np.sin(np.pi * u))
        normal = np.stack([-slope, np.zeros_like(slope), np.ones_like(slope)], axis=-1)
        below = np.stack([points[..., 0], points[..., 1], self.z + rise], axis=-1)
        return below, normal / np.linalg.norm(normal, axis=-1)[..., None]


def test_a_lifted_foot_rises_over_what_is_in_its_way(task: LeggedTask, shift: Phase, swing: Phase) -> None:
    """No place to pass is given and the ground is no obstacle of the scene: the refinement keeps the foot above it."""
    over = replace(swing, via=())
    plan = plan_legged(replace(task, phases=(shift, over), support=Bump()), retimer=po.TimeOptimal())
    assert plan.certificate.passed
    t = np.linspace(0.0, plan.phases[1].trajectory.duration, 301)
    foot = plan.task.machine.contacts(plan.phases[1].trajectory(t))[0][:, 0]
    top = np.interp(0.047, foot[:, 0], foot[:, 2])
    assert top >= -0.155 + 0.004 - 1e-6


def test_servos_with_jerk_limits_are_timed_smoothly(task: LeggedTask, shift: Phase) -> None:
    plan = plan_legged(replace(task, phases=(shift,)))
    assert isinstance(plan.phases[0].retimer, po.JerkLimited)
    assert plan.certificate.passed
    assert any(check.name == "jerk / limit" for check in plan.certificate.phases[0].checks)
    limits = task.machine.robot.limits
    free = po.Limits(limits.position, limits.velocity, limits.acceleration)
    assert isinstance(plan_legged(replace(task, phases=(shift,), limits=free)).phases[0].retimer, po.TimeOptimal)


def test_an_obstacle_is_passed(task: LeggedTask, shift: Phase, swing: Phase) -> None:
    """A rod across the foot's straight way: no place to pass is given, the seeder must find one."""
    rod = po.Capsule.between((0.051, -0.12, -0.15), (0.051, -0.06, -0.15), radius=0.002, name="rod")
    scene = po.Scene(task.machine.robot, [rod])
    over = replace(swing, via=(), goal={"right rear foot x": 0.03})
    plan = plan_legged(
        replace(task, phases=(shift, over), scene=scene, margins=po.Margins(clearance=0.002)), retimer=po.TimeOptimal()
    )
    assert plan.phases[1].seed is not None
    assert plan.phases[1].seed.straight_reason.startswith("collision")
    assert plan.certificate.passed
    assert plan.certificate.phases[1]["clearance"].value >= 0.002 - 1e-9


# --- The certificate sees what goes wrong


@dataclass(frozen=True, eq=False)
class Bent:
    """A motion that is changed on its way."""

    motion: Motion
    change: Callable[[Array, Array, int], Array]

    @property
    def duration(self) -> float:
        return self.motion.duration

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        times = np.atleast_1d(np.asarray(t, dtype=float))
        values = self.change(times / self.duration, np.array(self.motion(times, order)), order)
        return values[0] if np.ndim(t) == 0 else values


def judge(plan: LeggedPlan, k: int, change: Callable[[Array, Array, int], Array]) -> LeggedCertificate:
    """Certify the plan with its k-th phase changed."""
    parts: list[Motion] = list(plan.trajectory.parts)
    parts[k] = Bent(parts[k], change)
    bent = LeggedTrajectory(plan.trajectory.robot, parts, plan.trajectory.marks)
    return verify_legged(plan.task, [phase.problem for phase in plan.phases], bent)


def test_it_passes_what_is_not_changed(plan: LeggedPlan) -> None:
    assert judge(plan, 1, lambda s, X, order: X).passed


@pytest.mark.parametrize(
    ("name", "k", "variable", "amount", "shape"),
    [
        # 3e-9 is three times what is forgiven; shapes are zero at both ends but for jumps and speeds there
        ("standing feet move", 0, "left rear knee", 1e-7, "bump"),
        ("standing feet move", 1, "left front hip", 1e-7, "bump"),
        ("locked joints move", 1, "alpha", 3e-9, "bump"),
        ("lifted feet in the ground", 1, "right rear knee", 1.0, "bump"),
        ("support margin", 1, "y", -0.06, "bump"),
        ("pose jumps", 1, "head", 3e-9, "step"),
        ("contacts change at rest", 1, "jaw", 1e-4, "ramp"),
    ],
)
def test_corruption_is_seen(plan: LeggedPlan, name: str, k: int, variable: str, amount: float, shape: str) -> None:
    i = plan.task.machine.robot.mechanism.index(variable)
    duration = plan.trajectory.parts[k].duration

    def change(s: Array, X: Array, order: int) -> Array:
        shapes = {
            "bump": (np.sin(np.pi * s) ** 2, np.pi * np.sin(2 * np.pi * s) / duration),
            "step": (np.ones_like(s), np.zeros_like(s)),
            "ramp": (s, np.full_like(s, 1.0 / duration)),
        }[shape]
        if order < 2:
            X[:, i] += amount * shapes[order]
        return X

    certificate = judge(plan, k, change)
    check = certificate[name]
    assert not check.passed
    assert f"'{plan.task.phases[k].name}'" in check.where
    assert not certificate.passed
    with pytest.raises(po.CertificateError, match=name):
        certificate.check_passed()
    assert f"FAIL {name}" in str(certificate)


def test_a_motion_that_is_no_number_fails(plan: LeggedPlan) -> None:
    def change(s: Array, X: Array, order: int) -> Array:
        X[(s > 0.4) & (s < 0.5)] = np.nan
        return X

    certificate = judge(plan, 1, change)
    for name in ("support margin", "standing feet move", "locked joints move", "lifted feet in the ground"):
        assert not certificate[name].passed


def test_other_masses_may_tip_over(plan: LeggedPlan) -> None:
    """The certificate weighs the machine itself: with a tail of a kilogram no rear foot may come off."""
    heavy = replace(plan.task.machine, masses={**(plan.task.machine.masses or {}), "tail": 1.0})
    problems = [phase.problem for phase in plan.phases]
    certificate = verify_legged(replace(plan.task, machine=heavy), problems, plan.trajectory)
    check = certificate["support margin"]
    assert not check.passed
    assert check.where == "phase 'swing', lifting 'right rear'"
    centre = measure_centre(heavy, plan.trajectory(check.time))
    assert centre[0, 0] < measure_centre(plan.task.machine, plan.trajectory(check.time))[0, 0]


def test_another_ground_is_seen(plan: LeggedPlan) -> None:
    lower = replace(plan.task, support=PlaneSupport((0, 0, -0.1551)))
    certificate = verify_legged(lower, [phase.problem for phase in plan.phases], plan.trajectory)
    assert certificate["standing feet off support"].value == pytest.approx(1e-4)
    assert not certificate.passed


def test_a_phase_that_is_missing_is_no_certificate(plan: LeggedPlan) -> None:
    trajectory = plan.trajectory
    short = LeggedTrajectory(trajectory.robot, trajectory.parts[:2], trajectory.marks[:2])
    with pytest.raises(po.DefinitionError, match="has the phases"):
        verify_legged(plan.task, [phase.problem for phase in plan.phases], short)
    marks = [replace(mark, standing=plan.task.machine.names, lifted=()) for mark in trajectory.marks]
    with pytest.raises(po.DefinitionError, match=r"phase 'swing' is marked .*the task has it .*lift \['right rear'\]"):
        verify_legged(
            plan.task,
            [phase.problem for phase in plan.phases],
            LeggedTrajectory(trajectory.robot, trajectory.parts, marks),
        )
    mark = PhaseMark("p", 1.0, 3.0, ("a",), ("b",))
    assert mark.duration == 2.0
