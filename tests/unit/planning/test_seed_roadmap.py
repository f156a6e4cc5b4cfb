"""The roadmap: drawn once, asked many times."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import paraopt as po
from motions import problem_of, raf_problem
from paraopt.planning import GrownRoadmap

OPTIONS = po.Roadmap(nodes=150)


@functools.cache
def grown() -> GrownRoadmap:
    return OPTIONS.grow(problem_of("cylinder"))


def test_a_roadmap_answers_other_questions_in_its_scene() -> None:
    scene = problem_of("cylinder").scene
    alone = OPTIONS.seed(problem_of("cylinder"))
    for start, goal in (((-0.06, 0.0, 0.48), (0.06, 0.0, 0.48)), ((-0.06, -0.02, 0.475), (0.055, 0.02, 0.47))):
        ends = [dict(zip("xyz", end, strict=True)) for end in (start, goal)]
        problem = raf_problem(scene=scene, start=ends[0], goal=ends[1])
        seed = grown().seed(problem)
        assert seed.straight_reason.startswith("collision")
        assert len(seed.points) > 2
        assert np.min(scene.clearances(seed.X)[0]) >= problem.margins.clearance
        # only the ways to and from the roadmap, and along it, are judged
        assert seed.checks < 0.6 * alone.checks


def test_what_was_drawn_is_valid_and_joined_both_ways() -> None:
    roadmap = grown()
    assert len(roadmap.spots) > 50
    assert len(roadmap.edges) > len(roadmap.spots)
    assert all(i < j < len(roadmap.spots) for i, j in roadmap.edges)
    X = np.array([spot.X for spot in roadmap.spots])
    assert np.min(roadmap.problem.scene.clearances(X)[0]) >= roadmap.problem.margins.clearance


def test_another_scene_needs_another_roadmap() -> None:
    with pytest.raises(po.DefinitionError, match="drawn for another scene"):
        grown().seed(problem_of("box"))
    scene = problem_of("cylinder").scene
    with pytest.raises(po.DefinitionError, match="drawn for another margins"):
        grown().seed(raf_problem(scene=scene, margins=po.Margins(0.001, 0.01)))


def test_a_roadmap_that_does_not_join_the_ends_says_so() -> None:
    with pytest.raises(po.BudgetExceededError, match="do not join start and goal") as caught:
        po.Roadmap(nodes=2, rounds=1).seed(problem_of("cylinder"))
    assert not isinstance(caught.value, po.InfeasibleError)  # nothing was proved
    assert "reasons" in caught.value.evidence


def test_the_random_seed_decides() -> None:
    one, two = (po.Roadmap(nodes=150, random_seed=k).seed(problem_of("cylinder")) for k in (1, 2))
    assert one.points.shape != two.points.shape or not np.array_equal(one.points, two.points)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"nodes": 0}, "nodes of the search is 0"),
        ({"neighbours": 0}, "neighbours of the search is 0"),
        ({"rounds": 0}, "rounds of the search is 0"),
        ({"step": float("nan")}, "step of the search is nan"),
        ({"resolution": 1.5}, "resolution must not be above 1"),
        ({"cuts": -1}, "cuts not negative"),
    ],
)
def test_faulty_options_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        po.Roadmap(**options)  # type: ignore[arg-type]
