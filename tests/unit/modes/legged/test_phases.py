"""From a task to its problems: what must hold where phases meet, and what is refused, naming phase, foot and value."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.modes.legged import LeggedTask, Phase, PlaneSupport, build_problems, measure_support, plan_legged

TRUNK = ("x", "y", "z", "alpha", "beta", "gamma")


def limited(task: LeggedTask, **position: tuple[float, float]) -> po.Limits:
    limits = task.machine.robot.limits
    named = {name.replace("_", " "): value for name, value in position.items()}
    return po.Limits(named, limits.velocity, limits.acceleration, limits.jerk)


def test_problems_chain_on_one_mechanism(task: LeggedTask) -> None:
    shift, swing, back = build_problems(task)
    assert shift.robot is swing.robot is back.robot
    assert swing.start_configuration is shift.goal_configuration
    assert back.start_configuration["right rear foot x"] == 0.02
    assert swing.held == task.phases[1].held(task.machine)
    assert shift.independent == TRUNK
    # the goal leaves out y and z: they come back
    assert swing.goal_configuration["right rear foot z"] == 0.0
    assert len(shift.conditions[0].names) == 4
    assert len(swing.conditions[0].names) == 3
    assert_allclose(swing.conditions[0].lower, 0.002 / swing.conditions[0].horizon)  # type: ignore[union-attr]


def test_a_task_may_start_elsewhere(task: LeggedTask) -> None:
    problems = build_problems(replace(task, start={"y": 0.01}))
    assert problems[0].start_configuration["y"] == 0.01
    again = replace(task, start=problems[0].start_configuration)
    assert build_problems(again)[0].start_configuration is problems[0].start_configuration


def refuse(task: LeggedTask, kind: type[po.ParaoptError], *words: str, **changes: Any) -> po.ParaoptError:
    """Refuse a task when its problems are built, with all words in the message."""
    with pytest.raises(kind) as caught:
        build_problems(replace(task, **changes))
    for word in words:
        assert word in str(caught.value), str(caught.value)
    return caught.value


# --- Continuity


def test_stated_values_must_continue(task: LeggedTask, shift: Phase, swing: Phase) -> None:
    wrong = replace(swing, locked={**dict.fromkeys(TRUNK, 0.0), "x": 0.2})
    refuse(task, po.DefinitionError, "'swing'", "locks 'x'", "0.2 m", "0.1255", phases=(shift, wrong))
    wrong = replace(swing, start={"right front foot x": 1e-8})
    refuse(task, po.DefinitionError, "'swing'", "of foot 'right front'", "1e-08", phases=(shift, wrong))
    kept = replace(
        swing, start={"x": 0.1255}, locked={**dict.fromkeys(TRUNK, 0.0), "x": 0.1255, "y": 0.025, "z": -0.01}
    )
    assert len(build_problems(replace(task, phases=(shift, kept)))) == 2


def test_a_foot_stands_only_where_it_touches(task: LeggedTask, shift: Phase, swing: Phase, back: Phase) -> None:
    hanging = replace(swing, goal={"right rear foot z": 0.01}, via=())
    error = refuse(
        task, po.InfeasibleError, "'back'", "foot 'right rear'", "10.000 mm above", phases=(shift, hanging, back)
    )
    assert error.evidence["foot"] == "right rear"
    assert error.evidence["height"] == pytest.approx(0.01)
    build_problems(replace(task, phases=(shift, hanging)))  # in the air at the end of all phases
    deep = replace(swing, goal={"right rear foot z": -0.003}, via=())
    refuse(task, po.InfeasibleError, "'swing'", "'right rear'", "3.000 mm in 'ground'", phases=(shift, deep))
    low = PlaneSupport((0, 0, -0.1551))
    refuse(task, po.InfeasibleError, "'shift'", "'right rear'", "0.100 mm above", support=low)


# --- Faults


def test_a_foothold_out_of_reach(task: LeggedTask, shift: Phase, swing: Phase) -> None:
    far = replace(swing, goal={"right rear foot x": 0.12}, via=())
    words = ("'swing'", "'right rear'", "out of reach", "mm from its place")
    error = refuse(task, po.InfeasibleError, *words, phases=(shift, far))
    # the leg is stretched: the foot stops some 16 mm short
    gap = float(str(error).split("stays ")[1].split(" mm")[0])
    assert 5.0 < gap < 60.0


def test_a_masked_servo_range(task: LeggedTask) -> None:
    limits = limited(task, right_rear_knee=(-0.85, -0.6))
    words = ("'swing'", "'right rear knee'", "in the leg of foot 'right rear'", "[-0.85, -0.6]", "-0.928")
    error = refuse(task, po.InfeasibleError, *words, limits=limits)
    assert error.evidence["variable"] == "right rear knee"
    # masked only in the middle of the swing: found by the seed, which names phase and place
    with pytest.raises(po.InfeasibleError, match=r"phase 'swing' \(lifting 'right rear'\).*place 1.*knee.*-1\.403"):
        plan_legged(replace(task, limits=limited(task, right_rear_knee=(-1.2, -0.6))))


@pytest.mark.parametrize(("tilt", "refused"), [(0.0, 2), (0.5, 2), (0.8, 4), (-1.1, 4)])
def test_a_slope_on_which_any_lift_tips_over(task: LeggedTask, tilt: float, refused: int) -> None:
    """On level ground the rear feet may come off, downhill the two that are uphill, on the steepest slopes none."""
    down = (np.sin(tilt), 0.0, -np.cos(tilt))
    swings = []
    for foot in task.machine.names:
        names = tuple(f"{foot} foot {axis}" for axis in "xyz")
        standing = tuple(name for name in task.machine.names if name != foot)
        swings.append(Phase(f"lift {foot}", standing, names, {names[2]: 0.02}, locked=TRUNK))
    margins = []
    for foot, swing in zip(task.machine.names, swings, strict=True):
        error = None
        try:
            build_problems(replace(task, phases=(swing,), gravity=down))
        except po.InfeasibleError as caught:
            error = caught
        others = measure_support(task.machine, task.machine.robot.home_configuration.X, swing.standing, down)
        assert (error is None) == bool(others[0] >= 0.0)
        if error is not None:
            margins.append(error.evidence["margin"])
            assert margins[-1] == pytest.approx(others[0])
            told = str(error)
            assert all(word in told for word in (f"'{swing.name}'", f"'{foot}'", f"{1e3 * margins[-1]:.3f} mm")), told
    assert len(margins) == refused


def test_two_feet_carry_nothing(task: LeggedTask, swing: Phase) -> None:
    pair = replace(
        swing, standing=("right rear", "left front"), coordinates=("right front foot z", "left rear foot z"), goal={},
        via=(), stability=-0.1, locked=(*TRUNK, *(f"{f} foot {a}" for f in ("right front", "left rear") for a in "xy")),
    )  # fmt: skip
    words = ("'swing'", "'right front'", "'left rear'", "is a line", "-2.7")
    refuse(task, po.InfeasibleError, *words, phases=(pair,))
    none = replace(pair, standing=(), stability=0.0)
    refuse(task, po.InfeasibleError, "no foot stands", phases=(none,))
    build_problems(replace(task, phases=(replace(pair, stability=None),)))  # a machine that holds on to the ground


def test_impossible_locks(task: LeggedTask, shift: Phase, swing: Phase) -> None:
    knee = replace(swing, locked=(*TRUNK, "right rear knee"))
    words = ("'swing'", "'right rear'", "'right rear knee'", "2 motions are left, but 3")
    assert refuse(task, po.InfeasibleError, *words, phases=(shift, knee)).evidence["mobility"] == 2
    stuck = replace(shift, coordinates=("x",), goal={}, locked=task.machine.robot.mechanism.active)
    refuse(task, po.InfeasibleError, "'shift'", "no motions are left", phases=(stuck,))
    loose = replace(swing, locked=TRUNK[:5])
    words = ("'swing'", "determine 3 of 4 motions", "can move by themselves")
    refuse(task, po.InfeasibleError, *words, phases=(shift, loose))
    # hip and knee turn about parallel axes: with the hip locked, y and the knee say all, x and z say one thing twice
    hip = replace(
        swing, coordinates=("right rear foot x", "right rear foot y"), goal={}, via=(), stability=None,
        locked=(*TRUNK, "right rear hip"), standing=("right front", "left rear", "left front"),
    )  # fmt: skip
    build_problems(replace(task, phases=(shift, hip)))


def test_a_singular_lock_names_its_margin(task: LeggedTask, shift: Phase, swing: Phase) -> None:
    """A shin straight below its knee moves the foot along x alone: z does not tell where the leg is."""
    robot = task.machine.robot
    hip, knee = "right rear hip", "right rear knee"
    lock = replace(
        swing, coordinates=("right rear foot z", "right rear foot y"), goal={}, via=(), stability=None,
        locked=(*TRUNK, hip),
    )  # fmt: skip
    # the tip is (-4, ., -57) mm in the frame of the knee: here it is straight below it
    upright = {**{n: robot.home_configuration[n] for n in TRUNK}, hip: 0.6, knee: -0.6 - np.arctan2(4, 57)}
    upright |= {"right rear abduction": 0.0}
    upright |= {f"{foot} foot {a}": 0.0 for foot in task.machine.names[1:] for a in "xyz"}
    start = robot.kinematics.solve(upright, robot.home_configuration).configuration
    assert start["right rear foot z"] > 0.0
    words = ("'swing'", "'right rear'", "determine 1 of 2 motions", "smallest singular value", "0.05 is asked")
    error = refuse(task, po.InfeasibleError, *words, phases=(lock,), start=start)
    assert error.evidence["margin"] < 1e-6
