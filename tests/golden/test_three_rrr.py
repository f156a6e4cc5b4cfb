"""The 3-RRR against its source: Chablat1998, 3.4.6, tables 7 and 9; models.md §10."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants
from solutions import all_solutions, home_of, uncompiled

# Chablat1998, table 9, and its last point as recomputed in models.md §10
TABLE_9 = ((-15.468, 0.781, 0.073), (-15.468, -7.091, 0.500), (-9.902, -7.091, 1.081))
LAST = (-9.9035, -7.0799, 1.0801)
MODE = (-1, -1, -1)
DRIVES = ("alpha1", "alpha2", "alpha3")


def test_dimensions_are_as_printed() -> None:
    """Table 7: A, C, and L = M = 10."""
    mechanism = po.robots.three_rrr().mechanism
    at = {link.name: link.at[:2] for link in mechanism.links if isinstance(link, po.Series)}
    assert [at[f"proximal {i}"] for i in (1, 2, 3)] == [(-10, -10), (10, -10), (0, 10)]
    assert {at[f"distal {i}"] for i in (1, 2, 3)} == {(10, 0)}
    ends = [c for c in mechanism.closures if isinstance(c, po.Coincidence)]
    assert {c.point_A[:2] for c in ends} == {(10, 0)}
    assert [c.point_B[:2] for c in ends] == [(0, 0), (10, 0), (10, 10)]


def test_counts_and_ranks() -> None:
    """Cut at the platform's hinges: 9 variables, 6 equations, all independent."""
    robot = po.robots.three_rrr()
    kinematics = uncompiled(robot)
    report = po.report_state(kinematics, kinematics.configuration(home_of(robot)))
    assert (report.n_variables, report.n_equations, report.mobility) == (9, 6, 3)
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]")] == [6, 3, 3, 3, 6]


def test_inverse_model_by_the_source() -> None:
    """Chablat1998, 19: the elbow of each leg is at the distance M from the platform's point."""
    pose = (-6.0, -4.0, 0.3)
    home = po.robots.three_rrr(pose=pose).home
    R = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    for A, C, name in zip(((-10, -10), (10, -10), (0, 10)), ((0, 0), (10, 0), (10, 10)), DRIVES, strict=True):
        elbow = A + 10 * np.array([np.cos(home[name]), np.sin(home[name])])
        assert np.linalg.norm(pose[:2] + R @ C - elbow) == pytest.approx(10, abs=1e-12)


def test_eight_working_modes() -> None:
    robot = po.robots.three_rrr()
    found = all_solutions(uncompiled(robot), {n: robot.home[n] for n in ("x", "y", "theta")}, starts=400, span=20.0)
    assert len(found) == robot.facts["working modes"] == 8
    elbows = np.sign(found[:, [robot.mechanism.index(f"beta{i}") for i in (1, 2, 3)]])
    assert len({tuple(row) for row in elbows.tolist()}) == 8


def test_six_assembly_modes_at_the_joints_of_table_9() -> None:
    """Printed: at most six. At the drives of table 9 all six are there, and both ends of its path are among them."""
    robot = po.robots.three_rrr(pose=TABLE_9[0], elbows=MODE)
    found = all_solutions(uncompiled(robot), {n: robot.home[n] for n in DRIVES}, starts=2500, span=25.0)
    assert len(found) == robot.facts["assembly modes"] == 6
    for pose in (TABLE_9[0], LAST):
        assert np.min(np.max(np.abs(found[:, -3:] - pose), axis=1)) < 1e-3


def test_the_path_of_table_9_returns_to_its_joints_without_a_singularity() -> None:
    """Straight between three points, in one working mode: determinants keep their signs, drives end as they began."""
    first, last = (po.robots.three_rrr(pose=p, elbows=MODE) for p in (TABLE_9[0], LAST))
    # the points are printed to 1e-3, the last one recomputed to 1e-4
    assert_allclose([first.home[n] for n in DRIVES], [last.home[n] for n in DRIVES], rtol=0, atol=2e-4)
    printed = po.robots.three_rrr(pose=TABLE_9[2], elbows=MODE)
    assert_allclose([first.home[n] for n in DRIVES], [printed.home[n] for n in DRIVES], rtol=0, atol=2e-3)
    t = np.linspace(0, 1, 150)[:, None]
    corners = np.array([*TABLE_9[:2], LAST])
    poses = np.vstack([a + t * (b - a) for a, b in pairwise(corners)])
    X = np.array([home_of(po.robots.three_rrr(pose=tuple(p), elbows=MODE)) for p in poses.tolist()])
    kinematics = uncompiled(first)
    assert np.max(kinematics.scaled_residual(X)) < 1e-13
    determinants = Determinants.at(kinematics, kinematics.configuration(X[0]))
    for values in determinants(X):
        assert abs(np.sum(np.sign(values))) == len(X)
        assert np.min(np.abs(values)) > 0.01
    # in another working mode the same poses do not return to the same drives
    other = [po.robots.three_rrr(pose=p, elbows=(1, 1, 1)) for p in (TABLE_9[0], LAST)]
    assert abs(other[0].home["alpha1"] - other[1].home["alpha1"]) > 0.5


def test_a_pose_out_of_reach_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="leg 2 of the 3-RRR must span"):
        po.robots.three_rrr(pose=(-18.0, -5.0, 0.3))
