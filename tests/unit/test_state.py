"""The state of a mechanism: ranks as printed, mobility, signed determinants, margins and their gradients."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants, compute_rank, independent_rows
from support import assert_derivative, five_bar_robot, raf_configurations, raf_robot, two_rpr, two_rpr_values, vector


def ranks(report: po.StateReport) -> dict[str, int]:
    return {name: rank.value for name, rank in report.ranks.items()}


# --- The RAF, models.md §2-3


def test_raf_is_as_printed() -> None:
    robot = raf_robot()
    for configuration in (robot.home_configuration, *raf_configurations()):
        report = po.report_state(robot.kinematics, configuration)
        assert (report.n_variables, report.n_equations) == (32, 33)
        assert ranks(report) == {"E": 26, "M": 3, "N": 23, "K": 3, "[N K]": 26, "[M N]": 26}
        assert (report.mobility, report.useful_mobility, report.redundant_rows) == (6, 3, 7)
        assert report.idle == ("jack 1.z", "jack 2.z", "jack 3.z")
        E = robot.kinematics.functions.scaled_jacobian(configuration.X)[0]
        assert len(report.independent_rows) == 26
        assert np.linalg.svd(E[report.independent_rows], compute_uv=False)[-1] > 1e-3
        # the rank is no matter of the tolerance: singular values above 1e-3, then below 1e-14
        assert all(rank.gap > 1e8 for rank in report.ranks.values())
        assert report.parallel_margin > 0.1
        assert report.serial_margin > 0.3


def test_report_of_the_raf_reads_well() -> None:
    text = str(po.report_state(raf_robot().kinematics, raf_robot().home_configuration))
    for part in (
        "RAF: 32 variables, 33 equations, rg E = 26, rg M = 3, rg N = 23, rg K = 3, rg [N K] = 26",
        "mobility 6 = 3 useful + 3 idle ['jack 1.z', 'jack 2.z', 'jack 3.z'], 7 redundant equations",
    ):
        assert part in text


def without_chains(*arms: str) -> tuple[po.Kinematics, po.Configuration]:
    """Take passive chains off the RAF, each with its arm and both forearms."""
    robot = raf_robot()
    whole = robot.mechanism
    gone = {link.name for link in whole.links for arm in arms if link.name.split()[-1][0] == arm}
    mechanism = dataclasses.replace(
        whole,
        links=[link for link in whole.links if link.name not in gone],
        closures=[c for c in whole.closures if c.link_A not in gone],
    )
    home = robot.home_configuration
    kinematics = po.Kinematics(mechanism, "virtual machine")
    return kinematics, kinematics.configuration([home[name] for name in mechanism.names])


@pytest.mark.parametrize(
    ("arms", "mobility", "equations", "rank"),
    [((), 6, 33, 26), (("B",), 7, 21, 18), (("A",), 7, 21, 18), (("A", "B"), 9, 9, 9)],
    ids=["whole", "one chain A", "one chain B", "no chain"],
)
def test_mobility_of_the_raf_without_its_chains(arms: Sequence[str], mobility: int, equations: int, rank: int) -> None:
    """With one passive chain m = 7, with none 9: three of them always the spins of the jacks."""
    report = po.report_state(*without_chains(*arms))
    assert (report.n_equations, report.ranks["E"].value) == (equations, rank)
    assert report.mobility == mobility
    assert report.useful_mobility == mobility - 3
    assert report.idle == ("jack 1.z", "jack 2.z", "jack 3.z")
    # three actuators hold three freedoms; with more there is no determinant
    assert np.isfinite(report.parallel_determinant) == (mobility == 6)


@pytest.mark.parametrize("arms", [("B",), ("A",), ("A", "B")], ids=" ".join)
def test_freedoms_that_no_actuator_holds_leave_no_margin(arms: Sequence[str]) -> None:
    report = po.report_state(*without_chains(*arms))
    # [N K] has more columns than rank: the platform turns with blocked jacks
    assert (report.parallel_margin, report.serial_margin) == (0.0, 0.0)


def test_chains_keep_the_platform_level_in_finite_motion() -> None:
    """The three angles stay zero all over the workspace, strokes of 200 mm: they are not imposed anywhere."""
    robot = raf_robot()
    home = robot.home_configuration
    axes = (np.linspace(-0.12, 0.12, 7), np.linspace(-0.12, 0.12, 7), np.linspace(0.42, 0.6, 7))
    poses = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    batch = robot.kinematics.solve_batch(("x", "y", "z"), poses, np.tile(home.X, (len(poses), 1)))
    X = batch.X[batch.converged]
    X = X[np.all((X[:, :3] >= 0.0) & (X[:, :3] <= 0.2), axis=1)]
    assert len(X) > 150
    angles = X[:, robot.mechanism.indices(["alpha", "beta", "gamma"])]
    # the bound of the issue; a closure residual of 1e-12 over the platform's 0.1 m gives 1e-11
    assert np.abs(angles).max() < 1e-9


# --- Planar machines, models.md §2


def test_five_bar_is_as_printed() -> None:
    report = po.report_state(five_bar_robot().kinematics, five_bar_robot().home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility, report.useful_mobility) == (6, 4, 2, 2)
    assert ranks(report) == {"E": 4, "M": 2, "N": 2, "K": 2, "[N K]": 4, "[M N]": 4}
    assert (report.idle, report.redundant_rows) == ((), 0)


def three_rpr() -> po.Mechanism:
    base, plate = [(0, 0), (75, 0), (37.5, 64.952)], [(0, 0), (15, 0), (7.5, 12.990)]
    links: list[po.mechanism.Link] = [po.Base(), po.Mobile("plate")]
    for i, at in enumerate(base, start=1):
        links.append(po.Series(f"leg {i}", "base", at, po.Revolute(f"phi{i}")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"rho{i}", "x")))
    return po.Mechanism(
        "3-RPR",
        links,
        [po.Coincidence(f"rod {i}", (0, 0), "plate", p) for i, p in enumerate(plate, start=1)],
        active=("rho1", "rho2", "rho3"),
        operational=("x", "y", "theta"),
        planar=True,
    )


def stewart(spherical: bool) -> po.Mechanism:
    angles = np.deg2rad([0, 40, 120, 160, 240, 280])
    links: list[po.mechanism.Link] = [po.Base(), po.Mobile("plate")]
    closures = []
    for i, angle in enumerate(angles, start=1):
        at = (np.cos(angle), np.sin(angle), 0.0)
        joint = po.Spherical(f"s{i}") if spherical else po.Universal(f"s{i}")
        links.append(po.Series(f"leg {i}", "base", at, joint))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"q{i}")))
        end = angle + (0.4 if i % 2 else -0.4)
        closures.append(po.Coincidence(f"rod {i}", (0, 0, 0), "plate", (0.6 * np.cos(end), 0.6 * np.sin(end), 0)))
    active = [f"q{i}" for i in range(1, 7)]
    return po.Mechanism("Stewart", links, closures, active, ("x", "y", "z", "alpha", "beta", "gamma"))


@pytest.mark.parametrize(
    ("mechanism", "pose", "rod", "expected"),
    [
        # N, equations, rank E, m
        (two_rpr(), {"x": 1.0, "y": 2.0}, "rho", (6, 4, 4, 2)),
        (three_rpr(), {"x": 20.0, "y": 10.0, "theta": 0.3}, "rho", (9, 6, 6, 3)),
        (
            stewart(False),
            {"z": 1.2, "x": 0.1, "y": -0.1, "alpha": 0.1, "beta": 0.2, "gamma": 0.1},
            "q",
            (24, 18, 18, 6),
        ),
        (
            stewart(True),
            {"z": 1.2, "x": 0.1, "y": -0.1, "alpha": 0.1, "beta": 0.2, "gamma": 0.1},
            "q",
            (30, 18, 18, 12),
        ),
    ],
    ids=["2-RPR", "3-RPR", "Stewart", "Stewart with spherical joints"],
)
def test_counts_are_as_printed(
    mechanism: po.Mechanism, pose: Mapping[str, float], rod: str, expected: tuple[int, int, int, int]
) -> None:
    kinematics = po.Kinematics(mechanism, "virtual machine")
    start = {n: mechanism.length for n in mechanism.active if n.startswith(rod)}
    report = po.report_state(kinematics, kinematics.inverse(pose, start).configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == expected
    assert report.useful_mobility == len(mechanism.operational)
    assert ranks(report)["[N K]"] == ranks(report)["[M N]"] == expected[2]
    # II.26: the platform cannot move with blocked actuators; II.27: nor the actuators with a blocked platform
    assert ranks(report)["[N K]"] == ranks(report)["N"] + ranks(report)["K"]
    assert ranks(report)["[M N]"] == ranks(report)["M"] + ranks(report)["N"]


# --- Ranks and rows


def test_rank_counts_singular_values_above_the_tolerance() -> None:
    U, V = (np.linalg.qr(np.random.default_rng(i).normal(size=(6, 6)))[0] for i in (0, 1))
    matrix = U @ np.diag([5.0, 1.0, 0.1, 1e-6, 1e-10, 0.0]) @ V
    rank = compute_rank(matrix)
    assert rank.value == 4
    assert rank.smallest_kept == pytest.approx(1e-6, rel=1e-6)
    assert rank.largest_dropped == pytest.approx(1e-10, rel=1e-3)
    assert rank.gap == pytest.approx(1e4, rel=1e-3)
    assert compute_rank(matrix, tolerance=1e-3).value == 3
    assert compute_rank(1e-9 * matrix).value == 4  # relative to the largest
    assert compute_rank(np.zeros((3, 3))).value == 0
    assert compute_rank(np.zeros((0, 3))).value == 0
    assert compute_rank(np.eye(3)).gap == np.inf


def test_independent_rows_span_all_rows() -> None:
    random = np.random.default_rng(2)
    rows = random.normal(size=(4, 9))
    matrix = random.normal(size=(10, 4)) @ rows
    chosen = independent_rows(matrix)
    assert len(chosen) == 4
    assert list(chosen) == sorted(set(chosen))
    assert np.linalg.matrix_rank(matrix[chosen]) == 4
    # every row is a combination of the chosen ones
    combination = np.linalg.lstsq(matrix[chosen].T, matrix.T, rcond=None)[0]
    assert_allclose(matrix[chosen].T @ combination, matrix.T, atol=1e-12)
    assert independent_rows(np.zeros((0, 3))).size == 0
    assert independent_rows(np.zeros((2, 3))).size == 0


# --- Determinants and margins are the same thing


@pytest.mark.parametrize("robot", ["RAF", "five-bar", "2-RPR"])
def test_determinants_are_volumes_of_the_motion_space(robot: str) -> None:
    """By complementary minors |det [N K]| / sqrt(det E E^T) is the volume of the active rows of a basis of motions."""
    if robot == "RAF":
        kinematics, X = raf_robot().kinematics, np.array([c.X for c in raf_configurations()])
    elif robot == "five-bar":
        kinematics = five_bar_robot().kinematics
        start = five_bar_robot().home_configuration
        tips = ((6.0, 7.0), (5.0, 8.0), (3.0, 7.5), (7.0, 6.0))
        X = np.array([kinematics.inverse({"x": x, "y": y}, start).configuration.X for x, y in tips])
    else:
        kinematics = po.Kinematics(two_rpr(), "virtual machine")
        X = np.array([vector(kinematics.mechanism, two_rpr_values(x, y)) for x, y in ((1, 2), (3, -1), (-2, 0.5))])
    determinants = Determinants.at(kinematics, kinematics.configuration(X[0]))
    assert determinants.has_parallel
    assert determinants.has_serial
    parallel, serial = determinants(X)
    margins = po.MotionSpace(kinematics).margins(X)
    # the tangent is regularised by 1e-12, which a margin of 0.1 turns into some 1e-11
    assert_allclose(np.log(np.abs(parallel)), margins.log_parallel, atol=1e-9)
    assert_allclose(np.log(np.abs(serial)), margins.log_serial, atol=1e-9)
    assert np.all(np.abs(parallel) <= 1)
    assert np.all(np.abs(serial) <= 1)
    # a volume is at least the product of the smallest stretch, and at most that stretch
    m = len(kinematics.mechanism.operational)
    for stretch, volume in ((margins.parallel, parallel), (margins.serial, serial)):
        assert np.all(stretch**m <= np.abs(volume) + 1e-12)
        assert np.all(np.abs(volume) <= stretch + 1e-12)


def test_determinants_of_the_2_rpr_by_hand() -> None:
    """det [N K] and det [M N] of the 2-RPR are +-rho1 rho2 times (sine between the legs, one)."""
    mechanism = two_rpr(characteristic_length=1.0)
    kinematics = po.Kinematics(mechanism, "virtual machine")
    for x, y in ((1.0, 2.0), (3.0, -1.0), (-2.0, 0.5)):
        values = two_rpr_values(x, y)
        X = vector(mechanism, values)
        E = np.hstack(kinematics.jacobians(X))
        volume = np.sqrt(np.linalg.det(E @ E.T))
        parallel, serial = Determinants.at(kinematics, kinematics.configuration(X))(X)
        product = values["rho1"] * values["rho2"]
        sine = np.sin(values["phi1"] - values["phi2"])
        assert abs(parallel[0]) == pytest.approx(abs(product * sine) / volume, rel=1e-12)
        assert abs(serial[0]) == pytest.approx(product / volume, rel=1e-12)


def test_margin_is_the_largest_amplification_of_the_actuators() -> None:
    """1 / margin bounds the motion of the whole for a unit motion of the actuators, and is reached."""
    robot = raf_robot()
    configuration = raf_configurations()[4]
    space = po.MotionSpace(robot.kinematics)
    T = space.tangent(configuration.X)[0] / robot.kinematics.graph.variable_scale[:, None]
    margin = space.margins(configuration.X).parallel[0]
    directions = np.random.default_rng(0).normal(size=(3, 20000))
    motion = T @ directions
    ratio = np.linalg.norm(motion[:3], axis=0) / np.linalg.norm(motion, axis=0)
    assert np.all(ratio >= margin * (1 - 1e-9))
    assert ratio.min() < margin * 1.01  # 20000 directions come that near in three dimensions


@pytest.mark.parametrize("independent", [("x", "y", "z"), ("q1", "q2", "q3")], ids=" ".join)
@pytest.mark.parametrize("which", [0, 3, 8])
def test_margin_gradients(independent: tuple[str, ...], which: int) -> None:
    kinematics, configuration = raf_robot().kinematics, raf_configurations()[which]
    space = po.MotionSpace(kinematics, independent)
    T = space.tangent(configuration.X)
    margins, *gradients = space.margin_gradients(configuration.X, T)
    plain = space.margins(configuration.X)
    at = np.array([configuration[n] for n in independent])
    for name, gradient in zip(("parallel", "serial", "log_parallel", "log_serial"), gradients, strict=True):
        # by the singular values of a basis, and by a generalised eigenvalue: squared, hence the square of round-off
        assert_allclose(getattr(margins, name), getattr(plain, name), rtol=1e-9)

        def value(values: np.ndarray, name: str = name) -> float:
            solution = kinematics.solve(dict(zip(independent, values.tolist(), strict=True)), configuration)
            return float(getattr(space.margins(solution.configuration.X), name)[0])

        # two singular values that nearly meet ask for a short step, over which noise of some 1e-13 gives 1e-8
        assert_derivative(gradient[0], value, at, step=3e-5, tolerance=1e-7)


def test_margins_do_not_depend_on_the_independent_coordinates() -> None:
    kinematics = raf_robot().kinematics
    X = np.array([c.X for c in raf_configurations()])
    reference = po.MotionSpace(kinematics).margins(X)
    for independent in (("q1", "q2", "q3"), ("x", "y", "q3")):
        other = po.MotionSpace(kinematics, independent).margins(X)
        for name in ("parallel", "serial", "log_parallel", "log_serial"):
            assert_allclose(getattr(other, name), getattr(reference, name), atol=1e-8)


# --- Signs change across singularities, and only there


def five_bar_at(theta1: float, theta2: float, side: float = 1.0) -> dict[str, float]:
    """Close the five-bar by hand with its driven bars given: two circles about the elbows."""
    B1, B2 = (
        np.array([8 * np.cos(theta1), 8 * np.sin(theta1)]),
        np.array([9 + 5 * np.cos(theta2), 5 * np.sin(theta2)]),
    )
    d = B2 - B1
    D = np.linalg.norm(d)
    along = (5**2 - 8**2 + D**2) / (2 * D)
    P = B1 + (along * d + side * np.sqrt(5**2 - along**2) * np.array([-d[1], d[0]])) / D
    first, second = np.arctan2(*(P - B1)[::-1]), np.arctan2(*(P - B2)[::-1])
    return {
        "theta1": theta1, "theta2": theta2, "theta3": float(first - theta1), "theta4": float(second - theta2),
        "x": float(P[0]), "y": float(P[1]),
    }  # fmt: skip


def five_bar_reaching(x: float, y: float, elbows: tuple[float, float]) -> dict[str, float]:
    """Close the five-bar by hand with its tip given, elbows chosen by sign: a working mode."""
    values = {"x": x, "y": y}
    for i, (origin, bars) in enumerate(((0.0, (8.0, 5.0)), (9.0, (5.0, 8.0)))):
        w = np.array([x - origin, y])
        elbow = elbows[i] * np.arccos((w @ w - bars[0] ** 2 - bars[1] ** 2) / (2 * bars[0] * bars[1]))
        drive = np.arctan2(w[1], w[0]) - np.arctan2(bars[1] * np.sin(elbow), bars[0] + bars[1] * np.cos(elbow))
        values |= {f"theta{i + 1}": float(drive), f"theta{i + 3}": float(elbow)}
    return values


def test_parallel_determinant_of_the_five_bar_changes_sign_where_its_distal_bars_align() -> None:
    """On both sides of the alignment are the two assembly modes of the same actuators."""
    kinematics = five_bar_robot().kinematics
    determinants = Determinants.at(kinematics, five_bar_robot().home_configuration)
    # with theta1 = 2.4 the elbows are 13 apart, the bars in one line, at theta2 = 1.96558671904998
    theta2 = 1.96558671904998 + np.array([0.3, 1e-2, 1e-4, 1e-6])
    one, other = (
        np.array([vector(kinematics.mechanism, five_bar_at(2.4, float(t), side)) for t in theta2]) for side in (1, -1)
    )
    assert kinematics.scaled_residual(np.vstack([one, other])).max() < 1e-14
    (p1, s1), (p2, s2) = determinants(one), determinants(other)
    assert np.all(np.sign(p1) == -np.sign(p2))
    assert len(set(np.sign(p1))) == len(set(np.sign(p2))) == 1
    # it vanishes like the square root of the distance, as the two solutions merge: a tenth for the last hundredth
    assert np.all(np.diff(np.abs(p1)) < 0)
    assert abs(p1[-1] / p1[-2]) == pytest.approx(0.1, rel=0.02)
    # the serial determinant goes through without a change
    assert len(set(np.sign([*s1, *s2]))) == 1
    # nothing is left of the margin at the singularity itself
    margins = po.MotionSpace(kinematics).margins(one)
    assert margins.parallel[-1] < 2e-3
    assert margins.serial.min() > 0.1


def test_parallel_determinant_changes_sign_along_a_motion_through_the_singularity() -> None:
    kinematics = five_bar_robot().kinematics
    determinants = Determinants.at(kinematics, five_bar_robot().home_configuration)
    singular = five_bar_at(2.4, 1.96558671904998 + 1e-13)
    elbows = (float(np.sign(singular["theta3"])), float(np.sign(singular["theta4"])))
    # across the line of the distal bars, in one working mode
    direction = singular["theta1"] + singular["theta3"] + np.pi / 2
    offsets = np.array([-0.2, -1e-2, -1e-3, 1e-3, 1e-2, 0.2])
    X = np.array(
        [
            vector(
                kinematics.mechanism,
                five_bar_reaching(singular["x"] + s * np.cos(direction), singular["y"] + s * np.sin(direction), elbows),
            )
            for s in offsets
        ]
    )
    assert kinematics.scaled_residual(X).max() < 1e-14
    assert np.abs(np.diff(X, axis=0)).max() < 0.3  # it is one motion
    parallel, serial = determinants(X)
    assert np.all(np.sign(parallel) == np.sign(parallel[-1]) * np.sign(offsets))
    assert len(set(np.sign(serial))) == 1
    # it crosses zero at a slope, ten times nearer is ten times less; the alignment itself is known to the square root
    # of 1e-13
    assert_allclose(parallel[[2, 3]] / parallel[[1, 4]], 0.1, rtol=0.05)


def test_serial_determinant_of_the_five_bar_changes_sign_with_each_elbow() -> None:
    kinematics = five_bar_robot().kinematics
    determinants = Determinants.at(kinematics, five_bar_robot().home_configuration)
    modes = {}
    for elbows in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)):
        values = five_bar_reaching(6.0, 7.0, elbows)
        X = vector(kinematics.mechanism, values)
        assert kinematics.scaled_residual(X)[0] < 1e-14
        # det [M N] is, up to a constant of the rows, the product of the two legs' own determinants
        modes[elbows] = np.sign(determinants(X)[1][0])
    assert modes[1.0, 1.0] == modes[-1.0, -1.0] == -modes[-1.0, 1.0] == -modes[1.0, -1.0]


def test_serial_determinant_vanishes_at_full_reach() -> None:
    kinematics = five_bar_robot().kinematics
    determinants = Determinants.at(kinematics, five_bar_robot().home_configuration)
    reach = 13.0 - np.array([1e-1, 1e-3, 1e-5])
    X = np.array(
        [vector(kinematics.mechanism, five_bar_reaching(r * np.cos(1.0), r * np.sin(1.0), (1.0, 1.0))) for r in reach]
    )
    parallel, serial = determinants(X)
    # the elbow's sine is about the square root of the distance to full reach
    assert_allclose(serial[1:] / serial[:-1], 0.1, rtol=0.05)
    assert np.abs(parallel).min() > 0.01
    margins = po.MotionSpace(kinematics).margins(X)
    assert_allclose(margins.serial[1:] / margins.serial[:-1], 0.1, rtol=0.05)


def test_report_at_a_parallel_singularity() -> None:
    kinematics = po.Kinematics(two_rpr(), "virtual machine")
    at = kinematics.configuration(vector(kinematics.mechanism, two_rpr_values(1.0, 0.0)))
    report = po.report_state(kinematics, at)
    assert ranks(report) == {"E": 4, "M": 2, "N": 2, "K": 2, "[N K]": 3, "[M N]": 4}
    assert report.parallel_margin < 1e-12
    assert abs(report.parallel_determinant) < 1e-12
    assert report.serial_margin > 0.1
    assert abs(report.serial_determinant) > 0.1


def test_report_at_a_serial_singularity() -> None:
    kinematics = five_bar_robot().kinematics
    values = five_bar_reaching(6.0, 7.0, (1.0, 1.0)) | {"theta1": 1.0, "theta3": 0.0}
    tip = 13.0 * np.array([np.cos(1.0), np.sin(1.0)])
    second = five_bar_reaching(*((1 - 1e-15) * tip).tolist(), (1.0, 1.0))
    values |= {"x": float(tip[0]), "y": float(tip[1]), "theta2": second["theta2"], "theta4": second["theta4"]}
    report = po.report_state(kinematics, kinematics.configuration(vector(kinematics.mechanism, values)))
    assert (ranks(report)["[M N]"], ranks(report)["[N K]"]) == (3, 4)
    assert abs(report.serial_determinant) < 1e-12
    assert report.parallel_margin > 0.05
    assert report.serial_margin < 1e-7


# --- Freedom of units


def scaled(mechanism: po.Mechanism, factor: float) -> po.Mechanism:
    """Describe the same machine in another unit of length."""

    def times(values: Sequence[float]) -> tuple[float, ...]:
        return tuple(factor * v for v in values)

    return dataclasses.replace(
        mechanism,
        links=[
            dataclasses.replace(link, at=times(link.at)) if isinstance(link, (po.Base, po.Series)) else link
            for link in mechanism.links
        ],
        closures=[
            po.Coincidence(c.link_A, times(c.point_A), c.link_B, times(c.point_B), c.name)
            for c in mechanism.closures
            if isinstance(c, po.Coincidence)
        ],
    )


@pytest.mark.parametrize("robot", [raf_robot, five_bar_robot])
def test_units_change_nothing(robot: object) -> None:
    """The same machine in millimetres: the same ranks, margins and normalised determinants."""
    machine: po.Robot = robot()  # type: ignore[operator]
    home = machine.home_configuration
    kinematics = po.Kinematics(scaled(machine.mechanism, 1000.0), "virtual machine")
    X = home.X * [1000.0 if v.kind == "length" else 1.0 for v in machine.mechanism.variables]
    assert kinematics.mechanism.length == pytest.approx(1000.0 * machine.mechanism.length, rel=1e-12)
    metres = po.report_state(machine.kinematics, home)
    millimetres = po.report_state(kinematics, kinematics.configuration(X))
    assert ranks(millimetres) == ranks(metres)
    for name in ("parallel_margin", "serial_margin"):
        assert getattr(millimetres, name) == pytest.approx(getattr(metres, name), rel=1e-9)
    # signs belong to the choice of rows, which equal pivots may decide in either way
    for name in ("parallel_determinant", "serial_determinant"):
        assert abs(getattr(millimetres, name)) == pytest.approx(abs(getattr(metres, name)), rel=1e-9)


def test_a_rank_near_its_cut_is_doubtful() -> None:
    """Almost singular on purpose: the first leg of the five-bar stretched but for a small angle."""
    assert not compute_rank(np.diag([5.0, 1.0, 1e-2])).is_doubtful
    assert compute_rank(np.diag([5.0, 1.0, 1e-7])).is_doubtful  # counts, barely
    assert compute_rank(np.diag([5.0, 1.0, 1e-9])).is_doubtful  # does not, barely
    assert not compute_rank(np.diag([5.0, 1.0, 1e-15])).is_doubtful
    kinematics = five_bar_robot().kinematics
    for bend, doubtful in ((1e-2, False), (1e-7, True), (1e-9, True), (0.0, False)):
        start = {"theta1": 1.0, "theta3": bend, "theta2": 0.6, "theta4": 1.9, "x": 7.0, "y": 10.9}
        cfg = kinematics.solve({"theta1": 1.0, "theta3": bend}, start).configuration
        report = po.report_state(kinematics, cfg)
        assert report.is_doubtful is doubtful, bend
        assert ("doubtful ranks: [M N] (" in str(report)) is doubtful


def test_conditions_compare_with_the_right_numbers() -> None:
    """Four drives for three freedoms (Hayward's wrist), one for two operational variables, and one drive too many."""

    def sides(report: po.StateReport) -> dict[str, tuple[int, int, bool]]:
        return {c.name: (c.left, c.right, c.holds) for c in report.conditions}

    wrist = po.robots.hayward_wrist()
    found = sides(po.report_state(wrist.kinematics, wrist.home_configuration))
    assert found["II.22"] == (3, 4, False)  # m = 3, a = 4
    assert found["II.24"] == (4, 4, False)
    assert found["II.25"] == (4, 3, False)  # r = 3, not a
    assert found["II.26"] == (11, 11, True)
    robot = five_bar_robot()
    found = sides(po.report_state(robot.kinematics, robot.home_configuration))
    assert found["II.22"] == (2, 2, True)  # as many drives as freedoms is enough
    weak = po.Kinematics(dataclasses.replace(robot.mechanism, active=("theta1",)), "virtual machine")
    report = po.report_state(weak, weak.configuration(to_order(robot, weak)))
    assert report.is_under_actuated
    found = sides(report)
    assert found["II.24"] == (1, 1, False)
    assert found["II.25"] == (1, 2, True)  # r = 2, though a = 1 drive moves
    # an end point whose angle enters no equation: r = 3 although rg(K) = 2
    turning = [dataclasses.replace(k, coordinates=None) if k.name == "tip" else k for k in robot.mechanism.links]
    loose = po.Kinematics(
        dataclasses.replace(robot.mechanism, links=turning, operational=("x", "y", "theta")), "virtual machine"
    )
    found = sides(po.report_state(loose, loose.configuration([*robot.home_configuration.X, 0.0])))
    assert found["II.23"] == (2, 3, False)
    assert found["II.26"] == (4, 5, False)


def to_order(robot: po.Robot, kinematics: po.Kinematics) -> list[float]:
    return [robot.home_configuration[name] for name in kinematics.mechanism.names]


def test_words_are_of_the_machine_and_not_of_a_singular_pose() -> None:
    """All bars of a five-bar in one line: one closure less and one motion more, but the machine has the same drives."""
    robot = po.robots.five_bar(base=2, proximal=(5, 5), distal=(5, 3), tip=(3, 7))
    flat = robot.kinematics.configuration([0.0, 0.0, 0.0, 0.0, 10.0, 0.0])
    report = po.report_state(robot.kinematics, flat)
    assert (report.mobility, report.redundant_rows, report.over_constraint) == (3, 1, 0)
    assert report.kind == "as many drives as freedoms"
    assert "singular: E has 3 of 4" in str(report)


def test_two_drives_for_three_freedoms_are_too_few() -> None:
    """Of a 3-RPR only x and y are the task: the drives move as many variables, yet one freedom is theirs no more."""
    whole = po.robots.three_rpr()
    mechanism = dataclasses.replace(whole.mechanism, active=("rho1", "rho2"), operational=("x", "y"))
    kinematics = po.Kinematics(mechanism, "virtual machine")
    cfg = kinematics.configuration([whole.home_configuration[name] for name in mechanism.names])
    report = po.report_state(kinematics, cfg)
    assert (report.useful_mobility, report.condition("II.25").holds) == (3, False)
    assert report.is_under_actuated
    assert "under-actuated" in report.kind


def test_a_serial_singularity_breaks_ii_27_alone() -> None:
    kinematics = five_bar_robot().kinematics
    cfg = kinematics.solve({"theta1": 1.0, "theta3": 0.0}, {"theta1": 1.0, "theta2": 0.6, "theta4": 1.9, "x": 7.0})
    report = po.report_state(kinematics, cfg.configuration)
    assert {c.name: c.holds for c in report.conditions} == {
        "II.22": True, "II.23": True, "II.24": False, "II.25": False, "II.26": True, "II.27": False,
    }  # fmt: skip


def test_every_angle_that_takes_part_in_a_spin_is_idle() -> None:
    """A rod between two ball joints spins about itself; when its own axis does not come last, all three angles turn."""
    links: list[po.mechanism.Link] = [po.Base(), po.Mobile("tip", ("x", "y", "z"))]
    closures = []
    for i, foot in enumerate(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), start=1):
        links.append(po.Series(f"leg {i}", "base", foot, po.Spherical(f"leg {i}", order="zyx")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"q{i}", "z")))
        closures.append(po.Coincidence(f"rod {i}", (0, 0, 0), "tip", (0, 0, 0)))
    mechanism = po.Mechanism("point on three rods", links, closures, ("q1", "q2", "q3"), ("x", "y", "z"))
    kinematics = po.Kinematics(mechanism, "virtual machine")
    start = {"q1": 1.0, "q2": 1.0, "q3": 1.0, "leg 1.y": 0.3, "leg 2.y": -0.4, "leg 3.x": 0.4}
    report = po.report_state(kinematics, kinematics.inverse({"x": 0.4, "y": 0.3, "z": 0.9}, start).configuration)
    assert (report.mobility, report.internal_mobility) == (6, 3)
    assert set(report.idle) == {f"leg {i}.{axis}" for i in (1, 2, 3) for axis in "xyz"}
    assert report.kind == "as many drives as freedoms"
