"""Reports as JSON: what was asked, with which options and versions, how long it took, and the certificate."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
from collections.abc import Mapping, Sequence
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from paraopt.io.files import write_atomically
from paraopt.kinematics import Configuration, find_compiler
from paraopt.planning import Certificate, Problem, Refined, Seed, Trajectory

PACKAGES = ("paraopt", "casadi", "numpy", "scipy", "osqp", "qpsolvers", "ruckig", "toppra", "coal")


def describe(thing: Any) -> Any:
    """Turn frozen data into what JSON can hold: dataclasses become mappings that name their type.

    Args:
        thing: Numbers, strings, arrays, mappings, sequences, dataclasses.

    Returns:
        Mappings, lists, strings, finite numbers; numbers that are not finite become strings, functions their names.
    """
    if isinstance(thing, Configuration):
        return thing.as_dict()
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        fields = {f.name: describe(getattr(thing, f.name)) for f in dataclasses.fields(thing)}
        return {"type": type(thing).__name__, **fields}
    if isinstance(thing, Mapping):
        return {str(k): describe(v) for k, v in thing.items()}
    if isinstance(thing, np.ndarray):
        return describe(thing.tolist())
    if isinstance(thing, (bool, np.bool_)):
        return bool(thing)
    if isinstance(thing, (int, np.integer)):
        return int(thing)
    if isinstance(thing, (float, np.floating)):
        return float(thing) if np.isfinite(thing) else str(float(thing))
    if isinstance(thing, Enum):
        return thing.value
    if thing is None or isinstance(thing, str):
        return thing
    if isinstance(thing, Sequence):
        return [describe(v) for v in thing]
    if callable(thing):  # its address would differ from run to run
        named = thing if hasattr(thing, "__qualname__") else type(thing)
        return f"{named.__module__}.{named.__qualname__}"
    return repr(thing)


def build_report(
    problem: Problem,
    seed: Seed,
    refined: Refined,
    trajectory: Trajectory,
    certificate: Certificate,
    *,
    options: Mapping[str, Any],
    timings: Mapping[str, float],
) -> dict[str, Any]:
    """Collect everything that a person needs to judge or repeat a plan.

    Args:
        problem: What was asked.
        seed: The first way.
        refined: The refined path.
        trajectory: The timed motion.
        certificate: The verdict.
        options: Options of each stage.
        timings: Seconds spent in each stage.

    Returns:
        A mapping that JSON can hold.
    """
    robot = problem.robot
    return {
        "robot": {"name": robot.name, "source": robot.source},
        "problem": {
            "start": describe(problem.start),
            "goal": describe(problem.goal),
            "margins": describe(problem.margins),
            "limits": describe(problem.bounds),
            "obstacles": describe(problem.scene.obstacles),
            "straight motion": seed.straight_reason,
        },
        "options": describe(options),
        "versions": list_versions(),
        "timings [s]": describe(timings),
        "result": {
            "duration [s]": trajectory.duration,
            "method": trajectory.method,
            "slowed": trajectory.slowed,
            "seed length [m]": seed.length,
            "path length [m]": refined.length,
            "poses judged": seed.checks,
            "iterations": refined.iterations,
            "rounds": refined.rounds,
        },
        "certificate": {
            "passed": certificate.passed,
            "samples": certificate.n_samples,
            "period [s]": certificate.period,
            "checks": [describe(check) for check in certificate.checks],
        },
    }


def list_versions() -> dict[str, Any]:
    """List the versions of what a result depends on, by name, and the kind of machine."""
    return {
        **{name: _version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "compiled": find_compiler() is not None,
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "unknown"


def write_report(report: Mapping[str, Any], path: str | os.PathLike[str]) -> Path:
    """Write a report as JSON.

    Args:
        report: What `build_report` returned.
        path: Target file.

    Returns:
        The target.
    """
    return write_atomically(path, (json.dumps(report, indent=2, allow_nan=False) + "\n").encode())
