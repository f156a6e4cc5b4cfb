"""The program of a gait: its derivatives, and a machine of six legs that shares nothing with GIPO."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.modes.legged import (
    Foot,
    GaitModel,
    GaitOptions,
    LeggedMachine,
    PlaneSupport,
    build_turn,
    build_walk,
    find_gait,
    hold_trunk,
)
from paraopt.modes.legged.gait_mapped import MappedRows, build_derivatives
from paraopt.modes.legged.gait_program import GaitProgram, ProgramShape
from paraopt.modes.legged.gait_table import bernstein, run_law
from paraopt.robots.base import drive_limits


def hexapod() -> LeggedMachine:
    """Six legs of three joints about z, y, y around a hexagonal body; numbers of our own."""
    links: list[po.Base | po.Mobile | po.Series] = [po.Base("ground"), po.Mobile("body")]
    closures, joints, carriers, feet = [], [], [], []
    home = {"x": 0.0, "y": 0.0, "z": 0.1, "alpha": 0.0, "beta": 0.0, "gamma": 0.0}
    masses = {"body": 1.0}
    for i in range(6):
        azimuth, leg = math.pi / 6 + i * math.pi / 3, f"leg {i + 1}"
        c, s = math.cos(azimuth), math.sin(azimuth)
        yaw, lift, knee = (f"{leg} {name}" for name in ("yaw", "lift", "knee"))
        links += [
            po.Series(yaw, "body", (0.1 * c, 0.1 * s, 0), po.Revolute(yaw, "z", (-1.2, 1.2)), rotation=(0, 0, azimuth)),
            po.Series(lift, yaw, (0.03, 0, 0), po.Revolute(lift, "y", (-1.5, 1.5))),
            po.Series(knee, lift, (0.08, 0, 0), po.Revolute(knee, "y", (0.2, 2.6))),
        ]
        father, at = "ground", (0.22 * c, 0.22 * s, 0.0)
        for axis in "xyz":
            name = f"{leg} foot {axis}"
            links.append(po.Series(name, father, at, po.Prismatic(name, axis=axis, range=(-1.0, 1.0))))
            carriers.append(name)
            father, at = name, (0.0, 0.0, 0.0)
        closures.append(po.Coincidence(knee, (0.12, 0, 0), father, (0, 0, 0)))
        joints += [yaw, lift, knee]
        home |= {lift: -0.4, knee: 1.6}
        masses |= {lift: 0.05, knee: 0.05}
        feet.append(Foot(leg, carriers[-3:], knee, (0.12, 0, 0), carrier=father))
    operational = ("x", "y", "z", "alpha", "beta", "gamma", *carriers)
    mechanism = po.Mechanism("hexapod", links, closures, active=joints, operational=operational)
    limits = drive_limits(joints, 4.0, 40.0, 2000.0)
    return LeggedMachine(
        po.Robot(mechanism, {**home, **dict.fromkeys(carriers, 0.0)}, limits=limits, masses=masses), feet
    )


def test_mapped_derivatives_are_those_of_the_whole() -> None:
    """Against CasADi's own derivatives of the same rows, written out."""
    u, a = ca.SX.sym("u", 3), ca.SX.sym("a", 2)
    row = ca.Function("row", [u, a], [ca.vertcat(ca.sin(u[0]) * u[1], a[0] * u[1] * u[2] ** 2 + a[1])])
    mapped = MappedRows(row, 4)
    z, p = ca.MX.sym("z", 5), ca.MX.sym("p", 8)
    rng = np.random.default_rng(2)
    P, c = ca.MX(ca.DM(rng.normal(size=(12, 5)))), ca.MX(ca.DM(rng.normal(size=12)))
    slack = ca.DM(rng.normal(size=(8, 5)))
    zs, ps = ca.SX.sym("z", 5), ca.SX.sym("p", 8)
    rest = ca.Function("rest", [zs, ps], [ca.sumsqr(zs) * zs[0], ca.vertcat(zs[1] ** 3 * ps[0], zs[2])])
    problem, options = build_derivatives(mapped, P, c, [ca.reshape(p, 2, 4)], slack, rest, z, p)
    at, given, lam = rng.normal(size=5), rng.normal(size=8), rng.normal(size=10)
    values = ca.Function("values", [z, p], [problem["f"], problem["g"]])
    f, g = values.expand()(zs, ps)
    known = ca.Function(
        "known",
        [zs, ps],
        [ca.gradient(f, zs), ca.jacobian(g, zs), ca.triu(ca.hessian(0.7 * f + ca.dot(lam, g), zs)[0])],
    )
    gradient, jacobian, hessian = (np.asarray(v) for v in known(at, given))
    assert_allclose(np.asarray(options["grad_f"](at, given)[1]), gradient, atol=1e-12)
    assert_allclose(np.asarray(options["jac_g"](at, given)[1]), jacobian, atol=1e-12)
    assert_allclose(np.asarray(options["hess_lag"](at, given, 0.7, lam)), hessian, atol=1e-11)


def test_the_law_is_at_rest_at_both_ends() -> None:
    tau = np.linspace(0.0, 1.0, 100001)
    s = run_law(tau)
    assert (s[0], s[-1]) == (0.0, 1.0)
    rate = np.gradient(s, tau)
    assert rate[0] == pytest.approx(0.0, abs=1e-6)
    assert rate.max() == pytest.approx(1.875, abs=1e-6)
    assert_allclose(bernstein(s).sum(axis=1), 1.0, atol=1e-14)


def test_free_deviations_of_a_cycle() -> None:
    """A cycle ends as it began; a trunk that stands in swings has one knot for both of their ends."""
    model = GaitModel(po.robots.gipo_machine())
    for moves, straight, count in ((True, True, 8), (False, True, 4), (True, False, 8 + 16), (False, False, 4 + 8)):
        options = GaitOptions(swing_moves=moves, straight=straight)
        shape = ProgramShape(4, (0, 4), True, (True,) * 5, 5, moves, is_timed=False)
        program = GaitProgram.__new__(GaitProgram)
        program.shape, program.options = shape, options
        spread = program.spread.reshape(8, 4, -1)
        assert spread.shape[2] == count
        assert_allclose(spread[0, 0], spread[-1, -1])
        assert_allclose(spread[1:, 0], spread[:-1, -1])
        if not moves:
            assert_allclose(spread[1::2], np.repeat(spread[1::2, :1], 4, axis=1))
    assert model.trunk == ("x", "y", "z", "alpha", "beta", "gamma")


def test_a_machine_without_a_trunk_is_refused() -> None:
    machine = po.robots.gipo_machine()
    mechanism = machine.robot.mechanism
    with pytest.raises(po.DefinitionError, match="a gait needs"):
        GaitModel(LeggedMachine(machine.robot, [Foot("tip", ["right rear foot x"], "right rear carrier x")]))
    assert mechanism.name == "GIPO"


@pytest.mark.slow
def test_six_legs_walk_and_turn() -> None:
    model, support = GaitModel(hexapod()), PlaneSupport()
    for falls in (build_walk(model, support, step=0.05, lift=0.03), build_turn(model, support, 0.3)):
        stated, found = hold_trunk(falls), find_gait(falls)
        least = min(each.bound for each in stated.sample())
        assert min(each.bound for each in found.sample()) > least + 0.02
        assert_allclose(found.phases[-1].trunk[-1], model.rest_pose + falls.travel, atol=1e-12)
