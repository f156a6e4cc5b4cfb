"""The Gough-Stewart platform against models.md §2 (Lahouar, II.3 and annex B) and against its legs measured by hand."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import MotionSpace
from paraopt.robots import stewart as module_function
from paraopt.robots.stewart import BASE_POINTS, PLATFORM_POINTS
from paraopt.spatial import transform

Array = np.ndarray
POSE = ("x", "y", "z", "alpha", "beta", "gamma")


@functools.cache
def robot(spherical_base: bool = False) -> po.Robot:
    return module_function(spherical_base=spherical_base)


def random_poses(count: int, seed: int = 0) -> Array:
    """Poses about home, within reach of the legs' strokes."""
    spread = np.array([0.08, 0.08, 0.05, 0.2, 0.2, 0.25])
    return np.array([0, 0, 0.6, 0, 0, 0]) + np.random.default_rng(seed).uniform(-spread, spread, size=(count, 6))


def leg_vectors(pose: Array, base: Array, platform: Array) -> Array:
    """From each foot to its end, shape (6, 3): p + R b_i - a_i."""
    X = transform(pose[:3], pose[3:])
    return platform @ X[:3, :3].T + X[:3, 3] - base


def test_counts_and_ranks() -> None:
    """Printed: M 18 x 6, N 18 x 12, K 18 x 6; with N = 24, rank 18 and m = 6 by counting."""
    r = robot()
    blocks = r.kinematics.jacobians(r.home_configuration.X)
    assert [b.shape for b in blocks] == [(18, 6), (18, 12), (18, 6)]
    report = po.report_state(r.kinematics, r.home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility) == (24, 18, 6)
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [18, 6, 12, 6, 18, 18]


def test_spherical_feet_add_six_spins() -> None:
    r = robot(spherical_base=True)
    report = po.report_state(r.kinematics, r.home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility) == (30, 18, 12)
    assert set(report.idle) == {f"leg {i}.z" for i in range(1, 7)}
    # what is not idle is the same machine
    assert report.parallel_margin == pytest.approx(
        po.report_state(robot().kinematics, robot().home_configuration).parallel_margin, abs=1e-12
    )


def test_inverse_model_is_the_distance_between_the_joints() -> None:
    r = robot()
    for pose in random_poses(20):
        solution = r.kinematics.inverse(dict(zip(POSE, pose.tolist(), strict=True)), r.home_configuration)
        lengths = np.linalg.norm(leg_vectors(pose, np.array(BASE_POINTS), np.array(PLATFORM_POINTS)), axis=1)
        assert_allclose(solution.configuration.active, lengths, atol=1e-9)
        assert not solution.out_of_range


def test_velocity_model_is_made_of_the_lines_of_the_legs() -> None:
    """What annex B amounts to: q_i' = u_i . v + (R b_i x u_i) . w, u_i along leg i and w the angular velocity."""
    r = robot()
    for pose in random_poses(5, seed=1):
        cfg = r.kinematics.inverse(dict(zip(POSE, pose.tolist(), strict=True)), r.home_configuration).configuration
        T = r.kinematics.tangent(cfg.X, POSE)[0][r.mechanism.indices(r.mechanism.active)]
        R = transform((0, 0, 0), pose[3:])[:3, :3]
        ways = leg_vectors(pose, np.array(BASE_POINTS), np.array(PLATFORM_POINTS))
        u = ways / np.linalg.norm(ways, axis=1)[:, None]
        Rx = transform((0, 0, 0), (pose[3], 0, 0))[:3, :3]
        Rxy = transform((0, 0, 0), (pose[3], pose[4], 0))[:3, :3]
        # w = e_x alpha' + Rx e_y beta' + Rx Ry e_z gamma'
        W = np.column_stack([np.eye(3)[:, 0], Rx[:, 1], Rxy[:, 2]])
        by_hand = np.hstack([u, np.cross(np.array(PLATFORM_POINTS) @ R.T, u) @ W])
        assert_allclose(T, by_hand, atol=1e-9)


def test_forward_model_returns_to_the_pose() -> None:
    r = robot()
    for pose in random_poses(5, seed=2):
        q = np.linalg.norm(leg_vectors(pose, np.array(BASE_POINTS), np.array(PLATFORM_POINTS)), axis=1)
        found = r.kinematics.forward(dict(zip(r.mechanism.active, q.tolist(), strict=True)), r.home_configuration)
        assert_allclose(found.configuration.operational, pose, atol=1e-8)


def margins_about_home(r: po.Robot) -> Array:
    """Parallel margins at random poses about home."""
    margins = []
    for pose in random_poses(10, seed=3):
        solution = r.kinematics.inverse(dict(zip(POSE, pose.tolist(), strict=True)), r.home_configuration)
        margins.append(MotionSpace(r.kinematics).margins(solution.configuration.X[None]).parallel[0])
    return np.array(margins)


def scaled_copy(base: Array) -> po.Robot:
    turn = transform((0, 0, 0), (0, 0, 0.5))[:3, :3]
    return module_function(base_points=base.tolist(), platform_points=(0.6 * base @ turn.T).tolist())


def test_platform_similar_to_a_base_on_a_circle_is_singular_everywhere() -> None:
    """An architectural singularity: p + R b - a is then linear in a, and the moments a x (p + R b - a) are quadratic.

    The six lines are combinations of 1, x, y, x^2, xy, y^2 at the feet: six feet on a conic make them dependent at
    every pose. The default platform is regular, and so is a scaled copy of a base whose feet lie on no conic.
    """
    assert np.max(margins_about_home(scaled_copy(np.array(BASE_POINTS)))) < 1e-12
    assert np.min(margins_about_home(robot())) > 0.1
    scattered = [(0.5, 0.05, 0), (-0.15, 0.45, 0), (-0.3, 0.4, 0), (-0.35, -0.4, 0), (-0.1, -0.5, 0), (0.45, -0.1, 0)]
    assert np.min(margins_about_home(scaled_copy(np.array(scattered)))) > 1e-3


def test_wrong_sizes_are_refused() -> None:
    with pytest.raises(po.DefinitionError, match="5 platform points"):
        module_function(platform_points=PLATFORM_POINTS[:5])
    with pytest.raises(po.DefinitionError, match="lengths of leg"):
        module_function(stroke=0.3)
