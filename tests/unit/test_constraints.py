"""Simple constraints and the closing joints made of them: freedoms left, equal constructions, exact derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import subspace_angles
from scipy.spatial.transform import Rotation

import paraopt as po
from paraopt.closure import ClosureGraph, build_closure
from paraopt.mechanism import Closure
from paraopt.mechanism.closing_joints import perpendicular
from support import Array, assert_derivative

# Two bodies: the base carries side A, a free link side B. What is built on B in its own frame is carried to A by the
# pose, so that every constraint holds there; `slide` moves the point along the freedoms that the joint leaves.
POSE = np.array([0.3, -0.5, 0.8, 0.4, -0.7, 1.1])
POINT, AXIS = np.array([0.2, 0.6, -0.3]), np.array([0.5, -1.0, 0.7])


def to_base(vector: Array, pose: Array = POSE, *, point: bool) -> list[float]:
    R = Rotation.from_euler("XYZ", pose[3:]).as_matrix()
    moved: Array = R @ vector + (pose[:3] if point else 0.0)
    return [float(c) for c in moved]


def slid(along: float = 0.0, across: float = 0.0) -> list[float]:
    u, v = AXIS / np.linalg.norm(AXIS), np.array(perpendicular(tuple(AXIS))[0])
    return to_base(POINT + along * u + across * v, point=True)


AXIS_A = to_base(AXIS, point=False)
ACROSS_B = perpendicular(tuple(AXIS))[0]
ACROSS_A = to_base(np.array(ACROSS_B), point=False)
B = {"link_B": "body", "point_B": POINT.tolist()}
NORMAL = {"normal_A": AXIS_A, "normal_B": AXIS.tolist()}
BOTH = {"axis_A": AXIS_A, "axis_B": AXIS.tolist()}

SIMPLE: dict[str, tuple[Callable[[], Closure], int, int]] = {  # closure, equations, freedoms left
    "coincidence": (lambda: po.Coincidence("base", slid(), **B), 3, 3),
    "parallel axes": (lambda: po.ParallelAxes("base", AXIS_A, "body", AXIS.tolist()), 3, 4),
    "opposite axes": (lambda: po.ParallelAxes("base", AXIS_A, "body", (-AXIS).tolist()), 3, 4),
    "parallel planes": (lambda: po.ParallelPlanes("base", AXIS_A, "body", AXIS.tolist()), 3, 4),
    "perpendicular axes": (lambda: po.PerpendicularAxes("base", ACROSS_A, "body", AXIS.tolist()), 1, 5),
    "point on line": (lambda: po.PointOnLine("base", slid(0.4), **B, axis_B=AXIS.tolist()), 3, 4),
    "point on plane": (lambda: po.PointOnPlane("base", slid(0, 0.4), **B, normal_B=AXIS.tolist()), 1, 5),
    "weld": (lambda: po.Weld("base", "body", POSE[:3].tolist(), POSE[3:].tolist()), 12, 0),
}
JOINTS: dict[str, tuple[Callable[[], Any], int]] = {  # closing joint, freedoms left
    "spherical": (lambda: po.ClosingSpherical("base", slid(), **B), 3),
    "universal": (lambda: po.ClosingUniversal("base", slid(), ACROSS_A, **B, axis_B=AXIS.tolist()), 2),
    "cylindrical": (lambda: po.ClosingCylindrical(link_A="base", point_A=slid(0.4), **B, **BOTH), 2),
    "revolute": (lambda: po.ClosingRevolute(link_A="base", point_A=slid(), **B, **BOTH), 1),
    "prismatic": (
        lambda: po.ClosingPrismatic(
            link_A="base", point_A=slid(0.4), **B, **BOTH, direction_A=ACROSS_A, direction_B=ACROSS_B
        ),
        1,
    ),
    "planar contact": (lambda: po.PlanarContact(link_A="base", point_A=slid(0, 0.4), **B, **NORMAL), 3),
    "line contact": (
        lambda: po.LineContact("base", slid(0, 0.4), ACROSS_A, **B, normal_B=AXIS.tolist()),
        4,
    ),
}
TWO_WAYS = [name for name, (build, _) in JOINTS.items() if build().constructions]


def body(closure: Closure, order: str = "xyz") -> ClosureGraph:
    """Tie a free link to the base by one closure."""
    links = [po.Base(), po.Mobile("body", order=order)]
    return build_closure(po.Mechanism("two bodies", links, [closure], ("x",), ("y", "z", "alpha", "beta", "gamma")))


def in_order(graph: ClosureGraph, pose: Array) -> Array:
    """Write a pose (x, y, z, alpha, beta, gamma) in the order of the mechanism's variables."""
    named = dict(zip(("x", "y", "z", "alpha", "beta", "gamma"), pose, strict=True))
    return np.array([named[n] for n in graph.mechanism.names])


def evaluate(graph: ClosureGraph, pose: Array) -> tuple[Array, Array]:
    function = ca.Function("f", [graph.X], [graph.F, graph.E])
    F, E = function(in_order(graph, pose))
    return np.asarray(F).ravel(), np.asarray(ca.DM(E).full())


def tangent_space(graph: ClosureGraph, pose: Array = POSE) -> Array:
    _, E = evaluate(graph, pose)
    _, values, Vt = np.linalg.svd(E)
    return Vt[int(np.count_nonzero(values > 1e-9 * values[0])) :].T


@pytest.mark.parametrize(("build", "equations", "freedoms"), SIMPLE.values(), ids=SIMPLE.keys())
def test_simple_constraints_have_their_equations_and_freedoms(
    build: Callable[[], Closure], equations: int, freedoms: int
) -> None:
    graph = body(build())
    F, _ = evaluate(graph, POSE)
    assert_allclose(F, 0.0, atol=1e-14)
    assert len(F) == equations == len({row.name for row in graph.rows})
    assert tangent_space(graph).shape[1] == freedoms


@pytest.mark.parametrize(("build", "freedoms"), JOINTS.values(), ids=JOINTS.keys())
def test_closing_joints_leave_their_freedoms(build: Callable[[], Any], freedoms: int) -> None:
    joint = build()
    for construction in joint.constructions or [None]:
        chosen = replace(joint, construction=construction) if construction else joint
        graph = body(chosen)
        assert_allclose(evaluate(graph, POSE)[0], 0.0, atol=1e-14)
        assert tangent_space(graph).shape[1] == freedoms, construction


@pytest.mark.parametrize("name", TWO_WAYS)
def test_both_constructions_have_the_same_tangent_space(name: str) -> None:
    """At the pose of assembly, and after a finite motion along the freedoms of the first construction."""
    first = JOINTS[name][0]()
    assert len(first.constructions) == 2
    graphs = [body(replace(first, construction=c)) for c in first.constructions]
    X = in_order(graphs[0], POSE)
    residual = ca.Function("f", [graphs[0].X], [graphs[0].F, graphs[0].E])
    random = np.random.default_rng(0)
    for step in range(4):
        spaces = []
        for graph in graphs:
            F, E = ca.Function("f", [graph.X], [graph.F, graph.E])(X)
            assert_allclose(np.asarray(F).ravel(), 0.0, atol=1e-12, err_msg=f"step {step}, {graph.rows}")
            _, values, Vt = np.linalg.svd(ca.DM(E).full())
            spaces.append(Vt[int(np.count_nonzero(values > 1e-9 * values[0])) :].T)
        assert spaces[0].shape == spaces[1].shape
        assert np.max(subspace_angles(*spaces)) < 1e-9
        X = X + 0.3 * spaces[0] @ random.normal(size=spaces[0].shape[1])
        for _ in range(30):  # back onto the closures of the first construction
            F, E = residual(X)
            X = X - np.linalg.pinv(ca.DM(E).full(), rcond=1e-9) @ np.asarray(F).ravel()


@pytest.mark.parametrize("build", [b for b, *_ in [*SIMPLE.values(), *JOINTS.values()]])
def test_jacobians_are_exact_away_from_the_closed_pose(build: Callable[[], Closure]) -> None:
    graph = body(build())
    X = in_order(graph, POSE + 0.1 * np.arange(1, 7))
    function = ca.Function("f", [graph.X], [graph.F, graph.E])
    assert_derivative(ca.DM(function(X)[1]).full(), lambda x: np.asarray(function(x)[0]).ravel(), X)


@pytest.mark.parametrize("order", ["xyz", "zyx", "yzx"])
def test_order_of_rotations_is_that_of_the_matrices(order: str) -> None:
    graph = body(po.Coincidence("base", (0, 0, 0), "body", (0, 0, 0)), order)
    X_WB = np.asarray(ca.Function("f", [graph.X], [graph.X_W["body"]])(in_order(graph, POSE)))
    angles = dict(zip("xyz", POSE[3:], strict=True))
    expected = Rotation.from_euler(order.upper(), [angles[a] for a in order]).as_matrix()
    assert_allclose(X_WB[:3, :3], expected, atol=1e-15)
    assert_allclose(X_WB[:3, 3], POSE[:3], atol=0)


@pytest.mark.parametrize("order", ["xyz", "zyx"])
def test_spherical_joints_turn_in_the_stated_order(order: str) -> None:
    links = [po.Base(), po.Series("ball", "base", joint=po.Spherical("s", order=order))]
    mechanism = po.Mechanism("ball", links, (), ("s.x",), ("s.y",))
    assert [m.name for m in mechanism.link("ball").motions] == [f"s.{a}" for a in order]
    graph = build_closure(mechanism)
    angles = {"s.x": 0.4, "s.y": -0.7, "s.z": 1.1}
    X_W = ca.Function("f", [graph.X], [graph.X_W["ball"]])([angles[n] for n in mechanism.names])
    expected = Rotation.from_euler(order.upper(), [angles[f"s.{a}"] for a in order]).as_matrix()
    assert_allclose(np.asarray(X_W)[:3, :3], expected, atol=1e-15)


# --- In the plane


PLANE_POSE = (0.4, -0.3, 0.9)


def planar_points() -> tuple[list[float], list[float], list[float]]:
    """Give a point of the body, where it lies on the ground, and an axis of the body seen from the ground."""
    x, y, theta = PLANE_POSE
    R = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    return [0.5, 0.2], (R @ [0.5, 0.2] + [x, y]).tolist(), (R @ [1.0, 2.0]).tolist()


P_B, P_A, U_A = planar_points()
PLANAR: dict[str, tuple[Closure, int, int]] = {
    "coincidence": (po.Coincidence("base", P_A, "body", P_B), 2, 1),
    "parallel axes": (po.ParallelAxes("base", U_A, "body", (1, 2)), 1, 2),
    "perpendicular axes": (po.PerpendicularAxes("base", U_A, "body", (-2, 1)), 1, 2),
    "point on line": (po.PointOnLine("base", P_A, "body", P_B, (1, 2)), 1, 2),
    "point on plane": (po.PointOnPlane("base", P_A, "body", P_B, (1, 2)), 1, 2),
    "weld": (po.Weld("base", "body", PLANE_POSE[:2], (0, 0, PLANE_POSE[2])), 4, 0),
    "revolute": (po.ClosingRevolute("base", P_A, "z", "body", P_B, "z"), 2, 1),
    "prismatic": (po.ClosingPrismatic("base", P_A, U_A, "body", P_B, (1, 2)), 2, 1),
    "prismatic, two points": (
        po.ClosingPrismatic("base", P_A, U_A, "body", P_B, (1, 2), construction="cylindrical, point on plane"),
        2,
        1,
    ),
}


@pytest.mark.parametrize(("closure", "equations", "freedoms"), PLANAR.values(), ids=PLANAR.keys())
def test_constraints_in_the_plane(closure: Closure, equations: int, freedoms: int) -> None:
    links = [po.Base(), po.Mobile("body")]
    graph = build_closure(po.Mechanism("m", links, [closure], ("x",), ("y", "theta"), planar=True))
    F, E = ca.Function("f", [graph.X], [graph.F, graph.E])(PLANE_POSE)
    assert_allclose(np.asarray(F).ravel(), 0.0, atol=1e-15)
    assert F.numel() == equations
    assert 3 - np.linalg.matrix_rank(ca.DM(E).full(), tol=1e-9) == freedoms


def test_a_planar_weld_is_not_closed_half_a_turn_away() -> None:
    links = [po.Base(), po.Mobile("body")]
    graph = build_closure(po.Mechanism("m", links, [po.Weld("base", "body")], ("x",), ("y", "theta"), planar=True))
    turned = np.asarray(ca.Function("f", [graph.X], [graph.F])([0, 0, np.pi]))
    assert np.max(np.abs(turned)) > 1.0


@pytest.mark.parametrize(
    ("closure", "words"),
    [
        (po.ClosingSpherical("base", (0, 0), "body", (0, 0)), ["'base = body'", "ClosingSpherical", "in the plane"]),
        (po.PlanarContact("base", (0, 0), "z", "body", (0, 0), "z"), ["PlanarContact", "in the plane"]),
        (po.ClosingRevolute("base", (0, 0), "x", "body", (0, 0), "x"), ["turns about z"]),
        (po.ParallelAxes("base", "z", "body", "z"), ["out of its plane"]),
        (po.PointOnLine("base", (0, 0, 1), "body", (0, 0), "x"), ["out of its plane", "point"]),
        (po.Weld("base", "body", (0, 0, 0), (0.1, 0, 0)), ["out of its plane"]),
    ],
)
def test_what_has_no_meaning_in_the_plane_is_refused(closure: Closure, words: list[str]) -> None:
    with pytest.raises(po.DefinitionError) as caught:
        po.Mechanism("m", [po.Base(), po.Mobile("body")], [closure], ("x",), ("y",), planar=True)
    assert not [word for word in words if word not in str(caught.value)], str(caught.value)


# --- Refused


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: po.ParallelAxes("a", "w", "b", "x"), ["axis of 'a'", "'a = b'", "'w'", "'x'"]),
        (lambda: po.ParallelAxes("a", "x", "b", (0, 0, 0)), ["axis of 'b'", "zero"]),
        (lambda: po.PointOnPlane("a", (0, 0), "b", (0, 0), (np.nan, 0, 0)), ["normal of 'b'", "finite"]),
        (lambda: po.ClosingRevolute("a", (0, 0), "z", "b", (0, 0), "z", construction="glue"), ["'glue'", "'two coin"]),
        (lambda: po.ClosingRevolute("a", (0, 0), "z", "b", (0, 0), "z", spread=0), ["spread", "0.0 m", "above 0"]),
        (lambda: po.ClosingRevolute("a", (0, 0), "z", "b", (0, 0), "z", spread="far"), ["spread", "'far'"]),
        (
            lambda: po.ClosingPrismatic("a", (0, 0), "z", "b", (0, 0), "z", direction_A=(1, 0, 1)),
            ["direction_A", "perpendicular"],
        ),
        (lambda: po.Weld("a", "b", (0, 0, np.inf)), ["at in closure 'a = b'", "finite"]),
        (lambda: po.Weld("a", "b", rotation=(0, 0)), ["rotation in closure 'a = b'"]),
        (lambda: po.Weld("a", "b", name=3), ["name of a closure", "3"]),  # type: ignore[arg-type]
        (lambda: po.Mobile("a", order="xyx"), ["order of rotations", "'a'", "'xyx'"]),
        (lambda: po.Spherical("s", order="zy").motions, ["order of rotations", "'s'", "'zy'"]),
    ],
)
def test_faulty_constraints_are_refused_by_name(build: Callable[[], Any], words: list[str]) -> None:
    with pytest.raises(po.DefinitionError) as caught:
        build()
    assert not [word for word in words if word not in str(caught.value)], str(caught.value)


def test_closing_joints_expand_into_named_simple_constraints() -> None:
    joint = po.ClosingRevolute("a", (1, 0, 0), "z", "b", (0, 2, 0), "-z", name="hinge")
    assert [part.name for part in joint.expand()] == ["hinge: first point", "hinge: second point"]
    first, second = joint.expand()
    assert isinstance(second, po.Coincidence)
    assert_allclose(second.point_A, (1, 0, 2))  # the longer of the two points' distances is the spread
    assert_allclose(second.point_B, (0, 2, -2))
    assert first.expand() == (first,)


def test_directions_may_be_of_any_length() -> None:
    graphs = [body(po.PointOnPlane("base", (1, 0, 0), "body", (0, 0, 0), (0, 0, n))) for n in (1.0, 50.0)]
    F = [evaluate(graph, POSE)[0] for graph in graphs]
    assert_allclose(F[0], F[1], atol=1e-15)


def test_a_letter_and_its_vector_are_the_same_direction() -> None:
    assert po.ParallelAxes("a", "-y", "b", "z") == po.ParallelAxes("a", (0, -1, 0), "b", (0, 0, 1))
