"""What seeders walk on: lines looked at between their positions, full turns, and polylines that get shorter."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import paraopt as po
from motions import problem_of, turning_problem
from paraopt.planning import Validity
from paraopt.planning.ground import Ground, Spot
from support import five_bar_robot


def ground_of(problem: po.Problem, spacing: float, max_checks: int = 10**6) -> Ground:
    return Ground(problem, Validity(problem), spacing, max_checks)


def grazing_problem(width: float) -> po.Problem:
    """Put a thin plate across the way of a small tool, between two of the positions that are checked first."""
    robot = replace(five_bar_robot(), shapes={"tip": [po.Sphere(name="tool", radius=0.05)]})
    plate = po.Box(name="plate", size=(width, 2.0, 1.0), pose=po.transform((6.125, 7.0, 0.0)))
    ends = {"x": 5.5, "y": 7.0}, {"x": 6.5, "y": 7.0}
    return po.Problem(po.Scene(robot, [plate]), *ends, margins=po.Margins(0.01, 0.01))


def test_what_lies_between_the_positions_is_seen() -> None:
    # positions every 0.25 m; the plate, the tool and the margin take 0.16 m between two of them
    problem = grazing_problem(0.04)
    ground = ground_of(problem, 0.25)
    end = np.array([6.5, 7.0])
    assert ground.edge(ground.origin, end, fine=False)[0] == "valid"
    reason, spot = ground.edge(ground.origin, end)
    assert reason == "collision tool / plate"
    assert spot is None


def test_a_line_that_keeps_away_is_not_divided() -> None:
    problem = problem_of("free")
    ground = ground_of(problem, 0.003)
    reason, last = ground.edge(ground.origin, problem.goal_values())
    assert reason == "valid"
    assert last is not None
    # the ends were not judged, and 40 positions were: the distance of 0.12 m in steps of 3 mm
    assert ground.validity.checks == 40


def test_a_blocked_line_tells_how_far_it_is_valid() -> None:
    problem = problem_of("cylinder")
    ground = ground_of(problem, 0.003)
    chain, reason, where = ground.advance(ground.origin, problem.goal_values())
    assert reason == "collision tool / cylinder"
    assert where is not None
    # tool 12 mm, cylinder 30 mm, margin 5 mm: valid up to x = -47 mm
    assert chain[-1].value[0] <= -0.047 < where[0] <= chain[-1].value[0] + 0.003 + 1e-12


def test_many_lines_are_checked_as_one_is() -> None:
    problem = problem_of("cylinder")
    ground = ground_of(problem, 0.004)
    values = np.array([[-0.05, y, 0.48] for y in (-0.06, 0.0, 0.06)] + [[0.05, y, 0.48] for y in (-0.06, 0.06)])
    spots, _ = ground.place(values, [ground.origin] * len(values))
    known = [spot for spot in spots if spot is not None]
    assert len(known) == len(values)
    pairs = [(a, b) for a in known for b in known if a is not b]
    alone = [ground.edge(a, b.value, fine=False)[1] is not None for a, b in pairs]
    assert ground.lines(pairs) == alone
    assert True in alone
    assert False in alone


def test_another_solution_at_the_end_of_a_line_does_not_count() -> None:
    problem = problem_of("free")
    ground = ground_of(problem, 0.01)
    X = ground.goal.X.copy()
    X[problem.robot.mechanism.index("arm A")] += 0.1
    other = Spot(ground.goal.value, X, ground.goal.T)
    assert ground.lines([(ground.origin, ground.goal), (ground.origin, other)]) == [True, False]


def test_full_turns_are_taken_the_short_way_and_bounded() -> None:
    ground = ground_of(turning_problem(False), 0.01)
    goal = np.array([0.1, 0.2, -3.0])
    np.testing.assert_allclose(ground.unwrap(np.array([0.0, 0.0, 3.0]), goal), [0.1, 0.2, 2 * np.pi - 3.0])
    np.testing.assert_array_equal(ground.unwrap(np.array([0.0, 0.0, -2.0]), goal), goal)
    # the ends are at 3 and 2 pi - 3; one turn beyond them is looked at, and no more
    low, high = ground.problem.turn_bounds
    for here in (-40.0, -3.0, 0.0, 9.0, 40.0):
        value = ground.toward(np.array([0.0, 0.0, here]), goal)[2]
        assert (value - goal[2]) / (2 * np.pi) == pytest.approx(round((value - goal[2]) / (2 * np.pi)), abs=1e-12)
        if abs(here) < 10:
            assert low[2] <= value <= high[2]
    assert np.isinf(low[0])
    assert high[2] - low[2] == pytest.approx(2 * np.pi - 6.0 + 4 * np.pi)


def test_straightening_never_makes_a_way_longer_and_keeps_its_ends() -> None:
    problem = problem_of("cylinder")
    seed = po.MixedSearch(cuts=0).seed(problem)
    ground = ground_of(problem, 0.003)
    spots = ground.walk(ground.origin, list(seed.points[1:]))
    assert isinstance(spots, list)
    lengths = [ground.length_of(ground.straighten(spots, cuts)) for cuts in range(4)]
    assert lengths[0] <= seed.length + 1e-12
    assert all(b <= a + 1e-12 for a, b in itertools.pairwise(lengths))
    assert lengths[-1] < 0.97 * lengths[0]
    assert lengths[-1] >= 0.1592  # the shortest known
    best = ground.straighten(spots, 3)
    np.testing.assert_array_equal(best[0].value, seed.points[0])
    np.testing.assert_array_equal(best[-1].value, seed.points[-1])


def test_a_way_that_is_known_survives_the_end_of_the_budget() -> None:
    problem = problem_of("cylinder")
    seed = po.MixedSearch(cuts=0).seed(problem)
    ground = ground_of(problem, 0.003)
    spots = ground.walk(ground.origin, list(seed.points[1:]))
    assert isinstance(spots, list)
    ground.max_checks = ground.validity.checks
    assert ground.straighten(spots, 3) is spots


def test_a_blocked_way_tells_its_edge() -> None:
    problem = problem_of("cylinder")
    ground = ground_of(problem, 0.003)
    aside = np.array([-0.06, 0.01, 0.48])
    assert ground.walk(ground.origin, [aside, problem.goal_values()]) == (1, "collision tool / cylinder")
