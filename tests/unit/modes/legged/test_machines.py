"""Machines other than GIPO and the tripod: a biped on wide soles, and a hexapod that walks on three feet at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike, NDArray

import paraopt as po
from paraopt import legged

SOLE = ((0.09, 0.06, 0), (-0.05, 0.06, 0), (-0.05, -0.06, 0), (0.09, -0.06, 0))


def biped(free: tuple[str, ...] = ("x", "y", "z")) -> legged.LeggedMachine:
    """A trunk on two legs of three slides each, whose feet stay level, or turn about what is named as free."""
    links: list[po.mechanism.Link] = [po.Base("ground"), po.Mobile("trunk", ("x", "y", "z"))]
    closures, feet, slides = [], [], []
    home = {"x": 0.0, "y": 0.0, "z": 0.5}
    for side, y in (("left", 0.1), ("right", -0.1)):
        father, at = "trunk", (0.0, y, 0.0)
        for axis in "xyz":
            slide = po.Prismatic(f"{side} {axis}", axis=axis, range=(-0.6, 0.2))
            links.append(po.Series(f"{side} slide {axis}", father, at, slide))
            father, at = f"{side} slide {axis}", (0.0, 0.0, 0.0)
            slides.append(f"{side} {axis}")
        links.append(po.Mobile(f"{side} foot", free, prefix=f"{side} foot "))
        closures.append(po.Coincidence(father, (0, 0, 0), f"{side} foot", (0, 0, 0)))
        variables = [f"{side} foot {coordinate}" for coordinate in free]
        home |= dict.fromkeys(variables, 0.0) | {f"{side} foot y": y}
        home |= {f"{side} x": 0.0, f"{side} y": 0.0}
        home[f"{side} z"] = -0.5
        feet.append(legged.Foot(side, variables, father, carrier=f"{side} foot", upright=(0, 0, 1), sole=SOLE))
    placed = [name for foot in feet for name in foot.variables]
    mechanism = po.Mechanism("biped", links, closures, active=slides, operational=("x", "y", "z", *placed))
    limits = po.Limits(velocity=dict.fromkeys(slides, 0.5), acceleration=dict.fromkeys(slides, 2.0))
    masses = {"trunk": 2.0, "left slide z": 0.2, "right slide z": 0.2}
    return legged.LeggedMachine(po.Robot(mechanism, home, masses=masses, limits=limits), feet)


def walk(machine: legged.LeggedMachine, lean: float = 0.09) -> legged.LeggedTask:
    """Over the left foot, a step of the right one, and over both."""
    foot = machine.foot("right").variables
    return legged.LeggedTask(
        machine,
        (
            legged.Phase("over the left", machine.names, ("x", "y", "z"), {"y": lean}),
            legged.Phase(
                "step", ("left",), foot[:3], {foot[0]: 0.1}, ("x", "y", "z", *foot[3:]),
                [{foot[0]: 0.05, foot[2]: 0.05}], stability=0.01,
            ),
            legged.Phase("over both", machine.names, ("x", "y", "z"), {"x": 0.05, "y": 0.0}),
        ),
        legged.PlaneSupport(),
    )  # fmt: skip


@pytest.fixture(scope="module")
def plan() -> legged.LeggedPlan:
    return legged.plan_legged(walk(biped()))


def test_a_biped_walks_on_its_soles(plan: legged.LeggedPlan) -> None:
    machine, certificate = plan.task.machine, plan.certificate
    assert certificate.passed
    X = plan.trajectory(plan.trajectory.borders[1] + 1e-6)
    polygon = legged.build_polygon(machine, X, ("left",))
    assert sorted(polygon.corners) == ["left 1", "left 2", "left 3", "left 4"]
    # by hand: the trunk at y = 0.09, the feet at 0.1 and -0.1; the sole's inner edge is at 0.04
    assert_allclose(polygon.margin([[0, 0, 0]]), -0.04, atol=1e-9)
    centre = (2.0 * 0.09 + 0.2 * 0.1 - 0.2 * 0.1) / 2.4
    assert_allclose(legged.measure_support(machine, X, ("left",)), centre - 0.04, atol=1e-9)
    step = certificate.t[(certificate.t > plan.trajectory.borders[1]) & (certificate.t < plan.trajectory.borders[2])]
    assert len(step) > 100
    both = legged.build_polygon(machine, plan.trajectory(plan.trajectory.duration), machine.names)
    assert len(both.corners) == 6  # a hexagon round soles that are 0.1 m apart along x
    assert_allclose(plan.trajectory.at(plan.trajectory.duration)["right foot x"], 0.1, atol=1e-9)


def test_a_biped_that_does_not_shift_falls() -> None:
    with pytest.raises(po.InfeasibleError, match=r"'step' \(lifting 'right'\).*support margin.*-31\.667 mm"):
        legged.build_problems(walk(biped(), lean=0.01))  # 0.01 * 2 / 2.4 m, where 0.04 m is the edge


def test_a_foot_that_leans_does_not_stand() -> None:
    task = walk(biped())
    # the plane passes through both points of contact, so that only the soles are wrong
    slope = legged.PlaneSupport.tilted(0.1)
    with pytest.raises(po.InfeasibleError, match=r"'over the left': foot 'left' is to stand .* leans 5\.7296 degrees"):
        legged.build_problems(replace(task, support=slope))


def test_corners_of_a_lifted_sole_count(plan: legged.LeggedPlan) -> None:
    """Ground that rises in front of the foot: its point of contact stays above, its toes do not."""
    hill = np.tile(np.eye(4), (2, 1, 1))
    hill[1, :3, 3] = (0.26, -0.1, 0.02)  # nearest to the toes in the end, never to the point of contact
    task = replace(plan.task, support=legged.FrameSupport(hill))
    contacts = plan.task.machine.contacts(
        plan.trajectory.parts[1](np.linspace(0, plan.phases[1].trajectory.duration, 99))
    )
    assert np.min(legged.measure_height(task.support, contacts[0][:, 1])) > -1e-12
    problems = [phase.problem for phase in plan.phases]
    assert plan.certificate["lifted feet in the ground"].passed
    check = legged.verify_legged(task, problems, plan.trajectory)["lifted feet in the ground"]
    assert not check.passed
    assert check.value == pytest.approx(0.02, abs=1e-9)
    assert check.where == "phase 'step', foot 'right'"


def test_a_foot_that_nothing_holds_is_told() -> None:
    """While it is lifted no actuator says how a foot turns about the end of its leg."""
    task = walk(biped(("x", "y", "z", "alpha")))
    shift, step, _ = task.phases
    loose = replace(step, coordinates=task.machine.foot("right").variables, locked=("x", "y", "z"))
    with pytest.raises(po.InfeasibleError, match=r"phase 'step' \(lifting 'right'\).*parallel margin 0\.0000"):
        legged.plan_legged(replace(task, phases=(shift, loose)))


@dataclass(frozen=True, eq=False)
class Rocking:
    """A motion in which one variable sways and comes back to where it was."""

    motion: po.Trajectory
    variable: int
    amount: float

    @property
    def duration(self) -> float:
        return self.motion.duration

    def __call__(self, t: ArrayLike, order: int = 0) -> NDArray[np.float64]:
        X, s = np.array(self.motion(t, order)), np.pi * np.asarray(t) / self.duration
        if order < 2:
            X[..., self.variable] += self.amount * (
                np.sin(s) ** 2 if order == 0 else np.sin(2 * s) * np.pi / self.duration
            )
        return X


def test_a_standing_sole_that_rocks_is_seen() -> None:
    """About its point of contact, which stays where it is."""
    plan = legged.plan_legged(walk(biped(("x", "y", "z", "alpha"))))
    problems = [phase.problem for phase in plan.phases]
    i = plan.task.machine.robot.mechanism.index("left foot alpha")
    for amount, seen in ((3e-9, True), (3e-10, False)):  # a nanoradian is forgiven
        parts = [plan.trajectory.parts[0], Rocking(plan.phases[1].trajectory, i, amount), plan.trajectory.parts[2]]
        rocking = legged.LeggedTrajectory(plan.trajectory.robot, parts, plan.trajectory.marks)
        certificate = legged.verify_legged(plan.task, problems, rocking)
        check = certificate["standing feet turn"]
        assert check.passed is not seen
        assert check.value == pytest.approx(amount, rel=1e-3)
        assert certificate["standing feet move"].passed
    assert check.where == "phase 'step', foot 'left'"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sole": SOLE[:2]}, "sole of foot 'f' has 2 corners"),
        ({"upright": None}, "upright direction is None"),
        ({"sole": (*SOLE, (0, 0, 0.01))}, r"corner 4 of the sole of foot 'f' is 0\.01 m out of the plane"),
    ],
)
def test_faulty_soles_are_refused(change: dict[str, object], words: str) -> None:
    stated = {"name": "f", "variables": ["x"], "link": "shin", "upright": (0, 0, 1), "sole": SOLE}
    with pytest.raises(po.DefinitionError, match=words):
        legged.Foot(**{**stated, **change})  # type: ignore[arg-type]


# --- Six legs


def hexapod() -> legged.LeggedMachine:
    """A flat trunk; each leg turns about z at the hip, and lifts and bends about x."""
    links: list[po.mechanism.Link] = [po.Base("ground"), po.Mobile("trunk")]
    closures, feet, servos, masses = [], [], [], {"trunk": 1.5}
    home = {**dict.fromkeys(("x", "y", "alpha", "beta", "gamma"), 0.0), "z": 0.12}
    for name, x, side in [(f"{e} {s}", x, y) for e, x in (("front", 0.14), ("middle", 0.0), ("rear", -0.14))
                          for s, y in (("left", 1), ("right", -1))]:  # fmt: skip
        father, at = "trunk", (x, 0.06 * side, 0.0)
        for joint, axis, out in (("hip", "z", 0.05), ("lift", "x", 0.08), ("knee", "x", 0.0)):
            servo = po.Revolute(f"{name} {joint}", axis=axis, range=(-1.6, 1.6))
            links.append(po.Series(f"{name} {joint}", father, at, servo))
            father, at = f"{name} {joint}", (0.0, out * side, 0.0)
            servos.append(father)
            masses[father] = 0.05
        links.append(po.Mobile(f"{name} foot", ("x", "y", "z"), prefix=f"{name} "))
        closures.append(po.Coincidence(father, (0, 0, -0.12), f"{name} foot", (0, 0, 0)))
        variables = [f"{name} {axis}" for axis in "xyz"]
        home |= dict(zip(variables, (x, 0.19 * side, 0.0), strict=True))
        feet.append(legged.Foot(name, variables, father, (0, 0, -0.12), carrier=f"{name} foot"))
    placed = [name for foot in feet for name in foot.variables]
    pose = ("x", "y", "z", "alpha", "beta", "gamma")
    mechanism = po.Mechanism("hexapod", links, closures, active=servos, operational=(*pose, *placed))
    limits = po.Limits(velocity=dict.fromkeys(servos, 4.0), acceleration=dict.fromkeys(servos, 40.0))
    home |= dict.fromkeys(servos, 0.0)
    return legged.LeggedMachine(po.Robot(mechanism, home, masses=masses, limits=limits), feet)


@pytest.mark.slow  # 42 variables are compiled
def test_a_hexapod_walks_on_three_feet_at_a_time() -> None:
    machine = hexapod()
    first = ("front left", "middle right", "rear left")
    second = tuple(name for name in machine.names if name not in first)
    phases = []
    for k, (name, swinging, standing) in enumerate((("one", first, second), ("two", second, first))):
        goal = {"x": 0.02 * (k + 1), **{f"{foot} x": machine.robot.home[f"{foot} x"] + 0.04 for foot in swinging}}
        moving = [v for foot in swinging for v in machine.foot(foot).variables]
        via = {f"{foot} z": 0.03 for foot in swinging}
        pose = ("x", "y", "z", "alpha", "beta", "gamma")
        phases.append(legged.Phase(name, standing, (*pose, *moving), goal, via=[via], stability=0.01))
    plan = legged.plan_legged(legged.LeggedTask(machine, phases, legged.PlaneSupport()))
    assert plan.certificate.passed
    assert plan.certificate.smallest_margin > 0.04
    X = plan.trajectory(np.array([0.0, plan.trajectory.duration]))
    i = machine.robot.mechanism.index("x")
    travel = np.diff(machine.contacts(X)[0], axis=0)[0]
    # the trunk travels exactly as far as the feet
    assert_allclose(travel, np.tile([X[1, i] - X[0, i], 0.0, 0.0], (6, 1)), atol=1e-9)
