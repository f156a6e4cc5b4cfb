"""Motions that change the working mode: they cross serial singularities, never parallel ones.

Source: Chablat1998 (the five-bar 9, 8, 5, 5, 8; its working modes and the signs of det A).
"""

from __future__ import annotations

import functools
import itertools
import json
from pathlib import Path

import numpy as np
import pytest

import paraopt as po
from paraopt.planning.validity import compare_configurations
from support import five_bar_robot

POSE = {"x": 6.0, "y": 7.0}
MODES = ("++", "+-", "-+", "--")


@functools.cache
def mode(label: str) -> po.Configuration:
    return five_bar_robot().kinematics.working_modes(POSE)[label]


def change(first: str, second: str, **options: object) -> po.Problem:
    options = {"allow_mode_change": True, "margins": po.Margins(0.0, 0.05), **options}
    return po.Problem(po.Scene(five_bar_robot()), mode(first), mode(second), **options)  # type: ignore[arg-type]


@functools.cache
def plan_of_change() -> po.Plan:
    return po.plan(change("++", "--"))


def test_the_actuators_are_the_coordinates() -> None:
    problem = change("++", "-+")
    assert problem.independent == ("theta1", "theta2")
    assert problem.periodic.all()
    assert change("++", "-+", allow_mode_change=False).independent == ("x", "y")


@pytest.mark.parametrize(("first", "second"), [*itertools.permutations(MODES, 2)])
def test_modes_of_one_sign_are_joined_and_others_refused(first: str, second: str) -> None:
    problem = change(first, second)
    signs = [float(np.sign(problem.determinants(mode(m).X)[0][0])) for m in (first, second)]
    if signs[0] != signs[1]:
        with pytest.raises(po.InfeasibleError, match="crosses a parallel singularity") as caught:
            po.MixedSearch().seed(problem)
        assert "serial" not in str(caught.value)
        return
    seed = po.MixedSearch().seed(problem)
    # walk along it without the planner
    kinematics, walk = problem.robot.kinematics, [seed.X[0]]
    for values in seed.at(np.linspace(0.0, 1.0, 2001))[1:]:
        closed = kinematics.solve_batch(problem.independent, values[None], walk[-1][None])
        assert closed.converged[0]
        walk.append(closed.X[0])
    X = np.array(walk)
    parallel, serial = problem.determinants(X)
    assert np.all(np.sign(parallel) == signs[0])
    assert np.min(problem.space.margins(X).parallel) >= 0.05 - 1e-9
    # the leg's sign, and with one leg that of the product, cannot change but through zero
    if sum(a != b for a, b in zip(first, second, strict=True)) == 1:
        assert np.min(serial) < 0.0 < np.max(serial)
    # it ends in the mode that was asked for
    end = kinematics.working_modes(POSE, kinematics.configuration(X[-1])).label_of(kinematics.configuration(X[-1]))
    assert end == second


def test_without_leave_the_mode_stays() -> None:
    with pytest.raises(po.InfeasibleError, match=r"determinant of \[M N\] has the other sign"):
        po.MixedSearch().seed(change("++", "-+", allow_mode_change=False))


def test_a_plan_that_changes_the_mode_is_certified() -> None:
    plan = plan_of_change()
    assert plan.certificate.passed
    assert plan.certificate["parallel margin"].value >= 0.05 - 1e-9
    # both legs change their sign: the serial margin goes to nothing twice
    assert plan.certificate["serial margin"].value < 0.01
    assert "serial ones may be crossed" in plan.summary
    assert {c.name for c in plan.certificate.checks} >= {"parallel determinant", "closure residual"}
    assert "serial determinant" not in {c.name for c in plan.certificate.checks}


def test_a_certificate_still_refuses_a_parallel_singularity() -> None:
    plan = plan_of_change()
    strict = po.Problem(
        plan.problem.scene, plan.problem.start, plan.problem.goal, margins=po.Margins(0.0, 0.2), allow_mode_change=True
    )
    assert [c.name for c in po.verify(strict, plan.trajectory).failures] == ["parallel margin"]
    kept = po.Problem(plan.problem.scene, plan.problem.start, plan.problem.goal, margins=po.Margins(0.0, 0.05))
    assert {"serial margin", "serial determinant"} & {c.name for c in po.verify(kept, plan.trajectory).failures}


def test_a_plan_that_changes_the_mode_is_saved(tmp_path: Path) -> None:
    files = plan_of_change().save(tmp_path, view=False)
    report = json.loads(files["report"].read_text(encoding="utf-8"))
    assert report


def test_a_pose_is_reached_in_a_mode_on_the_same_side() -> None:
    """Of the solutions of a pose one is chosen that no parallel singularity parts from the start."""
    scene = po.Scene(five_bar_robot())
    problem = po.Problem(scene, mode("++"), {"x": 3.0, "y": 8.0}, allow_mode_change=True)
    parallel = [
        float(problem.determinants(c.X)[0][0]) for c in (problem.start_configuration, problem.goal_configuration)
    ]
    assert parallel[0] * parallel[1] > 0.0
    seed = po.MixedSearch().seed(problem)
    index = problem.robot.mechanism.indices(("x", "y"))
    assert seed.X[-1][index] == pytest.approx([3.0, 8.0], abs=1e-9)


def assemblies(first: float, second: float) -> po.Problem:
    """Ask for another assembly of the 3-RPR with the same drives, in the coordinates of the drives; x tells which."""
    robot = po.robots.three_rpr_innocenti()
    robot = po.Robot(robot.mechanism, home=robot.home, limits=robot.limits)
    modes = robot.kinematics.assembly_modes({"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}).modes
    ends = [next(m.configuration for m in modes if abs(m.configuration["x"] - x) < 0.5) for x in (first, second)]
    return po.Problem(po.Scene(robot), *ends, margins=po.Margins(0.0, 0.01), allow_mode_change=True)


def test_trees_find_the_loop_of_the_drives_that_changes_the_assembly() -> None:
    """The drives come back to where they were, the platform does not: a way round a cusp, without a singularity."""
    problem = assemblies(14.94, -13.39)
    seed = po.RRTConnect().seed(problem)
    np.testing.assert_allclose(seed.points[0], seed.points[-1], atol=1e-9)
    assert seed.length > 10.0
    kinematics, walk = problem.robot.kinematics, [seed.X[0]]
    for values in seed.at(np.linspace(0.0, 1.0, 3001))[1:]:
        closed = kinematics.solve_batch(problem.independent, values[None], walk[-1][None])
        assert closed.converged[0]
        walk.append(closed.X[0])
    X = np.array(walk)
    assert np.all(problem.determinants(X)[0] > 0.0)
    assert compare_configurations(problem, X[-1], problem.goal_configuration.X)[1] < 1e-6


def test_a_grid_that_knows_one_solution_for_each_position_says_so() -> None:
    with pytest.raises(po.NoPathError, match=r"another solution of the closures.* try RRTConnect") as caught:
        po.MixedSearch().seed(assemblies(14.94, -13.39))
    assert caught.value.evidence["cause"] == "solution"


def test_more_actuators_than_coordinates_are_refused() -> None:
    robot = po.robots.hayward_wrist()
    home = robot.home_configuration
    with pytest.raises(po.DefinitionError, match=r"actuators and .* operational variables"):
        po.Problem(po.Scene(robot), home, home, allow_mode_change=True)
