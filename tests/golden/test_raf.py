"""The RAF robot against the numbers of its source: Lahouar, IV.1, as deciphered and recomputed in models.md §2-3."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from support import raf_robot

MM = 1e-3
REFERENCE = {"x": 0.0, "y": 0.0, "z": 480 * MM}


def solve_on_axis(z: float) -> po.Solution:
    robot = raf_robot()
    return robot.kinematics.inverse({"x": 0.0, "y": 0.0, "z": z}, start=robot.home_configuration)


def test_reference_pose() -> None:
    """Printed: platform origin (0, 0, 480) mm, q = (64.807, 64.807, 65.034) mm, L10 = 0.9912, L19 = 0.9694 rad."""
    reference = solve_on_axis(REFERENCE["z"]).configuration
    # half of the last printed digit
    assert_allclose(reference.active / MM, (64.807, 64.807, 65.034), atol=5e-4)
    assert reference["arm A"] == pytest.approx(0.9912, abs=5e-5)
    assert reference["arm B"] == pytest.approx(0.9694, abs=5e-5)
    assert_allclose([reference[n] for n in ("alpha", "beta", "gamma")], 0, atol=1e-9)


def test_reference_strokes_by_hand() -> None:
    """Leg length = 390 mm + q, from the tables of the points: (100, 57, 440) and (0, 116, 440) mm."""
    legs = np.sqrt([100**2 + 57**2 + 440**2, 100**2 + 57**2 + 440**2, 116**2 + 440**2])
    assert_allclose(solve_on_axis(480 * MM).configuration.active / MM, legs - 390, atol=1e-8)


def test_home_of_the_library_is_the_reference_pose() -> None:
    home = raf_robot().home_configuration
    assert_allclose(home.operational, (0, 0, 480 * MM), atol=0)
    assert_allclose(home.X, solve_on_axis(480 * MM).X, atol=1e-11)


def test_counts_and_ranks() -> None:
    """Printed: 22 links, N = 32, 33 equations, rg E = 26, m = 6; rg M = 3, rg N = 23, rg K = 3, rg [N K] = 26."""
    robot = raf_robot()
    mechanism = robot.mechanism
    assert len(mechanism.links) == 22
    assert (mechanism.active, mechanism.operational) == (("q1", "q2", "q3"), ("x", "y", "z"))
    report = po.report_state(robot.kinematics, robot.home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility) == (32, 33, 6)
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]")] == [26, 3, 23, 3, 26]
    # the six freedoms are three translations and three leg spins
    assert report.idle == ("jack 1.z", "jack 2.z", "jack 3.z")
    # II.23, II.26: three independent coordinates, held when the actuators are
    assert report.ranks["[N K]"].value == report.ranks["N"].value + report.ranks["K"].value


def test_jacks_are_in_at_412_mm() -> None:
    """On the axis q = 0 at z = 412 mm: the first two jacks and the third a quarter of a millimetre apart."""
    robot = raf_robot()
    for jack in ("q1", "q3"):
        solution = robot.kinematics.solve({"x": 0.0, "y": 0.0, jack: 0.0}, start=robot.home_configuration)
        assert solution.configuration["z"] / MM == pytest.approx(412, abs=1)
    # by hand: 390 mm over 115.1 mm, and over 116 mm, and 40 mm for the points' own heights
    for jack, across in (("q1", np.hypot(100, 57)), ("q3", 116.0)):
        solution = robot.kinematics.solve({"x": 0.0, "y": 0.0, jack: 0.0}, start=robot.home_configuration)
        assert solution.configuration["z"] / MM == pytest.approx(np.sqrt(390**2 - across**2) + 40, abs=1e-8)


def test_passive_chains_stop_at_676_mm() -> None:
    low, high = 600 * MM, 750 * MM
    assert solve_on_axis(low).status is po.Status.CONVERGED
    assert solve_on_axis(high).status is po.Status.NEAREST
    while high - low > 0.1 * MM:
        middle = 0.5 * (low + high)
        if solve_on_axis(middle).status is po.Status.CONVERGED:
            low = middle
        else:
            high = middle
    assert low / MM == pytest.approx(676, abs=1)


def test_strokes_of_200_mm_end_before_the_chains_do() -> None:
    """Strokes are not printed; with q in [0, 200] mm the jacks reach z = 618.6 mm, short of the chains."""
    robot = raf_robot()
    out = robot.kinematics.forward(dict.fromkeys(("q1", "q2", "q3"), 0.2), start=robot.home_configuration)
    assert 0.6 < out.configuration["z"] < 0.63
    low, high = robot.limits.bounds(robot.mechanism)
    assert_allclose(low[:3], 0, atol=0)
    assert_allclose(high[:3], 0.2, atol=0)


def test_lengths_of_the_passive_chains_are_kept() -> None:
    """Arm 279.9 mm from its axis to the elbows' line, forearm 331 mm: distances of placed points, at another pose."""
    robot = raf_robot()
    names = [link.name for link in robot.mechanism.links]
    pose = robot.kinematics.inverse({"x": 0.03, "y": -0.02, "z": 0.52}, robot.home_configuration).configuration
    origin = {n: X[:3, 3] / MM for n, X in zip(names, robot.kinematics.poses(pose.X)[0], strict=True)}
    for arm in "AB":
        for side in "+-":
            key = arm + side
            elbow = np.linalg.norm(origin[f"cross {key}"] - origin[f"arm {arm}"])
            assert elbow == pytest.approx(np.sqrt(30**2 + 52**2 + 275**2), abs=1e-9)
            assert np.linalg.norm(origin[f"fork {key}"] - origin[f"forearm {key}"]) == pytest.approx(331, abs=1e-9)
        # the two elbows of an arm are 60 mm apart, and so are the two forks: a parallelogram
        for part in ("cross", "fork"):
            assert np.linalg.norm(origin[f"{part} {arm}+"] - origin[f"{part} {arm}-"]) == pytest.approx(60, abs=1e-8)
