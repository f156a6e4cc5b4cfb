"""GIPO on its ground, one lift planned once for all tests of this folder."""

from __future__ import annotations

from dataclasses import replace

import pytest

import paraopt as po
from paraopt.modes.legged import LeggedMachine, LeggedPlan, LeggedTask, Phase, PlaneSupport, plan_legged

TRUNK = ("x", "y", "z", "alpha", "beta", "gamma")
GROUND = PlaneSupport((0.0, 0.0, -0.155))


@pytest.fixture(scope="session")
def machine() -> LeggedMachine:
    return po.robots.gipo_machine()


@pytest.fixture(scope="session")
def scene(machine: LeggedMachine) -> po.Scene:
    """The scene chooses its pairs once."""
    return po.Scene(machine.robot)


@pytest.fixture(scope="session")
def shift(machine: LeggedMachine) -> Phase:
    """The trunk goes where the right rear foot can be lifted."""
    goal = {"x": machine.robot.home["x"] + 0.012, "y": 0.025, "z": -0.01}
    return Phase("shift", machine.names, TRUNK, goal)


@pytest.fixture(scope="session")
def swing() -> Phase:
    """The right rear foot takes a step of 20 mm, lifted by 20 mm on its way."""
    foot = tuple(f"right rear foot {axis}" for axis in "xyz")
    return Phase(
        "swing", ("right front", "left rear", "left front"), foot, {foot[0]: 0.02}, locked=TRUNK,
        via=[{foot[0]: 0.01, foot[2]: 0.02}], stability=0.002,
    )  # fmt: skip


@pytest.fixture(scope="session")
def back(shift: Phase) -> Phase:
    """The trunk comes back over all feet."""
    return replace(shift, name="back", goal={"y": 0.0})


@pytest.fixture(scope="session")
def task(machine: LeggedMachine, scene: po.Scene, shift: Phase, swing: Phase, back: Phase) -> LeggedTask:
    return LeggedTask(machine, (shift, swing, back), GROUND, scene=scene)


@pytest.fixture(scope="session")
def plan(task: LeggedTask) -> LeggedPlan:
    return plan_legged(task, retimer=po.TimeOptimal())
