"""Supports: planes of any tilt, surfaces known by frames."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.modes.legged import FrameSupport, PlaneSupport, drop_onto, measure_height

lengths = st.floats(-2.0, 2.0)
points = st.tuples(lengths, lengths, lengths)


@given(slope=st.floats(-1.2, 1.2), heading=st.floats(-3.1, 3.1), at=points, p=points, lean=st.floats(-0.3, 0.3))
def test_points_fall_along_gravity_onto_a_plane(
    slope: float, heading: float, at: tuple[float, ...], p: tuple[float, ...], lean: float
) -> None:
    support = PlaneSupport.tilted(slope, heading, at)
    down = np.array([math.sin(lean), 0.0, -math.cos(lean)])
    if abs(np.asarray(support.normal) @ down) < 0.05:
        return  # nearly a wall
    landed = drop_onto(support, p, down)
    assert abs(float(measure_height(support, landed))) < 1e-12  # lengths of metres, in doubles
    assert np.linalg.norm(np.cross(landed - np.asarray(p), down)) < 1e-12 * max(1.0, np.linalg.norm(landed))


def test_a_plane_rises_towards_its_heading() -> None:
    support = PlaneSupport.tilted(0.1, heading=math.pi / 2, point=(0, 0, 1))
    heights = drop_onto(support, [(0, 0, 5), (0, 1, 5), (1, 0, 5)])[:, 2]
    assert_allclose(heights, [1.0, 1.0 + math.tan(0.1), 1.0], atol=1e-15)
    assert float(measure_height(support, (0, 0, 1.5))) == pytest.approx(0.5 * math.cos(0.1))


def test_the_nearest_frame_stands_for_a_curved_surface() -> None:
    # three footholds on a sphere of radius 2 m around the origin
    frames = [po.transform(rotation=(angle, 0, 0)) @ po.transform((0, 0, 2)) for angle in (-0.2, 0.0, 0.2)]
    support = FrameSupport(frames)
    for frame in frames:
        p = frame[:3, 3] + 0.01 * frame[:3, 2] + 0.02 * frame[:3, 0]
        assert float(measure_height(support, p)) == pytest.approx(0.01)
        assert_allclose(support.tangent_plane(p)[1], frame[:3, 2])
    many = np.array([frame[:3, 3] for frame in frames])
    assert measure_height(support, many).shape == (3,)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: PlaneSupport(normal=(0, 0, 0)), "zero"),
        (lambda: PlaneSupport(point=(0, math.nan, 0)), "finite"),
        (lambda: FrameSupport(np.eye(3)), "shape"),
        (lambda: FrameSupport(np.zeros((0, 4, 4))), "shape"),
        (lambda: FrameSupport(np.diag([1.0, 1.0, -1.0, 1.0])), "orthonormal"),
        (lambda: FrameSupport(np.diag([1.0, 1.1, 1.0, 1.0])), "orthonormal"),
        (lambda: drop_onto(PlaneSupport(normal=(1, 0, 0)), (0, 0, 1)), "wall"),
    ],
)
def test_faulty_supports_are_refused(make: object, match: str) -> None:
    with pytest.raises(po.DefinitionError, match=match):
        make()  # type: ignore[operator]
