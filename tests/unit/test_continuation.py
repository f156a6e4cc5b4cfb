"""Continuation: ends that are known in closed form, coarse steps beside folds, and a hundredfold finer reference."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy.optimize
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants
from support import Array, five_bar_robot, raf_robot

COARSE = po.FollowOptions(first_step=1.0, largest_step=1.0, ranges=False)
FREE = po.FollowOptions(ranges=False)
BOTH = pytest.mark.parametrize("options", [FREE, COARSE], ids=["usual", "coarse"])


def five_bar_elbows(theta1: float, theta2: float) -> float:
    """Distance between the elbows of the five-bar 9, 8, 5, 5, 8; 13 where the distal bars are in line."""
    return math.dist((8 * math.cos(theta1), 8 * math.sin(theta1)), (9 + 5 * math.cos(theta2), 5 * math.sin(theta2)))


# --- Folds in closed form


@BOTH
@pytest.mark.parametrize("target", [(-1.0, 1.2), (3.0, 0.2), (2.4, -1.0)])
def test_five_bar_driven_past_the_aligned_distal_bars(target: tuple[float, float], options: po.FollowOptions) -> None:
    robot = five_bar_robot()
    home = robot.home_configuration
    start, end = home.active, np.array(target)

    def excess(s: float) -> float:
        return five_bar_elbows(*(start + s * (end - start))) - 13.0

    grid = np.linspace(0, 1, 2001)
    beyond = grid[np.argmax([excess(s) > 0 for s in grid])]
    assert beyond > 0, "the path must cross the singularity"
    s_singular = scipy.optimize.brentq(excess, beyond - 1 / 2000, beyond, xtol=1e-14)
    followed = po.follow(robot.kinematics, home, dict(zip(("theta1", "theta2"), target, strict=True)), options=options)
    assert followed.reason is po.StopReason.SINGULAR
    found = followed.singularity
    assert found is not None
    assert (found.kind, found.is_fold) == ("parallel", True)
    # sigma^2 is linear in s up to terms of the size of sigma^3 = 1e-15 over the curvature
    assert found.s == pytest.approx(s_singular, abs=1e-9)
    assert found.error < 1e-6
    assert found.distance <= options.singular
    assert set(found.motion.moving) <= {"x", "y", "theta3", "theta4"}
    assert followed.residual < 1e-12
    signs = Determinants.at(robot.kinematics, home).signs(followed.X[:-1])[0]
    assert len(set(signs)) == 1


@BOTH
def test_two_rpr_driven_past_its_base_line(options: po.FollowOptions) -> None:
    robot = po.robots.two_rpr()
    home = robot.home_configuration
    total = home["rho1"] + home["rho2"]
    followed = po.follow(robot.kinematics, home, {"rho1": 5.0, "rho2": 4.0}, options=options)
    assert followed.singularity is not None
    # the legs lie on the base line where their sum is its length, 10
    assert followed.singularity.s == pytest.approx((total - 10) / (total - 9), abs=1e-9)
    assert followed.end["y"] > 0
    twist = followed.singularity.motion.twist
    assert abs(twist[1]) > 1e3 * abs(twist[0])  # the tip moves across the base line


@BOTH
def test_inverse_model_ends_at_the_reach_of_a_leg(options: po.FollowOptions) -> None:
    robot = five_bar_robot()
    home = robot.home_configuration
    followed = po.follow(robot.kinematics, home, {"x": 20.0, "y": 0.0}, options=options)
    assert followed.singularity is not None
    assert followed.singularity.kind == "serial"
    a = np.array([home["x"], home["y"]])
    d = np.array([20.0, 0.0]) - a
    places = []
    for at in (0.0, 9.0):
        w = a - (at, 0)
        roots = np.roots([d @ d, 2 * w @ d, w @ w - 169])
        places += [float(r.real) for r in roots if abs(r.imag) < 1e-12 and 0 < r.real < 1]
    assert followed.singularity.s == pytest.approx(min(places), abs=1e-9)


@BOTH
def test_a_gap_in_the_path_is_not_jumped(options: po.FollowOptions) -> None:
    """The sum of the legs dips below the base between s = 0.49 and 0.51; Newton from end to end does not notice."""
    robot = po.robots.two_rpr()
    kinematics = robot.kinematics
    start = kinematics.forward({"rho1": 6.0, "rho2": 6.0}, robot.home_configuration).configuration

    def path(s: float) -> dict[str, float]:
        half = 5.0 + ((s - 0.5) ** 2 - 1e-4) * 4.0 / (1 - 4e-4)
        return {"rho1": half, "rho2": half}

    assert path(0.0)["rho1"] == pytest.approx(6.0)
    assert kinematics.forward(path(1.0), start).status is po.Status.CONVERGED
    followed = po.follow(kinematics, start, path, options=options)
    assert followed.reason is po.StopReason.SINGULAR
    assert followed.singularity is not None
    assert followed.singularity.s == pytest.approx(0.49, abs=1e-8)


@BOTH
@pytest.mark.parametrize(("lift", "arrives"), [(1e-6, True), (0.0, False)])
def test_a_path_that_grazes_a_fold(lift: float, arrives: bool, options: po.FollowOptions) -> None:
    """The legs' sum touches the base's length at s = 0.5, where both assembly modes meet, or passes just above it."""
    robot = po.robots.two_rpr()
    start = robot.kinematics.forward({"rho1": 6.0, "rho2": 6.0}, robot.home_configuration).configuration

    def path(s: float) -> Array:
        half = 5.0 + lift + (1.0 - lift) * (2 * s - 1) ** 2
        return np.array([half, half])

    followed = po.follow(robot.kinematics, start, path, ("rho1", "rho2"), options)
    assert followed.arrived is arrives
    assert np.all(followed.X[:, robot.mechanism.index("y")] > 0)
    if arrives:
        assert_allclose(followed.X[-1], start.X, atol=1e-8)
    else:
        assert followed.singularity is not None
        assert followed.singularity.s == pytest.approx(0.5, abs=1e-4)


# --- Random paths against a hundredfold finer reference


def reference(kinematics: po.Kinematics, starts: Array, targets: Array, steps: int) -> tuple[Array, Array, Array]:
    """Follow straight paths of the drives in many equal steps; stop where Newton fails, leaps or changes the sign."""
    names = kinematics.mechanism.active
    determinants = Determinants.at(kinematics, po.Configuration(kinematics.mechanism, starts[0], 0.0))
    X, before, origin = starts.copy(), starts.copy(), starts[:, : len(names)].copy()
    alive, stop, sign = np.ones(len(X), dtype=bool), np.ones(len(X)), determinants.signs(starts)[0]
    for i in range(1, steps + 1):
        a = np.flatnonzero(alive)
        values = origin[a] + (targets[a] - origin[a]) * (i / steps)
        solved = kinematics.solve_batch(names, values, 2 * X[a] - before[a])
        leap = np.max(np.abs(solved.X - X[a]) / kinematics.graph.variable_scale, axis=1)
        lost = ~solved.converged | (determinants.signs(solved.X)[0] != sign[a]) | (leap > 0.1)
        before[a] = X[a]
        X[a[~lost]] = solved.X[~lost]
        alive[a[lost]], stop[a[lost]] = False, (i - 1) / steps
    return X, alive, stop


def random_paths(count: int, seed: int) -> tuple[po.Kinematics, list[po.Configuration], Array]:
    """Draw regular poses of the 3-RPR and leg lengths to drive to."""
    robot = po.robots.three_rpr_innocenti()
    kinematics, random = robot.kinematics, np.random.default_rng(seed)
    determinants = Determinants.at(kinematics, robot.home_configuration)
    starts: list[po.Configuration] = []
    while len(starts) < count:
        pose = {"x": random.uniform(-20, 20), "y": random.uniform(-20, 20), "theta": random.uniform(-np.pi, np.pi)}
        solution = kinematics.inverse(pose, start={**robot.home_configuration.as_dict(), **pose})
        legs = solution.X[:3]
        regular = abs(float(determinants(solution.X)[0][0])) > 0.02
        if solution.status is po.Status.CONVERGED and np.all((legs > 10) & (legs < 32)) and regular:
            starts.append(solution.configuration)
    return kinematics, starts, random.uniform(10, 32, size=(count, 3))


def compare_with_reference(count: int, seed: int, options: po.FollowOptions) -> None:
    kinematics, starts, targets = random_paths(count, seed)
    steps = 4000  # the usual continuation takes some forty
    X, alive, stop = reference(kinematics, np.array([c.X for c in starts]), targets, steps)
    assert 0.2 * count < np.count_nonzero(alive) < 0.8 * count  # both outcomes are common
    for k, start in enumerate(starts):
        followed = po.follow(
            kinematics, start, dict(zip(("rho1", "rho2", "rho3"), targets[k], strict=True)), options=options
        )
        assert followed.arrived == alive[k], (k, str(followed), stop[k])
        if alive[k]:
            assert_allclose(followed.X[-1], X[k], atol=1e-7)
        else:
            assert followed.reason is po.StopReason.SINGULAR
            assert followed.singularity is not None
            assert followed.singularity.s == pytest.approx(stop[k], abs=1.5 / steps)


@BOTH
def test_random_paths_of_the_three_rpr(options: po.FollowOptions) -> None:
    compare_with_reference(30, 1, options)


@pytest.mark.slow
@BOTH
def test_many_random_paths_of_the_three_rpr(options: po.FollowOptions) -> None:
    compare_with_reference(400, 2, options)


def test_a_step_without_tests_does_jump() -> None:
    """Show that the tests matter: Newton from start to end finds another branch where that of the start has ended."""
    kinematics, starts, targets = random_paths(60, 1)
    _, alive, _ = reference(kinematics, np.array([c.X for c in starts]), targets, 1000)
    names = kinematics.mechanism.active
    naive = kinematics.solve_batch(names, targets, np.array([c.X for c in starts]))
    assert np.any(~alive & naive.converged)


# --- Any imposed set


@pytest.mark.parametrize("imposed", [("x", "y"), ("theta1", "theta2"), ("theta1", "x"), ("theta4", "y")])
def test_any_two_variables_of_the_five_bar(imposed: tuple[str, str]) -> None:
    robot = five_bar_robot()
    kinematics, home = robot.kinematics, robot.home_configuration
    target = kinematics.inverse({"x": home["x"] - 0.5, "y": home["y"] + 0.4}, home).configuration
    followed = po.follow(kinematics, home, {name: target[name] for name in imposed})
    assert followed.arrived, str(followed)
    assert_allclose(followed.end.X, target.X, atol=1e-9)
    assert followed.undetermined == 0


def test_redundant_equations_and_idle_spins() -> None:
    robot = raf_robot()
    kinematics, home = robot.kinematics, robot.home_configuration
    there = po.follow(kinematics, home, {"x": 0.05, "y": 0.02, "z": 0.5})
    assert there.arrived, str(there)
    back = po.follow(kinematics, there.end, {q: home[q] for q in ("q1", "q2", "q3")})
    assert back.arrived, str(back)
    assert_allclose(back.end.X, home.X, atol=1e-8)
    spins = kinematics.mechanism.indices(kinematics.idle)
    assert len(spins) == 3
    assert_allclose(there.X[:, spins], np.tile(home.X[spins], (len(there.X), 1)), atol=0)


def test_free_motions_are_counted_and_the_least_is_followed() -> None:
    robot = five_bar_robot()
    followed = po.follow(robot.kinematics, robot.home_configuration, {"x": 6.5})
    assert followed.arrived
    assert followed.undetermined == 1
    assert followed.end["x"] == pytest.approx(6.5, abs=1e-12)


def test_waypoints_are_met() -> None:
    robot = five_bar_robot()
    home = robot.home_configuration
    followed = po.follow(robot.kinematics, home, {"x": [6.5, 6.5, 6.0], "y": [7.0, 6.5, 7.0]})
    assert followed.arrived
    assert_allclose(followed.end.X, home.X, atol=1e-9)
    for s, x, y in ((1 / 3, 6.5, 7.0), (2 / 3, 6.5, 6.5)):
        k = int(np.argmin(np.abs(followed.s - s)))
        assert followed.s[k] == pytest.approx(s, abs=1e-15)
        assert_allclose(followed.X[k, robot.mechanism.indices(("x", "y"))], (x, y), atol=1e-12)


def test_history_is_consistent() -> None:
    robot = five_bar_robot()
    followed = po.follow(robot.kinematics, robot.home_configuration, {"x": 5.0, "y": 6.0})
    assert np.all(np.diff(followed.s) > 0)
    assert len(followed.s) == len(followed.X) == len(followed.margins) == len(followed.changes)
    assert np.all(followed.changes <= po.FollowOptions().contraction)
    assert_allclose(robot.kinematics.scaled_residual(followed.X), 0, atol=1e-12)
    again = po.follow(robot.kinematics, robot.home_configuration, {"x": 5.0, "y": 6.0})
    assert np.array_equal(again.X, followed.X)
    assert [c["x"] for c in followed.configurations] == followed.X[:, robot.mechanism.index("x")].tolist()


# --- Other ends


def test_joint_range_is_met_exactly() -> None:
    robot = po.robots.two_rpr(strokes=(6.0, 11.0))
    home = robot.home_configuration
    followed = po.follow(robot.kinematics, home, {"x": home["x"], "y": 30.0})
    assert followed.reason is po.StopReason.RANGE
    assert followed.limit == "rho1"  # the tip is nearer to the second hinge
    assert followed.end["rho1"] == pytest.approx(11.0, abs=1e-7)
    assert followed.end["y"] == pytest.approx(math.sqrt(121 - home["x"] ** 2), abs=1e-7)
    assert "'rho1' is 11 m, its range (6, 11) m" in followed.detail
    again = po.follow(robot.kinematics, followed.end, {"x": home["x"], "y": 30.0})
    assert (again.reason, again.limit) == (po.StopReason.RANGE, "rho1")
    assert again.s[-1] < 1e-6
    back = po.follow(robot.kinematics, followed.end, {"x": home["x"], "y": home["y"]})
    assert back.arrived


def test_path_that_is_not_finite() -> None:
    robot = five_bar_robot()
    home = robot.home_configuration

    def path(s: float) -> dict[str, float]:
        return {"x": home["x"] + s, "y": home["y"] if s <= 0.25 else np.nan}

    followed = po.follow(robot.kinematics, home, path)
    assert followed.reason is po.StopReason.NOT_FINITE
    assert followed.s[-1] == pytest.approx(0.25, abs=1e-12)
    everywhere = po.follow(robot.kinematics, home, lambda s: {"x": np.inf, "y": 0.0})
    assert (everywhere.reason, len(everywhere.s)) == (po.StopReason.NOT_FINITE, 1)
    assert po.follow(robot.kinematics, home, {"x": np.nan, "y": 0.0}).reason is po.StopReason.NOT_FINITE


def test_path_that_leaps() -> None:
    robot = five_bar_robot()
    home = robot.home_configuration
    followed = po.follow(robot.kinematics, home, lambda s: {"x": home["x"] + (s > 0.3) * 3.0, "y": home["y"]})
    assert followed.reason is po.StopReason.STEP
    assert followed.s[-1] == pytest.approx(0.3, abs=1e-12)


def test_more_variables_than_motions() -> None:
    """Four drives turn the wrist's three motions: only values that agree can be followed."""
    robot = po.robots.hayward_wrist()
    kinematics, home = robot.kinematics, robot.home_configuration
    drives = robot.mechanism.active

    def agreeing(s: float) -> Array:
        return kinematics.inverse({"alpha": 0.2 * s, "beta": 0.1 * s, "gamma": 0.3 * s}, home).configuration.active

    followed = po.follow(kinematics, home, agreeing, drives)
    assert followed.arrived, str(followed)
    assert followed.end["gamma"] == pytest.approx(0.3, abs=1e-9)
    straight = po.follow(kinematics, home, dict(zip(drives, agreeing(1.0), strict=True)))
    assert straight.reason is po.StopReason.CONTRADICTION
    assert "1 relation(s) upon q1, q2, q3, q4" in straight.detail


def test_start_at_a_singularity() -> None:
    robot = po.robots.two_rpr()
    kinematics = robot.kinematics
    start = kinematics.inverse({"x": 5.0, "y": 0.0}, {"rho1": 5, "rho2": 5, "phi2": np.pi}).configuration
    followed = po.follow(kinematics, start, {"rho1": 6.0, "rho2": 6.0}, options=FREE)
    assert followed.reason is po.StopReason.SINGULAR
    assert len(followed.s) == 1
    # the inverse model is regular there
    assert po.follow(kinematics, start, {"x": 5.0, "y": 3.0}, options=FREE).arrived


def bad_paths() -> list[tuple[object, tuple[str, ...] | None, type[Exception], str]]:
    constant: Callable[[float], Array] = lambda s: np.array([6.0, 7.0])  # noqa: E731
    return [
        ({"x": 1.0, "why": 2.0}, None, po.UnknownNameError, "'why'"),
        ({}, None, po.DefinitionError, "imposes nothing"),
        ({"x": [1.0, 2.0], "y": [1.0]}, None, po.DefinitionError, "as many as the others"),
        ({"x": "far", "y": 1.0}, None, po.DefinitionError, "must be numbers"),
        (constant, None, po.DefinitionError, "without names"),
        (constant, ("x", "x"), po.DefinitionError, "doubled"),
        (constant, ("x",), po.DefinitionError, "shape"),
        (constant, ("x", "theta1"), po.DefinitionError, "begin the path at the start"),
        (lambda s: {"x": 6.0, "y": 8.0}, None, po.DefinitionError, "begins with 'y' = 8"),
        (3.0, None, po.DefinitionError, "function of s"),
    ]


@pytest.mark.parametrize(("path", "names", "error", "message"), bad_paths())
def test_malformed_paths(path: object, names: tuple[str, ...] | None, error: type[Exception], message: str) -> None:
    robot = five_bar_robot()
    with pytest.raises(error, match=message):
        po.follow(robot.kinematics, robot.home_configuration, path, names)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "faulty", [{"first_step": 0.0}, {"contraction": 1.0}, {"singular": -1.0}, {"turn": np.nan}, {"prediction": 2.0}]
)
def test_faulty_options(faulty: dict[str, float]) -> None:
    with pytest.raises(po.DefinitionError, match=next(iter(faulty))):
        po.FollowOptions(**faulty)  # type: ignore[arg-type]
