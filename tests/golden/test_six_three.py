"""The 6-3 platform: ranks of models.md §2 for six legs, lengths measured by hand, and its known singularities."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.robots import six_three
from paraopt.robots.six_three import BASE_POINTS, PLATFORM_POINTS
from paraopt.spatial import transform

POSE = ("x", "y", "z", "alpha", "beta", "gamma")


@functools.cache
def robot() -> po.Robot:
    return six_three()


def test_counts_and_ranks() -> None:
    """As for the 6-6 platform: N = 24, 18 equations of rank 18, m = 6."""
    report = po.report_state(robot().kinematics, robot().home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility) == (24, 18, 6)
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [18, 6, 12, 6, 18, 18]


def test_inverse_model_is_the_distance_between_the_joints() -> None:
    r = robot()
    spread = np.array([0.06, 0.06, 0.05, 0.2, 0.2, 0.2])
    for pose in np.array([0, 0, 0.6, 0, 0, 0]) + np.random.default_rng(0).uniform(-spread, spread, size=(20, 6)):
        X = transform(pose[:3], pose[3:])
        ends = np.repeat(np.array(PLATFORM_POINTS), 2, axis=0) @ X[:3, :3].T + X[:3, 3]
        solution = r.kinematics.inverse(dict(zip(POSE, pose.tolist(), strict=True)), r.home_configuration)
        lengths = np.linalg.norm(ends - np.array(BASE_POINTS), axis=1)
        assert_allclose(solution.configuration.active, lengths, atol=1e-9)
        assert not solution.out_of_range


def test_legs_of_a_pair_meet() -> None:
    r = robot()
    poses = dict(zip((k.name for k in r.mechanism.links), r.kinematics.poses(r.home_configuration.X)[0], strict=True))
    for i in (1, 3, 5):
        assert_allclose(poses[f"rod {i}"][:3, 3], poses[f"rod {i + 1}"][:3, 3], atol=1e-12)


def test_quarter_turn_about_the_vertical_is_singular() -> None:
    """Hunt's and Fichter's singularity of the symmetric platform: level, on the axis, turned by a right angle."""
    r = robot()
    margins = []
    for angle in np.radians([0, 30, 60, 85, 90]):
        pose = {"x": 0.0, "y": 0.0, "z": 0.6, "alpha": 0.0, "beta": 0.0, "gamma": float(angle)}
        cfg = r.kinematics.inverse(pose, r.home_configuration).configuration
        margins.append(po.report_state(r.kinematics, cfg).parallel_margin)
    assert margins[-1] < 1e-9
    assert all(a > b for a, b in itertools.pairwise(margins))
    assert margins[0] > 0.1


def test_three_platform_points_are_needed() -> None:
    with pytest.raises(po.DefinitionError, match="6 platform points"):
        six_three(platform_points=PLATFORM_POINTS * 2)
