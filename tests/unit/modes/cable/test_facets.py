"""Facets of available wrench sets: against linear programs, against hulls of vertices, and their derivatives."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from cable_robots import draw_poses, hanging, ipanema, planar
from paraopt.errors import DefinitionError
from paraopt.modes.cable import (
    CableRobot,
    FacetOptions,
    Pulley,
    cable_functions,
    capacity_gradients,
    capacity_margins,
    check_feasibility,
    compute_facets,
    has_wrench_closure,
    is_wrench_feasible,
)
from paraopt.modes.cable.facets import facet_gradients, facet_names, facets_of

Array = NDArray[np.float64]


def hull_distances(W: Array, low: Array, high: Array, points: Array) -> Array:
    """Signed distances to the hull of all corners of the tension box, mapped by W."""
    corners = np.array(list(product(*zip(low, high, strict=True)))) @ W.T
    planes = ConvexHull(corners).equations
    return -np.max(points @ planes[:, :-1].T + planes[:, -1], axis=1)


@pytest.mark.parametrize(("dof", "n"), [(3, 4), (3, 6), (6, 6), (6, 8)])
def test_facets_are_those_of_the_hull_of_all_vertices(dof: int, n: int) -> None:
    random = np.random.default_rng(10 * dof + n)
    for _ in range(3):
        W = random.normal(size=(dof, n))
        low, high = random.uniform(0.0, 1.0, n), random.uniform(2.0, 5.0, n)
        inside = (W @ random.uniform(low, high, (50, n)).T).T
        points = np.vstack([inside, inside + random.normal(size=(50, dof))])
        facets = facets_of(np.tile(W, (100, 1, 1)), low, high)
        margins = np.min(facets.distances(-points), axis=1)
        assert margins == pytest.approx(hull_distances(W, low, high, points), abs=1e-9)
        assert np.any(margins > 0) or n == dof
        assert np.any(margins < 0)


def test_verdicts_agree_with_linear_programs_on_random_poses() -> None:
    """Two thousand poses of two robots; where the boundary is nearer than round-off nothing is asked."""
    robots = [ipanema(t_min=10.0), ipanema(t_min=5.0, load=(20, -30, 10, 1, 2, -1), pulleys=[Pulley(radius=0.04)] * 8)]
    for robot in robots:
        poses = draw_poses(robot, 1000, seed=11)
        margins = capacity_margins(robot, poses)
        W, w = cable_functions(robot).both(poses)
        bounds = np.column_stack([robot.t_min, robot.t_max])
        solved = np.array(
            [linprog(np.zeros(8), A_eq=A, b_eq=-b, bounds=bounds).status == 0 for A, b in zip(W, w, strict=True)]
        )
        clear = np.abs(margins) > 1e-6
        assert np.all(clear)
        assert np.array_equal(solved, margins >= 0.0)
        assert 0.05 < np.mean(solved) < 0.95
        assert np.array_equal(is_wrench_feasible(robot, poses), solved)


def test_margin_is_the_largest_disturbance_in_every_direction() -> None:
    """A linear program finds how far each direction reaches; the least over facets' normals is the margin."""
    robot = ipanema(t_min=10.0)
    pose = np.array([0.3, -0.2, 0.9, 0.05, 0.02, -0.1])
    margin = capacity_margins(robot, pose)[0]
    W, w = (v[0] for v in cable_functions(robot).both(pose))
    weights = np.array([1, 1, 1, *[robot.length_scale] * 3])
    facets = compute_facets(robot, pose)
    normals = facets.normals[0][~facets.is_flat[0]]
    random = np.random.default_rng(12)
    others = random.normal(size=(40, 6))
    others /= np.linalg.norm(others, axis=1)[:, None]

    def reach(direction: Array) -> float:
        solved = linprog(
            np.append(np.zeros(8), -1.0),
            A_eq=np.column_stack([W, weights * direction]),
            b_eq=-w,
            bounds=[*zip(robot.t_min, robot.t_max, strict=True), (0, None)],
        )
        return float(solved.x[-1])

    assert min(reach(d) for d in others) >= margin - 1e-6
    nearest = min(min(reach(d), reach(-d)) for d in normals)
    assert nearest == pytest.approx(margin, rel=1e-6)


def test_columns_that_are_dependent_span_no_facet() -> None:
    random = np.random.default_rng(13)
    W = random.normal(size=(6, 7))
    doubled = np.concatenate([W, W[:, :1]], axis=1)  # two cables on one line
    facets = facets_of(doubled[None], np.ones(8), np.full(8, 5.0))
    assert np.sum(facets.is_flat) == np.sum([0 in s and 7 in s for s in facets.columns.tolist()])
    wrench = -(doubled @ np.full(8, 3.0))
    single = facets_of(W[None], np.array([2.0, *[1.0] * 6]), np.array([10.0, *[5.0] * 6]))
    assert np.min(facets.distances(wrench)) == pytest.approx(np.min(single.distances(wrench)), rel=1e-9)


def test_symmetric_poses_are_judged() -> None:
    """At the centre of IPAnema many sets of five cables are dependent."""
    robot = ipanema(t_min=10.0)
    pose = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    facets = compute_facets(robot, pose)
    assert 0 < np.sum(facets.is_flat) < facets.is_flat.size
    near = pose + 1e-6 * np.random.default_rng(14).normal(size=(20, 6))
    assert capacity_margins(robot, near) == pytest.approx(np.full(20, capacity_margins(robot, pose)[0]), rel=1e-4)


@pytest.mark.parametrize("points", [[(0.1, 0, 0)] * 8, [(x, 0, 0) for x in np.linspace(-0.1, 0.1, 8)]])
def test_a_platform_that_cables_do_not_feel_has_no_margin(points: list[tuple[float, float, float]]) -> None:
    """All cables on one point give no moment about it, all on one line none about the line."""
    robot = ipanema(attachments=points, centre=(0, 0.01, 0), characteristic_length=0.1)
    assert capacity_margins(robot, [0.1, 0.2, 1.0, 0.1, 0.2, 0.3])[0] < -1e-3
    # a wrench that they balance all the same finds no margin either, and no pose counts as feasible
    held = ipanema(attachments=points, characteristic_length=0.1)
    pose = [0.1, 0.2, 1.0, 0.1, 0.2, 0.3]
    wrench = -cable_functions(held).wrench_matrix(pose)[0] @ np.full(8, 300.0)
    assert check_feasibility(held, pose, wrench).is_feasible
    assert capacity_margins(held, pose, wrench)[0] < 0.0
    assert not is_wrench_feasible(held, pose)[0]
    facets = compute_facets(held, pose)
    assert facets.is_lost[0]
    assert np.max(facets.distances(wrench)) < 0.0
    assert not has_wrench_closure(held, pose)[0]


@pytest.mark.parametrize(
    "robot",
    [
        ipanema(t_min=10.0, centre=(0.01, 0.02, -0.03), load=(5, 0, 3, 0.1, 0.2, 0.3)),
        ipanema(t_min=10.0, pulleys=[Pulley(radius=0.05)] * 8, order="zyx"),
        planar(t_min=1.0, gravity=(0, -9.81)),
    ],
    ids=["eyes", "pulleys", "planar"],
)
def test_gradients_are_those_of_central_differences(robot: CableRobot) -> None:
    poses = draw_poses(robot, 200, seed=15)
    margins, gradients = capacity_gradients(robot, poses)
    assert margins == pytest.approx(capacity_margins(robot, poses))
    h = 1e-6
    sides = [[capacity_margins(robot, poses + s * h * e) for s in (1, -1)] for e in np.eye(robot.dof)]
    numeric = np.stack([(a - b) / (2 * h) for a, b in sides], axis=1)
    # where two facets are equally near, one-sided slopes differ: none of these poses may be so
    assert gradients == pytest.approx(numeric, rel=1e-5, abs=1e-4)


def test_gradients_of_all_facets() -> None:
    robot = ipanema(t_min=10.0)
    poses = draw_poses(robot, 5, seed=16)
    wrench = cable_functions(robot).wrench(poses)
    facets = compute_facets(robot, poses)
    everyone = np.tile(np.arange(2 * len(facets.columns)), (5, 1))
    found = facet_gradients(robot, poses, facets, everyone)
    h, numeric = 1e-6, np.empty_like(found)
    for i, e in enumerate(np.eye(6)):
        ahead, behind = (compute_facets(robot, poses + s * h * e) for s in (1, -1))
        numeric[:, :, i] = (ahead.distances(wrench) - behind.distances(wrench)) / (2 * h)
    clear = np.isfinite(numeric)
    assert np.mean(clear) > 0.9
    scale = 1.0 + np.abs(numeric[clear])
    # a normal of nearly dependent columns may turn over within the step: those few are left out
    good = np.abs(found[clear] - numeric[clear]) / scale < 1e-4
    assert np.mean(good) > 0.98


def test_options_do_not_change_the_margins() -> None:
    robot, poses = ipanema(t_min=10.0), draw_poses(ipanema(), 333, seed=17)
    wanted = capacity_margins(robot, poses)
    for chunk in (1, 7, 5000):
        assert capacity_margins(robot, poses, None, FacetOptions(chunk=chunk)) == pytest.approx(wanted, rel=1e-12)
    with pytest.raises(DefinitionError, match="chunk"):
        FacetOptions(chunk=0)
    with pytest.raises(DefinitionError, match="flat"):
        FacetOptions(flat=0.0)


def test_names_tell_the_cables() -> None:
    names = facet_names(planar())
    assert names[0] == "facet of q1 q2, lower"
    assert len(names) == 2 * 6


def test_wrench_closure_of_the_centre() -> None:
    assert has_wrench_closure(planar(), [0.5, 0.5, 0.0])[0]
    assert not has_wrench_closure(planar(), [0.5, 0.5, 1.2])[0]
    assert not has_wrench_closure(ipanema(), [0.0, 0.0, 3.0, 0.0, 0.0, 0.0])[0]  # above all exits


def test_too_few_cables_are_refused() -> None:
    with pytest.raises(DefinitionError, match="4 cables hold 6 freedoms"):
        capacity_margins(hanging(), [0.5, 0.5, -0.5, 0, 0, 0])
