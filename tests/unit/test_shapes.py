"""Bodies: sizes and poses that are refused, placement between points, and bounds that contain them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.shapes import Shape

KINDS: dict[str, Callable[..., Shape]] = {
    "box": lambda **o: po.Box(size=(0.1, 0.2, 0.3), **o),
    "sphere": lambda **o: po.Sphere(radius=0.1, **o),
    "cylinder": lambda **o: po.Cylinder(radius=0.1, length=0.5, **o),
    "capsule": lambda **o: po.Capsule(radius=0.1, length=0.5, **o),
}
BAD_NUMBERS = [0, 0.0, -0.1, np.nan, np.inf, -np.inf, "wide", None, [1.0]]


@pytest.mark.parametrize("value", BAD_NUMBERS)
@pytest.mark.parametrize(
    ("build", "quantity"),
    [
        (lambda v: po.Sphere(radius=v, name="ball"), "radius of sphere 'ball'"),
        (lambda v: po.Cylinder(radius=v, length=1.0, name="rod"), "radius of cylinder 'rod'"),
        (lambda v: po.Cylinder(radius=1.0, length=v, name="rod"), "length of cylinder 'rod'"),
        (lambda v: po.Capsule(radius=v, length=1.0), "radius of capsule"),
        (lambda v: po.Capsule(radius=1.0, length=v), "length of capsule"),
        (lambda v: po.Box(size=(1.0, v, 1.0), name="crate"), "(size|side) of box 'crate'"),
        (lambda v: po.Cylinder.between((0, 0, 0), (0, 0, 1), v, name="rod"), "radius of cylinder 'rod'"),
        (lambda v: po.Capsule.between((0, 0, 0), (0, 0, 1), v, name="rod"), "radius of capsule 'rod'"),
    ],
)
def test_bad_sizes_are_refused_by_name(build: Callable[[Any], Shape], quantity: str, value: Any) -> None:
    with pytest.raises(po.DefinitionError, match=quantity):
        build(value)


@pytest.mark.parametrize("size", [(1, 2), (1, 2, 3, 4), 1.0, "box", None])
def test_a_box_has_three_sides(size: Any) -> None:
    with pytest.raises(po.DefinitionError, match="size of box 'crate'"):
        po.Box(size=size, name="crate")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "pose",
    [np.eye(3), np.full((4, 4), np.nan), 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]), (0, 0, 1), None],
    ids=["3 x 3", "nan", "stretched", "mirrored", "point", "none"],
)
def test_bad_poses_are_refused_by_name(kind: str, pose: Any) -> None:
    with pytest.raises(po.DefinitionError, match=f"pose of {kind} 'thing'"):
        KINDS[kind](name="thing", pose=pose)


@pytest.mark.parametrize("kind", KINDS)
def test_shapes_are_frozen_and_copy_their_pose(kind: str) -> None:
    pose = po.transform((1, 2, 3))
    shape = KINDS[kind](pose=pose)
    pose[0, 3] = 9.0
    assert shape.pose[0, 3] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        shape.pose[0, 3] = 5.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        shape.name = "other"  # type: ignore[misc]
    assert_allclose(KINDS[kind]().pose, np.eye(4), atol=0)


def test_sizes_are_kept_as_floats() -> None:
    assert (po.Cylinder(radius=1, length=np.float32(2)).radius, po.Sphere(radius=np.int64(3)).radius) == (1.0, 3.0)
    size = np.array([1.0, 2.0, 3.0])
    box = po.Box(size=size)
    size[0] = 9.0
    assert_allclose(box.size, (1, 2, 3), atol=0)


@pytest.mark.parametrize("kind", [po.Cylinder, po.Capsule])
@pytest.mark.parametrize(
    ("first", "second"),
    [((0, 0, 0), (0, 0, 1)), ((0, 0, 1), (0, 0, 0)), ((1, 2, 3), (1, 5, 7)), ((-0.1, 0.2, 0), (0.3, -0.2, 0.5))],
)
def test_between_two_points(kind: Any, first: Any, second: Any) -> None:
    shape = kind.between(first, second, radius=0.05, name="rod")
    assert shape.length == pytest.approx(np.linalg.norm(np.subtract(second, first)), rel=1e-15)
    ends = shape.pose @ np.array([[0, 0], [0, 0], [-0.5, 0.5], [0, 0]]) * shape.length
    assert_allclose(shape.pose[:3, 3] + ends[:3].T, [first, second], atol=1e-14)  # a few roundings of 7
    assert (shape.radius, shape.name) == (0.05, "rod")


@pytest.mark.parametrize("kind", [po.Cylinder, po.Capsule])
def test_between_one_point_and_itself_is_refused(kind: Any) -> None:
    with pytest.raises(po.DefinitionError, match="zero length"):
        kind.between((1, 2, 3), (1, 2, 3), radius=0.1)
    with pytest.raises(po.DefinitionError, match="segment end"):
        kind.between((1, 2, np.nan), (1, 2, 3), radius=0.1)


def test_bounding_radius_reaches_the_farthest_point() -> None:
    assert po.Box(size=(2, 4, 4)).bounding_radius == pytest.approx(3.0, rel=1e-15)
    assert po.Sphere(radius=0.3).bounding_radius == 0.3
    assert po.Cylinder(radius=3, length=8).bounding_radius == pytest.approx(5.0, rel=1e-15)
    assert po.Capsule(radius=3, length=8).bounding_radius == 7.0


def test_a_bare_shape_has_no_size() -> None:
    with pytest.raises(po.DefinitionError, match="shape 'thing': a bare Shape has no size"):
        _ = Shape(name="thing").bounding_radius


def test_labels_name_the_solid() -> None:
    assert po.Sphere(radius=1).label == "sphere"
    assert po.Sphere(radius=1, name="ball").label == "sphere 'ball'"
