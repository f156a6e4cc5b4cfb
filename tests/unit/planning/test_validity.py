"""The judge of poses: each thing that can be wrong is named, and nothing wrong is let through."""

from __future__ import annotations

import numpy as np
import pytest

import paraopt as po
from motions import GOAL, START, other_elbow, problem_of, raf_problem, straight_line
from paraopt.planning import Validity, check_ends
from support import raf_robot


def _judge(problem: po.Problem, pose: dict[str, float], near: po.Configuration | None = None) -> str:
    near = near or problem.start_configuration
    T = problem.space.tangent(near.X)
    values = np.array([[pose[name] for name in problem.independent]])
    verdict = Validity(problem).judge(values, near.X[None], T)
    assert verdict.valid[0] == (verdict.reasons[0] == "valid")
    return verdict.reasons[0]


@pytest.mark.parametrize(
    ("task", "pose", "margins", "reason"),
    [
        ("free", {"x": 0.0, "y": 0.01, "z": 0.48}, {}, "valid"),
        ("cylinder", {"x": 0.0, "y": 0.0, "z": 0.48}, {}, "collision tool / cylinder"),
        ("box", {"x": 0.0, "y": 0.0, "z": 0.48}, {}, "collision tool / box"),
        ("box", {"x": 0.0, "y": 0.0, "z": 0.44}, {}, "valid"),
        ("free", {"x": 0.0, "y": 0.0, "z": 0.40}, {}, "limit of q"),  # q = 0 at z = 0.412 on the axis (models.md, 3)
        ("free", {"x": 0.0, "y": 0.0, "z": 0.90}, {}, "closure"),
        ("free", {"x": 0.0, "y": 0.01, "z": 0.48}, {"singularity": 0.5}, "singularity"),
    ],
)
def test_what_is_wrong_is_named(task: str, pose: dict[str, float], margins: dict[str, float], reason: str) -> None:
    problem = raf_problem(task, margins=po.Margins(**margins))
    near = raf_robot().home_configuration
    assert _judge(problem, pose, near).startswith(reason)


def test_a_jump_to_another_branch_is_seen() -> None:
    problem = problem_of("free")
    # asked from the other elbow: closed, in range, clear of everything, but not on the branch of the start
    assert _judge(problem, dict(GOAL), other_elbow("B")) == "branch"


def test_a_departure_from_the_prediction_counts_as_a_lost_branch() -> None:
    problem = problem_of("free")
    near = problem.start_configuration
    values, tangent = np.array([list(GOAL.values())]), problem.space.tangent(near.X)
    assert Validity(problem).judge(values, near.X[None], tangent).valid[0]
    # over 0.12 m the joints bend away from their tangents by more than a thousandth of a radian
    strict = Validity(problem, reach=1e-3).judge(values, near.X[None], tangent)
    assert strict.reasons == ("branch",)


def test_batches_are_judged_pose_by_pose() -> None:
    problem = problem_of("cylinder")
    line = straight_line(problem, 41)
    verdict = Validity(problem).judge_configurations(line)
    inside = np.hypot(line[:, -3], line[:, -2]) - 0.042 < 0.005
    assert verdict.valid.tolist() == (~inside).tolist()
    assert verdict.valid[0]
    assert verdict.valid[-1]
    assert 0 < np.count_nonzero(inside) < len(line)
    one_by_one = [Validity(problem).judge_configurations(X[None]).reasons[0] for X in line]
    assert list(verdict.reasons) == one_by_one
    # the tangents of valid poses come along; both sides are the same solve, up to its batch
    usable = verdict.valid
    np.testing.assert_allclose(verdict.T[usable], problem.space.tangent(line[usable]), rtol=0, atol=1e-12)


def test_the_number_of_judged_poses_is_counted() -> None:
    problem, validity = problem_of("free"), Validity(problem_of("free"))
    validity.judge_configurations(np.tile(problem.start_configuration.X, (5, 1)))
    validity.judge_configurations(problem.goal_configuration.X[None])
    assert validity.checks == 6


# --- The ends


def _refusal(problem: po.Problem) -> po.InfeasibleError:
    with pytest.raises(po.InfeasibleError) as caught:
        check_ends(problem, Validity(problem))
    return caught.value


@pytest.mark.parametrize("end", ["start", "goal"])
def test_an_end_in_collision_is_refused_with_pair_distance_and_margin(end: str) -> None:
    error = _refusal(raf_problem("cylinder", **{end: {"x": 0.0, "y": 0.0, "z": 0.48}}))
    assert str(error).startswith(f"{end} is in collision")
    # on the axis the tool (12 mm) stands in the middle of the cylinder (30 mm)
    assert "tool / cylinder at -42.00 mm" in str(error)
    assert "margin is 5.00 mm" in str(error)
    assert error.evidence["configuration"]["y"] == 0.0
    assert error.evidence["reason"] == "collision tool / cylinder"


def test_an_end_nearer_than_the_margin_is_refused() -> None:
    # 60 mm beside the axis the gap is 18 mm
    check_ends(raf_problem("cylinder"), Validity(raf_problem("cylinder")))
    error = _refusal(raf_problem("cylinder", margins=po.Margins(clearance=0.02)))
    assert "start is in collision or too close: tool / cylinder at 18.00 mm" in str(error)
    assert "20.00 mm" in str(error)


def test_an_end_beyond_a_stroke_is_refused_with_joint_value_and_range() -> None:
    error = _refusal(raf_problem(goal={**GOAL, "z": 0.64}))
    assert str(error).startswith("goal is out of the range of 'q")
    assert "m is not in [0, 0.2] m" in str(error)


def test_an_end_near_a_singularity_is_refused_with_both_margins() -> None:
    error = _refusal(raf_problem(margins=po.Margins(singularity=0.3)))
    margins = problem_of("free").space.margins(problem_of("free").start_configuration.X)
    assert f"parallel margin {margins.parallel[0]:.4f}, serial margin {margins.serial[0]:.4f}" in str(error)
    assert "0.3000" in str(error)


def test_ends_on_two_branches_are_refused_with_the_determinant() -> None:
    error = _refusal(raf_problem(start=START, goal=other_elbow("B")))
    assert "another branch" in str(error)
    assert "singularity" in str(error)
    assert error.evidence
