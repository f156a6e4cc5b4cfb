"""Several seeders in turn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

import paraopt as po
from motions import problem_of, raf_problem
from paraopt.pipeline import choose_seeder


@dataclass(frozen=True)
class Failing:
    """Fail in a chosen way, and note that it was asked."""

    error: po.ParaoptError
    asked: list[po.Problem] = field(default_factory=list)

    def seed(self, problem: po.Problem) -> po.Seed:
        self.asked.append(problem)
        raise self.error


NO_PATH = po.NoPathError("no path at a step of 1 mm", step=1e-3)
SPENT = po.BudgetExceededError("the search judged 7 poses", checks=7)


def test_the_first_that_finds_a_way_gives_it() -> None:
    last = Failing(NO_PATH)
    seed = po.FirstSuccess((Failing(SPENT), Failing(NO_PATH), po.MixedSearch(), last)).seed(problem_of("cylinder"))
    np.testing.assert_array_equal(seed.points, po.MixedSearch().seed(problem_of("cylinder")).points)
    assert not last.asked


def test_that_there_is_no_path_weighs_more_than_a_spent_budget() -> None:
    with pytest.raises(po.NoPathError, match=r"none of 2 seeders .* no path at a step .* judged 7 poses") as caught:
        po.FirstSuccess((Failing(NO_PATH), Failing(SPENT))).seed(problem_of("cylinder"))
    assert caught.value.evidence["failures"] == (NO_PATH, SPENT)
    assert caught.value.evidence["step"] == 1e-3
    with pytest.raises(po.BudgetExceededError, match="none of 2 seeders"):
        po.FirstSuccess((Failing(SPENT), Failing(SPENT))).seed(problem_of("cylinder"))


def test_a_problem_without_a_solution_is_not_asked_again() -> None:
    second = Failing(NO_PATH)
    problem = raf_problem("cylinder", start={"x": 0.0, "y": 0.0, "z": 0.48})
    with pytest.raises(po.InfeasibleError, match="start is in collision"):
        po.FirstSuccess((po.MixedSearch(), second)).seed(problem)
    assert not second.asked


def test_no_seeder_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="no seeder"):
        po.FirstSuccess(())


def test_the_number_of_coordinates_chooses_the_seeder() -> None:
    assert choose_seeder(problem_of("free")) == po.MixedSearch()
    changing = choose_seeder(raf_problem(allow_mode_change=True))
    assert isinstance(changing, po.FirstSuccess)
    assert changing.seeders[0] == po.MixedSearch()
    robot = po.robots.stewart()
    home = robot.home_configuration
    many = choose_seeder(po.Problem(po.Scene(robot), home, home))
    assert isinstance(many, po.FirstSuccess)
    assert [type(s) for s in many.seeders] == [po.MixedSearch, po.RRTConnect]
