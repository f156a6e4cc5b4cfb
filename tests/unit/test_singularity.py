"""Singularities: kinds, legs, signed distances, free motions and escapes at poses known to be singular."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants, MotionSpace
from support import Array, five_bar_robot, raf_configurations, raf_robot, two_rpr, two_rpr_values, vector


def closed(kinematics: po.Kinematics, values: dict[str, float]) -> po.Configuration:
    """Check that values close the loops as they are; nothing is solved."""
    return kinematics.configuration(vector(kinematics.mechanism, values))


# --- Five-bar: base 9, proximal bars 8 and 5, distal bars 5 and 8


def five_bar_values(theta1: float, theta3: float, upper: bool = True) -> dict[str, float]:
    """Close the five-bar by hand from the first leg; `upper` chooses the elbow of the second."""
    tip = 8 * np.array([np.cos(theta1), np.sin(theta1)]) + 5 * np.array(
        [np.cos(theta1 + theta3), np.sin(theta1 + theta3)]
    )
    w = tip - (9.0, 0.0)
    theta4 = np.arccos((w @ w - 25 - 64) / 80) * (1 if upper else -1)
    theta2 = np.arctan2(w[1], w[0]) - np.arctan2(8 * np.sin(theta4), 5 + 8 * np.cos(theta4))
    return {"theta1": theta1, "theta2": theta2, "theta3": theta3, "theta4": theta4, "x": tip[0], "y": tip[1]}


def aligned_distal_bars() -> dict[str, float]:
    """Put the distal bars in one line: elbows 13 apart. The tip then moves across with blocked drives."""
    theta1 = 2.2
    elbow1 = 8 * np.array([np.cos(theta1), np.sin(theta1)])
    # the second elbow: 5 from (9, 0) and 13 from the first
    d = np.array([9.0, 0.0]) - elbow1
    along = (d @ d + 169 - 25) / (2 * np.linalg.norm(d))
    u = d / np.linalg.norm(d)
    elbow2 = elbow1 + along * u + np.sqrt(169 - along**2) * np.array([-u[1], u[0]])
    direction = (elbow2 - elbow1) / 13
    angle = np.arctan2(direction[1], direction[0])
    theta2 = np.arctan2(elbow2[1], elbow2[0] - 9)
    tip = elbow1 + 5 * direction
    return {
        "theta1": theta1, "theta2": theta2, "theta3": angle - theta1, "theta4": angle + np.pi - theta2,
        "x": tip[0], "y": tip[1],
    }  # fmt: skip


def test_regular_five_bar() -> None:
    robot = five_bar_robot()
    report = po.report_singularities(robot.kinematics, robot.home_configuration)
    assert report.kind == "regular"
    assert not [s for s in (report.parallel, report.serial, report.constraint) if s.is_singular]
    assert (report.singular_legs, report.architectural) == ((), ())
    state = po.report_state(robot.kinematics, robot.home_configuration)
    assert abs(report.parallel.distance) == pytest.approx(state.parallel_margin, rel=1e-9)
    assert abs(report.serial.distance) == pytest.approx(state.serial_margin, rel=1e-9)
    assert np.sign(report.parallel.distance) == np.sign(state.parallel_determinant)


def test_parallel_singularity_of_the_five_bar() -> None:
    kinematics = five_bar_robot().kinematics
    values = aligned_distal_bars()
    report = po.report_singularities(kinematics, closed(kinematics, values))
    assert report.kind == "parallel"
    assert abs(report.parallel.distance) < 1e-12
    motion = report.parallel.motion
    # drives at rest, the tip moves across the line of the distal bars
    assert_allclose([motion.velocities["theta1"], motion.velocities["theta2"]], 0, atol=1e-9)
    angle = values["theta1"] + values["theta3"]
    velocity = np.array([motion.velocities["x"], motion.velocities["y"]])
    assert np.linalg.norm(velocity) > 0.1
    assert velocity @ (np.cos(angle), np.sin(angle)) == pytest.approx(0, abs=1e-9)
    assert_allclose(motion.twist[:2], velocity, atol=1e-12)
    assert set(motion.moving) == {"x", "y", "theta3", "theta4"}


def test_serial_singularity_names_its_leg() -> None:
    kinematics = five_bar_robot().kinematics
    report = po.report_singularities(kinematics, closed(kinematics, five_bar_values(1.0, 0.0)))
    assert report.kind == "serial ('theta1')"
    assert report.singular_legs == ("theta1",)
    assert [leg.leg for leg in report.legs] == ["theta1", "theta2"]
    motion = report.serial.motion
    assert_allclose([motion.velocities["x"], motion.velocities["y"]], 0, atol=1e-9)
    assert_allclose(motion.velocities["theta2"], 0, atol=1e-9)
    # the stretched leg turns about its foot, the distal bar back: 8 theta1' + 5 (theta1' + theta3') = 0
    assert 8 * motion.velocities["theta1"] + 5 * (
        motion.velocities["theta1"] + motion.velocities["theta3"]
    ) == pytest.approx(0, abs=1e-9)


def test_signs_are_those_of_the_branches() -> None:
    """The sign of a leg's block is the side of its elbow; the determinant's sign changes across a singularity."""
    kinematics = five_bar_robot().kinematics
    signs = {}
    for theta3 in (0.3, -0.3):
        for upper in (True, False):
            report = po.report_singularities(kinematics, closed(kinematics, five_bar_values(1.0, theta3, upper)))
            signs[theta3, upper] = tuple(np.sign(leg.distance) for leg in report.legs)
    assert len(set(signs.values())) == 4  # the four working modes
    assert all(signs[0.3, u][0] == -signs[-0.3, u][0] for u in (True, False))
    assert all(signs[t, True][1] == -signs[t, False][1] for t in (0.3, -0.3))


def test_parallel_and_serial_at_once() -> None:
    """Both legs of the 2-RPR along one line, one of them without length."""
    kinematics = po.Kinematics(two_rpr(), "virtual machine")
    report = po.report_singularities(kinematics, closed(kinematics, two_rpr_values(0.0, 0.0)))
    assert report.kind == "parallel and serial ('rho1')"
    only_parallel = po.report_singularities(kinematics, closed(kinematics, two_rpr_values(1.5, 0.0)))
    assert only_parallel.kind == "parallel"
    assert_allclose(only_parallel.parallel.motion.twist[:3] / np.linalg.norm(only_parallel.parallel.motion.twist[:3]),
                    (0, only_parallel.parallel.motion.twist[1] / abs(only_parallel.parallel.motion.twist[1]), 0),
                    atol=1e-9)  # fmt: skip


# --- Escapes


def step_along(kinematics: po.Kinematics, configuration: po.Configuration, motion: po.kinematics.FreeMotion,
               size: float) -> po.Configuration:  # fmt: skip
    """Go along a motion and close the loops again with the smallest correction."""
    moved = configuration.X + size * np.array([motion.velocities[n] for n in kinematics.mechanism.names])
    return kinematics.solve({}, moved).configuration


@pytest.mark.parametrize("which", ["parallel", "serial", "constraint", "leg"])
@pytest.mark.parametrize("robot", ["five-bar", "RAF"])
def test_escapes_grow_at_the_stated_rate(which: str, robot: str) -> None:
    machine = five_bar_robot() if robot == "five-bar" else raf_robot()
    kinematics = machine.kinematics
    start = machine.home_configuration if robot == "five-bar" else raf_configurations()[3]

    def pick(report: po.SingularityReport) -> po.kinematics.Singularity:
        return report.legs[0] if which == "leg" else getattr(report, which)

    chosen = Determinants.at(kinematics, start)
    here = pick(po.report_singularities(kinematics, start, determinants=chosen))
    assert here.escape is not None
    size = 1e-4
    values = [
        abs(
            pick(
                po.report_singularities(kinematics, step_along(kinematics, start, here.escape, s), 1e-6, chosen)
            ).distance
        )
        for s in (-size, size)
    ]
    # central difference; the rate itself is some 1e-6 to 1 per unit, and round-off of the distances 1e-13 / 1e-4
    assert (values[1] - values[0]) / (2 * size) == pytest.approx(here.rate, rel=1e-4, abs=3e-8)


def test_the_escape_leads_out_of_a_singularity_and_across() -> None:
    kinematics = five_bar_robot().kinematics
    start = closed(kinematics, aligned_distal_bars())
    chosen = Determinants.at(kinematics, five_bar_robot().home_configuration)
    report = po.report_singularities(kinematics, start, determinants=chosen)
    escape = report.parallel.escape
    assert escape is not None
    distances = []
    for size in (-1e-3, 1e-3):
        there = step_along(kinematics, start, escape, size)
        distances.append(po.report_singularities(kinematics, there, determinants=chosen).parallel.distance)
    assert distances[0] * distances[1] < 0  # one side and the other
    assert_allclose(np.abs(distances), 1e-3 * report.parallel.rate, rtol=1e-2)
    # no other direction leaves faster
    random = np.random.default_rng(0)
    E = kinematics.functions.scaled_jacobian(start.X)[0]
    V = po.kinematics.null_space(E)
    names = kinematics.mechanism.names
    for _ in range(20):
        c = random.normal(size=V.shape[1])
        motion = V @ (c / np.linalg.norm(c)) * kinematics.graph.variable_scale
        other = po.kinematics.FreeMotion(dict(zip(names, motion, strict=True)), np.zeros(6), ())
        there = step_along(kinematics, start, other, 1e-3)
        distance = po.report_singularities(kinematics, there, determinants=chosen).parallel.distance
        assert abs(distance) < 1e-3 * report.parallel.rate * 1.01


@pytest.mark.parametrize("which", ["parallel", "serial", "constraint"])
@pytest.mark.parametrize("name", ["hexa", "hayward_wrist", "three_upu", "lee", "gosselin_wrist", "delta"])
def test_escapes_from_symmetric_poses_grow_as_stated(name: str, which: str) -> None:
    """Several singular values agree there: the smallest of them must grow, whichever it is after the step."""
    robot = getattr(po.robots, name)()
    kinematics, start = robot.kinematics, robot.home_configuration
    here = getattr(po.report_singularities(kinematics, start), which)
    if here.escape is None:
        assert here.rate == 0
        return
    size = 1e-4
    there = po.report_singularities(kinematics, step_along(kinematics, start, here.escape, size))
    growth = (abs(getattr(there, which).distance) - abs(here.distance)) / size
    # a one-sided difference: curvature of order 1 times the step, and round-off of the distances over it
    assert growth == pytest.approx(here.rate, rel=1e-2, abs=2e-5)


def both_legs_straight() -> dict[str, float]:
    """Stretch both legs of the five-bar to 13: two serial singularities at once."""
    tip = np.array([4.5, np.sqrt(169 - 4.5**2)])
    first, second = np.arctan2(tip[1], tip[0]), np.arctan2(tip[1], tip[0] - 9)
    return {"theta1": first, "theta2": second, "theta3": 0.0, "theta4": 0.0, "x": tip[0], "y": tip[1]}


def test_the_escape_leads_out_of_two_singularities_at_once() -> None:
    kinematics = five_bar_robot().kinematics
    start = closed(kinematics, both_legs_straight())
    report = po.report_singularities(kinematics, start)
    assert report.kind == "serial ('theta1', 'theta2')"
    escape, rate = report.serial.escape, report.serial.rate
    assert escape is not None

    def leave(motion: po.kinematics.FreeMotion) -> float:
        there = step_along(kinematics, start, motion, 1e-4)
        return abs(po.report_singularities(kinematics, there).serial.distance) / 1e-4

    assert leave(escape) == pytest.approx(rate, rel=1e-3)
    # both legs must bend, and no other motion bends the worse one faster
    V = po.kinematics.null_space(kinematics.functions.scaled_jacobian(start.X)[0])
    names, scale = kinematics.mechanism.names, kinematics.graph.variable_scale
    others = [V @ (np.cos(t), np.sin(t)) * scale for t in np.linspace(0, np.pi, 24, endpoint=False)]
    rates = [leave(po.kinematics.FreeMotion(dict(zip(names, v, strict=True)), np.zeros(6), ())) for v in others]
    assert max(rates) < rate * 1.001
    assert min(rates) < 0.2 * rate


def test_where_closures_are_lost_the_drives_hold_nothing() -> None:
    """All bars in one line: parallel, serial and of the constraints, and out by one of the branches that meet there."""
    robot = po.robots.five_bar(base=2, proximal=(5, 5), distal=(5, 3), tip=(3, 7))
    kinematics = robot.kinematics
    flat = kinematics.configuration([0.0, 0.0, 0.0, 0.0, 10.0, 0.0])
    report = po.report_singularities(kinematics, flat)
    assert report.kind == "parallel and serial ('theta1', 'theta2') and of the constraints"
    assert report.architectural == ()
    free = report.parallel.motion
    assert_allclose([free.velocities["theta1"], free.velocities["theta2"]], 0, atol=1e-9)
    assert abs(free.velocities["y"]) > 0.1
    assert report.parallel.escape is None
    escape = report.constraint.escape
    assert escape is not None
    there = step_along(kinematics, flat, escape, 1e-4)
    assert abs(po.report_singularities(kinematics, there).constraint.distance) / 1e-4 == pytest.approx(
        report.constraint.rate, rel=1e-3
    )
    # the motion exists: closing the loops again moves nothing at first order
    moved = (there.X - flat.X) / 1e-4 / kinematics.graph.variable_scale
    stated = np.array([escape.velocities[n] for n in kinematics.mechanism.names]) / kinematics.graph.variable_scale
    assert_allclose(moved, stated, atol=1e-3)


# --- 3-RPR


@functools.cache
def three_rpr(corners: tuple[tuple[float, float], ...]) -> po.Kinematics:
    feet = ((-37.5, 21.651), (37.5, 21.651), (0.0, -43.301))
    links: list[po.mechanism.Link] = [po.Base(), po.Mobile("plate")]
    closures = []
    for i, (foot, corner) in enumerate(zip(feet, corners, strict=True), start=1):
        links.append(po.Series(f"leg {i}", "base", foot, po.Revolute(f"phi{i}")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=po.Prismatic(f"rho{i}", "x")))
        closures.append(po.Coincidence(f"rod {i}", (0, 0), "plate", corner))
    m = po.Mechanism("3-RPR", links, closures, ("rho1", "rho2", "rho3"), ("x", "y", "theta"), planar=True)
    return po.Kinematics(m, "virtual machine")


def three_rpr_at(kinematics: po.Kinematics, x: float, y: float, theta: float) -> po.Configuration:
    start = dict.fromkeys(("rho1", "rho2", "rho3"), 50.0)
    return kinematics.inverse({"x": x, "y": y, "theta": theta}, start).configuration


def test_legs_of_a_3_rpr_through_one_point() -> None:
    """T1 of models.md §4: the straight line crosses det A = 0 at t = 0.182; the plate turns about the common point."""
    kinematics = three_rpr(((0.0, 0.0), (15.0, 0.0), (7.5, 12.990)))
    start, goal = np.array([20, 0, 0.3]), np.array([-60, 50, 0.6])

    def distance(t: float) -> float:
        cfg = three_rpr_at(kinematics, *(start + t * (goal - start)))
        return po.report_singularities(kinematics, cfg).parallel.distance

    low, high = 0.15, 0.21
    sign = np.sign(distance(low))
    while high - low > 1e-13:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sign(distance(middle)) == sign else (low, middle)
    assert low == pytest.approx(0.182, abs=5e-4)
    cfg = three_rpr_at(kinematics, *(start + low * (goal - start)))
    report = po.report_singularities(kinematics, cfg, tolerance=1e-8)
    assert report.kind == "parallel"
    vx, vy, _, _, _, spin = report.parallel.motion.twist
    # instantaneous centre: where the velocity of the plate is zero; every leg's line goes through it
    centre = np.array([cfg["x"] - vy / spin, cfg["y"] + vx / spin])
    for i, foot in enumerate(((-37.5, 21.651), (37.5, 21.651), (0.0, -43.301)), start=1):
        direction = np.array([np.cos(cfg[f"phi{i}"]), np.sin(cfg[f"phi{i}"])])
        offset = centre - foot
        assert abs(direction[0] * offset[1] - direction[1] * offset[0]) < 1e-4 * np.linalg.norm(offset)


def test_a_platform_similar_to_its_base_is_singular_at_every_pose() -> None:
    """A plate similar to the triangle of the feet, in the same order, at theta = 0 is parallel to it: at every (x, y)
    the legs meet in one point. For a 3-RPR only that orientation is lost; for a flat Stewart platform it is every pose.
    """
    plate = tuple((0.2 * x, 0.2 * y) for x, y in ((-37.5, 21.651), (37.5, 21.651), (0.0, -43.301)))
    kinematics = three_rpr(plate)
    report = po.report_singularities(kinematics, three_rpr_at(kinematics, 7.0, -3.0, 0.0))
    assert (report.kind, report.architectural) == ("parallel", ())
    assert po.report_singularities(kinematics, three_rpr_at(kinematics, 7.0, -3.0, 0.5)).kind == "regular"


def stewart(corner_angles: Array) -> po.Kinematics:
    """Build a flat Stewart platform on a regular base, with the corners of its plate at given angles."""
    feet, corners = (
        np.column_stack([r * np.cos(a), r * np.sin(a), np.zeros(6)]).tolist()
        for r, a in ((1.0, FEET), (0.6, corner_angles))
    )
    robot = po.robots.stewart(feet, corners, height=1.2)
    return po.Kinematics(robot.mechanism, "virtual machine")


FEET = np.deg2rad([0, 40, 120, 160, 240, 280])


def stewart_at(kinematics: po.Kinematics, *pose: float) -> po.Configuration:
    values = dict(zip(kinematics.mechanism.operational, pose, strict=True))
    return kinematics.inverse(values, dict.fromkeys(kinematics.mechanism.active, 1.2)).configuration


def test_a_stewart_platform_similar_to_its_base_is_architecturally_singular() -> None:
    kinematics = stewart(FEET)
    for pose in ((0.1, -0.1, 1.2, 0.1, 0.2, 0.1), (0.0, 0.2, 1.0, -0.3, 0.1, 0.4)):
        report = po.report_singularities(kinematics, stewart_at(kinematics, *pose))
        assert report.architectural == ("parallel",)
        assert report.kind == "architectural (parallel at every pose)"
        assert abs(report.parallel.distance) < 1e-9
        assert np.linalg.norm(report.parallel.motion.twist) > 0.1
        assert max(abs(report.parallel.motion.velocities[q]) for q in kinematics.mechanism.active) < 1e-8
    fit = stewart(FEET + np.array([0.4, -0.38, 0.41, -0.4, 0.42, -0.39]))
    report = po.report_singularities(fit, stewart_at(fit, 0.1, -0.1, 1.2, 0.1, 0.2, 0.1))
    assert (report.kind, report.architectural) == ("regular", ())


def test_fichter_pose_of_a_stewart_platform() -> None:
    """A symmetric platform turned by a quarter about the vertical: parallel singularity (Fichter).

    The way out is not along the height, nor along the two translations: these keep the platform turned by a quarter.
    """
    kinematics = stewart(np.deg2rad([20 - 18, 20 + 18, 140 - 18, 140 + 18, 260 - 18, 260 + 18]))
    for height in (0.9, 1.3):
        report = po.report_singularities(kinematics, stewart_at(kinematics, 0, 0, height, 0, 0, np.pi / 2))
        assert report.kind == "parallel"
        assert report.architectural == ()
        assert report.parallel.escape is not None
        assert report.parallel.escape.velocities["gamma"] != pytest.approx(0, abs=1e-3)
    assert po.report_singularities(kinematics, stewart_at(kinematics, 0, 0, 1.1, 0, 0, 0.3)).kind == "regular"


def test_twists_are_seen_from_the_world() -> None:
    """Linear and angular velocity of the platform, from two poses a small step apart."""
    kinematics = stewart(FEET)
    cfg = stewart_at(kinematics, 0.1, -0.1, 1.2, 0.3, 0.5, -0.4)
    motion = po.report_singularities(kinematics, cfg).parallel.motion
    velocity = np.array([motion.velocities[n] for n in kinematics.mechanism.names])
    index = [link.name for link in kinematics.mechanism.links].index("platform")
    before, after = (kinematics.poses(cfg.X + h * velocity)[0, index] for h in (-1e-5, 1e-5))
    assert_allclose(motion.twist[:3], (after - before)[:3, 3] / 2e-5, atol=1e-8)
    spin = (after - before)[:3, :3] / 2e-5 @ (0.5 * (after + before))[:3, :3].T
    assert_allclose(motion.twist[3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)
    assert np.linalg.norm(motion.twist[3:]) > 0.1


# --- Delta, with the shifted elbows


def test_delta_is_singular_where_the_shifted_elbows_and_the_platform_lie_in_one_plane() -> None:
    """R1 1.8, R2 0.3, L1 2.4, L2 2.8: arms and platform at one height, B_i - R2 e_i in the plane of P.

    The source prints the condition with the real elbows, which is another one for R2 != 0.
    """
    R1, R2, L1, L2 = 1.8, 0.3, 2.4, 2.8
    robot = po.robots.delta()
    kinematics = robot.kinematics
    # symmetric pose: the shifted elbows on a circle of radius L2 about P, at P's height
    reach = (R2 + L2 - R1) / L1
    theta = float(np.arccos(reach))
    home = robot.home_configuration
    height = -L1 * np.sin(theta)
    values = {n: home[n] for n in kinematics.mechanism.names}
    # P is level with the elbows: rods stretched outwards; approach from the home, below
    heights = [height - gap for gap in (0.5, 0.2, 0.05, 0.01, 0.002)]
    distances = []
    start: po.Configuration = home
    for z in heights:
        start = kinematics.inverse({"x": 0.0, "y": 0.0, "z": z}, start).configuration
        distances.append(abs(po.report_singularities(kinematics, start).parallel.distance))
    assert values["z"] < height
    assert distances == sorted(distances, reverse=True)
    # |distance| goes to zero with the height of P under the plane of the shifted elbows
    assert distances[-1] / distances[-2] == pytest.approx(0.2, rel=0.1)


# --- Constraints


def test_flattened_parallelogram_loses_a_constraint() -> None:
    """Four bars in one line: the closures allow two motions where there is one elsewhere."""
    links = [
        po.Base(),
        po.Series("crank", "base", (0, 0), po.Revolute("a")),
        po.Series("coupler", "crank", (1, 0), po.Revolute("b")),
        po.Series("rocker", "base", (2, 0), po.Revolute("c")),
        po.Mobile("pen", ("x", "y")),
    ]
    ties = [
        po.Coincidence("coupler", (2, 0), "rocker", (1, 0)),
        po.Coincidence("coupler", (1, 0), "pen", (0, 0)),
    ]
    m = po.Mechanism("parallelogram", links, ties, ("a",), ("x", "y"), planar=True)
    kinematics = po.Kinematics(m, "virtual machine")
    flat = closed(kinematics, {"a": 0.0, "b": 0.0, "c": 0.0, "x": 2.0, "y": 0.0})
    report = po.report_singularities(kinematics, flat)
    assert report.constraint.is_singular
    assert "of the constraints" in report.kind
    state = po.report_state(kinematics, flat)
    assert (state.mobility, state.ranks["E"].value, state.general_ranks["E"]) == (2, 3, 4)
    assert "singular: E has 3 of 4" in str(state)
    up = closed(kinematics, {"a": 1.0, "b": -1.0, "c": 1.0, "x": 1 + np.cos(1.0), "y": np.sin(1.0)})
    assert not po.report_singularities(kinematics, up).constraint.is_singular


# --- Refused, and words


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf])
def test_faulty_tolerances_are_refused(tolerance: float) -> None:
    robot = five_bar_robot()
    with pytest.raises(po.DefinitionError, match="tolerance"):
        po.report_singularities(robot.kinematics, robot.home_configuration, tolerance)


def test_report_reads_well() -> None:
    robot = five_bar_robot()
    text = str(po.report_singularities(robot.kinematics, robot.home_configuration))
    assert text.startswith("five-bar: regular\n")
    for part in ("parallel", "serial 'theta1'", "constraint", "grows by", "free: "):
        assert part in text


def test_velocities_of_free_motions_close_the_loops() -> None:
    for configuration in raf_configurations()[:4]:
        kinematics = raf_robot().kinematics
        report = po.report_singularities(kinematics, configuration)
        E = np.hstack(kinematics.jacobians(configuration.X))
        for item in (report.parallel, report.serial):
            velocity: Array = np.array([item.motion.velocities[n] for n in kinematics.mechanism.names])
            assert_allclose(E @ velocity, 0, atol=1e-12)
            assert_allclose(item.motion.twist[3:], 0, atol=1e-9)  # the RAF's platform does not turn


def test_a_regular_machine_may_be_loose() -> None:
    """Of the five-bar one drive is let go: regular, and one motion that nothing holds."""
    robot = five_bar_robot()
    assert po.report_singularities(robot.kinematics, robot.home_configuration).unheld == 0
    weak = po.Kinematics(dataclasses.replace(robot.mechanism, active=("theta1",)), "virtual machine")
    report = po.report_singularities(
        weak, weak.configuration([robot.home_configuration[n] for n in weak.mechanism.names])
    )
    assert (report.kind, report.unheld) == ("regular", 1)
    assert str(report).startswith("five-bar: regular; under-actuated: 1 motion more than drives\n")


# --- Signs far from where equations were chosen


def test_dependent_rows_are_no_singularity() -> None:
    """A regular walk of a tripod on which its chosen rows of welds and leg loops come to depend on each other."""
    robot = po.robots.tripod()
    kinematics, names = robot.kinematics, robot.mechanism.operational
    space, chosen = MotionSpace(kinematics), Determinants.at(kinematics, robot.home_configuration)
    X = robot.home_configuration.X[None]
    first, goal = X[0, space.index].copy(), np.array([-0.126, -0.118, 0.214, -0.337, -1.087, -0.4])
    rows, lowest = [], []
    for t in np.linspace(0.0, 1.0, 60)[1:]:
        values = (first + t * (goal - first))[None]
        closed = kinematics.solve_batch(
            names, values, X + np.einsum("nvm,nm->nv", space.tangent(X), values - X[:, space.index])
        )
        assert closed.converged[0]
        X = closed.X
        margins = space.margins(X)
        lowest.append(min(margins.parallel[0], margins.serial[0]))
        (E,) = kinematics.functions.scaled_jacobian.batch(X)
        rows.append(np.linalg.slogdet(E[0, chosen.rows][:, chosen.serial_columns])[0])
    assert min(lowest) > 0.05, "the walk is regular"
    assert min(rows) < 0.0 < max(rows), "the rows that were chosen at home turn"
    before, after = (np.array(chosen.signs(x))[:, 0] for x in (robot.home_configuration.X, X))
    np.testing.assert_array_equal(after, before)
    np.testing.assert_array_equal(np.sign([v[0] for v in chosen(X)]), before)
