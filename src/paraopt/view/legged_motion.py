"""A planned walk as figures, as a page and as files: what the other modules draw, taken from the plan."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from paraopt.io import build_legged_report, write_legged_trajectory, write_report
from paraopt.modes.legged import LeggedMachine, LeggedPlan, PhaseMark, measure_centre, measure_height
from paraopt.scene import Scene
from paraopt.view import style
from paraopt.view.content import PathLine, Phase, Readout
from paraopt.view.figures import draw_actuators, save_figure
from paraopt.view.legged_figures import draw_balance, draw_footfalls, draw_support_margin
from paraopt.view.legged_filmstrip import draw_filmstrip
from paraopt.view.motion import list_page_bodies, mark_link
from paraopt.view.page import write_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


def draw_legged(
    plan: LeggedPlan, *, others: Mapping[str, LeggedMachine] | None = None, mass_share: float | None = 0.1
) -> dict[str, Figure]:
    """Draw the figures of a walk.

    Args:
        plan: The plan.
        others: Machines with other masses, whose margin is drawn beside; see `draw_support_margin`.
        mass_share: Share by which masses may differ in the margin that is drawn dashed; none when None.

    Returns:
        Figures by name: "actuators", "footfalls", "filmstrip"; "margin" and "balance" where a support margin is asked.
    """
    mechanism, limits = plan.task.machine.robot.mechanism, plan.phases[0].problem.bounds
    state = plan.trajectory.state(np.linspace(0.0, plan.trajectory.duration, 1601))
    names, a = tuple(mechanism.active), len(mechanism.active)
    low, high = limits.bounds(mechanism)
    velocity, acceleration = (limits.of(q, names) for q in ("velocity", "acceleration"))
    figures = {
        "actuators": draw_actuators(
            state.t,
            names,
            state.X[:, :a],
            state.velocity[:, :a],
            state.acceleration[:, :a],
            units=[v.unit for v in mechanism.variables[:a]],
            position_limits=np.column_stack([low[:a], high[:a]]),
            velocity_limits=np.column_stack([-velocity, velocity]),
            acceleration_limits=np.column_stack([-acceleration, acceleration]),
            title=f"{plan.task.machine.robot.name}: actuators",
        ),
        "footfalls": draw_footfalls(plan.trajectory.marks, feet=plan.task.machine.names),
        "filmstrip": draw_filmstrip(plan),
    }
    if any(phase.phase.stability is not None for phase in plan.phases):
        figures["margin"] = draw_support_margin(plan, others=others, mass_share=mass_share, inertia=True)
        figures["balance"] = draw_balance(plan)
    return figures


def write_legged_page(path: str | os.PathLike[str], plan: LeggedPlan, frames_per_second: float = 60.0) -> Path:
    """Write a walk as one page that opens offline and plays; feet are marked as they stand or not, locks as they hold.

    Args:
        path: Target file.
        plan: The plan.
        frames_per_second: Sampled poses per second; the page interpolates between them.

    Returns:
        The target.

    Raises:
        DefinitionError: The robot has no solids.
    """
    trajectory, machine, certificate = plan.trajectory, plan.task.machine, plan.certificate
    robot = machine.robot
    count = max(2, int(np.ceil(trajectory.duration * frames_per_second)) + 1)
    t = np.linspace(0.0, trajectory.duration, count)
    X = trajectory(t)
    readouts = [Readout("feet that stand", "", np.array([float(len(m.standing)) for m in _marks_at(plan, t)]))]
    if np.any(np.isfinite(certificate.margin)):
        known = np.isfinite(certificate.margin)
        margin = 1e3 * np.interp(t, certificate.t[known], certificate.margin[known])
        bound = 1e3 * min(p.phase.stability for p in plan.phases if p.phase.stability is not None)
        readouts.insert(0, Readout("support margin", "mm", margin, bound))
    for foot, height in zip(machine.names, _heights(plan, X).T, strict=True):
        readouts.append(Readout(f"height of {foot}", "mm", 1e3 * height))
    centre = measure_centre(machine, X)
    ends = machine.contacts(X)[0]
    paths = [PathLine("centre of gravity", centre, color=style.INK)]
    paths += [PathLine(f"way of {foot}", ends[:, k]) for k, foot in enumerate(machine.names)]
    return write_page(
        path,
        title=f"{robot.name}: {'certified' if certificate.passed else 'NOT certified'} motion in "
        f"{len(trajectory.marks)} phases",
        bodies=list_page_bodies(plan.task.scene or Scene(robot)),
        times=t,
        poses=robot.kinematics.poses(X),
        paths=paths,
        readouts=readouts[:6],
        phases=list_page_phases(plan),
        caption=f"{trajectory.duration:.3f} s; feet that stand, feet in the air and locked joints are marked",
    )


def list_page_phases(plan: LeggedPlan) -> tuple[Phase, ...]:
    """List the phases of a walk as a page shows them: feet that stand, feet in the air, links of locked joints."""
    machine, mechanism = plan.task.machine, plan.task.machine.robot.mechanism
    carried = {v.name: v.link for v in mechanism.variables}
    phases = []
    for mark in plan.trajectory.marks:
        marks = [
            mark_link(
                mechanism,
                "fixed foot" if foot.name in mark.standing else "free foot",
                foot.link,
                foot.point,
                style.GREEN if foot.name in mark.standing else style.VERMILLION,
            )
            for foot in machine.feet
        ]
        # a trunk that stands still while a foot moves is no locked joint
        joints = [name for name in mark.locked if name not in mechanism.operational]
        marks += [mark_link(mechanism, "locked joint", carried[name], (0.0, 0.0, 0.0)) for name in joints]
        phases.append(Phase(mark.name, mark.start, mark.end, marks))
    return tuple(phases)


def save_legged(
    plan: LeggedPlan, folder: str | os.PathLike[str], *, period: float = 1e-3, view: bool = True
) -> dict[str, Path]:
    """Write the trajectory (CSV), the report (JSON), the figures (PNG) and the page (HTML) of a walk.

    Args:
        plan: The plan.
        folder: Where to; made when missing. Each file appears whole or not at all.
        period: Time between the rows of the CSV [s].
        view: Whether to draw figures and page; a robot without solids has no page.

    Returns:
        The files by name.

    Raises:
        MissingBackendError: `view` is asked for and matplotlib is not installed.
    """
    target = Path(folder)
    # everything is made before anything is written
    report = build_legged_report(plan)
    figures = draw_legged(plan) if view else {}
    files = {
        "trajectory": write_legged_trajectory(plan.trajectory, target / "trajectory.csv", period),
        "report": write_report(report, target / "report.json"),
    }
    for name, figure in figures.items():
        files[name] = save_figure(figure, target / f"{name}.png")
    if view and any(plan.task.machine.robot.shapes.values()):
        files["page"] = write_legged_page(target / "motion.html", plan)
    return files


def _marks_at(plan: LeggedPlan, t: Array) -> list[PhaseMark]:
    return [plan.trajectory.marks[k] for k in plan.trajectory.phase_at(t).tolist()]


def _heights(plan: LeggedPlan, X: Array) -> Array:
    """Give how far each foot is above its support [m], shape (n, n_feet)."""
    ends = plan.task.machine.contacts(X)[0]
    return measure_height(plan.task.support, ends.reshape(-1, 3)).reshape(ends.shape[:2])
