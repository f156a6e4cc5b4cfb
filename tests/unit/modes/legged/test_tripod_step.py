"""Steps leg after leg, ways of the tool, and the phases that the planner gets."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import BSpline, make_interp_spline

import paraopt as po
from paraopt.modes.legged import FrameSupport, LeggedTask, PlaneSupport, build_problems
from paraopt.modes.legged.tripod import (
    POSE,
    LockPoseOptions,
    TripodStep,
    WalkingTripod,
    build_scenario,
    build_step_task,
    check_machining,
    follow_tool,
    foot_names,
    lean_round,
    lock_names,
    tripod_step,
)
from paraopt.modes.legged.tripod.frames import read_angles, rotations
from paraopt.robots.tripod import SOLE, TOOL
from paraopt.spatial import rotation_about
from tripods import FEET, GEOMETRY, HOME, ahead, walker

Array = np.ndarray
QUICK = LockPoseOptions(starts=1)
FLAT = PlaneSupport((0.0, 0.0, -SOLE))


def work(x: float = 0.0, height: float = 0.2) -> BSpline:
    """Give the way of the platform whose tool runs round a circle of 30 mm, leaning towards all sides by 0.12 rad."""
    return follow_tool(lean_round(0.03, 0.12, height, (x, 0, 0)), (0, 0, -TOOL))


# --- Steps


def check_chain(step: TripodStep, goals: Array) -> None:
    """Each leg begins where the one before ended, and ends where it should; locked joints stay."""
    feet = step.feet
    for leg in step.legs:
        assert_allclose(leg.swing.feet, feet, atol=0)
        state = leg.lock.state
        b = step.walker.model.locks(leg.leg, state.poses, state.feet).b
        assert np.max(np.abs(b - b[0])) < 1e-10
        assert leg.lock.smallest > 3 * 0.05
        feet = leg.swing.feet_after
    assert_allclose(step.feet_after, feet, atol=0)
    assert_allclose(step.feet_after, goals, atol=1e-12)


def test_a_step_on_level_ground() -> None:
    step = tripod_step(walker(), HOME, FEET, ahead(), options=QUICK)
    assert [leg.leg for leg in step.legs] == [1, 2, 3]
    check_chain(step, ahead())
    assert step.summary.count("from a tilt of 0.3 rad 0.0") == 3
    phases = step.phases()
    assert [p.name for p in phases][:2] == ["reconfiguration for foot 1", "swing of foot 1"]
    assert len(phases) == 6
    for k, leg in enumerate(step.legs):
        tilt, swing = phases[2 * k : 2 * k + 2]
        assert tilt.coordinates == POSE
        assert len(tilt.standing) == 3
        assert_allclose(list(tilt.goal.values()), leg.lock.pose, atol=0)
        assert swing.locked == lock_names(leg.leg)
        assert swing.coordinates == foot_names(leg.leg)
        assert f"foot {leg.leg}" not in swing.standing
        assert_allclose(list(swing.goal.values()), ahead()[leg.leg - 1], atol=1e-12)
        over = next(v for n, v in swing.via[0].items() if n.endswith(" z"))
        assert over == pytest.approx(0.03)


def test_the_planner_agrees_with_the_closed_forms() -> None:
    """Problems of all phases: each reaches, by the general closures, the configurations of the closed forms."""
    step = tripod_step(walker(), HOME, FEET, ahead(), order=(3, 1), options=QUICK)
    problems = build_problems(build_step_task(step, FLAT))
    assert len(problems) == 4
    for leg, tilt, swing in zip(step.legs, problems[::2], problems[1::2], strict=True):
        assert_allclose(tilt.goal_configuration.X, leg.lock.state.X[0], atol=1e-9)
        assert_allclose(swing.start_configuration.X, leg.lock.state.X[0], atol=1e-9)
        assert_allclose(swing.goal_configuration.X, leg.lock.state.X[-1], atol=1e-9)
        assert set(swing.held) == set(walker().held_in_swing(leg.leg))
    with pytest.raises(po.DefinitionError, match=r"order of the legs is \[1, 1\]"):
        tripod_step(walker(), HOME, FEET, ahead(), order=(1, 1))


def test_a_level_lock_is_refused_by_the_planner_too() -> None:
    """An impossible lock: the swing asked for at once, without the reconfiguration."""
    step = tripod_step(walker(), HOME, FEET, ahead(), order=(1,), options=QUICK)
    task = build_step_task(step, FLAT)
    at_once = LeggedTask(task.machine, task.phases[1:], FLAT, start=walker().configuration(HOME, FEET))
    with pytest.raises(po.InfeasibleError, match=r"phase 'swing of foot 1' .*foot 1") as caught:
        build_problems(at_once)
    assert "singular value" in str(caught.value) or "motions" in str(caught.value)


def test_a_step_on_a_slope() -> None:
    """All that was on the plane of z = 0 turned by 0.25 rad: the ground, the feet, the step."""
    R = np.asarray(rotation_about("y", -0.25))
    ground = po.HalfSpace(name="slope", pose=pose_of(R, -SOLE * R[:, 2]))
    robot = po.robots.tripod(free_feet=True, ground=[ground])
    climber = WalkingTripod(GEOMETRY, po.Scene(robot), walker().sole)

    def turn(feet: Array) -> Array:
        turned = feet.copy()
        turned[:, :3] = feet[:, :3] @ R.T
        turned[:, 3:] = [read_angles(R @ r) for r in rotations(feet)]
        return turned

    feet, goals = turn(FEET), turn(ahead())
    start = climber.geometry.rest_pose(feet)
    step = tripod_step(climber, start, feet, goals, order=(2,), options=QUICK)
    level = tripod_step(walker(), HOME, FEET, ahead(), order=(2,), options=QUICK)
    check_chain(step, np.vstack([feet[:1], goals[1:2], feet[2:]]))
    # the same machine on the same ground, seen from aside; its search is stopped early, on two ways
    assert step.smallest == pytest.approx(level.smallest, rel=0.15)
    problems = build_problems(build_step_task(step, PlaneSupport(-SOLE * R[:, 2], R[:, 2])))
    assert_allclose(problems[-1].goal_configuration.X, step.legs[0].lock.state.X[-1], atol=1e-9)


def test_a_step_on_a_hull() -> None:
    """On a cylinder of 1.5 m across the step, its footholds given as frames."""
    bend = 1.5

    def lay(feet: Array) -> Array:
        laid = feet.copy()
        for k, (foot, r) in enumerate(zip(feet, rotations(feet), strict=True)):
            a = foot[0] / bend
            laid[k, :3] = bend * np.sin(a), foot[1], bend * (np.cos(a) - 1)
            laid[k, 3:] = read_angles(np.asarray(rotation_about("y", a)) @ r)
        return laid

    feet, goals = lay(FEET), lay(ahead())
    hull = po.Cylinder(
        name="hull", radius=bend - SOLE, length=2.0, pose=po.transform((0, 0, -bend), (0.5 * np.pi, 0, 0))
    )
    robot = po.robots.tripod(free_feet=True, ground=[hull])
    inspector = WalkingTripod(GEOMETRY, po.Scene(robot), walker().sole)
    step = tripod_step(inspector, GEOMETRY.rest_pose(feet), feet, goals, order=(1,), options=QUICK)
    check_chain(step, np.vstack([goals[:1], feet[1:]]))
    frames = [
        pose_of(r, f[:3] - SOLE * r[:, 2]) for f, r in zip([*feet, *goals], rotations([*feet, *goals]), strict=True)
    ]
    problems = build_problems(build_step_task(step, FrameSupport(np.array(frames))))
    assert_allclose(problems[-1].goal_configuration.X, step.legs[0].lock.state.X[-1], atol=1e-9)


def pose_of(R: Array, p: Array) -> Array:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


def test_a_foothold_out_of_reach_names_phase_foot_and_margin() -> None:
    with pytest.raises(
        po.InfeasibleError, match=r"phase 'swing of foot 2': foot 2 cannot reach its new frame .* 281 mm"
    ) as c:
        tripod_step(walker(), HOME, FEET, ahead(0.45), order=(2, 1, 3), options=LockPoseOptions(starts=3))
    assert c.value.evidence["leg"] == 2
    assert c.value.evidence["margin"] < -1e-3


# --- Machining


def test_the_tip_follows_the_way_of_the_tool() -> None:
    curve = work()
    s = np.linspace(0, 1, 997)
    poses = curve(s)
    tip = poses[:, :3] + rotations(poses) @ np.array([0, 0, -TOOL])
    a = 2 * np.pi * s
    assert_allclose(tip, np.column_stack([0.03 * np.cos(a), 0.03 * np.sin(a), 0.2 + 0 * s]), atol=2e-6)
    assert_allclose(poses[:, 3:5], 0.12 * np.column_stack([np.sin(a), np.cos(a)]), atol=2e-6)
    X = check_machining(walker(), curve, FEET)
    names = walker().robot.mechanism.names
    assert X.shape == (401, len(names))
    assert walker().robot.kinematics.scaled_residual(X).max() < 1e-12


def test_a_turned_work_is_the_same_work_turned() -> None:
    """In position and orientation, as a rigid body."""
    s = np.linspace(0, 1, 23)
    here, there = lean_round(0.03, 0.12, 0.2)(s), lean_round(0.03, 0.12, 0.2, (0.1, -0.2, 0.05), 0.4)(s)
    R = np.asarray(rotation_about("z", 0.4))
    assert_allclose(there[:, :3], here[:, :3] @ R.T + [0.1, -0.2, 0.05], atol=1e-12)
    assert_allclose(rotations(there), R @ rotations(here), atol=1e-12)


def test_ways_of_the_tool_that_cannot_be_are_refused() -> None:
    def corner(s: Array) -> Array:
        return np.column_stack([np.abs(s - 0.3), *[0 * s] * 5])

    with pytest.raises(po.DefinitionError, match=r"way of the tool is missed by .* without corners"):
        follow_tool(corner, (0, 0, -TOOL), most_knots=64)
    with pytest.raises(po.DefinitionError, match=r"way of the tool gives shape \(9,\)"):
        follow_tool(lambda s: s, (0, 0, -TOOL))


@pytest.mark.parametrize(
    ("curve", "options", "words"),
    [
        (work(height=0.33), {}, "phase 'work': 'q[LR] [123]' would be .* out of"),
        (work(), {"clearance": 0.09}, "phase 'work': .* are .* mm apart at s = .*, asked 90 mm"),
        (work(), {"standing_margin": 0.5}, "phase 'work': the distance to parallel singularities is .* asked 0.5"),
    ],
    ids=["stroke", "clearance", "margin"],
)
def test_work_out_of_bounds_is_refused(curve: BSpline, options: dict[str, float], words: str) -> None:
    with pytest.raises(po.InfeasibleError, match=words) as caught:
        check_machining(walker(), curve, FEET, phase="work", **options)
    assert 0 <= caught.value.evidence["s"] <= 1


def test_the_scenario_is_a_list_of_phases() -> None:
    task, step = build_scenario(walker(), FEET, ahead(), work(), work(0.06), FLAT, options=QUICK)
    names = [phase.name for phase in task.phases]
    assert names[0] == "machining"
    assert names[-2:] == ["way to the new work", "machining at the new place"]
    assert len(names) == 9
    assert task.phases[0].curve is not None
    problems = build_problems(task)
    for before, after in itertools.pairwise(problems):
        assert_allclose(after.start_configuration.X, before.goal_configuration.X, atol=1e-9)
    last = problems[-1].goal_configuration
    assert_allclose([last[n] for n in POSE], work(0.06)(1.0), atol=1e-9)
    assert_allclose([last[n] for n in foot_names(3)], ahead()[2], atol=1e-9)
    assert step.smallest > 0.1
    # the work out of reach of the feet it is to be done on: told before anything is planned
    with pytest.raises(po.InfeasibleError, match="phase 'machining at the new place'"):
        build_scenario(walker(), FEET, FEET, work(), work(0.4), FLAT, options=QUICK)


def test_a_curve_of_any_spline_can_be_machined() -> None:
    moves = [[0.0] * 6, [0.02, 0, 0.01, 0, 0.1, 0], [0.02, 0.02, 0, 0.1, 0.1, 0], [0.0] * 6]
    poses = HOME + np.array(moves)
    assert len(check_machining(walker(), make_interp_spline(np.linspace(0, 1, 4), poses, k=3), FEET, count=50)) == 50
