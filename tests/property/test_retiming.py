"""Random smooth paths of four machines under random limits: no limit is exceeded, and no failure is silent.

The fast suite runs some dozens; `make test-all` a thousand.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import BSpline

import paraopt as po
from paraopt.planning import Retimer, TimeLaw

Array = NDArray[np.float64]
ROBOTS = ("five_bar", "three_rpr", "raf", "delta")
EXCESS = 1e-3  # share by which a limit may be exceeded, ten times denser than the retimer's grid
RADIUS = {"five_bar": 0.15, "three_rpr": 0.12, "raf": 0.1, "delta": 0.12}  # of the paths, in characteristic sizes

each_robot = pytest.mark.parametrize("name", ROBOTS)


@pytest.fixture(autouse=True, scope="module")
def compiled() -> Iterator[None]:
    """Four machines, used many times: compiling them pays, other than for the random mechanisms of this folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("PARAOPT_COMPILE", raising=False)
        yield


@functools.cache
def robot_of(name: str) -> po.Robot:
    return getattr(po.robots, name)()


def random_path(name: str, rng: np.random.Generator) -> po.Path:
    """Draw a smooth path around home; one that cannot be closed, or comes near a singularity, is drawn again."""
    robot = robot_of(name)
    kinematics, home = robot.kinematics, robot.home_configuration
    names = robot.mechanism.operational
    index = robot.mechanism.indices(names)
    reach = RADIUS[name] * kinematics.graph.variable_scale[index]
    for _ in range(100):
        count = int(rng.integers(4, 9))
        points = home.X[index] + np.cumsum(rng.uniform(-0.5, 0.5, (count, len(index))), axis=0) * reach
        points -= points[0] - home.X[index]
        knots = np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, count - 2), [1.0] * 3])
        try:
            path = po.Path.along(robot, names, BSpline(knots, points, 3), home.X)
            T = path.points(np.linspace(0.0, 1.0, 101)).T / kinematics.graph.variable_scale[:, None]
        except po.SolveError:
            continue
        if np.max(np.abs(T) * kinematics.graph.variable_scale[index]) < 30.0:
            return path
    raise AssertionError(f"no path of {name} was found in a hundred draws")


def random_limits(path: po.Path, rng: np.random.Generator) -> po.Limits:
    """Draw limits of very different sizes around what a motion of one second would need."""
    active = path.robot.mechanism.active
    size = np.ptp(path(np.linspace(0.0, 1.0, 33))[:, : len(active)], axis=0)
    size = np.maximum(size, 0.1 * np.max(size))

    def draw(decades: float) -> dict[str, float]:
        return dict(zip(active, (size * 10.0 ** rng.uniform(-decades, decades, len(active))).tolist(), strict=True))

    return po.Limits(velocity=draw(0.5), acceleration=draw(1.0), jerk=draw(1.5))


def problem_with(path: po.Path, limits: po.Limits) -> po.Problem:
    robot, names = path.robot, path.robot.mechanism.operational
    ends = path(np.array([0.0, 1.0]))[:, robot.mechanism.indices(names)]
    start, goal = (dict(zip(names, values.tolist(), strict=True)) for values in ends)
    return po.Problem(po.Scene(robot), start, goal, limits=limits)


def largest_share(problem: po.Problem, trajectory: po.Trajectory, jerk: bool) -> float:
    """Look ten times denser than the retimer: stated derivatives, and differences of those below them."""
    active = problem.robot.mechanism.active
    # an odd number, so that the samples fall between those of the retimer's own check too
    t = np.linspace(0.0, trajectory.duration, 10 * 10 * trajectory.n_grid // 3 + 1001)
    state = trajectory.state(t)
    a, step = len(active), float(t[1])
    shares = []
    for quantity, tables in (
        ("velocity", (state.velocity, np.diff(state.X, axis=0) / step)),
        ("acceleration", (state.acceleration, np.diff(state.velocity, axis=0) / step)),
        ("jerk", (np.diff(state.acceleration, axis=0) / step,) if jerk else ()),
    ):
        limit = problem.bounds.of(quantity, active)
        shares += [float(np.max(np.abs(table[:, :a]) / limit)) for table in tables]
    return max(shares)


def check_campaign(name: str, retimer: Retimer, seeds: range) -> None:
    for seed in seeds:
        rng = np.random.default_rng([ROBOTS.index(name), seed])
        path = random_path(name, rng)
        problem = problem_with(path, random_limits(path, rng))
        # smooth paths that never stand still can always be timed: an error would be a failure here
        trajectory = retimer.retime(problem, path)
        share = largest_share(problem, trajectory, retimer.bounds_jerk)
        assert share <= 1.0 + EXCESS, f"{name}, seed {seed}: a limit is exceeded by {100 * (share - 1.0):.3g} %"
        assert share >= 0.97, f"{name}, seed {seed}: only {100 * share:.3g} % of the limits are used"


@each_robot
@pytest.mark.parametrize("retimer", [po.TimeOptimal(), po.JerkLimited()], ids=["time-optimal", "jerk-limited"])
def test_random_paths_stay_within_random_limits(name: str, retimer: Retimer) -> None:
    check_campaign(name, retimer, range(6))


@pytest.mark.slow
@pytest.mark.timeout(3600)
@each_robot
def test_a_thousand_random_paths_stay_within_random_limits(name: str) -> None:
    check_campaign(name, po.TimeOptimal(), range(1000, 1250))
    check_campaign(name, po.JerkLimited(), range(1000, 1250))


@each_robot
@pytest.mark.parametrize("retimer", [po.TimeOptimal(), po.JerkLimited()], ids=["time-optimal", "jerk-limited"])
@pytest.mark.parametrize("factor", [1e-3, 0.3, 7.0, 1e4])
def test_durations_scale_with_the_limits(name: str, retimer: Retimer, factor: float) -> None:
    """Speeds by k, accelerations by k^2, jerks by k^3: the same motion in a k-th of the time."""
    rng = np.random.default_rng([ROBOTS.index(name), 77])
    path = random_path(name, rng)
    limits = random_limits(path, rng)
    scaled = po.Limits(
        **{
            quantity: {n: v * factor**power for n, v in getattr(limits, quantity).items()}
            for power, quantity in enumerate(("velocity", "acceleration", "jerk"), start=1)
        }
    )
    first, second = (retimer.retime(problem_with(path, given), path).duration for given in (limits, scaled))
    # both are solved in scaled units; what differs is round-off of the scales, and toppra's and HiGHS' answers to it
    assert second * factor == pytest.approx(first, rel=1e-3)


@each_robot
def test_durations_do_not_depend_on_the_speed_of_the_parameter(name: str) -> None:
    """A path is its geometry: another parameter gives another law, but the same motion."""
    rng = np.random.default_rng([ROBOTS.index(name), 5])
    path = random_path(name, rng)
    limits = random_limits(path, rng)
    backwards = po.Path.along(
        path.robot,
        path.independent,
        BSpline(1.0 - path.spline.t[::-1], path.spline.c[::-1], 3),
        path(1.0),
    )
    there, back = (po.TimeOptimal(n_grid=400).retime(problem_with(p, limits), p).duration for p in (path, backwards))
    # limits are the same in both directions, so the same motion runs backwards
    assert back == pytest.approx(there, rel=5e-3)


@each_robot
def test_a_law_that_is_too_fast_is_seen(name: str) -> None:
    """The checks of this file can fail: run the same law two percent faster."""
    rng = np.random.default_rng([ROBOTS.index(name), 0])
    path = random_path(name, rng)
    problem = problem_with(path, random_limits(path, rng))
    for retimer in (po.TimeOptimal(), po.JerkLimited()):
        trajectory = retimer.retime(problem, path)
        law: TimeLaw = trajectory.law.stretched(0.98)
        assert largest_share(problem, replace(trajectory, law=law), retimer.bounds_jerk) > 1.0 + EXCESS


def test_the_campaign_is_the_same_every_time() -> None:
    paths = [random_path("five_bar", np.random.default_rng([0, 3])) for _ in range(2)]
    np.testing.assert_array_equal(paths[0].spline.c, paths[1].spline.c)
    assert os.environ.get("PARAOPT_COMPILE") is None
