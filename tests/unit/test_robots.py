"""The contract of the library: what every robot of `paraopt.robots` keeps, whatever its source."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path

import coal
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import qr

import paraopt as po
from paraopt.kinematics import GeneralState, find_general_state, null_space
from paraopt.scene.geometry import build_geometry
from paraopt.scene.pairs import find_neighbours
from support import Array, finite_difference, library_robot, library_robots

NAMES = library_robots()
# Facts that the report gives; the others (working and assembly modes) are counted by the models that find them.
REPORTED: dict[str, Callable[[po.StateReport], int]] = {
    "variables": lambda r: r.n_variables,
    "equations": lambda r: r.n_equations,
    "rank E": lambda r: r.ranks["E"].value,
    "rank M": lambda r: r.ranks["M"].value,
    "rank N": lambda r: r.ranks["N"].value,
    "rank K": lambda r: r.ranks["K"].value,
    "mobility": lambda r: r.mobility,
    "idle": lambda r: r.internal_mobility,
}
COUNTED = {"working modes", "assembly modes"}


@functools.cache
def general(name: str) -> GeneralState:
    return find_general_state(library_robot(name).kinematics, library_robot(name).home_configuration)


def test_the_library_is_complete() -> None:
    """The robots that the sources name, issue by issue of models.md §2-11."""
    wanted = {
        "serial_2r", "serial_2rp", "lynx", "two_rpr", "five_bar", "three_rpr", "three_rrr", "planar_platform", "lee",
        "three_upu", "raf", "delta", "hayward_wrist", "gosselin_wrist", "stewart", "six_three", "hexa", "two_delta",
        "logabex", "larm_planar", "larm_spatial", "larm_hanging", "gipo", "tripod",
    }  # fmt: skip
    assert wanted <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_assembles_at_home(name: str) -> None:
    robot = library_robot(name)
    home = robot.home_configuration
    assert home.residual <= 1e-10
    assert_allclose(home.operational, [robot.home[n] for n in robot.mechanism.operational], atol=0)
    F = robot.kinematics.residual(home.X) / robot.kinematics.graph.row_scale
    assert np.max(np.abs(F), initial=0.0) <= 1e-10


@pytest.mark.parametrize("name", NAMES)
def test_facts_are_those_of_the_report(name: str) -> None:
    robot = library_robot(name)
    assert set(robot.facts) <= {*REPORTED, *COUNTED}
    assert {"variables", "equations", "rank E", "mobility"} <= set(robot.facts)
    report = po.report_state(robot.kinematics, robot.home_configuration)
    stated = {k: v for k, v in robot.facts.items() if k in REPORTED}
    assert {k: REPORTED[k](report) for k in stated} == stated


@pytest.mark.parametrize("name", NAMES)
def test_home_is_a_generic_pose(name: str) -> None:
    """No rank is smaller at home than around it, and none hangs on the tolerance."""
    robot = library_robot(name)
    report = po.report_state(robot.kinematics, robot.home_configuration)
    assert {n: r.value for n, r in report.ranks.items()} == dict(report.general_ranks)
    assert not report.is_doubtful
    singularities = po.report_singularities(robot.kinematics, robot.home_configuration)
    # what is fewer drives than freedoms cannot hold the platform, anywhere: that is no fault of the pose
    assert singularities.kind == "regular", str(singularities)


@pytest.mark.parametrize("name", NAMES)
def test_velocities_close_the_loops_on_a_finite_motion(name: str) -> None:
    """M qdot_a + N qdot_p + K xdot = 0 with velocities from differences of closed configurations, to 1e-9."""
    robot = library_robot(name)
    kinematics, scale = robot.kinematics, robot.kinematics.graph.variable_scale
    random = np.random.default_rng(7)
    start = kinematics.configuration(general(name).X[-1])
    E = kinematics.functions.scaled_jacobian(start.X)[0]
    V = null_space(E)
    # coordinates that the motions can be parametrised with: the best conditioned rows of their basis
    _, _, order = qr(V.T, pivoting=True)
    chosen = sorted(order[: V.shape[1]].tolist())
    names = [robot.mechanism.names[i] for i in chosen]
    direction = (V @ random.normal(size=V.shape[1]))[chosen]
    direction *= scale[chosen] / max(np.abs(direction).max(), 1e-12)

    def at(t: float) -> Array:
        """Impose the chosen coordinates along a curve; the rest follows."""
        values = start.X[chosen] + 0.05 * np.sin(t) * direction
        solution = kinematics.solve_batch(names, values[None], start.X[None])
        assert solution.converged[0]
        X: Array = solution.X[0]
        return X

    worst = 0.0
    for t in (0.3, 0.9, 1.5):
        X = at(t)
        # scaled: a motion of order 0.05, closed to 1e-13, by the five-point rule
        velocity = finite_difference(lambda s: at(float(s[0])), [t], step=5e-3)[:, 0]
        J = kinematics.jacobians(X)
        a, p = J.M.shape[1], J.N.shape[1]
        sums = J.M @ velocity[:a] + J.N @ velocity[a : a + p] + J.K @ velocity[a + p :]
        worst = max(worst, float(np.max(np.abs(sums / kinematics.graph.row_scale), initial=0.0)))
        assert np.max(np.abs(velocity / scale)) > 1e-3 * np.abs(np.cos(t))
    assert worst < 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_limits_hold_at_home(name: str) -> None:
    robot = library_robot(name)
    low, high = robot.limits.bounds(robot.mechanism)
    X = robot.home_configuration.X
    outside = [n for n, v, a, b in zip(robot.mechanism.names, X, low, high, strict=True) if not a <= v <= b]
    assert not outside
    for quantity in ("velocity", "acceleration"):
        assert set(getattr(robot.limits, quantity)) >= set(robot.mechanism.active), quantity


@pytest.mark.parametrize("name", NAMES)
def test_solids_do_not_collide_at_home(name: str) -> None:
    robot = library_robot(name)
    assert robot.shapes, "a robot without solids cannot be planned among obstacles"
    scene = po.Scene(robot)
    if not scene.pairs:
        pytest.fail(f"no pair is checked:\n{scene.describe_pairs()}") if len(scene.bodies) > 3 else None
        return
    clearance = scene.clearance(robot.home_configuration)
    assert clearance.distance > 0, f"{clearance.pair}: {clearance.distance}"


def gap(robot: po.Robot, first: str, second: str, X_FS: Array) -> float:
    """Measure the smallest distance between the solids of two links [m], the second being at X_FS in the first.

    Planar machines have their links on levels: there the levels are laid on one another.
    """
    best = np.inf
    for one in robot.shapes[first]:
        for other in robot.shapes[second]:
            placed = []
            for shape, pose in ((one, one.pose), (other, X_FS @ other.pose)):
                z = 0.0 if robot.mechanism.planar else pose[2, 3]
                X = coal.Transform3s(pose[:3, :3], np.array([pose[0, 3], pose[1, 3], z]))
                placed += [build_geometry(shape), X]
            best = min(best, coal.distance(*placed, coal.DistanceRequest(), coal.DistanceResult()))
    return best


# The ground plate lies deeper than the joints that stand on it.
FLOATING = {"raf": {"arm A", "arm B", "jack 1", "jack 2", "jack 3"}}


@pytest.mark.parametrize("name", NAMES)
def test_solids_of_joined_links_meet_at_home(name: str) -> None:
    """What is joined in the mechanism is joined as a body: no arm floats beside its motor."""
    robot = library_robot(name)
    poses = dict(zip([k.name for k in robot.mechanism.links], robot.kinematics.poses(robot.home_configuration.X)[0],
                     strict=True))  # fmt: skip
    apart = {}
    for pair in find_neighbours(robot):
        first, second = sorted(pair)
        if pair & FLOATING.get(name, set()) and robot.mechanism.base.name in pair:
            continue
        distance = gap(robot, first, second, np.linalg.inv(poses[first]) @ poses[second])
        if distance > 1e-6 * robot.mechanism.length:
            apart[first, second] = distance
    assert not apart


@pytest.mark.parametrize("name", NAMES)
def test_slides_stay_in_their_rails_at_every_stroke(name: str) -> None:
    robot = library_robot(name)
    m, home = robot.mechanism, robot.home_configuration
    for link in m.links:
        if not (isinstance(link, po.Series) and robot.shapes.get(link.name) and robot.shapes.get(link.father)):
            continue
        (motion, *others) = link.motions or (None,)
        if motion is None or motion.kind != "length" or others or not np.all(np.isfinite(motion.range)):
            continue
        poses = robot.kinematics.poses(home.X)[0]
        index = {k.name: i for i, k in enumerate(m.links)}
        X_FS = np.linalg.inv(poses[index[link.father]]) @ poses[index[link.name]]
        for stroke in np.linspace(*motion.range, 5):
            moved = X_FS.copy()
            moved[:3, 3] += moved[:3, "xyz".index(motion.axis)] * (stroke - home[motion.name])
            assert gap(robot, link.father, link.name, moved) <= 0, (motion.name, stroke)


@pytest.mark.parametrize("name", NAMES)
def test_toml_round_trip(name: str, tmp_path: Path) -> None:
    robot = library_robot(name)
    po.save_robot(robot, tmp_path / "robot.toml")
    again = po.load_robot(tmp_path / "robot.toml")
    assert again.mechanism == robot.mechanism
    for field in ("home", "masses", "contacts", "facts", "tool", "source", "limits"):
        assert getattr(again, field) == getattr(robot, field), field
    assert list(again.shapes) == list(robot.shapes)
    for link, shapes in robot.shapes.items():
        for one, other in zip(shapes, again.shapes[link], strict=True):
            assert type(one) is type(other)
            assert {k: np.asarray(v).tolist() for k, v in vars(one).items()} == {
                k: np.asarray(v).tolist() for k, v in vars(other).items()
            }


@pytest.mark.parametrize("name", NAMES)
def test_source_is_stated(name: str) -> None:
    robot = library_robot(name)
    assert robot.source
    assert "Source:" in (inspect.getdoc(getattr(po.robots, name)) or "")
