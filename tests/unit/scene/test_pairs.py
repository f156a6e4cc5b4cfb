"""The table of pairs: what a person changes, what sampling leaves out, and internal and external clearance."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

import paraopt as po
from paraopt.scene.pairs import find_rigid_groups
from paraopt.scene.reach import walk_configurations
from support import five_bar_robot, raf_configurations, raf_robot


def table(scene: po.Scene) -> dict[str, str]:
    return {p.name: "checked" for p in scene.pairs} | {s.name: s.reason for s in scene.skipped_pairs}


@functools.cache
def scene() -> po.Scene:
    ball = po.Sphere(radius=0.03, pose=po.transform((0.16, 0.1, 0.52)), name="ball")
    return po.Scene(raf_robot(), [ball])


# --- By hand


def test_pairs_are_skipped_and_checked_by_hand() -> None:
    before = table(scene())
    changed = scene().with_pairs(skip={("jack 1", "jack 2"): "guarded by a plate"}, check=["base plate / jack 1"])
    after = table(changed)
    assert after["jack 1 / jack 2"] == "guarded by a plate"
    assert after["base plate / jack 1"] == "checked"
    assert {k for k in before if before[k] != after[k]} == {"jack 1 / jack 2", "base plate / jack 1"}
    assert table(scene()) == before  # a new scene, the old one stays
    assert "skipped  jack 1 / jack 2: guarded by a plate" in changed.describe_pairs().splitlines()
    # what is said later holds
    again = changed.with_pairs(check=[("jack 2", "jack 1")])
    assert table(again)["jack 1 / jack 2"] == "checked"
    assert table(changed.with_pairs(skip=[("base plate", "jack 1")]))["base plate / jack 1"] == "left out by hand"


def test_a_link_stands_for_all_its_bodies_and_the_world_for_all_obstacles() -> None:
    robot = raf_robot()
    link = "arm A"
    assert [solid.name for solid in robot.shapes[link]] == ["arm A", "arm A fork"]
    rows = table(scene().with_pairs(skip=[(link, "world")]))
    for solid in robot.shapes[link]:
        assert rows[f"{solid.name} / ball"] == "left out by hand"
    all_free = scene().with_pairs(skip=[("world", name) for name in robot.shapes if name != robot.mechanism.base.name])
    assert not any(p.is_external for p in all_free.pairs)


def test_a_checked_pair_comes_into_the_clearance() -> None:
    home = raf_robot().home_configuration
    forced = scene().with_pairs(check=["base plate / jack 1"])
    # joined bodies overlap at their joint
    assert forced.clearance(home).distance < scene().clearance(home).distance


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"skip": [("jack 1", "jak 2")]}, po.UnknownNameError, "'jak 2'.*did you mean 'jack 2'"),
        ({"check": ["jack 1 / nobody"]}, po.UnknownNameError, "'nobody'"),
        ({"skip": ["jack 1"]}, po.DefinitionError, "two names, or 'first / second'"),
        ({"skip": [("jack 1", "jack 2", "jack 3")]}, po.DefinitionError, "two names"),
        ({"skip": "jack 1 / jack 2"}, po.DefinitionError, "must be a list of pairs"),
        ({"skip": {("jack 1", "jack 2"): ""}}, po.DefinitionError, "must say why"),
        ({"skip": {("jack 1", "jack 2"): 3}}, po.DefinitionError, "must say why"),
        ({"check": {("jack 1", "jack 2"): "so"}}, po.DefinitionError, "need no reason"),
        ({"check": 3}, po.DefinitionError, "must be a list of pairs"),
        (
            {"skip": [("jack 1", "jack 2")], "check": ["jack 2 / jack 1"]},
            po.DefinitionError,
            "both skipped and checked",
        ),
    ],
)
def test_bad_changes_are_refused(options: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        scene().with_pairs(**options)


# --- Fixed to the base, fixed to each other


def stand() -> po.Robot:
    """A turning arm with a tool fixed to it, on a column that is fixed to the base by two links."""
    box = po.Box(size=(0.1, 0.1, 0.1))
    mechanism = po.Mechanism(
        "stand",
        [
            po.Base(),
            po.Series("column", "base", (1, 0, 0), po.Fixed()),
            po.Series("head", "column", (0, 0, 1), po.Fixed()),
            po.Series("arm", "head", (0, 0, 0.5), po.Revolute("a")),
            po.Series("tool", "arm", (0.5, 0, 0), po.Fixed()),
            po.Series("lamp", "tool", (0.5, 0, 0), po.Fixed()),
            po.Series("dial", "base", joint=po.Revolute("b")),
        ],
        (),
        active=("a",),
        operational=("b",),
    )
    return po.Robot(
        mechanism, {"a": 0.0, "b": 0.0}, shapes={k: [box] for k in ("base", "column", "head", "arm", "tool", "lamp")}
    )


def test_what_is_fixed_to_the_base_does_not_move() -> None:
    robot = stand()
    groups = find_rigid_groups(robot)
    assert {k for k, g in groups.items() if g == "world"} == {"base", "column", "head", "world"}
    assert len({groups[k] for k in ("arm", "tool", "lamp")}) == 1
    rows = table(po.Scene(robot, [po.Sphere(radius=0.1, name="rock")]))
    for name in ("base / column", "base / head", "column / head", "head / rock", "base / rock"):
        assert rows[name] == "neither moves"
    assert rows["arm / lamp"] == "'arm' and 'lamp' are fixed to each other"
    assert rows["arm / tool"] == "joined by a joint"
    assert rows["head / arm"] == "joined by a joint"
    for name in ("column / arm", "head / tool", "lamp / rock", "base / arm"):
        assert rows[name] == "checked"


def test_welds_hold_links_together() -> None:
    mechanism = po.Mechanism(
        "welded",
        [po.Base(), po.Series("arm", "base", joint=po.Revolute("a")), po.Mobile("plate")],
        [po.Weld("arm", "plate", at=(1, 0, 0))],
        active=("a",),
        operational=("x",),
    )
    groups = find_rigid_groups(po.Robot(mechanism, {"x": 1.0, "a": 0.0}))
    assert groups["arm"] == groups["plate"] != "world"


# --- Never in reach


@functools.cache
def pruned() -> po.Scene:
    return scene().find_unreachable_pairs(samples=400, seed=1)


def test_the_walk_stays_closed_within_the_limits_and_goes_far() -> None:
    robot = raf_robot()
    X = walk_configurations(robot, 300, seed=0)
    assert X.shape == (300, len(robot.mechanism.names))
    low, high = robot.limits.bounds(robot.mechanism)
    assert np.all((low <= X) & (high >= X))
    for x in X[::30]:
        robot.kinematics.configuration(x)  # exists only if the loops are closed
    index = [robot.mechanism.index(name) for name in robot.mechanism.operational]
    assert np.all(np.ptp(X[:, index], axis=0) > 0.3 * robot.mechanism.length)
    np.testing.assert_array_equal(X, walk_configurations(robot, 300, seed=0))
    assert not np.array_equal(X[1:], walk_configurations(robot, 300, seed=5)[1:])


def test_unreachable_pairs_are_left_out_with_the_evidence() -> None:
    left = [s for s in pruned().skipped_pairs if s.reason.startswith("never in reach")]
    assert left
    assert all("over 400 sampled configurations (seed 1)" in s.reason for s in left)
    assert {s.name for s in left} <= {p.name for p in scene().pairs if not p.is_external}
    # obstacles stay
    assert [p.name for p in pruned().pairs if p.is_external] == [p.name for p in scene().pairs if p.is_external]
    # the evidence is true: the number is the smallest distance over the walk
    X = walk_configurations(raf_robot(), 400, seed=1)
    names = [p.name for p in scene().pairs]
    for s in left[:5]:
        k = names.index(s.name)
        T = np.zeros((400, X.shape[1], 1))
        smallest = scene().distances(X, np.array([k]), T).values.min()
        assert s.reason.startswith(f"never in reach: {smallest:.3g} m apart")
        assert smallest >= 0.2 * raf_robot().mechanism.length
    # and the clearance of other configurations is what it was
    for c in raf_configurations():
        assert pruned().clearance(c).distance == scene().clearance(c).distance


def test_pairs_that_meet_are_kept() -> None:
    """The bars of the five-bar sweep over each other."""
    alone = po.Scene(five_bar_robot())
    assert alone.find_unreachable_pairs(samples=200).pairs == alone.pairs


@pytest.mark.parametrize("options", [{"samples": 0}, {"samples": 1.5}, {"apart": 0.0}, {"apart": np.nan}])
def test_bad_options_of_the_sampling_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(po.DefinitionError):
        scene().find_unreachable_pairs(**options)


# --- Internal and external


def test_internal_and_external_clearance_are_told_apart() -> None:
    for c in raf_configurations()[:4]:
        both, inner, outer = (scene().clearance(c, kind) for kind in ("all", "internal", "external"))
        assert (inner.is_external, outer.is_external) == (False, True)
        nearest = min((inner, outer), key=lambda k: k.distance)
        assert (both.distance, both.pair, both.is_external) == (nearest.distance, nearest.pair, nearest.is_external)
        for kind, one in (("internal", inner), ("external", outer)):
            values, which = scene().clearances(c.X, kind)
            assert values[0] == one.distance
            assert scene().pairs[which[0]].name == one.pair
        assert outer.describe() == f"nearest to an obstacle: {outer.pair}, {1e3 * outer.distance:.3g} mm apart"
        assert inner.describe().startswith(f"nearest to the robot itself: {inner.pair}")


def test_kinds_that_do_not_exist_are_refused() -> None:
    home = raf_robot().home_configuration
    with pytest.raises(po.UnknownNameError, match="valid names: 'all', 'external', 'internal'"):
        scene().clearance(home, "outer")  # type: ignore[arg-type]
    with pytest.raises(po.DefinitionError, match="no external pair to check"):
        po.Scene(raf_robot()).clearance(home, "external")
