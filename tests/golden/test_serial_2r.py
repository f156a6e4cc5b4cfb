"""The serial 2R against its source: Lahouar, I.3 to I.5 (direct model, two elbows, ring of reach)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from solutions import all_solutions, uncompiled

L1, L2 = 0.5, 0.4


@pytest.mark.parametrize("q", [(0.3, 0.9), (-2.0, 1.4), (1.0, -2.5)])
def test_direct_model(q: tuple[float, float]) -> None:
    """I.3, I.4: x = l1 cos q1 + l2 cos(q1 + q2), y alike, unique."""
    found = all_solutions(uncompiled(po.robots.serial_2r((L1, L2))), {"q1": q[0], "q2": q[1]}, starts=30, span=1.0)
    assert len(found) == 1
    x = L1 * math.cos(q[0]) + L2 * math.cos(q[0] + q[1])
    y = L1 * math.sin(q[0]) + L2 * math.sin(q[0] + q[1])
    assert_allclose(found[0, -2:], (x, y), rtol=0, atol=1e-12)


def test_elbow_up_and_elbow_down() -> None:
    """Two solutions of the inverse model inside the ring, of opposite elbows and opposite serial determinants."""
    kinematics = uncompiled(po.robots.serial_2r((L1, L2)))
    found = all_solutions(kinematics, {"x": 0.5, "y": 0.3}, starts=60, span=1.0)
    assert len(found) == 2
    assert_allclose(found[0, 1], -found[1, 1], rtol=0, atol=1e-9)
    reports = [po.report_state(kinematics, kinematics.configuration(X)) for X in found]
    assert reports[0].serial_determinant * reports[1].serial_determinant < 0


@pytest.mark.parametrize(("distance", "reached"), [(0.099, False), (0.101, True), (0.899, True), (0.901, False)])
def test_the_ring_of_reach(distance: float, reached: bool) -> None:
    """I.5: |l1 - l2| <= r <= l1 + l2."""
    target = {"x": distance * math.cos(0.7), "y": distance * math.sin(0.7)}
    found = all_solutions(uncompiled(po.robots.serial_2r((L1, L2))), target, starts=60, span=1.0)
    assert (len(found) > 0) is reached


def test_only_serial_singularities_and_where() -> None:
    """There are no passive joints: [N K] = K is regular everywhere, [M N] = M has determinant l1 l2 sin q2."""
    kinematics = uncompiled(po.robots.serial_2r((L1, L2)))
    for q2 in (0.0, math.pi):
        stretched = kinematics.forward({"q1": 0.4, "q2": q2}).configuration
        report = po.report_state(kinematics, stretched)
        assert report.ranks["M"].value == 1
        assert report.serial_margin < 1e-12
        assert report.parallel_margin > 0.1
    bent = kinematics.forward({"q1": 0.4, "q2": 1.1}).configuration
    M = kinematics.jacobians(bent.X).M
    assert abs(np.linalg.det(M)) == pytest.approx(L1 * L2 * math.sin(1.1), rel=1e-12)
