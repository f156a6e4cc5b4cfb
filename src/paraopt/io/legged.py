"""Walks as files: the trajectory with the phase of every instant as CSV, and a report as JSON."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from paraopt.io.report import describe, list_versions
from paraopt.io.tables import Table, tabulate, write_table
from paraopt.modes.legged import LeggedPlan, LeggedTrajectory, measure_centre

PHASE = "phase [1]"


def tabulate_legged(trajectory: LeggedTrajectory, period: float = 1e-3) -> Table:
    """Arrange samples of a walk: time, place of the phase in their order, then all variables.

    Args:
        trajectory: The motion.
        period: Time between rows [s].

    Returns:
        The table; where two phases meet the row belongs to the later one.

    Raises:
        DefinitionError: The period is not finite and above 0.
    """
    state = trajectory.sample(period)
    plain = tabulate(trajectory, state)
    phases = trajectory.phase_at(state.t).astype(float)
    columns = (plain.columns[0], PHASE, *plain.columns[1:])
    return Table(columns, np.column_stack([plain.values[:, :1], phases, plain.values[:, 1:]]))


def write_legged_trajectory(trajectory: LeggedTrajectory, path: str | os.PathLike[str], period: float = 1e-3) -> Path:
    """Write a walk as CSV, with a column that tells the phase; `read_trajectory` reads it.

    Args:
        trajectory: The motion.
        path: Target file.
        period: Time between rows [s]; the last row is the end of the motion.

    Returns:
        The target.

    Raises:
        DefinitionError: The period is not finite and above 0.
    """
    return write_table(tabulate_legged(trajectory, period), path)


def build_legged_report(plan: LeggedPlan) -> dict[str, Any]:
    """Collect everything that a person needs to judge or repeat a walk.

    Args:
        plan: The plan.

    Returns:
        A mapping that JSON can hold, for `write_report`.
    """
    task, certificate = plan.task, plan.certificate
    machine, robot = task.machine, task.machine.robot
    phases = []
    for k, (planned, mark) in enumerate(zip(plan.phases, plan.trajectory.marks, strict=True)):
        phase, verdict = planned.phase, certificate.phases[k]
        phases.append({
            "name": phase.name,
            "start [s]": mark.start,
            "end [s]": mark.end,
            "standing": list(mark.standing),
            "lifted": list(mark.lifted),
            "locked": {name: planned.problem.start_configuration[name] for name in phase.locked},
            "coordinates": list(phase.coordinates),
            "start": {name: planned.problem.start_configuration[name] for name in phase.coordinates},
            "goal": {name: planned.problem.goal_configuration[name] for name in phase.coordinates},
            "support margin asked [m]": phase.stability,
            "straight motion": None if planned.seed is None else planned.seed.straight_reason,
            "path length [m]": planned.refined.length,
            "method": planned.trajectory.method,
            "certificate": {
                "passed": verdict.passed,
                "samples": verdict.n_samples,
                "checks": [describe(check) for check in verdict.checks],
            },
        })  # fmt: skip
    centre = measure_centre(machine, robot.home_configuration.X)[0]
    return {
        "robot": {"name": robot.name, "source": robot.source},
        "task": {
            "feet": list(machine.names),
            "masses [kg]": describe(machine.masses),
            "centres of mass [m]": describe(machine.centres),
            "centre of gravity at home [m]": describe(centre),
            "support": describe(task.support),
            "gravity": describe(task.gravity),
            "margins": describe(task.margins),
            "distance from tipping over asked [m]": task.tipping,
            "limits": describe(robot.limits if task.limits is None else task.limits),
            "obstacles": describe(task.scene.obstacles if task.scene else ()),
        },
        "options": describe(plan.options),
        "versions": list_versions(),
        "timings [s]": describe(plan.timings),
        "result": {"duration [s]": plan.trajectory.duration, "phases": len(phases)},
        "phases": phases,
        "certificate": {
            "passed": certificate.passed,
            "smallest support margin [m]": describe(certificate.smallest_margin),
            "smallest distance from tipping over, with inertia [m]": describe(certificate.smallest_tipping),
            "checks": [describe(check) for check in certificate.checks],
        },
    }
