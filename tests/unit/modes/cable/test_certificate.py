"""What the cables of a motion feel, judged; motions in a row; each corrupted motion is found out."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import paraopt as po
from cable_robots import ipanema
from paraopt.errors import CertificateError, DefinitionError, UnknownNameError
from paraopt.modes.cable import (
    CableTolerances,
    MotionChain,
    SwayLimits,
    TensionLimits,
    build_hanging,
    dynamic_tensions,
    read_hanging,
    verify_cables,
)

LOW = {"x": 0.4, "y": 0.45, "z": -0.7, "gamma": 0.0}
MIDDLE = {"x": 0.5, "y": 0.5, "z": -0.5, "gamma": 0.1}
MARGINS = po.Margins(clearance=0.001, singularity=0.01)


@functools.cache
def machine() -> po.Robot:
    return po.robots.larm_hanging(tension=(0.5, 8.0))


@functools.cache
def move(forth: bool = True) -> po.Trajectory:
    robot = read_hanging(machine())
    ends = (LOW, MIDDLE) if forth else (MIDDLE, LOW)
    problem = po.Problem(po.Scene(machine()), *ends, MARGINS)
    return po.plan(problem, retimer=po.TimeOptimal(constraints=(TensionLimits(robot), SwayLimits(robot)))).trajectory


@dataclass(frozen=True)
class Faster:
    """A time law run faster."""

    law: Any
    factor: float

    @property
    def duration(self) -> float:
        return float(self.law.duration / self.factor)

    def __call__(self, t: Any, order: int = 0) -> Any:
        return self.law(np.asarray(t) * self.factor, order) * self.factor**order


def test_a_motion_of_a_hanging_platform_is_certified() -> None:
    robot = read_hanging(machine(), machine().mechanism.active)
    certificate = verify_cables(robot, move())
    assert certificate.passed
    assert certificate.check_passed() is certificate
    assert [c.name for c in certificate.checks] == [
        "tension above t_min", "tension below t_max", "unbalanced / weight", "stability",
    ]  # fmt: skip
    assert certificate["tension above t_min"].value == pytest.approx(np.min(certificate.needed) - 0.5)
    assert certificate["tension below t_max"].value == pytest.approx(8.0 - np.max(certificate.needed))
    assert certificate["tension above t_min"].where in robot.cables
    assert np.min(certificate.margins) == pytest.approx(
        min(certificate[name].value for name in ("tension above t_min", "tension below t_max"))
    )
    found = dynamic_tensions(robot, move(), tolerance=1.0, count=len(certificate.needed))
    assert certificate.needed == pytest.approx(found.values, abs=1e-9)  # within the limits they are the same
    assert certificate.unbalanced * robot.weight == pytest.approx(found.residual, abs=1e-9)
    assert "equilibria stable" in certificate.summary
    with pytest.raises(DefinitionError, match="no check"):
        certificate["nothing"]


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({"t_min": 3.0}, "tension above t_min"),
        ({"t_max": 4.0}, "tension below t_max"),
        ({"mass": 3.0}, "tension below t_max"),
    ],
)
def test_a_tension_beyond_a_limit_is_found(changes: dict[str, Any], failing: str) -> None:
    robot = replace(read_hanging(machine()), **changes)
    certificate = verify_cables(robot, move(), count=501, stability_count=11)
    assert [c.name for c in certificate.checks if not c.passed] == [failing]
    with pytest.raises(CertificateError, match=failing):
        certificate.check_passed()


def test_a_motion_that_sways_is_found() -> None:
    robot = read_hanging(machine())
    fast = replace(move(), law=Faster(move().law, 1.2))
    certificate = verify_cables(robot, fast, count=501, stability_count=11)
    assert [c.name for c in certificate.checks if not c.passed] == ["unbalanced / weight"]
    # accelerations grow by the square
    assert certificate["unbalanced / weight"].value == pytest.approx(
        1.44 * verify_cables(robot, move(), count=501, stability_count=11)["unbalanced / weight"].value, rel=1e-6
    )
    tolerances = CableTolerances(sway=0.1)
    assert verify_cables(robot, fast, count=501, stability_count=11, tolerances=tolerances).passed


def test_an_equilibrium_that_falls_over_is_found() -> None:
    """The same machine with its mass above the line of the attachments: balanced, but not for long."""
    standing = replace(read_hanging(machine(), machine().mechanism.active), name="standing", centre=(0, 0, 0.05))
    robot = build_hanging(standing, ("x", "y", "z", "gamma"))
    level = MIDDLE | {"gamma": 0.0}
    problem = po.Problem(po.Scene(robot), level, level | {"z": -0.6}, MARGINS)
    trajectory = po.plan(problem).trajectory
    certificate = verify_cables(standing, trajectory, count=501, stability_count=21)
    assert [c.name for c in certificate.checks if not c.passed] == ["stability"]
    assert "NOT stable" in certificate.summary


def test_a_robot_with_enough_cables_is_judged_by_its_capacity() -> None:
    robot = ipanema(t_min=10.0, velocity=1.0, acceleration=2.0)
    pose = dict.fromkeys(robot.coordinates, 0.0)
    problem = po.Problem(po.Scene(robot.robot), pose | {"x": -0.2, "z": 1.0}, pose | {"x": 0.2, "z": 1.0}, MARGINS)
    trajectory = po.plan(problem, retimer=po.TimeOptimal(constraints=(TensionLimits(robot),))).trajectory
    certificate = verify_cables(robot, trajectory, count=301)
    assert certificate.passed
    assert [c.name for c in certificate.checks] == [
        "capacity margin", "tension above t_min", "tension below t_max", "unbalanced / weight",
    ]  # fmt: skip
    assert certificate["capacity margin"].value > 0.0
    weak = verify_cables(replace(robot, t_max=120.0), trajectory, count=301)
    assert {c.name for c in weak.checks if not c.passed} == {"capacity margin", "unbalanced / weight"}


def test_a_steady_push_moves_a_pendulum_as_far_as_its_weight_allows() -> None:
    """Below the centre the platform turns about its bar as a pendulum; its curvature is drop over length."""
    robot = read_hanging(machine())
    level = MIDDLE | {"gamma": 0.0}
    side = level | {"y": 0.52}
    trajectory = po.plan(po.Problem(po.Scene(machine()), level, side, MARGINS)).trajectory
    certificate = verify_cables(robot, trajectory, tolerances=CableTolerances(sway=1.0))
    assert certificate.curvature[0] == pytest.approx(0.05 / robot.length_scale, rel=1e-6)
    # the moment of the unbalanced force over that of the weight: the lateral acceleration over gravity
    lateral = np.max(
        np.abs(trajectory(np.linspace(0, trajectory.duration, 4001), 2)[:, machine().mechanism.index("y")])
    )
    assert certificate.deflection >= lateral / 9.81 * 0.99
    assert certificate.deflection < 3.0 * lateral / 9.81


def test_motions_in_a_row_are_one() -> None:
    forth, back = move(), move(False)
    chain = MotionChain([forth, back])
    assert chain.duration == pytest.approx(forth.duration + back.duration)
    assert np.max(chain.jumps) < 1e-9
    assert np.max(chain.speeds) < 1e-6
    t = np.array([0.0, 0.3, forth.duration, forth.duration + 0.2, chain.duration])
    for order in (0, 1, 2):
        whole = chain(t, order)
        assert whole[1] == pytest.approx(forth(0.3, order))
        assert whole[3] == pytest.approx(back(0.2, order))
    assert chain(0.3) == pytest.approx(forth(0.3))
    assert chain.state(t).velocity == pytest.approx(chain(t, 1))
    certificate = verify_cables(read_hanging(machine()), chain, count=801, stability_count=41)
    assert certificate.passed
    assert MotionChain([forth]).duration == forth.duration


def test_a_chain_that_does_not_meet_is_refused() -> None:
    with pytest.raises(DefinitionError, match="jumps by"):
        MotionChain([move(), move()])
    with pytest.raises(DefinitionError, match="no motions"):
        MotionChain([])
    with pytest.raises(DefinitionError, match="time is in"):
        MotionChain([move()])(move().duration + 1.0)
    other = build_hanging(read_hanging(machine(), machine().mechanism.active), ("x", "y", "z", "gamma"))
    level = MIDDLE | {"gamma": 0.0}
    foreign = po.plan(po.Problem(po.Scene(other), level, level | {"z": -0.6}, MARGINS)).trajectory
    with pytest.raises(DefinitionError, match="whose variables are not those"):
        MotionChain([move(), foreign])


def test_cables_take_the_names_and_limits_of_their_lengths() -> None:
    named = read_hanging(machine(), ("q1", "q2", "q3", "q4"))
    assert tuple(named.cables) == ("q1", "q2", "q3", "q4")
    assert np.array_equal(named.velocity, [0.5] * 4)
    assert np.array_equal(named.acceleration, [2.0] * 4)
    assert read_hanging(machine()).velocity is None
    with pytest.raises(UnknownNameError, match="q5"):
        read_hanging(machine(), ("q1", "q2", "q3", "q5"))
    with pytest.raises(DefinitionError, match="4 different names"):
        read_hanging(machine(), ("q1", "q2"))
