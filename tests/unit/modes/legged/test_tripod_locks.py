"""What the locks of a leg in the air hold, and what escapes them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.modes.legged.tripod import (
    check_locks,
    fit_platform,
    lock_matrix,
    lock_names,
    report_locks,
    smallest_of_columns,
    tilt_frame,
    tripod_model,
)
from tripods import FEET, GEOMETRY, HOME, TILTED, random_stances, walker

MODEL = tripod_model(GEOMETRY)
LEGS = (1, 2, 3)


@pytest.mark.parametrize("leg", LEGS)
def test_level_poses_are_refused_with_the_reason(leg: int) -> None:
    rng = np.random.default_rng(leg)
    for _ in range(5):  # anywhere, turned about the vertical: level is enough
        pose = HOME + rng.uniform(-1, 1, 6) * (0.03, 0.03, 0.03, 0, 0, 0.2)
        report = report_locks(MODEL, leg, pose, FEET)
        assert report.rank == 5
        assert report.singular_values[-2] > 0.1
        with pytest.raises(po.InfeasibleError) as caught:
            check_locks(MODEL, leg, pose, FEET, phase="swing")
        told = str(caught.value)
        for words in (
            "phase 'swing'", f"foot {leg} cannot come off", "rank 5 of 6", f"slides along lc of leg {leg}",
            "all locked joints unchanged", "P_L P_R of both standing legs is square to the normal of its foot",
        ):  # fmt: skip
            assert words in told
        assert caught.value.evidence["margin"] < 1e-12


@pytest.mark.parametrize("leg", LEGS)
def test_the_slide_leaves_all_locked_joints_as_they_are(leg: int) -> None:
    """Not only to first order: 40 mm along lc change b by rounding errors alone."""
    report = report_locks(MODEL, leg, HOME, FEET)
    slid = HOME + report.direction * MODEL.scale * np.linspace(0, 0.04 / GEOMETRY.radius, 9)[:, None]
    b = MODEL.locks(leg, slid, FEET).b
    assert np.max(np.abs(b - b[0])) < 1e-13
    lengths = MODEL.inverse(slid, FEET)[:, MODEL.names.index(f"q4 {leg}")]
    assert_allclose(lengths - lengths[0], np.linspace(0, 0.04, 9), atol=1e-12)


def test_what_counts_is_the_platform_against_the_feet_and_not_against_the_vertical() -> None:
    """A level platform on feet that lean to opposite sides: regular; on a slope, parallel to it: rank 5."""
    feet = FEET.copy()
    feet[1:, 3] += 0.2, -0.2
    assert report_locks(MODEL, 1, HOME, feet).rank == 6
    tilted = tilt_frame(HOME, 0.0, 0.2)
    slope = np.array([tilt_frame(f, -f[5], 0.2) for f in FEET])
    assert report_locks(MODEL, 1, tilted, slope).rank == 5


@pytest.mark.parametrize("leg", LEGS)
def test_a_tilt_about_the_leg_makes_the_locks_regular(leg: int) -> None:
    values = [
        check_locks(MODEL, leg, tilt_frame(HOME, GEOMETRY.azimuth(leg), a), FEET).smallest for a in (0.1, 0.2, 0.3)
    ]
    assert values == sorted(values)
    assert values[-1] == pytest.approx(0.0745, abs=5e-5)  # the same for each leg: the machine has three-fold symmetry
    # nearly level: refused in words of its own
    with pytest.raises(po.InfeasibleError, match="nearly rank 5"):
        check_locks(MODEL, leg, tilt_frame(HOME, GEOMETRY.azimuth(leg), 0.01), FEET)


@pytest.mark.parametrize("leg", LEGS)
def test_the_matrix_is_that_of_the_general_kinematics(leg: int) -> None:
    poses, feet = random_stances(40, leg)
    X, kinematics = walker().configurations(poses, feet), walker().robot.kinematics
    assert_allclose(lock_matrix(kinematics, leg, X, GEOMETRY.radius), MODEL.locks(leg, poses, feet).B, atol=1e-10)
    # the columns that are solved for lose rank where the matrix does, and only there
    level = walker().configurations(HOME, FEET)
    assert smallest_of_columns(kinematics, leg, level)[0] < 1e-12
    ratio = smallest_of_columns(kinematics, leg, X) / np.linalg.svd(MODEL.locks(leg, poses, feet).B)[1][:, -1]
    assert 0.1 < np.min(ratio) < np.max(ratio) < 1.0


def test_forward_model_from_150_random_starts() -> None:
    """`min |b(x) - b|` at 0.3 rad: a decimetre and 0.4 rad around, every start comes to the one pose."""
    b = MODEL.locks(1, TILTED, FEET).b[0]
    rng = np.random.default_rng(0)
    starts = TILTED + rng.uniform(-1, 1, (150, 6)) * (0.1, 0.1, 0.1, 0.4, 0.4, 0.4)
    poses, left = fit_platform(MODEL, 1, b, FEET, starts)
    assert np.max(left) < 1e-12
    assert_allclose(poses, np.tile(TILTED, (150, 1)), rtol=0, atol=1e-11)


def test_forward_model_of_the_general_kinematics_from_the_same_starts() -> None:
    robot = walker().robot
    X = walker().configurations(TILTED, FEET)[0]
    names = [*lock_names(1), *(n for n in robot.mechanism.operational if n.startswith("foot"))]
    rng = np.random.default_rng(0)
    poses = TILTED + rng.uniform(-1, 1, (150, 6)) * (0.1, 0.1, 0.1, 0.4, 0.4, 0.4)
    values = np.tile(X[robot.mechanism.indices(names)], (150, 1))
    found = robot.kinematics.fit_batch(names, values, walker().configurations(poses, FEET))
    assert_allclose(found.X, np.tile(X, (150, 1)), rtol=0, atol=1e-9)


def test_forward_model_says_what_is_left_where_no_pose_has_the_locks() -> None:
    b = MODEL.locks(1, TILTED, FEET).b[0] + [0, 0, 0, 0, 0.4, -0.4]
    _, left = fit_platform(MODEL, 1, b, FEET + np.array([0, 0, 0.5, 0, 0, 0]), TILTED)
    assert left[0] > 1e-3


def test_slopes_of_singular_values() -> None:
    poses, feet = random_stances(6, 9)
    U, values, V = np.linalg.svd(MODEL.locks(2, poses, feet).B)
    by_pose, by_feet = MODEL.lock_slopes(2, poses, feet, U[:, :, 5], V[:, 5])
    h = 1e-6
    for k in range(6):
        move = np.eye(6)[k] * h
        high, low = (np.linalg.svd(MODEL.locks(2, poses + s * move, feet).B)[1][:, 5] for s in (1, -1))
        assert_allclose(by_pose[:, k], (high - low) / (2 * h), atol=1e-7)
    for k in (0, 7, 17):
        move = (np.eye(18)[k] * h).reshape(3, 6)
        high, low = (np.linalg.svd(MODEL.locks(2, poses, feet + s * move).B)[1][:, 5] for s in (1, -1))
        assert_allclose(by_feet[:, k], (high - low) / (2 * h), atol=1e-7)
    assert values.shape == (6, 6)
