"""Lee's manipulator (3-RPS): lengths of the legs and the motions that follow the three free ones, by hand."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.robots import lee
from paraopt.spatial import transform

Array = np.ndarray
R_BASE, R_PLATFORM = 0.35, 0.2
AZIMUTH = 2 * np.pi * np.arange(3) / 3
OUT = np.column_stack([np.cos(AZIMUTH), np.sin(AZIMUTH), np.zeros(3)])


@functools.cache
def robot() -> po.Robot:
    return lee(R_BASE, R_PLATFORM)


def poses(count: int, seed: int = 0) -> Array:
    spread = np.array([0.05, 0.25, 0.25])
    return np.array([0.5, 0, 0]) + np.random.default_rng(seed).uniform(-spread, spread, size=(count, 3))


def pose_by_hand(z: float, alpha: float, beta: float) -> Array:
    """Place the platform (4, 4): each end stays in the vertical plane of its leg, whence R12 = R21, x and y."""
    gamma = math.atan2(-math.sin(alpha) * math.sin(beta), math.cos(alpha) + math.cos(beta))
    X = transform((0, 0, z), (alpha, beta, gamma))
    X[0, 3], X[1, 3] = 0.5 * R_PLATFORM * (X[0, 0] - X[1, 1]), -R_PLATFORM * X[1, 0]
    return X


def test_counts_and_ranks() -> None:
    report = po.report_state(robot().kinematics, robot().home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility, report.idle) == (12, 9, 3, ())
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [9, 3, 6, 3, 9, 9]
    assert robot().mechanism.operational == ("z", "alpha", "beta")


def test_inverse_model_and_parasitic_motions() -> None:
    r = robot()
    for z, alpha, beta in poses(20).tolist():
        solution = r.kinematics.inverse({"z": z, "alpha": alpha, "beta": beta}, r.home_configuration)
        cfg, X = solution.configuration, pose_by_hand(z, alpha, beta)
        lengths = np.linalg.norm(R_PLATFORM * OUT @ X[:3, :3].T + X[:3, 3] - R_BASE * OUT, axis=1)
        assert_allclose(cfg.active, lengths, atol=1e-9)
        assert_allclose((cfg["x"], cfg["y"]), X[:2, 3], atol=1e-9)
        assert abs(math.atan2(-X[0, 1], X[0, 0]) - cfg["gamma"]) < 1e-9
        assert not solution.out_of_range


def test_level_platform_is_on_the_axis_and_a_tilted_one_is_not() -> None:
    r = robot()
    level = r.kinematics.inverse({"z": 0.55, "alpha": 0, "beta": 0}, r.home_configuration).configuration
    assert_allclose([level[n] for n in ("x", "y", "gamma")], 0, atol=1e-12)
    tilted = r.kinematics.inverse({"z": 0.5, "alpha": 0.3, "beta": 0.3}, level).configuration
    assert abs(tilted["gamma"]) > 0.01
    assert abs(tilted["y"]) > 1e-3


def test_leg_in_the_plane_of_the_platform_is_singular() -> None:
    """All legs in the plane of the ball joints, platform level at z = 0: nothing withstands a force along z."""
    r = lee(R_BASE, R_PLATFORM, height=0.1)
    given = {f"q{i}": R_BASE - R_PLATFORM for i in (1, 2, 3)} | {f"leg {i}": -math.pi / 2 for i in (1, 2, 3)}
    flat = r.kinematics.configuration([given.get(n, 0.0) for n in r.mechanism.names])
    assert po.report_state(r.kinematics, flat).parallel_margin < 1e-12
    assert po.report_state(r.kinematics, r.home_configuration).parallel_margin > 0.02
