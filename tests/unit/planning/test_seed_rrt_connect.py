"""RRT-Connect: two trees, the same at every run of one seed of the random numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import paraopt as po
from motions import problem_of, turning_problem


def stewart_problem() -> po.Problem:
    """Let a pin on the platform meet a post that hangs between start and goal."""
    robot = po.robots.stewart()
    pin = po.Cylinder.between((0, 0, 0), (0, 0, 0.25), 0.02, "tool")
    robot = replace(robot, shapes={"platform": [pin]})
    post = po.Cylinder.between((0, 0, 0.78), (0, 0, 2.0), 0.03, "post")
    names = robot.mechanism.operational
    ends = (dict(zip(names, (x, 0.0, 0.6, 0.0, x, 2 * x), strict=True)) for x in (-0.12, 0.12))
    return po.Problem(po.Scene(robot, [post]), *ends)


def test_the_random_seed_decides() -> None:
    one, two = (po.RRTConnect(random_seed=k).seed(problem_of("cylinder")) for k in (1, 2))
    assert one.points.shape != two.points.shape or not np.array_equal(one.points, two.points)


def test_six_coordinates_are_searched() -> None:
    seed = po.RRTConnect().seed(stewart_problem())
    assert seed.straight_reason == "collision tool / post"
    assert seed.points.shape[1] == 6
    walk = seed.at(np.linspace(0.0, 1.0, 400))
    X = np.repeat(seed.X[:1], 1, axis=0)
    for values in walk:
        X = np.vstack([X, seed.problem.robot.kinematics.solve_batch(seed.problem.independent, values[None], X[-1:]).X])
    assert np.min(seed.problem.scene.clearances(X)[0]) >= seed.problem.margins.clearance - 1e-9


def test_trees_meet_across_half_a_turn() -> None:
    theta = po.RRTConnect().seed(turning_problem(True)).points[:, 2]
    assert theta[0] == 3.0
    assert theta[-1] == pytest.approx(2 * np.pi - 3.0, abs=1e-15)


@pytest.mark.parametrize("budget", [1, 60, 150])
def test_an_exhausted_budget_is_told(budget: int) -> None:
    with pytest.raises(po.BudgetExceededError, match="raise max_checks"):
        po.RRTConnect(max_checks=budget).seed(problem_of("cylinder"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 0.0}, "step of the search is 0.0"),
        ({"resolution": -0.1}, "resolution of the search is -0.1"),
        ({"resolution": 2.0}, "resolution must not be above 1"),
        ({"max_checks": 0}, "max_checks of the search is 0"),
        ({"cuts": -1}, "cuts not negative"),
    ],
)
def test_faulty_options_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        po.RRTConnect(**options)  # type: ignore[arg-type]
