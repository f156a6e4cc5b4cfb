"""Assembly modes: exact methods against the search from many starts, theory's parity, and what cannot be assembled."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import paraopt as po
from paraopt.kinematics import find_legs
from paraopt.kinematics.orientation import ParallelOrientation
from paraopt.kinematics.planar_legs import PlanarLeg, PlanarProblem, read_planar_legs, solve_planar
from paraopt.kinematics.postures import PostureReader
from paraopt.kinematics.six_distances import SixDistances, solve_six_distances
from paraopt.robots.planar_platform import planar_platform, planar_platforms
from solutions import home_of, uncompiled
from support import five_bar_robot

Array = np.ndarray
ANYWHERE = po.AssemblyOptions(respect_ranges=False)
MANY = po.AssemblyOptions(method="many starts", respect_ranges=False)
PLATFORMS = list(planar_platforms())
# found by a random walk over platforms that kept what had the most real solutions: 22 of 40
POINTS_22 = np.array([
    -0.614, -0.088, 1.129, 0.575, -0.689, -0.137, -0.185, -0.432, 0.731, -0.743, -0.392, -0.427, -0.336, -0.066, 0.197,
    0.57, -0.164, 0.905, 0.153, 0.265, -0.952, 0.969, -1.337, -0.54, 1.255, -0.6, -0.304, 0.515, -0.93, -0.246, -0.538,
    -0.824, 0.284, 0.894, -1.194, 0.378,
]).reshape(2, 6, 3)  # fmt: skip
LENGTHS_22 = (1.631, 1.276, 0.907, 1.326, 1.735, 1.15)


@functools.cache
def robot_of(name: str) -> po.Robot:
    return getattr(po.robots, name)()


def home_drives(robot: po.Robot) -> dict[str, float]:
    return {n: robot.home_configuration[n] for n in robot.mechanism.active}


def general_platform(seed: int) -> tuple[po.Robot, dict[str, float]]:
    """Six legs between random points, and their lengths at a random pose."""
    random = np.random.default_rng(seed)
    A, B = (random.uniform(-s, s, (6, 3)) * (1.0, 1.0, 0.6) for s in (1.0, 0.7))
    R = Rotation.from_euler("xyz", random.uniform(-0.6, 0.6, 3)).as_matrix()
    lengths = np.linalg.norm(B @ R.T + random.uniform(-0.3, 0.3, 3) + (0, 0, 0.9) - A, axis=1)
    robot = po.robots.stewart(A.tolist(), B.tolist(), height=1.2, stroke=0.2)
    return robot, dict(zip(robot.mechanism.active, lengths.tolist(), strict=True))


def assert_same(kinematics: po.Kinematics, a: Array, b: Array) -> None:
    """Compare sets of configurations as postures."""
    reader = PostureReader(kinematics)
    marks_a, marks_b = reader(a), reader(b)
    distances = np.max(np.abs(marks_a[:, None] - marks_b[None]), axis=2)
    assert distances.shape[0] == distances.shape[1]
    # both are polished to 1e-12; conditioning of up to 1e4 is met
    assert np.max(np.min(distances, axis=1), initial=0.0) < 1e-7
    assert np.max(np.min(distances, axis=0), initial=0.0) < 1e-7


# --- What holds for all


@pytest.mark.parametrize(
    ("name", "count"),
    [("two_rpr", 2), ("five_bar", 2), ("three_rpr", 2), ("three_rrr", 2), ("delta", 2), ("gosselin_wrist", 8),
     ("serial_2r", 1), ("serial_2rp", 1), ("lynx", 1), ("lee", 8), ("planar_platform", 2), ("hayward_wrist", 1)],
)  # fmt: skip
def test_modes_at_home(name: str, count: int) -> None:
    """Counts are the facts of the robots; those of 3-RPR and 3-RRR are the largest numbers, met elsewhere."""
    robot = robot_of(name)
    kinematics, home = robot.kinematics, robot.home_configuration
    modes = kinematics.assembly_modes(home_drives(robot), start=home)
    assert len(modes) == count
    assert np.max(kinematics.scaled_residual(modes.X)) < 1e-10
    assert_allclose(modes.X[:, : len(robot.mechanism.active)], np.tile(home.active, (count, 1)), rtol=0, atol=0)
    assert_allclose(modes[0].configuration.X, home.X, rtol=0, atol=1e-8)  # nearest to the start first
    assert modes.missing_probability < 0.05
    assert not modes.is_continuous
    for mode in modes:
        assert 1e-3 < mode.margin <= 1.0
        assert mode.sign == (np.sign(mode.determinant) if np.isfinite(mode.determinant) else 0)
        assert np.isnan(mode.determinant) or abs(mode.determinant) <= 1 + 1e-12
        assert mode.out_of_range == ()
    marks = PostureReader(kinematics)(modes.X)
    for a, b in itertools.combinations(range(count), 2):
        assert np.max(np.abs(marks[a] - marks[b])) > 1e-3
    if count > 1:
        assert modes.is_even
    if not modes.held and count > 1:
        assert modes.has_comparable_signs
        assert modes.is_balanced


def test_the_sign_belongs_to_the_posture_and_not_to_its_angles() -> None:
    """A universal joint has two pairs of angles for one direction; the bare determinant changes sign with them."""
    robot = robot_of("hexa")
    kinematics, X = robot.kinematics, robot.home_configuration.X.copy()
    a, b = kinematics.mechanism.indices(("rod 3.y", "rod 3.x"))
    turned = X.copy()
    turned[[a, b]] = X[a] + np.pi, np.pi - X[b]
    assert kinematics.scaled_residual(turned)[0] < 1e-12
    both = np.array([X, turned])
    _, N, K = kinematics.jacobians_batch(both)
    bare = np.sign(np.linalg.det(np.concatenate([N, K], axis=2)))
    assert bare[0] == -bare[1]
    signs = ParallelOrientation.at(kinematics, X)(both)
    assert signs[0] == pytest.approx(signs[1], rel=1e-9)
    marks = PostureReader(kinematics)(both)
    assert_allclose(marks[0], marks[1], rtol=0, atol=1e-12)


# --- Planar platforms


@pytest.mark.parametrize("index", np.random.default_rng(4).choice(len(PLATFORMS), 10, replace=False).tolist())
def test_planar_platforms_of_any_legs(index: int) -> None:
    check_planar(PLATFORMS[index])


@pytest.mark.slow
def test_more_planar_platforms_of_any_legs() -> None:
    for index in np.random.default_rng(5).choice(len(PLATFORMS), 150, replace=False):
        check_planar(PLATFORMS[index])


def check_planar(legs: tuple[str, str, str]) -> None:
    robot = planar_platform(*legs)
    kinematics, home = uncompiled(robot), home_of(robot)
    q = dict(zip(robot.mechanism.active, home[:3].tolist(), strict=True))
    exact = kinematics.assembly_modes(q, ANYWHERE, start=home)
    searched = kinematics.assembly_modes(q, MANY, start=home)
    assert (exact.method, searched.method) == ("planar sextic", "many starts")
    assert_same(kinematics, exact.X, searched.X)
    assert 2 <= len(exact) <= exact.complex_count <= 6
    assert exact.is_balanced
    assert_allclose(exact[0].configuration.X, home, rtol=0, atol=1e-8)


def test_legs_are_read_from_the_mechanism() -> None:
    """By hand: with its drive held a leg RPR is a circle about its foot, its length the radius."""
    robot = robot_of("three_rpr_innocenti")
    X = home_of(robot)
    X[:3] = 15.0, 15.4, 12.0
    problem = read_planar_legs(robot.kinematics, X)
    assert problem is not None
    assert [leg.kind for leg in problem.legs] == ["RR", "RR", "RR"]
    assert_allclose([leg.length for leg in problem.legs], (15.0, 15.4, 12.0), rtol=1e-12)
    assert_allclose([leg.c for leg in problem.legs], (0, 15.9, 10j), rtol=0, atol=1e-12)
    assert read_planar_legs(robot_of("hexa").kinematics, robot_of("hexa").home_configuration.X) is None


@pytest.mark.parametrize("kinds", ["".join(k) for k in itertools.combinations_with_replacement("ABC", 3)])
def test_derivatives_and_roots_of_every_kind_of_leg(kinds: str) -> None:
    """A pose is chosen, legs are made that hold it: it must be among the solutions, and the Jacobian be the slope."""
    random = np.random.default_rng(sum(map(ord, kinds)))
    p, theta = complex(*random.normal(size=2)), float(random.uniform(-np.pi, np.pi))
    u = np.exp(1j * theta)
    legs = []
    for kind in kinds:
        b, c = (complex(*random.normal(size=2)) for _ in range(2))
        d = np.exp(1j * random.uniform(-np.pi, np.pi))
        if kind == "A":
            legs.append(PlanarLeg("RR", c, b, 1.0, abs(p + u * b - c)))
        elif kind == "B":
            legs.append(PlanarLeg("PR", p + u * b + 0.7 * d, b, d, 0.0))
        else:
            legs.append(PlanarLeg("RP", c, (c - p) / u + 0.3 * d, d, 0.0))
    platform = po.Mobile("platform", ("x", "y", "theta"))
    problem = PlanarProblem(tuple(legs), True, 1.0, platform)
    pose = np.array([[p.real, p.imag, theta]])
    F, J = problem.residual(pose)
    assert np.max(np.abs(F)) < 1e-12
    h = 1e-6
    for k in range(3):
        step = h * np.eye(3)[k]
        slope = (problem.residual(pose + step)[0] - problem.residual(pose - step)[0]) / (2 * h)
        assert_allclose(J[0, :, k], slope[0], rtol=0, atol=1e-7)
    found = solve_planar(problem)
    assert not found.is_continuous
    assert np.max(np.abs(problem.residual(found.poses)[0])) < 1e-10
    gap = np.abs(found.poses[:, :2] - pose[:, :2]).max(axis=1) + np.abs(np.exp(1j * found.poses[:, 2]) - u)
    assert np.min(gap) < 1e-8
    assert len(found.poses) <= found.degree <= 6


def test_a_platform_that_can_move_is_said_to() -> None:
    """Base and platform alike, legs of equal length: at theta = 0 the platform swings as in a parallelogram."""
    triangle = ((0.0, 0.0), (4.0, 0.0), (1.0, 3.0))
    robot = po.robots.three_rpr(triangle, triangle, (1.0, 9.0), (2.0, 2.0, 0.0), 0.01)
    kinematics = uncompiled(robot)
    modes = kinematics.assembly_modes(dict.fromkeys(robot.mechanism.active, 3.0))
    assert modes.is_continuous
    assert "continuum" in modes.reason
    still = kinematics.assembly_modes({"rho1": 3.0, "rho2": 3.2, "rho3": 3.1})
    assert not still.is_continuous


def test_a_rotation_held_twice_lets_the_platform_slide() -> None:
    robot = planar_platform("_R_PP", "_R_PP", "R_P_R")
    kinematics, home = uncompiled(robot), home_of(robot)
    q = dict(zip(robot.mechanism.active, home[:3].tolist(), strict=True))
    modes = kinematics.assembly_modes(q, ANYWHERE, start=home)
    assert modes.is_continuous


@pytest.mark.parametrize(
    ("legs", "count"),
    [(("_R_PP", "R_P_R", "R_P_R"), 2), (("_R_PP", "_R_RR", "P_R_R"), 2), (("PP_R_", "P_R_R", "R_R_P"), 1)],
)
def test_one_leg_that_holds_the_rotation_leaves_circles_and_lines(legs: tuple[str, str, str], count: int) -> None:
    robot = planar_platform(*legs)
    kinematics, home = uncompiled(robot), home_of(robot)
    q = dict(zip(robot.mechanism.active, home[:3].tolist(), strict=True))
    exact = kinematics.assembly_modes(q, ANYWHERE, start=home)
    assert (len(exact), exact.complex_count) == (count, count)
    assert_same(kinematics, exact.X, kinematics.assembly_modes(q, MANY, start=home).X)


def test_equal_legs_of_an_equilateral_platform() -> None:
    """Symmetric: solutions come in threes by turning the machine, and lines coincide on the way to them."""
    robot = robot_of("three_rpr")
    kinematics = robot.kinematics
    q = dict.fromkeys(robot.mechanism.active, 45.0)
    exact = kinematics.assembly_modes(q, ANYWHERE, start=robot.home_configuration)
    assert (len(exact), exact.is_balanced) == (6, True)
    assert_same(kinematics, exact.X, kinematics.assembly_modes(q, MANY, start=robot.home_configuration).X)


def test_two_modes_meet_at_a_parallel_singularity() -> None:
    """Five-bar with its distal bars in one line: elbows 13 apart."""
    robot = five_bar_robot()
    kinematics = robot.kinematics
    # elbow 1 at (0, 8) and elbow 2 at a distance of 13 from it, 5 from (9, 0): by the law of cosines
    gap = complex(9, -8)
    turn = np.arccos((13**2 - 25 - abs(gap) ** 2) / (2 * 5 * abs(gap)))
    q = {"theta1": np.pi / 2, "theta2": float(np.angle(gap) + turn)}
    modes = kinematics.assembly_modes(q)
    assert len(modes) == 1
    assert modes[0].sign == 0
    assert modes[0].margin < 1e-6
    assert not modes.is_continuous
    inside = kinematics.assembly_modes({**q, "theta2": q["theta2"] - 1e-3})
    outside = kinematics.assembly_modes({**q, "theta2": q["theta2"] + 1e-3})
    assert sorted([len(inside), len(outside)]) == [0, 2]


# --- Six distances


@pytest.mark.parametrize("seed", [3, 19])
def test_general_six_legged_platforms(seed: int) -> None:
    robot, q = general_platform(seed)
    kinematics = robot.kinematics
    exact = kinematics.assembly_modes(q, ANYWHERE)
    searched = kinematics.assembly_modes(q, MANY)
    assert (exact.method, exact.complex_count, exact.missing_probability) == ("six distances", 40, 0.0)
    assert_same(kinematics, exact.X, searched.X)
    assert exact.is_even
    assert exact.is_balanced
    assert np.all(exact.signs != 0)
    assert searched.is_balanced


def test_a_platform_with_22_real_solutions() -> None:
    robot = po.robots.stewart(*POINTS_22.tolist(), height=3.0, stroke=0.2)
    q = dict(zip(robot.mechanism.active, LENGTHS_22, strict=True))
    exact = robot.kinematics.assembly_modes(q, ANYWHERE)
    assert (len(exact), exact.complex_count, exact.is_balanced) == (22, 40, True)
    searched = robot.kinematics.assembly_modes(q, MANY)
    assert searched.is_balanced
    assert_same(robot.kinematics, exact.X, searched.X)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_ten_times_the_effort_finds_no_more(seed: int) -> None:
    robot, q = general_platform(seed)
    first = robot.kinematics.assembly_modes(q, MANY)
    effort = po.SearchOptions(batch=10 * first.search.starts, missing_probability=1e-4,
                              max_starts=10 * first.search.starts, seed=1)  # fmt: skip
    more = robot.kinematics.assembly_modes(q, po.AssemblyOptions("many starts", search=effort, respect_ranges=False))
    assert more.search.starts >= 10 * first.search.starts
    assert_same(robot.kinematics, first.X, more.X)
    assert_same(robot.kinematics, first.X, robot.kinematics.assembly_modes(q, ANYWHERE).X)


@pytest.mark.slow
def test_ten_times_the_effort_finds_no_more_than_22() -> None:
    robot = po.robots.stewart(*POINTS_22.tolist(), height=3.0, stroke=0.2)
    q = dict(zip(robot.mechanism.active, LENGTHS_22, strict=True))
    effort = po.SearchOptions(missing_probability=0.005, max_starts=500_000, seed=7)
    more = robot.kinematics.assembly_modes(q, po.AssemblyOptions("many starts", search=effort, respect_ranges=False))
    assert len(more) == 22


def test_poses_of_six_distances_are_poses() -> None:
    random = np.random.default_rng(11)
    base, platform = random.normal(size=(2, 6, 3))
    R, p = Rotation.random(rng=random).as_matrix(), random.normal(size=3)
    lengths = np.linalg.norm(platform @ R.T + p - base, axis=1)
    found = solve_six_distances(SixDistances(base, platform, lengths))
    assert (found.finite, found.lost) == (40, 0)
    assert_allclose(found.R @ found.R.transpose(0, 2, 1), np.tile(np.eye(3), (len(found.R), 1, 1)), rtol=0, atol=1e-12)
    assert_allclose(np.linalg.det(found.R), 1.0, rtol=1e-12)
    ends = np.einsum("nij,kj->nki", found.R, platform) + found.p[:, None]
    assert_allclose(np.linalg.norm(ends - base, axis=2), np.tile(lengths, (len(ends), 1)), rtol=1e-10)
    assert np.min(np.max(np.abs(found.p - p), axis=1)) < 1e-10


@pytest.mark.parametrize("name", ["stewart", "hexa", "six_three"])
def test_symmetric_platforms_are_searched_as_well(name: str) -> None:
    """Their multiple solutions leave paths without an end, and this is said."""
    robot = robot_of(name)
    kinematics = robot.kinematics
    modes = kinematics.assembly_modes(home_drives(robot), ANYWHERE, start=robot.home_configuration)
    assert modes.method == "six distances"
    assert modes.search is not None
    assert "of 40 complex solutions are multiple, at infinity or were not reached" in modes.reason
    assert_same(kinematics, modes.X, kinematics.assembly_modes(home_drives(robot), MANY).X)
    assert modes.is_even
    assert modes.is_balanced


# --- Coordinates that are held


def test_without_a_hold_a_delta_has_turned_solutions_too() -> None:
    robot = robot_of("delta")
    held = robot.kinematics.assembly_modes(home_drives(robot), start=robot.home_configuration)
    assert set(held.held) == {"alpha", "beta", "gamma"}
    free = robot.kinematics.assembly_modes(
        home_drives(robot),
        po.AssemblyOptions(hold=(), search=po.SearchOptions(max_starts=4000)),
        start=robot.home_configuration,
    )
    assert len(free) > len(held) == 2
    straight = np.max(np.abs(free.X[:, robot.mechanism.indices(("alpha", "beta", "gamma"))]), axis=1) < 1e-9
    assert_same(robot.kinematics, held.X, free.X[straight])


@pytest.mark.parametrize(("name", "message"), [("x", "only passive variables can"), ("twist", "unknown variable")])
def test_only_passive_variables_are_held(name: str, message: str) -> None:
    robot = robot_of("delta")
    with pytest.raises(po.DefinitionError, match=message):
        robot.kinematics.assembly_modes(home_drives(robot), po.AssemblyOptions(hold=(name,)))


def test_a_platform_comes_apart_when_it_is_held() -> None:
    graph = robot_of("delta").kinematics.graph
    assert len(find_legs(graph)) == 1
    assert len(find_legs(graph, ("alpha", "beta", "gamma"))) == 3


# --- Failures


def test_drives_out_of_reach_give_an_empty_answer_with_its_reason() -> None:
    """A five-bar whose elbows are too far apart; a wrist cannot be, a search that fails can."""
    modes = five_bar_robot().kinematics.assembly_modes({"theta1": np.pi, "theta2": 0.0})
    assert (len(modes), modes.X.shape, modes.poses.shape) == (0, (0, 6), (0, 2))
    assert "no real solution" in modes.reason
    searched = five_bar_robot().kinematics.assembly_modes({"theta1": np.pi, "theta2": 0.0}, MANY)
    assert len(searched) == 0
    assert searched.missing_probability == 1.0
    assert "none of 1024 starts closes the loops" in searched.reason or "starts closes" in searched.reason
    robot, q = general_platform(3)
    apart = robot.kinematics.assembly_modes({**q, "q1": 50.0})
    assert len(apart) == 0
    assert apart.reason.startswith("no real solution: all 40 are complex")


def test_ranges_are_respected_when_asked() -> None:
    mechanism = po.Mechanism(
        "ranged",
        links=[
            po.Base(),
            po.Series("leg 1", "base", joint=po.Revolute("phi1", range=(0.0, np.pi))),
            po.Series("rod 1", "leg 1", joint=po.Prismatic("rho1", axis="x")),
            po.Series("leg 2", "base", at=(4, 0), joint=po.Revolute("phi2")),
            po.Series("rod 2", "leg 2", joint=po.Prismatic("rho2", axis="x")),
            po.Mobile("tip", coordinates=("x", "y")),
        ],
        closures=[po.Coincidence("rod 1", (0, 0), "tip", (0, 0)), po.Coincidence("rod 2", (0, 0), "tip", (0, 0))],
        active=("rho1", "rho2"),
        operational=("x", "y"),
        planar=True,
    )
    kinematics = po.Kinematics(mechanism, backend="virtual machine")
    q = {"rho1": 3.0, "rho2": 3.0}
    inside = kinematics.assembly_modes(q)
    assert (len(inside), inside.left_out) == (1, 1)
    assert inside[0].configuration["y"] > 0
    both = kinematics.assembly_modes(q, ANYWHERE)
    assert sorted(m.out_of_range for m in both) == [(), ("phi1",)]


def test_a_short_search_says_so() -> None:
    robot = robot_of("gosselin_wrist")
    options = po.AssemblyOptions(search=po.SearchOptions(max_starts=64, batch=64))
    modes = robot.kinematics.assembly_modes(home_drives(robot), options, start=robot.home_configuration)
    assert modes.missing_probability > 0.3
    assert "ended after 64 starts" in modes.reason
    assert not modes.search.complete
    assert 0.0 <= modes.search.unseen_mass <= 1.0


@pytest.mark.parametrize("method", ["planar sextic", "six distances"])
def test_a_method_that_does_not_fit_is_refused(method: str) -> None:
    robot = robot_of("gosselin_wrist")
    with pytest.raises(po.DefinitionError, match=f"not of the kind that method '{method}' solves"):
        robot.kinematics.assembly_modes(home_drives(robot), po.AssemblyOptions(method=method))  # type: ignore[arg-type]


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="method of assembly modes is 'guess'"):
        po.AssemblyOptions(method="guess")  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [float("nan"), float("-inf"), "far", None])
def test_values_must_be_finite_numbers(value: object) -> None:
    with pytest.raises(po.DefinitionError, match="'theta1'"):
        five_bar_robot().kinematics.assembly_modes({"theta1": value, "theta2": 0.0})  # type: ignore[dict-item]


def test_the_drives_must_be_complete() -> None:
    kinematics = five_bar_robot().kinematics
    with pytest.raises(po.DefinitionError, match=r"missing \['theta2'\]"):
        kinematics.assembly_modes({"theta1": 1.0})
    with pytest.raises(po.DefinitionError, match=r"not active \['x'\]"):
        kinematics.assembly_modes({"theta1": 1.0, "theta2": 1.0, "x": 0.0})


def test_a_corrupted_mode_is_no_configuration() -> None:
    robot = five_bar_robot()
    mode = robot.kinematics.assembly_modes(home_drives(robot))[0]
    for k in range(6):
        X = mode.configuration.X.copy()
        X[k] += 1e-6
        with pytest.raises(po.SolveError, match="loops of 'five-bar' are open"):
            robot.kinematics.configuration(X)
