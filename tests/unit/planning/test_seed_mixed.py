"""The mixed depth/breadth search: its grid, its modes, its budget and its refusals.

Source: models.md, 9 (Lahouar, III.1).
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import paraopt as po
from motions import CLEARANCE, GOAL, START, plan_of, problem_of, raf_problem, turning_problem
from support import raf_robot


def _wall(problem: po.Problem, bottom: float) -> po.Problem:
    """Hang a wall as wide as the whole reach across the way."""
    wall = po.Box(name="wall", size=(0.02, 2.0, 0.6), pose=po.transform((0.0, 0.0, bottom + 0.3)))
    return po.Problem(po.Scene(problem.robot, [wall]), START, GOAL, margins=problem.margins)


# --- Free


@pytest.mark.parametrize("problem", [problem_of("free"), turning_problem(False)], ids=["raf", "3-RPR"])
def test_a_free_motion_needs_no_search(problem: po.Problem) -> None:
    seed = po.MixedSearch().seed(problem)
    assert len(seed.points) == 2
    assert seed.straight_reason == "valid"
    assert len(seed.explored) == len(seed.blocked) == len(seed.switches) == 0
    # both ends, and the straight line: five checks for each of the eight or ten steps
    assert 2 < seed.checks < 100


def test_the_distance_divided_tells_the_default_step() -> None:
    seed = plan_of("cylinder").seed
    assert 0.12 / 12 <= seed.step <= 0.12 / 6


# --- Blocked


@pytest.mark.parametrize("task", ["cylinder", "box"])
def test_positions_lie_on_the_grid_of_the_start(task: str) -> None:
    seed = plan_of(task).seed
    for positions in (seed.explored, seed.blocked, seed.switches):
        steps = (positions - seed.points[0]) / seed.step
        # a few units in the last place of the coordinates, over the step
        assert np.max(np.abs(steps - np.round(steps))) < 1e-12


@pytest.mark.parametrize("task", ["cylinder", "box"])
def test_what_was_explored_was_not_blocked(task: str) -> None:
    seed = plan_of(task).seed

    def nodes(positions: np.ndarray) -> set[tuple[int, ...]]:
        return {tuple(row) for row in np.round((positions - seed.points[0]) / seed.step).astype(int).tolist()}

    assert len(seed.explored) > 0
    assert len(seed.blocked) > 0
    free, taken = nodes(seed.explored), nodes(seed.blocked)
    # a node may be judged again when a part of the way is planned again; at exactly the margin, as at nodes level with
    # the cylinder's lower face, round-off then decides
    for node in free & taken:
        pose = dict(zip("xyz", (seed.points[0] + seed.step * np.array(node)).tolist(), strict=True))
        configuration = raf_robot().kinematics.inverse(pose, start=seed.problem.start_configuration).configuration
        assert abs(seed.problem.scene.clearance(configuration).distance - CLEARANCE) < 1e-9
    assert nodes(seed.switches) <= free | {(0, 0, 0)}
    # the boundary is followed, the space is not filled: breadth looks only beside what is blocked
    touching = sum(
        any(tuple(np.add(node, move)) in taken for move in itertools.product((-1, 0, 1), repeat=3)) for node in free
    )
    assert touching > 0.5 * len(free)


@pytest.mark.parametrize("task", ["cylinder", "box"])
def test_the_mode_switches_where_the_way_meets_and_leaves_the_obstacle(task: str) -> None:
    switches = plan_of(task).seed.switches
    assert len(switches) >= 2
    # first by depth towards the goal, then in breadth beside the obstacle, then free again
    assert switches[0, 0] < 0.0 < switches[-1, 0]


def test_the_cylinder_is_passed_at_the_side_and_the_box_below() -> None:
    cylinder, box = plan_of("cylinder").seed.points, plan_of("box").seed.points
    assert np.max(np.abs(cylinder[:, 1])) > 0.047
    # the box is 0.6 m wide; its lower face less the margin less the tool leaves 0.46 m
    assert np.min(box[:, 2]) <= 0.46
    assert np.max(np.abs(box[:, 1])) < 0.3


def test_a_planar_search_moves_in_all_three_coordinates() -> None:
    seed = po.MixedSearch().seed(turning_problem(True))
    assert seed.straight_reason == "collision disc / ball"
    assert len(seed.switches) >= 2
    # the ball (50 mm) and the disc (50 mm) stay 5 mm apart at every corner
    assert np.min(np.linalg.norm(seed.points[:, :2], axis=1)) >= 0.105
    # angles count as arcs of the characteristic length: the grid is finer in theta
    metric = seed.problem.metric
    steps = (seed.explored - seed.points[0]) * metric / seed.step
    assert np.max(np.abs(steps - np.round(steps))) < 1e-9
    assert metric[2] == seed.problem.robot.mechanism.length != 1.0


def test_straightening_drops_needless_corners() -> None:
    seed = plan_of("cylinder").seed
    # around a cylinder a handful of corners suffices, where the way on the grid has a dozen nodes
    assert len(seed.points) <= 8
    half_way = 0.5 * np.pi * 0.12  # a half circle over the two ends
    assert 0.12 < seed.length < half_way


# --- Steps


@pytest.mark.parametrize("step", [0.01, 0.02, 0.03])
def test_other_steps_find_a_way_too(step: float) -> None:
    seed = po.MixedSearch(step=step).seed(problem_of("cylinder"))
    assert seed.step in (step, step / 2, step / 4)
    distance, _ = seed.problem.scene.clearances(seed.X)
    assert distance.min() >= 0.005
    # best known: 159.2 mm (plans with many control points); a coarse grid costs corners
    assert 0.1592 <= seed.length < 0.25


@pytest.mark.parametrize("problem", [problem_of("cylinder"), turning_problem(True)], ids=["raf", "3-RPR"])
def test_moves_along_the_axes_find_a_way_too(problem: po.Problem) -> None:
    seeds = [po.MixedSearch(neighbourhood=kind, cuts=0).seed(problem) for kind in ("axes", "full")]  # type: ignore[arg-type]
    assert len(seeds[0].explored) != len(seeds[1].explored)
    np.testing.assert_array_equal(po.MixedSearch(cuts=0).seed(problem).points, seeds[1].points)
    for seed in seeds:
        assert seed.length < 2.0 * np.linalg.norm((seed.points[-1] - seed.points[0]) * problem.metric)


def test_the_step_is_halved_until_a_way_is_found() -> None:
    """The gap lies beside the straight way, and a coarse grid has no node in it."""
    problem = _gate(middle=0.02, width=0.05)
    with pytest.raises(po.NoPathError, match="no path at a step of 40 mm"):
        po.MixedSearch(step=0.04, refinements=0).seed(problem)
    seed = po.MixedSearch(step=0.04, refinements=1).seed(problem)
    assert seed.step == 0.02
    # the checks of the coarse grid count too
    assert seed.checks > po.MixedSearch(step=0.02, refinements=0).seed(problem).checks
    # through the gap, where the tool (24 mm) and its margins leave 16 mm
    crossing = seed.at(np.linspace(0.0, 1.0, 401))
    assert np.all(np.abs(crossing[np.abs(crossing[:, 0]) < 0.005, 1] - 0.02) <= 0.0081)


def _gate(middle: float, width: float) -> po.Problem:
    """Hang two walls with a gap for the tool between them; the jacks may not dip below the walls nearby."""
    walls = [
        po.Box(name=name, size=(0.01, 1.0, 0.6), pose=po.transform((0.0, y, 0.52 + 0.3)))
        for name, y in (("left", middle + 0.5 * width + 0.5), ("right", middle - 0.5 * width - 0.5))
    ]
    limits = po.Limits(position=dict.fromkeys(("q1", "q2", "q3"), (0.045, 0.2)))
    return po.Problem(po.Scene(raf_robot(), walls), START, GOAL, limits=limits)


# --- Refusals


def test_an_obstacle_that_makes_every_path_impossible_is_named() -> None:
    problem = _wall(raf_with_long_tool(), 0.49)
    with pytest.raises(po.NoPathError) as caught:
        po.MixedSearch(refinements=0).seed(problem)
    message, evidence = str(caught.value), caught.value.evidence
    assert isinstance(caught.value, po.InfeasibleError)
    assert "no path at a step of" in message
    assert "collision tool / wall" in message
    assert "try" in message
    free, blocked = evidence["explored"], evidence["blocked"]
    assert f"{len(free)} positions are free and {len(blocked)} blocked" in message
    assert sum(evidence["reasons"].values()) == len(blocked)
    assert max(evidence["reasons"], key=evidence["reasons"].get) == "collision tool / wall"
    # nothing was found beyond the wall, whose half thickness is 10 mm and the tool's radius 12 mm
    assert np.max(free[:, 0]) < 0.0
    assert evidence["step"] == pytest.approx(0.12 / 8, rel=0.4)


def raf_with_long_tool() -> po.Problem:
    """Give a robot whose tool of 0.3 m cannot dip below a hanging wall: its stroke is 0.2 m."""
    robot = po.robots.raf(tool_length=0.3)
    return po.Problem(po.Scene(robot), START, GOAL)


@pytest.mark.parametrize("budget", [1, 60, 100, 300])
def test_an_exhausted_budget_is_told_apart_from_no_path(budget: int) -> None:
    with pytest.raises(po.BudgetExceededError) as caught:
        po.MixedSearch(max_checks=budget).seed(problem_of("cylinder"))
    assert not isinstance(caught.value, po.InfeasibleError)  # a way may exist
    assert "raise max_checks" in str(caught.value)
    explored, blocked = caught.value.evidence["explored"], caught.value.evidence["blocked"]
    # the two ends are judged in any case
    assert len(explored) + len(blocked) <= max(budget, 2)


def test_a_sufficient_budget_is_kept() -> None:
    needed = plan_of("cylinder").seed.checks
    assert po.MixedSearch(max_checks=needed).seed(problem_of("cylinder")).checks == needed
    # a way that is known when the budget ends is given as it is
    less = po.MixedSearch(max_checks=needed - 1).seed(problem_of("cylinder"))
    assert less.checks < needed
    assert less.length >= plan_of("cylinder").seed.length


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 0.0}, "step of the search is 0.0 m"),
        ({"step": -0.01}, "step of the search is -0.01 m"),
        ({"step": float("nan")}, "step of the search is nan m"),
        ({"step": float("inf")}, "step of the search is inf m"),
        ({"resolution": 0.0}, "resolution of the search is 0.0"),
        ({"resolution": 1.5}, "resolution of the search is 1.5"),
        ({"resolution": float("nan")}, "resolution of the search is nan"),
        ({"cuts": -1}, "refinements and cuts must not be negative"),
        ({"neighbourhood": "some"}, "neighbourhood of the search is 'some'"),
        ({"refinements": -1}, "refinements and cuts must not be negative"),
        ({"max_checks": 0}, "max_checks at least 1"),
    ],
)
def test_faulty_options_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(po.DefinitionError) as caught:
        po.MixedSearch(**options)
    assert words in str(caught.value)


def test_options_are_frozen() -> None:
    options = po.MixedSearch(step=0.01)
    with pytest.raises(AttributeError):
        options.step = 0.02  # type: ignore[misc]
    assert options == po.MixedSearch(step=0.01)


def test_limits_of_the_problem_bound_the_search() -> None:
    """The box is passed below; jacks that may not shorten so far must find another way, or none."""
    jacks = ("q1", "q2", "q3")
    limits = po.Limits(position=dict.fromkeys(jacks, (0.05, 0.2)))
    free, bound = plan_of("box").seed, po.MixedSearch().seed(raf_problem("box", limits=limits))
    index = raf_robot().mechanism.indices(jacks)
    assert np.min(free.X[:, index]) < 0.05 <= np.min(bound.X[:, index])
    assert bound.length > free.length
