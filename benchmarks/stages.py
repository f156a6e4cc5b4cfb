"""How long does each stage of the three RAF tasks take on one core?

Every run builds robot and problem anew, so that "compile" is what a new process pays when the generated code is
already on disk. The targets: 1 s for seed, refine, retime and verify of the cylinder task. The source needed about
20 s a task on an Athlon 64 (Lahouar, IV.1): another machine, another program, named for orientation only.
"""

from __future__ import annotations

import os
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from benchmarks.tables import table
from problems.raf import Parameters, build_problem

import paraopt as po

TASKS = ("free", "cylinder", "box")
STAGES = ("compile", "check", "seed", "refine", "retime", "verify")
COUNTED = ("seed", "refine", "retime", "verify")
TARGET, SOURCE = 1.0, 20.0  # s


def measure(runs: int = 3, cold: bool = False) -> dict[str, Any]:
    """Plan each task several times after a warm-up, and keep the median of each stage."""
    result: dict[str, Any] = {"runs": runs, "tasks": {}}
    if cold:
        with _empty_cache():
            result["compile with an empty cache"] = _plan("free").timings["compile"]
    for task in TASKS:
        _plan(task)
    for task in TASKS:
        plans = [_plan(task) for _ in range(runs)]
        last = plans[-1]
        entry: dict[str, Any] = {s: statistics.median(p.timings[s] for p in plans) for s in STAGES}
        totals = [sum(p.timings[s] for s in COUNTED) for p in plans]
        entry |= {
            "total": statistics.median(totals),
            "slowest total": max(totals),
            "poses judged": last.seed.checks,
            "path [m]": last.refined.length,
            "duration [s]": last.trajectory.duration,
            "certified": all(p.certificate.passed for p in plans),
        }
        result["tasks"][task] = entry
    return result


def show(result: dict[str, Any]) -> str:
    rows = []
    for task, entry in result["tasks"].items():
        times = [f"{entry[s]:.3f}" for s in (*STAGES, "total", "slowest total")]
        rows.append([task, *times, str(entry["poses judged"]), "yes" if entry["certified"] else "NO"])
    total = result["tasks"]["cylinder"]["total"]
    verdict = "met" if total < TARGET else "MISSED"
    note = (
        f"total: {' + '.join(COUNTED)}; medians of {result['runs']} runs after a warm-up\n"
        f"cylinder: {total:.3f} s, target {TARGET:g} s {verdict}; the source tells about {SOURCE:g} s on an Athlon 64, "
        f"another machine"
    )
    if (first := result.get("compile with an empty cache")) is not None:
        note += f"\ncompile with an empty cache, once for a robot and all its tasks: {first:.1f} s"
    head = ["RAF task [s]", *STAGES, "total", "slowest", "poses judged", "certified"]
    return table(head, rows, note)


def _plan(task: str) -> po.Plan:
    return po.plan(build_problem(Parameters(task=task)), allow_failed=True)  # type: ignore[arg-type]


@contextmanager
def _empty_cache() -> Iterator[None]:
    before = os.environ.get("PARAOPT_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PARAOPT_CACHE"] = folder
        try:
            yield
        finally:
            del os.environ["PARAOPT_CACHE"]
            if before is not None:
                os.environ["PARAOPT_CACHE"] = before
