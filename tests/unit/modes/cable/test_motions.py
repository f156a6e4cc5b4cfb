"""Tension margins along motions: conditions with gradients, rows for retimers, inverse dynamics of what they give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import paraopt as po
from cable_robots import draw_poses, hanging, ipanema, planar
from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.modes.cable import (
    CableRobot,
    Pulley,
    TensionLimits,
    TensionMargin,
    WinchLimits,
    build_hanging,
    cable_functions,
    capacity_margins,
    compute_facets,
    distribute_batch,
    dynamic_tensions,
)

Array = NDArray[np.float64]
RANGES = {"x": (-1.8, 1.8), "y": (-1.3, 1.3), "z": (0.1, 1.9), "alpha": (-1, 1), "beta": (-1, 1), "gamma": (-1, 1)}
WIDE = po.Margins(clearance=0.001, singularity=0.01)


def fast_ipanema(**changes: Any) -> CableRobot:
    """A robot whose winches are never the bottleneck."""
    return ipanema(**({"t_min": 10.0, "velocity": 20.0, "acceleration": 200.0, "ranges": RANGES} | changes))


def task(robot: CableRobot, goal: dict[str, float], **options: Any) -> po.Problem:
    pose = dict.fromkeys(robot.robot.mechanism.operational, 0.0) | {"z": 1.0}
    return po.Problem(
        po.Scene(robot.robot), start=pose | {"x": -0.3}, goal=pose | goal, **({"margins": WIDE} | options)
    )


def configurations(robot: CableRobot, poses: Array) -> tuple[Array, Array]:
    """Configurations of the robot's mechanism at poses, and their tangents by the coordinates."""
    kinematics = robot.robot.kinematics
    closed = kinematics.solve_batch(
        robot.coordinates, poses, np.tile(robot.robot.home_configuration.X, (len(poses), 1))
    )
    assert np.all(closed.converged)
    return closed.X, kinematics.tangent(closed.X, robot.coordinates)


@pytest.mark.parametrize("lowest", [1, 8, None])
@pytest.mark.parametrize("planar_robot", [False, True])
def test_condition_gives_margins_and_their_derivatives(lowest: int | None, planar_robot: bool) -> None:
    robot = planar(t_min=1.0, gravity=(0, -9.81)) if planar_robot else ipanema(t_min=10.0)
    condition = TensionMargin(robot, margin=5.0, lowest=lowest, scale=20.0)
    poses = draw_poses(robot, 30, seed=40, turn=0.1)
    X, T = configurations(robot, poses)
    values, slopes = condition.gradients(X, T)
    assert values.shape == (30, len(condition.names)) == (30, len(condition.lower))
    assert slopes.shape == (*values.shape, robot.dof)
    assert values == pytest.approx(condition.values(X))
    assert np.min(values, axis=1) == pytest.approx(capacity_margins(robot, poses) / 20.0)
    assert condition.lower == pytest.approx(np.full(len(condition.names), 0.25))
    assert len(set(condition.names)) == len(condition.names)
    h, index = 1e-6, robot.robot.mechanism.indices(robot.coordinates)
    numeric = np.empty_like(slopes)
    for i in range(robot.dof):
        ahead, behind = X.copy(), X.copy()
        ahead[:, index[i]] += h
        behind[:, index[i]] -= h
        numeric[:, :, i] = (condition.values(ahead) - condition.values(behind)) / (2 * h)
    # facets change place in the order, and normals of nearly dependent columns turn over: at few places
    good = np.abs(slopes - numeric) <= 1e-4 * (1.0 + np.abs(numeric))
    assert np.mean(good) > 0.97
    assert np.all(good[:, :1] if lowest == 1 else True)


def test_condition_of_a_hanging_robot_gives_its_tensions() -> None:
    """Along motions through equilibria: here up and down below the centre."""
    robot = hanging(t_min=0.5)
    poses = np.zeros((9, 6))
    poses[:, :3] = [0.5, 0.5, 0.0]
    poses[:, 2] = np.linspace(-0.9, -0.3, 9)
    X = np.zeros((9, len(robot.robot.mechanism.names)))
    index = robot.robot.mechanism.indices(robot.coordinates)
    X[:, index] = poses
    condition = TensionMargin(robot, scale=1.0)
    T = np.zeros((*X.shape, 1))
    T[:, index[2], 0] = 1.0
    values, slopes = condition.gradients(X, T)
    tensions = distribute_batch(robot, poses).check().values
    assert values == pytest.approx(np.hstack([tensions - 0.5, 100.0 - tensions]), abs=1e-9)
    h = 1e-6
    ahead, behind = (distribute_batch(robot, poses + s * h * np.eye(6)[2]).values for s in (1, -1))
    assert slopes[:, :4, 0] == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)
    assert condition.names[0] == "tension margin / 1 N, q1 above t_min"


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_slopes_of_a_hanging_robot_along_its_equilibria(tilt: float) -> None:
    """Sideways, where the platform tilts as it goes and its weight turns about its origin: by differences."""
    robot = hanging(t_min=0.5, operational=("x", "y", "z", "gamma"))
    machine = build_hanging(robot)
    kinematics, names = machine.kinematics, ("x", "y", "z", "gamma")
    targets = np.column_stack([np.linspace(0.3, 0.6, 5), np.full(5, 0.4), np.full(5, -0.5), np.full(5, tilt)])
    start = machine.home_configuration.X

    def solve(values: Array) -> Array:
        return np.array([kinematics.inverse(dict(zip(names, v, strict=True)), start).configuration.X for v in values])

    X = solve(targets)
    condition = TensionMargin(robot, machine.mechanism, scale=1.0)
    values, slopes = condition.gradients(X, kinematics.tangent(X, names))
    h = 1e-5
    numeric = np.stack(
        [(condition.values(solve(targets + h * e)) - condition.values(solve(targets - h * e))) / (2 * h)
         for e in np.eye(4)], axis=-1,
    )  # fmt: skip
    assert np.max(np.abs(X[:, machine.mechanism.indices(("beta",))])) > 0.1
    assert values == pytest.approx(condition.values(X))
    assert slopes == pytest.approx(numeric, rel=1e-5, abs=1e-5)


def test_rows_of_a_hanging_robot_are_its_tensions() -> None:
    """Less the margin that is kept from the limits; tensions are those that inertia and weight ask for."""
    robot = hanging(t_min=0.5)
    random = np.random.default_rng(46)
    poses = draw_poses(robot, 20, seed=47)
    poses[:, 2] = -0.5
    first, second = random.normal(size=(2, *poses.shape))
    names, (a, b, c) = TensionLimits(robot, margin=0.25).affine_levels(poses, first, second)
    speed, acceleration = 0.7, -1.3
    V, A = speed * first, acceleration * first + speed**2 * second
    W, wrench = cable_functions(robot).wrench_matrix(poses), cable_functions(robot).dynamic_wrench(poses, V, A)
    scale = np.array([1, 1, 1, *[1 / robot.length_scale] * 3])
    t = [np.linalg.lstsq(scale[:, None] * G, -scale * w, rcond=None)[0] for G, w in zip(W, wrench, strict=True)]
    wanted = np.hstack([np.array(t) - 0.5, 100.0 - np.array(t)]) - 0.25
    assert a * acceleration + b * speed**2 + c == pytest.approx(wanted, abs=1e-9)
    assert names[0] == "tension of q1"


def test_condition_is_kept_by_a_plan() -> None:
    """Along the upper edge of the workspace, which is hollow, the straight way has no tensions; the plan goes round."""
    robot, asked = fast_ipanema(), 10.0
    start = dict.fromkeys(robot.coordinates, 0.0) | {"x": -1.2, "y": 0.98, "z": 1.31}
    goal = start | {"x": 1.2}
    straight = np.linspace(list(start.values()), list(goal.values()), 101)
    margins = capacity_margins(robot, straight)
    assert min(margins[0], margins[-1]) > asked
    assert np.min(margins) < 0.0
    problem = po.Problem(po.Scene(robot.robot), start, goal, WIDE, conditions=(TensionMargin(robot, margin=asked),))
    plan = po.plan(problem)
    along = plan.path(np.linspace(0.0, 1.0, 2001))[:, robot.robot.mechanism.indices(robot.coordinates)]
    assert np.min(capacity_margins(robot, along)) >= asked - 1e-4
    assert plan.certificate.passed


def test_a_start_without_margin_is_refused() -> None:
    robot = fast_ipanema()
    problem = task(robot, {"x": 0.3}, conditions=(TensionMargin(robot, margin=500.0),))
    with pytest.raises(InfeasibleError, match="tension margin"):
        po.plan(problem)


@pytest.mark.parametrize("planar_robot", [False, True])
def test_rows_are_the_distances_of_the_dynamic_wrench(planar_robot: bool) -> None:
    robot = (
        planar(t_min=1.0, gravity=(0, -9.81), centre=(0.01, 0.02))
        if planar_robot
        else ipanema(t_min=10.0, centre=(0.01, -0.02, 0.03))
    )
    random = np.random.default_rng(41)
    poses = draw_poses(robot, 50, seed=42)
    first, second = random.normal(size=(2, *poses.shape))
    speed, acceleration = random.uniform(0, 2, 50), random.normal(size=50)
    names, (a, b, c) = TensionLimits(robot, margin=2.0).affine_levels(poses, first, second)
    assert len(names) == a.shape[1]
    found = a * acceleration[:, None] + b * speed[:, None] ** 2 + c
    V, A = first * speed[:, None], first * acceleration[:, None] + second * speed[:, None] ** 2
    wrench = cable_functions(robot).dynamic_wrench(poses, V, A)
    wanted = compute_facets(robot, poses).distances(wrench) - 2.0
    is_facet = np.isfinite(wanted)
    assert found[is_facet] == pytest.approx(wanted[is_facet], rel=1e-9, abs=1e-8)
    assert np.all(found[~is_facet] > 0.0)


@pytest.mark.parametrize("margin", [1.0, 20.0])
def test_timed_motion_keeps_all_tensions_within_their_limits(margin: float) -> None:
    robot = fast_ipanema()
    problem = task(robot, {"x": 0.6, "y": 0.2, "z": 1.2, "gamma": 0.05})
    plan = po.plan(problem, retimer=po.TimeOptimal(constraints=(TensionLimits(robot, margin),)))
    tensions = dynamic_tensions(robot, plan.trajectory, count=4001).check()
    assert np.all(tensions.values >= robot.t_min)
    assert np.all(tensions.values <= robot.t_max)
    assert np.max(tensions.residual) <= 1e-9 * max(robot.weight, float(np.max(np.abs(tensions.wrench))))
    reached = capacity_margins(robot, tensions.poses, tensions.wrench)
    # between the points of its grid the retimer keeps a row to a thousandth of what it is divided by
    assert np.min(reached) >= margin - 1e-3 * float(np.max(robot.t_max))
    # and the tensions are what bounds the motion: somewhere it touches
    assert np.min(reached) <= 1.5 * margin + 1.0


def test_without_the_rows_the_check_fails() -> None:
    robot = fast_ipanema()
    plan = po.plan(task(robot, {"x": 0.6, "y": 0.2, "z": 1.2}), retimer=po.TimeOptimal())
    tensions = dynamic_tensions(robot, plan.trajectory, count=501)
    assert not np.all(tensions.feasible)
    with pytest.raises(InfeasibleError, match=r"first at t = .* beyond what the cables can make"):
        tensions.check()


def test_inverse_dynamics_follows_the_law_of_motion() -> None:
    """A point mass on a planar robot that is moved by hand: forces are mass times acceleration."""
    robot = planar(gravity=(0, -9.81), inertia=0.0, mass=2.0, velocity=5.0, acceleration=20.0)
    pose = {"x": 0.4, "y": 0.4, "theta": 0.0}
    problem = po.Problem(po.Scene(robot.robot), pose, {"x": 0.6, "y": 0.6, "theta": 0.0}, WIDE)
    plan = po.plan(problem)
    t = np.linspace(0.0, plan.trajectory.duration, 50)
    tensions = dynamic_tensions(robot, plan.trajectory, t)
    acceleration = plan.trajectory(t, 2)[:, robot.robot.mechanism.indices(("x", "y"))]
    assert tensions.wrench[:, :2] == pytest.approx(2.0 * (np.array([0, -9.81]) - acceleration), abs=1e-9)
    with pytest.raises(DefinitionError, match="lacks the coordinates"):
        dynamic_tensions(ipanema(), plan.trajectory)


def test_default_rows_hold_the_limits_between_the_points_of_the_grid() -> None:
    robot = fast_ipanema()
    for goal in ({"x": 0.6, "y": 0.2, "z": 1.2}, {"x": -0.9, "y": -0.4, "z": 0.6, "gamma": 0.05}):
        plan = po.plan(task(robot, goal), retimer=po.TimeOptimal(constraints=(TensionLimits(robot),)))
        tensions = dynamic_tensions(robot, plan.trajectory, count=8001).check()
        assert np.min(capacity_margins(robot, tensions.poses, tensions.wrench)) > 0.0


def test_a_hanging_platform_is_timed_by_the_tensions_that_it_asks_for() -> None:
    """Up and down below the centre all inertia is balanced: four equal cables, by hand."""
    robot = hanging(t_max=6.0, t_min=0.5, velocity=5.0, acceleration=100.0)
    machine = build_hanging(robot, ("x", "y", "z", "gamma"))
    start = {"x": 0.5, "y": 0.5, "z": -0.8, "gamma": 0.0}
    problem = po.Problem(po.Scene(machine), start, start | {"z": -0.45}, po.Margins(clearance=0.001, singularity=1e-3))
    plan = po.plan(problem, retimer=po.TimeOptimal(constraints=(TensionLimits(robot, margin=0.05),)))
    tensions = dynamic_tensions(robot, plan.trajectory, tolerance=1e-6).check()
    depth = -tensions.poses[:, 2]
    slope = depth / np.sqrt(0.4**2 + 0.5**2 + depth**2)
    index = machine.mechanism.indices(("z",))
    lift = 9.81 + plan.trajectory(tensions.t, 2)[:, index[0]]
    assert tensions.values == pytest.approx(np.tile((lift / (4 * slope))[:, None], 4), rel=1e-6)
    assert np.max(tensions.values) <= 6.0
    assert np.max(tensions.values) > 5.5  # the tensions are what bounds the motion


def test_limits_of_winches_hold_over_pulleys() -> None:
    robot = ipanema(pulleys=[Pulley(radius=0.1)] * 8, velocity=1.5, acceleration=6.0)
    problem = task(robot, {"x": 0.5, "y": 0.3, "z": 0.8})
    plan = po.plan(problem, retimer=po.TimeOptimal(constraints=(WinchLimits(robot),)))
    t = np.linspace(0.0, plan.trajectory.duration, 2001)
    state = plan.trajectory.state(t)
    index = robot.robot.mechanism.indices(robot.coordinates)
    rate, change = cable_functions(robot).length_motion(
        *(v[:, index] for v in (state.X, state.velocity, state.acceleration))
    )
    assert np.max(np.abs(rate)) <= 1.5 * (1 + 1e-3)
    assert np.max(np.abs(change)) <= 6.0 * (1 + 1e-3)
    assert np.max(np.abs(rate)) > 0.9 * 1.5 or np.max(np.abs(change)) > 0.9 * 6.0


def test_arguments_are_checked() -> None:
    robot = ipanema()
    with pytest.raises(DefinitionError, match="tension margin is -1 N"):
        TensionMargin(robot, margin=-1.0)
    with pytest.raises(DefinitionError, match="nearest facets"):
        TensionMargin(robot, lowest=0)
    with pytest.raises(DefinitionError, match="nearest facets"):
        TensionMargin(robot, lowest=2.5)  # type: ignore[arg-type]
    with pytest.raises(DefinitionError, match="scale"):
        TensionMargin(robot, scale=0.0)
    with pytest.raises(DefinitionError, match="lacks the coordinates"):
        TensionMargin(robot, mechanism=planar().mechanism)
    with pytest.raises(DefinitionError, match="tension margin"):
        TensionLimits(robot, margin=np.nan)


@pytest.mark.slow
def test_random_plans_have_tensions_within_limits_at_every_time() -> None:
    """Random ends with margin and a random obstacle, with and without limits of jerk."""
    robot = ipanema(t_min=10.0, velocity=3.0, acceleration=40.0, jerk=2000.0)
    random = np.random.default_rng(43)
    poses = draw_poses(robot, 4000, seed=44, turn=0.1)
    poses = poses[capacity_margins(robot, poses) > 15.0]
    rows = (TensionLimits(robot),)
    retimers = (po.TimeOptimal(constraints=rows), po.JerkLimited(constraints=rows))
    planned = 0
    for i in range(12):
        start, goal = (dict(zip(robot.coordinates, p.tolist(), strict=True)) for p in random.choice(poses, 2))
        pose = po.transform(random.uniform([-1.5, -1.0, 0.2], [1.5, 1.0, 1.8]))
        scene = po.Scene(robot.robot, [po.Sphere(radius=float(random.uniform(0.05, 0.2)), pose=pose)])
        problem = po.Problem(
            scene, start, goal, po.Margins(0.002, 0.02), conditions=(TensionMargin(robot, margin=10.0),)
        )
        try:
            plan = po.plan(problem, retimer=retimers[i % 2])
        except (InfeasibleError, po.SolveError):  # an obstacle in the way, or no path that was found
            continue
        planned += 1
        tensions = dynamic_tensions(robot, plan.trajectory, count=4001).check()
        assert np.min(capacity_margins(robot, tensions.poses)) >= 10.0 - 1e-3
        assert np.min(tensions.margins) >= 0.0
    assert planned >= 8
