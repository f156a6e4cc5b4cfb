"""Motions that several test files look at: the three tasks of the RAF robot, planned once, and a planar 3-RPR.

Tests import it as `from motions import ...`; pytest puts this folder on the path.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import paraopt as po
from paraopt.planning.verify import Motion
from paraopt.shapes import Shape
from support import raf_robot

Array = NDArray[np.float64]

# --- The tasks of the RAF robot, stated here again: the script's own defaults are compared with them

TASKS = ("free", "cylinder", "box")
START: Mapping[str, float] = {"x": -0.06, "y": 0.0, "z": 0.48}
GOAL: Mapping[str, float] = {"x": 0.06, "y": 0.0, "z": 0.48}
CLEARANCE, SINGULARITY = 0.005, 0.05
VELOCITY, ACCELERATION, JERK = 0.1, 0.5, 10.0
TOOL_RADIUS, TOOL_TOP = 0.012, 0.08  # the tool stands upright on the platform's origin [m]
CYLINDER_RADIUS = 0.03
BOX_SIZE, BOX_FACE = (0.06, 0.6, 0.3), 0.545  # sides, and height of the lower face [m]
OBSTACLES: Mapping[str, tuple[Shape, ...]] = {
    "free": (),
    "cylinder": (
        po.Cylinder(name="cylinder", radius=CYLINDER_RADIUS, length=0.4, pose=po.transform((0.0, 0.0, 0.49 + 0.2))),
    ),
    "box": (po.Box(name="box", size=BOX_SIZE, pose=po.transform((0.0, 0.0, BOX_FACE + 0.15))),),
}


def raf_problem(task: str = "free", **changes: Any) -> po.Problem:
    """State a task of the RAF robot, or a variant of it."""
    options: dict[str, Any] = {"start": START, "goal": GOAL, "margins": po.Margins(CLEARANCE, SINGULARITY)}
    scene = changes.pop("scene", None) or po.Scene(raf_robot(), OBSTACLES[task])
    return po.Problem(scene, **{**options, **changes})


@functools.cache
def problem_of(task: str) -> po.Problem:
    """Give the problem of a task; do not change it."""
    return raf_problem(task)


@functools.cache
def plan_of(task: str) -> po.Plan:
    """Give the plan of a task with all defaults; do not change it."""
    return po.plan(problem_of(task))


@functools.cache
def cable_plan() -> po.Plan:
    """Plan a motion of LARM's cable robot in the plane past a post; do not change it."""
    post = po.Box(size=(0.12, 0.12, 0.2), pose=po.transform((0.5, 0.3, 0.0)), name="post")
    scene = po.Scene(po.robots.larm_planar(), [post])
    start, goal = {"x": 0.3, "y": 0.62, "theta": 0.0}, {"x": 0.7, "y": 0.6, "theta": 0.1}
    return po.plan(po.Problem(scene, start, goal, margins=po.Margins(clearance=0.01, singularity=0.01)))


@functools.cache
def jerk_limited_of(task: str) -> po.Trajectory:
    """Time the path of a task with limited jerk."""
    return po.JerkLimited().retime(problem_of(task), plan_of(task).path)


def other_elbow(arm: str, pose: Mapping[str, float] = GOAL) -> po.Configuration:
    """Solve a pose of the RAF with one arm's elbow on the other side: both forearms of the arm turn over."""
    robot = raf_robot()
    usual = robot.kinematics.inverse(pose, start=robot.home_configuration).configuration
    first = {**usual.as_dict(), f"arm {arm}": usual[f"arm {arm}"] - 1.8}
    first.update({f"cross {arm}{side}": usual[f"cross {arm}{side}"] - np.pi for side in "+-"})
    flipped = robot.kinematics.inverse(pose, start=first).configuration
    assert abs(flipped[f"arm {arm}"] - usual[f"arm {arm}"]) > 0.5  # else this helper is of no use
    return flipped


# --- A planar machine whose platform turns


def three_rpr(
    at_base: Sequence[Sequence[float]],
    at_platform: Sequence[Sequence[float]],
    home: Mapping[str, float],
    strokes: tuple[float, float],
    shapes: Mapping[str, Sequence[Shape]] | None = None,
) -> po.Robot:
    """Describe a 3-RPR: three driven legs between a base and a platform with pose x, y, theta."""
    links: list[Any] = [po.Base()]
    closures, values = [], dict(home)
    turn = np.exp(1j * home["theta"])
    for i, (a, b) in enumerate(zip(at_base, at_platform, strict=True), start=1):
        slide = po.Prismatic(f"rho{i}", axis="x", range=strokes)
        links.append(po.Series(f"leg {i}", "base", at=tuple(a), joint=po.Revolute(f"phi{i}")))
        links.append(po.Series(f"rod {i}", f"leg {i}", joint=slide))
        closures.append(po.Coincidence(f"rod {i}", (0, 0), "platform", tuple(b)))
        leg = complex(home["x"], home["y"]) + turn * complex(*b) - complex(*a)
        values |= {f"rho{i}": abs(leg), f"phi{i}": float(np.angle(leg))}
    drives = ("rho1", "rho2", "rho3")
    mechanism = po.Mechanism(
        "3-RPR",
        [*links, po.Mobile("platform", coordinates=("x", "y", "theta"))],
        closures,
        active=drives,
        operational=("x", "y", "theta"),
        planar=True,
    )
    limits = po.Limits(
        velocity=dict.fromkeys(drives, 0.5), acceleration=dict.fromkeys(drives, 2.0), jerk=dict.fromkeys(drives, 50.0)
    )
    return po.Robot(mechanism, home=values, shapes=shapes or {}, limits=limits)


def _triangle(radius: float, turn: float) -> list[tuple[float, float]]:
    angles = turn + 2.0 * np.pi * np.arange(3) / 3.0
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angles]


@functools.cache
def turning_robot() -> po.Robot:
    """Give a 3-RPR that is far from singular at theta = pi, with a disc on its platform; do not change it."""
    disc = po.Cylinder(name="disc", radius=0.05, length=0.1)
    # the platform's triangle is turned by a quarter: at theta = 0 and pi the legs pull with the longest levers
    home = {"x": 0.0, "y": 0.0, "theta": 3.0}
    return three_rpr(_triangle(1.0, 0.0), _triangle(0.3, 0.5 * np.pi), home, (0.2, 2.5), {"platform": [disc]})


@functools.cache
def turning_problem(blocked: bool) -> po.Problem:
    """Ask the turning robot for a motion whose short way leads through theta = pi; a ball may stand in its way."""
    ball = [po.Sphere(name="ball", radius=0.05)] if blocked else []
    scene = po.Scene(turning_robot(), ball)
    return po.Problem(scene, {"x": -0.15, "y": 0.0, "theta": 3.0}, {"x": 0.15, "y": 0.0, "theta": -3.0})


# --- Independent looks


def straight_line(problem: po.Problem, count: int = 201) -> Array:
    """Walk straight from the start to the goal in small steps, without the planner; shape (count, n_variables)."""
    robot, names = problem.robot, problem.independent
    X = [problem.start_configuration.X]
    first, last = X[0][robot.mechanism.indices(names)], problem.goal_values()
    for share in np.linspace(0.0, 1.0, count)[1:]:
        closed = robot.kinematics.solve_batch(names, (first + share * (last - first))[None], X[-1][None])
        assert closed.converged[0]
        X.append(closed.X[0])
    return np.array(X)


def distance_of_uprights(xy: Array, z_low: ArrayLike, z_high: ArrayLike, obstacle: str) -> Array:
    """Measure the distance between the upright tool and an upright obstacle by hand, for n positions of its axis.

    Args:
        xy: Positions of the tool's axis [m], shape (n, 2).
        z_low: Lower end of the tool [m].
        z_high: Upper end of the tool [m].
        obstacle: "cylinder" or "box".

    Returns:
        Distances [m]: positive apart, otherwise zero or less.
    """
    if obstacle == "cylinder":
        gap, face = np.linalg.norm(xy, axis=1) - CYLINDER_RADIUS, 0.49
    else:
        outside = np.maximum(np.abs(xy) - 0.5 * np.array(BOX_SIZE[:2]), 0.0)
        gap, face = np.linalg.norm(outside, axis=1), BOX_FACE
    gap = gap - TOOL_RADIUS
    above = face - np.asarray(z_high)
    assert np.all(np.asarray(z_low) < np.asarray(z_high))
    return np.where((gap > 0.0) & (above > 0.0), np.hypot(gap, above), np.maximum(gap, above))


# --- Corrupted motions


@dataclass(frozen=True, eq=False)
class Altered:
    """Change what another motion answers: all that `verify` needs of a trajectory is a duration and a call.

    Attributes:
        motion: The motion.
        change: Gets the times, the answer and the order; returns another answer.
        length: Duration [s]; that of the motion when None.
    """

    motion: Motion
    change: Callable[[Array, Array, int], Array]
    length: float | None = None

    @property
    def duration(self) -> float:
        return self.motion.duration if self.length is None else self.length

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        times = np.asarray(t, dtype=float)
        return self.change(times, np.array(self.motion(times, order)), order)
