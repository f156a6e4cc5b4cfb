"""The Hexa: the closed-form inverse model of an arm and a rod, and the 64 working modes of Chablat1998, 3.2.2."""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.robots import hexa
from paraopt.spatial import transform

Array = np.ndarray
POSE = ("x", "y", "z", "alpha", "beta", "gamma")
R1, D1, R2, D2, L1, L2 = 0.3, 0.2, 0.1, 0.12, 0.3, 0.6


@functools.cache
def robot() -> po.Robot:
    return hexa(R1, D1, R2, D2, L1, L2)


def arm_angles(pose: Array) -> Array:
    """Both postures of each arm, shape (6, 2), the outer elbow first: u cos(theta) - w sin(theta) = k."""
    X = transform(pose[:3], pose[3:])
    angles = []
    for i in range(6):
        azimuth, side = 2 * math.pi * (i // 2) / 3, (-0.5, 0.5)[i % 2]
        out, across = (
            np.array([math.cos(azimuth), math.sin(azimuth), 0]),
            np.array([-math.sin(azimuth), math.cos(azimuth), 0]),
        )
        way = X[:3, :3] @ (R2 * out + side * D2 * across) + X[:3, 3] - (R1 * out + side * D1 * across)
        u, w = way @ out, way[2]
        k = (way @ way + L1**2 - L2**2) / (2 * L1)
        middle, half = math.atan2(-w, u), math.acos(k / math.hypot(u, w))
        angles.append(sorted((middle - half, middle + half), key=lambda t: -math.cos(t)))
    return np.array(angles)


def random_poses(count: int, seed: int = 0) -> Array:
    spread = np.array([0.08, 0.08, 0.06, 0.2, 0.2, 0.2])
    return np.array([0, 0, -0.6, 0, 0, 0]) + np.random.default_rng(seed).uniform(-spread, spread, size=(count, 6))


def test_counts_and_ranks() -> None:
    report = po.report_state(robot().kinematics, robot().home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility) == (24, 18, 6)
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [18, 6, 12, 6, 18, 18]


def test_spherical_elbows_add_six_spins() -> None:
    r = hexa(spherical_elbow=True)
    report = po.report_state(r.kinematics, r.home_configuration)
    assert (report.n_variables, report.mobility, report.useful_mobility) == (30, 12, 6)
    assert set(report.idle) == {f"rod {i}.z" for i in range(1, 7)}


def test_inverse_model() -> None:
    r = robot()
    for pose in random_poses(20):
        solution = r.kinematics.inverse(dict(zip(POSE, pose.tolist(), strict=True)), r.home_configuration)
        assert_allclose(solution.configuration.active, arm_angles(pose)[:, 0], atol=1e-9)


def test_sixty_four_working_modes() -> None:
    """Printed: 64 = 2^6, two postures of each leg; every product of postures closes the loops."""
    r = robot()
    (pose,) = random_poses(1, seed=1)
    postures = arm_angles(pose)
    choices = np.array(list(itertools.product((0, 1), repeat=6)))
    wanted = postures[np.arange(6), choices]
    starts = np.tile(r.home_configuration.X, (64, 1))
    starts[:, :6] = wanted
    rods = r.mechanism.indices([f"rod {i}.y" for i in range(1, 7)])
    X = transform(pose[:3], pose[3:])
    for i in range(6):  # the rod's own angle, from the elbow to the platform
        azimuth, side = 2 * math.pi * (i // 2) / 3, (-0.5, 0.5)[i % 2]
        out, across = (
            np.array([math.cos(azimuth), math.sin(azimuth), 0]),
            np.array([-math.sin(azimuth), math.cos(azimuth), 0]),
        )
        way = X[:3, :3] @ (R2 * out + side * D2 * across) + X[:3, 3] - (R1 * out + side * D1 * across)
        along, down = way @ out - L1 * np.cos(wanted[:, i]), -way[2] - L1 * np.sin(wanted[:, i])
        starts[:, rods[i]] = np.arctan2(-along, down) - wanted[:, i]
    found = r.kinematics.solve_batch(POSE, np.tile(pose, (64, 1)), starts)
    assert np.all(found.converged)
    assert_allclose(found.X[:, :6], wanted, atol=1e-9)
    assert len(np.unique(np.round(found.X[:, :6], 6), axis=0)) == 64 == r.facts["working modes"]


def test_home_out_of_reach_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="cannot reach the platform at home"):
        hexa(height=-1.2)
