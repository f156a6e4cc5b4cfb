"""The Lynx against its source: Lahouar, annex A, as deciphered and recomputed in models.md §2."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po

MM = 1e-3


@functools.cache
def lynx() -> po.Robot:
    return po.robots.lynx()


def tool_at(q: np.ndarray) -> po.Configuration:
    """Solve for the tool at given joints, from the home's branch of the angles."""
    kinematics = lynx().kinematics
    return kinematics.forward(
        dict(zip(lynx().mechanism.active, q, strict=True)), lynx().home_configuration
    ).configuration


def test_axes_and_points_are_as_printed() -> None:
    """Table A.1, triples read in the order of the text; the tool is welded at (135, 0, 0) of the last link."""
    series = [link for link in lynx().mechanism.links if isinstance(link, po.Series)]
    assert [link.motions[0].axis for link in series] == ["z", "y", "y", "y", "x"]
    points = [(0, 0, 60), (0, 0, 13), (0, 0, 121), (116, 0, 0), (55, 0, 0)]
    assert_allclose([link.at for link in series], np.multiply(points, MM), atol=1e-15)
    (weld,) = lynx().mechanism.closures
    assert isinstance(weld, po.Weld)
    assert_allclose(weld.at, (0.135, 0, 0), atol=1e-15)


def test_counts_and_ranks() -> None:
    """Printed: N = 11 and 12 equations, of which 6 are needed; five joints, m = 5."""
    report = po.report_state(lynx().kinematics, lynx().home_configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (11, 12, 6, 5)
    assert report.ranks["K"].value == len(lynx().mechanism.operational)  # II.23


@pytest.mark.parametrize("seed", range(4))
def test_position_of_the_tool(seed: int) -> None:
    """A.4, A.8 and A.12: the arm's plane turns about z; 190 = 55 + 135 and 73 = 60 + 13 mm."""
    q = np.random.default_rng(seed).uniform(-0.8, 0.8, size=5)
    bend = np.cumsum(q[1:4])
    reach = 121 * np.sin(bend[0]) + 116 * np.cos(bend[1]) + 190 * np.cos(bend[2])
    height = 73 + 121 * np.cos(bend[0]) - 116 * np.sin(bend[1]) - 190 * np.sin(bend[2])
    expected = np.multiply((reach * np.cos(q[0]), reach * np.sin(q[0]), height), MM)
    tool = tool_at(q)
    assert_allclose([tool[n] for n in "xyz"], expected, atol=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_third_angle_follows_from_the_five_operational_variables(seed: int) -> None:
    """`x cos(alpha) sin(gamma) = (y cos(beta) - x sin(alpha) sin(beta)) cos(gamma)`: it stays in the arm's plane."""
    tool = tool_at(np.random.default_rng(10 + seed).uniform(-0.8, 0.8, size=5))
    x, y, alpha, beta, gamma = (tool[n] for n in ("x", "y", "alpha", "beta", "gamma"))
    side = y * np.cos(beta) - x * np.sin(alpha) * np.sin(beta)
    assert x * np.cos(alpha) * np.sin(gamma) == pytest.approx(side * np.cos(gamma), abs=1e-11)


def test_six_operational_variables_are_one_too_many() -> None:
    """With gamma among them II.23 holds, but the choice is not minimal: six variables, five motions."""
    mechanism = replace(lynx().mechanism, operational=("x", "y", "z", "alpha", "beta", "gamma"))
    kinematics = po.Kinematics(mechanism)
    X = [lynx().home_configuration[n] for n in mechanism.names]
    report = po.report_state(kinematics, kinematics.configuration(X))
    assert report.ranks["K"].value == 6 > report.mobility == 5
    assert report.ranks["[M N]"].value == 5 < report.ranks["E"].value


@pytest.mark.parametrize(("left_out", "regular"), [("gamma", True), ("alpha", False), ("beta", False)])
def test_choice_of_the_angle_that_is_left_out(left_out: str, regular: bool) -> None:
    """Straight ahead and level, where beta = 0, only gamma may be left out of the angles."""
    names = [n for n in ("x", "y", "z", "alpha", "beta", "gamma") if n != left_out]
    kinematics = po.Kinematics(replace(lynx().mechanism, operational=names))
    level = tool_at(np.array([0.0, -0.4, 0.9, -0.5, 0.0]))
    assert level["beta"] == pytest.approx(0, abs=1e-12)
    X = [level[n] for n in kinematics.mechanism.names]
    report = po.report_state(kinematics, kinematics.configuration(X))
    assert (report.serial_margin > 0.05) is regular
