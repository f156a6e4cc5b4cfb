"""Motions with locked variables, in chosen coordinates, under conditions of any kind."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from motions import raf_problem
from paraopt.planning.validity import Validity, check_ends

Array = np.ndarray
FOOT = tuple(f"foot 1 {c}" for c in ("x", "y", "z", "alpha", "beta", "gamma"))
LOCKED = ("q1 1", "q2 1", "q3 1", "q6 1", "q1 2", "q1 3")


# --- Locked variables: the swing of a tripod's foot, Tripod, in the corrected form of models.md §7


@functools.cache
def swing() -> po.Problem:
    robot = po.robots.tripod(free_feet=True)
    pose = {**{name: robot.home[name] for name in robot.mechanism.operational}, "beta": 0.3}
    start = robot.kinematics.inverse(pose, robot.home_configuration).configuration
    standing = [n for n in robot.mechanism.operational if n.startswith(("foot 2", "foot 3"))]
    return po.Problem(
        po.Scene(robot),
        start,
        {**{name: start[name] for name in FOOT}, "foot 1 x": start["foot 1 x"] + 0.08},
        margins=po.Margins(clearance=0.0, singularity=0.01),
        coordinates=FOOT,
        held=(*LOCKED, *standing),
    )


@functools.cache
def swung() -> po.Plan:
    return po.plan(swing())


def test_a_swing_with_locked_joints_ends_where_the_source_says() -> None:
    """Locks and standing feet held, the foot is the coordinate: platform and actuators follow."""
    plan = swung()
    assert plan.certificate.passed
    end = plan.trajectory.at(plan.trajectory.duration)
    assert_allclose([end[n] for n in ("x", "y", "z")], [0.051411, 0.0, 0.383487], rtol=0, atol=1e-6)
    assert_allclose([end[n] for n in ("alpha", "beta", "gamma")], [0.0, 0.3, 0.0], rtol=0, atol=1e-6)


def test_held_variables_stay_to_the_last_bit_and_the_loops_closed() -> None:
    plan, problem = swung(), swing()
    index = problem.robot.mechanism.indices(problem.held)
    X = plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 200))
    assert np.all(X[:, index] == problem.start_configuration.X[index])
    assert plan.certificate["held variables move"].value == 0.0
    assert np.max(problem.robot.kinematics.scaled_residual(X)) < 1e-11


def test_margins_are_those_of_the_columns_that_are_solved_for() -> None:
    """By their meaning: with locks and feet held, the actuators' rates amplify into motions by at most 1 / margin."""
    problem = swing()
    X = problem.start_configuration.X[None]
    mechanism, kinematics = problem.robot.mechanism, problem.robot.kinematics
    (E,) = kinematics.functions.scaled_jacobian(X[0])
    free = [i for i, n in enumerate(mechanism.names) if n not in problem.held]
    V = np.zeros((E.shape[1], 6))
    V[free] = np.linalg.svd(E[:, free])[2][-6:].T
    wanted = [
        np.linalg.svd(V[mechanism.indices(names)], compute_uv=False)[-1] for names in (mechanism.active, list(FOOT))
    ]
    margins = problem.space.margins(X)
    assert_allclose([margins.parallel[0], margins.serial[0]], wanted, rtol=1e-9)


def test_a_level_tripod_cannot_be_locked() -> None:
    """It slides along a leg with all locks unchanged: the foot does not determine it."""
    robot = swing().robot
    problem = replace(swing(), start=robot.home_configuration, goal={n: robot.home_configuration[n] for n in FOOT})
    with pytest.raises(po.InfeasibleError, match=r"start is too near a singularity: .*serial margin 0\.0000"):
        check_ends(problem, Validity(problem))


def test_a_moved_lock_is_not_certified() -> None:
    class Slipping:
        duration = swung().trajectory.duration

        def __call__(self, t: Any, order: int = 0) -> Array:
            value = swung().trajectory(t, order)
            shift = np.zeros(value.shape[-1])
            shift[swing().robot.mechanism.index("q1 2")] = 2e-9
            return value + shift * (order == 0) * (np.asarray(t) > 0.1)[..., None]

    check = po.verify(swing(), Slipping())["held variables move"]
    assert not check.passed
    assert check.where == "q1 2"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"held": ("nothing",)}, "held variable of the problem 'nothing'"),
        ({"coordinates": ("foot 9 x",)}, "coordinate of the problem 'foot 9 x'"),
        ({"coordinates": ()}, "coordinates of the problem are empty"),
        ({"held": (FOOT[0],)}, "'foot 1 x' is held, but start and goal are stated in it"),
        ({"held": (*LOCKED, LOCKED[0])}, "held variable 'q1 1' appears twice"),
        ({"held": "q1 1"}, "held of the problem are 'q1 1'; they must be a sequence"),
        ({"goal": {"x": 0.0}}, "goal must state"),
    ],
)
def test_names_that_do_not_fit_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        replace(swing(), **changes)


def test_too_few_held_variables_are_told() -> None:
    problem, words = replace(swing(), held=swing().held[1:]), "7 useful degrees of freedom .* 17 variables held, but 6 "
    with pytest.raises(po.DefinitionError, match=words):
        check_ends(problem, Validity(problem))


def test_a_goal_that_moves_a_held_variable_is_refused() -> None:
    robot = swing().robot
    with pytest.raises(po.DefinitionError, match=r"'q6 1' is held, but it is .* at the start and .* at the goal"):
        replace(swing(), goal=robot.home_configuration)


# --- Conditions that compute their own quantities


class Outside:
    """Keep the platform's centre out of a ball: 1 is one radius."""

    names = ("distance from the ball",)
    lower = np.array([0.0])

    def __init__(self, robot: po.Robot, centre: Sequence[float], radius: float) -> None:
        self.index, self.centre, self.radius = robot.mechanism.indices(("x", "y", "z")), np.array(centre), radius

    def values(self, X: Array) -> Array:
        gap = np.linalg.norm(X[:, self.index] - self.centre, axis=1)
        return np.asarray(gap / self.radius - 1.0)[:, None]

    def gradients(self, X: Array, T: Array) -> tuple[Array, Array]:
        away = X[:, self.index] - self.centre
        along = away / np.linalg.norm(away, axis=1)[:, None] / self.radius
        return self.values(X), np.einsum("nc,ncm->nm", along, T[:, self.index])[:, None, :]


def blocked() -> po.Problem:
    """The straight motion of the RAF runs through the ball."""
    problem = raf_problem("free")
    ends = (problem.start_configuration.X, problem.goal_configuration.X)
    index = problem.robot.mechanism.indices(("x", "y", "z"))
    middle = 0.5 * (ends[0] + ends[1])[index] + np.array([0.0, 0.002, 0.0])
    return replace(problem, conditions=(Outside(problem.robot, middle, 0.02),))


def test_seed_refinement_and_certificate_keep_a_condition() -> None:
    problem = blocked()
    plan = po.plan(problem)
    assert plan.seed.straight_reason == "condition distance from the ball"
    check = plan.certificate["distance from the ball"]
    assert check.passed
    assert 0.0 <= check.value < 0.2, "the shortest way passes near the ball"
    assert plan.refined.length < plan.seed.length
    assert np.min(problem.conditions[0].values(plan.trajectory(np.linspace(0, plan.trajectory.duration, 999)))) >= -1e-6


def test_an_expression_is_the_same_condition() -> None:
    problem = blocked()
    ball = problem.conditions[0]

    def distance(value: Any, pose: Any) -> Any:
        gap = [value[name] - float(c) for name, c in zip(("x", "y", "z"), ball.centre, strict=True)]
        return (gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2) ** 0.5

    bound = po.PathBound("distance from the ball", distance, lower=ball.radius, scale=ball.radius)
    ours, theirs = po.plan(problem), po.plan(replace(problem, conditions=(bound,)))
    assert theirs.certificate["distance from the ball"].value >= ball.radius * (1 - 1e-6)
    assert_allclose(theirs.refined.length, ours.refined.length, rtol=2e-3)


def test_a_motion_through_the_ball_is_not_certified() -> None:
    through = po.plan(replace(blocked(), conditions=()))
    check = po.verify(blocked(), through.trajectory)["distance from the ball"]
    assert not check.passed
    assert check.value < -0.8


def test_a_start_that_breaks_a_condition_is_refused_with_its_value() -> None:
    problem = blocked()
    index = problem.robot.mechanism.indices(("x", "y", "z"))
    at = problem.start_configuration.X[index]
    inside = replace(problem, conditions=(Outside(problem.robot, at + 1e-3, 0.02),))
    with pytest.raises(po.InfeasibleError, match=r"start breaks the condition 'distance from the ball': -0\.9"):
        check_ends(inside, Validity(inside))
