"""Centre of gravity, support polygon and margin, with derivatives."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

import paraopt as po
from paraopt.modes.legged import (
    HeightCondition,
    LeggedMachine,
    LeggedPlan,
    PlaneSupport,
    StabilityCondition,
    SupportPolygon,
    build_centre,
    build_polygon,
    differentiate_centre,
    measure_centre,
    measure_support,
    measure_worst_support,
)
from support import finite_difference

Array = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)


def somewhere(machine: LeggedMachine, n: int = 4) -> Array:
    """Values of all variables near home; balance does not ask for closed loops."""
    X = machine.robot.home_configuration.X
    return X + np.random.default_rng(5).uniform(-0.3, 0.3, size=(n, len(X)))


# --- Centre of gravity


def test_the_centre_is_the_weighted_mean_of_the_links(machine: LeggedMachine) -> None:
    X = somewhere(machine)
    poses = machine.robot.kinematics.poses(X)
    links = [link.name for link in machine.robot.mechanism.links]
    moment = np.zeros((len(X), 3))
    for link, mass in machine.robot.masses.items():
        pose = poses[:, links.index(link)]
        moment += mass * (pose[:, :3, :3] @ np.asarray(machine.robot.centres.get(link, (0, 0, 0))) + pose[:, :3, 3])
    assert_allclose(measure_centre(machine, X), moment / machine.mass, atol=1e-14)
    expression = ca.Function("centre", [machine.robot.kinematics.graph.X], [build_centre(machine)])
    assert_allclose(np.asarray(expression(X[0])).ravel(), measure_centre(machine, X)[0], atol=1e-14)


def test_its_derivatives_are_exact(machine: LeggedMachine) -> None:
    X = somewhere(machine, 1)[0]
    centre, slopes = differentiate_centre(machine, X)
    assert_allclose(centre, measure_centre(machine, X))
    measured = finite_difference(lambda x: measure_centre(machine, x)[0], X)
    assert_allclose(slopes[0], measured, atol=1e-11)


def test_other_masses_move_it_and_compile_nothing(machine: LeggedMachine) -> None:
    X = machine.robot.home_configuration.X
    heavy = replace(machine, masses={**(machine.masses or {}), "head": 1e6})
    head = machine.robot.kinematics.poses(X)[0, [k.name for k in machine.robot.mechanism.links].index("head")]
    at = head[:3, :3] @ np.asarray(machine.robot.centres["head"]) + head[:3, 3]
    assert_allclose(measure_centre(heavy, X)[0], at, atol=1e-6)  # a millionth of 0.3 m from it
    assert heavy.robot.kinematics is machine.robot.kinematics
    only = replace(machine, masses={"trunk": 2.0}, centres={"trunk": (0.1, 0.0, 0.0)})
    assert only.mass == 2.0
    assert_allclose(measure_centre(only, X)[0], [machine.robot.home["x"] + 0.1, 0.0, 0.0], atol=1e-12)


def test_gipo_weighs_slightly_towards_its_front(machine: LeggedMachine) -> None:
    """Lahouar, IV.3: "slightly towards the front"; ours are 4.6 mm ahead of the middle of the feet."""
    centre = measure_centre(machine, machine.robot.home_configuration.X)[0]
    feet = machine.contacts(machine.robot.home_configuration.X)[1][0]
    assert 2e-3 < centre[0] - feet[:, 0].mean() < 8e-3
    assert abs(centre[1]) < 1e-12
    with pytest.raises(po.UnknownNameError, match="hip"):
        po.robots.gipo(masses={"hipp": 0.1})
    assert po.robots.gipo(masses={"hip": 0.1}).masses["left front hip"] == 0.1


# --- Polygon


@given(seed=seeds, n=st.integers(3, 7), lean=st.floats(-0.4, 0.4))
def test_the_hull_and_its_margin(seed: int, n: int, lean: float) -> None:
    random = np.random.default_rng(seed)
    points = random.uniform(-1, 1, size=(n, 3))
    down = np.array([math.sin(lean), 0.0, -math.cos(lean)])
    polygon = SupportPolygon.over([f"foot {i}" for i in range(n)], points, down)
    across = np.array([[math.cos(lean), 0.0, math.sin(lean)], [0.0, 1.0, 0.0]])
    hull = ConvexHull(points @ across.T)
    assert {int(name.removeprefix("foot ")) for name in polygon.corners} == set(hull.vertices.tolist())
    probes = random.uniform(-1.2, 1.2, size=(20, 3))
    flat = probes @ across.T
    inside = np.max(hull.equations @ np.vstack([flat.T, np.ones(20)]), axis=0)  # below zero inside
    margin = polygon.margin(probes)
    assert_allclose(margin[inside <= 0], -inside[inside <= 0], atol=1e-12)
    # outside: no nearer than the worst edge, and as far as the nearest of many points of the boundary
    corners = hull.points[hull.vertices]
    share = np.linspace(0, 1, 2001)[:, None, None]
    border = (corners + share * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)
    nearest = np.min(np.linalg.norm(flat[:, None] - border, axis=2), axis=1)
    assert_allclose(-margin[inside > 0], nearest[inside > 0], atol=2e-3)  # the boundary is sampled every 2 mm or less
    assert np.all(np.min(polygon.distances(probes), axis=1)[inside > 0] < 1e-12)


def test_two_feet_and_feet_in_a_row_make_a_line() -> None:
    line = SupportPolygon.over(["a", "b"], [(0, 0, 0), (2, 0, 1)])
    assert set(line.corners) == {"a", "b"}
    assert len(line.edges) == 2
    assert_allclose(line.margin([(1, 0, 5), (1, 0.5, 0), (3, 0, 0), (-3, 4, 0)]), [0.0, -0.5, -1.0, -5.0], atol=1e-15)
    row = SupportPolygon.over(["a", "b", "c"], [(0, 0, 0), (1, 1e-17, 0), (2, 0, 0)])
    assert set(row.corners) == {"a", "c"}
    point = SupportPolygon.over(["a"], [(1, 0, 0)])
    assert point.edges == ()
    assert_allclose(point.margin([(1, 2, 9)]), [-2.0])
    twice = SupportPolygon.over(["a", "b", "c"], [(0, 0, 0), (0, 0, 1), (1, 0, 0)])
    assert len(twice.corners) == 2  # two feet one above the other
    with pytest.raises(po.DefinitionError, match="needs feet"):
        SupportPolygon.over([], np.zeros((0, 3)))


def test_feet_at_different_heights_are_seen_along_gravity() -> None:
    points = [(0, 0, 0), (1, 0, 0.7), (0, 1, -0.4)]
    level = SupportPolygon.over("abc", [(x, y, 0) for x, y, _ in points])
    stairs = SupportPolygon.over("abc", points)
    probes = [(0.2, 0.3, 4.0), (2, 2, 0)]
    assert_allclose(stairs.margin(probes), level.margin(probes))
    # tilting gravity by 45 degrees about y shifts a centre 0.3 m up by 0.3 m along x
    tilted = SupportPolygon.over("abc", [(x, y, 0) for x, y, _ in points], (1, 0, -1))
    assert tilted.margin([(-0.3, 0.25, 0.3)])[0] == pytest.approx(0.0, abs=1e-12)
    assert tilted.margin([(-0.25, 0.25, 0.3)])[0] > 0.02


def test_margin_of_a_machine(machine: LeggedMachine) -> None:
    X = machine.robot.home_configuration.X
    # the diagonal through the other feet passes 2.7 mm behind the centre of gravity
    for foot, margin in (("right rear", 2.7e-3), ("right front", -2.7e-3)):
        others = [name for name in machine.names if name != foot]
        assert measure_support(machine, X, others)[0] == pytest.approx(margin, abs=1e-4)


# --- Conditions


@pytest.fixture(scope="module")
def stance(machine: LeggedMachine) -> tuple[Array, Array]:
    """A configuration, and a few motions of all variables there."""
    X = somewhere(machine, 3)
    return X, np.random.default_rng(2).normal(size=(3, X.shape[1], 4))


@pytest.mark.parametrize("kind", ["stability", "height"])
def test_conditions_have_exact_derivatives(machine: LeggedMachine, stance: tuple[Array, Array], kind: str) -> None:
    X, T = stance
    condition: StabilityCondition | HeightCondition
    if kind == "stability":
        feet = ("right front", "left rear", "left front")
        polygon = build_polygon(machine, X[0], feet, (0.1, 0.2, -1.0))
        condition = StabilityCondition(machine, polygon, margin=0.004, horizon=0.03)
        assert_allclose(condition.lower, 0.004 / 0.03)
    else:
        condition = HeightCondition(machine, ("right rear", "left front"), PlaneSupport.tilted(0.2, 0.5))
        assert np.all(np.abs(condition.lower) * condition.horizon <= 1e-6)  # as deep as the certificate forgives
    values, slopes = condition.gradients(X, T)
    assert values.shape == (3, len(condition.names))
    assert_allclose(values, condition.values(X))
    for i in range(3):
        measured = finite_difference(lambda s, i=i: condition.values((X[i] + T[i] @ s)[None])[0], np.zeros(4))  # type: ignore[misc]
        assert_allclose(slopes[i], measured, atol=1e-9)  # values over the horizon are some ten


def test_a_condition_needs_an_edge(machine: LeggedMachine) -> None:
    polygon = SupportPolygon.over(["right rear"], [(0, 0, 0)])
    with pytest.raises(po.DefinitionError, match="at least two feet"):
        StabilityCondition(machine, polygon)
    line = SupportPolygon.over(["a", "b"], [(0, 0, 0), (1, 0, 0)])
    with pytest.raises(po.DefinitionError, match="horizon"):
        StabilityCondition(machine, line, horizon=0.0)


# --- Masses that are not known well


def test_the_worst_masses_are_found(machine: LeggedMachine, plan: LeggedPlan) -> None:
    """No choice of masses within the share is worse, and the corners of the box come as near as one likes."""
    feet = ("right front", "left rear", "left front")
    swing = plan.trajectory.parts[1]
    X = swing(np.linspace(0.0, swing.duration, 7))
    worst = measure_worst_support(machine, X, feet, 0.1)
    nominal = measure_support(machine, X, feet)
    assert np.all(worst < nominal)
    assert_allclose(measure_worst_support(machine, X, feet, 0.0), nominal, atol=1e-15)
    # of the corners, those that are best for one edge are found by trying the links one after the other
    masses = dict(machine.masses or {})
    polygon = build_polygon(machine, X[0], feet)
    reached = np.full(len(X), np.inf)
    for edge in range(len(polygon.edges)):
        for i, x in enumerate(X):
            chosen = dict(masses)
            for _ in range(3):
                for link in masses:
                    tried = [{**chosen, link: masses[link] * factor} for factor in (0.9, 1.1)]
                    chosen = min(
                        tried,
                        key=lambda m: polygon.distances(measure_centre(replace(machine, masses=m), x))[0, edge],
                    )
            reached[i] = min(reached[i], measure_support(replace(machine, masses=chosen), x, feet)[0])
    assert_allclose(worst, reached, atol=1e-12)
    random = np.random.default_rng(3)
    for _ in range(20):
        drawn = {link: mass * random.uniform(0.9, 1.1) for link, mass in masses.items()}
        assert np.all(measure_support(replace(machine, masses=drawn), X, feet) >= worst - 1e-12)
    for share in (-0.1, 1.0):
        with pytest.raises(po.DefinitionError, match="share"):
            measure_worst_support(machine, X, feet, share)
    with pytest.raises(po.DefinitionError, match="no polygon"):
        measure_worst_support(machine, X, feet[:2])
