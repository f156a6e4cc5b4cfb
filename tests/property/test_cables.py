"""Random cables among random solids: against brute force, which looks at points along the segments."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.scene.collision import CollisionModel
from paraopt.scene.pairs import WORLD, Body, Pair
from paraopt.shapes import Cable, Mesh, Shape
from solids import DEEP, DRAW, build, draw_pose

Array = np.ndarray
ZERO = np.zeros(1, dtype=int)
POSE = ("x", "y", "z", "alpha", "beta", "gamma")

seeds = st.integers(0, 2**32 - 1)
kinds = st.sampled_from([*sorted(DRAW), "Mesh"])


def draw_solid(random: np.random.Generator, kind: str, pose: Array, name: str = "it") -> Shape:
    if kind != "Mesh":
        return build(kind, {**DRAW[kind](random), "name": name}, pose)
    parts = [random.uniform(-0.1, 0.1, (8, 3)) + np.array([shift, 0, 0]) for shift in (-0.15, 0.15)]
    hulls = [po.ConvexPolyhedron(vertices=part).hull for part in parts]
    corners = np.vstack([h.vertices for h in hulls])
    triangles = np.vstack([hulls[0].triangles, hulls[1].triangles + len(hulls[0].vertices)])
    return Mesh(vertices=corners, triangles=triangles, parts=parts, pose=pose, name=name)


@functools.cache
def mechanism() -> po.Mechanism:
    """Two bodies that fly: what is imposed and what is driven makes no difference to space."""
    links = [po.Base(), po.Mobile("platform"), po.Mobile("body", prefix="b_")]
    return po.Mechanism("two flyers", links, (), active=tuple(f"b_{c}" for c in POSE), operational=POSE)


@functools.cache
def kinematics() -> po.Kinematics:
    return po.Kinematics(mechanism())


def make_scene(
    cables: tuple[Cable, ...], solids: dict[str, list[Shape]], obstacles: tuple[Shape, ...] = ()
) -> po.Scene:
    robot = po.Robot(mechanism(), home=dict.fromkeys(POSE, 0.0), shapes=solids, cables=cables)
    vars(robot)["kinematics"] = kinematics()  # built once for all examples
    return po.Scene(robot, obstacles)


def draw_state(random: np.random.Generator) -> Array:
    lengths, angles = random.uniform(-0.5, 0.5, (2, 3)), random.uniform(-1.0, 1.0, (2, 3))
    return np.concatenate([lengths[0], angles[0], lengths[1], angles[1]])


def draw_cable(random: np.random.Generator, name: str, ignored: bool) -> Cable:
    links = random.choice(["base", "platform", "body"], size=2, replace=False)
    points = random.uniform(-0.8, 0.8, (2, 3))
    ignore = tuple(random.uniform(0.0, 0.3, 2)) if ignored else (0.0, 0.0)
    return Cable(link_A=str(links[0]), point_A=points[0], link_B=str(links[1]), point_B=points[1],
                 radius=random.uniform(0.002, 0.03), ignore=ignore, name=name)  # fmt: skip


def ends_of(cable: Cable, poses: Array) -> Array:
    """What is looked at of a cable, shape (2, 3), from its words alone."""
    names = [link.name for link in mechanism().links]
    A, B = (
        (poses[names.index(link)] @ [*point, 1.0])[:3] for link, point in zip(cable.links, cable.points, strict=True)
    )
    length = float(np.linalg.norm(B - A))
    a, b = cable.ignore
    if a + b >= length:
        middle = A + a / (a + b) * (B - A)
        return np.array([middle, middle])
    return np.array([A + a / length * (B - A), B - b / length * (B - A)])


def points_from(solid: Shape, points: Array) -> Array:
    """Distances of points from a solid: balls of no matter what size, less their radius."""
    bodies = [Body("solid", solid, WORLD, "world"), Body("ball", po.Sphere(radius=1e-3), 0, "ball")]
    model = CollisionModel(bodies, [Pair(0, 1, "solid / ball", True)])
    poses = np.tile(np.eye(4), (len(points), 1, 1, 1))
    poses[:, 0, :3, 3] = points
    return model.measure(model.place(poses), np.arange(len(points)), np.zeros(len(points), dtype=int))[0] + 1e-3


def measure(scene: po.Scene, X: Array) -> tuple[float, Array, Array]:
    """Distance, witness points and normal of the first pair."""
    distance, points, normal = scene._collision.measure(scene._collision.place(kinematics().poses(X)), ZERO, ZERO)
    return float(distance[0]), points[0], normal[0]


def search(distance: Any, n: int) -> float:
    """Smallest value of a function of n shares in [0, 1], on grids that close in on the best point."""
    centre, half = np.full(n, 0.5), 0.5
    best = np.inf
    for _ in range(14):
        axes = [np.clip(c + half * np.linspace(-1, 1, 31 if n == 1 else 15), 0.0, 1.0) for c in centre]
        grid = np.array(np.meshgrid(*axes)).reshape(n, -1).T
        values = distance(grid)
        k = int(np.argmin(values))
        best, centre, half = min(best, float(values[k])), grid[k], 0.3 * half
    return best


@given(kind=kinds, seed=seeds, ignored=st.booleans(), carrier=st.sampled_from(["world", "body", "platform"]))
def test_a_cable_is_as_near_as_the_nearest_of_its_points(kind: str, seed: int, ignored: bool, carrier: str) -> None:
    random = np.random.default_rng(seed)
    solid, cable = draw_solid(random, kind, draw_pose(random, 0.5)), draw_cable(random, "rope", ignored)
    solids, obstacles = ({}, (solid,)) if carrier == "world" else ({carrier: [solid]}, ())
    scene = make_scene((cable,), solids, obstacles)
    # what the rules leave out (the solid holds an end) is measured here, too
    scene = scene.with_pairs(check=["it / rope"])
    X = draw_state(random)
    poses = kinematics().poses(X)[0]
    X_WC = np.eye(4) if carrier == "world" else poses[[k.name for k in mechanism().links].index(carrier)]
    A, B = (ends_of(cable, poses) - X_WC[:3, 3]) @ X_WC[:3, :3]
    distance, points, normal = measure(scene, X)
    parts = [part for part in solid.solids] if isinstance(solid, Mesh) else [solid]  # one by one they are convex
    if isinstance(solid, Mesh):
        parts = [po.ConvexPolyhedron(vertices=part.vertices, pose=solid.pose) for part in parts]
    expected = min(search(lambda s, p=p: points_from(p, A + s * (B - A)), 1) for p in parts) - cable.radius
    if expected > 1e-3 - cable.radius:  # the segment itself stays outside: sampled depths of single points say no more
        assert abs(distance - expected) < 2e-6
    else:
        assert distance < 1e-6
    assert_allclose(points[1] - points[0], distance * normal, atol=1e-9)
    # the witness of the cable lies on its surface
    first, last = ends_of(cable, poses)
    core = points[1] + cable.radius * normal if scene.bodies[1].name == "rope" else points[0]
    span = last - first
    share = np.clip((core - first) @ span / max(span @ span, 1e-300), 0.0, 1.0)
    assert np.linalg.norm(first + share * span - core) < (1e-6 if distance > 0 else DEEP)


@given(kind=kinds, seed=seeds)
def test_a_penetration_is_undone_by_its_depth_and_by_nothing_shorter(kind: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    solid = draw_solid(random, "Box" if kind == "Mesh" else kind, draw_pose(random, 0.1))
    cable = Cable(link_A="platform", point_A=random.normal(size=3), link_B="platform", point_B=random.normal(size=3),
                  radius=0.02, name="rope")  # fmt: skip
    scene = make_scene((cable,), {}, (solid,))
    X = np.zeros(12)
    distance, _, normal = (
        v[0] for v in scene._collision.measure(scene._collision.place(kinematics().poses(X)), ZERO, ZERO)
    )
    if distance > 0:
        return

    def shifted(way: Array) -> float:
        moved = X.copy()
        moved[mechanism().index("x") : mechanism().index("x") + 3] += way
        return float(scene.clearances(moved)[0][0])

    assert abs(shifted(-distance * normal)) < DEEP
    for way in random.normal(size=(20, 3)):
        assert shifted(0.9 * -distance * way / np.linalg.norm(way)) < DEEP + 0.1 * distance


@given(seed=seeds, ignored=st.booleans())
def test_two_cables_are_as_near_as_the_nearest_of_their_points(seed: int, ignored: bool) -> None:
    random = np.random.default_rng(seed)
    cables = (draw_cable(random, "one", ignored), draw_cable(random, "other", ignored))
    scene = make_scene(cables, {})
    assert [p.name for p in scene.pairs] == ["one / other"]
    X = draw_state(random)
    poses = kinematics().poses(X)[0]
    (A, B), (C, D) = (ends_of(cable, poses) for cable in cables)

    def gap(s: Array) -> Array:
        return np.linalg.norm(A + s[:, :1] * (B - A) - C - s[:, 1:] * (D - C), axis=1)

    expected = search(gap, 2) - cables[0].radius - cables[1].radius
    distance, points, normal = measure(scene, X)
    assert abs(distance - expected) < 2e-6
    assert_allclose(points[1] - points[0], distance * normal, atol=1e-12)
    assert_allclose(np.linalg.norm(normal), 1.0, atol=1e-12)


@given(kind=kinds, seed=seeds, ignored=st.booleans())
def test_gradients_are_those_of_finite_differences(kind: str, seed: int, ignored: bool) -> None:
    """Both ends of both cables and the solid move, each with its link: all twelve coordinates."""
    random = np.random.default_rng(seed)
    cables = (draw_cable(random, "one", ignored), draw_cable(random, "other", ignored))
    solid = draw_solid(random, kind, draw_pose(random, 0.5))
    scene = make_scene(cables, {"body": [solid]}).with_pairs(check=["it / one", "it / other", "one / other"])
    X, T = draw_state(random), np.eye(12)[None]
    every = np.arange(3)
    found = scene.distances(X, every, T)
    h = 1e-5
    steps = np.vstack([X + h * np.eye(12), X - h * np.eye(12)])
    around = scene.distances(steps, every, np.zeros((24, 12, 1))).values.reshape(2, 12, 3)
    right, left = (around[0] - found.values) / h, (found.values - around[1]) / h
    # coal's 1e-8 (cylinders, cones) over the step; elsewhere the formulas are as good as the step allows
    rough = 5e-3 if kind in ("Cylinder", "Cone") else 1e-6
    compared = 0
    for pair in range(3):
        # depths have several ways out; near contact a distance bends as much as a small ball
        if found.values[0, pair] < (0.02 if pair < 2 and kind in ("Cylinder", "Cone") else 1e-3):
            continue
        smooth = np.abs(right - left)[:, pair] < 1e-3
        bend = np.abs(right - left)[:, pair] + rough
        error = np.abs(0.5 * (right + left)[:, pair] - found.gradients[0, pair])
        assert np.all(error[smooth] <= bend[smooth]), (scene.pairs[pair].name, error, bend)
        compared += int(np.count_nonzero(smooth))
    if np.all(found.values > 0.05):
        assert compared >= 18


@given(seed=seeds)
def test_a_batch_is_its_members(seed: int) -> None:
    random = np.random.default_rng(seed)
    cables = tuple(draw_cable(random, name, bool(i % 2)) for i, name in enumerate("abc"))
    solids = {"body": [draw_solid(random, k, draw_pose(random, 0.4), k) for k in sorted(DRAW)],
              "platform": [draw_solid(random, "Box", draw_pose(random, 0.2), "plate")]}  # fmt: skip
    scene = make_scene(cables, solids)
    X = np.array([draw_state(random) for _ in range(5)])
    every = np.arange(len(scene.pairs))
    together = scene.distances(X, every, np.zeros((5, 12, 1))).values
    alone = np.vstack([scene.distances(x, every, np.zeros((1, 12, 1))).values for x in X])
    assert_allclose(together, alone, atol=1e-12)
    placed = scene._collision.place(kinematics().poses(X))
    assert np.all(scene._collision.lower_bounds(placed) <= together + np.where(together > 0, 1e-7, DEEP))
    assert_allclose(scene.clearances(X)[0], together.min(axis=1), atol=1e-12)
