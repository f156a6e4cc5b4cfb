"""Elimination of passives: agreement with the closed forms of the sources, and the caveats of models.md §2."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import subspace_angles

import paraopt as po
from paraopt.kinematics import Leg
from support import Array, five_bar_robot, raf_robot, two_rpr, two_rpr_values, vector


def model_of(kinematics: po.Kinematics, X: Array) -> po.VelocityModel:
    return po.eliminate_passives(kinematics, kinematics.configuration(X))


def assert_same_model(model: po.VelocityModel, A: Array, B: Array) -> None:
    """Compare with a closed form: A and B are known up to an invertible combination of their rows."""
    ours, theirs = np.hstack([model.A, model.B]), np.hstack([A, B])
    assert ours.shape == theirs.shape
    assert np.max(subspace_angles(ours.T, theirs.T)) < 1e-9
    assert_allclose(model.G, -np.linalg.solve(B, A), atol=1e-9)
    assert_allclose(model.forward, -np.linalg.solve(A, B), atol=1e-9)


def test_two_rpr_is_as_printed() -> None:
    """II.36-II.38: O holds the unit vectors of the legs, A their components, B = -1.

    Source: Lahouar, II.36-II.38.
    """
    kinematics = po.Kinematics(two_rpr(), "virtual machine")
    random = np.random.default_rng(0)
    for x, y in random.uniform((-3, 0.5), (6, 5), size=(10, 2)):
        values = two_rpr_values(x, y)
        model = model_of(kinematics, vector(kinematics.mechanism, values))
        unit = np.array([[np.cos(values[f"phi{i}"]), np.sin(values[f"phi{i}"])] for i in (1, 2)])
        assert_same_model(model, -unit, np.eye(2))
        printed_O = np.zeros((4, 2))
        printed_O[:2, 0], printed_O[2:, 1] = unit
        assert np.max(subspace_angles(model.O, printed_O)) < 1e-9
        assert_allclose(model.O.T @ model.N, 0, atol=1e-12)
        assert_allclose(model.O.T @ model.O, np.eye(2), atol=1e-12)


def test_five_bar_against_its_closed_form() -> None:
    """(P - B_i) . (Pdot - B_idot) = 0 for the elbows B_i.  Source: Chablat1998."""
    robot = five_bar_robot()
    for x, y in ((6.0, 7.0), (5.0, 8.0), (3.0, 7.5), (7.0, 6.0)):
        cfg = robot.kinematics.inverse({"x": x, "y": y}, robot.home_configuration).configuration
        feet, bars = np.array([[0.0, 0.0], [9.0, 0.0]]), (8.0, 5.0)
        A, B = np.zeros((2, 2)), np.zeros((2, 2))
        for i, (foot, bar) in enumerate(zip(feet, bars, strict=True)):
            theta = cfg[f"theta{i + 1}"]
            arm = bar * np.array([np.cos(theta), np.sin(theta)])
            distal = np.array([x, y]) - foot - arm
            A[i] = distal
            B[i, i] = -distal @ (-arm[1], arm[0])
        assert_same_model(po.eliminate_passives(robot.kinematics, cfg), A, B)


def planar_three_rpr() -> tuple[po.Mechanism, Array, Array]:
    feet = np.array([(-37.5, 21.651), (37.5, 21.651), (0, -43.301)])
    corners = np.array([(0, 0), (15, 0), (7.5, 12.990)])
    links: list[po.mechanism.Link] = [po.Base(), po.Mobile("plate")]
    closures = []
    for i, (foot, corner) in enumerate(zip(feet, corners, strict=True), start=1):
        links.append(po.Series(f"leg {i}", "base", tuple(foot), po.Revolute(f"phi{i}")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"rho{i}", "x")))
        closures.append(po.Coincidence(f"rod {i}", (0, 0), "plate", tuple(corner)))
    names = ("rho1", "rho2", "rho3")
    return po.Mechanism("3-RPR", links, closures, names, ("x", "y", "theta"), planar=True), feet, corners


def test_three_rpr_against_its_closed_form() -> None:
    """rho_i rhodot_i = (P + R b_i - a_i) . (Pdot + thetadot E R b_i): rows (n_x, n_y, (R b) x n), II.65."""
    mechanism, feet, corners = planar_three_rpr()
    kinematics = po.Kinematics(mechanism, "virtual machine")
    for x, y, theta in ((20, 0, 0.3), (-60, 50, 0.6), (5, -12, -1.9)):
        c, s = np.cos(theta), np.sin(theta)
        R = np.array([[c, -s], [s, c]])
        legs = np.array([x, y]) + corners @ R.T - feet
        rho = np.linalg.norm(legs, axis=1)
        values = {"x": x, "y": y, "theta": theta}
        for i in range(3):
            values |= {f"rho{i + 1}": rho[i], f"phi{i + 1}": np.arctan2(legs[i, 1], legs[i, 0])}
        n, arms = legs / rho[:, None], corners @ R.T
        A = np.column_stack([n, arms[:, 0] * n[:, 1] - arms[:, 1] * n[:, 0]])
        assert_same_model(model_of(kinematics, vector(mechanism, values)), A, -np.eye(3))


def test_stewart_against_its_closed_form() -> None:
    """qdot = n . (v + omega x R b), with omega the angular velocity of `Rx Ry Rz`.

    Annex B's printed signs of M, N and K contradict each other; this form is the checked one.
    """
    random = np.random.default_rng(1)
    angles = np.deg2rad([0, 40, 120, 160, 240, 280])
    feet = np.column_stack([np.cos(angles), np.sin(angles), 0.1 * random.normal(size=6)])
    ends = angles + 0.4 * (-1.0) ** np.arange(6)
    corners = np.column_stack([0.6 * np.cos(ends), 0.6 * np.sin(ends), 0.05 * random.normal(size=6)])
    links: list[po.mechanism.Link] = [po.Base(), po.Mobile("plate")]
    closures = []
    for i in range(6):
        links.append(po.Series(f"leg {i}", "base", tuple(feet[i]), po.Universal(f"s{i}")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"q{i}")))
        closures.append(po.Coincidence(f"rod {i}", (0, 0, 0), "plate", tuple(corners[i])))
    pose = ("x", "y", "z", "alpha", "beta", "gamma")
    mechanism = po.Mechanism("Stewart", links, closures, [f"q{i}" for i in range(6)], pose)
    kinematics = po.Kinematics(mechanism, "virtual machine")
    for _ in range(5):
        values = dict(zip(pose, random.normal((0, 0, 1.2, 0, 0, 0), 0.15), strict=True))
        cfg = kinematics.inverse(values, dict.fromkeys(mechanism.active, 1.2)).configuration
        R = np.asarray(po.transform((0, 0, 0), [values[a] for a in pose[3:]]))[:3, :3]
        legs = np.array([values[c] for c in "xyz"]) + corners @ R.T - feet
        n = legs / np.linalg.norm(legs, axis=1)[:, None]
        a, b = values["alpha"], values["beta"]
        omega = np.array([[1, 0, np.sin(b)], [0, np.cos(a), -np.sin(a) * np.cos(b)],
                          [0, np.sin(a), np.cos(a) * np.cos(b)]])  # fmt: skip
        A = np.hstack([n, np.cross(corners @ R.T, n) @ omega])
        assert_same_model(po.eliminate_passives(kinematics, cfg), A, -np.eye(6))


# --- Caveats


def test_b_stays_regular_at_a_parallel_singularity() -> None:
    """Caveat (a): with the source's unnormalised O, det B would be the sine between the legs and vanish here."""
    kinematics = po.Kinematics(two_rpr(characteristic_length=1.0), "virtual machine")
    aligned = vector(kinematics.mechanism, two_rpr_values(1.5, 0.0))
    model = model_of(kinematics, aligned)
    assert abs(np.linalg.det(model.B)) == pytest.approx(1.0, abs=1e-12)
    assert abs(np.linalg.det(model.A)) < 1e-12
    assert_allclose(model.O.T @ model.O, np.eye(2), atol=1e-12)
    assert model.condition_A > 1e12
    assert model.condition_B == pytest.approx(1.0)
    with pytest.raises(po.SolveError, match="parallel singularity"):
        _ = model.forward


def test_an_operational_variable_without_equation_fails_ii_23() -> None:
    """Caveat (b): the angle of the five-bar's end point enters no equation."""
    robot = five_bar_robot()
    m = robot.mechanism
    links = [po.Mobile("tip", ("x", "y", "theta")) if link.name == "tip" else link for link in m.links]
    wide = po.Mechanism(m.name, links, m.closures, m.active, ("x", "y", "theta"), planar=True)
    kinematics = po.Kinematics(wide, "virtual machine")
    home = robot.home_configuration
    X = np.array([home[n] if n != "theta" else 0.2 for n in wide.names])
    report = po.report_state(kinematics, kinematics.configuration(X))
    condition = report.condition("II.23")
    assert (condition.left, condition.right, condition.holds) == (2, 3, False)
    assert "choose fewer" in condition.verdict
    with pytest.raises(po.SolveError, match="rank of A is 2"):
        _ = po.eliminate_passives(kinematics, kinematics.configuration(X)).forward


def test_spins_of_legs_are_left_out() -> None:
    """Caveat (c): the RAF's three spins make N of rank 23 out of 26 columns; A and B are square all the same."""
    robot = raf_robot()
    model = po.eliminate_passives(robot.kinematics, robot.home_configuration)
    assert (model.A.shape, model.B.shape, model.N.shape) == ((3, 3), (3, 3), (33, 26))
    T = robot.kinematics.tangent(robot.home_configuration.X, ("x", "y", "z"))[0]
    assert_allclose(model.G, T[:3], atol=1e-11)


# --- Velocities


@pytest.mark.parametrize("robot", [five_bar_robot, raf_robot])
def test_velocities_of_all_roles_close_the_loops(robot: Callable[[], po.Robot]) -> None:
    machine = robot()
    mechanism = machine.mechanism
    model = po.eliminate_passives(machine.kinematics, machine.home_configuration)
    random = np.random.default_rng(2)
    xdot = {n: float(v) for n, v in zip(mechanism.operational, random.normal(size=3), strict=False)}
    qdot = model.active_velocities(xdot)
    passive = model.passive_velocities(qdot, xdot)
    back = model.operational_velocities(qdot)
    assert_allclose([back[n] for n in xdot], list(xdot.values()), atol=1e-10)
    everything = np.array([{**qdot, **passive, **xdot}[n] for n in mechanism.names])
    M, N, K = machine.kinematics.jacobians(machine.home_configuration.X)
    assert_allclose(np.hstack([M, N, K]) @ everything, 0, atol=1e-10)


def cross_drive() -> po.Kinematics:
    """Describe a slider on a line driven by two prismatic joints in series: a = 2, m = 2, r = 1."""
    links = [
        po.Base(),
        po.Series("coarse", "base", joint=po.Prismatic("q1", "x")),
        po.Series("fine", "coarse", joint=po.Prismatic("q2", "x")),
        po.Mobile("slider", ("x",)),
    ]
    closure = po.PointOnPlane("fine", (0, 0), "slider", (0, 0), (1, 0))
    return po.Kinematics(po.Mechanism("slider", links, [closure], ("q1", "q2"), ("x",), planar=True), "virtual machine")


def test_redundant_drives_share_the_motion() -> None:
    """II.33: the motion of smallest norm, half each; II.24 says redundant."""
    kinematics = cross_drive()
    cfg = kinematics.configuration([0.1, 0.2, 0.3])
    model = po.eliminate_passives(kinematics, cfg)
    assert model.active_velocities({"x": 1.0}) == pytest.approx({"q1": 0.5, "q2": 0.5})
    assert model.operational_velocities({"q1": 0.3, "q2": 0.2}) == pytest.approx({"x": 0.5})
    report = po.report_state(kinematics, cfg)
    assert report.is_redundant
    assert "redundant" in report.kind


def three_legs() -> po.Kinematics:
    """Hold a point of the plane by three legs: a = 3 drives for m = 2 freedoms."""
    links: list[po.mechanism.Link] = [po.Base(), po.Mobile("tip", ("x", "y"))]
    for i, at in enumerate(((0, 0), (4, 0), (2, 5)), start=1):
        links.append(po.Series(f"leg {i}", "base", at, po.Revolute(f"phi{i}")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"rho{i}", "x")))
    ties = [po.Coincidence(f"rod {i}", (0, 0), "tip", (0, 0)) for i in (1, 2, 3)]
    names = ("rho1", "rho2", "rho3")
    return po.Kinematics(po.Mechanism("tripod", links, ties, names, ("x", "y"), planar=True), "virtual machine")


def test_more_drives_than_freedoms_move_in_agreement() -> None:
    """Three equations are left for two platform velocities: the drives' motion is the only one, not the smallest."""
    kinematics = three_legs()
    cfg = kinematics.inverse({"x": 1.0, "y": 2.0}, dict.fromkeys(("rho1", "rho2", "rho3"), 2.0)).configuration
    model = po.eliminate_passives(kinematics, cfg)
    assert (model.A.shape, model.B.shape) == ((3, 2), (3, 3))
    feet = np.array([[0, 0], [4, 0], [2, 5]])
    # a leg's length changes by the velocity along the leg, whichever way its length is counted
    signs = np.sign([cfg[f"rho{i}"] for i in (1, 2, 3)])
    unit = (cfg.operational - feet) / np.linalg.norm(cfg.operational - feet, axis=1)[:, None]
    assert_allclose(model.G, signs[:, None] * unit, atol=1e-10)
    report = po.report_state(kinematics, cfg)
    assert report.is_redundantly_actuated
    assert not report.is_redundant
    assert not report.condition("II.22").holds
    with pytest.raises(po.SolveError, match="contradict"):  # drives that work against each other
        model.passive_velocities({"rho1": 1.0, "rho2": 1.0, "rho3": 1.0}, {"x": 0.0, "y": 0.0})


def test_serial_singularity_has_no_inverse_velocities() -> None:
    kinematics = five_bar_robot().kinematics
    tip = 13.0 * np.array([np.cos(1.0), np.sin(1.0)])
    w = tip - (9.0, 0.0)
    theta4 = np.arccos((w @ w - 25 - 64) / 80)
    theta2 = np.arctan2(w[1], w[0]) - np.arctan2(8 * np.sin(theta4), 5 + 8 * np.cos(theta4))
    values = {"theta1": 1.0, "theta3": 0.0, "theta2": theta2, "theta4": theta4, "x": tip[0], "y": tip[1]}
    model = model_of(kinematics, vector(kinematics.mechanism, values))
    with pytest.raises(po.SolveError, match="serial singularity: the rank of B is 1, 2 are needed"):
        _ = model.G


@pytest.mark.parametrize(
    ("given", "word"),
    [({"x": 1.0}, r"missing \['y'\]"), ({"x": 1, "y": 1, "w": 0}, r"\['w'\]"), ({"x": np.nan, "y": 0}, "finite"),
     ({"x": "fast", "y": 0}, "numbers")],
)  # fmt: skip
def test_faulty_velocities_are_refused(given: dict[str, float], word: str) -> None:
    robot = five_bar_robot()
    with pytest.raises(po.DefinitionError, match=word):
        po.eliminate_passives(robot.kinematics, robot.home_configuration).active_velocities(given)


# --- Legs


def test_legs_are_found_by_sparsity() -> None:
    legs = five_bar_robot().kinematics.legs
    assert legs == (Leg((0, 1), ("theta1",), ("theta3",)), Leg((2, 3), ("theta2",), ("theta4",)))
    assert [leg.name for leg in legs] == ["theta1", "theta2"]
    three = po.Kinematics(planar_three_rpr()[0], "virtual machine").legs
    assert [leg.variables for leg in three] == [(f"rho{i}", f"phi{i}") for i in (1, 2, 3)]
    # the platform's passive angles tie the RAF's legs together; its idle spins belong to none
    (whole,) = raf_robot().kinematics.legs
    assert len(whole.rows) == 33
    assert not {"jack 1.z", "jack 2.z", "jack 3.z"} & set(whole.variables)
