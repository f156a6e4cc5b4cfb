"""The 2-delta: the inner Delta alone places the end effector (Lahouar, I.2: position and orientation decoupled)."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.robots import two_delta
from paraopt.spatial import transform

Array = np.ndarray
POSE = ("x", "y", "z", "alpha", "beta", "gamma")
INNER = (0.15, 0.05, 0.25, 0.5, 0.06)
OUTER = (0.35, 0.17, 0.35, 0.7, 0.14)
NECK, LEVER, RISE, TURN, HEIGHT = 0.2, 0.12, 0.1, 0.09, -0.7


@functools.cache
def robot() -> po.Robot:
    return two_delta(INNER, OUTER, NECK, LEVER, RISE, TURN, HEIGHT)


def poses(count: int, seed: int = 0) -> Array:
    spread = np.array([0.05, 0.05, 0.04, 0.2, 0.2, 0.2])
    return np.array([0, 0, HEIGHT, 0, 0, 0]) + np.random.default_rng(seed).uniform(-spread, spread, size=(count, 6))


def solve(pose: Array) -> po.Configuration:
    r = robot()
    return r.kinematics.inverse(dict(zip(POSE, pose.tolist(), strict=True)), r.home_configuration).configuration


def arm_angles(p: Array, sizes: tuple[float, ...], first: float) -> Array:
    """Give the outer posture of the arms of one Delta with its platform at p."""
    R1, R2, L1, L2, _ = sizes
    angles = []
    for k in range(3):
        azimuth = first + 2 * math.pi * k / 3
        way = p + (R2 - R1) * np.array([math.cos(azimuth), math.sin(azimuth), 0])
        u = way[0] * math.cos(azimuth) + way[1] * math.sin(azimuth)
        opening = math.acos((way @ way + L1**2 - L2**2) / (2 * L1) / math.hypot(u, way[2]))
        middle = math.atan2(-way[2], u)
        angles.append(max((middle - opening, middle + opening), key=math.cos))
    return np.array(angles)


def test_counts_and_ranks() -> None:
    """By counting: 2 x (3 + 12) for the Deltas, 3 x 2 ties, 3 x 6 free links; 3 x (12 rods, 3 ties, 1 joint)."""
    report = po.report_state(robot().kinematics, robot().home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility, report.idle) == (54, 48, 6, ())
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [48, 6, 42, 6, 48, 48]


def test_inverse_model_by_hand() -> None:
    """The inner arms follow from the position; the outer ones from the ring, whose ties keep their length."""
    for pose in poses(15):
        cfg = solve(pose)
        assert_allclose(cfg.active[:3], arm_angles(pose[:3] + np.array([0, 0, NECK]), INNER, 0.0), atol=1e-9)
        ring = np.array([cfg[f"ring.{n}"] for n in "xyz"])
        assert_allclose(cfg.active[3:], arm_angles(ring, OUTER, math.pi / 3), atol=1e-9)
        X = transform(pose[:3], pose[3:])
        for azimuth in 2 * np.pi * np.arange(3) / 3:
            end = LEVER * np.array([math.cos(azimuth), math.sin(azimuth), 0])
            hold = end + TURN * np.array([-math.sin(azimuth), math.cos(azimuth), 0])
            tie = ring + hold - (X[:3, :3] @ end + X[:3, 3])
            assert abs(np.linalg.norm(tie) - math.hypot(RISE, TURN)) < 1e-9
        turned = [cfg[f"{part}.{n}"] for part in ("carrier", "ring") for n in ("alpha", "beta", "gamma")]
        assert_allclose(turned, 0, atol=1e-9)


def test_outer_arms_turn_and_do_not_move_the_end_effector() -> None:
    """In velocities, and over a finite motion: with the inner arms held the centre of the ball joint stays."""
    r = robot()
    for pose in poses(5, seed=1):
        cfg = solve(pose)
        T = r.kinematics.tangent(cfg.X, r.mechanism.active)[0]
        place, turn = r.mechanism.indices(POSE[:3]), r.mechanism.indices(POSE[3:])
        assert_allclose(T[place][:, 3:], 0, atol=1e-9)
        assert np.linalg.matrix_rank(T[place][:, :3], tol=1e-3) == 3
        assert np.linalg.matrix_rank(T[turn][:, 3:], tol=1e-3) == 3
        q = cfg.active + np.array([0, 0, 0, 0.05, -0.03, 0.04])
        moved = r.kinematics.forward(dict(zip(r.mechanism.active, q.tolist(), strict=True)), cfg).configuration
        assert_allclose(moved.operational[:3], pose[:3], atol=1e-9)
        assert np.max(np.abs(moved.operational[3:] - pose[3:])) > 0.02
