"""How do cables carry a platform round obstacles, pulling all the time, and when must it rise before it may pass?

The tasks are those of the thesis' cable robot (Lahouar, IV.2), of which it prints no dimension: robot, obstacles and
poses are ours. `planar`: four cables hold a platform with a gripper in an upright square, over a wall. `chain`: a
platform hangs from four cables, goes from rest to a start, past a post to a goal, and back to rest: three plans, one
motion. `rise`: low on both sides of a wall. `ipanema`: IPAnema 1 with eight cables, past a ball; geometry, mass and
largest tensions are those of CASPR's files, the least tension and the speeds of the winches are ours.

Expected: the straight way from start to goal is blocked. In `rise` a cable touches the wall before the platform does,
which rises first, by about 0.2 m. Every tension is within its limits at 4001 times of inverse dynamics. What hangs from
four cables has four independent coordinates, x, y, z, gamma: its tilt follows by a balance that stays stable, and
inertia leaves at most 2 % of the weight unbalanced. Exit code 0 only if motions and cables are certified.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

import paraopt as po
from paraopt.io import load_caspr
from paraopt.modes import cable
from paraopt.planning import PathConstraint

CASPR = Path(__file__).resolve().parents[1] / "tests" / "data" / "caspr" / "IPAnema_1"
Pose = dict[str, float]
Task = tuple[po.Scene, cable.CableRobot, list[tuple[str, Pose]]]


@dataclass(frozen=True)
class Parameters:
    """Plan a task of a cable robot."""

    task: Literal["planar", "chain", "rise", "ipanema"] = "rise"
    """Which robot does what."""
    caspr: Path = CASPR
    """Folder of CASPR's XML files, for `ipanema`."""
    tension: float = 0.2
    """Least distance of tensions from their limits at rest, as a share of the weight per cable [1]."""
    sway: float = 0.02
    """Largest unbalanced inertia of a hanging platform, as a share of the weight [1]."""
    retimer: Literal["ruckig", "toppra"] = "ruckig"
    """Jerk-limited, so that tensions change without jumps, or time-optimal."""
    margins: po.Margins = field(default_factory=lambda: po.Margins(clearance=0.015, singularity=0.01))
    """Clearance [m] and distance to singularities."""
    period: float = 0.01
    """Time between commands of the winches [s]."""
    output: Path | None = None
    """Folder of the results; none are written when not given."""


def build_planar(p: Parameters) -> Task:
    """Carry a gripper over a wall in an upright square."""
    robot = po.robots.larm_planar()
    gripper = po.Capsule.between((0, -0.16, 0), (0, 0, 0), 0.01, "gripper")
    robot = replace(robot, shapes={**robot.shapes, "platform": [*robot.shapes["platform"], gripper]})
    exits, points = (np.array([c.points[k][:2] for c in robot.cables]) for k in (0, 1))
    cables = cable.CableRobot(
        name=robot.name, exits=exits, attachments=points, mass=1.0, inertia=0.005, t_min=1.0, t_max=60.0, planar=True,
        gravity=(0, -9.81), home={"x": 0.5, "y": 0.5}, velocity=0.5, acceleration=2.0,
    )  # fmt: skip
    wall = po.Box(name="wall", size=(0.04, 0.2, 0.03), pose=po.transform((0.5, 0.1, 0)))
    beam = po.Box(name="beam", size=(0.04, 0.46, 0.03), pose=po.transform((0.5, 0.75, 0)))
    places = [("start", {"x": 0.25, "y": 0.3, "theta": 0.0}), ("goal", {"x": 0.75, "y": 0.3, "theta": 0.0})]
    return po.Scene(robot, [wall, beam]), cables, places


def build_chain(p: Parameters) -> Task:
    """Hang a platform from four cables; a post stands between start and goal."""
    robot = po.robots.larm_hanging(tension=(0.5, 8.0))
    post = po.Cylinder(name="post", radius=0.05, length=0.26, pose=po.transform((0.5, 0.5, -0.87)))
    block = po.Box(name="block", size=(0.16, 0.16, 0.28), pose=po.transform((0.35, 0.65, -0.86)))
    rest, start, goal = ((0.5, 0.5, -0.35, 0.0), (0.25, 0.35, -0.8, 0.0), (0.75, 0.65, -0.8, 0.3))
    poses = zip(("rest", "start", "goal", "rest"), (rest, start, goal, rest), strict=True)
    places = [(name, dict(zip(robot.mechanism.operational, pose, strict=True))) for name, pose in poses]
    return po.Scene(robot, [post, block]), cable.read_hanging(robot, robot.mechanism.active), places


def build_rise(p: Parameters) -> Task:
    """Hang a platform from four cables, low on both sides of a wall."""
    robot = po.robots.larm_hanging(tension=(0.5, 8.0))
    wall = po.Box(name="wall", size=(0.06, 0.6, 0.25), pose=po.transform((0.5, 0.5, -0.875)))
    pose = {"y": 0.45, "z": -0.85, "gamma": 0.0}
    places = [("start", {"x": 0.25, **pose}), ("goal", {"x": 0.75, **pose})]
    return po.Scene(robot, [wall]), cable.read_hanging(robot, robot.mechanism.active), places


def build_ipanema(p: Parameters) -> Task:
    """Read IPAnema 1 and put a ball in its way."""
    plate = po.Box(name="plate", size=(0.12, 0.12, 0.04))
    cables = replace(load_caspr(p.caspr).robot, velocity=1.0, acceleration=3.0, jerk=60.0, solids=[plate], t_min=10.0)
    ball = po.Sphere(name="ball", radius=0.15, pose=po.transform((0, 0, 1.0)))
    level = dict.fromkeys(cables.coordinates, 0.0)
    places = [("start", level | {"x": -0.8, "y": 0.1, "z": 1.0}), ("goal", level | {"x": 0.8, "y": 0.1, "z": 1.0})]
    return po.Scene(cables.robot, [ball]), cables, places


def plan_task(
    p: Parameters, scene: po.Scene, cables: cable.CableRobot, places: Sequence[tuple[str, Pose]]
) -> list[po.Plan]:
    """Plan from place to place, each motion from the end of the one before."""
    hangs = cables.n_cables < cables.dof
    limits: list[PathConstraint] = [cable.TensionLimits(cables)]
    limits += [cable.SwayLimits(cables, p.sway)] if hangs else []
    retimer = po.JerkLimited() if p.retimer == "ruckig" else po.TimeOptimal()
    margin = cable.TensionMargin(cables, scene.robot.mechanism, margin=p.tension * cables.weight / cables.n_cables)
    plans: list[po.Plan] = []
    here: Mapping[str, float] | po.Configuration = places[0][1]
    for (a, _), (b, there) in pairwise(places):
        problem = po.Problem(scene, here, there, margins=p.margins, conditions=(margin,), dynamics=limits)
        plans.append(po.plan(problem, retimer=retimer))  # raises if the certificate fails
        index = scene.robot.mechanism.index("y" if cables.planar else "z")
        height = plans[-1].trajectory(np.linspace(0.0, plans[-1].trajectory.duration, 1001))[:, index]
        print(f"{a} -> {b}: independent coordinates {', '.join(problem.independent)}; rises by ", end="")
        print(f"{np.max(height) - height[0]:.3f} m\n{plans[-1].summary}")
        here = problem.goal
    return plans


def main(p: Parameters) -> int:
    """Plan the task, judge what the cables feel, write the files."""
    build = {"planar": build_planar, "chain": build_chain, "rise": build_rise, "ipanema": build_ipanema}[p.task]
    try:
        scene, cables, places = build(p)
        plans = plan_task(p, scene, cables, places)
        chain = cable.MotionChain([plan.trajectory for plan in plans])
        certificate = cable.verify_cables(cables, chain, tolerances=cable.CableTolerances(sway=p.sway))
        print(
            f"{certificate.summary}\nall together {chain.duration:.3f} s, jumps {np.max(chain.jumps, initial=0.0):.1e}"
        )
        if p.output:
            for plan, (name, _) in zip(plans, places[1:], strict=True):
                plan.save(p.output / f"to-{name}")
            names = [f"{a} to {b}" for (a, _), (b, _) in pairwise(places)]
            files = po.view.save_cables(p.output, scene, chain, certificate, period=p.period, names=names)
            print(f"files: {p.output} ({', '.join(f.name for f in files.values())}; to-...: each motion)")
        certificate.check_passed()
    except (po.ParaoptError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
