"""The Delta of Chablat1998, 3.4.7: R1, R2, L1, L2 = 1.8, 0.3, 2.4, 2.8; models.md §10 for the singularities."""

from __future__ import annotations

import functools
import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import paraopt as po
from paraopt.kinematics import MotionSpace
from paraopt.robots import delta

Array = np.ndarray
R1, R2, L1, L2 = 1.8, 0.3, 2.4, 2.8
AZIMUTH = 2 * np.pi * np.arange(3) / 3
OUT = np.column_stack([np.cos(AZIMUTH), np.sin(AZIMUTH), np.zeros(3)])
ACROSS = np.column_stack([-np.sin(AZIMUTH), np.cos(AZIMUTH), np.zeros(3)])


@functools.cache
def robot() -> po.Robot:
    return delta(R1, R2, L1, L2)


def elbows(theta: Array) -> Array:
    """B_i, shape (3, 3)."""
    theta = np.asarray(theta)
    return (R1 + L1 * np.cos(theta))[:, None] * OUT - (L1 * np.sin(theta))[:, None] * np.array([0, 0, 1.0])


def arm_angles(p: Array) -> Array:
    """Both postures of each arm at a position of the platform, the outer elbow first, shape (3, 2)."""
    angles = []
    for e in OUT:
        way = np.asarray(p) + (R2 - R1) * e
        k = (way @ way + L1**2 - L2**2) / (2 * L1)
        middle, half = math.atan2(-way[2], way @ e), math.acos(k / math.hypot(way @ e, way[2]))
        angles.append(sorted((middle - half, middle + half), key=lambda t: -math.cos(t)))
    return np.array(angles)


def values(p: Array, theta: Array) -> dict[str, float]:
    """Close the loops by hand: platform level at p, arms at theta."""
    found: dict[str, float] = dict(zip("xyz", np.asarray(p, dtype=float).tolist(), strict=True))
    for i, (t, way) in enumerate(zip(theta, p + R2 * OUT - elbows(theta), strict=True), start=1):
        found[f"theta{i}"] = float(t)
        for side in "+-":
            # Ry(theta + a) Rx(b) (-e_z) = (-sin(theta + a) cos b, sin b, -cos(theta + a) cos b)
            found[f"rod {i}{side}.y"] = math.atan2(-way @ OUT[i - 1], -way[2]) - float(t)
            found[f"rod {i}{side}.x"] = math.asin(way @ ACROSS[i - 1] / L2)
    return found


def closed(p: Array, theta: Array) -> Array:
    r = robot()
    given = values(p, theta)
    X = np.array([given.get(n, 0.0) for n in r.mechanism.names])
    return r.kinematics.configuration(X).X  # raises where the loops are open


def parallel_margin(X: Array) -> float:
    return float(MotionSpace(robot().kinematics, robot().mechanism.names[-3:]).margins(X[None]).parallel[0])


def volume(points: Array, p: Array) -> float:
    """Six times the volume of the tetrahedron of three points and p, over L2^3: zero where they are coplanar."""
    return float(np.linalg.det((points - p) / L2))


def random_positions(count: int, seed: int = 0) -> Array:
    spread = np.array([0.6, 0.6, 0.5])
    return np.array([0, 0, -3.5]) + np.random.default_rng(seed).uniform(-spread, spread, size=(count, 3))


def test_counts_and_ranks() -> None:
    """Three arms and six rods: by counting, 3 + 6 x 2 + 6 variables, 6 x 3 equations, three freedoms."""
    report = po.report_state(robot().kinematics, robot().home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility, report.idle) == (21, 18, 3, ())
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [18, 3, 15, 3, 18, 18]


def test_spherical_elbows_add_six_spins() -> None:
    r = delta(spherical_elbow=True)
    report = po.report_state(r.kinematics, r.home_configuration)
    assert (report.n_variables, report.mobility, report.useful_mobility) == (27, 9, 3)
    assert all(name.startswith("rod") and name.endswith(".z") for name in report.idle)


def test_inverse_model_and_rotations_that_stay_zero() -> None:
    r = robot()
    for p in random_positions(20):
        cfg = r.kinematics.inverse(dict(zip("xyz", p.tolist(), strict=True)), r.home_configuration).configuration
        assert_allclose(cfg.active, arm_angles(p)[:, 0], atol=1e-9)
        assert_allclose([cfg[n] for n in ("alpha", "beta", "gamma")], 0, atol=1e-9)


def test_rotations_stay_zero_along_a_finite_motion() -> None:
    """Printed: the parallelograms keep the platform level. A turn round the workspace, from pose to pose."""
    r = robot()
    cfg = r.home_configuration
    for s in np.linspace(0, 2 * np.pi, 60):
        target = {"x": 1.0 * math.sin(s), "y": 0.8 * math.sin(2 * s), "z": -3.5 + 0.5 * math.sin(3 * s)}
        cfg = r.kinematics.inverse(target, cfg).configuration
        assert max(abs(cfg[n]) for n in ("alpha", "beta", "gamma")) < 1e-9


def test_eight_working_modes() -> None:
    """Printed: 8 solutions of the inverse model; every product of the two postures of each arm closes the loops."""
    (p,) = random_positions(1, seed=1)
    postures = arm_angles(p)
    modes = [postures[np.arange(3), list(choice)] for choice in itertools.product((0, 1), repeat=3)]
    closed_modes = [closed(p, theta)[:3] for theta in modes]
    assert len(np.unique(np.round(closed_modes, 6), axis=0)) == 8 == robot().facts["working modes"]


def test_two_assembly_modes() -> None:
    """Printed: 2 solutions of the forward model: P is on three spheres about B_i - R2 e_i, mirrored in their plane."""
    r = robot()
    (p,) = random_positions(1, seed=2)
    theta = arm_angles(p)[:, 0]
    shifted = elbows(theta) - R2 * OUT
    normal = np.cross(shifted[1] - shifted[0], shifted[2] - shifted[0])
    normal /= np.linalg.norm(normal)
    mirrored = p - 2 * (normal @ (p - shifted[0])) * normal
    for place in (p, mirrored):
        start = closed(place, theta)
        found = r.kinematics.forward(dict(zip(r.mechanism.active, theta.tolist(), strict=True)), start)
        assert_allclose(found.configuration.operational, place, atol=1e-9)
    assert np.linalg.norm(mirrored - p) > 1


def centre_on(points: Array) -> tuple[Array, float]:
    """Centre and radius of the circle through three points."""
    a, b = points[0] - points[2], points[1] - points[2]
    n = np.cross(a, b)
    centre = points[2] + np.cross((a @ a) * b - (b @ b) * a, n) / (2 * n @ n)
    return centre, float(np.linalg.norm(centre - points[0]))


def coplanar_pose(first: float, second: float, shift: float) -> tuple[Array, Array]:
    """Find theta_3 with P in the plane of B_i - shift e_i, at the distance L2 of the rods from B_i - R2 e_i."""

    def gap(third: float) -> Any:
        return centre_on(elbows(np.array([first, second, third])) - shift * OUT)[1] - L2

    angles = np.linspace(-1.2, 2.5, 200)
    gaps = [gap(t) for t in angles]
    k = next(i for i in range(199) if gaps[i] * gaps[i + 1] < 0)
    theta = np.array([first, second, brentq(gap, angles[k], angles[k + 1], xtol=1e-15)])
    return centre_on(elbows(theta) - shift * OUT)[0], theta


@pytest.mark.parametrize(("first", "second"), [(0.9, 1.6), (0.3, 1.4), (1.2, 0.8)])
def test_parallel_singularity_where_shifted_elbows_and_platform_are_coplanar(first: float, second: float) -> None:
    p, theta = coplanar_pose(first, second, R2)
    assert abs(volume(elbows(theta) - R2 * OUT, p)) < 1e-12
    assert parallel_margin(closed(p, theta)) < 1e-12
    # the printed condition takes the elbows themselves: here they are not coplanar with P
    assert abs(volume(elbows(theta), p)) > 2e-3


def test_printed_condition_does_not_tell_the_singularity() -> None:
    """Where the real elbows and P are coplanar the machine is regular; found along a motion of the platform."""

    def place(z: float) -> tuple[Array, Array]:
        p = np.array([1.5, 0.3, z])
        return p, arm_angles(p)[:, 0]

    def printed(z: float) -> float:
        p, theta = place(z)
        return volume(elbows(theta), p)

    p, theta = place(brentq(printed, -1.3, -1.0, xtol=1e-15))
    assert abs(volume(elbows(theta), p)) < 1e-12
    assert abs(volume(elbows(theta) - R2 * OUT, p)) > 1e-2
    assert parallel_margin(closed(p, theta)) > 1e-2


def test_margin_falls_with_the_volume_and_only_there() -> None:
    """Towards the singularity the margin goes to zero with the shifted volume, to first order."""
    p, theta = coplanar_pose(0.9, 1.6, R2)
    normal = np.cross(*(elbows(theta) - R2 * OUT - p)[:2])
    normal /= np.linalg.norm(normal)
    ratios = []
    for step in (1e-3, 2e-3, 4e-3):
        off = p - step * normal
        postures = arm_angles(off)
        near = postures[np.arange(3), np.argmin(np.abs(postures - theta[:, None]), axis=1)]
        X = closed(off, near)
        ratios.append(parallel_margin(X) / abs(volume(elbows(near) - R2 * OUT, off)))
        assert parallel_margin(X) > 1e-5
    assert_allclose(ratios, ratios[0], rtol=0.05)


def test_full_stretch_in_the_plane_of_the_base() -> None:
    """Printed: with R1 + L1 = R2 + L2 arms, rods and base lie in one plane at one angle, and there it is singular.

    The source measures theta = pi from the inward direction; here the arms point outwards at theta = 0.
    """
    rod = R1 + L1 - R2
    flat = delta(R1, R2, L1, rod, height=-2.0)
    names = flat.mechanism.names
    given = {f"rod {i}{s}.y": math.pi / 2 for i in (1, 2, 3) for s in "+-"}  # inwards, along -x of the arm
    X = np.array([given.get(n, 0.0) for n in names])
    cfg = flat.kinematics.configuration(X)
    report = po.report_state(flat.kinematics, cfg)
    assert report.ranks["[N K]"].value < report.ranks["N"].value + 3
    # it cannot withstand a force along z
    assert report.parallel_margin < 1e-9


def test_home_out_of_reach_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="cannot reach the platform at home"):
        delta(height=-6.0)
