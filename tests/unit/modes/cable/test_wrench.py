"""Functions of the pose: lengths over pulleys, wrench matrices, wrenches of inertia."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cable_robots import draw_poses, ipanema, planar
from paraopt.errors import SolveError
from paraopt.modes.cable import CableRobot, Drum, Pulley, cable_functions

Array = NDArray[np.float64]

AXES = [(0, 0, 1), (0, 0, -1), (0.2, 0, 1), (0, 0.3, -1), (1, 0.1, 0), (0, 0, 1), (0, 1, 1), (0, 0, 1)]
PULLEYS = [Pulley(radius=0.03 + 0.005 * i, axis=axis) for i, axis in enumerate(AXES)]
ROBOTS = {
    # an inertia with three principal values: a sphere's would hide the gyroscopic moment
    "eyes": ipanema(
        t_min=10.0,
        centre=(0.02, -0.01, 0.03),
        load=(3.0, -2.0, 5.0, 0.3, 0.1, -0.4),
        order="zyx",
        inertia=[[4.0, 0.5, -0.2], [0.5, 9.0, 0.3], [-0.2, 0.3, 6.0]],
    ),
    "pulleys": ipanema(t_min=10.0, pulleys=PULLEYS),
    "one pulley": ipanema(pulleys=[Pulley(radius=0.05), *[None] * 7]),
    "planar": planar(gravity=(0.3, -9.81), centre=(0.01, 0.02), load=(1.0, -2.0, 0.3)),
    "planar pulleys": planar(pulleys=[Pulley(radius=0.01, axis=(1, 0.2, 0))] * 4),
}


def differentiate(function: Any, poses: Array, step: float = 1e-6) -> Array:
    """Central differences along every coordinate; the last axis."""
    shifts = step * np.eye(poses.shape[1])
    return np.stack([(function(poses + e) - function(poses - e)) / (2 * step) for e in shifts], axis=-1)


@pytest.mark.parametrize("name", ROBOTS)
def test_rates_of_the_lengths_are_exact(name: str) -> None:
    robot = ROBOTS[name]
    functions, poses = cable_functions(robot), draw_poses(robot, 20, seed=1)
    wanted = differentiate(functions.lengths, poses)
    assert functions.length_rates(poses) == pytest.approx(wanted, abs=1e-8)


@pytest.mark.parametrize("name", ROBOTS)
def test_virtual_work_ties_lengths_and_wrenches(name: str) -> None:
    """`dl/dx = -W^T E`: tensions work against the lengths, over pulleys as well."""
    robot = ROBOTS[name]
    functions, poses = cable_functions(robot), draw_poses(robot, 20, seed=2)
    W, E = functions.wrench_matrix(poses), functions.twists(poses)
    assert functions.length_rates(poses) == pytest.approx(-np.einsum("kdn,kdx->knx", W, E), abs=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_rates_of_the_wrenches_are_exact(name: str) -> None:
    robot = ROBOTS[name]
    functions, poses = cable_functions(robot), draw_poses(robot, 20, seed=3)
    dW, dw = functions.derivatives(poses)
    assert dW == pytest.approx(differentiate(functions.wrench_matrix, poses), abs=1e-7)
    assert dw == pytest.approx(differentiate(functions.wrench, poses), abs=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_second_rates_of_the_lengths_along_a_motion(name: str) -> None:
    robot = ROBOTS[name]
    functions, poses = cable_functions(robot), draw_poses(robot, 10, seed=4)
    first, second = np.random.default_rng(5).normal(size=(2, *poses.shape))
    rate, change = functions.length_motion(poses, first, second)
    h = 1e-4

    def at(s: float) -> Array:
        return functions.lengths(poses + s * first + 0.5 * s**2 * second)

    assert rate == pytest.approx((at(h) - at(-h)) / (2 * h), abs=1e-5)
    assert change == pytest.approx((at(h) - 2 * at(0.0) + at(-h)) / h**2, abs=1e-4)


@pytest.mark.parametrize("name", ["eyes", "planar"])
def test_inertia_is_the_change_of_momentum(name: str) -> None:
    """Momentum is computed by hand from the pose at three instants; the moment is about the moving origin."""
    robot = ROBOTS[name]
    functions, poses = cable_functions(robot), draw_poses(robot, 5, seed=6)
    V, A = np.random.default_rng(7).normal(size=(2, *poses.shape))
    h = 1e-4

    def momentum(s: float) -> tuple[Array, Array]:
        """Momentum, and angular momentum about the origin of the world."""
        here, rate = poses + s * V + 0.5 * s**2 * A, V + s * A
        twist = np.einsum("kij,kj->ki", functions.twists(here), rate)
        velocity, omega = (np.zeros((len(poses), 3)) for _ in range(2))
        origin = np.zeros((len(poses), 3))
        width = 2 if robot.planar else 3
        velocity[:, :width], origin[:, :width] = twist[:, :width], here[:, :width]
        omega[:, 3 - robot.dof + width :] = twist[:, width:]
        # the rotation from where it takes three points
        R = rotation_of(robot, here)
        arm = R @ robot.centre
        linear = robot.mass * (velocity + np.cross(omega, arm))
        spin = np.einsum("kij,jl,kml,km->ki", R, robot.inertia, R, omega)
        return linear, spin + np.cross(origin + arm, linear)

    after, before = momentum(h), momentum(-h)
    force, moment = ((x - y) / (2 * h) for x, y in zip(after, before, strict=True))
    origin = np.zeros((len(poses), 3))
    width = 2 if robot.planar else 3
    origin[:, :width] = poses[:, :width]
    moment -= np.cross(origin, force)
    wanted = np.column_stack([force[:, :2], moment[:, 2:]]) if robot.planar else np.hstack([force, moment])
    assert functions.inertia_wrench(poses, V, A) == pytest.approx(wanted, rel=1e-6, abs=1e-5)
    assert functions.dynamic_wrench(poses, V, A) == pytest.approx(functions.wrench(poses) - wanted, rel=1e-6, abs=1e-5)


def rotation_of(robot: CableRobot, poses: Array) -> Array:
    """Rotations of the platform from where a robot with three attachments on its axes has them."""
    probe = CableRobot(
        name="probe", exits=[(9, 0, 9), (0, 9, 9), (9, 9, 0)], attachments=np.eye(3), mass=1.0, t_max=1.0,
        order="xyz" if robot.planar else robot.order,
    )  # fmt: skip
    spatial = poses
    if robot.planar:
        spatial = np.zeros((len(poses), 6))
        spatial[:, :2], spatial[:, 5] = poses[:, :2], poses[:, 2]
    points = cable_functions(probe).attachment_points(spatial)
    return (points - spatial[:, None, :3]).transpose(0, 2, 1)


@pytest.mark.parametrize("name", ["eyes", "planar"])
def test_wrenches_at_rest_are_those_of_statics(name: str) -> None:
    """Built by hand: pulls along the cables, the weight at the centre of mass, the load at the origin."""
    robot = ROBOTS[name]
    poses = draw_poses(robot, 10, seed=11)
    W, w = cable_functions(robot).both(poses)
    kept = [0, 1, 5] if robot.planar else list(range(6))
    for pose, R, found_W, found_w in zip(poses, rotation_of(robot, poses), W, w, strict=True):
        origin = np.append(pose[:2], 0.0) if robot.planar else pose[:3]
        arms = robot.attachments_in_space() @ R.T
        pulls = robot.exits_in_space() - origin - arms
        pulls /= np.linalg.norm(pulls, axis=1)[:, None]
        assert found_W == pytest.approx(np.hstack([pulls, np.cross(arms, pulls)]).T[kept], abs=1e-13)
        weight = robot.mass * robot.gravity
        wanted = np.concatenate([weight, np.cross(R @ robot.centre, weight)])[kept] + robot.load
        assert found_w == pytest.approx(wanted, abs=1e-11)


def test_a_planar_robot_is_the_spatial_one_in_its_plane() -> None:
    flat = planar()
    spatial = CableRobot(
        name="spatial", exits=flat.exits_in_space(), attachments=flat.attachments_in_space(), mass=1.0, t_max=100.0,
        gravity=(0, 0, 0), home={"x": 0.5, "y": 0.5},
    )  # fmt: skip
    poses = draw_poses(flat, 10, seed=8)
    lifted = np.zeros((10, 6))
    lifted[:, [0, 1, 5]] = poses
    W = cable_functions(spatial).wrench_matrix(lifted)[:, [0, 1, 5]]
    assert cable_functions(flat).wrench_matrix(poses) == pytest.approx(W, abs=1e-14)


def test_cable_over_the_wheel_by_hand() -> None:
    """Half a turn: the cable comes up the axis, lies on the wheel for pi r, and hangs down two radii beside."""
    r, drop = 0.1, 0.7
    robot = CableRobot(
        name="one", exits=[(0, 0, 1), (9, 0, 0)], attachments=[(0, 0, 0)] * 2, mass=1.0, t_max=10.0,
        pulleys=[Pulley(radius=r), None], home={"x": 1.0},
    )  # fmt: skip
    pose = [2 * r, 0.0, 1.0 - drop, 0.0, 0.0, 0.0]
    functions = cable_functions(robot)
    assert functions.lengths(pose)[0, 0] == pytest.approx(np.pi * r + drop, abs=1e-15)
    assert functions.leaving_points(pose)[0, 0] == pytest.approx([2 * r, 0.0, 1.0], abs=1e-15)
    assert functions.wrench_matrix(pose)[0, :3, 0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)


def test_lengths_grow_through_all_angles_on_the_wheel() -> None:
    """An attachment goes once round the wheel: the free part turns with it, and the length never jumps."""
    r, far = 0.1, 0.5
    robot = CableRobot(
        name="one", exits=[(0, 0, 0), (9, 0, 0)], attachments=[(0, 0, 0)] * 2, mass=1.0, t_max=10.0,
        pulleys=[Pulley(radius=r), None], home={"x": 1.0},
    )  # fmt: skip
    angle = np.linspace(0.1, 1.4 * np.pi, 200)  # on the wheel; beyond half a turn the free part comes back inwards
    leaving = np.column_stack([r - r * np.cos(angle), 0.0 * angle, r * np.sin(angle)])
    held = leaving + far * np.column_stack([np.sin(angle), 0.0 * angle, np.cos(angle)])
    ahead = held[:, 0] > 0.0  # behind the axis the wheel would swivel round
    assert np.max(angle[ahead]) > 1.05 * np.pi
    poses = np.hstack([held, np.zeros((200, 3))])[ahead]
    functions = cable_functions(robot)
    assert functions.lengths(poses)[:, 0] == pytest.approx(r * angle[ahead] + far, abs=1e-12)
    assert functions.leaving_points(poses)[:, 0] == pytest.approx(leaving[ahead], abs=1e-12)


def test_cables_leave_the_wheels_along_tangents() -> None:
    robot = ROBOTS["pulleys"]
    functions, poses = cable_functions(robot), draw_poses(robot, 50, seed=9)
    leaving, held = functions.leaving_points(poses), functions.attachment_points(poses)
    for i, (pulley, exit_) in enumerate(zip(PULLEYS, robot.exits, strict=True)):
        axis = np.array(pulley.axis)
        beside = held[:, i] - exit_ - ((held[:, i] - exit_) @ axis)[:, None] * axis
        centre = exit_ + pulley.radius * beside / np.linalg.norm(beside, axis=1)[:, None]
        spoke = leaving[:, i] - centre
        assert np.linalg.norm(spoke, axis=1) == pytest.approx(np.full(50, pulley.radius), rel=1e-12)
        assert np.einsum("ki,ki->k", spoke, held[:, i] - leaving[:, i]) == pytest.approx(np.zeros(50), abs=1e-13)


def test_small_wheels_are_eyes() -> None:
    eyes, poses = ROBOTS["eyes"], draw_poses(ROBOTS["eyes"], 10, seed=10)
    small = ipanema(pulleys=[Pulley(radius=1e-9)] * 8, order="zyx")
    lengths = cable_functions(small).lengths(poses)
    assert lengths == pytest.approx(cable_functions(eyes).lengths(poses), abs=1e-8)


def test_an_attachment_within_the_wheel_is_refused() -> None:
    robot = ipanema(pulleys=[Pulley(radius=0.5), *[None] * 7])
    with pytest.raises(SolveError, match="pose 1"):
        cable_functions(robot).both([[0, 0, 1, 0, 0, 0], [-1.4, 1.44, 2.0, 0, 0, 0]])


def test_winch_angles_need_drums() -> None:
    with pytest.raises(SolveError, match="no drums"):
        cable_functions(ipanema()).winch_angles([0.0] * 6)
    robot = ipanema(drums=[Drum(radius=0.05)] * 8)
    functions = cable_functions(robot)
    pose = [0.1, 0.0, 1.0, 0.0, 0.0, 0.0]
    assert functions.winch_angles(pose) == pytest.approx(functions.lengths(pose) / 0.05)
