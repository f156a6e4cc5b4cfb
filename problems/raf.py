"""Can the RAF translational robot carry its tool from one side of an obstacle to the other, and at what speed?

The tasks of the thesis (Lahouar, IV.1.2): a free motion; a vertical cylinder in the way, passed at the side; a box too
wide to pass at the side, passed below. The source prints neither the poses of the obstacles nor the strokes: the
defaults here are ours, placed so that the straight motion is blocked by the tool. The cylinder and the box hang from
above, the cylinder lower than the robot can dip, the box wider than it can reach.

Expected: certified motions of about 120, 159 and 139 mm; the first stays straight, the second keeps its height
within a few millimetres and swings out by about 47 mm, the third dips by about 20 mm. The source needed about 20 s a
task on an Athlon 64.
"""

from __future__ import annotations

import sys
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

import paraopt as po


@dataclass(frozen=True)
class Parameters:
    """Plan a task of the RAF robot."""

    task: Literal["free", "cylinder", "box"] = "cylinder"
    """Which obstacle stands in the way."""
    start: tuple[float, float, float] = (-0.06, 0.0, 0.48)
    """Platform at the start [m]."""
    goal: tuple[float, float, float] = (0.06, 0.0, 0.48)
    """Platform at the goal [m]."""
    obstacle: tuple[float, float] = (0.0, 0.0)
    """Centre of the obstacle, x and y [m]."""
    cylinder: tuple[float, float, float] = (0.03, 0.4, 0.49)
    """Radius, length and lower end of the cylinder [m]."""
    box: tuple[float, float, float, float] = (0.06, 0.6, 0.3, 0.545)
    """Sizes along x, y, z and lower face of the box [m]."""
    limits: tuple[float, float, float] = (0.1, 0.5, 10.0)
    """Velocity [m/s], acceleration [m/s^2] and jerk [m/s^3] of the jacks; those of the file where a robot is read."""
    robot: Path | None = None
    """TOML file of the robot; that of the library when not given."""
    margins: po.Margins = field(default_factory=po.Margins)
    """Clearance [m] and distance to singularities."""
    retimer: Literal["toppra", "ruckig"] = "toppra"
    """Time-optimal, or jerk-limited."""
    period: float = 1e-3
    """Time between the rows of the trajectory file [s]."""
    output: Path | None = None
    """Folder of the results; out/raf-<task> when not given."""
    view: bool = False
    """Open the moving robot in the browser."""


def build_problem(p: Parameters) -> po.Problem:
    """Place the robot and the obstacle."""
    velocity, acceleration, jerk = p.limits
    library = po.robots.raf(velocity=velocity, acceleration=acceleration, jerk=jerk)
    robot = po.load_robot(p.robot) if p.robot else library
    (x, y), (radius, length, bottom), (*size, face) = p.obstacle, p.cylinder, p.box
    obstacles: dict[str, list[po.Cylinder | po.Box]] = {
        "free": [],
        "cylinder": [
            po.Cylinder(name="cylinder", radius=radius, length=length, pose=po.transform((x, y, bottom + length / 2)))
        ],
        "box": [po.Box(name="box", size=size, pose=po.transform((x, y, face + size[2] / 2)))],
    }
    start, goal = (dict(zip("xyz", pose, strict=True)) for pose in (p.start, p.goal))
    return po.Problem(po.Scene(robot, obstacles[p.task]), start, goal, margins=p.margins)


def main(p: Parameters) -> int:
    """Plan, save, and say what came out."""
    output = p.output or Path("out") / f"raf-{p.task}"
    retimer = po.TimeOptimal() if p.retimer == "toppra" else po.JerkLimited()
    try:
        plan = po.plan(
            build_problem(p),
            retimer=retimer,
            progress=lambda stage, seconds: print(f"  {stage:<8}{seconds:7.2f} s", file=sys.stderr, flush=True),
        )
        files = plan.save(output, period=p.period)
    except (po.ParaoptError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    print(plan.summary)
    print(f"files: {output.resolve()} ({', '.join(f.name for f in files.values())})")
    if p.view:
        webbrowser.open(files["page"].resolve().as_uri())
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
