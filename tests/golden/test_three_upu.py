"""The 3-UPU: lengths by hand, a platform that does not turn, and where it could: where the constraints are singular."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.robots import three_upu

Array = np.ndarray
R_BASE, R_PLATFORM, HEIGHT = 0.4, 0.1, 0.4
AZIMUTH = 2 * np.pi * np.arange(3) / 3
OUT = np.column_stack([np.cos(AZIMUTH), np.sin(AZIMUTH), np.zeros(3)])
ACROSS = np.column_stack([-np.sin(AZIMUTH), np.cos(AZIMUTH), np.zeros(3)])


@functools.cache
def robot() -> po.Robot:
    return three_upu(R_BASE, R_PLATFORM, HEIGHT)


def positions(count: int, seed: int = 0) -> Array:
    spread = np.array([0.1, 0.1, 0.08])
    return np.array([0, 0, HEIGHT]) + np.random.default_rng(seed).uniform(-spread, spread, size=(count, 3))


def test_counts_and_ranks() -> None:
    report = po.report_state(robot().kinematics, robot().home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility, report.idle) == (15, 12, 3, ())
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [12, 3, 9, 3, 12, 12]


def test_inverse_model_and_orientation_that_is_kept() -> None:
    r = robot()
    for p in positions(20):
        cfg = r.kinematics.inverse(dict(zip("xyz", p.tolist(), strict=True)), r.home_configuration).configuration
        assert_allclose(cfg.active, np.linalg.norm(p + (R_PLATFORM - R_BASE) * OUT, axis=1), atol=1e-9)
        assert_allclose([cfg[n] for n in ("alpha", "beta", "gamma")], 0, atol=1e-9)


@pytest.mark.parametrize("lean", [1e-3, 1e-2, 0.1, 0.2])
def test_home_comes_near_a_singularity_of_the_constraints_as_the_legs_stand_up(lean: float) -> None:
    """At home the legs withstand turning about their own directions: their determinant is 3 sqrt(3)/2 sin^2 cos.

    The smallest singular value of the scaled E goes to zero with the lean of the legs, the sine of their angle.
    """
    legs = np.array([0, 0, HEIGHT]) - lean * OUT
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    psi = math.atan2(lean, HEIGHT)
    assert np.linalg.det(legs) == pytest.approx(1.5 * math.sqrt(3) * math.sin(psi) ** 2 * math.cos(psi), rel=1e-9)
    r = three_upu(R_BASE, R_BASE - lean, HEIGHT)
    (E,) = r.kinematics.functions.scaled_jacobian(r.home_configuration.X)
    smallest = np.linalg.svd(E, compute_uv=False)[-1]
    assert 0.05 * math.sin(psi) < smallest < math.sin(psi)


def test_upright_legs_let_the_platform_turn() -> None:
    """Base and platform of one size: all legs withstand turning about the vertical only; two more motions appear."""
    r = three_upu(R_BASE, R_BASE, HEIGHT)
    report = po.report_state(r.kinematics, r.home_configuration)
    assert report.ranks["E"].value == 10
    assert report.mobility == 5


def test_directions_of_the_constraints_away_from_home() -> None:
    """Leg i withstands turning about n_i, normal to both axes of its joint; the platform keeps still while they span.

    By hand n_i is the leg's projection on its vertical plane. The rank of E falls only where the n_i are dependent.
    """
    r = robot()
    for p in positions(10, seed=1):
        cfg = r.kinematics.inverse(dict(zip("xyz", p.tolist(), strict=True)), r.home_configuration).configuration
        legs = p + (R_PLATFORM - R_BASE) * OUT
        n = legs - np.sum(legs * ACROSS, axis=1)[:, None] * ACROSS
        n /= np.linalg.norm(n, axis=1)[:, None]
        poses = dict(zip((k.name for k in r.mechanism.links), r.kinematics.poses(cfg.X)[0], strict=True))
        for i in range(3):
            inner = poses[f"rod {i + 1}"][:3, 0]
            assert_allclose(np.cross(inner, ACROSS[i]), n[i], atol=1e-9)
        assert abs(np.linalg.det(n)) > 0.3
        assert po.report_state(r.kinematics, cfg).ranks["E"].value == 12
