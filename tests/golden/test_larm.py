"""LARM's cable robot: Lahouar, I.2 and IV.2; the bounds IV.4-IV.6 in the checked form of models.md §5."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.robots.larm import CABLES
from paraopt.scene.reach import walk_configurations
from paraopt.view.motion import list_cable_ends

SIDE, HALF_WIDTH = 1.0, 0.1
EXITS = np.array([(0, 0), (0, SIDE), (SIDE, 0), (SIDE, SIDE)])
ENDS = np.array([-HALF_WIDTH, -HALF_WIDTH, HALF_WIDTH, HALF_WIDTH])


@functools.cache
def planar() -> po.Robot:
    return po.robots.larm_planar()


@functools.cache
def spatial() -> po.Robot:
    return po.robots.larm_spatial()


def at(robot: po.Robot, *pose: float) -> po.Configuration:
    impose = dict(zip(robot.mechanism.operational, pose, strict=True))
    return robot.kinematics.inverse(impose, robot.home_configuration).configuration


def test_fully_constrained_in_the_plane() -> None:
    """I.2: at least one cable more than motions, m >= n + 1."""
    report = po.report_state(planar().kinematics, planar().home_configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (11, 8, 8, 3)
    assert len(planar().mechanism.active) == report.mobility + 1
    assert report.ranks["K"].value == 3
    assert report.parallel_margin > 0.1


def test_under_constrained_in_space() -> None:
    """Four cables and six motions: one that no cable feels, and at each pose another that leaves all lengths alone."""
    report = po.report_state(spatial().kinematics, spatial().home_configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (18, 12, 12, 6)
    assert report.idle == ("alpha",)
    assert report.ranks["K"].value == len(spatial().mechanism.operational) == 5  # II.23
    assert report.parallel_margin == 0
    assert report.ranks["[N K]"].value < report.ranks["N"].value + report.ranks["K"].value  # II.26 fails


@pytest.mark.parametrize("seed", range(3))
def test_lengths_of_the_cables_in_the_plane(seed: int) -> None:
    x, y, theta = np.random.default_rng(seed).uniform((0.3, 0.3, -0.3), (0.7, 0.7, 0.3))
    ends = np.column_stack([x + ENDS * np.cos(theta), y + ENDS * np.sin(theta)])
    assert_allclose(at(planar(), x, y, theta).active, np.linalg.norm(ends - EXITS, axis=1), atol=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_lengths_of_the_cables_in_space(seed: int) -> None:
    """The attachment line points along Rz(gamma) Ry(beta) e_x; the roll about it changes no length."""
    random = np.random.default_rng(seed)
    x, y, z, gamma, beta = random.uniform((0.3, 0.3, -0.7, -0.3, -0.3), (0.7, 0.7, -0.3, 0.3, 0.3))
    line = np.array([np.cos(gamma) * np.cos(beta), np.sin(gamma) * np.cos(beta), -np.sin(beta)])
    ends = np.array([x, y, z]) + ENDS[:, None] * line
    exits = np.column_stack([EXITS, np.zeros(4)])
    level = at(spatial(), x, y, z, gamma, beta)
    assert_allclose(level.active, np.linalg.norm(ends - exits, axis=1), atol=1e-11)
    rolled = spatial().kinematics.solve({**dict(zip(CABLES, level.active, strict=True)), "alpha": 0.7}, level)
    assert_allclose(rolled.configuration.active, level.active, atol=1e-12)


@pytest.mark.parametrize("build", [planar, spatial])
def test_the_cables_are_as_long_as_their_variables(build: Callable[[], po.Robot]) -> None:
    robot = build()
    X = walk_configurations(robot, 200, seed=1)
    ends = list_cable_ends(po.Scene(robot), X)
    assert [c.name for c in robot.cables] == [f"cable {q}" for q in CABLES]
    assert_allclose(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2), X[:, :4], atol=1e-9)
    assert_allclose(ends[:, :, 0], np.tile(np.column_stack([EXITS, np.zeros(4)]), (200, 1, 1)), atol=1e-12)


def test_exits_and_bar_do_not_count_but_the_load_and_the_other_cables_do() -> None:
    scene = po.Scene(spatial())
    rows = {p.name: "checked" for p in scene.pairs} | {s.name: s.reason for s in scene.skipped_pairs}
    for q in CABLES:
        assert rows[f"platform bar / cable {q}"] == "the cable ends on 'platform bar'"
        assert rows[f"platform / cable {q}"] == "checked"
        for exit_ in CABLES:
            held = "lies within the length that is ignored" in rows[f"exit {exit_} / cable {q}"]
            assert held is (exit_ == q), (exit_, q)
    assert rows["cable q1 / cable q2"] == rows["cable q3 / cable q4"] == "both end at one place of 'platform'"
    assert rows["cable q1 / cable q3"] == rows["cable q2 / cable q4"] == "checked"
    assert scene.clearance(spatial().home_configuration).distance > 0.04


def test_tensions_balance_where_the_source_bounds_the_rotation() -> None:
    """IV.4: positive tensions hold the platform in the plane exactly between -psi1 and psi2.

    It shows that the cables are led to the right exits: the tensions that balance each other are the left null
    vector of the lengths' Jacobian, and pull only if all have one sign.
    """
    random = np.random.default_rng(0)
    bounded = []
    for x, y, theta in random.uniform((HALF_WIDTH, 0.02, -1.2), (SIDE - HALF_WIDTH, SIDE - 0.02, 1.2), size=(40, 3)):
        psi1 = min(np.arctan((SIDE - y) / x), np.arctan(y / (SIDE - x)))
        psi2 = min(np.arctan(y / x), np.arctan((SIDE - y) / (SIDE - x)))
        bounded.append(bool(-psi1 < theta < psi2))
        here = at(planar(), x, y, theta)
        T = planar().kinematics.tangent(here.X, ("x", "y", "theta"))[0, :4]
        tensions = np.linalg.svd(T.T)[2][-1]
        assert bool(np.all(tensions > 0) or np.all(tensions < 0)) is bounded[-1], (x, y, theta)
    assert 5 < sum(bounded) < 35  # both sides of the bound have been seen
