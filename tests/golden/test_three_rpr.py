"""The 3-RPR against its sources: Lahouar, II.59 and III.3 (models.md §2, §4); Chablat1998, tables 2 and 3 (§10)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants
from solutions import all_solutions, home_of, uncompiled

Array = np.ndarray
PLAIN = ((0.0, 0.0), (75.0, 0.0), (37.5, 64.952))
START, GOAL_T0, GOAL_T1 = (20.0, 0.0, 0.3), (60.0, -50.0, 0.6), (-60.0, 50.0, 0.6)
# Chablat1998, table 3: x, y, phi of the six solutions for the legs 15.0, 15.4, 12.0
TABLE_3 = (
    (-8.715, 12.183, -0.987), (-5.495, -13.935, -0.047), (-14.894, 1.596, 0.244),
    (-13.417, -6.660, 0.585), (14.920, -1.337, 1.001), (14.673, -3.013, 2.133),
)  # fmt: skip
LEGS = {"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}


def anchors(robot: po.Robot) -> tuple[Array, Array]:
    A = [link.at[:2] for link in robot.mechanism.links if isinstance(link, po.Series) and link.father == "base"]
    b = [c.point_B[:2] for c in robot.mechanism.closures if isinstance(c, po.Coincidence)]
    return np.array(A), np.array(b)


def legs_by_hand(A: Array, b: Array, pose: Array) -> tuple[Array, Array]:
    """Vectors of the legs, and the arms of the platform's points, both in the base."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    arms = b @ np.array([[c, s], [-s, c]])
    return pose[:2] + arms - A, arms


def determinant_by_hand(A: Array, b: Array, pose: Array) -> float:
    """Determinant of the rows (n_x, n_y, (R b) x n), in length units: models.md §4."""
    legs, arms = legs_by_hand(A, b, pose)
    n = legs / np.linalg.norm(legs, axis=1, keepdims=True)
    return float(np.linalg.det(np.column_stack([n, arms[:, 0] * n[:, 1] - arms[:, 1] * n[:, 0]])))


def along(start: tuple[float, ...], goal: tuple[float, ...], t: Array) -> Array:
    return np.asarray(start) + t[:, None] * (np.asarray(goal) - start)


def crossings(t: Array, values: Array) -> Array:
    k = np.flatnonzero(np.diff(np.sign(values)))
    return t[k] + (t[k + 1] - t[k]) * values[k] / (values[k] - values[k + 1])


def test_counts() -> None:
    """Printed: N = 9, 6 equations, m = 3 (Lahouar, II.3.3)."""
    for robot in (po.robots.three_rpr(), po.robots.three_rpr_innocenti()):
        kinematics = uncompiled(robot)
        report = po.report_state(kinematics, kinematics.configuration(home_of(robot)))
        assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (9, 6, 6, 3)


def test_dimensions_of_the_planning_example() -> None:
    """Printed: l = 15, L = 75, strokes from 10 to 200; start (20, 0, 0.3)."""
    robot = po.robots.three_rpr()
    A, b = anchors(robot)
    for points, side in ((A, 75.0), (b, 15.0)):
        # coordinates are rounded to 1e-3 in the text
        assert_allclose(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1), side, rtol=0, atol=1e-3)
    assert {robot.mechanism.variables[i].range for i in range(3)} == {(10.0, 200.0)}
    assert_allclose([robot.home[n] for n in ("x", "y", "theta")], START, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("base", "goal", "expected"),
    [
        pytest.param(PLAIN, GOAL_T0, (0.4145,), id="T0"),
        pytest.param(None, GOAL_T1, (0.182, 0.694), id="T1"),
    ],
)
def test_straight_lines_cross_the_parallel_singularity(
    base: tuple | None, goal: tuple[float, float, float], expected: tuple[float, ...]
) -> None:
    """models.md §4: T0 crosses once, so no path exists in its aspects; T1 twice, and start and goal share a sign."""
    shape = {} if base is None else {"base": base}
    robot = po.robots.three_rpr(**shape)
    kinematics = uncompiled(robot)
    t = np.linspace(0.0, 1.0, 801)
    poses = along(START, goal, t)
    X = np.array([home_of(po.robots.three_rpr(pose=tuple(p), **shape)) for p in poses.tolist()])
    assert np.max(kinematics.scaled_residual(X)) < 1e-13
    determinants, _ = Determinants.at(kinematics, kinematics.configuration(X[0]))(X)
    A, b = anchors(robot)
    by_hand = np.array([determinant_by_hand(A, b, p) for p in poses])
    # half of the last of three digits
    assert_allclose(crossings(t, determinants), expected, rtol=0, atol=5e-4)
    assert_allclose(crossings(t, determinants), crossings(t, by_hand), rtol=0, atol=1e-5)
    assert abs(np.sum(np.sign(determinants) * np.sign(by_hand))) == len(t)
    assert bool(determinants[0] * determinants[-1] > 0) is (len(expected) == 2)


def test_dimensions_of_the_six_solutions() -> None:
    """Chablat1998, table 2: A2 = (15.9, 0), A3 = (0, 10), l1 = B2B3 = 16.5, l2 = B1B2 = 17.0, l3 = B3B1 = 20.8."""
    robot = po.robots.three_rpr_innocenti()
    A, b = anchors(robot)
    assert_allclose(A, [(0, 0), (15.9, 0), (0, 10)], rtol=0, atol=0)
    sides = [np.linalg.norm(b[i] - b[j]) for i, j in ((1, 2), (0, 1), (2, 0))]
    assert_allclose(sides, (16.5, 17.0, 20.8), rtol=0, atol=1e-12)
    assert {robot.mechanism.variables[i].range for i in range(3)} == {(10.0, 32.0)}


def test_the_six_printed_solutions_close_the_loops() -> None:
    """Table 3 fits inputs that were rounded in print: 0.15 is the stated tolerance (models.md §10)."""
    A, b = anchors(po.robots.three_rpr_innocenti())
    for pose in TABLE_3:
        legs, _ = legs_by_hand(A, b, np.array(pose))
        assert_allclose(np.linalg.norm(legs, axis=1), tuple(LEGS.values()), rtol=0, atol=0.15)


def test_six_assembly_modes_three_in_each_aspect() -> None:
    """There are six solutions and no more; they are those of table 3; {2, 3, 6} and {1, 4, 5} differ in sign."""
    kinematics = uncompiled(po.robots.three_rpr_innocenti())
    found = all_solutions(kinematics, LEGS, starts=1500, span=25.0)
    assert len(found) == 6
    order = [int(np.argmin(np.max(np.abs(found[:, -3:] - pose), axis=1))) for pose in TABLE_3]
    assert sorted(order) == list(range(6))
    assert_allclose(found[order, -3:], TABLE_3, rtol=0, atol=0.15)
    determinants, _ = Determinants.at(kinematics, kinematics.configuration(found[order[0]]))(found[order])
    signs = np.sign(determinants)
    assert set(signs[[1, 2, 5]]) == {-signs[0]}
    assert set(signs[[0, 3, 4]]) == {signs[0]}
