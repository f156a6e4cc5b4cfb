"""Can a machine tool with six actuators walk to its next work, and how must its platform stand to lift a foot?

The tripod (Tripod): a platform for machining on three legs of two linear actuators. To lift a foot it locks six passive
joints; a level platform cannot be held so (rank 5), so the platform first goes to a lock pose. Here that pose is the
one from which the locks hold best over the whole swing; the source's manner, a tilt of 0.3 rad, is told beside.

Tasks: `swing`, one foot; `step`, all three feet, one after the other; `scenario`, machining a circle with the tool
leaning to all sides, a step, the same work at the new place. No dimension is printed: all are ours.

Expected: swing of 80 mm, 2 phases, smallest singular value of the locks 0.215 (0.061 from the tilt of 0.3 rad);
scenario, a step of 60 mm, 9 phases, about 9 s, 0.226; all certified, locked joints and standing feet still to 1e-9.
"""

from __future__ import annotations

import sys
import time
import webbrowser
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import tyro

import paraopt as po
from paraopt.modes.legged import LeggedTask, PlaneSupport, plan_legged
from paraopt.modes.legged import tripod as tr

TIP = (0.0, 0.0, -0.1)  # of the tool, in the platform's frame [m]


@dataclass(frozen=True)
class Parameters:
    """Let the tripod walk, and machine."""

    task: Literal["swing", "step", "scenario"] = "scenario"
    """What it does."""
    shift: tuple[float, float, float] | None = None
    """Step of each foot in x, y, z [m]; 80 mm along x for the swing, 60 mm else, when not given."""
    turn: float = 0.0
    """Turn of the stance about the vertical [rad]; each foot takes its part of it."""
    lift: float = 0.03
    """How high a foot is lifted half way [m]."""
    bar: float = 0.0
    """Height of a bar across the way of foot 1 [m]; none when 0. Lift the feet by three times of it."""
    work: tuple[float, float, float] = (0.03, 0.12, 0.2)
    """Radius of the circle [m], lean of the tool [rad], height of its tip [m]."""
    limits: tuple[float, float, float] = (0.2, 1.0, 20.0)
    """Velocity [m/s], acceleration [m/s^2] and jerk [m/s^3] of the actuators."""
    margins: po.Margins = field(default_factory=po.Margins)
    """Clearance [m] and distance to singularities."""
    lock: tr.LockPoseOptions = field(default_factory=tr.LockPoseOptions)
    """How lock poses are searched for."""
    output: Path | None = None
    """Folder of the results; out/tripod-<task> when not given."""
    view: bool = False
    """Open the moving robot in the browser."""


def build_task(p: Parameters) -> tuple[LeggedTask, tr.TripodStep]:
    """Place the machine, its work and its new footholds, and find the lock poses."""
    shift = p.shift or ((0.08 if p.task == "swing" else 0.06), 0.0, 0.0)
    walker = po.robots.walking_tripod(velocity=p.limits[0], acceleration=p.limits[1], jerk=p.limits[2])
    home, support = walker.geometry.home_feet, PlaneSupport(walker.sole)
    goals = tr.move_frames(home, shift, p.turn)
    if p.bar:
        x, y = 0.5 * (home[0] + goals[0])[:2]
        bar = po.Box(name="bar", size=(0.02, 0.1, p.bar), pose=po.transform((x, y, walker.sole[2] + 0.5 * p.bar)))
        walker = replace(walker, scene=po.Scene(walker.robot, [bar]))
    if p.task == "scenario":
        places = (((0.0, 0.0, 0.0), 0.0), (shift, p.turn))
        before, after = (tr.follow_tool(tr.lean_round(*p.work, *place), TIP) for place in places)
        return tr.build_scenario(
            walker, home, goals, before, after, support, lift=p.lift, options=p.lock, margins=p.margins
        )
    order = (1,) if p.task == "swing" else tr.LEGS
    step = tr.tripod_step(walker, walker.geometry.home_pose, home, goals, order=order, lift=p.lift, options=p.lock)
    return tr.build_step_task(step, support, margins=p.margins), step


def main(p: Parameters) -> int:
    """Plan, save, and say what came out."""
    output = p.output or Path("out") / f"tripod-{p.task}"
    begin = time.perf_counter()
    try:
        task, step = build_task(p)
        plan = plan_legged(task, progress=lambda n, s: print(f"  {n:<28}{s:7.2f} s", file=sys.stderr, flush=True))
        seconds = time.perf_counter() - begin
        files = po.view.save_legged(plan, output)
    except (po.ParaoptError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    print(plan.summary, step.summary, sep="\n")
    print(f"planned {len(plan.phases)} phases in {seconds:.1f} s, lock poses included")
    print(f"files: {output.resolve()} ({', '.join(f.name for f in files.values())})")
    if p.view:
        webbrowser.open(files["page"].resolve().as_uri())
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
