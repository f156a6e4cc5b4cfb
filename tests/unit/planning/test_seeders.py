"""The contract of the family of seeders: every member runs over every problem here."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import paraopt as po
from motions import other_elbow, problem_of, raf_problem, turning_problem
from paraopt.planning import FirstSuccess, Roadmap, RRTConnect, Seeder, Validity

SEEDERS: tuple[Seeder, ...] = (
    po.MixedSearch(),
    RRTConnect(),
    Roadmap(nodes=120),
    FirstSuccess((RRTConnect(max_checks=3), po.MixedSearch(max_checks=2000), RRTConnect())),
)
PROBLEMS = {
    "raf free": (lambda: problem_of("free"), False),
    "raf cylinder": (lambda: problem_of("cylinder"), True),
    "raf box": (lambda: problem_of("box"), True),
    "3-RPR free": (lambda: turning_problem(blocked=False), False),
    "3-RPR ball": (lambda: turning_problem(blocked=True), True),
}
_SEEDS: dict[tuple[str, str], po.Seed] = {}


def _seed(seeder: Seeder, name: str) -> po.Seed:
    key = (repr(seeder), name)
    if key not in _SEEDS:
        _SEEDS[key] = seeder.seed(PROBLEMS[name][0]())
    return _SEEDS[key]


pytestmark = pytest.mark.parametrize("seeder", SEEDERS, ids=lambda s: type(s).__name__)
over_problems = pytest.mark.parametrize("name", PROBLEMS)


@over_problems
def test_a_seed_joins_the_start_to_the_goal(seeder: Seeder, name: str) -> None:
    seed = _seed(seeder, name)
    problem, index = seed.problem, seed.problem.robot.mechanism.indices(seed.problem.independent)
    np.testing.assert_array_equal(seed.points[0], problem.start_configuration.X[index])
    np.testing.assert_array_equal(seed.points[-1], problem.goal_values())
    np.testing.assert_array_equal(seed.X[0], problem.start_configuration.X)
    # each corner's configuration has its coordinates, and is closed to the solver's bound
    np.testing.assert_array_equal(seed.X[:, index], seed.points)
    assert np.max(problem.robot.kinematics.scaled_residual(seed.X)) <= 1e-12
    assert seed.checks > 0


@over_problems
def test_what_blocks_the_straight_motion_is_told(seeder: Seeder, name: str) -> None:
    seed, blocked = _seed(seeder, name), PROBLEMS[name][1]
    distance = float(np.linalg.norm((seed.points[-1] - seed.points[0]) * seed.problem.metric))
    if blocked:
        assert seed.straight_reason.startswith("collision ")
        assert len(seed.points) > 2
        assert seed.length > distance * 1.01
    else:
        assert seed.straight_reason == "valid"
        assert len(seed.points) == 2
        # two roundings of sums of squares
        assert seed.length == pytest.approx(distance, rel=1e-15)


@over_problems
def test_every_edge_holds_on_a_check_ten_times_denser(seeder: Seeder, name: str) -> None:
    seed = _seed(seeder, name)
    problem = seed.problem
    names, kinematics = problem.independent, problem.robot.kinematics
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    spacing = getattr(seeder, "resolution", 0.2) * seed.step / 10.0
    for k in range(len(seed.points) - 1):
        a, b = seed.points[k], seed.points[k + 1]
        count = int(np.ceil(np.linalg.norm((b - a) * problem.metric) / spacing))
        walk = [seed.X[k]]
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            closed = kinematics.solve_batch(names, (a + share * (b - a))[None], walk[-1][None])
            assert closed.converged[0]
            walk.append(closed.X[0])
        X = np.array(walk)
        # walking in small steps ends where the seed says: one branch, angles unwrapped
        gap = np.abs(X[-1] - seed.X[k + 1]) / kinematics.graph.variable_scale
        # both are solved to a scaled residual of 1e-12, amplified at most by 1 / margin, some 20
        assert np.max(gap) < 1e-9
        assert np.all((low - 1e-9 <= X) & (high + 1e-9 >= X))
        margins = problem.space.margins(X)
        # between checked poses the margin moves by less than its change from one to the next
        sag = float(np.max(np.abs(np.diff(margins.parallel)))) * 10.0
        assert min(margins.parallel.min(), margins.serial.min()) >= problem.margins.singularity - sag
        distance, _ = problem.scene.clearances(X)
        # between checked poses the distance may sag, by less than half the way between them
        assert distance.min() >= problem.margins.clearance - 5.0 * spacing
        if np.all(np.isfinite(distance)):
            assert distance[::10].min() >= problem.margins.clearance - 0.5 * spacing


@over_problems
def test_explored_and_blocked_are_what_they_say(seeder: Seeder, name: str) -> None:
    seed = _seed(seeder, name)
    m = len(seed.problem.independent)
    assert seed.explored.shape[1:] == seed.blocked.shape[1:] == seed.switches.shape[1:] == (m,)
    assert seed.checks >= len(seed.explored) + len(seed.blocked)
    problem = seed.problem
    for positions, expected in ((seed.explored, True), (seed.blocked, False)):
        if not len(positions):
            continue
        # a way of their own: all straight from the start, in small steps
        X = np.tile(seed.X[0], (len(positions), 1))
        for share in np.linspace(0.0, 1.0, 21)[1:]:
            values = seed.points[0] + share * (positions - seed.points[0])
            X = problem.robot.kinematics.solve_batch(problem.independent, values, X).X
        verdict = Validity(problem).judge_configurations(X)
        closed = problem.robot.kinematics.scaled_residual(X) <= 1e-12
        # where the distance equals the margin, as at nodes level with a face, round-off decides
        tie = np.abs(problem.scene.clearances(X)[0] - problem.margins.clearance) < 1e-9
        assert np.all(((verdict.valid & closed) == expected) | tie)
        assert np.count_nonzero(tie) < 0.5 * len(tie)


@over_problems
def test_arc_and_interpolation_follow_the_corners(seeder: Seeder, name: str) -> None:
    seed = _seed(seeder, name)
    arc = seed.arc
    assert arc[0] == 0.0
    assert arc[-1] == 1.0
    assert np.all(np.diff(arc) > 0)
    # one multiplication and one division per coordinate
    np.testing.assert_allclose(seed.at(arc), seed.points, rtol=0, atol=1e-14)
    middle = seed.at(0.5 * (arc[:-1] + arc[1:]))
    np.testing.assert_allclose(middle, 0.5 * (seed.points[:-1] + seed.points[1:]), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["raf cylinder", "3-RPR ball"])
def test_the_same_problem_gives_the_same_seed(seeder: Seeder, name: str) -> None:
    first, problem = _seed(seeder, name), PROBLEMS[name][0]()
    again = seeder.seed(dataclasses.replace(problem))
    for field in ("points", "X", "explored", "blocked", "switches"):
        np.testing.assert_array_equal(getattr(first, field), getattr(again, field))
    assert (first.checks, first.step, first.straight_reason) == (again.checks, again.step, again.straight_reason)


def test_the_short_way_leads_through_half_a_turn(seeder: Seeder) -> None:
    for name in ("3-RPR free", "3-RPR ball"):
        theta = _seed(seeder, name).points[:, 2]
        assert theta[0] == 3.0
        assert theta[-1] == pytest.approx(2.0 * np.pi - 3.0, abs=1e-15)  # not -3.0: unwrapped
        assert np.all(theta > 2.5)


def test_bad_ends_are_refused_before_any_search(seeder: Seeder) -> None:
    for problem, words in (
        (raf_problem("cylinder", start={"x": 0.0, "y": 0.0, "z": 0.48}), "start is in collision"),
        (raf_problem("cylinder", goal={"x": 0.0, "y": 0.01, "z": 0.48}), "goal is in collision"),
        (raf_problem(goal={"x": 0.0, "y": 0.0, "z": 0.64}), "goal is out of the range of 'q"),
        (raf_problem(goal=other_elbow("B")), "goal lies on another branch"),
    ):
        with pytest.raises(po.InfeasibleError, match=words) as caught:
            seeder.seed(problem)
        assert not isinstance(caught.value, po.NoPathError)  # that one means that a search was made


def test_nothing_to_plan_is_refused(seeder: Seeder) -> None:
    with pytest.raises(po.DefinitionError, match="start and goal are the same pose"):
        seeder.seed(raf_problem(goal=dict(raf_problem().start)))
