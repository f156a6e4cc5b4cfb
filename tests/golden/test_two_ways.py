"""One machine described in several ways moves alike: Lahouar, II.1 (ways of modelling), on robots of the library.

A parallel robot is described by cutting one joint of each leg, or by cutting the platform into one piece per leg and
welding the pieces, with the free link of the operational variables welded to one of them; a serial robot by welding a
free link to its tool. Alike means: the same mobility, the same motions of the variables that two descriptions share,
and the same solutions of the inverse model.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import null_space, subspace_angles

import paraopt as po
from paraopt.spatial import rotation_about, rotation_xyz, transform
from support import finite_difference

Array = np.ndarray
Poses = Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Way:
    """Hold another description of a robot of the library.

    Attributes:
        mechanism: The description.
        start: Gives the values of variables that the library's description lacks, from its link poses.
    """

    mechanism: po.Mechanism
    start: Callable[[Poses], dict[str, float]]

    @functools.cached_property
    def kinematics(self) -> po.Kinematics:
        return po.Kinematics(self.mechanism, "virtual machine")  # used too little to be worth compiling


def angles_xyz(R: Array) -> tuple[float, float, float]:
    """Give the angles of `Rx Ry Rz`."""
    return float(np.arctan2(-R[1, 2], R[2, 2])), float(np.arcsin(R[0, 2])), float(np.arctan2(-R[0, 1], R[0, 0]))


def angle_between(A: Array, B: Array) -> float:
    """Give the angle about z by which frame B is turned in frame A."""
    R = A[:3, :3].T @ B[:3, :3]
    return float(np.arctan2(R[1, 0], R[0, 0]))


def minus(p: Sequence[float], q: Sequence[float] = (0.0, 0.0, 0.0)) -> tuple[float, ...]:
    """Give q - p."""
    return tuple(b - a for a, b in zip(p, q, strict=True))


# --- The second way: pieces of the platform, welded


def welded(reference: po.Mechanism, platform: str = "platform") -> Way:
    """Replace each coincidence with the platform by a joint that carries a piece of it, and weld the pieces.

    The pieces have their origins in the joints and the axes of the platform. The free link is welded to the first one.
    """
    links, closures = list(reference.links), []
    ties = [c for c in reference.closures if isinstance(c, po.Coincidence)]
    assert {c.link_B for c in ties} == {platform}
    for i, tie in enumerate(ties, start=1):
        joint = po.Revolute(f"hinge {i}") if reference.planar else po.Spherical(f"ball {i}")
        links.append(po.Series(f"piece {i}", tie.link_A, tie.point_A, joint))
    first = ties[0].point_B
    for i, tie in enumerate(ties[1:], start=2):
        closures.append(po.Weld("piece 1", f"piece {i}", minus(first, tie.point_B)))
    closures.append(po.Weld("piece 1", platform, minus(first)))

    def start(poses: Poses) -> dict[str, float]:
        values: dict[str, float] = {}
        for i, tie in enumerate(ties, start=1):
            leg, body = poses[tie.link_A], poses[platform]
            if reference.planar:
                values[f"hinge {i}"] = angle_between(leg, body)
            else:
                angles = angles_xyz(leg[:3, :3].T @ body[:3, :3])
                values |= {f"ball {i}.{axis}": a for axis, a in zip("xyz", angles, strict=True)}
        return values

    name = f"{reference.name}, welded"
    return Way(
        po.Mechanism(name, links, closures, reference.active, reference.operational, reference.planar), start
    )  # fmt: skip


# --- The five-bar: its platform is a point, so the free link of the second way has an angle more


def five_bar_dimensions() -> tuple[dict[str, Sequence[float]], dict[str, Sequence[float]]]:
    """Read places of the joints and ends of the distal bars off the library's five-bar."""
    mechanism = po.robots.five_bar().mechanism
    places = {k.name: k.at for k in mechanism.links if isinstance(k, po.Series)}
    ends = {c.link_A: c.point_A for c in mechanism.closures if isinstance(c, po.Coincidence)}
    return places, ends


def five_bar_arms() -> list[po.Base | po.Series]:
    places, _ = five_bar_dimensions()
    bars = (("proximal 1", "base", "theta1"), ("distal 1", "proximal 1", "theta3"),
            ("proximal 2", "base", "theta2"), ("distal 2", "proximal 2", "theta4"))  # fmt: skip
    return [po.Base(), *(po.Series(n, f, places[n], po.Revolute(v)) for n, f, v in bars)]


def five_bar_welded() -> Way:
    """RR-RRR: the first arm ends in a piece of the platform, the second carries its piece by a third joint."""
    _, ends = five_bar_dimensions()
    links = [
        *five_bar_arms(),
        po.Series("piece 1", "distal 1", ends["distal 1"]),
        po.Series("piece 2", "distal 2", ends["distal 2"], po.Revolute("hinge")),
        po.Mobile("tip"),
    ]
    closures = [po.Weld("piece 1", "piece 2"), po.Weld("piece 1", "tip")]

    def start(poses: Poses) -> dict[str, float]:
        one, two = poses["distal 1"], poses["distal 2"]
        return {"theta": angle_between(np.eye(4), one), "hinge": angle_between(two, one)}

    return Way(po.Mechanism("five-bar, welded", links, closures, ("theta1", "theta2"), ("x", "y"), True), start)


def five_bar_cut_at_the_elbows() -> Way:
    """Hang the distal bars from the tip and cut the joints between proximal and distal bars."""
    places, ends = five_bar_dimensions()
    links: list[po.Base | po.Series | po.Mobile] = [k for k in five_bar_arms() if not k.name.startswith("distal")]
    links.append(po.Mobile("tip", coordinates=("x", "y")))
    closures = []
    for i in (1, 2):
        links.append(po.Series(f"distal {i}", "tip", joint=po.Revolute(f"phi{i}")))
        closures.append(
            po.Coincidence(f"proximal {i}", places[f"distal {i}"], f"distal {i}", minus(ends[f"distal {i}"]))
        )

    def start(poses: Poses) -> dict[str, float]:
        return {f"phi{i}": angle_between(np.eye(4), poses[f"distal {i}"]) for i in (1, 2)}

    return Way(
        po.Mechanism("five-bar, cut at the elbows", links, closures, ("theta1", "theta2"), ("x", "y"), True), start
    )  # fmt: skip


# --- Legs that hang from the platform: the joint at the base is cut instead


def three_rpr_cut_at_the_base() -> Way:
    reference = po.robots.three_rpr().mechanism
    feet = [k.at for k in reference.links if isinstance(k, po.Series) and k.father == "base"]
    ties = [c for c in reference.closures if isinstance(c, po.Coincidence)]
    links: list[po.Base | po.Series | po.Mobile] = [po.Base(), po.Mobile("platform")]
    closures = []
    for i, (stroke, foot, tie) in enumerate(zip(reference.active, feet, ties, strict=True), start=1):
        links.append(po.Series(f"hung {i}", "platform", tie.point_B, po.Revolute(f"psi{i}")))
        links.append(po.Series(f"end {i}", f"hung {i}", joint=po.Prismatic(stroke, axis="x")))
        closures.append(po.Coincidence(f"end {i}", (0, 0), "base", foot))

    def start(poses: Poses) -> dict[str, float]:
        turns = [angle_between(poses["platform"], poses[tie.link_A]) + np.pi for tie in ties]
        return {f"psi{i}": turn for i, turn in enumerate(turns, start=1)}

    name = "3-RPR, cut at the base"
    return Way(po.Mechanism(name, links, closures, reference.active, reference.operational, True), start)


def stewart_cut_at_the_base() -> Way:
    """Close each leg by a universal joint at its foot; its axes are x of the base and y of the leg, as in `Rx Ry`."""
    reference = po.robots.stewart().mechanism
    feet = [k.at for k in reference.links if isinstance(k, po.Series) and k.father == "base"]
    ties = [c for c in reference.closures if isinstance(c, po.Coincidence)]
    links: list[po.Base | po.Series | po.Mobile] = [po.Base(), po.Mobile("platform")]
    closures = []
    for i, (stroke, foot, tie) in enumerate(zip(reference.active, feet, ties, strict=True), start=1):
        links.append(po.Series(f"hung {i}", "platform", tie.point_B, po.Spherical(f"ball {i}")))
        links.append(po.Series(f"end {i}", f"hung {i}", joint=po.Prismatic(stroke, axis="z")))
        closures.append(po.ClosingUniversal(f"end {i}", (0, 0, 0), "y", "base", foot, "x"))

    def start(poses: Poses) -> dict[str, float]:
        values: dict[str, float] = {}
        for i, tie in enumerate(ties, start=1):
            # the leg seen from above: half a turn about its y axis
            upside_down = poses[tie.link_A][:3, :3] @ np.diag([-1.0, 1.0, -1.0])
            angles = angles_xyz(poses["platform"][:3, :3].T @ upside_down)
            values |= {f"ball {i}.{axis}": a for axis, a in zip("xyz", angles, strict=True)}
        return values

    name = "Stewart, cut at the base"
    return Way(po.Mechanism(name, links, closures, reference.active, reference.operational), start)


# --- The Lynx: a joint cut instead of a weld, and no closure at all


def lynx_cut_at_the_gripper() -> Way:
    """Let the free link be the gripper itself, held by a closing joint on the roll axis: q5 is then no variable."""
    reference = po.robots.lynx().mechanism
    links = [k for k in reference.links if k.name != "link 5"]
    last = reference.link("link 5")
    assert isinstance(last, po.Series)
    (weld,) = reference.closures
    assert isinstance(weld, po.Weld)
    roll = po.ClosingRevolute("link 4", last.at, "x", "tool", minus(weld.at), "x")
    return Way(
        po.Mechanism("Lynx, cut at the gripper", links, [roll], reference.active[:4], reference.operational),
        lambda poses: {},
    )


def lynx_matrices(q: Array) -> Array:
    """Multiply the matrices of annex A: the pose of the tool, shape (4, 4)."""
    mm = 1e-3
    steps = (("z", (0, 0, 60)), ("y", (0, 0, 13)), ("y", (0, 0, 121)), ("y", (116, 0, 0)), ("x", (55, 0, 0)))
    X = np.eye(4)
    for (axis, at), angle in zip(steps, q, strict=True):
        turn = np.eye(4)
        turn[:3, :3] = rotation_about(axis, float(angle))
        X = X @ transform(np.multiply(at, mm)) @ turn
    return X @ transform((135 * mm, 0, 0))


# --- Comparison


@functools.cache
def library(name: str) -> po.Robot:
    robot: po.Robot = getattr(po.robots, name)()
    return robot


@functools.cache
def way(name: str) -> Way:
    builders: dict[str, Callable[[], Way]] = {
        "five_bar, welded": five_bar_welded,
        "five_bar, cut at the elbows": five_bar_cut_at_the_elbows,
        "three_rpr, welded": lambda: welded(library("three_rpr").mechanism),
        "three_rpr, cut at the base": three_rpr_cut_at_the_base,
        "stewart, welded": lambda: welded(library("stewart").mechanism),
        "stewart, cut at the base": stewart_cut_at_the_base,
        "lynx, cut at the gripper": lynx_cut_at_the_gripper,
    }
    return builders[name]()


# half the sides of the box of poses about home, in the order of the operational variables [m or rad]
BOX: dict[str, tuple[float, ...]] = {
    "five_bar": (1.0, 1.0),
    "three_rpr": (5.0, 5.0, 0.3),
    "stewart": (0.06, 0.06, 0.06, 0.2, 0.2, 0.2),
    "lynx": (0.02, 0.05, 0.03, 0.3, 0.2),
}
# N, equations, rank: added up by hand
SIZES = {
    "five_bar, welded": (8, 8, 6),  # a hinge and the angle of the tip more; a planar weld has 4 rows of rank 3
    "five_bar, cut at the elbows": (6, 4, 4),
    "three_rpr, welded": (12, 12, 9),
    "three_rpr, cut at the base": (9, 6, 6),
    "stewart, welded": (42, 72, 36),  # six balls more; a weld has 12 rows of rank 6
    "stewart, cut at the base": (30, 24, 24),
    "lynx, cut at the gripper": (10, 6, 5),
}
SEEDS = range(5)


def random_configuration(name: str, seed: int) -> po.Configuration:
    robot = library(name)
    offset = np.random.default_rng(seed).uniform(-1, 1, size=len(BOX[name])) * BOX[name]
    pose = {n: robot.home[n] + d for n, d in zip(robot.mechanism.operational, offset, strict=True)}
    return robot.kinematics.inverse(pose, robot.home_configuration).configuration


def solve_other_way(other: Way, here: po.Configuration, seed: int) -> po.Configuration:
    """Solve the inverse model of another description from a start near the posture, but not on it."""
    reference = here.mechanism
    poses = dict(zip([k.name for k in reference.links], library_poses(here), strict=True))
    start = {n: here[n] for n in other.mechanism.names if n in reference.names} | other.start(poses)
    random = np.random.default_rng(1000 + seed)
    start = {n: v + 0.01 * other.mechanism.length * random.uniform(-1, 1) * (n in reference.active)
             + 0.02 * random.uniform(-1, 1) * (n not in reference.names) for n, v in start.items()}  # fmt: skip
    assert set(start) == set(other.mechanism.names)
    pose = {n: here[n] for n in other.mechanism.operational}
    return other.kinematics.inverse(pose, start).configuration


def library_poses(here: po.Configuration) -> Array:
    robot = next(r for r in map(library, BOX) if r.mechanism is here.mechanism)
    return robot.kinematics.poses(here.X)[0]


def shared_motions(kinematics: po.Kinematics, X: Array, shared: Sequence[str], length: float) -> Array:
    """Give a basis of the motions, as seen in some variables; lengths in units of one length for all descriptions."""
    mechanism = kinematics.mechanism
    (E,) = kinematics.functions.scaled_jacobian(X)
    motions = null_space(E, rcond=1e-9) * kinematics.graph.variable_scale[:, None]
    scale = [length if v.kind == "length" else 1.0 for v in mechanism.variables]
    return np.asarray((motions / np.array(scale)[:, None])[mechanism.indices(shared)])


@pytest.mark.parametrize("name", SIZES)
def test_sizes_and_mobility(name: str) -> None:
    robot, other = library(name.split(",")[0]), way(name)
    configuration = solve_other_way(other, robot.home_configuration, 0)
    report = po.report_state(other.kinematics, configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value) == SIZES[name]
    assert report.mobility == po.report_state(robot.kinematics, robot.home_configuration).mobility


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", SIZES)
def test_same_solutions_of_the_inverse_model(name: str, seed: int) -> None:
    other, here = way(name), random_configuration(name.split(",")[0], seed)
    there = solve_other_way(other, here, seed)
    common = [n for n in other.mechanism.names if n in here.mechanism.names]
    assert set(common) >= {*other.mechanism.active, *other.mechanism.operational}
    for variable in here.mechanism.variables:
        if variable.name in common:
            gap = there[variable.name] - here[variable.name]
            gap = np.angle(np.exp(1j * gap)) if variable.kind == "angle" else gap
            assert gap == pytest.approx(0, abs=1e-9), variable.name


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", SIZES)
def test_same_motions(name: str, seed: int) -> None:
    """Principal angles between the motions that both descriptions allow to the variables that they share."""
    robot, other = library(name.split(",")[0]), way(name)
    here = random_configuration(name.split(",")[0], seed)
    there = solve_other_way(other, here, seed)
    shared = (*other.mechanism.active, *other.mechanism.operational)
    length = robot.mechanism.length
    A = shared_motions(robot.kinematics, here.X, shared, length)
    B = shared_motions(other.kinematics, there.X, shared, length)
    assert A.shape == B.shape
    assert np.linalg.matrix_rank(A, tol=1e-6) == A.shape[1]  # the shared variables show every motion
    assert np.max(subspace_angles(A, B)) < 1e-9


def test_another_machine_moves_differently() -> None:
    """A platform with one hinge 0.1 % off is another machine, and its motions tell."""
    robot = library("three_rpr")
    b = [c.point_B for c in robot.mechanism.closures if isinstance(c, po.Coincidence)]
    off = [(x, y) for x, y, _ in b[:2]] + [(b[2][0], 1.001 * b[2][1])]
    wrong = po.robots.three_rpr(platform=tuple(off))
    here = random_configuration("three_rpr", 0)
    there = wrong.kinematics.inverse({n: here[n] for n in wrong.mechanism.operational}, here.X).configuration
    shared = (*robot.mechanism.active, *robot.mechanism.operational)
    A, B = (shared_motions(r.kinematics, c.X, shared, 1.0) for r, c in ((robot, here), (wrong, there)))
    assert np.max(subspace_angles(A, B)) > 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_lynx_is_the_product_of_its_matrices(seed: int) -> None:
    """The welded free link stands where the matrices of the joints bring the tool, for random joints and for tasks."""
    robot = library("lynx")
    q = np.random.default_rng(seed).uniform(-0.8, 0.8, size=5)
    tool = robot.kinematics.forward(dict(zip(robot.mechanism.active, q, strict=True)), robot.home_configuration)
    tasks = [tool.configuration, random_configuration("lynx", seed)]
    for here in tasks:
        X = lynx_matrices(here.active)
        assert_allclose(X[:3, 3], [here[n] for n in "xyz"], atol=1e-11)
        R = np.asarray(rotation_xyz(here["alpha"], here["beta"], here["gamma"]))
        assert_allclose(X[:3, :3], R, atol=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_lynx_moves_as_the_product_of_its_matrices(seed: int) -> None:
    """The motions of the closure are the graph of the product's derivative, here by finite differences."""
    robot = library("lynx")
    here = random_configuration("lynx", seed)

    def pose(q: Array) -> Array:
        X = lynx_matrices(q)
        return np.array([*X[:3, 3], *angles_xyz(X[:3, :3])[:2]])

    assert_allclose(pose(here.active), here.operational, atol=1e-11)
    length = robot.mechanism.length
    scale = np.array([length, length, length, 1.0, 1.0])[:, None]
    product = np.vstack([np.eye(5), finite_difference(pose, here.active) / scale])
    shared = (*robot.mechanism.active, *robot.mechanism.operational)
    closure = shared_motions(robot.kinematics, here.X, shared, length)
    assert np.max(subspace_angles(product, closure)) < 1e-9
