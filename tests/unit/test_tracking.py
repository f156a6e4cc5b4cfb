"""Velocity-level tracking: limits, margins, jogs out of singularities, redundancy, and the programs behind them."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import numpy as np
import pytest
import qpsolvers
import scipy.optimize
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants
from paraopt.kinematics.motion_place import MotionPlace, find_frame
from paraopt.kinematics.velocity_program import Program
from support import Array, assert_derivative, five_bar_robot, raf_robot

PERIOD = 1e-3
OK, LIMITED, RELAXED = po.TrackStatus.OK, po.TrackStatus.LIMITED, po.TrackStatus.RELAXED
NOTHING = po.VelocityTracker(margins={})


@functools.cache
def ranged_five_bar() -> po.Robot:
    return po.robots.five_bar(base=8, proximal=(5, 5), distal=(7, 7), ranges=((0, np.pi), (0, np.pi)), tip=(4, 8))


@functools.cache
def three_legs() -> po.Robot:
    """Three legs of variable length from the ground to one point: three drives for two motions."""
    feet = ((0.0, 0.0), (10.0, 0.0), (4.0, 9.0))
    links: list[po.Base | po.Series | po.Mobile] = [po.Base()]
    closures = []
    for i, at in enumerate(feet, start=1):
        links.append(po.Series(f"leg {i}", "base", at, po.Revolute(f"phi{i}")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"rho{i}", axis="x", range=(0.5, 20))))
        closures.append(po.Coincidence(f"rod {i}", (0, 0), "tip", (0, 0)))
    links.append(po.Mobile("tip", coordinates=("x", "y")))
    mechanism = po.Mechanism("three legs", links, closures, ("rho1", "rho2", "rho3"), ("x", "y"), planar=True)
    tip = np.array([5.0, 4.0])
    home = {"x": 5.0, "y": 4.0}
    for i, at in enumerate(feet, start=1):
        d = tip - at
        home |= {f"rho{i}": float(np.hypot(*d)), f"phi{i}": float(np.arctan2(d[1], d[0]))}
    return po.Robot(mechanism, home=home)


def columns(robot: po.Robot, *names: str) -> list[int]:
    return robot.mechanism.indices(names)


# --- Following


@pytest.mark.parametrize("as_positions", [True, False])
def test_circle_of_the_five_bar(as_positions: bool) -> None:
    robot = five_bar_robot()
    home = robot.home_configuration
    t = PERIOD * np.arange(1, 3001)
    turn = 2 * np.pi / 3
    x, y = home["x"] + 0.4 * (np.cos(turn * t) - 1), home["y"] + 0.4 * np.sin(turn * t)
    if as_positions:
        commands = {"x": x, "y": y}
    else:  # velocities in the middle of each step
        middle = turn * (t - PERIOD / 2)
        commands = {"x": -0.4 * turn * np.sin(middle), "y": 0.4 * turn * np.cos(middle)}
    tracked = po.track(robot.kinematics, home, commands, PERIOD, NOTHING, positions=as_positions)
    error = np.hypot(*(tracked.X[1:, columns(robot, "x", "y")] - np.column_stack([x, y])).T)
    # positions: the damping's 1e-8 of a step; velocities: the midpoint rule's third order, (turn h)^2 / 24 of the way
    assert np.max(error) < (1e-9 if as_positions else 1e-6)
    assert np.max(tracked.residuals) < 1e-12
    assert_allclose(robot.kinematics.scaled_residual(tracked.X), 0, atol=1e-12)
    assert set(tracked.statuses) == {OK}
    assert set(tracked.limited_by) == {()}
    assert_allclose(tracked.X[-1], home.X, atol=1e-6)  # the same branch, one turn later


def test_drives_are_followed() -> None:
    robot = five_bar_robot()
    step = NOTHING.step(robot.kinematics, robot.home_configuration, {"theta1": 0.3, "theta2": -0.2}, PERIOD)
    assert step.status is OK
    assert_allclose(step.velocity[columns(robot, "theta1", "theta2")], [0.3, -0.2], rtol=1e-6)
    assert step.error < 1e-6
    assert step.summary == OK.value


def test_twist_of_a_platform() -> None:
    robot = po.robots.stewart()
    kinematics, home = robot.kinematics, robot.home_configuration
    linear, angular = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.2, -0.15])
    step = NOTHING.step(kinematics, home, po.Twist(linear, angular), 1e-5)
    assert step.status is OK
    platform = [link.name for link in kinematics.mechanism.links].index(kinematics.mechanism.variables[-1].link)
    before, after = kinematics.poses(np.array([home.X, step.configuration.X]))[:, platform]
    assert_allclose((after[:3, 3] - before[:3, 3]) / 1e-5, linear, atol=1e-6)
    spin = (after[:3, :3] @ before[:3, :3].T - np.eye(3)) / 1e-5
    assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], angular, atol=1e-5)
    alone = NOTHING.step(kinematics, home, po.Twist(linear), 1e-5)  # rotations are free: the least motion
    assert np.linalg.norm(alone.velocity / kinematics.graph.variable_scale) < np.linalg.norm(
        step.velocity / kinematics.graph.variable_scale
    )


def test_one_call_after_the_other_is_the_sequence() -> None:
    robot = ranged_five_bar()
    random = np.random.default_rng(3)
    tracker = po.VelocityTracker(limits=robot.limits)
    commands = {"x": np.repeat(random.uniform(-9, 9, 5), 20), "y": np.repeat(random.uniform(-9, 9, 5), 20)}
    tracked = po.track(robot.kinematics, robot.home_configuration, commands, PERIOD, tracker)
    configuration, velocity = robot.home_configuration, None
    for k in range(100):
        step = tracker.step(
            robot.kinematics, configuration, {n: float(v[k]) for n, v in commands.items()}, PERIOD, velocity
        )
        configuration, velocity = step.configuration, step.velocity
        # programs are solved to round-off over the smallest eigenvalue, 1e-4
        assert_allclose(configuration.X, tracked.X[k + 1], atol=1e-10)
        assert step.status is tracked.statuses[k]
    again = po.track(robot.kinematics, robot.home_configuration, commands, PERIOD, tracker)
    assert np.array_equal(again.X, tracked.X)
    assert again.limited_by == tracked.limited_by


@pytest.mark.parametrize("name", ["delta", "hayward_wrist", "stewart", "three_rrr", "two_rpr"])
def test_sine_of_several_robots(name: str) -> None:
    robot: po.Robot = getattr(po.robots, name)()
    home = robot.home_configuration
    t = PERIOD * np.arange(1, 201)
    scale = robot.kinematics.graph.variable_scale
    goal = {
        n: home[n] + 0.01 * scale[robot.mechanism.index(n)] * np.sin((3 + i) * t)
        for i, n in enumerate(robot.mechanism.operational)
    }
    tracked = po.track(robot.kinematics, home, goal, PERIOD, NOTHING, positions=True)
    reached = tracked.X[1:, columns(robot, *goal)]
    assert_allclose(reached, np.column_stack(list(goal.values())), atol=1e-8 * np.max(scale))
    assert set(tracked.statuses) == {OK}


def test_over_constrained_machine_with_idle_spins() -> None:
    robot = raf_robot()
    home = robot.home_configuration
    n = 200
    commands = {"x": np.full(n, 0.05), "y": np.full(n, -0.03), "z": np.full(n, 0.02)}
    tracked = po.track(robot.kinematics, home, commands, PERIOD)
    assert_allclose(tracked.X[-1, columns(robot, "x", "y", "z")], [0.01, -0.006, 0.484], atol=1e-8)
    assert np.max(tracked.residuals) < 1e-12
    spins = columns(robot, *robot.kinematics.idle)
    assert_allclose(tracked.X[:, spins], np.tile(home.X[spins], (n + 1, 1)), atol=1e-12)


# --- Limits


def random_commands(count: int, seed: int, size: float) -> dict[str, Array]:
    random = np.random.default_rng(seed)
    values = np.repeat(random.uniform(-size, size, (count // 50, 2)), 50, axis=0)
    return {"x": values[:, 0], "y": values[:, 1]}


def check_limits(robot: po.Robot, tracked: po.Tracked, *drives: str) -> None:
    """Velocities and accelerations as a controller sees them, from the configurations alone."""
    index = columns(robot, *drives)
    values = tracked.X[:, index]
    low, high = robot.limits.bounds(robot.mechanism)
    assert np.all(values >= low[index])
    assert np.all(values <= high[index])
    v = np.diff(values, axis=0) / tracked.period
    assert np.all(np.abs(v) <= robot.limits.of("velocity", drives))
    a = np.diff(np.vstack([np.zeros(len(drives)), v]), axis=0) / tracked.period
    # differences of differences of values of order one over 1e-6 s^2: round-off of 1e-9
    assert np.all(np.abs(a) <= robot.limits.of("acceleration", drives) + 1e-8)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [1.0, 5.0, 15.0])
def test_limits_hold_for_random_commands(seed: int, size: float) -> None:
    robot = replace(
        ranged_five_bar(),
        limits=po.Limits(
            position={"theta1": (1.9, 2.1), "theta2": (1.05, 1.25)},
            velocity={"theta1": 0.8, "theta2": 0.6},
            acceleration={"theta1": 10.0, "theta2": 8.0},
        ),
    )
    tracked = po.track(
        robot.kinematics,
        robot.home_configuration,
        random_commands(2000, seed, size),
        PERIOD,
        po.VelocityTracker(limits=robot.limits, margins={}),
    )
    check_limits(robot, tracked, "theta1", "theta2")
    assert RELAXED not in tracked.statuses
    held = {name for names in tracked.limited_by for name in names}
    assert "acceleration of 'theta1'" in held
    if size > 1:
        assert any("velocity" in name for name in held)
        assert any("position" in name for name in held)
    assert np.max(tracked.residuals) <= 1e-12


def test_each_limit_is_named() -> None:
    robot = five_bar_robot()
    kinematics, home = robot.kinematics, robot.home_configuration
    command = {"theta1": -5.0, "theta2": 0.0}

    def held(limits: po.Limits, count: int = 400) -> po.Tracked:
        commands = {n: np.full(count, v) for n, v in command.items()}
        return po.track(kinematics, home, commands, PERIOD, po.VelocityTracker(limits=limits, margins={}))

    fast = held(po.Limits(velocity={"theta1": 0.5}))
    assert set(fast.limited_by) == {("velocity of 'theta1'",)}
    # the proximity of 1e-6 draws the second drive, by its part over the square of the margin, 0.1
    assert_allclose(fast.velocities[:, columns(robot, "theta1", "theta2")], np.tile([-0.5, 0], (400, 1)), atol=1e-3)
    abrupt = held(po.Limits(acceleration={"theta1": 20.0}), 200)
    assert set(abrupt.limited_by) == {("acceleration of 'theta1'",)}
    # the closing of the loops may leave a step a little short of its bound, which is on the safe side
    assert_allclose(abrupt.velocities[:, 0], -20.0 * PERIOD * np.arange(1, 201), rtol=1e-3)
    far = held(po.Limits(position={"theta1": (home["theta1"] - 0.2, 3.0)}), 1000)
    assert far.limited_by[-1] == ("position of 'theta1'",)
    assert far.X[-1, 0] == pytest.approx(home["theta1"] - 0.2, abs=2e-6)
    assert np.min(far.X[:, 0]) >= home["theta1"] - 0.2
    assert far.statuses[-1] is LIMITED
    # joint ranges hold without any limits
    robot = po.robots.two_rpr()
    ranged = po.track(robot.kinematics, robot.home_configuration, {"rho1": np.full(1000, -20.0)}, PERIOD, NOTHING)
    assert ranged.X[:, 0].min() >= 6.0
    assert "position of 'rho1'" in ranged.limited_by[-1]


def test_bounds_that_cannot_all_hold() -> None:
    """Too fast towards the end of a range: the acceleration gives way, and by no more than needed."""
    robot = five_bar_robot()
    home = robot.home_configuration
    limits = po.Limits(position={"theta1": (-1.0, home["theta1"] + 0.001)}, acceleration={"theta1": 10.0})
    tracker = po.VelocityTracker(limits=limits, margins={})
    step = tracker.step(robot.kinematics, home, {"theta1": 1.0, "theta2": 0.0}, PERIOD, {"theta1": 1.0})
    assert step.status is RELAXED
    assert step.limited_by == ("acceleration of 'theta1'",)
    assert step.configuration["theta1"] <= home["theta1"] + 0.001
    # from a speed of 14 a h a point comes to rest in a h^2 14 15 / 2 = 0.00105 m, from 13 a h in 0.00091 m
    assert 13 * 0.99 * 10 * PERIOD < step.velocity[0] < 14 * 0.99 * 10 * PERIOD
    allowed = step.velocity[0]
    assert step.relaxation == pytest.approx((1.0 - allowed) / (10 * PERIOD) - 1, rel=1e-3)


def test_outside_a_range_only_back() -> None:
    robot = five_bar_robot()
    home = robot.home_configuration
    tracker = po.VelocityTracker(limits=po.Limits(position={"theta1": (-1.0, home["theta1"] - 0.1)}), margins={})
    rest = tracker.step(robot.kinematics, home, {"theta1": 0.0, "theta2": 0.0}, PERIOD)
    assert rest.status is OK
    assert_allclose(rest.velocity, 0, atol=1e-9)
    out = tracker.step(robot.kinematics, home, {"theta1": 1.0, "theta2": 0.0}, PERIOD)
    assert out.limited_by == ("position of 'theta1'",)
    assert out.velocity[0] <= 1e-7
    back = tracker.step(robot.kinematics, home, {"theta1": -1.0, "theta2": 0.0}, PERIOD)
    assert back.status is OK


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_ten_thousand_steps_neither_drift_nor_change_branch(seed: int) -> None:
    robot = five_bar_robot()
    kinematics = robot.kinematics
    tracker = po.VelocityTracker(limits=robot.limits, margins={"parallel": 0.05, "serial": 0.02})
    tracked = po.track(kinematics, robot.home_configuration, random_commands(10000, seed, 4.0), PERIOD, tracker)
    assert np.max(tracked.residuals) <= 1e-12
    assert np.max(kinematics.scaled_residual(tracked.X)) <= 1e-12
    for kind in ("parallel", "serial"):
        assert np.min(tracked.margins[kind]) >= tracker.margins[kind]
    determinants = Determinants.at(kinematics, robot.home_configuration)
    for signs in determinants.signs(tracked.X):
        assert len(set(signs)) == 1
    values = tracked.X[:, columns(robot, "theta1", "theta2")]
    v = np.diff(values, axis=0) / PERIOD
    assert np.max(np.abs(v)) <= 2.0
    a = np.max(np.abs(np.diff(v, axis=0)), axis=1) / PERIOD
    kept = np.array([s is not RELAXED for s in tracked.statuses[1:]])
    assert np.all(a[kept] <= 10.0 + 1e-8)
    assert np.mean(kept) > 0.99
    assert_allclose(a[~kept], 10.0 * (1 + tracked.relaxations[1:][~kept]), rtol=1e-3)
    final = kinematics.inverse(
        dict(zip(("x", "y"), tracked.X[-1, columns(robot, "x", "y")], strict=True)), tracked.X[-1] + 1e-4
    )
    assert_allclose(final.configuration.X, tracked.X[-1], atol=1e-9)


# --- Singularities


def test_margins_and_their_slopes() -> None:
    """Against the state report, and against finite differences along closed motions, redundant machines included."""
    for robot in (five_bar_robot(), po.robots.stewart(), po.robots.hayward_wrist(), raf_robot(), three_legs()):
        kinematics, home = robot.kinematics, robot.home_configuration
        frame = find_frame(kinematics, home)
        start = po.VelocityTracker(margins={}).step(
            kinematics, home, {n: 0.1 + 0.05 * i for i, n in enumerate(robot.mechanism.operational)}, 0.1
        )
        place = MotionPlace(frame, start.configuration.X.copy())
        state = po.report_state(kinematics, start.configuration)
        for kind, value in (("parallel", state.parallel_margin), ("serial", state.serial_margin)):
            assert place.margin(kind) == pytest.approx(value, rel=1e-8)

            def along(c: Array, place: MotionPlace = place, kind: str = kind) -> float:
                return MotionPlace(place.frame, place.close(place.X + place.frame.scale * (place.V @ c))[0]).margin(
                    kind
                )

            assert_derivative(place.slope(kind), along, np.zeros(frame.mobility), tolerance=1e-7)


@functools.cache
def singular_poses() -> list[tuple[str, po.Robot, po.Configuration]]:
    """Parallel singularities, to round-off: found by the determinant's sign along one coordinate."""
    found = []
    robot = five_bar_robot()
    home = robot.home_configuration
    stopped = po.follow(robot.kinematics, home, {"theta1": 3.0, "theta2": 0.2})
    found.append(("five-bar", robot, _polish(robot, stopped.end, "x")))
    robot = po.robots.three_rpr_innocenti()
    stopped = po.follow(
        robot.kinematics, robot.home_configuration, {"rho1": 25.0, "rho2": 11.0, "rho3": 30.0},
        options=po.FollowOptions(ranges=False),
    )  # fmt: skip
    assert stopped.reason is po.StopReason.SINGULAR
    found.append(("3-RPR", robot, _polish(robot, stopped.end, "y")))
    return found


def _polish(robot: po.Robot, near: po.Configuration, name: str) -> po.Configuration:
    kinematics = robot.kinematics
    determinants = Determinants.at(kinematics, robot.home_configuration)

    def at(value: float) -> po.Configuration:
        pose = {n: near[n] for n in robot.mechanism.operational} | {name: value}
        return kinematics.inverse(pose, near).configuration

    width = 1e-3 * robot.mechanism.length
    root = scipy.optimize.brentq(
        lambda v: float(determinants(at(v).X)[0][0]), near[name] - width, near[name] + width, xtol=1e-15, rtol=1e-15
    )
    return at(root)


@pytest.mark.parametrize("case", [0, 1], ids=["five-bar", "3-RPR"])
@pytest.mark.parametrize("distance", [1e-3, 0.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_jog_out_of_a_parallel_singularity(case: int, distance: float, side: float) -> None:
    _, robot, singular = singular_poses()[case]
    kinematics, mechanism = robot.kinematics, robot.mechanism
    report = po.report_singularities(kinematics, singular)
    assert report.parallel.is_singular
    assert report.parallel.escape is not None
    way = {n: side * report.parallel.escape.velocities[n] for n in mechanism.operational}
    start = singular
    if distance:
        moved = {n: singular[n] + way[n] * distance / report.parallel.rate for n in way}
        start = kinematics.inverse(moved, singular).configuration
        margin = po.report_state(kinematics, start).parallel_margin
        assert margin == pytest.approx(distance, rel=0.1)
    tracker = po.VelocityTracker(margins={"parallel": 0.02})
    n = 500
    speed = 0.1 / report.parallel.rate
    out = po.track(kinematics, start, {k: np.full(n, speed * v) for k, v in way.items()}, PERIOD, tracker)
    assert out.margins["parallel"][-1] > 0.03
    assert set(out.statuses) == {OK}
    assert np.all(np.diff(out.margins["parallel"]) > -1e-9)
    assert np.max(out.residuals) < 1e-10
    if distance:
        back = po.track(kinematics, start, {k: np.full(n, -speed * v) for k, v in way.items()}, PERIOD, tracker)
        assert np.min(back.margins["parallel"]) >= 0.99 * distance
        assert back.statuses[0] is LIMITED
        assert "parallel singularity" in back.limited_by[0]
    # from outside the margin a motion towards the singularity is slowed and ends at the margin
    again = {k: np.full(3 * n, -speed * v) for k, v in way.items()}
    into = po.track(kinematics, out.end.configuration, again, PERIOD, tracker)
    assert np.min(into.margins["parallel"]) >= 0.02
    assert into.margins["parallel"][-1] == pytest.approx(0.02, abs=1e-4)
    assert into.limited_by[-1] == ("parallel singularity",)


def test_without_the_margin_the_singularity_is_crossed() -> None:
    """Show that it is the margin that holds: the same command without it changes the sign of the determinant."""
    _, robot, singular = singular_poses()[0]
    kinematics = robot.kinematics
    report = po.report_singularities(kinematics, singular)
    assert report.parallel.escape is not None
    way = {n: report.parallel.escape.velocities[n] for n in ("x", "y")}
    start = kinematics.inverse({n: singular[n] + 0.3 * v for n, v in way.items()}, singular).configuration
    commands = {n: np.full(600, -v) for n, v in way.items()}
    determinants = Determinants.at(kinematics, start)
    crossed = po.track(kinematics, start, commands, PERIOD, NOTHING)
    assert len(set(determinants.signs(crossed.X)[0])) == 2
    held = po.track(kinematics, start, commands, PERIOD)
    assert len(set(determinants.signs(held.X)[0])) == 1


def test_drives_commanded_into_a_singularity_without_a_margin() -> None:
    """There the loops cannot be closed with the commanded speeds: the answer stays bounded, and says so."""
    robot = five_bar_robot()
    commands = {"theta1": np.full(400, 5.0), "theta2": np.zeros(400)}
    tracked = po.track(robot.kinematics, robot.home_configuration, commands, PERIOD, NOTHING)
    assert np.max(tracked.residuals) <= 1e-12
    largest = np.max(np.abs(np.diff(tracked.X, axis=0)) / robot.kinematics.graph.variable_scale)
    assert largest <= 1.2 * NOTHING.largest_step
    lost = tracked.errors > 0.5
    assert np.any(lost)
    assert all(names == ("length of the step",) for names, off in zip(tracked.limited_by, lost, strict=True) if off)
    held = po.track(robot.kinematics, robot.home_configuration, commands, PERIOD)
    assert np.min(held.margins["parallel"]) >= 0.02
    assert held.limited_by[-1] == ("parallel singularity",)


def test_serial_margin_holds_at_the_reach() -> None:
    robot = five_bar_robot()
    tracker = po.VelocityTracker(limits=robot.limits, margins={"serial": 0.03})
    n = 3000
    tracked = po.track(
        robot.kinematics, robot.home_configuration, {"x": np.full(n, 3.0), "y": np.zeros(n)}, PERIOD, tracker
    )
    assert np.min(tracked.margins["serial"]) >= 0.03
    assert "serial singularity" in tracked.limited_by[-1]
    assert np.max(np.abs(np.diff(tracked.X[:, columns(robot, "theta1", "theta2")], axis=0))) <= 2.0 * PERIOD


# --- Redundancy


def test_contradicting_drives_are_weighed() -> None:
    robot = three_legs()
    kinematics, home = robot.kinematics, robot.home_configuration
    feet = np.array([[0.0, 0.0], [10.0, 0.0], [4.0, 9.0]])
    away = np.array([home["x"], home["y"]]) - feet
    J = away / np.linalg.norm(away, axis=1)[:, None]  # d rho / d tip
    wanted = np.array([0.3, -0.2, 0.25])
    command = dict(zip(("rho1", "rho2", "rho3"), wanted, strict=True))
    index = columns(robot, "x", "y")
    alike = NOTHING.step(kinematics, home, command, 1e-6)
    assert_allclose(alike.velocity[index], np.linalg.lstsq(J, wanted, rcond=None)[0], rtol=1e-4)
    assert alike.error > 1e-3
    for weights in ({"rho1": 1.0, "rho2": 5.0, "rho3": 0.1}, {"rho1": 1e6, "rho2": 1e6, "rho3": 1e-3}):
        root = np.sqrt(list(weights.values()))
        expected = np.linalg.lstsq(root[:, None] * J, root * wanted, rcond=None)[0]
        step = replace(NOTHING, weights=weights).step(kinematics, home, command, 1e-6)
        assert_allclose(step.velocity[index], expected, rtol=1e-4)
    assert_allclose(step.velocity[columns(robot, "rho1", "rho2")], wanted[:2], rtol=1e-4)


def test_hayward_wrist_with_one_drive_too_many() -> None:
    robot = po.robots.hayward_wrist()
    kinematics, home = robot.kinematics, robot.home_configuration
    turned = NOTHING.step(kinematics, home, {"alpha": 0.1, "beta": -0.05, "gamma": 0.2}, 1e-6)
    drives = robot.mechanism.active
    rates = turned.velocity[columns(robot, *drives)]
    agreeing = NOTHING.step(kinematics, home, dict(zip(drives, rates, strict=True)), 1e-6)
    assert agreeing.error < 1e-5
    assert_allclose(agreeing.velocity, turned.velocity, atol=1e-4)
    wrong = rates + np.array([0.0, 0.0, 0.0, 0.05])
    weighed = replace(NOTHING, weights={"q4": 1e-6}).step(kinematics, home, dict(zip(drives, wrong, strict=True)), 1e-6)
    assert_allclose(weighed.velocity, turned.velocity, atol=1e-4)


def test_free_motions_by_least_norm_or_by_effort() -> None:
    robot = five_bar_robot()
    kinematics, home = robot.kinematics, robot.home_configuration
    scale = kinematics.graph.variable_scale
    T = kinematics.tangent(home.X, ("x", "y"))[0] / scale[:, None]
    drives = columns(robot, "theta1", "theta2")
    for effort, metric in (
        (None, T.T @ T),
        ({}, T[drives].T @ T[drives] + 1e-3 * T.T @ T),
        ({"theta2": 50.0}, T[drives].T @ np.diag([1.0, 50.0]) @ T[drives] + 1e-3 * T.T @ T),
    ):
        step = replace(NOTHING, effort=effort).step(kinematics, home, {"x": 0.5}, 1e-6)
        vy = -metric[0, 1] / metric[1, 1] * 0.5  # least (0.5, vy) metric (0.5, vy)
        assert_allclose(step.velocity[columns(robot, "x", "y")], [0.5, vy], rtol=1e-4, atol=1e-5)


# --- Programs and solvers


def random_program(random: np.random.Generator, m: int, n: int) -> Program:
    root = random.normal(size=(m, m))
    P = root @ root.T + 1e-3 * np.eye(m)
    R = random.normal(size=(n, m))
    inside = 0.3 * random.normal(size=m)
    low, high = R @ inside - random.exponential(size=n), R @ inside + random.exponential(size=n)
    high[random.uniform(size=n) < 0.2] = np.inf
    low[random.uniform(size=n) < 0.2] = -np.inf
    return Program(P, random.normal(size=m) * 3, R, low, high)


def by_enumeration(program: Program) -> Array:
    """Try all sets of held rows: exact, and slow."""
    m, n = len(program.p), len(program.R)
    best, value = np.full(m, np.nan), np.inf
    for size in range(m + 1):
        for rows in itertools.combinations(range(n), size):
            for sides in itertools.product((0, 1), repeat=size):
                bounds = np.array([(program.low, program.high)[s][r] for r, s in zip(rows, sides, strict=True)])
                if not np.all(np.isfinite(bounds)):
                    continue
                A = program.R[list(rows)]
                K = np.block([[program.P, A.T], [A, np.zeros((size, size))]])
                c = np.linalg.solve(K, np.concatenate([program.p, bounds]))[:m]
                worth = 0.5 * c @ program.P @ c - program.p @ c
                if program.excess(c) < 1e-9 and worth < value:
                    best, value = c, worth
    return best


@pytest.mark.parametrize("solver", qpsolvers.available_solvers)
def test_programs_are_solved_exactly(solver: str) -> None:
    random = np.random.default_rng(0)
    held = 0
    for _ in range(30):
        program = random_program(random, 3, 5)
        guess = np.linalg.solve(program.P, program.p)
        answer = program.solve(solver, guess, np.arange(0))
        assert answer is not None
        assert_allclose(answer.c, by_enumeration(program), atol=1e-7)
        held += bool(answer.held.size)
        # the rows that push suffice to find it again
        again = program.solve(solver, guess, answer.held)
        assert again is not None
        assert_allclose(again.c, answer.c, atol=1e-9)
        # wrong rows are not believed
        astray = program.solve(solver, guess, np.array([1, -3]))
        assert astray is not None
        assert_allclose(astray.c, answer.c, atol=1e-7)
    assert held > 15


def test_program_without_an_answer() -> None:
    eye = np.eye(2)
    program = Program(
        eye, np.array([1.0, 0.0]), np.vstack([eye, eye]), np.array([1.0, -9, -9, -9]), np.array([2.0, 9, 0.5, 9])
    )
    assert program.solve("osqp", np.array([1.0, 0.0]), np.arange(0)) is None


@pytest.mark.parametrize("solver", qpsolvers.available_solvers)
def test_solvers_agree(solver: str) -> None:
    robot = ranged_five_bar()
    commands = random_commands(300, 5, 12.0)
    tracked = [
        po.track(
            robot.kinematics, robot.home_configuration, commands, PERIOD,
            po.VelocityTracker(limits=robot.limits, solver=name),
        )
        for name in ("osqp", solver)
    ]  # fmt: skip
    assert_allclose(tracked[0].X, tracked[1].X, atol=1e-8)


# --- Faulty input


def test_faulty_commands() -> None:
    robot = five_bar_robot()
    kinematics, home = robot.kinematics, robot.home_configuration

    def refuse(error: type[Exception], message: str, command: object, **others: object) -> None:
        arguments = {"period": PERIOD, **others}
        with pytest.raises(error, match=message):
            NOTHING.step(kinematics, home, command, **arguments)  # type: ignore[arg-type]

    refuse(po.UnknownNameError, "'why'.*valid names.*'theta1'", {"why": 1.0})
    for bad in (np.nan, np.inf):
        refuse(po.DefinitionError, "command of 'x' is .*finite", {"x": bad, "y": 0.0})
        refuse(po.DefinitionError, "period", {"x": 0.0}, period=bad)
    refuse(po.DefinitionError, "command of 'x'", {"x": "fast"})
    refuse(po.DefinitionError, "by name, or a Twist", [1.0, 2.0])
    refuse(po.DefinitionError, "period", {"x": 0.0}, period=0.0)
    refuse(po.DefinitionError, "velocity before", {"x": 0.0}, velocity=np.full(6, np.nan))
    refuse(po.DefinitionError, "one per variable", {"x": 0.0}, velocity=np.zeros(3))
    refuse(po.UnknownNameError, "'why'", {"x": 0.0}, velocity={"why": 1.0})
    refuse(po.UnknownNameError, "link of a twist 'hand'", po.Twist((0, 0, 0), link="hand"))
    with pytest.raises(po.DefinitionError, match="finite"):
        po.Twist((0, np.nan, 0))
    with pytest.raises(po.DefinitionError, match="shape"):
        po.Twist((0, 0))
    with pytest.raises(po.DefinitionError, match="shapes"):
        po.track(kinematics, home, {"x": [1.0, 2.0], "y": [1.0]}, PERIOD)
    with pytest.raises(po.DefinitionError, match="no step"):
        po.track(kinematics, home, {"x": [], "y": []}, PERIOD)
    with pytest.raises(po.DefinitionError, match="no positions"):
        po.track(kinematics, home, po.Twist(np.zeros((3, 3))), PERIOD, positions=True)


def test_faulty_options() -> None:
    with pytest.raises(po.MissingBackendError, match=r"'simplex'.*installed:.*'osqp'"):
        po.VelocityTracker(solver="simplex")
    with pytest.raises(po.UnknownNameError, match=r"'sideways'.*'parallel', 'serial'"):
        po.VelocityTracker(margins={"sideways": 0.1})
    for faulty in (
        {"damping": 0.0},
        {"gain": np.inf},
        {"buffer": -1.0},
        {"weights": {"x": -1.0}},
        {"margins": {"parallel": 0}},
    ):
        with pytest.raises(po.DefinitionError, match=next(iter(faulty))):
            po.VelocityTracker(**faulty)  # type: ignore[arg-type]
    robot = five_bar_robot()
    for tracker in (
        po.VelocityTracker(weights={"why": 1.0}),
        po.VelocityTracker(limits=po.Limits(velocity={"why": 1.0})),
    ):
        with pytest.raises(po.UnknownNameError, match="'why'"):
            tracker.step(robot.kinematics, robot.home_configuration, {"x": 0.0}, PERIOD)
