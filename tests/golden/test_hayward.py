"""Hayward's wrist: Lahouar, I.2 (four prismatic actuators turn a plate on a ball joint); lengths by hand."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.spatial import rotation_xyz

ANGLES = ("alpha", "beta", "gamma")


@functools.cache
def wrist() -> po.Robot:
    return po.robots.hayward_wrist()


def test_one_actuator_more_than_motions() -> None:
    report = po.report_state(wrist().kinematics, wrist().home_configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (15, 12, 12, 3)
    assert len(wrist().mechanism.active) == 4
    # blocked actuators hold the plate, with one equation to spare
    assert report.ranks["[N K]"].value == report.ranks["N"].value + report.ranks["K"].value == 11


@pytest.mark.parametrize("seed", range(4))
def test_lengths_of_the_actuators(seed: int) -> None:
    """`|C + R b - a|` with the feet a at 0.1 m, turned by 0.6 rad to either side, and the ends b at 0.08 m."""
    angles = np.random.default_rng(seed).uniform(-0.5, 0.5, size=3)
    solution = wrist().kinematics.inverse(dict(zip(ANGLES, angles, strict=True)), wrist().home_configuration)
    R = np.asarray(rotation_xyz(*angles))
    quarter = np.arange(4) * np.pi / 2
    turned = quarter + np.array([0.6, -0.6, 0.6, -0.6])
    feet = 0.1 * np.array([np.cos(turned), np.sin(turned), 0 * turned])
    ends = 0.08 * np.array([np.cos(quarter), np.sin(quarter), 0 * quarter])
    lengths = np.linalg.norm(np.array([[0], [0], [0.2]]) + R @ ends - feet, axis=0)
    assert_allclose(solution.configuration.active, lengths, atol=1e-11)


def test_four_equal_forces_press_the_ball_and_turn_nothing() -> None:
    """At home the forces that do no work on any turn of the plate are equal in all four actuators."""
    home = wrist().home_configuration
    T = wrist().kinematics.tangent(home.X, ANGLES)[0, :4]  # lengths per turn, the first four variables
    assert np.linalg.matrix_rank(T) == 3
    assert_allclose(T.T @ np.ones(4), 0, atol=1e-11)


def test_without_twist_nothing_holds_the_turn_about_the_vertical() -> None:
    plain = po.robots.hayward_wrist(twist=0.0)
    report = po.report_state(plain.kinematics, plain.home_configuration)
    assert report.parallel_margin == pytest.approx(0, abs=1e-9)
    assert po.report_state(wrist().kinematics, wrist().home_configuration).parallel_margin > 0.1
