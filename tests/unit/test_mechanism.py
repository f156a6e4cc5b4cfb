"""Descriptions: what is accepted and how it is read, and every faulty one refused by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from itertools import permutations
from typing import Any

import numpy as np
import pytest

import paraopt as po
from paraopt import mechanism as parts
from support import two_rpr


def build(
    *links: Any,
    closures: Sequence[Any] = (),
    active: Any = ("a",),
    operational: Any = ("x",),
    **options: Any,
) -> po.Mechanism:
    """Describe a machine with a base, a driven arm and a free tip, and whatever is added."""
    start: list[Any] = [po.Base(), po.Series("arm", "base", joint=po.Revolute("a")), po.Mobile("tip", ("x", "y"))]
    return po.Mechanism("machine", [*start, *links], closures, active, operational, **options)


def with_joint(joint: Any, **options: Any) -> po.Mechanism:
    return build(po.Series("extra", "arm", joint=joint), **options)


# --- Reading a good description


def test_variables_are_active_then_passive_then_operational() -> None:
    mechanism = two_rpr()
    assert mechanism.names == ("rho1", "rho2", "phi1", "phi2", "x", "y")
    assert mechanism.passive == ("phi1", "phi2")
    assert [v.role for v in mechanism.variables] == ["active"] * 2 + ["passive"] * 2 + ["operational"] * 2
    assert [v.kind for v in mechanism.variables] == ["length", "length", "angle", "angle", "length", "length"]
    assert [v.unit for v in mechanism.variables] == ["m", "m", "rad", "rad", "m", "m"]
    assert [v.link for v in mechanism.variables] == ["rod 1", "rod 2", "leg 1", "leg 2", "tip", "tip"]
    assert mechanism.index("phi2") == 3
    assert mechanism.indices(["y", "rho1"]) == [5, 0]
    assert mechanism.link("rod 1").name == "rod 1"
    assert mechanism.base.name == "base"


def test_active_and_operational_keep_the_order_that_the_user_states() -> None:
    mechanism = dataclasses.replace(two_rpr(), active=("rho2", "rho1"), operational=("y", "x"))
    assert mechanism.names == ("rho2", "rho1", "phi1", "phi2", "y", "x")


@pytest.mark.parametrize("order", list(permutations(range(4))))
def test_links_may_be_listed_in_any_order(order: Sequence[int]) -> None:
    chain = [
        po.Base(),
        po.Series("upper", "base", joint=po.Revolute("a")),
        po.Series("lower", "upper", joint=po.Revolute("b")),
        po.Series("hand", "lower", joint=po.Revolute("c")),
    ]
    mechanism = po.Mechanism("chain", [chain[i] for i in order], (), ("a", "b"), ("c",))
    assert [link.name for link in mechanism.ordered_links] == ["base", "upper", "lower", "hand"]
    assert [link.name for link in mechanism.links] == [chain[i].name for i in order]


@pytest.mark.parametrize(
    ("joint", "motions"),
    [
        (po.Fixed(), []),
        (po.Revolute("r", "x"), [("r", "angle", "x")]),
        (po.Prismatic("p", "y"), [("p", "length", "y")]),
        (po.Spherical("s"), [("s.x", "angle", "x"), ("s.y", "angle", "y"), ("s.z", "angle", "z")]),
        (po.Spherical(("u", "v", "w")), [("u", "angle", "x"), ("v", "angle", "y"), ("w", "angle", "z")]),
        (po.Universal("u"), [("u.x", "angle", "x"), ("u.y", "angle", "y")]),
        (po.Universal("u", axes=("z", "x")), [("u.z", "angle", "z"), ("u.x", "angle", "x")]),
        (po.Universal(("v", "w"), axes=("y", "z")), [("v", "angle", "y"), ("w", "angle", "z")]),
        (po.Cylindrical("c", axis="x"), [("c.angle", "angle", "x"), ("c.stroke", "length", "x")]),
        (po.Cylindrical(("t", "d")), [("t", "angle", "z"), ("d", "length", "z")]),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, parts.Joint) else "",
)
def test_composite_joints_name_their_motions(joint: po.Fixed, motions: list[tuple[str, str, str]]) -> None:
    assert [(m.name, m.kind, m.axis) for m in joint.motions] == motions
    declared = {(v.name, v.kind) for v in with_joint(joint).variables if v.link == "extra"}
    assert declared == {(name, kind) for name, kind, _ in motions}


def test_ranges_reach_the_variables() -> None:
    joint = po.Spherical("s", ranges=[(-1, 1), (-2, 2), (-3, 3)])
    platform = po.Mobile("plate", ("z",), prefix="plate ", ranges={"z": (0.1, 0.9)})
    mechanism = build(po.Series("extra", "arm", joint=joint), platform)
    ranges = {v.name: v.range for v in mechanism.variables}
    assert ranges["s.y"] == (-2.0, 2.0)
    assert ranges["plate z"] == (0.1, 0.9)
    assert ranges["a"] == (-np.inf, np.inf)


@pytest.mark.parametrize(
    ("mobile", "planar", "expected"),
    [
        (po.Mobile("plate"), False, ["x", "y", "z", "alpha", "beta", "gamma"]),
        (po.Mobile("plate"), True, ["x", "y", "theta"]),
        (po.Mobile("plate", ("z", "x")), False, ["x", "z"]),
        (po.Mobile("plate", ("y", "x"), prefix="p."), True, ["p.x", "p.y"]),
    ],
)
def test_coordinates_of_a_mobile_link(mobile: po.Mobile, planar: bool, expected: list[str]) -> None:
    links = [po.Base(), po.Series("arm", "base", joint=po.Revolute("a")), mobile]
    mechanism = po.Mechanism("machine", links, (), ("a",), expected[:1], planar=planar)
    assert [m.name for m in mechanism.link("plate").motions] == expected


def test_points_in_the_plane_may_have_two_coordinates() -> None:
    tie = po.Coincidence("arm", (1, 2), "tip", (0, 0))
    assert tie.point_A == (1.0, 2.0, 0.0)
    assert tie.name == "arm = tip"
    assert po.Coincidence("arm", (1, 2), "tip", (0, 0), "grip").name == "grip"
    assert po.Series("s", "base", at=(1, 2)).at == (1.0, 2.0, 0.0)


def test_characteristic_length_is_stated_or_the_mean_distance_of_the_points() -> None:
    assert build(characteristic_length=2).length == 2.0
    # points of no length do not count: (3, 4) and (0, 7) have the mean 6
    tie = po.Coincidence("arm", (0, 7), "tip", (0, 0))
    assert build(po.Series("extra", "arm", at=(3, 4)), closures=[tie]).length == pytest.approx(6.0, rel=1e-15)
    assert build().length == 1.0


# --- Frozen


def test_a_mechanism_cannot_be_changed() -> None:
    mechanism = two_rpr()
    for thing, field in (
        (mechanism, "name"),
        (mechanism.links[1], "father"),
        (mechanism.links[1].joint, "name"),
        (mechanism.closures[0], "point_A"),
        (mechanism.variables[0], "role"),
    ):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(thing, field, None)


def test_a_mechanism_copies_what_it_is_given() -> None:
    links: list[Any] = [po.Base(), po.Series("arm", "base", at=[1, 2], joint=po.Revolute("a")), po.Mobile("tip", ["x"])]
    active, closures = ["a"], [po.Coincidence("arm", [1.0, 0.0], "tip", [0.0, 0.0])]
    mechanism = po.Mechanism("machine", links, closures, active, ["x"])
    links.clear(), closures.clear(), active.clear()
    assert (len(mechanism.links), len(mechanism.closures), mechanism.active) == (3, 1, ("a",))


def test_ranges_of_a_mobile_link_are_copied() -> None:
    ranges = {"x": (0.0, 1.0)}
    tip = po.Mobile("tip", ("x",), ranges=ranges)
    ranges["x"] = (0.0, 9.0)
    assert tip.motions[0].range == (0.0, 1.0)


# --- Faulty descriptions: (what is built, the error, what its message must hold)

FAULTS: dict[str, tuple[Callable[[], Any], type[Exception], list[str]]] = {
    # links
    "unknown father": (
        lambda: build(po.Series("rod", "amr")),
        po.UnknownNameError,
        ["father of link 'rod'", "'amr'", "did you mean 'arm'", "'base'", "'tip'"],
    ),
    "own father": (lambda: build(po.Series("rod", "rod")), po.DefinitionError, ["cycle", "'rod'"]),
    "cycle": (
        lambda: build(po.Series("r1", "r3"), po.Series("r2", "r1"), po.Series("r3", "r2")),
        po.DefinitionError,
        ["cycle", "'r1'", "'r2'", "'r3'"],
    ),
    "doubled link": (lambda: build(po.Series("arm", "base")), po.DefinitionError, ["link 'arm'", "twice"]),
    "link without name": (lambda: po.Series("", "base"), po.DefinitionError, ["name of a link", "''"]),
    "link named by a number": (lambda: po.Mobile(3), po.DefinitionError, ["name of a link", "3"]),  # type: ignore[arg-type]
    "two bases": (lambda: build(po.Base("ground")), po.DefinitionError, ["2 base links", "'base'", "'ground'"]),
    "no base": (
        lambda: po.Mechanism("machine", [po.Mobile("tip")], (), ("x",), ("y",)),
        po.DefinitionError,
        ["0 base links", "'machine'"],
    ),
    "no link": (lambda: build("rod"), po.DefinitionError, ["'rod'", "must be Base, Series or Mobile"]),
    "bare link": (lambda: build(parts.Link("rod")), po.DefinitionError, ["'rod'", "must be Base, Series or Mobile"]),
    "no joint": (lambda: with_joint("hinge"), po.DefinitionError, ["joint of link 'extra'", "'hinge'"]),
    "bare joint": (lambda: with_joint(parts.Joint()), po.DefinitionError, ["bare Joint"]),
    "placement not finite": (
        lambda: po.Series("rod", "base", at=(0, np.nan, 0)),
        po.DefinitionError,
        ["placement of link 'rod'", "nan"],
    ),
    "placement of four": (
        lambda: po.Series("rod", "base", at=(0, 0, 0, 0)),
        po.DefinitionError,
        ["placement of link 'rod'", "two or three"],
    ),
    "placement no numbers": (
        lambda: po.Series("rod", "base", at="here"),
        po.DefinitionError,
        ["placement of link 'rod'", "'here'"],
    ),
    "rotation not finite": (
        lambda: po.Series("rod", "base", rotation=(0, np.inf, 0)),
        po.DefinitionError,
        ["rotation of link 'rod'", "inf"],
    ),
    "rotation of two": (
        lambda: po.Series("rod", "base", rotation=(0, 1)),
        po.DefinitionError,
        ["rotation of link 'rod'"],
    ),
    "base not finite": (lambda: po.Base(at=(np.nan, 0, 0)), po.DefinitionError, ["position of base 'base'", "nan"]),
    "base turned by nothing": (
        lambda: po.Base("ground", rotation=(0, np.nan, 0)),
        po.DefinitionError,
        ["rotation of base 'ground'", "nan"],
    ),
    # joints
    "doubled variable": (lambda: with_joint(po.Revolute("a")), po.DefinitionError, ["variable 'a'", "twice"]),
    "doubled within a joint": (
        lambda: with_joint(po.Spherical(("u", "v", "u"))),
        po.DefinitionError,
        ["variable 'u'", "twice"],
    ),
    "variable without name": (lambda: with_joint(po.Revolute("")), po.DefinitionError, ["name of a variable", "''"]),
    "spherical of two names": (
        lambda: with_joint(po.Spherical(("u", "v"))),
        po.DefinitionError,
        ["spherical", "('u', 'v')", "3"],
    ),
    "universal of three names": (
        lambda: with_joint(po.Universal(("u", "v", "w"))),
        po.DefinitionError,
        ["universal", "('u', 'v', 'w')", "2"],
    ),
    "cylindrical of one name": (lambda: with_joint(po.Cylindrical(["u"])), po.DefinitionError, ["cylindrical", "'u'"]),
    "ranges missing": (
        lambda: with_joint(po.Spherical("s", ranges=[(0, 1)])),
        po.DefinitionError,
        ["spherical", "1 ranges", "3"],
    ),
    "universal on one axis": (
        lambda: with_joint(po.Universal("u", axes=("y", "y"))),
        po.DefinitionError,
        ["'u'", "two different axes"],
    ),
    "unknown axis": (lambda: with_joint(po.Revolute("r", "w")), po.DefinitionError, ["axis of 'r'", "'w'"]),
    "unknown axis of a universal": (
        lambda: with_joint(po.Universal("u", axes=("x", "w"))),
        po.DefinitionError,
        ["'u.w'", "'w'"],
    ),
    "range not a number": (
        lambda: with_joint(po.Revolute("r", range=(np.nan, 1))),
        po.DefinitionError,
        ["range of 'r'", "nan"],
    ),
    "range upside down": (lambda: with_joint(po.Prismatic("d", range=(1, 0))), po.DefinitionError, ["range of 'd'"]),
    "range empty": (lambda: with_joint(po.Prismatic("d", range=(1, 1))), po.DefinitionError, ["range of 'd'"]),
    "range of three": (
        lambda: with_joint(po.Prismatic("d", range=(0, 1, 2))),  # type: ignore[arg-type]
        po.DefinitionError,
        ["range of 'd'", "two numbers"],
    ),
    # mobile links
    "unknown coordinate": (
        lambda: po.Mobile("plate", ("x", "w")),
        po.UnknownNameError,
        ["'plate'", "'w'", "'alpha'", "'theta'"],
    ),
    "doubled coordinate": (lambda: po.Mobile("plate", ("x", "x")), po.DefinitionError, ["'plate'", "doubled"]),
    "coordinate under two names": (
        lambda: po.Mobile("plate", ("gamma", "theta")),
        po.DefinitionError,
        ["'plate'", "doubled"],
    ),
    "range of an unknown coordinate": (
        lambda: po.Mobile("plate", ranges={"w": (0, 1)}),
        po.UnknownNameError,
        ["'plate'", "'w'", "'alpha'"],
    ),
    "range of a coordinate not a number": (
        lambda: build(po.Mobile("plate", ("z",), ranges={"z": (0, np.nan)})),
        po.DefinitionError,
        ["range of 'z'", "nan"],
    ),
    "two free links of the same coordinates": (
        lambda: build(po.Mobile("plate", ("x", "z"))),
        po.DefinitionError,
        ["variable 'x'", "twice"],
    ),
    # closures
    "closure to an unknown link": (
        lambda: build(closures=[po.Coincidence("arm", (0, 0), "tpi", (0, 0))]),
        po.UnknownNameError,
        ["'arm = tpi'", "'tpi'", "did you mean 'tip'", "'base'"],
    ),
    "closure to itself": (
        lambda: build(closures=[po.Coincidence("tip", (0, 0), "tip", (0, 0), "grip")]),
        po.DefinitionError,
        ["'grip'", "'tip'", "itself"],
    ),
    "no closure": (lambda: build(closures=["arm = tip"]), po.DefinitionError, ["'arm = tip'", "Closure"]),
    "point not finite": (
        lambda: po.Coincidence("arm", (0, np.inf), "tip", (0, 0)),
        po.DefinitionError,
        ["'arm'", "'arm = tip'", "inf"],
    ),
    "point of one coordinate": (
        lambda: po.Coincidence("arm", (0, 0), "tip", (0,), "grip"),
        po.DefinitionError,
        ["'tip'", "'grip'", "two or three"],
    ),
    # roles
    "unknown active": (
        lambda: build(active=("a", "b")),
        po.UnknownNameError,
        ["active variable of 'machine'", "'b'", "'a', 'x', 'y'"],
    ),
    "unknown operational": (
        lambda: build(operational=("x", "z")),
        po.UnknownNameError,
        ["operational variable of 'machine'", "'z'", "'a', 'x', 'y'"],
    ),
    "both roles": (
        lambda: build(operational=("x", "a")),
        po.DefinitionError,
        ["'a'", "both active and operational"],
    ),
    "doubled active": (lambda: build(active=("a", "a")), po.DefinitionError, ["active variable 'a'", "twice"]),
    "doubled operational": (
        lambda: build(operational=("x", "x")),
        po.DefinitionError,
        ["operational variable 'x'", "twice"],
    ),
    "nothing active": (lambda: build(active=()), po.DefinitionError, ["'machine'", "no active"]),
    "nothing operational": (lambda: build(operational=()), po.DefinitionError, ["'machine'", "no operational"]),
    "roles in a string": (lambda: build(active="a"), po.DefinitionError, ["active", "'a'", "sequence"]),
    "characteristic length of zero": (
        lambda: build(characteristic_length=0.0),
        po.DefinitionError,
        ["characteristic length of 'machine'", "0.0 m"],
    ),
    "characteristic length not finite": (
        lambda: build(characteristic_length=np.inf),
        po.DefinitionError,
        ["characteristic length of 'machine'", "inf"],
    ),
    # the plane
    "planar: turns about x": (
        lambda: with_joint(po.Revolute("r", "x"), planar=True),
        po.DefinitionError,
        ["'r'", "'extra'", "planar", "rotation about x"],
    ),
    "planar: slides along z": (
        lambda: with_joint(po.Prismatic("d"), planar=True),
        po.DefinitionError,
        ["'d'", "'extra'", "planar", "translation along z"],
    ),
    "planar: spherical joint": (
        lambda: with_joint(po.Spherical("s"), planar=True),
        po.DefinitionError,
        ["'s.x'", "'extra'", "planar"],
    ),
    "planar: free along z": (
        lambda: build(po.Mobile("plate", ("z",)), planar=True),
        po.DefinitionError,
        ["'z'", "'plate'", "planar"],
    ),
    "planar: placed above": (
        lambda: build(po.Series("rod", "arm", at=(0, 0, 1)), planar=True),
        po.DefinitionError,
        ["'rod'", "planar", "out of its plane"],
    ),
    "planar: placed askew": (
        lambda: build(po.Series("rod", "arm", rotation=(0, 0.1, 0)), planar=True),
        po.DefinitionError,
        ["'rod'", "planar", "out of its plane"],
    ),
    "planar: base askew": (
        lambda: po.Mechanism(
            "machine", [po.Base(rotation=(0.1, 0, 0)), po.Mobile("tip")], (), ("x",), ("y",), planar=True
        ),
        po.DefinitionError,
        ["'base'", "planar", "out of its plane"],
    ),
    "planar: point above": (
        lambda: build(closures=[po.Coincidence("arm", (0, 0, 1), "tip", (0, 0))], planar=True),
        po.DefinitionError,
        ["'arm = tip'", "out of its plane"],
    ),
    "planar: no link": (lambda: build("rod", planar=True), po.DefinitionError, ["'rod'"]),
    "characteristic length no number": (
        lambda: build(characteristic_length="long"),
        po.DefinitionError,
        ["'machine'", "'long'"],
    ),
    "range of a coordinate that is not free": (
        lambda: po.Mobile("plate", ("x",), ranges={"z": (0, 1)}),
        po.UnknownNameError,
        ["'z'", "'plate'", "'x'"],
    ),
    "closures missing": (
        lambda: build(closures=None),  # type: ignore[arg-type]
        po.DefinitionError,
        ["closures", "None"],
    ),
    "two closures of one name": (
        lambda: build(closures=[po.Coincidence("arm", (i, 0), "tip", (i, 0)) for i in (0, 1)]),
        po.DefinitionError,
        ["closure 'arm = tip'", "twice"],
    ),
}


@pytest.mark.parametrize(("describe", "error", "words"), FAULTS.values(), ids=FAULTS.keys())
def test_a_faulty_description_is_refused_by_name(
    describe: Callable[[], Any], error: type[Exception], words: list[str]
) -> None:
    with pytest.raises(po.DefinitionError) as caught:
        describe()
    assert type(caught.value) is error
    assert not [word for word in words if word not in str(caught.value)], str(caught.value)


@pytest.mark.parametrize("ask", ["index", "link"])
def test_an_unknown_name_is_asked_for(ask: str) -> None:
    with pytest.raises(po.UnknownNameError, match=r"'rho3'.*valid names: "):
        getattr(two_rpr(), ask)("rho3")


def test_order_of_links_is_needed_only_for_fathers() -> None:
    late = [po.Series("rod", "arm"), po.Series("arm", "base", joint=po.Revolute("a")), po.Mobile("tip", ("x",))]
    mechanism = po.Mechanism("machine", [*late, po.Base()], (), ("a",), ("x",))
    assert mechanism.base.name == "base"
