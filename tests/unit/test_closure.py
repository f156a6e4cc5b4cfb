"""The graph: poses against a hand calculation with scipy, closure equations, and their exact Jacobian."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import paraopt as po
from paraopt.closure import ClosureGraph, build_closure
from support import assert_derivative, raf_robot, two_rpr, two_rpr_values, vector

# poses of order one, through a chain of some ten products, computed twice in double precision
ROUND_OFF = 1e-14
AXES = "xyz"


def evaluate(graph: ClosureGraph, expression: ca.SX, X: np.ndarray) -> np.ndarray:
    return np.asarray(ca.Function("f", [graph.X], [expression])(X))


def by_hand(at: Sequence[float] = (0, 0, 0), rotation: Rotation | None = None) -> np.ndarray:
    X = np.eye(4)
    X[:3, 3] = at
    if rotation is not None:
        X[:3, :3] = rotation.as_matrix()
    return X


def turn(axis: str, angle: float) -> np.ndarray:
    return by_hand(rotation=Rotation.from_rotvec(angle * np.eye(3)[AXES.index(axis)]))


def slide(axis: str, stroke: float) -> np.ndarray:
    return by_hand(at=stroke * np.eye(3)[AXES.index(axis)])


JOINTS: list[tuple[str, po.Fixed, dict[str, float], np.ndarray]] = [
    ("fixed", po.Fixed(), {}, np.eye(4)),
    *[(f"revolute {a}", po.Revolute("j", a), {"j": 0.7}, turn(a, 0.7)) for a in AXES],
    *[(f"prismatic {a}", po.Prismatic("j", a), {"j": -0.4}, slide(a, -0.4)) for a in AXES],
    *[
        (
            f"cylindrical {a}",
            po.Cylindrical("j", a),
            {"j.angle": 0.9, "j.stroke": 0.3},
            turn(a, 0.9) @ slide(a, 0.3),
        )
        for a in AXES
    ],
    *[
        (f"universal {a}{b}", po.Universal(("u", "v"), (a, b)), {"u": 0.5, "v": -1.2}, turn(a, 0.5) @ turn(b, -1.2))
        for a in AXES
        for b in AXES
        if a != b
    ],
    (
        "spherical",
        po.Spherical("j"),
        {"j.x": 0.5, "j.y": -1.2, "j.z": 2.1},
        by_hand(rotation=Rotation.from_euler("XYZ", (0.5, -1.2, 2.1))),
    ),
]


@pytest.mark.parametrize(("joint", "values", "moved"), [j[1:] for j in JOINTS], ids=[j[0] for j in JOINTS])
def test_pose_is_base_then_placement_then_joint(joint: po.Fixed, values: dict[str, float], moved: np.ndarray) -> None:
    base, turned, at, askew = (0.3, -0.1, 0.5), (0.2, 0.4, -0.7), (1.0, 2.0, -0.5), (-0.3, 0.8, 1.9)
    mechanism = po.Mechanism(
        "machine",
        [
            po.Series("hand", "arm", at=(0.0, 0.0, 0.2)),
            po.Series("arm", "base", at=at, joint=joint, rotation=askew),
            po.Base(at=base, rotation=turned),
            po.Mobile("plate"),
        ],
        (),
        active=("x", "y"),
        operational=("z",),
    )
    graph = build_closure(mechanism)
    free = {"x": 0.1, "y": 0.2, "z": 0.3, "alpha": 0.4, "beta": -0.5, "gamma": 0.6}
    X = vector(mechanism, {**free, **values})
    # the base's pose moves the robot, the constant placement stands before the joint
    X_WA = by_hand(base, Rotation.from_euler("XYZ", turned)) @ by_hand(at, Rotation.from_euler("XYZ", askew)) @ moved
    assert_allclose(evaluate(graph, graph.X_W["arm"], X), X_WA, atol=ROUND_OFF)
    assert_allclose(evaluate(graph, graph.X_W["hand"], X), X_WA @ by_hand((0, 0, 0.2)), atol=ROUND_OFF)
    # a free link is placed in the world, not on the base
    X_WP = by_hand((0.1, 0.2, 0.3), Rotation.from_euler("XYZ", (0.4, -0.5, 0.6)))
    assert_allclose(evaluate(graph, graph.X_W["plate"], X), X_WP, atol=ROUND_OFF)


def test_poses_of_the_base_and_of_a_chain() -> None:
    mechanism = two_rpr()
    graph = build_closure(mechanism)
    X = vector(mechanism, {"rho1": 2.0, "rho2": 3.0, "phi1": 0.3, "phi2": 2.0, "x": 9.0, "y": 8.0})
    assert_allclose(evaluate(graph, graph.X_W["base"], X), np.eye(4), atol=0)
    assert_allclose(evaluate(graph, graph.X_W["rod 2"], X), by_hand((4, 0, 0)) @ turn("z", 2.0) @ slide("x", 3.0),
                    atol=ROUND_OFF)  # fmt: skip


def test_equations_are_the_gap_between_the_points() -> None:
    base = (0.5, 0.0, 0.0)
    mechanism = po.Mechanism(
        "machine",
        [po.Base(at=base), po.Series("arm", "base", joint=po.Revolute("a", "y")), po.Mobile("plate", ("x", "z"))],
        [po.Coincidence("arm", (1, 2, 3), "plate", (0.1, 0.2, 0.3), "grip")],
        ("a",),
        ("x",),
    )
    graph = build_closure(mechanism)
    X = vector(mechanism, {"a": 0.8, "x": 0.4, "z": -0.6})
    p_A = np.array(base) + Rotation.from_euler("y", 0.8).apply((1, 2, 3))
    assert_allclose(evaluate(graph, graph.F, X)[:, 0], p_A - (0.5, 0.2, -0.3), atol=ROUND_OFF)
    assert [(row.name, row.unit) for row in graph.rows] == [("grip [x]", "m"), ("grip [y]", "m"), ("grip [z]", "m")]


def test_rows_out_of_the_plane_are_never_built() -> None:
    graph = build_closure(two_rpr())
    assert graph.F.shape == (4, 1)
    assert [row.name for row in graph.rows] == [f"rod {i} = tip [{a}]" for i in (1, 2) for a in "xy"]


def test_residual_vanishes_where_the_loops_close_by_hand() -> None:
    mechanism = two_rpr()
    graph = build_closure(mechanism)
    values = two_rpr_values(1.3, 2.1)
    assert_allclose(evaluate(graph, graph.F, vector(mechanism, values)), 0, atol=ROUND_OFF)
    values["phi1"] += 1e-3
    assert np.abs(evaluate(graph, graph.F, vector(mechanism, values))).max() > 1e-3


def every_joint() -> po.Mechanism:
    """A machine with each kind of joint in one loop."""
    return po.Mechanism(
        "machine",
        [
            po.Base(at=(0.1, 0.2, 0.3), rotation=(0.3, 0, 0.1)),
            po.Series("a", "base", (1, 0, 0), po.Spherical("s"), rotation=(0, 0.5, 0)),
            po.Series("b", "a", (0, 0.4, 0), po.Cylindrical("c", "y")),
            po.Series("c", "b", (0, 0, 0.6), po.Universal("u", ("z", "x"))),
            po.Series("d", "base", (0, 1, 0), po.Prismatic("p", "x")),
            po.Series("e", "d", (0, 0, 1), po.Revolute("r", "z"), rotation=(0.2, 0, 0)),
            po.Mobile("plate"),
        ],
        [
            po.Coincidence("c", (0, 0.1, 0.5), "plate", (0.3, 0, 0)),
            po.Coincidence("e", (0.2, 0, 0), "plate", (0, 0.3, 0)),
        ],
        active=("p", "c.stroke"),
        operational=("x", "y", "z"),
    )


@pytest.mark.parametrize(
    "describe", [two_rpr, every_joint, lambda: raf_robot().mechanism], ids=["2-RPR", "every joint", "RAF"]
)
@pytest.mark.parametrize("seed", range(3))
def test_jacobian_is_the_derivative_of_the_residual(describe: Callable[[], po.Mechanism], seed: int) -> None:
    graph = build_closure(describe())
    X = np.random.default_rng(seed).uniform(-1, 1, len(graph.mechanism.names))
    residual = ca.Function("F", [graph.X], [graph.F])
    # five points at steps of 1e-3: 1e-12 of truncation, 1e-12 of round-off
    assert_derivative(
        evaluate(graph, graph.E, X), lambda x: np.asarray(residual(x))[:, 0], X, step=1e-3, tolerance=1e-10
    )


@pytest.mark.parametrize("describe", [two_rpr, every_joint, lambda: raf_robot().mechanism])
def test_blocks_are_the_columns_of_each_role(describe: Callable[[], po.Mechanism]) -> None:
    mechanism = describe()
    graph = build_closure(mechanism)
    X = np.random.default_rng(0).uniform(-1, 1, len(mechanism.names))
    E = evaluate(graph, graph.E, X)
    columns = {name: E[:, i] for i, name in enumerate(mechanism.names)}
    for block, names in zip(graph.blocks, (mechanism.active, mechanism.passive, mechanism.operational), strict=True):
        assert_allclose(evaluate(graph, block, X), np.column_stack([columns[n] for n in names]), atol=0)
    assert sum(block.shape[1] for block in graph.blocks) == len(mechanism.names)


def test_quarter_turns_are_exact() -> None:
    """cos(pi/2) = 6e-17 would couple directions that have nothing to do with each other."""

    def build(rotation: Sequence[float]) -> ClosureGraph:
        return build_closure(
            po.Mechanism(
                "machine",
                [
                    po.Base(),
                    po.Series("slide", "base", joint=po.Prismatic("d", "x"), rotation=rotation),
                    po.Mobile("plate", ("x", "y", "z")),
                ],
                [po.Coincidence("slide", (0, 0, 0), "plate", (0, 0, 0))],
                ("d",),
                ("x",),
            )
        )

    # the slide moves along the world's axis that the quarter turns bring its x axis to, and along no other
    for rotation, column in (
        ((0, 0, np.pi / 2), (0, 1, 0)),
        ((0, -np.pi / 2, 0), (0, 0, 1)),
        ((0, 0, np.pi), (-1, 0, 0)),
        ((np.pi / 2, 0, np.pi / 2), (0, 0, 1)),
        ((0.3, 0, 0), (1, 0, 0)),
    ):
        graph = build(rotation)
        M = graph.blocks[0]
        assert M.nnz() == 1, (rotation, str(M))
        # sin(pi/2) is 1 exactly
        assert_allclose(np.asarray(ca.DM(ca.evalf(M)))[:, 0], column, atol=0)


def test_idle_columns_are_structurally_empty() -> None:
    """A jack that spins about its own axis appears in no equation of the RAF."""
    graph = build_closure(raf_robot().mechanism)
    empty = set(graph.mechanism.names) - {
        graph.mechanism.names[j] for j in np.asarray(graph.E.sparsity().get_triplet()[1])
    }
    assert empty == {"jack 1.z", "jack 2.z", "jack 3.z"}


def test_scales_are_the_characteristic_length_or_one() -> None:
    graph = build_closure(two_rpr(characteristic_length=2.5))
    assert_allclose(graph.variable_scale, [2.5, 2.5, 1, 1, 2.5, 2.5], atol=0)
    assert_allclose(graph.row_scale, [2.5] * 4, atol=0)


def test_a_mechanism_without_closures_has_no_equations() -> None:
    mechanism = po.Mechanism(
        "chain", [po.Base(), po.Series("arm", "base", joint=po.Universal("a"))], (), ("a.x",), ("a.y",)
    )
    graph = build_closure(mechanism)
    assert graph.F.shape == (0, 1)
    assert graph.E.shape == (0, 2)


def test_closure_without_equations_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="Closure"):
        po.mechanism.Closure("rod 1", "tip")

    @dataclass(frozen=True)
    class Magnet(po.mechanism.Closure):
        link_A: str
        link_B: str
        name: str = ""

    mechanism = two_rpr()
    with pytest.raises(po.DefinitionError, match="Magnet"):
        build_closure(po.Mechanism("m", mechanism.links, [Magnet("rod 1", "tip")], ("rho1",), ("x",), planar=True))


def test_rows_have_different_names() -> None:
    ties = [po.Coincidence("rod 1", (i, 0), "tip", (i, 0)) for i in (0, 1)]
    with pytest.raises(po.DefinitionError, match="closure 'rod 1 = tip' appears twice"):
        po.Mechanism("machine", two_rpr().links, ties, ("rho1",), ("x",), planar=True)
