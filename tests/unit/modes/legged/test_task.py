"""What a machine, a phase and a task may state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

import paraopt as po
from paraopt.modes.legged import Foot, LeggedMachine, LeggedTask, Phase, PlaneSupport


def test_a_machine_names_its_feet(machine: LeggedMachine) -> None:
    assert machine.names == ("right rear", "right front", "left rear", "left front")
    assert machine.foot("left rear").variables == ("left rear foot x", "left rear foot y", "left rear foot z")
    assert machine.mass == pytest.approx(sum(machine.robot.masses.values()))
    ends, carriers = machine.contacts(machine.robot.home_configuration.X)
    np.testing.assert_allclose(ends, carriers, atol=1e-12)
    np.testing.assert_allclose(ends[0, 0], [0.037, -0.079, -0.155], atol=1e-12)
    with pytest.raises(po.UnknownNameError, match="did you mean 'left rear'"):
        machine.foot("left read")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda m: {"feet": []}, "there must be some"),
        (lambda m: {"feet": [m.feet[0], m.feet[0]]}, "different names"),
        (lambda m: {"feet": [replace(m.feet[0], variables=m.feet[0].variables[:2])]}, "is moved by"),
        (lambda m: {"feet": [replace(m.feet[0], carrier="trunk")]}, "is moved by"),
        (lambda m: {"feet": [replace(m.feet[0], link="paw")]}, "unknown link"),
        (lambda m: {"feet": [m.feet[0], replace(m.feet[0], name="again")]}, "moves two feet"),
        (lambda m: {"masses": {"paw": 1.0}}, "unknown link"),
        (lambda m: {"masses": {"trunk": -1.0}}, "not negative"),
        (lambda m: {"masses": {"trunk": math.nan}}, "not negative"),
        (lambda m: {"masses": {}}, "no mass"),
        (lambda m: {"masses": {"trunk": 0.0}}, "no mass"),
        (lambda m: {"centres": {"paw": (0, 0, 0)}}, "unknown link"),
        (lambda m: {"centres": {"trunk": (0, 0, 0, 1)}}, "two or three"),
    ],
)
def test_faulty_machines_are_refused(
    machine: LeggedMachine, change: Callable[[LeggedMachine], dict[str, object]], match: str
) -> None:
    with pytest.raises(po.DefinitionError, match=match):
        replace(machine, **change(machine))  # type: ignore[arg-type]


def test_a_foot_is_read() -> None:
    foot = Foot("f", ["x"], "shin", (0, 0, -1), upright=(0, 0, 2))
    assert (foot.carrier, foot.carrier_point, foot.upright) == ("shin", (0, 0, -1), (0, 0, 1))
    assert Foot("f", ["x"], "shin", (0, 0, -1), carrier="slide").carrier_point == (0, 0, 0)
    for wrong in ({"name": ""}, {"variables": ()}, {"variables": "x"}, {"upright": (0, 0, 0)}):
        with pytest.raises(po.DefinitionError):
            Foot(**{"name": "f", "variables": ["x"], "link": "shin", **wrong})


def line(*values: float) -> BSpline:
    return BSpline([0, 0, 1, 1], np.array([[0.0] * len(values), values]), 1)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"name": ""}, "non-empty"),
        ({"coordinates": ()}, "nothing would move"),
        ({"coordinates": "x"}, "sequence of names"),
        ({"standing": ("a", "a")}, "twice"),
        ({"locked": ("x",)}, "both moves and locks"),
        ({"goal": {"z": 1.0}}, "unknown coordinate in the goal"),
        ({"goal": {"x": math.inf}}, "finite"),
        ({"goal": {"x": "far"}}, "'far'"),
        ({"via": [{"z": 1.0}]}, "unknown coordinate in the via"),
        ({"locked": {"q": math.nan}}, "finite"),
        ({"stability": math.nan}, "finite, or None"),
        ({"curve": line(1.0)}, "gives values of shape"),
        ({"curve": line(1.0, 2.0), "goal": {"x": 2.0}}, "ends with 'x' at 1"),
        ({"curve": line(1.0, 2.0), "via": [{"x": 1.0}]}, "give one of them"),
        ({"curve": BSpline([0, 0, 2, 2], np.zeros((2, 2)), 1)}, "over"),
    ],
)
def test_faulty_phases_are_refused(change: dict[str, object], match: str) -> None:
    good: dict[str, object] = {"name": "p", "standing": ("a",), "coordinates": ("x", "y")}
    Phase(**good)  # type: ignore[arg-type]
    with pytest.raises(po.DefinitionError, match=match):
        Phase(**{**good, **change})  # type: ignore[arg-type]


def test_a_phase_holds_feet_and_locks(machine: LeggedMachine, swing: Phase) -> None:
    held = swing.held(machine)
    assert set(held) == {f"{f} foot {a}" for f in swing.standing for a in "xyz"} | set(swing.locked)
    assert swing.lifted(machine) == ("right rear",)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"phases": ()}, "at least one phase"),
        ({"gravity": (0, 0, 0)}, "gravity is zero"),
        ({"limits": po.Limits(velocity={"knees": 1.0})}, "knees"),
    ],
)
def test_faulty_tasks_are_refused(task: LeggedTask, change: dict[str, object], match: str) -> None:
    with pytest.raises(po.DefinitionError, match=match):
        replace(task, **change)  # type: ignore[arg-type]


def test_phases_must_fit_the_machine(task: LeggedTask, swing: Phase) -> None:
    cases: list[tuple[tuple[Phase, ...], str]] = [
        ((swing, swing), "appear twice"),
        ((replace(swing, standing=("third",)),), "unknown standing foot of phase 'swing'"),
        ((replace(swing, locked=("knee",)),), "unknown variable of phase 'swing'"),
        ((replace(swing, standing=("right rear",)),), "foot 'right rear' stands, but its variables"),
    ]
    for phases, match in cases:
        with pytest.raises(po.DefinitionError, match=match):
            replace(task, phases=phases)
    other = po.Scene(po.robots.gipo())
    with pytest.raises(po.DefinitionError, match="another robot"):
        replace(task, scene=other)
    assert isinstance(replace(task, gravity=(0, 0, -9.81), support=PlaneSupport()).down, np.ndarray)
