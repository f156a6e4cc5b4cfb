"""Hanging platforms: poses of least energy against the balance of forces, stability against the energy itself."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

import paraopt as po
from paraopt.modes.cable import (
    CableRobot,
    EquilibriumOptions,
    HangingPose,
    Pulley,
    build_hanging,
    cable_functions,
    check_feasibility,
    find_equilibria,
    find_equilibrium,
    judge_stability,
    read_hanging,
    report_cable_state,
)
from paraopt.modes.cable.energy import Place

Array = NDArray[np.float64]
SIDE, HALF, DROP = 1.0, 0.1, 0.05
EXITS = [(0, 0, 0), (0, SIDE, 0), (SIDE, 0, 0), (SIDE, SIDE, 0)]
ENDS = [(-HALF, 0, 0), (-HALF, 0, 0), (HALF, 0, 0), (HALF, 0, 0)]


def larm(**changes: Any) -> CableRobot:
    """LARM in space with the dimensions of the library's."""
    values: dict[str, Any] = {
        "name": "LARM", "exits": EXITS, "attachments": ENDS, "mass": 1.0, "t_max": 60.0, "centre": (0, 0, -DROP),
        "order": "zyx", "home": {"x": 0.5, "y": 0.5, "z": -0.5}, "operational": ("x", "y", "z", "gamma"),
    }  # fmt: skip
    return CableRobot(**(values | changes))


def bar(centre: float, **changes: Any) -> CableRobot:
    """A bar on two cables in an upright plane, its centre of mass above or below the line of its ends."""
    values: dict[str, Any] = {
        "name": "bar", "exits": [(0, 0), (1, 0)], "attachments": [(-0.2, 0), (0.2, 0)], "mass": 2.0, "t_max": 100.0,
        "centre": (0, centre), "planar": True, "gravity": (0, -9.81), "home": {"x": 0.5, "y": -0.4},
        "operational": ("x", "y"),
    }  # fmt: skip
    return CableRobot(**(values | changes))


LEVEL = np.array([0.5, 0.5])
"""Lengths of the bar's cables where it hangs level at its home."""


@cache
def hanging() -> po.Robot:
    return po.robots.larm_hanging()


def hang_at(**pose: float) -> po.Configuration:
    """Solve the machine whose closures hold the balance."""
    wanted = {"x": 0.5, "y": 0.5, "z": -0.5, "gamma": 0.0} | pose
    return hanging().kinematics.inverse(wanted, hanging().home_configuration).configuration


def lengths_of(configuration: po.Configuration) -> Array:
    return np.array([configuration[q] for q in ("q1", "q2", "q3", "q4")])


def assert_balanced(found: HangingPose, paid: Array) -> None:
    """Check the equilibrium by what shares nothing with its search: the wrench equation, signs and lengths."""
    robot, functions = found.robot, cable_functions(found.robot)
    W, w = functions.both(found.pose)
    left = W[0] @ found.tensions + w[0]
    split = 2 if robot.planar else 3
    weight = float(np.linalg.norm(w[0][:split]))
    assert np.max(np.abs(left[:split])) <= 1e-9 * weight
    assert np.max(np.abs(left[split:])) <= 1e-9 * weight * robot.length_scale
    assert np.min(found.tensions) >= -1e-9 * weight
    spans = functions.lengths(found.pose)[0]
    assert np.all(spans <= paid + 1e-9)
    assert_allclose(found.lengths, spans, atol=1e-12)
    for cable, tension, gap in zip(robot.cables, found.tensions, paid - spans, strict=True):
        assert (cable in found.slack) == (gap > 1e-8)
        assert tension < 1e-6 * weight or gap < 1e-8, "a slack cable pulls"


# --- LARM


@pytest.mark.parametrize(("x", "y", "gamma"), [(0.5, 0.5, 0.0), (0.5, 0.3, 0.0), (0.3, 0.5, 0.0), (0.37, 0.62, 0.4)])
def test_energy_and_closures_find_one_equilibrium(x: float, y: float, gamma: float) -> None:
    configuration = hang_at(x=x, y=y, gamma=gamma)
    paid = lengths_of(configuration)
    found = find_equilibrium(larm(), paid)
    assert_balanced(found, paid)
    assert found.stability.verdict == "stable"
    assert not found.slack
    assert found.residual <= 1e-9
    for coordinate in ("x", "y", "z", "alpha", "beta", "gamma"):
        assert found[coordinate] == pytest.approx(configuration[coordinate], abs=1e-9), coordinate
    assert_allclose(found.tensions, [configuration[t] for t in ("t1", "t2", "t3", "t4")], rtol=1e-8)


def test_the_platform_is_level_in_the_middle_only() -> None:
    """models.md 5: with a central mass and headed along x it is level at x = L/2, and tilts elsewhere."""
    for y in (0.3, 0.5, 0.6):
        assert find_equilibrium(larm(), lengths_of(hang_at(y=y)))["beta"] == pytest.approx(0.0, abs=1e-10)
    tilt = [find_equilibrium(larm(), lengths_of(hang_at(x=x)))["beta"] for x in (0.3, 0.4, 0.45, 0.55, 0.6, 0.7)]
    assert all(a > b for a, b in itertools.pairwise(tilt))
    assert_allclose(tilt, -np.array(tilt[::-1]), atol=1e-10)
    assert tilt[2] > 0.05, "the end at the nearer side is up"
    level = [0.3, 0.5, -0.5, 0.0, 0.0, 0.0]
    assert not check_feasibility(larm(), level).is_feasible


def test_no_pose_within_the_cables_has_less_energy() -> None:
    """Poses around that no cable forbids, drawn at random: the weight lies higher in all of them."""
    robot, paid = larm(), lengths_of(hang_at(x=0.35, y=0.45, gamma=0.2))
    found = find_equilibrium(robot, paid)
    random = np.random.default_rng(0)
    poses = found.pose + random.normal(size=(4000, 6)) * random.choice([1e-3, 1e-2, 0.1], size=(4000, 1))
    allowed = np.all(cable_functions(robot).lengths(poses) <= paid, axis=1)
    assert allowed.sum() > 50
    energies = [9.81 * (Place.at(robot, p).p + Place.at(robot, p).R @ robot.centre)[2] for p in poses[allowed]]
    assert found.energy == pytest.approx(9.81 * (found["z"] + (found.R @ robot.centre)[2]))
    assert min(energies) > found.energy


def test_all_equilibria_of_larm() -> None:
    paid = lengths_of(hang_at(x=0.35, y=0.45, gamma=0.2))
    found = find_equilibria(larm(), paid)
    assert len(found) == 1
    assert found.missing_probability < 0.05
    assert not found.is_continuous
    assert sum(found.hits) == found.starts, "every start comes to rest"
    again = find_equilibria(larm(), paid)
    assert_allclose(again[0].pose, found[0].pose, atol=0)


def test_a_weight_on_the_line_of_the_ends_turns_freely() -> None:
    """Drop zero: nothing tells the turn about the line, so that equilibria are neutral; the closures call it idle."""
    robot, paid = larm(centre=(0, 0, 0)), lengths_of(hang_at())
    found = find_equilibria(robot, paid)
    assert found.is_continuous
    assert {pose.stability.verdict for pose in found} == {"neutral"}
    assert "neutral" in found[0].findings[0]
    assert np.abs(found[0].stability.softest[3]) > 0.99, "the turn about x"
    assert build_hanging(robot).kinematics.idle == ("alpha",)


def test_a_weight_above_the_line_of_the_ends_turns_over() -> None:
    """Ends below the centre of mass: the level equilibrium is none to rest in; the platform hangs upside down."""
    robot, paid = larm(centre=(0, 0, DROP)), lengths_of(hang_at())
    level = [0.5, 0.5, -0.5, 0.0, 0.0, 0.0]
    tensions = check_feasibility(robot, level).tensions
    stability = judge_stability(robot, level, tensions)
    assert stability.verdict == "unstable"
    assert any("the equilibrium is unstable" in finding for finding in report_cable_state(robot, level).findings)
    found = find_equilibria(robot, paid)
    assert len(found) == 1
    assert abs(found[0]["alpha"]) == pytest.approx(np.pi, abs=1e-9)
    assert_balanced(found[0], paid)


# --- Stability, on a bar


def curvature(centre: float) -> float:
    """Give the least curvature where the bar hangs level: each cable carries half of the weight along its slope."""
    return judge_stability(bar(centre), [0.5, -0.4, 0.0], np.full(2, 9.81 / 0.8)).least


def test_the_second_variation_is_that_of_the_energy() -> None:
    """Turn the bar with its lengths held, by closures without forces, and weigh it: energies differ by 1/2 c |z|^2."""
    robot = bar(0.15)
    kinematics, L = robot.robot.kinematics, robot.length_scale
    height = {}
    for turn in (-0.02, 0.0, 0.02):
        v = kinematics.solve({"q1": 0.5, "q2": 0.5, "theta": turn}, robot.robot.home).configuration
        height[turn] = v["y"] + 0.15 * np.cos(turn)
        if turn > 0:
            z = np.hypot((v["x"] - 0.5) / L, turn)
    second = (height[0.02] + height[-0.02] - 2 * height[0.0]) / (L * z**2)
    assert curvature(0.15) == pytest.approx(second, rel=1e-3)  # the difference has an error of second order in 0.02


def test_an_equilibrium_loses_its_stability_where_the_closures_lose_rank() -> None:
    """Raise the weight of the bar: at one height the curvature is zero, [N K] singular, and its sign turns there."""
    low, high = curvature(0.3), curvature(0.5)
    assert low > 0.0 > high
    critical = 0.3 + 0.2 * low / (low - high)  # the height of the weight enters the curvature linearly
    assert curvature(critical) == pytest.approx(0.0, abs=1e-12)

    def judge(centre: float) -> tuple[float, float, str]:
        machine = build_hanging(bar(centre))
        answer = machine.kinematics.solve({"x": 0.5, "y": -0.4}, machine.home)
        configuration = machine.kinematics.configuration(answer.X)
        rows = machine.kinematics.jacobians(answer.X)
        block = np.hstack([rows.N, rows.K])
        report = po.report_singularities(machine.kinematics, configuration)
        return float(np.linalg.det(block)), float(np.linalg.svd(block, compute_uv=False)[-1]), report.kind

    below, at, above = judge(critical - 0.05), judge(critical), judge(critical + 0.05)
    assert below[0] * above[0] < 0.0
    assert at[1] < 1e-8 < 1e-4 < min(below[1], above[1])
    assert (below[2], above[2]) == ("regular", "regular")
    assert "parallel" in at[2]


def test_beyond_it_the_bar_leans_to_either_side() -> None:
    found = find_equilibria(bar(0.6), LEVEL)
    assert len(found) == 2
    assert_allclose(found[0].pose * [1, 1, 1], found[1].pose * [-1, 1, -1] + [1, 0, 0], atol=1e-8)
    for pose in found:
        assert_balanced(pose, LEVEL)
        assert pose.stability.is_stable
    assert found[0].energy == pytest.approx(found[1].energy)
    assert judge_stability(bar(0.6), [0.5, -0.4, 0.0], np.full(2, 9.81 / 0.8)).verdict == "unstable"


def test_a_start_on_a_ridge_is_left() -> None:
    """The home pose is an equilibrium that does not hold: the platform falls off it to one that does."""
    leaning = find_equilibrium(bar(0.6), LEVEL)
    assert_balanced(leaning, LEVEL)
    assert leaning.stability.is_stable
    assert abs(leaning["theta"]) > 1.0
    robot = larm(centre=(0, 0, DROP))
    paid = cable_functions(robot).lengths(robot.home_pose)[0]
    over = find_equilibrium(robot, paid)
    assert_balanced(over, paid)
    assert abs(over["alpha"]) == pytest.approx(np.pi, abs=1e-9)


def test_states_and_stability_agree() -> None:
    for centre in (0.4, 0.45):
        lost = [f for f in report_cable_state(bar(centre), [0.5, -0.4, 0.0]).findings if "equilibrium" in f]
        assert bool(lost) is (curvature(centre) < 0)


# --- Slack, pulleys, many cables


@pytest.mark.parametrize(("third", "slack"), [(0.39, ("q1", "q2")), (0.41, ("q3",)), (0.6, ("q3",))])
def test_slack_cables_are_told(third: float, slack: tuple[str, ...]) -> None:
    robot = bar(-0.1, exits=[(0, 0), (1, 0), (0.5, 0)], attachments=[(-0.2, 0), (0.2, 0), (0, 0)], operational=None)
    paid = np.array([0.5, 0.5, third])
    (found,) = find_equilibria(robot, paid)
    assert_balanced(found, paid)
    assert tuple(found.slack) == slack
    assert f"cable {slack[0]!r} is slack by" in found.findings[0]


def test_a_tension_that_reaches_zero_is_told() -> None:
    """Under the side y = 0 of the square the two cables of that side carry all: the others are about to go slack."""
    paid = lengths_of(hang_at(y=0.0))
    found = find_equilibrium(larm(), paid)
    assert_balanced(found, paid)
    assert (found.loose, found.slack) == (("q2", "q4"), {})
    assert "the tension of cable 'q2' reaches zero" in found.findings
    inside = find_equilibrium(larm(), lengths_of(hang_at(y=0.05)))
    assert not inside.loose


def test_where_a_cable_would_have_to_push_it_goes_slack_instead() -> None:
    """Beyond the side of the square the closures ask for a push, and say so; the energy lets the platform swing in."""
    beyond = hanging().kinematics.inverse({"x": 0.5, "y": -0.05, "z": -0.5, "gamma": 0.0}, hanging().home_configuration)
    assert {"t2", "t4"} <= set(beyond.out_of_range)
    paid = lengths_of(beyond.configuration)
    found = find_equilibrium(larm(), paid)
    assert_balanced(found, paid)
    assert set(found.slack) == {"q2", "q4"}
    assert found["y"] == pytest.approx(0.0, abs=1e-9)


def test_cables_lie_over_pulleys() -> None:
    pulleys = [Pulley(radius=0.03, axis=(0, 0, -1)) for _ in range(4)]
    robot = larm(pulleys=pulleys)
    paid = cable_functions(robot).lengths([0.4, 0.45, -0.5, 0.1, 0.0, 0.0])[0]
    found = find_equilibrium(robot, paid)
    assert_balanced(found, paid)
    assert found.stability.is_stable
    eyes = find_equilibrium(larm(), paid)
    assert np.max(np.abs(found.pose - eyes.pose)) > 1e-3
    with pytest.raises(po.DefinitionError, match="has pulleys"):
        build_hanging(robot)


def draw(seed: int, n: int, planar: bool) -> tuple[CableRobot, Array]:
    """Draw a platform of random cables and lengths, some of them too long."""
    random = np.random.default_rng(seed)
    width = 2 if planar else 3
    exits, ends = random.uniform(-1, 1, (n, width)), random.uniform(-0.3, 0.3, (n, width))
    exits[:, -1] = random.uniform(1.0, 1.5, n)
    robot = CableRobot(
        name="random", exits=exits, attachments=ends, mass=random.uniform(0.5, 50), t_max=1e4, planar=planar,
        centre=random.uniform(-0.1, 0.1, width), gravity=(0, -9.81) if planar else (0, 0, -9.81),
        load=random.uniform(-1, 1, 3) if planar else [*random.uniform(-1, 1, 3), 0, 0, 0],
    )  # fmt: skip
    pose = np.zeros(robot.dof)
    pose[: width - 1] = random.uniform(-0.3, 0.3, width - 1)
    return robot, cable_functions(robot).lengths(pose)[0] + random.uniform(0, 0.2, n)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("n", [2, 3, 4, 8])
def test_random_platforms_come_to_rest(n: int, planar: bool) -> None:
    for seed in range(3):
        robot, paid = draw(100 * n + seed, n, planar)
        found = find_equilibria(robot, paid, EquilibriumOptions(max_starts=40))
        assert len(found) >= 1
        for pose in found:
            assert_balanced(pose, paid)
            assert pose.stability.verdict != "unstable"
        assert sum(found.hits) >= 0.9 * found.starts


# --- Motions, and the machinery of closed loops, through equilibria


@pytest.mark.slow
def test_assembly_modes_are_all_equilibria_and_the_stable_ones_those_of_least_energy() -> None:
    """Four lengths: the loops close with forces at several poses; the energy finds those in which a platform rests."""
    here = hang_at(x=0.35, y=0.45, gamma=0.2)
    robot = read_hanging(hanging())
    modes = hanging().kinematics.assembly_modes({q: here[q] for q in hanging().mechanism.active}, start=here)
    stable = []
    for mode in modes:
        v = mode.configuration
        pose = [v[c] for c in robot.coordinates]
        tensions = [v[t] for t in robot.cables]
        W, w = cable_functions(robot).both(pose)
        assert_allclose(W[0] @ tensions + w[0], 0.0, atol=1e-8)
        if judge_stability(robot, pose, tensions).is_stable:
            stable.append(pose)
    found = find_equilibria(robot, lengths_of(here))
    assert len(modes) > len(stable) == len(found)
    assert_allclose(np.sort(stable, axis=0), np.sort([p.pose for p in found], axis=0), atol=1e-8)


def test_a_motion_is_planned_through_equilibria() -> None:
    """Between the samples of a certified motion, too, forces balance and tensions keep their limits."""
    start = {"x": 0.3, "y": 0.4, "z": -0.5, "gamma": 0.0}
    goal = {"x": 0.65, "y": 0.6, "z": -0.4, "gamma": 0.3}
    problem = po.Problem(po.Scene(hanging()), start, goal, margins=po.Margins(clearance=0.002, singularity=0.05))
    plan = po.plan(problem)
    assert plan.certificate.passed
    X = plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 501))
    robot = read_hanging(hanging())
    index = hanging().mechanism.indices
    poses, tensions = X[:, index(robot.coordinates)], X[:, index(robot.cables)]
    W, w = cable_functions(robot).both(poses)
    left = np.einsum("kdn,kn->kd", W, tensions) + w
    assert np.max(np.abs(left)) <= 1e-9 * robot.weight
    assert np.all((robot.t_min <= tensions) & (tensions <= robot.t_max))
    assert np.ptp(poses[:, robot.coordinates.index("beta")]) > 0.4, "the tilt is computed, not imposed"
    for k in (0, 250, 500):
        assert judge_stability(robot, poses[k], tensions[k]).is_stable


# --- Machines and back


def test_a_machine_with_balance_is_read_back() -> None:
    robot = larm()
    machine = build_hanging(robot)
    again = read_hanging(machine)
    assert_allclose(again.exits, robot.exits)
    assert_allclose(again.attachments, robot.attachments)
    assert (again.mass, again.order, dict(again.home)) == (robot.mass, robot.order, dict(robot.home))
    of_library = read_hanging(hanging())
    assert of_library.cables == ("t1", "t2", "t3", "t4")
    paid = lengths_of(hang_at(x=0.4))
    assert_allclose(find_equilibrium(of_library, paid).pose, find_equilibrium(robot, paid).pose, atol=1e-12)


def test_loads_are_those_of_the_cable_robot() -> None:
    robot = bar(-0.1, load=(1.0, -2.0, 0.3))
    machine = build_hanging(robot)
    answer = machine.kinematics.solve({"x": 0.5, "y": -0.4}, machine.home).configuration
    W, w = cable_functions(robot).both([answer["x"], answer["y"], answer["theta"]])
    tensions = [answer["tension q1"], answer["tension q2"]]
    assert_allclose(W[0] @ tensions + w[0], 0.0, atol=1e-9)
    found = find_equilibrium(robot, [answer["q1"], answer["q2"]])
    assert_allclose(found.pose, [answer["x"], answer["y"], answer["theta"]], atol=1e-9)
    again = read_hanging(machine)
    assert_allclose(again.load, robot.load)
    spatial = larm(load=(1.0, 2.0, -3.0, 0.1, 0.2, 0.3))
    assert_allclose(read_hanging(build_hanging(spatial)).load, spatial.load)


def test_a_base_that_stands_elsewhere_moves_the_exits() -> None:
    """The exits of a machine are told in its base; a cable robot's in the world."""
    machine = build_hanging(bar(-0.1))
    links = [po.Base(k.name, at=(0.3, -0.2), rotation=(0, 0, 0.1)) if isinstance(k, po.Base) else k
             for k in machine.mechanism.links]  # fmt: skip
    moved = read_hanging(replace(machine, mechanism=replace(machine.mechanism, links=links)))
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    assert_allclose(moved.exits, np.array([(0, 0), (1, 0)]) @ turn.T + [0.3, -0.2], atol=1e-12)


def test_tensions_beyond_their_limits_are_named() -> None:
    robot = bar(-0.1, t_min=[1.0, 12.5], t_max=[12.0, 100.0])
    found = find_equilibrium(robot, LEVEL)  # 12.26 N in each
    assert found.out_of_limits == ("q1", "q2")
    assert find_equilibrium(bar(-0.1), LEVEL).out_of_limits == ()


def test_tilt_follows_from_its_coordinates_exactly() -> None:
    """The implicit-function theorem gives the slope of the tilt: the weight is in the graph like everything else."""
    kinematics = hanging().kinematics
    names = hanging().mechanism.operational
    here = hang_at(x=0.4, y=0.45)
    T = kinematics.tangent(here.X, names)[0]
    step = 1e-4
    ahead, behind = hang_at(x=0.4 + step, y=0.45), hang_at(x=0.4 - step, y=0.45)
    assert_allclose(T[:, 0], (ahead.X - behind.X) / (2 * step), atol=1e-5)


@pytest.mark.parametrize("order", ["".join(p) for p in itertools.permutations("xyz")])
def test_places_are_poses(order: str) -> None:
    robot = larm(order=order, operational=None)
    random = np.random.default_rng(3)
    for middle in (*random.uniform(-1.5, 1.5, 5), np.pi / 2, -np.pi / 2):
        pose = np.array([*random.uniform(-1, 1, 3), random.uniform(-3, 3), middle, random.uniform(-3, 3)])
        place = Place.at(robot, pose)
        again = Place.at(robot, place.pose(robot))
        assert_allclose(again.R, place.R, atol=1e-7)  # an arc sine near its end
        if abs(middle) < 1.5:
            assert_allclose(place.pose(robot), pose, atol=1e-12)


FAULTS: dict[str, tuple[Callable[[], Any], type[po.ParaoptError], str]] = {
    "no gravity": (lambda: find_equilibrium(bar(0, gravity=(0, 0)), LEVEL), po.DefinitionError, "nothing pulls"),
    "moment in space": (
        lambda: find_equilibrium(larm(load=(0, 0, 0, 0, 0, 1)), np.ones(4)), po.DefinitionError,
        "a moment that is constant in space has no potential energy",
    ),
    "number of lengths": (lambda: find_equilibrium(bar(0), [1.0]), po.DefinitionError, "there must be 2, one for each"),
    "no length": (lambda: find_equilibria(bar(0), [1.0, 0.0]), po.DefinitionError, "all above 0"),
    "too short": (lambda: find_equilibrium(bar(0), [0.2, 0.2]), po.SolveError, "comes to no rest"),
    "all too short": (
        lambda: find_equilibria(bar(0), [0.2, 0.2], EquilibriumOptions(max_starts=5)), po.SolveError, "from 5 starts"
    ),
    "tensions": (lambda: judge_stability(bar(0), [0, 0, 0], [1.0]), po.DefinitionError, r"must be \(2,\)"),
    "seed": (lambda: EquilibriumOptions(seed=-1), po.DefinitionError, "seed of the equilibria is -1"),
    "options": (lambda: EquilibriumOptions(slack=0.0), po.DefinitionError, "slack of the equilibria is 0.0"),
    "probability": (lambda: EquilibriumOptions(missing_probability=1.0), po.DefinitionError, "must be below 1"),
    "coordinates": (lambda: build_hanging(bar(0), ("x",)), po.DefinitionError, "2 cables and 1 independent"),
    "no balance": (lambda: read_hanging(po.robots.larm_spatial()), po.DefinitionError, "has 0 equilibria"),
    "not free": (lambda: read_hanging(_carried()), po.DefinitionError, "only a free platform hangs"),
}  # fmt: skip


def _carried() -> po.Robot:
    robot = hanging()
    links = [k if k.name != "platform" else po.Mobile("platform", ("x", "y", "z", "gamma", "beta"), order="zyx")
             for k in robot.mechanism.links]  # fmt: skip
    return replace(robot, mechanism=replace(robot.mechanism, links=links))


@pytest.mark.parametrize(("ask", "error", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_faults_are_named(ask: Callable[[], Any], error: type[po.ParaoptError], message: str) -> None:
    with pytest.raises(error, match=message):
        ask()
