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


def test_more_actuators_than_coordinates_are_refused() -> None:
    robot = po.robots.hayward_wrist()
    home = robot.home_configuration
    with pytest.raises(po.DefinitionError, match=r"actuators and .* operational variables"):
        po.Problem(po.Scene(robot), home, home, allow_mode_change=True)
