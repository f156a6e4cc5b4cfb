"""The question: what is refused when stated, and how start and goal become configurations."""

from __future__ import annotations

import numpy as np
import pytest

import paraopt as po
from motions import GOAL, START, other_elbow, problem_of, raf_problem, straight_line, three_rpr, turning_problem
from paraopt.planning import Validity, check_ends
from support import five_bar_robot, raf_robot

JACKS = ("q1", "q2", "q3")


# --- Stating


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ({"x": 0.0, "y": 0.0}, ("missing ['z']",)),
        ({**START, "w": 1.0}, ("not operational ['w']",)),
        ({**START, "q1": 0.1}, ("not operational ['q1']",)),
        ({}, ("missing ['x', 'y', 'z']",)),
        ({**START, "x": float("nan")}, ("'x'", "nan", "finite")),
        ({**START, "z": float("inf")}, ("'z'", "inf", "finite")),
        ({**START, "y": "left"}, ("'y'", "'left'", "finite")),
    ],
)
@pytest.mark.parametrize("end", ["start", "goal"])
def test_faulty_poses_are_refused_by_name(end: str, pose: dict[str, object], words: tuple[str, ...]) -> None:
    with pytest.raises(po.DefinitionError) as caught:
        raf_problem(**{end: pose})
    message = str(caught.value)
    assert message.startswith(end)
    assert all(word in message for word in words), message


def test_a_configuration_of_another_machine_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="goal is a configuration of another mechanism, 'five-bar'"):
        raf_problem(goal=five_bar_robot().home_configuration)


@pytest.mark.parametrize("name", ["clearance", "singularity"])
@pytest.mark.parametrize("value", [-1e-9, float("nan"), float("inf"), "wide"])
def test_faulty_margins_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(po.DefinitionError, match=f"{name} margin is "):
        po.Margins(**{name: value})


def test_a_singularity_margin_lies_below_one() -> None:
    assert po.Margins(singularity=0.999).singularity == 0.999
    with pytest.raises(po.DefinitionError, match=r"singularity margin is 1\.0.*\[0, 1"):
        po.Margins(singularity=1.0)


@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("value", [0, 0.0, -0.1, float("nan"), float("inf")])
def test_faulty_limits_are_refused_by_name(quantity: str, value: float) -> None:
    with pytest.raises(po.DefinitionError, match=f"{quantity} limit of 'q2' is .*finite and above 0"):
        po.Limits(**{quantity: {"q1": 0.1, "q2": value}})


@pytest.mark.parametrize("bounds", [(0.2, 0.1), (0.1, 0.1), (float("nan"), 0.1)])
def test_an_empty_range_is_refused(bounds: tuple[float, float]) -> None:
    with pytest.raises(po.DefinitionError, match="position limit of 'q1'"):
        po.Limits(position={"q1": bounds})


def test_limits_of_unknown_variables_are_refused_with_the_valid_names() -> None:
    with pytest.raises(po.UnknownNameError, match=r"velocity limits 'q9'.*'q1', 'q2', 'q3'"):
        raf_problem(limits=po.Limits(velocity={"q9": 1.0}))


def test_limits_of_the_problem_stand_in_for_those_of_the_robot() -> None:
    limits = po.Limits(velocity=dict.fromkeys(JACKS, 0.03), position={"q1": (0.01, 0.3)})
    problem = raf_problem(limits=limits)
    assert problem.bounds is limits
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    # a position limit narrows the range of the joint, it does not widen it
    assert (low[0], high[0]) == (0.01, 0.2)
    assert raf_problem().bounds is raf_robot().limits


# --- Solving the ends


def test_the_ends_are_closed_configurations_with_the_stated_pose() -> None:
    problem = problem_of("cylinder")
    for pose, configuration in ((START, problem.start_configuration), (GOAL, problem.goal_configuration)):
        assert {name: configuration[name] for name in "xyz"} == pose  # imposed values are kept to the last bit
        # the bound of the solver on scaled residuals
        assert configuration.residual <= 1e-12


def test_the_ends_lie_on_the_branch_of_the_home() -> None:
    problem, home = problem_of("free"), raf_robot().home_configuration
    for configuration in (problem.start_configuration, problem.goal_configuration):
        for arm in ("arm A", "arm B"):  # the other elbow lies more than a radian away
            assert abs(configuration[arm] - home[arm]) < 0.5


def test_the_goal_follows_the_branch_of_a_stated_start() -> None:
    flipped = other_elbow("B", START)
    problem = raf_problem(start=flipped)
    assert problem.start_configuration is flipped
    assert abs(problem.goal_configuration["arm B"] - flipped["arm B"]) < 0.5
    assert abs(problem.goal_configuration["arm B"] - problem_of("free").goal_configuration["arm B"]) > 0.5
    check_ends(problem, Validity(problem))


def test_what_is_out_of_reach_is_refused_with_the_nearest_pose() -> None:
    problem = raf_problem(goal={**GOAL, "z": 1.2})
    with pytest.raises(po.InfeasibleError, match=r"goal is out of reach.*'z' wanted 1\.2 m, nearest 0\.") as caught:
        _ = problem.goal_configuration
    assert caught.value.evidence["pose"]["z"] == 1.2
    nearest = caught.value.evidence["solution"].nearest
    # the passive chains of the RAF end at z = 0.676 m on the axis (models.md, 3); strokes of 0.2 m end earlier
    assert 0.55 < nearest["z"] < 0.68


def test_periodic_angles_are_known_and_taken_the_short_way() -> None:
    problem = turning_problem(blocked=False)
    assert problem.periodic.tolist() == [False, False, True]
    assert not np.any(problem_of("free").periodic)
    length = problem.robot.mechanism.length
    assert problem.metric.tolist() == [1.0, 1.0, length]
    # from 3.0 to -3.0 through pi
    np.testing.assert_allclose(problem.goal_values(), [0.15, 0.0, 2.0 * np.pi - 3.0], rtol=0, atol=1e-15)


def test_an_angle_with_a_range_is_not_periodic() -> None:
    limited = po.Limits(position={"theta": (-4.0, 4.0)})
    problem = turning_problem(blocked=False)
    bounded = po.Problem(problem.scene, dict(problem.start), dict(problem.goal), limits=limited)
    assert not np.any(bounded.periodic)
    assert bounded.goal_values()[2] == -3.0


# --- Ends that cannot be joined


@pytest.mark.parametrize("arm", ["A", "B"])
def test_a_goal_with_the_other_elbow_lies_on_another_branch(arm: str) -> None:
    problem = raf_problem(goal=other_elbow(arm))
    with pytest.raises(po.InfeasibleError, match="goal lies on another branch than the start"):
        check_ends(problem, Validity(problem))


def test_a_goal_with_the_same_elbows_is_accepted_as_a_configuration() -> None:
    problem = raf_problem(goal=problem_of("free").goal_configuration)
    check_ends(problem, Validity(problem))


def test_a_goal_with_full_turns_in_its_joints_is_the_same_goal() -> None:
    usual = problem_of("free").goal_configuration
    X = usual.X.copy()
    X[raf_robot().mechanism.index("cross A+")] += 2.0 * np.pi
    problem = raf_problem(goal=raf_robot().kinematics.configuration(X))
    check_ends(problem, Validity(problem))


def test_the_printed_goal_of_the_3_rpr_is_refused() -> None:
    """The plain reading of the thesis' example puts start and goal on two sides of det A = 0.

    Source: models.md, 4, T0 (Lahouar, III.3).
    """
    base, platform = [(0, 0), (75, 0), (37.5, 64.952)], [(0, 0), (15, 0), (7.5, 12.990)]
    start, goal = {"x": 20.0, "y": 0.0, "theta": 0.3}, {"x": 60.0, "y": -50.0, "theta": 0.6}
    robot = three_rpr(base, platform, start, (10.0, 200.0))
    problem = po.Problem(po.Scene(robot), start, goal, margins=po.Margins(singularity=0.0))
    with pytest.raises(po.InfeasibleError, match=r"goal lies on another branch.*\[N K\].*parallel singularity"):
        check_ends(problem, Validity(problem))
    # one crossing, at t = 0.4145 as recomputed there
    parallel, _ = problem.determinants(straight_line(problem, 401))
    crossings = np.flatnonzero(np.diff(np.sign(parallel)))
    assert len(crossings) == 1
    assert crossings[0] / 400 <= 0.4145 <= (crossings[0] + 1) / 400


# --- Metric, turns and modes


@pytest.mark.parametrize("length", [0.0, -1.0, float("nan"), float("inf")])
def test_a_faulty_characteristic_length_is_refused(length: float) -> None:
    with pytest.raises(po.DefinitionError, match="characteristic length of the metric is"):
        raf_problem(characteristic_length=length)


def test_fewer_turns_than_none_are_refused() -> None:
    with pytest.raises(po.DefinitionError, match="number of full turns is -1"):
        raf_problem(turns=-1)


def test_the_characteristic_length_weighs_angles_alone() -> None:
    usual = turning_problem(False)
    other = po.Problem(usual.scene, usual.start, usual.goal, characteristic_length=7.0)
    assert usual.metric.tolist() == [1.0, 1.0, usual.robot.mechanism.length]
    assert other.metric.tolist() == [1.0, 1.0, 7.0]
    assert other.periodic.tolist() == [False, False, True]
    np.testing.assert_array_equal(other.goal_values(), usual.goal_values())


def test_turns_bound_periodic_coordinates_alone() -> None:
    usual = turning_problem(False)
    low, high = usual.start_configuration.X[usual.index], usual.goal_values()
    for turns in (0, 1, 3):
        problem = po.Problem(usual.scene, usual.start, usual.goal, turns=turns)
        lower, upper = problem.turn_bounds
        assert np.all(np.isinf(lower[:2]) & np.isinf(upper[:2]))
        # a rounding's room is left at both ends
        assert lower[2] == pytest.approx(low[2] - 2 * np.pi * turns, abs=1e-8)
        assert upper[2] == pytest.approx(high[2] + 2 * np.pi * turns, abs=1e-8)


def test_differences_of_angles_go_the_short_way() -> None:
    problem = turning_problem(False)
    turned = problem.turn(np.array([[4.0, -4.0, 4.0], [0.0, 0.0, -np.pi]]))
    np.testing.assert_allclose(turned, [[4.0, -4.0, 4.0 - 2 * np.pi], [0.0, 0.0, -np.pi]], atol=1e-15)


def test_forces_weigh_like_angles_over_their_reference() -> None:
    """A tension among the coordinates: one weight of it counts as one radian."""
    robot = po.robots.larm_hanging()
    home = robot.home_configuration
    goal = {"x": 0.5, "y": 0.5, "z": -0.5, "t1": home["t1"]}
    problem = po.Problem(po.Scene(robot), home, goal, coordinates=tuple(goal))
    length, weight = robot.mechanism.length, 9.81
    np.testing.assert_allclose(problem.metric, [1.0, 1.0, 1.0, length / weight], rtol=1e-3)
