"""What a search says where there is no way: which end is wrong, what parts the ends, what closes the way, and where.

Source: models.md, 4 and 10 (Lahouar, III.3; Chablat1998, tables 2 and 3).
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

import paraopt as po
from paraopt.planning import Validity
from paraopt.planning.validity import find_crossing
from support import five_bar_robot

T0_BASE = ((0.0, 0.0), (75.0, 0.0), (37.5, 64.952))
AWAY = {"x": 60.0, "y": -50.0, "theta": 0.6}


@functools.cache
def plain_robot() -> po.Robot:
    return replace(po.robots.three_rpr(T0_BASE), shapes={})


@functools.cache
def innocenti() -> po.Robot:
    return replace(po.robots.three_rpr_innocenti(), shapes={})


def joined_modes(margin: float, **changes: object) -> po.Problem:
    """Ask for another assembly of the same side, which is reached by a full turn."""
    modes = innocenti().kinematics.assembly_modes({"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}).modes
    start, goal = (next(m.configuration for m in modes if abs(m.configuration["x"] - x) < 0.5) for x in (14.94, -8.68))
    pose = {name: goal[name] for name in ("x", "y", "theta")}
    return po.Problem(po.Scene(innocenti()), start, pose, margins=po.Margins(0.0, margin), **changes)  # type: ignore[arg-type]


def test_t0_is_refused_for_its_sign_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = po.Problem(po.Scene(plain_robot()), {"x": 20.0, "y": 0.0, "theta": 0.3}, AWAY, margins=po.Margins(0.0))
    monkeypatch.setattr(Validity, "judge", lambda *_: pytest.fail("a pose was searched"))
    with pytest.raises(po.InfeasibleError, match=r"goal lies on another branch .* \[N K\] .* parallel sing") as caught:
        po.MixedSearch().seed(problem)
    assert not isinstance(caught.value, po.NoPathError)
    evidence = caught.value.evidence
    assert evidence["reason"] == "branch"
    # printed with four digits; found by bisection between poses of a straight motion
    assert evidence["crossing"] == pytest.approx(0.4145, abs=1e-3)
    assert "at 41.4" in str(caught.value) or "at 41.5" in str(caught.value)
    parallel, serial = evidence["determinants"]
    assert parallel[0] * parallel[1] < 0 < serial[0] * serial[1]


def test_no_crossing_is_found_where_there_is_none() -> None:
    problem = po.Problem(
        po.Scene(plain_robot()), {"x": 20.0, "y": 0.0, "theta": 0.3}, {"x": 22.0, "y": 1.0, "theta": 0.3}
    )
    assert find_crossing(problem) is None


def test_ends_of_one_sign_that_a_margin_parts_are_told() -> None:
    assert po.MixedSearch().seed(joined_modes(0.05)).length > 0.0  # the same ends, joined
    with pytest.raises(po.NoPathError, match="in different regions at this step, though their determinants") as caught:
        po.MixedSearch(refinements=1).seed(joined_modes(0.12))
    evidence = caught.value.evidence
    assert evidence["cause"] == "singularity"
    assert max(evidence["reasons"], key=evidence["reasons"].get) == "singularity"
    first = po.MixedSearch(refinements=0)
    with pytest.raises(po.NoPathError) as coarse:
        first.seed(joined_modes(0.12))
    assert evidence["step"] == 0.5 * coarse.value.evidence["step"]
    assert f"at a step of {1e3 * evidence['step']:.3g} mm" in str(caught.value)


def test_a_way_by_a_full_turn_needs_angles_on_the_circle() -> None:
    seed = po.MixedSearch().seed(joined_modes(0.01))
    assert abs(seed.points[-1, 2] - seed.problem.goal_configuration["theta"]) == pytest.approx(2 * np.pi, abs=1e-12)
    bounded = replace(innocenti().limits, position={"theta": (-np.pi, np.pi)})
    for problem in (joined_modes(0.01, limits=bounded), joined_modes(0.01, turns=0)):
        with pytest.raises(po.NoPathError):
            po.MixedSearch(refinements=0).seed(problem)


def test_what_closes_the_way_is_named_with_the_pair() -> None:
    robot = replace(five_bar_robot(), shapes={"tip": [po.Sphere(name="tool", radius=0.1)]})
    wall = po.Box(name="wall", size=(0.3, 60.0, 1.0), pose=po.transform((6.0, 0.0, 0.0)))
    ends = {"x": 5.0, "y": 7.5}, {"x": 7.0, "y": 7.5}
    problem = po.Problem(po.Scene(robot, [wall]), *ends, margins=po.Margins(0.01, 0.05))
    with pytest.raises(po.NoPathError, match="without the solids there is a way, closed first of all by") as caught:
        po.MixedSearch(refinements=0).seed(problem)
    assert caught.value.evidence["cause"] == "collision"
    assert "collision tool / wall" in caught.value.evidence["reasons"]
    # what the search saw lies on the start's side of the wall
    assert np.max(caught.value.evidence["explored"][:, 0]) < 6.0


def test_what_is_wrong_at_an_end_is_told() -> None:
    robot = replace(five_bar_robot(), shapes={"tip": [po.Sphere(name="tool", radius=0.1)]})
    block = po.Box(name="block", size=(1.0, 1.0, 4.0), pose=po.transform((4.9, 7.5, 0.0)))
    ends = {"x": 6.0, "y": 7.0}, {"x": 5.0, "y": 7.5}
    for first, second, label in ((*ends, "goal"), (*ends[::-1], "start")):
        with pytest.raises(po.InfeasibleError, match=f"{label} is in collision .* tool / block at ") as caught:
            po.MixedSearch().seed(po.Problem(po.Scene(robot, [block]), first, second))
        assert caught.value.evidence["reason"].startswith("collision ")
        assert caught.value.evidence["configuration"]["x"] == 5.0


def test_a_goal_on_a_flipped_leg_is_brought_back_into_its_range() -> None:
    """A straight walk past a leg of no length comes out with a negative one; the pose has another solution."""
    modes = innocenti().kinematics.assembly_modes({"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}).modes
    start, goal = (next(m.configuration for m in modes if abs(m.configuration["x"] - x) < 0.5) for x in (-5.51, -13.39))
    problem = po.Problem(po.Scene(innocenti()), start, {n: goal[n] for n in ("x", "y", "theta")})
    drives = [problem.goal_configuration[f"rho{i}"] for i in (1, 2, 3)]
    # the modes are closed to 1e-12 relative to lengths of 16
    assert drives == pytest.approx([15.0, 15.4, 12.0], abs=1e-9)
