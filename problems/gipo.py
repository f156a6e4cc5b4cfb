"""How should a dog of 17 servos move its trunk so that it never tips over while it walks, turns, or climbs?

The source (Lahouar, IV.3) lifts one foot at a time (right rear, right front, left rear, left front; steps of 60 mm,
half in the first and the last phase, 20 mm high) and moves the trunk 15 mm with each; where that is not stable the
trunk is moved by hand. Here its poses are found: the centre of gravity stays as far inside the support polygon as it
can at every instant, or the steps are made as fast as the drives and a stated margin allow. Masses, ranges and drive
limits are ours.

Expected: the gait as stated misses stability by 3 mm. The walk that is found keeps 45 mm, the turn of 15 degrees 40 mm,
with every mass up to 10 % off 39 and 34 mm; on a slope of 20 degrees the walk keeps 32 mm. For speed the steps grow to
twice their length. Every motion is certified over all phases and written as a RoboBASIC program.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

import paraopt as po
from paraopt import io, legged, view


@dataclass(frozen=True)
class Parameters:
    """Plan a gait of GIPO."""

    task: Literal["walk", "turn", "slope", "sideways"] = "walk"
    """What it does."""
    cycles: int = 1
    """How often the cycle of a walk is repeated."""
    step: float = 0.06
    """Length of a step [m]."""
    lift: float = 0.02
    """Height to which a foot is lifted [m]."""
    angle: float = 15.0
    """Angle of the turn [degrees]."""
    slope: float = 15.0
    """Rise of the ground ahead, on a slope [degrees]."""
    optimise: Literal["margin", "speed"] = "margin"
    """What the trunk's way is best in."""
    margin: float = 0.01
    """Support margin that a fast gait keeps [m]."""
    masses: float = 0.1
    """Share by which every mass may be wrong, for the margin that is left then."""
    trunk: float = -0.02
    """Height of the trunk at rest above the source's place, at which the legs are stretched [m]."""
    margins: po.Margins = field(default_factory=lambda: po.Margins(clearance=0.0, singularity=0.05))
    """Clearance [m] and distance to singularities."""
    output: Path | None = None
    """Folder of the results; none are written when not given."""


def build_footfalls(p: Parameters, model: legged.GaitModel, support: legged.Support) -> legged.Footfalls:
    """List which foot is lifted when, and to where."""
    if p.task == "turn":
        return legged.build_turn(model, support, math.radians(p.angle), p.lift)
    heading = 0.5 * math.pi if p.task == "sideways" else 0.0
    return legged.build_walk(model, support, step=p.step, lift=p.lift, heading=heading)


def main(p: Parameters) -> int:
    """Find the gait, plan it, and say what came out beside the gait as stated."""
    model = legged.GaitModel(po.robots.gipo_machine(po.robots.gipo(trunk_height=p.trunk)))
    support = legged.PlaneSupport(point=model.rest_places[0])
    gravity = legged.tilt_gravity(math.radians(p.slope) if p.task == "slope" else 0.0)
    aim = legged.GaitAim(p.optimise, margin=p.margin, scale=(0.5, 2.0) if p.optimise == "speed" else (1.0, 1.0))
    try:
        falls = build_footfalls(p, model, support)
        for what, gait in (
            ("as stated", legged.hold_trunk(falls, gravity=gravity)),
            ("found", best := legged.find_gait(falls, gravity=gravity, aim=aim)),
        ):
            looked = gait.sample()
            margin, worst = min(s.bound for s in looked), legged.measure_mass_margin(gait, p.masses)
            time = gait.times(looked).sum()
            print(
                f"{what}: support margin {1e3 * margin:.2f} mm, {1e3 * worst:.2f} mm with masses {100 * p.masses:g} % "
                f"off, steps of {1e3 * gait.scale * p.step:.0f} mm, {len(gait.phases)} phases in {time:.2f} s at most"
            )
        gait = best.repeated(p.cycles) if p.task != "turn" else best
        # half of what was found, and never tipping over with the inertia of what moves
        task = legged.build_gait_task(gait, support, stability=0.5 * margin, margins=p.margins, tipping=0.0)
        plan = legged.plan_legged(task)
        files = view.save_legged(plan, p.output) if p.output else {}
        program = io.build_robobasic(plan.trajectory, io.gipo_servos(), title=f"GIPO {p.task}")
        if p.output:
            files["program"] = program.write(p.output / "gipo.bas")
    except (po.ParaoptError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    travel, turn = 1e3 * math.hypot(*gait.travel[:3]), math.degrees(gait.travel[5])
    print(plan.summary)
    print(f"trunk and feet travel {travel:.1f} mm and {turn:.1f} degrees in {plan.trajectory.duration:.2f} s")
    print(f"RoboBASIC: {len(program.speeds)} moves, within {program.deviation:.2f} servo units of the motion")
    print(f"files: {', '.join(str(f) for f in files.values()) or 'none'}")
    return 0 if plan.certificate.passed else 1


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
