"""Relations between joint variables and static balance as closures: forces are variables like others."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.closure import build_closure
from paraopt.mechanism import Closure, Coupling, Equilibrium, Tension
from paraopt.view.graph_content import build_link_graph
from support import Array, assert_derivative

G = 9.81


def planar_cables(
    extra: list[Closure] | None = None, drums: bool = False, unit: float = 1.0, mass: float = 2.0, centre: float = -0.1
) -> po.Mechanism:
    """Hang a bar on two cables from (0, 0) and (1, 0); lengths are multiplied by a unit."""
    links: list[po.mechanism.Link] = [po.Base()]
    closures: list[Closure] = []
    tensions = []
    for i, (exit_, end) in enumerate(((0.0, -0.2), (1.0, 0.2)), start=1):
        at, point = (exit_ * unit, 0.0), (end * unit, 0.0)
        links.append(po.Series(f"swing {i}", "base", at, po.Revolute(f"a{i}")))
        links.append(po.Series(f"cable {i}", f"swing {i}", joint=po.Prismatic(f"l{i}", "x", (0.01 * unit, 3 * unit))))
        if drums:
            links.append(po.Series(f"drum {i}", "base", at, po.Revolute(f"d{i}")))
            closures.append(Coupling({f"l{i}": 1.0}, radii={f"d{i}": -0.05 * unit}, length=0.4 * unit))
        closures.append(po.Coincidence(f"cable {i}", (0, 0), "bar", point))
        tensions.append(Tension(f"t{i}", "base", at, "bar", point))
    links.append(po.Mobile("bar"))
    balance = Equilibrium("bar", tensions, mass=mass, centre=(0, centre * unit), gravity=(0, -G * unit, 0))
    active = ("d1", "d2") if drums else ("l1", "l2")
    return po.Mechanism("bar", links, [*closures, balance, *(extra or [])], active, ("x", "y"), planar=True)


HANGS = {
    "x": 0.5,
    "y": -0.4,
    "theta": 0.0,
    "l1": 0.5,
    "l2": 0.5,
    "a1": -0.9,
    "a2": math.pi + 0.9,
    "t1": 10.0,
    "t2": 10.0,
}


def solve(mechanism: po.Mechanism, impose: dict[str, float], start: dict[str, float] | None = None) -> po.Solution:
    kinematics = po.Kinematics(mechanism)
    known = {n: v for n, v in (start or HANGS).items() if n in mechanism.names}
    return kinematics.solve(impose, known)


# --- Balance


def test_tensions_are_variables_of_their_own() -> None:
    mechanism = planar_cables()
    found = {v.name: v for v in mechanism.variables}
    assert mechanism.passive == ("a1", "a2", "theta", "t1", "t2")
    assert (found["t1"].kind, found["t1"].unit, found["t1"].link) == ("force", "N", "bar")
    assert found["t1"].range == (0.0, np.inf)
    assert found["t1"].scale == pytest.approx(2.0 * G)
    graph = build_closure(mechanism)
    assert [(r.name, r.unit) for r in graph.rows[-3:]] == [
        ("equilibrium of bar, force [x]", "N"), ("equilibrium of bar, force [y]", "N"),
        ("equilibrium of bar, moment [z]", "N m"),
    ]  # fmt: skip
    assert_allclose(graph.row_scale[-3:], [2 * G, 2 * G, 2 * G * mechanism.length])
    assert_allclose(graph.variable_scale[mechanism.index("t2")], 2 * G)


def test_balance_agrees_with_statics_by_hand() -> None:
    """A level bar in the middle: each cable carries half of the weight over the sine of its slope."""
    answer = solve(planar_cables(), {"x": 0.5, "y": -0.4})
    assert answer.status is po.Status.CONVERGED
    values = answer.configuration
    assert values["theta"] == pytest.approx(0.0, abs=1e-12)
    assert_allclose([values["t1"], values["t2"]], G / math.sin(math.atan2(0.4, 0.3)), rtol=1e-12)


def test_a_bar_beside_the_middle_tilts_until_three_forces_meet() -> None:
    """Lines of the cables and the vertical through the centre of mass meet in one point, an old theorem of statics."""
    answer = solve(planar_cables(), {"x": 0.42, "y": -0.4})
    v = answer.configuration
    R = np.array([[math.cos(v["theta"]), -math.sin(v["theta"])], [math.sin(v["theta"]), math.cos(v["theta"])]])
    origin = np.array([v["x"], v["y"]])
    ends = [origin + R @ (s * 0.2, 0.0) for s in (-1, 1)]
    exits = [np.zeros(2), np.array([1.0, 0.0])]
    matrix = np.column_stack([ends[0] - exits[0], -(ends[1] - exits[1])])
    meeting = exits[0] + np.linalg.solve(matrix, exits[1] - exits[0])[0] * (ends[0] - exits[0])
    assert abs(v["theta"]) > 0.01
    assert meeting[0] == pytest.approx((origin + R @ (0.0, -0.1))[0], abs=1e-10)


def test_derivatives_of_the_balance_are_exact() -> None:
    mechanism = po.robots.larm_hanging().mechanism
    graph = build_closure(mechanism)
    functions = ca.Function("f", [graph.X], [graph.F, graph.E])
    home = po.robots.larm_hanging().home_configuration.X
    X = home + 0.05 * np.random.default_rng(1).normal(size=len(home))
    assert_derivative(np.asarray(functions(X)[1]), lambda x: np.asarray(functions(x)[0]).ravel(), X)


@pytest.mark.parametrize(("unit", "mass"), [(1000.0, 2.0), (1.0, 2000.0), (1e-3, 5e-3)])
def test_margins_know_no_units(unit: float, mass: float) -> None:
    """The same machine in millimetres, or with another weight, is as far from its singularities."""
    margins = []
    for mechanism, u, m in ((planar_cables(), 1.0, 2.0), (planar_cables(unit=unit, mass=mass), unit, mass)):
        start = {
            n: v * (u if n[0] in "xyl" else m * u / 2 if n[0] == "t" and n != "theta" else 1) for n, v in HANGS.items()
        }
        answer = solve(mechanism, {"x": 0.42 * u, "y": -0.4 * u}, start)
        space = po.MotionSpace(po.Kinematics(mechanism))
        found = space.margins(answer.configuration.X)
        margins.append((found.parallel[0], found.serial[0]))
    assert_allclose(margins[1], margins[0], rtol=1e-8)


def test_a_tension_may_be_imposed() -> None:
    """What if cable 1 shall pull with 15 N: the bar moves aside, and the tilt, the place and the lengths follow."""
    answer = solve(planar_cables(), {"t1": 15.0, "y": -0.4})
    assert answer.status is po.Status.CONVERGED
    assert answer.configuration["t1"] == 15.0
    assert answer.configuration["x"] < 0.5


def test_ranges_of_tensions_are_told() -> None:
    tight = planar_cables()
    balance = tight.closures[-1]
    assert isinstance(balance, Equilibrium)
    short = replace(balance, tensions=[replace(t, range=(0.0, 11.0)) for t in balance.tensions])
    answer = solve(replace(tight, closures=[*tight.closures[:-1], short]), {"x": 0.5, "y": -0.4})
    assert answer.out_of_range == ("t1", "t2")


def test_loads_act_where_they_are_stated() -> None:
    """A moment, and a force beside the centre of mass, tilt a bar alike."""
    mechanism = planar_cables()
    balance = mechanism.closures[-1]
    assert isinstance(balance, Equilibrium)

    def tilt(**loads: Any) -> float:
        loaded = replace(mechanism, closures=[*mechanism.closures[:-1], replace(balance, **loads)])
        return float(solve(loaded, {"x": 0.5, "y": -0.4}).configuration["theta"])

    force = tilt(force=(0.0, -3.0, 0.0), at=(0.1, 0.0, 0.0))
    heavier = tilt(mass=2.0 + 3.0 / G, centre=(0.1 * 3 / (2 * G + 3), -0.1 * 2 * G / (2 * G + 3), 0.0))
    assert force == pytest.approx(heavier, abs=1e-12)
    assert force < -1e-3
    assert tilt(moment=(0.0, 0.0, -0.5)) < -1e-3


def test_forces_are_judged_by_what_pulls() -> None:
    """The weight, or the constant force where nothing has weight, or what is stated."""
    pull = [Tension("t", "base", (0, 0, 0), "body", (0, 0, 0))]
    force = (0.0, 3.0, -4.0)
    assert Equilibrium("body", pull, mass=2.0, force=force).scale == pytest.approx(2.0 * G)
    assert Equilibrium("body", pull, force=force).scale == pytest.approx(5.0)
    assert Equilibrium("body", pull, mass=2.0, gravity=(0, 0, 0), force=force).scale == pytest.approx(5.0)
    assert Equilibrium("body", pull, mass=2.0, reference_force=7.0).scale == 7.0


def test_a_cable_between_two_bodies_pulls_both() -> None:
    """Two weights under each other: the upper cable carries both, the lower one its own."""
    upper, lower = po.Mobile("upper", prefix="u."), po.Mobile("lower", prefix="l.")
    t1 = Tension("t1", "base", (0, 0), "upper", (0, 0.1))
    t2 = Tension("t2", "upper", (0, -0.1), "lower", (0, 0.1))
    gravity = (0.0, -G, 0.0)
    closures = [
        Equilibrium("upper", [t1, t2], mass=3.0, gravity=gravity), Equilibrium("lower", [t2], mass=2.0, gravity=gravity)
    ]  # fmt: skip
    mechanism = po.Mechanism("chain", [po.Base(), upper, lower], closures, ("u.y",), ("l.y",), planar=True)
    start = {"u.y": -1.0, "l.y": -2.0, "u.x": 0.1, "l.x": -0.1, "u.theta": 0.1, "t1": 40.0, "t2": 10.0}
    answer = po.Kinematics(mechanism).solve({"u.y": -1.0, "l.y": -2.0}, start)
    assert answer.status is po.Status.CONVERGED
    assert_allclose([answer.configuration["t1"], answer.configuration["t2"]], [5 * G, 2 * G], rtol=1e-12)
    other = Equilibrium("lower", [replace(t2, point_B=(0, 0.2))], mass=2.0, gravity=gravity)
    with pytest.raises(po.DefinitionError, match="tension 't2' of 'chain' is described twice, differently"):
        replace(mechanism, closures=[closures[0], other])


# --- Relations


def test_a_drum_winds_its_cable() -> None:
    mechanism = planar_cables(drums=True)
    answer = solve(mechanism, {"x": 0.42, "y": -0.4})
    v = answer.configuration
    for i in (1, 2):
        assert v[f"l{i}"] == pytest.approx(0.4 + 0.05 * v[f"d{i}"], abs=1e-12)
    kinematics = po.Kinematics(mechanism)
    report = po.report_state(kinematics, v)
    assert (report.mobility, report.ranks["M"].value) == (2, 2)
    back = kinematics.forward({"d1": v["d1"], "d2": v["d2"]}, v)
    assert_allclose(back.X, v.X, atol=1e-10)


def test_gears_and_pulleys_relate_variables() -> None:
    links = [po.Base(), *(po.Series(n, "base", joint=po.Revolute(n)) for n in ("wheel", "pinion", "wrap"))]
    links += [po.Series(n, "base", joint=po.Prismatic(n, "x")) for n in ("free", "paid")]
    closures = [
        Coupling({"wheel": 40.0, "pinion": 20.0}, angle=0.6),
        Coupling({"free": 1.0, "paid": -1.0}, radii={"wrap": 0.03}, length=0.2, name="pulley"),
    ]
    mechanism = po.Mechanism("shop", links, closures, ("pinion", "wrap"), ("free",))
    assert [(r.name, r.unit) for r in build_closure(mechanism).rows] == [
        ("coupling of wheel, pinion", "1"), ("pulley", "m")
    ]  # fmt: skip
    v = po.Kinematics(mechanism).solve({"pinion": 1.0, "free": 0.5, "wrap": 2.0}, {}).configuration
    assert v["wheel"] == pytest.approx((0.6 - 20.0) / 40.0)
    assert v["paid"] == pytest.approx(0.5 + 0.06 - 0.2)


def test_one_rope_over_an_idler_pulls_equally_on_both_sides() -> None:
    """With equal tensions the bar can hang in one place of each height only: under the middle."""
    mechanism = planar_cables([Coupling({"t1": 1.0, "t2": -1.0}, name="idler")])
    answer = solve(mechanism, {"y": -0.4}, {**HANGS, "x": 0.4})
    assert answer.configuration["x"] == pytest.approx(0.5, abs=1e-10)


# --- Refusals


def tension(**changes: Any) -> Tension:
    return Tension(
        **{"name": "t", "link_A": "base", "point_A": (0, 0, 1), "link_B": "body", "point_B": (0, 0, 0), **changes}
    )


def body(*closures: Closure, planar: bool = False) -> po.Mechanism:
    joint = po.Series("arm", "base", joint=po.Revolute("turn"))
    slide = po.Series("slide", "base", joint=po.Prismatic("s", "x"))
    return po.Mechanism("m", [po.Base(), joint, slide, po.Mobile("body")], closures, ("x",), ("y",), planar=planar)


FAULTS: dict[str, tuple[Callable[[], Any], str]] = {
    "tension to itself": (lambda: tension(link_B="base"), "pulls 'base' towards itself"),
    "no name": (lambda: tension(name=""), "name of a tension is ''"),
    "range": (lambda: tension(range=(3, 1)), r"range of 't' is \(3.0, 1.0\)"),
    "no tensions": (lambda: Equilibrium("body", [], mass=1), "there must be some"),
    "same tension": (lambda: Equilibrium("body", [tension(), tension()], mass=1), "each with its own name"),
    "another link": (
        lambda: Equilibrium("arm", [tension()], mass=1), "between 'base' and 'body'; one of them must be 'arm'"
    ),
    "no tension": (lambda: Equilibrium("body", ["t"], mass=1), "it must be a Tension"),  # type: ignore[list-item]
    "negative mass": (lambda: Equilibrium("body", [tension()], mass=-1), "mass in 'equilibrium of body' is -1.0 kg"),
    "nothing to judge by": (lambda: Equilibrium("body", [tension()]), "state a reference_force above 0"),
    "reference": (lambda: Equilibrium("body", [tension()], mass=1, reference_force=-2.0), "reference_force above 0"),
    "unknown link": (
        lambda: body(Equilibrium("body", [tension(link_A="bse")], mass=1)), "'bse'.*did you mean 'base'"
    ),
    "twice": (
        lambda: body(Equilibrium("body", [tension()], mass=1),
                     Equilibrium("body", [tension(name="u")], mass=1, name="again")),
        "equilibrium of link 'body' appears twice",
    ),
    "name of a joint": (lambda: body(Equilibrium("body", [tension(name="turn")], mass=1)), "'turn' appears twice"),
    "out of plane": (
        lambda: body(Equilibrium("body", [tension()], mass=1), planar=True),
        "gravity is .* third component must be zero",
    ),
    "one variable": (lambda: Coupling({"turn": 1.0}), "it must relate two or more"),
    "zero factor": (lambda: Coupling({"turn": 0.0, "x": 1.0}), "factor of 'turn' .* is zero"),
    "no number": (lambda: Coupling({"turn": "a", "x": 1.0}), "must be a number"),  # type: ignore[dict-item]
    "twice in one": (lambda: Coupling({"turn": 1.0}, radii={"turn": 1.0}), "has a factor and a radius"),
    "kinds": (lambda: body(Coupling({"turn": 1.0, "s": 1.0})), "different kinds, .*give angles among lengths a radius"),
    "radius of a length": (lambda: body(Coupling({"turn": 1.0}, radii={"s": 1.0})), "'s' has a radius .* is a length"),
    "constant": (lambda: body(Coupling({"x": 1.0, "s": 1.0}, angle=1.0)), "kind length, but states 'angle', 1.0"),
    "unknown": (lambda: body(Coupling({"trn": 1.0, "alpha": 1.0})), "'trn'.*did you mean 'turn'"),
}  # fmt: skip


@pytest.mark.parametrize(("build", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_faults_are_named(build: Callable[[], Any], message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        build()


# --- Files and figures


def test_files_hold_forces_in_newtons(tmp_path: Path) -> None:
    """Lengths of a file in millimetres are millimetres in moments and in gravity too; forces stay newtons."""
    file = tmp_path / "bar.toml"
    file.write_text(
        """
format = 1
units = { length = "mm", angle = "deg" }
name = "weight"
planar = true
active = ["y"]
operational = ["x"]
links = [{ type = "Base" }, { type = "Mobile", name = "body" }]
[[closures]]
type = "Equilibrium"
link = "body"
mass = 2
gravity = [0, -9810, 0]
moment = [0, 0, 500]
force = [1, 0, 0]
tensions = [{ name = "t", link_A = "base", point_A = [0, 0], link_B = "body", point_B = [0, 100], range = [1, 50] }]
[[closures]]
type = "Coupling"
coefficients = { y = 1 }
radii = { theta = 50 }
length = 20
[home]
x = 0
t = 19.62
[limits]
position = { t = [2, 40] }
"""
    )
    robot = po.load_robot(file)
    balance, relation = robot.mechanism.closures
    assert isinstance(balance, Equilibrium)
    assert isinstance(relation, Coupling)
    assert (balance.gravity, balance.moment, balance.force) == ((0, -9.81, 0), (0, 0, 0.5), (1, 0, 0))
    assert balance.tensions[0] == Tension("t", "base", (0, 0), "body", (0, 0.1), (1, 50))
    assert (dict(relation.radii), relation.length) == ({"theta": 0.05}, 0.02)
    assert (robot.home["t"], robot.limits.position["t"]) == (19.62, (2, 40))
    assert po.load_mechanism(po.save_mechanism(robot.mechanism, file)) == robot.mechanism


def test_the_link_graph_shows_balance_and_relations() -> None:
    graph = build_link_graph(planar_cables(drums=True))
    ties = {frozenset(tie.ends): [line.text for line in tie.lines] for tie in graph.ties if tie.kind == "closure"}
    assert ties[frozenset(("base", "bar"))] == ["equilibrium", "t1, t2"]
    assert ties[frozenset(("cable 1", "drum 1"))] == ["coupling"]


def test_a_hanging_machine_is_drawn(tmp_path: Path) -> None:
    robot = po.Robot(planar_cables(), HANGS)
    po.view.draw_robot(robot, tmp_path / "bar.png")
    assert (tmp_path / "bar.png").stat().st_size > 1000


def test_random_starts_are_within_reach() -> None:
    """Without a start, tensions begin within twice the weight, as lengths do within twice the machine's size."""
    kinematics = po.Kinematics(planar_cables())
    starts: Array = kinematics._starts(None)
    pulls = starts[:, kinematics.mechanism.indices(("t1", "t2"))]
    assert pulls.min() >= 0.0
    assert 2.0 * G < pulls.max() <= 4.0 * G
