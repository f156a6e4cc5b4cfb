"""Measure speed, side by side in one run, on one core: `make bench`.

python benchmarks/run.py                       # everything, a few minutes
python benchmarks/run.py --only evaluations    # or peers, forward, stages, refine, retime, clearance, stacked, cables,
                                               # legged, tripod, seeds
python benchmarks/run.py --cold                # also the first compilation, into an empty cache
python benchmarks/run.py --json bench.json
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import json
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

SECTIONS = (
    "evaluations",
    "peers",
    "forward",
    "stages",
    "refine",
    "retime",
    "clearance",
    "stacked",
    "cables",
    "legged",
    "tripod",
    "seeds",
)


def hold_to_one_core() -> str:
    """Keep numerical libraries and, where the system allows it, the process on one core; before numpy is imported."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    if hasattr(os, "sched_setaffinity"):
        core = max(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {core})
        return "one core"
    return "one thread"


def describe_machine() -> dict[str, str]:
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    packages = {}
    for name in ("casadi", "numpy", "scipy", "coal", "toppra", "drake", "pin", "mujoco"):
        try:
            packages[name] = version(name)
        except PackageNotFoundError:  # a peer that is not there
            packages[name] = "absent"
    return {"processor": model, "system": platform.system(), "python": platform.python_version(), **packages}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=SECTIONS, action="append", help="one section; may be repeated")
    parser.add_argument("--runs", type=int, default=3, help="plans of each task")
    parser.add_argument("--cold", action="store_true", help="also compile into an empty cache")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    options = parser.parse_args()

    cores = hold_to_one_core()
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    machine = describe_machine()
    print(", ".join(f"{k} {v}" if k not in ("processor", "system") else v for k, v in machine.items()) + f", {cores}")
    results: dict[str, Any] = {"machine": machine, "cores": cores}
    for name in options.only or SECTIONS:
        section = importlib.import_module(f"benchmarks.{name}")
        arguments = {"runs": options.runs, "cold": options.cold} if name == "stages" else {}
        results[name] = section.measure(**arguments)
        print(f"\n{section.show(results[name])}", flush=True)
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(results, indent=2, default=dataclasses.asdict) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
