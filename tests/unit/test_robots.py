"""The contract of the library: what every robot of `paraopt.robots` keeps, whatever its source."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import qr

import paraopt as po
from paraopt.kinematics import GeneralState, find_general_state, null_space
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
        "logabex", "larm_planar", "larm_spatial", "gipo", "tripod",
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
