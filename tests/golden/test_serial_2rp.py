"""The serial 2RP against the Jacobian of its source, Lahouar, I.18, as far as it can be read."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from solutions import all_solutions, uncompiled

L1 = 0.5


@pytest.mark.parametrize("q", [(0.4, 0.7, 0.4), (-1.0, 2.0, 0.35), (2.0, -0.4, 0.45)])
def test_jacobian(q: tuple[float, float, float]) -> None:
    """I.18, I.19: the columns are the velocities (x, y, theta) for a unit speed of each joint."""
    kinematics = uncompiled(po.robots.serial_2rp(L1))
    found = all_solutions(kinematics, dict(zip(("q1", "q2", "q3"), q, strict=True)), starts=40, span=1.0)
    assert len(found) == 1
    q1, q12, q3 = q[0], q[0] + q[1], q[2]
    s1, c1, s12, c12 = math.sin(q1), math.cos(q1), math.sin(q12), math.cos(q12)
    J = [[-L1 * s1 - q3 * s12, -q3 * s12, c12], [L1 * c1 + q3 * c12, q3 * c12, s12], [1, 1, 0]]
    T = kinematics.tangent(found, ("q1", "q2", "q3"))[0, -3:]
    assert_allclose(T, J, rtol=0, atol=1e-9)
    assert np.linalg.det(J) == pytest.approx(L1 * math.cos(q[1]), rel=1e-12)  # by hand


def test_two_places_of_the_second_hinge() -> None:
    """The tool's line meets the circle of radius l1 twice: q3^2 - 2 q3 p.u + p^2 - l1^2 = 0; one q3 is too long."""
    robot = po.robots.serial_2rp(L1)
    pose = {n: robot.home[n] for n in ("x", "y", "theta")}
    found = all_solutions(uncompiled(robot), pose, starts=100, span=1.0)
    assert len(found) == robot.facts["working modes"] == 2
    assert_allclose(np.prod(found[:, 2]), pose["x"] ** 2 + pose["y"] ** 2 - L1**2, rtol=1e-9)
    low, high = robot.mechanism.variables[2].range
    assert sum((low <= found[:, 2]) & (found[:, 2] <= high)) == 1


@pytest.mark.parametrize("q2", [math.pi / 2, -math.pi / 2])
def test_singular_where_the_second_angle_is_right(q2: float) -> None:
    kinematics = uncompiled(po.robots.serial_2rp(L1))
    report = po.report_state(kinematics, kinematics.forward({"q1": 0.2, "q2": q2, "q3": 0.4}).configuration)
    assert report.ranks["M"].value == 2
    assert report.serial_margin < 1e-12
