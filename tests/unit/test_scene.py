"""A robot among obstacles: which pairs are checked, clearance, and its gradient through the closures."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import paraopt as po
from paraopt.shapes import Shape
from support import assert_derivative, finite_difference, five_bar_robot, raf_configurations, raf_robot

POSE = ("x", "y", "z", "alpha", "beta", "gamma")


def flyer(*shapes: Shape) -> po.Robot:
    """A body that is free in space; its motor turns nothing."""
    mechanism = po.Mechanism(
        "flyer",
        [po.Base(), po.Mobile("body"), po.Series("motor", "base", joint=po.Revolute("spin"))],
        (),
        active=("spin",),
        operational=POSE,
    )
    return po.Robot(mechanism, home=dict.fromkeys(POSE, 0.0), shapes={"body": shapes})


def obstacles() -> list[Shape]:
    """One of each kind about the RAF, near the ways of its parts."""
    return [
        po.Sphere(radius=0.04, pose=po.transform((0.16, 0.1, 0.52)), name="ball"),
        po.Cylinder(radius=0.03, length=0.4, pose=po.transform((-0.2, 0.15, 0.4), (0.2, 0.1, 0.0)), name="pillar"),
        po.Box(size=(0.08, 0.1, 0.3), pose=po.transform((0.25, -0.15, 0.35), (0.0, 0.3, 0.5)), name="crate"),
        po.Capsule(radius=0.02, length=0.3, pose=po.transform((0.0, 0.0, 0.75), (0.0, 1.2, 0.4)), name="bar"),
    ]


@functools.cache
def scene() -> po.Scene:
    return po.Scene(raf_robot(), obstacles())


@functools.cache
def states() -> np.ndarray:
    X = np.array([c.X for c in raf_configurations()])
    X.flags.writeable = False
    return X


@functools.cache
def every_distance() -> np.ndarray:
    """Measure every pair at every state: brute force."""
    X = states()
    T = po.MotionSpace(raf_robot().kinematics).tangent(X)
    return scene().distances(X, np.arange(len(scene().pairs)), T).values


# --- Which pairs


def table(scene: po.Scene) -> dict[str, str]:
    """Give for every pair of bodies "checked", or why not."""
    rows = {p.name: "checked" for p in scene.pairs} | {s.name: s.reason for s in scene.skipped_pairs}
    assert len(rows) == len(scene.pairs) + len(scene.skipped_pairs)
    return rows


def test_every_pair_is_checked_or_told_why_not() -> None:
    rows, n = table(scene()), len(scene().bodies)
    assert len(rows) == n * (n - 1) // 2
    for name, reason in {
        "base plate / jack 1": "joined by a joint",
        "jack 2 / rod 2": "joined by a joint",
        "rod 3 / platform": "joined by a closure",
        "arm A / arm A fork": "both on 'arm A'",
        "platform / tool": "both on 'platform'",
        "base plate / pillar": "neither moves",
        "ball / bar": "both on 'world'",
    }.items():
        assert rows[name] == reason
    # links without solids are bridged: the cross of the cardan, and the fork at the platform
    for name, through in (
        ("arm A / forearm A+", "cross A+"),
        ("forearm B- / platform", "fork B-"),
        ("arm B fork / forearm B-", "cross B-"),
    ):
        assert f"{through!r}, which has no solid" in rows[name]
    for name in (
        "jack 1 / jack 2", "rod 1 / arm A", "base plate / rod 1", "base plate / forearm A+", "arm A / platform",
        "forearm A+ / forearm B-", "forearm A+ / forearm A-", "tool / crate", "rod 2 / ball", "base plate / platform",
    ):  # fmt: skip
        assert rows[name] == "checked"


def test_obstacles_are_checked_against_everything_that_moves() -> None:
    external = [p.name for p in scene().pairs if p.is_external]
    moving = [b for b in scene().bodies if b.link not in ("base", "world")]
    assert sorted(external) == sorted(f"{b.name} / {o.name}" for b in moving for o in obstacles())


def test_table_tells_what_is_checked() -> None:
    text = scene().describe_pairs().splitlines()
    assert len(text) == len(scene().pairs) + len(scene().skipped_pairs)
    assert "checked  tool / ball  (obstacle)" in text
    assert "checked  jack 1 / jack 2" in text
    assert "skipped  base plate / jack 1: joined by a joint" in text


def legs(spread: float, **parts: Any) -> po.Robot:
    """Two legs on a bare base, some distance apart, that hold a bare point."""
    mechanism = po.Mechanism(
        "legs",
        [
            po.Base(),
            po.Series("left", "base", (0, 0), po.Revolute("a")),
            po.Series("right", "base", (spread, 0), po.Revolute("b")),
            po.Mobile("tip", ("x", "y")),
        ],
        [po.Coincidence("left", (1, 0), "tip", (0, 0))],
        active=("a", "b"),
        operational=("x", "y"),
        planar=True,
    )
    rods = {name: [po.Capsule.between((0, 0, 0), (1, 0, 0), 0.05)] for name in ("left", "right")}
    return po.Robot(mechanism, {"x": 0.6, "y": 0.8}, shapes=rods | parts.pop("shapes", {}), **parts)


def test_a_bare_base_does_not_join_legs_that_stand_apart() -> None:
    assert table(po.Scene(legs(3.0)))["left / right"] == "checked"
    assert "'base', which has no solid" in table(po.Scene(legs(0.0)))["left / right"]
    # nor does a base with a solid
    ground = {"base": [po.Box(size=(4, 4, 0.1), pose=po.transform((0, 0, -1)))]}
    assert table(po.Scene(legs(0.0, shapes=ground)))["left / right"] == "checked"


def test_declared_contacts_are_left_out_in_either_order() -> None:
    for pair in (("left", "right"), ("right", "left")):
        rows = table(po.Scene(legs(3.0, contacts={pair: "they lean on each other"})))
        assert rows["left / right"] == "declared: they lean on each other"


def test_a_robot_whose_bars_may_all_touch_has_nothing_to_check() -> None:
    pairs = (("proximal 1", "proximal 2"), ("distal 1", "proximal 2"), ("distal 2", "proximal 1"))
    robot = dataclasses.replace(five_bar_robot(), contacts=dict.fromkeys(pairs, "bars run on different levels"))
    alone = po.Scene(robot)
    home = robot.home_configuration
    assert alone.pairs == ()
    with pytest.raises(po.DefinitionError, match="'five-bar' has no pair to check"):
        alone.clearance(home)
    values, which = alone.clearances(np.stack([home.X, home.X]))
    assert_array_equal(values, [np.inf, np.inf])
    assert_array_equal(which, [-1, -1])
    assert_array_equal(alone.too_close(home.X, 1.0), [-1])
    assert alone.near_pairs(home.X, 1.0).size == 0
    # an obstacle is checked against all four bars
    assert len(po.Scene(robot, [po.Sphere(radius=1.0)]).pairs) == 4


# --- Refused


@pytest.mark.parametrize("obstacle", ["box", None, 1.0, np.eye(4)])
def test_obstacles_that_are_no_shapes_are_refused(obstacle: Any) -> None:
    with pytest.raises(po.DefinitionError, match="is not a shape"):
        po.Scene(flyer(), [po.Sphere(radius=1.0), obstacle])


def test_doubled_names_are_refused() -> None:
    ball = po.Sphere(radius=1.0, name="ball")
    with pytest.raises(po.DefinitionError, match=r"\['ball'\] appear twice"):
        po.Scene(flyer(), [ball, ball])
    with pytest.raises(po.DefinitionError, match=r"\['ball'\] appear twice"):
        po.Scene(flyer(ball), [ball])
    # those without a name are numbered
    assert [b.name for b in po.Scene(flyer(), [po.Sphere(radius=1.0)] * 2).bodies] == ["obstacle 1", "obstacle 2"]


@pytest.mark.parametrize("given", [[Shape(name="thing")], po.Sphere(radius=1.0)], ids=["bare shape", "no list"])
def test_obstacles_that_cannot_be_measured_are_refused_at_once(given: Any) -> None:
    with pytest.raises(po.DefinitionError):
        po.Scene(flyer(), given)


def test_a_bare_shape_is_refused_when_measured() -> None:
    robot = flyer(po.Sphere(radius=0.1))
    with pytest.raises(po.DefinitionError, match="shape 'thing' cannot be checked"):
        po.Scene(robot, [Shape(name="thing")]).clearance(robot.home_configuration)


def test_a_scene_is_frozen() -> None:
    given = obstacles()
    made = po.Scene(raf_robot(), given)
    given.clear()
    assert len(made.obstacles) == 4
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.robot = None  # type: ignore[misc]


# --- Distances through the poses of the links


def configuration(robot: po.Robot, *pose: float) -> po.Configuration:
    return robot.kinematics.configuration([0.0, *pose])


@pytest.mark.parametrize(
    ("pose", "expected"),
    [((3, 0, 0, 0, 0, 0), 1.5), ((0, 1, 2, 0, 0, 0), np.hypot(1, 2) - 1.5), ((1.5, 0, 0, 0.3, 0.2, 0.1), 0.0),
     ((1, 0, 0, 0, 0, 0), -0.5)],
)  # fmt: skip
def test_a_flying_ball(pose: tuple[float, ...], expected: float) -> None:
    robot = flyer(po.Sphere(radius=0.5))
    clearance = po.Scene(robot, [po.Sphere(radius=1.0, name="rock")]).clearance(configuration(robot, *pose))
    assert clearance.distance == pytest.approx(expected, abs=1e-12)
    assert clearance.pair == "body / rock"
    away = np.array(pose[:3]) / np.linalg.norm(pose[:3])
    # from the body to the rock; the body gains by moving away
    assert_allclose(clearance.normal, -away, atol=1e-12)
    assert_allclose(clearance.gradient, [*away, 0, 0, 0], atol=1e-12)
    assert_allclose(clearance.points[1], away, atol=1e-12)
    assert_allclose(clearance.points[1] - clearance.points[0], clearance.distance * clearance.normal, atol=1e-12)


def test_placement_on_the_link_and_in_the_world() -> None:
    """A ball on an arm of 2 that turns about z, in front of a box that is turned itself."""
    robot = flyer(po.Sphere(radius=0.1, pose=po.transform((2, 0, 0))))
    wall = po.Box(size=(2, 0.2, 2), pose=po.transform((0, 5, 0), (0, 0, np.pi)))
    clearance = po.Scene(robot, [wall]).clearance(configuration(robot, 0, 1, 0, 0, 0, np.pi / 2))
    assert clearance.distance == pytest.approx(5 - 0.1 - (1 + 2 + 0.1), abs=1e-9)
    # turning moves the ball along the wall
    assert_allclose(clearance.gradient, [0, -1, 0, 0, 0, 0], atol=1e-7)
    assert_allclose(clearance.points[0], (0, 3.1, 0), atol=1e-7)


def test_two_bodies_of_one_robot() -> None:
    """A gradient counts the motion of both bodies; here both legs turn."""
    robot = legs(3.0)
    kinematics = robot.kinematics
    values = {"a": 0.9, "b": 2.0, "x": np.cos(0.9), "y": np.sin(0.9)}
    X = np.array([values[n] for n in robot.mechanism.names])
    T = kinematics.tangent(X, ("a", "b"))
    found = po.Scene(robot).distances(X, np.array([0]), T)

    def distance(angles: np.ndarray) -> float:
        a, b = angles
        p, q = np.array([np.cos(a), np.sin(a)]), np.array([3 + np.cos(b), np.sin(b)])
        return float(np.linalg.norm(p - q)) - 0.1  # the tips are nearest

    assert found.values[0, 0] == pytest.approx(distance(np.array([0.9, 2.0])), abs=1e-9)
    assert_derivative(found.gradients[0, 0], distance, np.array([0.9, 2.0]), tolerance=1e-7)


# --- The RAF among obstacles of every kind


def test_smallest_is_that_of_all_pairs() -> None:
    values, which = scene().clearances(states())
    every = every_distance()
    assert_array_equal(values, every.min(axis=1))
    assert_array_equal(every[np.arange(len(every)), which], values)
    assert len(set(which.tolist())) > 2  # different pairs come into it
    for i, c in enumerate(raf_configurations()[:3]):
        clearance = scene().clearance(c)
        assert clearance.distance == values[i]
        assert clearance.pair == scene().pairs[which[i]].name
        assert_allclose(clearance.points[1] - clearance.points[0], clearance.distance * clearance.normal, atol=1e-12)


@pytest.mark.parametrize("horizon", [0.0, 0.02, 0.1, 0.5])
def test_near_pairs_are_those_within_the_horizon(horizon: float) -> None:
    assert_array_equal(scene().near_pairs(states(), horizon), np.flatnonzero((every_distance() < horizon).any(axis=0)))


@pytest.mark.parametrize("margin", [0.0, 0.01, 0.03, 0.2])
def test_too_close_names_a_pair_that_is(margin: float) -> None:
    which, every = scene().too_close(states(), margin), every_distance()
    assert_array_equal(which >= 0, (every < margin).any(axis=1))
    for i in np.flatnonzero(which >= 0):
        assert every[i, which[i]] < margin


def test_single_states_and_batches_agree() -> None:
    values, which = scene().clearances(states())
    for i, X in enumerate(states()):
        one, pair = scene().clearances(X)
        assert (one[0], pair[0]) == (values[i], which[i])


POSES = [0, 1, 4, 7]


@pytest.mark.parametrize("name", ["ball", "pillar", "crate", "bar"])
@pytest.mark.parametrize("which", POSES)
def test_gradients_to_every_kind_of_obstacle(name: str, which: int) -> None:
    """Against finite differences of distances at solved poses, for every body of the robot, away from kinks."""
    here = raf_configurations()[which]
    pairs = np.array([i for i, p in enumerate(scene().pairs) if p.name.endswith(f"/ {name}")])
    check_gradients(here, pairs, kinks=0.25)


@pytest.mark.parametrize("which", POSES)
def test_gradients_within_the_robot(which: int) -> None:
    pairs = np.array([i for i, p in enumerate(scene().pairs) if not p.is_external])
    check_gradients(raf_configurations()[which], pairs, kinks=0.25)


def check_gradients(here: po.Configuration, pairs: np.ndarray, kinks: float) -> None:
    kinematics = raf_robot().kinematics
    T = po.MotionSpace(kinematics).tangent(here.X)

    def distances(x: np.ndarray) -> np.ndarray:
        there = kinematics.inverse(dict(zip("xyz", x.tolist(), strict=True)), here).configuration
        return scene().distances(there.X, pairs, T).values[0]

    claimed = scene().distances(here.X, pairs, T).gradients[0]
    wide, narrow = (finite_difference(distances, here.operational, h) for h in (1e-3, 5e-4))
    # two steps differ where an edge or the end of a segment takes over between the points, whatever is claimed
    smooth = np.all(np.abs(wide - narrow) < 1e-4, axis=1)
    assert smooth.mean() >= 1 - kinks
    # distances are known to some 1e-8, which a step of 1e-3 turns into 1e-5
    assert_allclose(claimed[smooth], wide[smooth], atol=1e-4)
    assert np.abs(claimed[smooth]).max() > 0.5


def test_gradients_in_penetration_show_the_way_out() -> None:
    robot = flyer(po.Box(size=(0.4, 0.4, 0.4)))
    inside = po.Scene(robot, [po.Box(size=(2.0, 2.0, 2.0), name="block")])
    here = configuration(robot, 0.9, 0.1, -0.2, 0.05, 0.1, 0.3)
    clearance = inside.clearance(here)
    assert clearance.distance < -0.2

    def distance(pose: np.ndarray) -> float:
        return float(inside.clearances(np.array([0.0, *pose]))[0][0])

    assert_derivative(clearance.gradient, distance, here.operational, step=1e-3, tolerance=1e-4)
    # a step along the gradient comes out by as much
    step = 0.01 * clearance.gradient / np.linalg.norm(clearance.gradient)
    gain = distance(here.operational + step) - clearance.distance
    assert gain == pytest.approx(0.01 * np.linalg.norm(clearance.gradient), rel=0.05)


KINDS: dict[str, Callable[[], Shape]] = {
    "sphere": lambda: po.Sphere(radius=0.2),
    "box": lambda: po.Box(size=(0.2, 0.3, 0.4)),
    "cylinder": lambda: po.Cylinder(radius=0.15, length=0.5),
    "capsule": lambda: po.Capsule(radius=0.15, length=0.5),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_a_flying_solid_among_obstacles(kind: str, seed: int) -> None:
    """The gradient of the smallest distance with respect to all six coordinates of a pose."""
    robot = flyer(KINDS[kind]())
    around = po.Scene(robot, [
        po.Sphere(radius=0.3, pose=po.transform((1.5, 0, 0))),
        po.Box(size=(0.4, 0.5, 0.6), pose=po.transform((0, 1.5, 0), (0.3, 0.2, 0.1))),
        po.Cylinder(radius=0.2, length=0.8, pose=po.transform((0, 0, 1.5), (1.0, 0.2, 0.1))),
        po.Capsule(radius=0.2, length=0.8, pose=po.transform((-1.5, 0, 0), (0.5, 0.2, 0.1))),
    ])  # fmt: skip
    pose = np.random.default_rng(seed).uniform(-0.3, 0.3, 6)
    T = po.MotionSpace(robot.kinematics).tangent(np.array([0.0, *pose]))
    pairs = np.arange(4)
    found = around.distances(np.array([0.0, *pose]), pairs, T)

    def distances(values: np.ndarray) -> np.ndarray:
        return around.distances(np.array([0.0, *values]), pairs, T).values[0]

    wide, narrow = (finite_difference(distances, pose, h) for h in (1e-3, 5e-4))
    smooth = np.all(np.abs(wide - narrow) < 1e-4, axis=1)
    assert smooth.sum() >= 3
    assert_allclose(found.gradients[0, smooth], wide[smooth], atol=1e-4)
