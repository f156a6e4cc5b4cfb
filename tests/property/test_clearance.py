"""Distances of random convex solids: what holds whatever they are, however they are turned and moved."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import paraopt as po
from paraopt.scene.collision import CollisionModel
from paraopt.scene.pairs import WORLD, Body, Pair
from paraopt.shapes import ConvexPolyhedron, HalfSpace, Mesh, Shape
from solids import APART, DEEP, DRAW, build, draw_pose

Array = np.ndarray
ZERO = np.zeros(1, dtype=int)

seeds = st.integers(0, 2**32 - 1)


def cuboid(size: Array) -> Array:
    return np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T * size


kinds = st.sampled_from(sorted(DRAW))


def measure(first: Shape, second: Shape) -> tuple[float, Array, Array]:
    bodies = [Body(name, shape, WORLD, "world") for name, shape in (("a", first), ("b", second))]
    model = CollisionModel(bodies, [Pair(0, 1, "a / b", True)])
    distance, points, normal = model.measure(model.place(np.zeros((1, 0, 4, 4))), ZERO, ZERO)
    return float(distance[0]), points[0], normal[0]


def draw_two(random: np.random.Generator, first: str, second: str, spread: float) -> tuple[Any, Any]:
    """Draw two solids as (kind, sizes, pose); the second is no half-space where the first is."""
    if first == second == "HalfSpace":
        second = "Box"
    return tuple((kind, DRAW[kind](random), draw_pose(random, spread)) for kind in (first, second))  # type: ignore[return-value]


def tolerance(distance: float) -> float:
    return APART if distance > 0 else DEEP


@given(first=kinds, second=kinds, seed=seeds, spread=st.floats(0.0, 1.5))
def test_swapping_swaps(first: str, second: str, seed: int, spread: float) -> None:
    a, b = draw_two(np.random.default_rng(seed), first, second, spread)
    one, points, normal = measure(build(*a), build(*b))
    other, swapped, back = measure(build(*b), build(*a))
    assert abs(one - other) < tolerance(one)
    for n, p, d in ((normal, points, one), (back, swapped, other)):
        assert abs(np.linalg.norm(n) - 1.0) < 1e-9
        assert_allclose(p[1] - p[0], d * n, atol=1e-9)


@given(first=kinds, second=kinds, seed=seeds, spread=st.floats(0.0, 1.5))
def test_moving_both_changes_nothing(first: str, second: str, seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    a, b = draw_two(random, first, second, spread)
    X = draw_pose(random, 3.0)
    here = measure(build(*a), build(*b))[0]
    there = measure(build(a[0], a[1], X @ a[2]), build(b[0], b[1], X @ b[2]))[0]
    assert abs(here - there) < tolerance(here)


@given(first=kinds, second=kinds, seed=seeds, spread=st.floats(0.0, 1.5), way=st.floats(1e-4, 0.3))
def test_a_distance_changes_by_no_more_than_the_way(
    first: str, second: str, seed: int, spread: float, way: float
) -> None:
    """Through contact, too: signed distances have no jump."""
    random = np.random.default_rng(seed)
    a, b = draw_two(random, first, second, spread)
    shift = random.normal(size=3)
    moved = b[2].copy()
    moved[:3, 3] += way * shift / np.linalg.norm(shift)
    before, after = (measure(build(*a), build(b[0], b[1], X))[0] for X in (b[2], moved))
    assert abs(after - before) <= way + tolerance(before) + tolerance(after)


@given(first=kinds, second=kinds, seed=seeds, angle=st.floats(1e-3, 0.5))
def test_a_turn_changes_a_distance_by_no_more_than_the_farthest_point_moves(
    first: str, second: str, seed: int, angle: float
) -> None:
    random = np.random.default_rng(seed)
    a, b = draw_two(random, first, "Box" if second == "HalfSpace" else second, 1.0)
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec(angle * np.array([0.6, 0.0, 0.8])).as_matrix()
    solid = build(*b)
    before, after = measure(build(*a), solid)[0], measure(build(*a), build(b[0], b[1], b[2] @ X))[0]
    assert abs(after - before) <= angle * solid.bounding_radius + tolerance(before) + tolerance(after)


@given(first=kinds, second=kinds, seed=seeds)
def test_the_normal_is_the_gradient_away_from_kinks(first: str, second: str, seed: int) -> None:
    """Moving the second body by a small way changes the distance by `normal . way`; turning, by that of its point."""
    random = np.random.default_rng(seed)
    a, b = draw_two(random, first, second, 1.2)
    solid = build(*a)
    distance, points, normal = measure(solid, build(*b))
    # depths are too rough for differences, and near contact a distance bends as much as a small ball
    if distance < 0.02:
        return
    twist, turn = random.normal(size=3), random.normal(size=3)

    def along(h: float) -> float:
        X = b[2].copy()
        R = Rotation.from_rotvec(h * turn).as_matrix()
        X[:3, :3], X[:3, 3] = R @ X[:3, :3], points[1] + R @ (X[:3, 3] - points[1]) + h * twist
        return measure(solid, build(b[0], b[1], X))[0]

    # a step of 2e-5 turns the 1e-8 of a distance into 1e-3, and a bend of 50 into 1e-3 times the square of the way
    h = 2e-5
    sides = [(along(h) - distance) / h, (distance - along(-h)) / h]
    # at a kink the one-sided rates differ
    if abs(sides[0] - sides[1]) < 2e-2:
        assert abs(0.5 * (sides[0] + sides[1]) - normal @ twist) < 2e-2
    # whatever is there, the claim is an upper bound to the right and a lower one to the left
    assert sides[0] <= normal @ twist + 2e-2
    assert sides[1] >= normal @ twist - 2e-2


@given(other=kinds, seed=seeds, spread=st.floats(0.0, 1.2))
def test_a_box_is_the_polyhedron_of_its_corners_and_of_its_facets(other: str, seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    size, X = random.uniform(0.05, 0.5, 3), draw_pose(random, spread)
    second = build(other, DRAW[other](random), draw_pose(random, spread))
    box = measure(po.Box(size=size, pose=X), second)[0]
    facets = np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([size, size]) / 2
    for same in (ConvexPolyhedron(vertices=cuboid(size), pose=X), ConvexPolyhedron.from_facets(*facets, pose=X)):
        assert abs(measure(same, second)[0] - box) < tolerance(box)


@given(other=kinds, seed=seeds, spread=st.floats(0.0, 1.2))
def test_a_cylinder_lies_between_the_prisms_in_and_about_it(other: str, seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    radius, length, X = random.uniform(0.05, 0.3), random.uniform(0.1, 0.8), draw_pose(random, spread)
    second = build(other, DRAW[other](random), draw_pose(random, spread))
    whole = measure(po.Cylinder(radius=radius, length=length, pose=X), second)[0]
    turn = np.linspace(0, 2 * np.pi, 61)[:-1]
    ring = np.column_stack([np.cos(turn), np.sin(turn)])

    def prism(r: float) -> float:
        ends = [np.column_stack([r * ring, np.full(60, z)]) for z in (-length / 2, length / 2)]
        return measure(ConvexPolyhedron(vertices=np.vstack(ends), pose=X), second)[0]

    inner, outer = prism(radius), prism(radius / np.cos(np.pi / 60))
    assert outer - tolerance(outer) <= whole <= inner + tolerance(inner)
    assert inner - outer < 0.01 * radius + 2 * DEEP


@given(other=kinds, seed=seeds, spread=st.floats(0.0, 1.2))
def test_a_mesh_of_parts_is_as_near_as_the_whole(other: str, seed: int, spread: float) -> None:
    """A box cut in three by planes: apart, its parts are as near as the box; inside, the sign is the same."""
    random = np.random.default_rng(seed)
    size, X = random.uniform(0.1, 0.5, 3), draw_pose(random, spread)
    second = build(other, DRAW[other](random), draw_pose(random, spread))
    corners = cuboid(size)
    cuts = np.array([-0.5, *np.sort(random.uniform(-0.4, 0.4, 2)), 0.5]) * size[0]
    parts = [np.column_stack([np.where(corners[:, 0] < 0, a, b), corners[:, 1:]])
             for a, b in itertools.pairwise(cuts) if b - a > 1e-3]  # fmt: skip
    triangles = ConvexPolyhedron(vertices=corners).hull.triangles
    vertices = ConvexPolyhedron(vertices=corners).hull.vertices
    if len(parts) < 3:
        return
    mesh = Mesh(vertices=vertices, triangles=triangles, parts=parts, pose=X)
    plain = Mesh(vertices=vertices, triangles=triangles, pose=X)
    whole = measure(po.Box(size=size, pose=X), second)[0]
    found = measure(mesh, second)[0]
    assert abs(measure(plain, second)[0] - whole) < tolerance(whole)
    if whole > 0:
        assert abs(found - whole) < APART
    else:
        assert whole - DEEP <= found <= APART


@given(kind=kinds, seed=seeds, spread=st.floats(0.0, 1.5))
def test_lower_bounds_are_lower_bounds(kind: str, seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    shapes = [build(k, DRAW[k](random), draw_pose(random, spread)) for k in sorted(DRAW)]
    chosen = build(kind, DRAW[kind](random), draw_pose(random, spread))
    if kind == "HalfSpace":
        shapes = [s for s in shapes if not isinstance(s, HalfSpace)]
    bodies = [Body(str(i), shape, WORLD, "world") for i, shape in enumerate([chosen, *shapes])]
    pairs = [Pair(0, i, f"0 / {i}", True) for i in range(1, len(bodies))]
    model = CollisionModel(bodies, pairs)
    placed = model.place(np.zeros((1, 0, 4, 4)))
    bounds = model.lower_bounds(placed)[0]
    every = model.measure(placed, np.zeros(len(pairs), dtype=int), np.arange(len(pairs)))[0]
    assert np.all(bounds <= every + np.where(every > 0, APART, DEEP))
    smallest, which = model.smallest(placed)
    assert abs(smallest[0] - every.min()) < tolerance(float(every.min()))
    assert every[which[0]] == smallest[0]
    below = model.first_below(placed, 0.1)
    assert (below[0] >= 0) == bool(np.any(every < 0.1))
