"""Working and assembly modes against the sources: Chablat1998, 2.3, 3.2 to 3.4 (models.md §10); elsewhere geometry."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po

Array = np.ndarray
# Chablat1998, table 3: x, y, phi of the six solutions for the legs 15.0, 15.4, 12.0
TABLE_3 = (
    (-8.715, 12.183, -0.987), (-5.495, -13.935, -0.047), (-14.894, 1.596, 0.244),
    (-13.417, -6.660, 0.585), (14.920, -1.337, 1.001), (14.673, -3.013, 2.133),
)  # fmt: skip
LEGS = {"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}


def home_pose(robot: po.Robot) -> dict[str, float]:
    return {n: robot.home_configuration[n] for n in robot.mechanism.operational}


def home_drives(robot: po.Robot) -> dict[str, float]:
    return {n: robot.home_configuration[n] for n in robot.mechanism.active}


def test_the_six_assembly_modes_of_table_3() -> None:
    """Six, three per sign; {2, 3, 6} in one aspect, {1, 4, 5} in the other; 0.15 as inputs were rounded in print."""
    robot = po.robots.three_rpr_innocenti()
    modes = robot.kinematics.assembly_modes(LEGS)
    assert (len(modes), modes.method, modes.complex_count) == (6, "planar sextic", 6)
    order = [int(np.argmin(np.max(np.abs(modes.poses - pose), axis=1))) for pose in TABLE_3]
    assert sorted(order) == list(range(6))
    assert_allclose(modes.poses[order], TABLE_3, rtol=0, atol=0.15)
    signs = modes.signs[order]
    assert set(signs[[1, 2, 5]]) == {-signs[0]}
    assert set(signs[[0, 3, 4]]) == {signs[0]}
    assert modes.is_balanced


def test_the_3_rpr_has_0_2_4_or_6_solutions_in_the_shares_of_the_source() -> None:
    """Fractions of the box of legs with 0, 2, 4, 6 solutions: 0.017, 0.586, 0.326, 0.071, within four deviations."""
    robot = po.robots.three_rpr_innocenti()
    random = np.random.default_rng(0)
    counts = np.zeros(7, dtype=int)
    draws = 400
    for legs in random.uniform(10.0, 32.0, size=(draws, 3)):
        modes = robot.kinematics.assembly_modes(dict(zip(LEGS, legs.tolist(), strict=True)))
        counts[len(modes)] += 1
        assert modes.is_balanced
    shares = np.array([0.017, 0.586, 0.326, 0.071])
    assert np.all(counts[1::2] == 0)
    deviations = np.sqrt(shares * (1 - shares) / draws)
    assert np.all(np.abs(counts[::2] / draws - shares) < 4 * deviations)


def test_the_five_bar_has_two_assembly_and_four_working_modes() -> None:
    robot = po.robots.five_bar()
    modes = robot.kinematics.assembly_modes(home_drives(robot))
    assert len(modes) == 2
    assert sorted(modes.signs) == [-1, 1]
    # by geometry: the tips mirror each other in the line of the elbows
    a, b = (home_drives(robot)[n] for n in ("theta1", "theta2"))
    elbows = np.array([(8 * np.cos(a), 8 * np.sin(a)), (9 + 5 * np.cos(b), 5 * np.sin(b))])
    gap, line = modes.poses[1] - modes.poses[0], elbows[1] - elbows[0]
    assert abs(gap @ line) < 1e-10
    assert abs(np.linalg.det([modes.poses.mean(axis=0) - elbows[0], line])) < 1e-10
    assert set(robot.kinematics.working_modes({"x": 6.0, "y": 7.0}).labels) == {"++", "+-", "-+", "--"}


def test_the_2_rpr_has_one_working_mode_and_two_assembly_modes() -> None:
    robot = po.robots.two_rpr()
    assert robot.kinematics.working_modes(home_pose(robot)).count == 1
    modes = robot.kinematics.assembly_modes(home_drives(robot))
    assert_allclose(modes.poses, [(5.5, 7.0), (5.5, -7.0)] if modes.poses[0, 1] > 0 else [(5.5, -7.0), (5.5, 7.0)],
                    rtol=0, atol=1e-10)  # fmt: skip
    assert modes.is_balanced


def test_the_3_rrr_has_up_to_six_assembly_and_eight_working_modes() -> None:
    """Printed: at most six. Random drives: 0, 2, 4 and 6 are met, never more."""
    robot = po.robots.three_rrr()
    random = np.random.default_rng(0)
    counts = set()
    for q in random.uniform(-np.pi, np.pi, size=(80, 3)):
        modes = robot.kinematics.assembly_modes(dict(zip(robot.mechanism.active, q.tolist(), strict=True)))
        assert modes.is_balanced
        counts.add(len(modes))
    assert counts == {0, 2, 4, 6}
    labels = set(robot.kinematics.working_modes(home_pose(robot)).labels)
    assert labels == {"".join(s) for s in itertools.product("+-", repeat=3)}


def test_the_delta_has_two_assembly_and_eight_working_modes() -> None:
    """Spheres about the elbows, shifted by the platform's radius, meet twice; each arm has two elbows."""
    robot = po.robots.delta()
    kinematics, home = robot.kinematics, robot.home_configuration
    modes = kinematics.assembly_modes(home_drives(robot), start=home)
    assert len(modes) == 2
    assert dict(modes.held) == {"alpha": 0.0, "beta": 0.0, "gamma": 0.0}
    R1, R2, L1, L2 = 1.8, 0.3, 2.4, 2.8
    centres = []
    for i, theta in enumerate(home_drives(robot).values()):
        out = np.array((np.cos(2 * np.pi * i / 3), np.sin(2 * np.pi * i / 3), 0.0))
        centres.append((R1 - R2 + L1 * np.cos(theta)) * out - L1 * np.sin(theta) * np.array((0, 0, 1.0)))
    for pose in modes.poses:
        assert_allclose(np.linalg.norm(pose - np.array(centres), axis=1), L2, rtol=1e-10)
    normal = np.cross(centres[1] - centres[0], centres[2] - centres[0])
    assert np.linalg.norm(np.cross(modes.poses[1] - modes.poses[0], normal)) < 1e-9
    working = kinematics.working_modes(home_pose(robot), home)
    assert working.count == 8
    assert set(working.labels) == {"".join(s) for s in itertools.product("+-", repeat=3)}
    for arm, postures in enumerate(working.legs):
        # by geometry: elbows at the distance of the rod from the platform's point, seen in the plane of the arm
        out = np.array((np.cos(2 * np.pi * arm / 3), np.sin(2 * np.pi * arm / 3), 0.0))
        x, y, z = home_pose(robot).values()
        u, v, w = (np.array((x, y, z)) @ d for d in (out, np.cross((0, 0, 1), out), np.array((0, 0, 1.0))))
        angles = postures.values[:, 0]
        gap = (R1 - R2 + L1 * np.cos(angles) - u) ** 2 + v**2 + (L1 * np.sin(angles) + w) ** 2
        assert_allclose(gap, L2**2, rtol=1e-10)


def test_the_hexa_has_64_working_modes() -> None:
    robot = po.robots.hexa()
    modes = robot.kinematics.working_modes(home_pose(robot), robot.home_configuration)
    assert modes.count == 64
    assert len(set(modes.labels)) == 64
    assert max(c.residual for c in modes) < 1e-12


def test_the_raf_has_two_places_and_two_postures_of_each_passive_arm() -> None:
    """Three spheres about the jacks' feet meet twice; each of the two passive arms closes in two ways; jacks in one."""
    robot = po.robots.raf()
    kinematics, home = robot.kinematics, robot.home_configuration
    working = kinematics.working_modes(home_pose(robot), home)
    assert set(working.held) == {"alpha", "beta", "gamma"}
    assert [leg.count for leg in working.legs] == [1, 1, 1, 2, 2]
    modes = kinematics.assembly_modes(home_drives(robot), start=home)
    places = np.unique(np.round(modes.poses, 9), axis=0)
    assert (len(modes), len(places)) == (8, 2)
    # by geometry: the platform does not turn, so each jack is a sphere about its foot, shifted by its end
    feet = 1e-3 * (np.array([(185, -106, 20), (-185, -106, 20), (0, 214, 20)])
                   - np.array([(85, -49, -20), (-85, -49, -20), (0, 98, -20)]))  # fmt: skip
    lengths = np.array(list(home_drives(robot).values())) + 0.298 + 0.092
    for place in places:
        assert_allclose(np.linalg.norm(place - feet, axis=1), lengths, rtol=1e-8)


@pytest.mark.parametrize(("legs", "count"), [(("R_P_R",) * 3, 6), (("_R_RR",) * 3, 6), (("_P_RR",) * 3, 6)])
def test_circles_give_six_complex_solutions(legs: tuple[str, str, str], count: int) -> None:
    """Three circles: a sextic, whatever drives the legs."""
    robot = po.robots.planar_platform(*legs)
    kinematics = po.Kinematics(robot.mechanism, backend="virtual machine")
    home = np.array([robot.home[n] for n in robot.mechanism.names])
    q = dict(zip(robot.mechanism.active, home[:3].tolist(), strict=True))
    assert kinematics.assembly_modes(q, start=home).complex_count == count
