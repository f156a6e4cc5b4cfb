"""XFKM: nearest values within the ranges, weights, imposed expressions, and how an answer says what it is."""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics.interior import solve_interior
from support import Array, five_bar_robot, raf_robot, two_rpr, two_rpr_values, vector

CLOSED = 1e-12


@functools.cache
def short_legs() -> po.Kinematics:
    """Describe the 2-RPR with legs of 1 to 3 on feet 4 apart."""
    m = two_rpr()
    links = [
        po.Series(k.name, k.father, k.at, po.Prismatic(k.joint.name, "x", (1.0, 3.0)))
        if isinstance(k, po.Series) and isinstance(k.joint, po.Prismatic)
        else k
        for k in m.links
    ]
    return po.Kinematics(po.Mechanism(m.name, links, m.closures, m.active, m.operational, planar=True))


def start(x: float = 2.0, y: float = 1.5) -> Array:
    return vector(short_legs().mechanism, two_rpr_values(x, y))


def test_exact_values_within_the_ranges_are_met() -> None:
    answer = short_legs().fit({"x": 1.8, "y": 1.2}, start())
    assert (answer.status, answer.solver, answer.at_bound) == (po.Status.CONVERGED, "newton", ())
    assert answer.distance == 0.0
    assert answer.residual <= CLOSED


def test_an_exact_solution_out_of_range_is_no_answer_of_fit() -> None:
    """Leg 1 would be 3.6 long. `solve` gives it and says so; `fit` gives the nearest point at 3 from the first foot."""
    impose = {"x": 3.0, "y": 2.0}
    solved = short_legs().solve(impose, start())
    assert (solved.status, solved.out_of_range) == (po.Status.CONVERGED, ("rho1",))
    answer = short_legs().fit(impose, start())
    assert answer.status is po.Status.NEAREST
    assert answer.out_of_range == ()
    assert answer.at_bound == ("rho1",)
    expected = 3.0 * np.array([3.0, 2.0]) / np.hypot(3, 2)
    assert_allclose(answer.nearest.operational, expected, atol=1e-6)
    scaled = (np.hypot(3, 2) - 3.0) / short_legs().mechanism.length
    assert answer.distance == pytest.approx(scaled, rel=1e-5)
    assert "at the end of their range: 'rho1'" in answer.summary
    with pytest.raises(po.SolveError, match="nearest"):
        _ = answer.configuration


def test_both_legs_at_their_ends() -> None:
    """High above the feet: the nearest point is where both circles of radius 3 meet."""
    answer = short_legs().fit({"x": 2.0, "y": 9.0}, start())
    assert answer.status is po.Status.NEAREST
    assert set(answer.at_bound) == {"rho1", "rho2"}
    assert_allclose(answer.nearest.operational, (2.0, np.sqrt(5.0)), atol=1e-6)


@pytest.mark.parametrize("ratio", [1.0, 5.0, 0.2])
def test_weights_choose_between_what_cannot_be_met_together(ratio: float) -> None:
    """The tip is wanted at (1.4, 0.7), which is 1.565 from the foot, and the leg 2 long."""
    wanted = np.array([1.4, 0.7])
    impose = {"x": 1.4, "y": 0.7, "rho1": 2.0}
    answer = short_legs().fit(impose, start(), weights={"rho1": ratio})
    assert (answer.status, answer.at_bound) == (po.Status.NEAREST, ())
    # stationary along the ray from the foot: (r - 1.565) + ratio^2 (r - 2) = 0
    r = (np.linalg.norm(wanted) + ratio**2 * 2.0) / (1 + ratio**2)
    assert answer.nearest["rho1"] == pytest.approx(r, abs=1e-6)
    assert_allclose(answer.nearest.operational, r * wanted / np.linalg.norm(wanted), atol=1e-6)


def test_interior_point_and_quadratic_programs_agree() -> None:
    kinematics = short_legs()
    index = kinematics.mechanism.index
    low, high = (np.array(b) for b in zip(*[v.range for v in kinematics.mechanism.variables], strict=True))
    for x, y in ((3.0, 2.0), (2.0, 9.0), (0.2, 0.1), (6.0, -1.0)):
        target, weight = np.zeros(6), np.zeros(6)
        target[[index("x"), index("y")]], weight[[index("x"), index("y")]] = (x, y), 1.0
        X, _, word = solve_interior(kinematics.functions, start(), target, weight, low, high, np.arange(4))
        assert word == "Solve_Succeeded"
        answer = kinematics.fit({"x": x, "y": y}, start())
        assert_allclose(answer.nearest.operational, X[-2:], atol=1e-5)


def test_the_raf_is_fitted_from_a_far_open_start() -> None:
    """Redundant rows and idle spins; nothing of the start is closed, and the target is beyond the strokes."""
    robot = raf_robot()
    far = {"x": 0.3, "y": -0.3, "z": 0.9, "arm A": 2.0, "q1": 0.5, "alpha": 0.8}
    answer = robot.kinematics.fit({"x": 0.0, "y": 0.0, "z": 0.7}, far)
    if answer.status is po.Status.FAILED:
        with pytest.raises(po.SolveError, match="failed"):
            _ = answer.nearest
    else:
        assert answer.out_of_range == ()
        assert robot.kinematics.scaled_residual(answer.nearest.X)[0] <= CLOSED
    near = robot.kinematics.fit({"x": 0.0, "y": 0.0, "z": 0.7}, robot.home_configuration)
    assert near.status is po.Status.NEAREST
    assert set(near.at_bound) >= {"q1", "q2"}


def test_ipopt_answers_where_the_programs_did_not_settle() -> None:
    hurried = po.SolveOptions(nearest_iterations=1)
    answer = short_legs().fit({"x": 3.0, "y": 2.0}, start(), options=hurried)
    assert (answer.status, answer.solver) == (po.Status.NEAREST, "ipopt")
    assert_allclose(answer.nearest.operational, 3.0 * np.array([3.0, 2.0]) / np.hypot(3, 2), atol=1e-5)
    given_up = po.SolveOptions(nearest_iterations=1, interior_iterations=1)
    assert short_legs().fit({"x": 3.0, "y": 2.0}, start(), options=given_up).status is po.Status.FAILED


@pytest.mark.parametrize(
    ("weights", "word"),
    [({"z": 1.0}, "'z'"), ({"x": 0.0}, "above 0"), ({"x": -1}, "above 0"), ({"x": np.nan}, "finite"),
     ({"x": "heavy"}, "number")],
)  # fmt: skip
def test_faulty_weights_are_refused(weights: dict[str, Any], word: str) -> None:
    with pytest.raises(po.DefinitionError, match=word):
        short_legs().fit({"x": 1.0, "y": 1.0}, start(), weights=weights)


# --- Imposed expressions


def distance_between(one: str, other: str) -> Any:
    return lambda q, X_W: ca.norm_2(X_W[one][:3, 3] - X_W[other][:3, 3])


def test_an_imposed_expression_is_met() -> None:
    """The five-bar with its two elbows a stated distance apart, and the tip at a stated height."""
    robot = five_bar_robot()
    gauged = robot.kinematics.with_gauges(po.Gauge("between elbows", distance_between("distal 1", "distal 2")))
    assert gauged.mechanism.names == ("theta1", "theta2", "theta3", "theta4", "between elbows", "x", "y")
    answer = gauged.solve({"between elbows": 9.0, "y": 7.2}, robot.home_configuration)
    assert answer.status is po.Status.CONVERGED
    cfg = answer.configuration
    elbows = [np.array([f + bar * np.cos(cfg[t]), bar * np.sin(cfg[t])])
              for f, bar, t in ((0, 8, "theta1"), (9, 5, "theta2"))]  # fmt: skip
    assert np.linalg.norm(elbows[0] - elbows[1]) == pytest.approx(9.0, abs=1e-11)
    assert robot.kinematics.scaled_residual([cfg[n] for n in robot.mechanism.names])[0] <= CLOSED
    # too far apart: 13 is the most that the distal bars span
    nearest = gauged.solve({"between elbows": 14.0}, cfg)
    assert nearest.status is po.Status.NEAREST
    assert nearest.nearest["between elbows"] == pytest.approx(13.0, abs=1e-4)


def test_gauges_show_what_they_measure() -> None:
    robot = five_bar_robot()
    gauged = robot.kinematics.with_gauges(
        po.Gauge("turn", lambda q, X_W: q["theta1"] + q["theta3"], kind="angle"),
        po.Gauge("height", lambda q, X_W: X_W["tip"][1, 3]),
    )
    cfg = gauged.solve({"x": 6.2, "y": 7.1}, robot.home_configuration).configuration
    assert cfg["turn"] == pytest.approx(cfg["theta1"] + cfg["theta3"], abs=1e-12)
    assert cfg["height"] == pytest.approx(7.1, abs=1e-12)
    report = po.report_state(gauged, cfg)
    assert (report.mobility, report.useful_mobility, report.n_equations) == (2, 2, 6)
    assert gauged.graph.rows[-1].unit == "m"
    more = gauged.with_gauges(po.Gauge("twice", lambda q, X_W: 2 * q["turn"], kind="angle"))
    assert [g.name for g in more.gauges] == ["turn", "height", "twice"]
    again = more.solve({"x": 6.2, "y": 7.1}, robot.home_configuration).configuration
    assert again["twice"] == pytest.approx(2 * cfg["turn"], abs=1e-12)


@pytest.mark.parametrize(
    ("gauge", "word"),
    [
        (po.Gauge("x", lambda q, X_W: q["y"]), "'x' appears twice"),
        (po.Gauge("g", lambda q, X_W: q["theta9"]), "'theta9'"),
        (po.Gauge("g", lambda q, X_W: X_W["nowhere"][0, 3]), "'nowhere'"),
        (po.Gauge("g", lambda q, X_W: X_W["tip"]), r"shape \(4, 4\)"),
        (po.Gauge("g", lambda q, X_W: "far"), "'g' cannot be built"),  # type: ignore[arg-type, return-value]
        (po.Gauge("g", lambda q, X_W: q["x"], range=(1.0, 0.0)), "range of 'g'"),
    ],
)
def test_faulty_gauges_are_refused(gauge: po.Gauge, word: str) -> None:
    with pytest.raises(po.DefinitionError, match=word):
        five_bar_robot().kinematics.with_gauges(gauge)


# --- The tripod's walking mode, models.md §7


@functools.cache
def tripod() -> po.Kinematics:
    return po.Kinematics(po.robots.tripod(free_feet=True).mechanism, "virtual machine")


def test_locked_joints_of_the_tripod_as_expressions() -> None:
    """The length q4 of a chain and the relation of its actuators, q^2 = q4^2 + d^2 -+ 2 q4 d sin q5, as gauges."""
    robot = po.robots.tripod(free_feet=True)
    d = 0.15 * np.sin(np.radians(20))

    def actuator(sign: float) -> Any:
        return lambda q, X_W: ca.sqrt(q["q4 1"] ** 2 + d**2 + sign * 2 * q["q4 1"] * d * ca.sin(q["q5 1"]))

    gauged = tripod().with_gauges(po.Gauge("left", actuator(-1.0)), po.Gauge("right", actuator(1.0)))
    home = robot.home_configuration
    cfg = gauged.solve({}, home.as_dict()).configuration
    real = sorted((cfg["qL 1"], cfg["qR 1"]))
    assert_allclose(sorted((cfg["left"], cfg["right"])), real, atol=1e-10)


LOCKED = ("q1 1", "q2 1", "q3 1", "q6 1", "q1 2", "q1 3")


def test_locks_of_a_level_platform_are_singular() -> None:
    """Six locked angles and three feet imposed: rank one short where the platform is level, full where it is tilted."""
    robot = po.robots.tripod(free_feet=True)
    home = (
        po.Kinematics(robot.mechanism, "virtual machine")
        .inverse({n: robot.home[n] for n in robot.mechanism.operational}, robot.home)
        .configuration
    )
    feet = [n for n in robot.mechanism.names if n.startswith("foot")]
    level = tripod().solve({n: home[n] for n in (*LOCKED, *feet)}, home)
    assert (level.status, level.undetermined) == (po.Status.SINGULAR, 1)
    assert "not unique" in level.summary
    pose = {n: home[n] for n in (*feet, "x", "y", "z", "alpha", "beta", "gamma")}
    tilted = tripod().solve(pose | {"beta": 0.3}, home).configuration
    locked = tripod().solve({n: tilted[n] for n in (*LOCKED, *feet)}, tilted)
    assert (locked.status, locked.undetermined) == (po.Status.CONVERGED, 0)
    assert locked.rank.value == level.rank.value + 1
