"""The closed forms of the tripod against the general closures, which know nothing of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.modes.legged.tripod import TripodGeometry, WalkingTripod, leg_names, move_frames, tripod_model
from tripods import FEET, GEOMETRY, HOME, random_stances, walker

MODEL = tripod_model(GEOMETRY)


def test_closed_forms_agree_with_the_general_solver_on_thousands_of_poses() -> None:
    """Both are exact: 1e-10 is what the general solver leaves of its residual, with room."""
    robot = walker().robot
    poses, feet = random_stances(3000, 0)
    X = walker().configurations(poses, feet)
    general = robot.kinematics.inverse_batch(np.hstack([poses, feet.reshape(-1, 18)]), robot.home_configuration.X)
    angle = np.array([v.kind == "angle" for v in robot.mechanism.variables])
    gap = general.X - X
    gap[:, angle] = np.angle(np.exp(1j * gap[:, angle]))
    assert np.max(np.abs(gap)) < 1e-10
    assert robot.kinematics.scaled_residual(X).max() < 1e-13


def test_actuators_are_the_distances_of_their_ends() -> None:
    """From A to P_L and P_R, placed here without the closed forms."""
    poses, feet = random_stances(50, 1)
    values = MODEL.inverse(poses, feet)
    robot = walker().robot
    frames = robot.kinematics.poses(walker().configurations(poses, feet))
    platform = frames[:, [link.name for link in robot.mechanism.links].index("platform")]
    for i in (1, 2, 3):
        for side, sign in (("L", -1), ("R", 1)):
            turn = GEOMETRY.azimuth(i) + sign * GEOMETRY.half_angle
            point = GEOMETRY.radius * np.array([math.cos(turn), math.sin(turn), 0.0])
            end = platform[:, :3, 3] + platform[:, :3, :3] @ point
            length = np.linalg.norm(end - feet[:, i - 1, :3], axis=1)
            assert_allclose(values[:, MODEL.names.index(f"q{side} {i}")], length, rtol=0, atol=1e-14)


def test_derivatives_against_the_general_tangent() -> None:
    poses, feet = random_stances(20, 2)
    values, by_pose, by_feet = MODEL.slopes(poses, feet)
    kinematics = walker().robot.kinematics
    T = kinematics.tangent(walker().configurations(poses, feet), kinematics.mechanism.operational)
    rows = kinematics.mechanism.indices(MODEL.names)
    assert_allclose(T[:, rows, :6], by_pose, atol=1e-10)
    assert_allclose(T[:, rows, 6:], by_feet, atol=1e-10)
    assert_allclose(values, MODEL.inverse(poses, feet), atol=0)


def test_one_stance_and_many() -> None:
    poses, feet = random_stances(5, 3)
    assert_allclose(MODEL.inverse(poses, FEET)[2], MODEL.inverse(poses[2], FEET)[0], atol=0)
    assert_allclose(MODEL.inverse(HOME, feet)[4], MODEL.inverse(HOME, feet[4])[0], atol=0)
    assert MODEL.names[:10] == leg_names(1)


def test_home_is_the_home_of_the_robot() -> None:
    robot = walker().robot
    assert_allclose(walker().configurations(HOME, FEET)[0], robot.home_configuration.X, atol=1e-12)
    assert_allclose(GEOMETRY.rest_pose(FEET), HOME, atol=1e-15)
    pose, feet = walker().read(robot.home_configuration)
    assert_allclose(pose, HOME, atol=1e-15)
    assert_allclose(feet, FEET, atol=1e-15)


def test_rest_pose_goes_where_the_feet_go() -> None:
    moved = move_frames(FEET, (0.1, -0.2, 0.05), 0.4)
    assert_allclose(GEOMETRY.rest_pose(moved), [0.1, -0.2, 0.37, 0, 0, 0.4], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radius": 0.0}, "radius of the tripod is 0.0 m"),
        ({"half_angle": 1.2}, "half angle of the tripod is 1.2 rad"),
        ({"stroke": (0.4, 0.3)}, r"stroke of the tripod is \[0.4, 0.3\]"),
        ({"stroke": (0.25, 0.3)}, "qL of the tripod is .* at home"),
        ({"q6": (-0.2, 0.8)}, "q6 of the tripod is .* at home"),
    ],
    ids=str,
)
def test_geometries_that_cannot_be_are_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        TripodGeometry(**change)  # type: ignore[arg-type]


def test_a_walker_needs_free_feet_of_its_own_geometry() -> None:
    with pytest.raises(po.DefinitionError, match="does not walk"):
        WalkingTripod(GEOMETRY, po.Scene(po.robots.tripod()))
    with pytest.raises(po.DefinitionError, match="is not of this geometry"):
        WalkingTripod(TripodGeometry(radius=0.16), walker().scene)


# --- Solids


def test_rods_stay_in_their_bodies_and_out_of_the_ground() -> None:
    """At every length between the ends of the stroke; both in the frame of the actuator, z from A."""
    low, high = GEOMETRY.stroke
    shapes = walker().robot.shapes
    for name, body in shapes.items():
        if not name.startswith("actuator"):
            continue
        (cylinder,), (rod,) = body, shapes[name.replace("actuator", "rod")]
        bottom, top = (cylinder.pose[2, 3] + s * 0.5 * cylinder.length for s in (-1, 1))
        tail, tip = (rod.pose[2, 3] + s * 0.5 * rod.length for s in (-1, 1))
        assert abs(tip) < 1e-12
        assert high + tail < top + cylinder.radius - 0.01  # the body still holds it
        assert low + tail - rod.radius > 0  # above A, which is above the ground
        assert low > top + cylinder.radius  # the axle keeps off the body
        assert bottom == pytest.approx(0, abs=1e-12)  # it turns on the foot's axle
        assert cylinder.pose[0, 3] == rod.pose[0, 3]  # on one line


def test_home_is_free_of_contact() -> None:
    clearance = walker().scene.clearance(walker().robot.home_configuration)
    assert clearance.distance > 0.015
    fixed = po.robots.tripod()
    assert po.Scene(fixed).clearance(fixed.home_configuration).distance > 0.015


def test_the_platform_is_checked_against_the_legs() -> None:
    names = {pair.name for pair in walker().scene.pairs}
    assert {"platform / rod L 1", "tool / actuator R 2", "ground / tool", "foot 1 / foot 2"} <= names
    # the platform let down on its legs: seen
    low = walker().configuration([0, 0, 0.02, 0, 0, 0], FEET)
    assert walker().scene.clearance(low).distance < 0
