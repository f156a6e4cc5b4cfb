"""Cables between links: pose and length that follow, what is left out at the ends, distances and gradients."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from gantry import gantry, limits
from paraopt.scene import Cable
from paraopt.scene.cable import shorten_segments
from paraopt.scene.ends import holds
from paraopt.shapes import Cone, ConvexPolyhedron, HalfSpace, Mesh, Shape
from support import assert_derivative

POSE = ("x", "y", "z", "alpha", "beta", "gamma")
Array = np.ndarray


def flyer(*shapes: Shape) -> po.Robot:
    """A platform that is free in space, held by nothing that is modelled."""
    mechanism = po.Mechanism(
        "flyer",
        [po.Base(), po.Mobile("platform"), po.Series("motor", "base", joint=po.Revolute("spin"))],
        (),
        active=("spin",),
        operational=POSE,
    )
    return po.Robot(mechanism, home=dict.fromkeys(POSE, 0.0), shapes={"platform": shapes})


def cable(**changes: Any) -> Cable:
    given = {"link_A": "base", "point_A": (0, 0, 2), "link_B": "platform", "point_B": (0.1, 0, 0), "radius": 0.01}
    return Cable(**given | {"name": "rope"} | changes)


def state(*pose: float) -> Array:
    return np.array([0.0, *pose])


# --- Refused


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius": 0.0}, "radius of cable 'rope' is 0 m"),
        ({"radius": -1.0}, "radius of cable 'rope'"),
        ({"radius": np.nan}, "radius of cable 'rope'"),
        ({"radius": "thin"}, "radius of cable 'rope'"),
        ({"ignore": (0.1, -0.1)}, "ignored length of cable 'rope'"),
        ({"ignore": (0.1, np.inf)}, "ignored length of cable 'rope'"),
        ({"ignore": 0.1}, "ignore of cable 'rope' is 0.1; it must be two lengths"),
        ({"point_A": (0, 0, np.nan)}, "point_A of cable 'rope'"),
        ({"point_B": (0, 0, 0, 0)}, "point_B of cable 'rope'"),
        ({"link_A": 3}, "link_A of a cable is 3"),
        ({"link_B": "base", "point_B": (0, 0, 2)}, "begins and ends at one point of 'base'"),
    ],
)
def test_bad_cables_are_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        cable(**changes)


def test_scenes_refuse_what_is_no_cable() -> None:
    with pytest.raises(po.DefinitionError, match="each must be a Cable"):
        po.Scene(flyer(), cables=["rope"])  # type: ignore[list-item]
    with pytest.raises(po.DefinitionError, match="must be a list of Cable"):
        po.Scene(flyer(), cables=cable())  # type: ignore[arg-type]
    with pytest.raises(po.UnknownNameError, match="link at an end of cable 'rope': 'plateform'"):
        po.Scene(flyer(), cables=[cable(link_B="plateform")])
    with pytest.raises(po.DefinitionError, match="appear twice"):
        po.Scene(flyer(), cables=[cable(), cable(point_A=(1, 0, 2))])


# --- Which pairs


def table(scene: po.Scene) -> dict[str, str]:
    return {p.name: "checked" for p in scene.pairs} | {s.name: s.reason for s in scene.skipped_pairs}


def test_pairs_of_cables() -> None:
    robot = flyer(po.Box(size=(0.2, 0.2, 0.1), name="plate"))
    ropes = [
        cable(name="one"),
        cable(name="two", point_B=(0.1, 0, 0.001), point_A=(1, 0, 2)),
        cable(name="far", point_A=(0, 1, 2), point_B=(-0.1, 0, 0), ignore=(0.0, 0.05)),
        cable(name="stay", link_B="base", point_B=(0, 3, 0)),
    ]
    rows = table(po.Scene(robot, [po.Sphere(radius=0.1, name="rock")], ropes))
    assert rows["plate / one"] == "the cable ends on 'plate'"
    assert rows["plate / far"] == "checked"  # its end is left out
    assert rows["one / two"] == "both end at one place of 'platform'"
    assert rows["one / far"] == "checked"
    assert rows["rock / one"] == "checked"
    assert rows["rock / stay"] == "neither moves"
    assert rows["plate / stay"] == rows["one / stay"].replace("both end at one place of 'base'", "checked") == "checked"


def test_solids_of_the_link_that_do_not_hold_the_end_are_checked() -> None:
    """A plate that hangs below the bar to which the cable is tied."""
    bar = po.Capsule.between((-0.1, 0, 0), (0.1, 0, 0), 0.02, "bar")
    plate = po.Box(size=(0.2, 0.2, 0.02), pose=po.transform((0, 0, -0.1)), name="plate")
    scene = po.Scene(flyer(bar, plate), cables=[cable()])
    rows = table(scene)
    assert rows == {
        "bar / rope": "the cable ends on 'bar'",
        "plate / rope": "checked",
        "bar / plate": "both on 'platform'",
    }
    upright = scene.robot.kinematics.configuration(state(0, 0, 0, 0, 0, 0))
    assert scene.clearance(upright).distance == pytest.approx(0.1 - 0.01 - 0.01, abs=1e-9)
    # upside down the cable has to pass through the plate
    folded = scene.robot.kinematics.configuration(state(0, 0, 0, np.pi, 0, 0))
    assert scene.clearance(folded).distance < 0
    assert "collision with the robot itself: plate / rope" in scene.clearance(folded).describe()


def test_what_is_ignored_decides_about_the_solid_at_the_end() -> None:
    eye = po.Sphere(radius=0.03, pose=po.transform((0.1, 0, 0)), name="eye")
    for ignored, told in (
        (0.0, "the cable ends on 'eye'"),
        (0.02, "checked"),  # shorter than the eye's radius: it begins inside
        (0.05, "'eye' lies within the length that is ignored at the cable's end"),
    ):
        scene = po.Scene(flyer(eye), cables=[cable(ignore=(0.0, ignored))])
        assert table(scene)["eye / rope"] == told
        forced = scene.with_pairs(check=["eye / rope"])
        found = forced.clearance(forced.robot.kinematics.configuration(state(0, 0, 0, 0, 0, 0)))
        assert found.distance == pytest.approx(ignored - 0.03 - 0.01, abs=1e-9)


def test_an_end_on_a_pulley_is_on_the_frame_that_holds_it() -> None:
    """Its motor's link turns at the exit; the frame's ring round the exit does not count, its far beam does."""
    ring = po.Sphere(radius=0.05, pose=po.transform((0, 0, 2)), name="ring")
    beam = po.Capsule.between((0.5, -1, 1), (0.5, 1, 1), 0.05, "beam")
    mechanism = po.Mechanism(
        "winch",
        [po.Base(), po.Mobile("platform"), po.Series("motor", "base", at=(0, 0, 2), joint=po.Revolute("spin"))],
        (), active=("spin",), operational=POSE,
    )  # fmt: skip
    ropes = [cable(link_A="motor", point_A=(0, 0, 0)), cable(name="other", point_B=(-0.1, 0, 0))]
    robot = po.Robot(mechanism, home=dict.fromkeys(POSE, 0.0), shapes={"base": [ring, beam]}, cables=ropes)
    rows = table(po.Scene(robot))
    assert rows["ring / rope"] == rows["ring / other"] == "the cable ends on 'ring'"
    assert rows["beam / rope"] == rows["beam / other"] == "checked"
    assert rows["rope / other"] == "both end at one place of 'motor'"


def test_cables_from_one_exit_do_not_touch_there() -> None:
    """Whatever is ignored, and however small the angle between them."""
    ropes = [cable(point_B=(0.02, 0, 0)), cable(name="other", point_B=(-0.02, 0, 0))]
    for ignored in (0.0, 0.1):
        scene = po.Scene(flyer(), cables=[dataclasses.replace(r, ignore=(ignored, 0.0)) for r in ropes])
        assert table(scene) == {"rope / other": "both end at one place of 'base'"}
        forced = scene.with_pairs(check=["rope / other"])
        assert forced.clearances(state(0, 0, 0, 0, 0, 0))[0][0] < 0
    # from exits that are farther apart than the cables are thick they count
    apart = po.Scene(flyer(), cables=[ropes[0], dataclasses.replace(ropes[1], point_A=(0.021, 0, 2))])
    assert table(apart) == {"rope / other": "checked"}


def two_cubes() -> Mesh:
    """A mesh of two unit cubes, at x = 0 and at x = 3."""
    hulls = [ConvexPolyhedron(vertices=np.array(list(itertools.product((d, d + 1), (0, 1), (0, 1))))).hull
             for d in (0, 3)]  # fmt: skip
    corners = np.vstack([h.vertices for h in hulls])
    triangles = np.vstack([h.triangles + 8 * i for i, h in enumerate(hulls)])
    return Mesh(vertices=corners, triangles=triangles, parts=[h.vertices for h in hulls])


HOLDERS = {
    "box": (po.Box(size=(0.2, 0.4, 0.6)), [(0.1, 0, 0), (0.11, 0.2, 0.3)], [(0.12, 0, 0), (0.11, 0.21, 0.3)]),
    "sphere": (po.Sphere(radius=0.3), [(0.31, 0, 0), (0, 0, 0)], [(0.2, 0.2, 0.2)]),
    "cylinder": (po.Cylinder(radius=0.1, length=0.4), [(0.11, 0, 0), (0, 0, 0.21)], [(0.1, 0.1, 0), (0, 0.11, 0.21)]),
    "capsule": (po.Capsule(radius=0.1, length=0.4), [(0, 0, 0.31), (0.11, 0, 0.2)], [(0, 0, 0.32), (0.1, 0, 0.3)]),
    "cone": (Cone(radius=0.3, length=0.4), [(0, 0, -0.21), (0.15, 0, 0), (0, 0, 0.2)], [(0.17, 0, 0), (0, 0, 0.23)]),
    "half-space": (HalfSpace(), [(5, 5, 0.01), (0, 0, -3)], [(0, 0, 0.011)]),
    "polyhedron": (
        ConvexPolyhedron(vertices=0.5 * np.vstack([np.eye(3), -np.eye(3)])),
        [(0.5, 0, 0), (0.17, 0.17, 0.17)], [(0.18, 0.18, 0.18), (0.52, 0, 0)],
    ),
    "mesh": (
        two_cubes(),
        [(0, 0, 0.5), (3.5, 1, 1)], [(2, 0.5, 0.5), (1.1, 0, 0)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", HOLDERS)
def test_which_points_a_solid_holds(kind: str) -> None:
    solid, held, free = HOLDERS[kind]
    X = po.transform((0.3, -0.2, 0.7), (0.4, 0.2, 1.0))
    moved = dataclasses.replace(solid, pose=X)
    for points, told in ((held, True), (free, False)):
        for point in points:
            assert holds(solid, point, 0.0101) is told, point
            assert holds(moved, X[:3, :3] @ point + X[:3, 3], 0.0101) is told, point


def test_a_scene_takes_the_cables_of_its_robot() -> None:
    plate = po.Box(size=(0.2, 0.2, 0.1), name="plate")
    robot = dataclasses.replace(flyer(plate), cables=[cable()])
    hose = cable(name="hose", point_A=(0, 1, 2), point_B=(0, 0.1, 0))
    scene = po.Scene(robot, [po.Sphere(radius=0.1, name="rock")], [hose])
    assert [b.name for b in scene.bodies] == ["plate", "rock", "rope", "hose"]
    assert scene.cables == (hose,)
    assert [c.name for c in scene.all_cables] == ["rope", "hose"]
    # a table of pairs keeps both, once
    changed = scene.with_pairs(skip=["rope / hose"])
    assert [b.name for b in changed.bodies] == [b.name for b in scene.bodies]
    by_hand = po.Scene(flyer(plate), [po.Sphere(radius=0.1, name="rock")], [cable(), hose])
    X = np.column_stack([np.zeros(20), np.random.default_rng(0).uniform(-0.5, 0.5, (20, 6))])
    assert_allclose(scene.clearances(X)[0], by_hand.clearances(X)[0], atol=0)
    T = po.MotionSpace(robot.kinematics).tangent(X)
    every = np.arange(len(scene.pairs))
    assert_allclose(scene.distances(X, every, T).gradients, by_hand.distances(X, every, T).gradients, atol=0)
    with pytest.raises(po.DefinitionError, match=r"'rope'.* appear twice"):
        po.Scene(robot, cables=[cable()])


# --- Distances


def test_it_follows_the_platform() -> None:
    """A cable from (0, 0, 2) to the platform's origin; a ball beside it."""
    scene = po.Scene(flyer(), [po.Sphere(radius=0.2, pose=po.transform((1.0, 0, 1.0)), name="ball")],
                     [cable(point_B=(0, 0, 0))])  # fmt: skip
    configuration = scene.robot.kinematics.configuration(state(0, 0, 0, 0, 0, 0))
    found = scene.clearance(configuration)
    assert found.pair == "ball / rope"
    assert found.is_external
    assert found.distance == pytest.approx(1.0 - 0.2 - 0.01, abs=1e-9)
    assert_allclose(found.normal, (-1, 0, 0), atol=1e-9)
    assert_allclose(found.points, [(0.8, 0, 1), (0.01, 0, 1)], atol=1e-9)
    # moving the lower end by dx moves the middle by half of it
    assert_allclose(found.gradient, (-0.5, 0, 0, 0, 0, 0), atol=1e-7)
    # half as long: the ball is now beside its end
    shorter = scene.robot.kinematics.configuration(state(0, 0, 1.5, 0, 0, 0))
    assert scene.clearance(shorter).distance == pytest.approx(np.hypot(1.0, 0.5) - 0.21, abs=1e-9)
    # stretched beyond it
    longer = scene.robot.kinematics.configuration(state(0, 0, -7, 0, 0, 0))
    assert scene.clearance(longer).distance == pytest.approx(0.79, abs=1e-9)


OTHERS: dict[str, Shape] = {
    "box": po.Box(size=(0.3, 0.2, 0.4), pose=po.transform((0.35, 0.1, 1.0), (0.3, 0.2, 0.1)), name="it"),
    "sphere": po.Sphere(radius=0.2, pose=po.transform((0.5, 0.1, 1.0)), name="it"),
    "cylinder": po.Cylinder(radius=0.1, length=0.5, pose=po.transform((0.4, 0.1, 1.0), (0.9, 0.2, 0.1)), name="it"),
    "capsule": po.Capsule(radius=0.1, length=0.5, pose=po.transform((0.5, 0.1, 1.0), (0.9, 0.2, 0.1)), name="it"),
    "cone": Cone(radius=0.2, length=0.5, pose=po.transform((0.5, 0.1, 1.0), (0.9, 0.2, 0.1)), name="it"),
    "polyhedron": ConvexPolyhedron(
        vertices=0.3 * np.random.default_rng(1).normal(size=(12, 3)), pose=po.transform((0.9, 0.1, 1.2)), name="it"
    ),
    "half-space": HalfSpace.behind((0, 0, -0.3), (0.1, 0.2, 1.0), name="it"),
}


@pytest.mark.parametrize("kind", OTHERS)
@pytest.mark.parametrize("ignore", [(0.0, 0.0), (0.7, 0.2), (0.2, 0.9)])
def test_a_cable_is_a_capsule_of_the_same_ends(kind: str, ignore: tuple[float, float]) -> None:
    """Against the fixed capsule that coal measures, and with the gradient by finite differences."""
    robot = flyer()
    scene = po.Scene(robot, [OTHERS[kind]], [cable(ignore=ignore)])
    assert [p.name for p in scene.pairs] == ["it / rope"]
    pair, random = np.zeros(1, dtype=int), np.random.default_rng(0)
    smooth = 0
    for _ in range(12):
        X = state(*random.uniform(-0.3, 0.3, 3), *random.uniform(-0.5, 0.5, 3))
        T = po.MotionSpace(robot.kinematics).tangent(X)
        found = scene.distances(X, pair, T)
        A, B = np.array([0.0, 0, 2]), (robot.kinematics.poses(X)[0, 1] @ [0.1, 0, 0, 1])[:3]
        ends = shorten_segments(A, B, np.array(ignore))
        fixed = po.Capsule.between(ends[0], ends[1], 0.01, "rod")
        other = po.Scene(flyer(fixed), [OTHERS[kind]])
        still = other.distances(np.zeros(7), pair, np.zeros((1, 7, 6)))
        # the platform of the other scene stands in the world's origin
        assert found.values[0, 0] == pytest.approx(still.values[0, 0], abs=1e-7)

        def distance(pose: Array, T: Array = T) -> float:
            return float(scene.distances(state(*pose), pair, T).values[0, 0])

        pose = X[1:]
        steps = [np.array([(distance(pose + h * e) - distance(pose - h * e)) / (2 * h) for e in np.eye(6)])
                 for h in (1e-3, 5e-4)]  # fmt: skip
        if np.allclose(*steps, atol=1e-4):  # no kink between
            smooth += 1
            assert_allclose(found.gradients[0, 0], steps[1], atol=2e-4)
    assert smooth >= 8


def test_cables_near_each_other() -> None:
    """One upright, one that crosses it at a distance that the platform's y decides."""
    ropes = [cable(point_B=(0, 0, 0)), cable(name="other", link_B="base", point_A=(-1, 1, 1), point_B=(1, 1, 1))]
    scene = po.Scene(flyer(), cables=ropes)
    T = po.MotionSpace(scene.robot.kinematics).tangent(state(0, 0, 0, 0, 0, 0))
    found = scene.distances(state(0, 0, 0, 0, 0, 0), np.zeros(1, dtype=int), T)
    assert found.values[0, 0] == pytest.approx(1.0 - 0.02, abs=1e-9)
    assert_allclose(found.gradients[0, 0], (0, -0.5, 0, 0, 0, 0), atol=1e-7)
    # they cross: the distance is minus the sum of the radii, and there is a direction
    crossing = scene.robot.kinematics.configuration(state(0, 2, 0, 0, 0, 0))
    clearance = scene.clearance(crossing)
    assert clearance.distance == pytest.approx(-0.02, abs=1e-9)
    # normal to both: to (0, 2, -2) and to x
    assert_allclose(np.abs(clearance.normal), np.array([0, 1, 1]) / np.sqrt(2), atol=1e-6)
    assert "collision with the robot itself" in clearance.describe()


def test_shorter_than_what_is_left_out_it_is_a_ball_between() -> None:
    A, B = np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 0.3]])
    ends = shorten_segments(A, B, np.array([[0.2, 0.4]]))
    assert_allclose(ends[0], [(0, 0, 0.1)] * 2, atol=1e-15)
    assert_allclose(shorten_segments(A, A, np.array([[0.2, 0.4]]))[0], 0.0, atol=0)
    assert_allclose(shorten_segments(A, B, np.array([[0.1, 0.05]]))[0], [(0, 0, 0.1), (0, 0, 0.25)], atol=1e-15)
    scene = po.Scene(flyer(), [po.Sphere(radius=0.5, pose=po.transform((1, 0, 0)))],
                     [cable(point_A=(0, 0, 0), point_B=(0, 0, 0), ignore=(1.0, 1.0))])  # fmt: skip
    pose = np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0])
    T = po.MotionSpace(scene.robot.kinematics).tangent(state(*pose))
    pair = np.zeros(1, dtype=int)
    found = scene.distances(state(*pose), pair, T)
    middle = 0.5 * pose[:3]
    assert found.values[0, 0] == pytest.approx(np.linalg.norm(middle - (1, 0, 0)) - 0.51, abs=1e-9)
    assert_derivative(
        found.gradients[0, 0], lambda p: scene.distances(state(*p), pair, T).values[0, 0], pose, tolerance=1e-6
    )
    # of no length at all
    nothing = scene.distances(state(0, 0, 0, 0, 0, 0), pair, T)
    assert nothing.values[0, 0] == pytest.approx(0.49, abs=1e-9)
    assert np.all(np.isfinite(nothing.gradients))


def test_batches_and_bounds() -> None:
    scene = po.Scene(flyer(), [OTHERS["box"], po.Sphere(radius=0.1, name="ball")], [cable()])
    random = np.random.default_rng(2)
    X = np.column_stack([np.zeros(40), random.uniform(-0.5, 0.5, (40, 6))])
    values, which = scene.clearances(X)
    every = scene.distances(X, np.arange(len(scene.pairs)), np.zeros((40, 7, 6))).values
    assert_allclose(values, every.min(axis=1), atol=1e-9)
    assert_allclose(every[np.arange(40), which], values, atol=0)
    placed = scene._collision.place(scene.robot.kinematics.poses(X))
    assert np.all(scene._collision.lower_bounds(placed) <= every + 1e-7)
    for i in range(40):
        assert scene.clearances(X[i])[0][0] == pytest.approx(values[i], abs=1e-9)
    near = scene.too_close(X, 0.1)
    assert np.array_equal(near >= 0, values < 0.1)


# --- In a plan


def test_a_plan_leads_a_rope_round_a_hose() -> None:
    """Both are thin: a rope that passed through the hose would be in contact for two millimetres of the way only."""
    rope = cable(point_B=(0, 0, 0), link_B="block", radius=0.001)
    hose = cable(name="hose", point_A=(0, -1, 1), link_B="base", point_B=(0, 0.2, 1), radius=0.001)
    position = {"x": (-1.0, 1.0), "y": (-1.0, 1.0), "z": (-0.5, 0.5)}
    bounds = dataclasses.replace(limits(), position=position)
    robot = dataclasses.replace(gantry(), cables=[rope, hose], limits=bounds)
    ends = ({"x": x, "y": 0.0, "z": 0.0} for x in (-0.5, 0.5))
    plan = po.plan(po.Problem(po.Scene(robot), *ends, margins=po.Margins(clearance=0.01)))
    assert plan.certificate.passed
    x, y, z = plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 4001))[:, -3:].T
    crossings = np.flatnonzero(x[1:] * x[:-1] <= 0.0)
    assert crossings.size
    # where the block crosses the plane of the hose, the rope is at the height of the hose beyond its end
    for k in crossings:
        assert y[k] / (2.0 - z[k]) > 0.2 + 0.01
