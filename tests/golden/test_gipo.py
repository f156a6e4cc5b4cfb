"""GIPO against its source: Lahouar, IV.3, as deciphered and recomputed in models.md §6."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po

MM = 1e-3
LEGS = ("right rear", "right front", "left rear", "left front")
REST = np.array([(37, -79, -155), (250, -79, -155), (37, 79, -155), (250, 79, -155)]) * MM


@functools.cache
def gipo() -> po.Robot:
    return po.robots.gipo()


def tips(robot: po.Robot, X: np.ndarray) -> np.ndarray:
    """Give the places of the tips on the shins, shape (4, 3)."""
    poses = dict(zip([k.name for k in robot.mechanism.links], robot.kinematics.poses(X)[0], strict=True))
    ends = {c.link_A: c.point_A for c in robot.mechanism.closures if isinstance(c, po.Coincidence)}
    return np.array([(poses[f"{leg} knee"] @ [*ends[f"{leg} knee"], 1])[:3] for leg in LEGS])


def test_counts_and_ranks() -> None:
    """Counted in tables IV.3 and IV.4: N = 6 + 17 + 12 = 35, 4 coincidences, m = 23; 18 without head and tail."""
    report = po.report_state(gipo().kinematics, gipo().home_configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (35, 12, 12, 23)
    assert report.idle == gipo().mechanism.passive == ("neck 1", "neck 2", "head", "jaw", "tail")
    body = po.robots.gipo(head_and_tail=False)
    report = po.report_state(body.kinematics, body.home_configuration)
    assert (report.n_variables, report.ranks["E"].value, report.mobility) == (30, 12, 18)
    assert report.idle == body.mechanism.passive == ()


def test_seventeen_servos() -> None:
    """Three in each leg, four in the head, one in the tail."""
    assert len(gipo().mechanism.active) == 3 * 4
    assert len(gipo().mechanism.passive) == 4 + 1
    assert len(gipo().limits.velocity) == 17
    assert len(gipo().mechanism.operational) == 6 + 12


def test_tips_stand_on_the_printed_feet() -> None:
    assert_allclose(tips(gipo(), gipo().home_configuration.X), REST, atol=1e-11)


def test_zero_angles_fit_the_printed_stance() -> None:
    """Checked: with the rear hips at -58 and the trunk at (113.5, 0, 10) mm the tips are 5.5 mm off along x."""
    mechanism = gipo().mechanism
    X = np.zeros(len(mechanism.names))
    X[mechanism.indices("xyz")] = np.multiply((113.5, 0, 10), MM)
    off = (tips(gipo(), X) - REST) / MM
    assert_allclose(np.abs(off), np.tile((5.5, 5.0, 0.0), (4, 1)), atol=1e-9)


def test_left_legs_mirror_the_right_ones() -> None:
    home = gipo().home_configuration
    for end in ("rear", "front"):
        for joint, sign in (("hip", 1), ("abduction", -1), ("knee", 1)):
            assert home[f"left {end} {joint}"] == pytest.approx(sign * home[f"right {end} {joint}"], abs=1e-11)


def test_printed_sign_of_the_rear_hips_also_stands() -> None:
    printed = po.robots.gipo(rear_hip=1)
    hip = printed.mechanism.link("right rear hip")
    assert isinstance(hip, po.Series)
    assert_allclose(hip.at, np.multiply((58, -50, -38), MM), atol=1e-15)
    assert_allclose(tips(printed, printed.home_configuration.X), REST, atol=1e-11)


def test_servos_hold_the_trunk_once_the_feet_are_held() -> None:
    """12 servos hold 18 motions nowhere, but the 6 of the trunk redundantly when the carriers stand still."""
    kinematics, home = gipo().kinematics, gipo().home_configuration
    mechanism = gipo().mechanism
    assert po.report_state(kinematics, home).parallel_margin == 0
    trunk = mechanism.operational[:6]
    (E,) = kinematics.functions.scaled_jacobian(home.X)
    assert np.linalg.matrix_rank(E[:, mechanism.indices(trunk)]) == 6


def test_turn_of_the_trunk_with_servos_at_rest_carries_the_feet() -> None:
    """IV.3.3: servos fixed, carriers free, the trunk turned by 15 degrees gives the places to step to."""
    mechanism, home = gipo().mechanism, gipo().home_configuration
    angle = np.radians(15)
    trunk = {n: home[n] for n in mechanism.operational[:6]} | {"gamma": angle}
    solution = gipo().kinematics.solve({**{n: home[n] for n in mechanism.active}, **trunk}, home)
    turned = solution.configuration
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    origin = np.array([home["x"], 0, 0])
    expected = (REST - origin) @ R.T + origin
    moved = REST + np.array([[turned[f"{leg} foot {c}"] for c in "xyz"] for leg in LEGS])
    assert_allclose(moved, expected, atol=1e-11)
