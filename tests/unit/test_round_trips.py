"""Round trips over the library: inverse and forward models undo each other, batches and single calls agree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants, SampleOptions, find_compiler, sample_configurations
from paraopt.kinematics.functions import FunctionSet
from support import Array, library_robot, library_robots

NAMES = library_robots()
# what the drives determine is asked of the report at home: fewer drives than freedoms leave the forward model open
NEAR = SampleOptions(count=4, step=0.08, seed=3)


def poses(robot: po.Robot) -> Array:
    """Give closed configurations near home, on its branch; shape (n, n_variables)."""
    found = sample_configurations(robot.kinematics, robot.home_configuration, NEAR)
    assert len(found) > NEAR.count
    return found


def wrapped(robot: po.Robot, X: Array, Y: Array) -> Array:
    """Give the scaled difference of configurations, angles on the circle, idle variables left out."""
    idle = po.report_state(robot.kinematics, robot.home_configuration).idle
    used = [i for i, n in enumerate(robot.mechanism.names) if n not in idle and n not in robot.kinematics.idle]
    angle = np.array([v.kind == "angle" for v in robot.mechanism.variables])
    gap = np.where(angle, (X - Y + np.pi) % (2 * np.pi) - np.pi, (X - Y) / robot.mechanism.length)
    result: Array = gap[..., used]
    return result


def determines(robot: po.Robot, role: str) -> bool:
    """Tell whether imposing the variables of a role leaves no useful freedom."""
    report = po.report_state(robot.kinematics, robot.home_configuration)
    whole = "[N K]" if role == "active" else "[M N]"
    columns = report.n_variables - len(report.variables[role])
    return report.ranks[whole].value == columns - report.internal_mobility


@pytest.mark.parametrize("name", NAMES)
def test_inverse_then_forward_returns(name: str) -> None:
    robot = library_robot(name)
    kinematics, home = robot.kinematics, robot.home_configuration
    if not determines(robot, "operational"):
        pytest.fail(f"{name}: the operational variables do not determine the drives")
    for X in poses(robot):
        x = {n: float(X[robot.mechanism.index(n)]) for n in robot.mechanism.operational}
        there = kinematics.inverse(x, home).configuration
        q = {n: there[n] for n in robot.mechanism.active}
        back = kinematics.forward(q, home if determines(robot, "active") else there)
        assert back.status in (po.Status.CONVERGED, po.Status.SINGULAR)
        assert_allclose(wrapped(robot, back.configuration.X, there.X), 0, atol=1e-8)
        signs = Determinants.at(kinematics, home)
        for one, other in zip(signs.signs(back.X), signs.signs(there.X), strict=True):
            assert np.array_equal(one, other, equal_nan=True)  # the same branch


@pytest.mark.parametrize("name", NAMES)
def test_forward_then_inverse_returns(name: str) -> None:
    robot = library_robot(name)
    kinematics, home = robot.kinematics, robot.home_configuration
    for X in poses(robot):
        q = {n: float(X[robot.mechanism.index(n)]) for n in robot.mechanism.active}
        there = kinematics.forward(q, X).configuration
        x = {n: there[n] for n in robot.mechanism.operational}
        assert_allclose(wrapped(robot, kinematics.inverse(x, home).configuration.X, there.X), 0, atol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_batch_equals_single(name: str) -> None:
    robot = library_robot(name)
    kinematics, home, names = robot.kinematics, robot.home_configuration, robot.mechanism.operational
    x = poses(robot)[:, robot.mechanism.indices(names)]
    batch = kinematics.solve_batch(names, x, np.tile(home.X, (len(x), 1)))
    assert batch.converged.all()
    for row, X in zip(x, batch.X, strict=True):
        single = kinematics.inverse(dict(zip(names, row.tolist(), strict=True)), home)
        assert_allclose(X, single.X, atol=1e-12)


def assert_compiled_equals_uncompiled(name: str) -> None:
    robot = library_robot(name)
    compiled = po.Kinematics(robot.mechanism, "compiled")
    home, names = robot.home_configuration, robot.mechanism.operational
    X = poses(robot)
    for one, other in zip(compiled.jacobians_batch(X), robot.kinematics.jacobians_batch(X), strict=True):
        assert_allclose(one, other, atol=1e-12 * max(1.0, np.abs(other).max(initial=0.0)))
    x = X[:, robot.mechanism.indices(names)]
    starts = np.tile(home.X, (len(x), 1))
    both = [k.solve_batch(names, x, starts) for k in (compiled, robot.kinematics)]
    assert both[0].converged.all()
    assert_allclose(both[0].X, both[1].X, atol=1e-9)


@pytest.mark.skipif(find_compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("name", ["five_bar", "three_rpr", "stewart", "raf"])
def test_compiled_equals_uncompiled(name: str) -> None:
    assert_compiled_equals_uncompiled(name)


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("name", sorted({*NAMES} - {"five_bar", "three_rpr", "stewart", "raf"}))
def test_every_robot_compiled_equals_uncompiled(name: str) -> None:
    assert_compiled_equals_uncompiled(name)


def test_machines_of_the_library_share_no_functions() -> None:
    """Each has its own compiled functions: a cache that mixed them up would pass the tests above by luck only."""
    sets = {id(library_robot(n).kinematics.functions) for n in NAMES}
    assert len(sets) == len(NAMES)
    assert all(isinstance(library_robot(n).kinematics.functions, FunctionSet) for n in NAMES)
