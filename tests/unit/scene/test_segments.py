"""Segments against convex polyhedra: by hand, by linear programming, and against coal."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog

from paraopt.scene.geometry import build_geometry
from paraopt.scene.segments import clip_segments, measure_segments, nearest_of_segments, segments_meet, stack_hulls
from paraopt.shapes import Capsule, ConvexPolyhedron, Hull

Array = np.ndarray
CUBE = ConvexPolyhedron(vertices=np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T)


def draw_hull(random: np.random.Generator) -> Hull:
    """Draw a polyhedron, slim or fat, of 4 to 20 points, about the origin or beside it."""
    points = random.normal(size=(random.integers(4, 21), 3)) * random.uniform(0.1, 1.0, 3)
    return ConvexPolyhedron(vertices=points + random.uniform(-0.5, 0.5, 3)).hull


def draw_segments(random: np.random.Generator, n: int) -> tuple[Array, Array]:
    A = random.normal(size=(n, 3))
    return A, A + random.normal(size=(n, 3)) * random.uniform(0.01, 2.0, (n, 1))


def measure(A: Array, B: Array, hull: Hull) -> tuple[Array, Array, Array, Array]:
    return measure_segments(A, B, stack_hulls([hull]), np.zeros(len(A), dtype=int))


# --- By hand, on the cube from -1 to 1

CASES: dict[str, tuple[Any, Any, float | None, float]] = {
    # first end, second end, length inside (None where apart), signed distance
    "through the middle": ((-3, 0, 0), (3, 0, 0), 2.0, -1.0),
    "within": ((-0.5, 0, 0), (0.5, 0, 0), 1.0, -1.0),
    "one end inside": ((0.5, 0, 0), (3, 0, 0), 0.5, -0.5),
    "before it": ((-3, 0, 0), (-2, 0, 0), None, 1.0),
    "behind it": ((2, 0, 0), (5, 0, 0), None, 1.0),
    "over a face": ((-3, 0.2, 1.5), (3, 0.3, 1.5), None, 0.5),
    "past an edge": ((0, 3, 1), (0, 1, 3), None, np.sqrt(2) - 0.0),
    "past a corner": ((2, 2, 2), (3, 3, 3), None, np.sqrt(3)),
    "touching a face with its end": ((1, 0, 0), (3, 0, 0), 0.0, 0.0),
    "along a face": ((-3, 0, 1), (3, 0, 1), 2.0, 0.0),
    "along an edge": ((-3, 1, 1), (3, 1, 1), 2.0, 0.0),
    "touching an edge": ((0, 0, 2), (0, 2, 0), 0.0, 0.0),
    "touching a corner": ((1, 0, 2), (1, 2, 0), 0.0, 0.0),
    "along the line of a face, beside it": ((2, 0, 1), (3, 0, 1), None, 1.0),
    "a point inside": ((0.2, 0.3, 0.5), (0.2, 0.3, 0.5), 0.0, -0.5),
    "a point on a face": ((0.2, 0.3, 1), (0.2, 0.3, 1), 0.0, 0.0),
    "a point outside": ((0.2, 0.3, 3), (0.2, 0.3, 3), None, 2.0),
    "a point off a corner": ((2, 2, 2), (2, 2, 2), None, np.sqrt(3)),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("backwards", [False, True])
def test_by_hand(case: str, backwards: bool) -> None:
    first, second, inside, expected = CASES[case]
    A, B = np.array([first], dtype=float), np.array([second], dtype=float)
    if backwards:
        A, B = B, A
    hull = CUBE.hull
    low, high = clip_segments(A, B, hull.normals, hull.offsets)
    assert bool(segments_meet(A, B, hull.normals, hull.offsets)[0]) is (inside is not None)
    if inside is not None:
        assert high[0] - low[0] == pytest.approx(inside, abs=1e-12)
    distance, on_solid, on_segment, normal = measure(A, B, hull)
    assert distance[0] == pytest.approx(expected, abs=1e-12)
    assert np.linalg.norm(normal[0]) == pytest.approx(1.0, abs=1e-12)
    assert_allclose(on_segment - on_solid, distance[:, None] * normal, atol=1e-12)
    # the witness point of the solid is on its surface
    assert np.max(hull.normals @ on_solid[0] - hull.offsets) == pytest.approx(0.0, abs=1e-12)


def test_past_an_edge_is_the_distance_of_its_line() -> None:
    """The segment from (0, 3, 1) to (0, 1, 3) has its middle (0, 2, 2) over the edge (., 1, 1)."""
    distance, on_solid, _, normal = measure(np.array([[0.0, 3, 1]]), np.array([[0.0, 1, 3]]), CUBE.hull)
    assert_allclose(on_solid[0, 1:], (1, 1), atol=1e-12)
    assert_allclose(normal[0], np.array([0, 1, 1]) / np.sqrt(2), atol=1e-12)
    assert distance[0] == pytest.approx(np.sqrt(2), abs=1e-12)


def test_several_polyhedra_of_different_sizes_in_one_call() -> None:
    random = np.random.default_rng(5)
    hulls = [draw_hull(random) for _ in range(6)]
    A, B = draw_segments(random, 60)
    which = random.integers(0, 6, 60)
    together = measure_segments(A, B, stack_hulls(hulls), which)
    for k, hull in enumerate(hulls):
        alone = measure(A[which == k], B[which == k], hull)
        for ours, theirs in zip(together, alone, strict=True):
            assert_allclose(ours[which == k], theirs, atol=1e-12)


def test_nothing_is_measured_without_segments() -> None:
    assert measure(np.empty((0, 3)), np.empty((0, 3)), CUBE.hull)[0].shape == (0,)


# --- Linear programming: is there a point of the segment in the solid?


def gap_by_linear_programming(a: Array, b: Array, hull: Hull) -> float:
    """Give the least amount by which some point of the segment violates the facets [m]: at most 0 where they meet."""
    t = hull.normals @ (b - a)
    found = linprog(
        (0.0, 1.0), A_ub=np.column_stack([t, -np.ones(len(t))]), b_ub=hull.offsets - hull.normals @ a,
        bounds=[(0, 1), (None, None)], method="highs",
    )  # fmt: skip
    assert found.status == 0
    return float(found.fun)


def compare_with_linear_programming(random: np.random.Generator, hulls: int, each: int) -> None:
    met = 0
    for _ in range(hulls):
        hull = draw_hull(random)
        A, B = draw_segments(random, each)
        meet = segments_meet(A, B, hull.normals, hull.offsets)
        distance = measure(A, B, hull)[0]
        assert np.array_equal(meet, distance <= 0.0)
        for i in range(each):
            gap = gap_by_linear_programming(A[i], B[i], hull)
            # what the program cannot tell from touching is left to the cases by hand
            if abs(gap) > 1e-8:
                assert meet[i] == (gap < 0.0)
                # the distance is that to the farthest of these facets or more
                assert gap < 0.0 or distance[i] >= gap - 1e-9
        met += int(meet.sum())
    assert 0.1 * hulls * each < met < 0.9 * hulls * each


def test_agrees_with_linear_programming() -> None:
    compare_with_linear_programming(np.random.default_rng(0), 40, 50)


@pytest.mark.slow
def test_agrees_with_linear_programming_on_many() -> None:
    compare_with_linear_programming(np.random.default_rng(1), 400, 50)


# --- coal


def compare_with_coal(random: np.random.Generator, hulls: int, each: int) -> None:
    radius, request, result = 1e-3, coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    request.gjk_tolerance, request.epa_tolerance = 1e-9, 1e-6
    request.gjk_max_iterations = request.epa_max_iterations = 512
    signs = set()
    for _ in range(hulls):
        hull = draw_hull(random)
        A, B = draw_segments(random, each)
        distance, on_solid, on_segment, normal = measure(A, B, hull)
        solid = build_geometry(ConvexPolyhedron(vertices=hull.vertices))
        for i in range(each):
            rod = Capsule.between(A[i], B[i], radius)
            geometry = build_geometry(rod)
            X = coal.Transform3s(rod.pose[:3, :3].copy(), rod.pose[:3, 3].copy())
            result.clear()
            theirs = coal.ComputeDistance(solid, geometry)(coal.Transform3s(), X, request, result) + radius
            # both are exact but for round-off where GJK ends on a corner, edge or facet; else to its tolerance
            assert distance[i] == pytest.approx(theirs, abs=1e-8 if distance[i] > 0 else 1e-5)
        signs |= set(np.sign(distance).tolist())
        # proofs without coal: the solid and the segment lie on both sides of planes that far apart
        sides = np.minimum(np.sum(normal * A, axis=1), np.sum(normal * B, axis=1)) - (normal @ hull.vertices.T).max(1)
        assert_allclose(sides, distance, atol=1e-10)
        assert np.max(on_solid @ hull.normals.T - hull.offsets) < 1e-9
        assert_allclose(on_segment - on_solid, distance[:, None] * normal, atol=1e-12)
    assert signs == {-1.0, 1.0}


def test_agrees_with_coal() -> None:
    compare_with_coal(np.random.default_rng(2), 100, 50)


@pytest.mark.slow
def test_agrees_with_coal_on_many() -> None:
    compare_with_coal(np.random.default_rng(3), 2000, 50)


# --- Two segments


def test_nearest_points_of_segments_are_the_nearest() -> None:
    random = np.random.default_rng(4)
    n = 400
    P, Q = random.normal(size=(2, n, 3))
    u, v = random.normal(size=(2, n, 3))
    v[:100] = u[:100] * random.uniform(-2, 2, (100, 1))  # parallel
    v[100:120] = u[100:120] * 0.7 + 1e-8 * random.normal(size=(20, 3))  # nearly
    u[120:140] = 0.0
    v[130:150] = 0.0
    p, q = nearest_of_segments(P, u, Q, v)
    found = np.linalg.norm(p - q, axis=1)
    s, t = np.meshgrid(np.linspace(0, 1, 81), np.linspace(0, 1, 81))
    sampled = np.full(n, np.inf)
    for a, b in zip(s.ravel(), t.ravel(), strict=True):
        sampled = np.minimum(sampled, np.linalg.norm(P + a * u - Q - b * v, axis=1))
    assert np.all(found <= sampled + 1e-7)
    assert np.all(found >= sampled - 0.02 * (np.linalg.norm(u, axis=1) + np.linalg.norm(v, axis=1)) - 1e-12)
    # they lie on the segments
    for point, start, span in ((p, P, u), (q, Q, v)):
        share = np.sum((point - start) * span, axis=1) / np.maximum(np.sum(span**2, axis=1), 1e-300)
        assert np.all((share > -1e-12) & (share < 1 + 1e-12))
        assert_allclose(point, start + share[:, None] * span, atol=1e-9)
