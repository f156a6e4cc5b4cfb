"""The 2-RPR against its sources: Lahouar, II.34 to II.43; Chablat1998, 5 and 6; models.md §2 and §10."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants
from solutions import all_solutions, home_of, uncompiled

L = 10.0


def test_counts() -> None:
    """Printed: N = 6, 4 equations, m = 2; q = (rho1, rho2), x = (x, y)."""
    robot = po.robots.two_rpr()
    kinematics = uncompiled(robot)
    report = po.report_state(kinematics, kinematics.configuration(home_of(robot)))
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (6, 4, 4, 2)
    assert (robot.mechanism.active, robot.mechanism.operational) == (("rho1", "rho2"), ("x", "y"))


@pytest.mark.parametrize("point", [(3.0, 4.0), (8.0, -2.0), (-1.0, 6.0)])
def test_inverse_model(point: tuple[float, float]) -> None:
    """Chablat1998, 5: rho1^2 = x^2 + y^2, rho2^2 = (x - L)^2 + y^2; one solution of positive lengths."""
    x, y = point
    found = all_solutions(uncompiled(po.robots.two_rpr(L)), {"x": x, "y": y}, starts=100, span=12.0)
    assert len(found) == 4  # either leg may be turned by half a turn with the opposite length
    positive = found[np.all(found[:, :2] > 0, axis=1)]
    assert_allclose(positive[:, :2], [[math.hypot(x, y), math.hypot(x - L, y)]], rtol=0, atol=1e-9)


def test_two_assembly_modes_mirror_each_other() -> None:
    kinematics = uncompiled(po.robots.two_rpr(L))
    found = all_solutions(kinematics, {"rho1": 7.0, "rho2": 6.0}, starts=100, span=12.0)
    assert len(found) == 2
    assert_allclose(found[0, -2:], found[1, -2:] * (1, -1), rtol=0, atol=1e-9)
    x = (7.0**2 - 6.0**2 + L**2) / (2 * L)
    assert_allclose(found[:, -2], x, rtol=0, atol=1e-9)
    parallel, _ = Determinants.at(kinematics, kinematics.configuration(found[0]))(found)
    assert parallel[0] * parallel[1] < 0  # two aspects: y > 0 and y < 0


def test_the_equations_are_those_of_the_source() -> None:
    """II.34 and its derivatives: x - rho cos(phi) - a = 0, y - rho sin(phi) = 0 for each leg, up to sign."""
    robot = po.robots.two_rpr(L)
    kinematics = uncompiled(robot)
    values = {"rho1": 3.0, "rho2": 5.0, "phi1": 0.7, "phi2": 2.0, "x": 1.0, "y": 2.0}
    X = np.array([values[n] for n in robot.mechanism.names])
    M, N, K = kinematics.jacobians(X)
    c1, s1, c2, s2 = math.cos(0.7), math.sin(0.7), math.cos(2.0), math.sin(2.0)
    F = [3 * c1 - 1, 3 * s1 - 2, L + 5 * c2 - 1, 5 * s2 - 2]
    assert_allclose(kinematics.residual(X), F, rtol=0, atol=1e-12)
    assert_allclose(M, [[c1, 0], [s1, 0], [0, c2], [0, s2]], rtol=0, atol=1e-12)
    assert_allclose(N, [[-3 * s1, 0], [3 * c1, 0], [0, -5 * s2], [0, 5 * c2]], rtol=0, atol=1e-12)
    assert_allclose(K, [[-1, 0], [0, -1], [-1, 0], [0, -1]], rtol=0, atol=1e-12)


def test_legs_along_one_line_are_a_parallel_singularity() -> None:
    """Chablat1998, 6: det A = 4 y L up to sign, so the line of the base is singular and nothing else."""
    robot = po.robots.two_rpr(L)
    kinematics = uncompiled(robot)
    flat = {"rho1": 4.0, "rho2": 6.0, "phi1": 0.0, "phi2": math.pi, "x": 4.0, "y": 0.0}
    X = np.array([flat[n] for n in robot.mechanism.names])
    report = po.report_state(kinematics, kinematics.configuration(X))
    assert report.ranks["[N K]"].value == 3
    assert report.parallel_margin < 1e-12
    assert report.serial_margin > 0.1
