"""Rotations and transforms against scipy's, and what is refused."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import paraopt as po
from paraopt import spatial

# a rotation of order one computed twice in double precision
ROUND_OFF = 1e-15


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("angle", [-2.5, 0.0, 0.3, np.pi])
def test_rotation_about_an_axis(axis: str, angle: float) -> None:
    R = np.asarray(spatial.rotation_about(axis, angle))
    assert_allclose(R, Rotation.from_euler(axis, angle).as_matrix(), atol=ROUND_OFF)


@pytest.mark.parametrize("axis", ["X", "w", "", None])
def test_rotation_about_no_axis_is_refused(axis: Any) -> None:
    with pytest.raises(po.DefinitionError, match="axis is"):
        spatial.rotation_about(axis, 0.1)


def test_rotation_of_a_symbol_is_the_same_expression() -> None:
    angle = ca.SX.sym("angle")
    R = ca.Function("R", [angle], [spatial.rotation_about("y", angle)])
    assert_allclose(np.asarray(R(0.7)), np.asarray(spatial.rotation_about("y", 0.7)), atol=ROUND_OFF)


def test_rotation_xyz_is_x_then_y_then_z_of_the_moving_frame() -> None:
    angles = (0.3, -1.1, 2.0)
    R = np.asarray(spatial.rotation_xyz(*angles))
    # capital letters are scipy's intrinsic angles: Rx Ry Rz
    assert_allclose(R, Rotation.from_euler("XYZ", angles).as_matrix(), atol=ROUND_OFF)
    assert not np.allclose(R, Rotation.from_euler("ZYX", angles).as_matrix())


def test_transform() -> None:
    X = po.transform((1, 2, 3), (0.1, 0.2, 0.3))
    expected = np.eye(4)
    expected[:3, :3] = Rotation.from_euler("XYZ", (0.1, 0.2, 0.3)).as_matrix()
    expected[:3, 3] = (1, 2, 3)
    assert_allclose(X, expected, atol=ROUND_OFF)
    assert_allclose(po.transform(), np.eye(4), atol=0)


@pytest.mark.parametrize(
    ("position", "rotation", "word"),
    [
        ((1, 2), (0, 0, 0), "position"),
        ((1, 2, np.nan), (0, 0, 0), "position"),
        ((1, 2, 3), (0, np.inf, 0), "rotation"),
        ((1, 2, 3), (0, 0, 0, 0), "rotation"),
        (("a", 2, 3), (0, 0, 0), "position"),
        (None, (0, 0, 0), "position"),
        (1.0, (0, 0, 0), "position"),
    ],
)
def test_transform_refuses_what_is_no_vector(position: Any, rotation: Any, word: str) -> None:
    with pytest.raises(po.DefinitionError, match=word):
        po.transform(position, rotation)


@pytest.mark.parametrize(
    ("a", "b"),
    [((0, 0, 0), (0, 0, 2)), ((0, 0, 0), (0, 0, -2)), ((1, 2, 3), (1, 5, 3)), ((0.1, -0.2, 0.3), (-1, 2, 0.7))],
)
def test_segment_pose_runs_from_one_point_to_the_other(a: Any, b: Any) -> None:
    X, length = spatial.segment_pose(a, b)
    ends = X @ np.array([[0, 0], [0, 0], [-length / 2, length / 2], [1, 1]])
    assert_allclose(ends[:3].T, [a, b], atol=1e-15 * 4)  # a few roundings of numbers up to 4
    assert length == pytest.approx(np.linalg.norm(np.subtract(b, a)), rel=1e-15)
    spatial.check_pose(X, "segment", tolerance=1e-15)


def test_segment_of_no_length_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match=r"zero length.*1\.0, 2\.0, 3\.0"):
        spatial.segment_pose((1, 2, 3), (1, 2, 3))


def test_finite_vector_copies_and_locks() -> None:
    given = np.array([1.0, 2.0, 3.0])
    kept = spatial.finite_vector(given, 3, "size")
    given[0] = 9.0
    assert kept[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 5.0


@pytest.mark.parametrize("X", [np.eye(3), np.full((4, 4), np.nan), "pose", [[1, 2], [3]]])
def test_pose_must_be_four_by_four_numbers(X: Any) -> None:
    with pytest.raises(po.DefinitionError, match=r"pose of the tool (must be|is)"):
        spatial.check_pose(X, "pose of the tool")


def _corrupted(row: int, column: int, value: float) -> np.ndarray:
    X = po.transform((1, 2, 3), (0.1, 0.2, 0.3))
    X[row, column] = value
    return X


@pytest.mark.parametrize(
    "X",
    [
        np.diag([1.0, 1.0, -1.0, 1.0]),  # left-handed
        np.diag([1.0, 1.0, 1.0, 2.0]),
        2.0 * np.eye(4),
        _corrupted(0, 0, 0.5),
        _corrupted(3, 0, 1e-3),
        np.array(po.transform((0, 0, 1))).T,
    ],
)
def test_pose_must_be_rigid(X: np.ndarray) -> None:
    with pytest.raises(po.DefinitionError, match="pose of the tool is not a rigid pose"):
        spatial.check_pose(X, "pose of the tool")


def test_pose_is_copied_and_locked() -> None:
    given = po.transform((1, 2, 3))
    kept = spatial.check_pose(given, "pose")
    given[0, 3] = 9.0
    assert kept[0, 3] == 1.0
    assert not kept.flags.writeable
