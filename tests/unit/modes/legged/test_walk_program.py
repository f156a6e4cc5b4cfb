"""What is planned is what the servos are told: programs of walks, played on paper, against the motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

import paraopt as po
from paraopt.errors import InfeasibleError
from paraopt.io.robobasic import build_robobasic
from paraopt.io.robobasic_player import play
from paraopt.io.servos import HIGHEST, LOWEST, Servo, ServoTable, gipo_servos
from paraopt.modes.legged import (
    GaitModel,
    LeggedPlan,
    PlaneSupport,
    build_gait_task,
    build_turn,
    find_gait,
    plan_legged,
)


def check_program(plan: LeggedPlan, groups: bool) -> None:
    """Play the program of a walk and compare the units of every servo with the angles of the motion."""
    table, motion = gipo_servos(), plan.trajectory
    program = build_robobasic(motion, table, groups=groups, title="walk")
    start = np.full(24, 100.0)
    start[list(table.numbers)] = program.units[0]
    run = play(program.text, list(start))
    t = np.linspace(0.0, motion.duration, 9973)  # not on the writer's milliseconds
    angles = motion(t)[:, motion.robot.mechanism.indices(table.joints)]
    told = run(program.lead + t)[:, list(table.numbers)]
    # in the program's own words: units = zero + direction * degrees
    exact = np.array([s.zero + s.direction * np.degrees(a) for s, a in zip(table.servos, angles.T, strict=True)]).T
    assert np.max(np.abs(told - exact)) <= 1.0 + 2e-3  # one unit; and what happens within a millisecond
    assert run.duration - program.lead == pytest.approx(motion.duration, abs=1.5e-3)
    assert run.units.min() >= LOWEST
    assert run.units.max() <= HIGHEST
    # at rest where phases meet: a servo ends there within rounding
    borders = motion.borders
    rest = motion(borders)[:, motion.robot.mechanism.indices(table.joints)]
    assert np.max(np.abs(run(program.lead + borders)[:, list(table.numbers)] - table.units(rest))) <= 1.0 + 2e-3


@pytest.mark.parametrize("groups", [False, True])
def test_the_program_of_a_lift_plays_the_lift(plan: LeggedPlan, groups: bool) -> None:
    check_program(plan, groups)


def test_a_servo_that_cannot_go_so_far_is_named(plan: LeggedPlan) -> None:
    knee = plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 2001))
    least = math.degrees(knee[:, plan.task.machine.robot.mechanism.index("right rear knee")].min())
    servo = Servo("right rear knee", 20, lower=math.ceil(100.0 + least) + 3)
    with pytest.raises(InfeasibleError, match=r"servo 20 \(right rear knee\)"):
        build_robobasic(plan.trajectory, ServoTable((servo,)))


@pytest.mark.slow
def test_the_program_of_a_turn_plays_the_turn() -> None:
    model = GaitModel(po.robots.gipo_machine(po.robots.gipo(trunk_height=-0.02)))
    support = PlaneSupport(point=model.rest_places[0])
    gait = find_gait(build_turn(model, support, math.radians(15)))
    plan = plan_legged(build_gait_task(gait, support, margins=po.Margins(clearance=0.0, singularity=0.05)))
    for groups in (False, True):
        check_program(plan, groups)
    # it turned by what was asked, trunk and feet alike
    X = plan.trajectory(np.array([0.0, plan.trajectory.duration]))
    mechanism = model.machine.robot.mechanism
    turned = X[1, mechanism.index("gamma")] - X[0, mechanism.index("gamma")]
    assert turned == pytest.approx(math.radians(15), abs=1e-9)
    feet = model.machine.contacts(X)[0][..., :2] - X[:, None, mechanism.indices(("x", "y"))]
    c, s = math.cos(turned), math.sin(turned)
    np.testing.assert_allclose(feet[1], feet[0] @ np.array([[c, s], [-s, c]]), atol=1e-9)
