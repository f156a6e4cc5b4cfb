"""How long does a walk or a turn of GIPO take to find and to plan, beside the number of its phases?

Every gait is found anew; the functions of the robot are compiled before. "find" is the trunk's way by optimisation,
looked at ten times more densely; the others are the stages of the general planner, over all phases. Programs of one
shape are built once: "find again" is the same without the building.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

from benchmarks.tables import table
from problems.gipo import Parameters, build_footfalls

import paraopt as po
from paraopt import legged

TASKS = ("turn", "walk")
STAGES = ("prepare", "refine", "retime", "verify")


def measure(runs: int = 3) -> dict[str, Any]:
    """Find and plan each task several times after a warm-up, and keep the medians."""
    result: dict[str, Any] = {"runs": runs, "tasks": {}}
    for task in TASKS:
        _run(task)
        found = [_run(task) for _ in range(runs)]
        entry: dict[str, Any] = {name: statistics.median(each[name] for each in found) for name in found[0]}
        entry["certified"] = all(each["certified"] for each in found)
        result["tasks"][task] = entry
    return result


def show(result: dict[str, Any]) -> str:
    rows = []
    for task, entry in result["tasks"].items():
        times = [f"{entry[name]:.3f}" for name in ("find", "find again", *STAGES, "total", "per phase")]
        margin = f"{1e3 * entry['margin [m]']:.1f}"
        rows.append([task, str(int(entry["phases"])), *times, margin, "yes" if entry["certified"] else "NO"])
    head = ["GIPO [s]", "phases", "find", "find again", *STAGES, "total", "per phase", "margin [mm]", "certified"]
    note = f"total: find + {' + '.join(STAGES)}; medians of {result['runs']} runs after a warm-up"
    return table(head, rows, note)


def _run(task: str) -> dict[str, float]:
    p = Parameters(task=task)  # type: ignore[arg-type]
    model = legged.GaitModel(po.robots.gipo_machine(po.robots.gipo(trunk_height=p.trunk)))
    support = legged.PlaneSupport(point=model.rest_places[0])
    model.machine.robot.kinematics.prepare()
    falls = build_footfalls(p, model, support)
    begin = time.perf_counter()
    gait = legged.find_gait(falls)
    found = time.perf_counter()
    legged.find_gait(falls)
    again = time.perf_counter()
    plan = legged.plan_legged(legged.build_gait_task(gait, support, margins=p.margins), allow_failed=True)
    entry = {"find": found - begin, "find again": again - found, **{s: plan.timings[s] for s in STAGES}}
    entry["total"] = entry["find"] + sum(plan.timings[s] for s in STAGES)
    entry |= {"phases": len(plan.phases), "per phase": entry["total"] / len(plan.phases)}
    return entry | {"margin [m]": plan.certificate.smallest_margin, "certified": plan.certificate.passed}
