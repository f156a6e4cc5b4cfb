"""A planned walk as figures, as a page and as files: what the other modules draw, taken from the plan."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from paraopt.io import build_legged_report, write_legged_trajectory, write_report
from paraopt.modes.legged import (
    LeggedMachine,
    LeggedPlan,
    build_polygon,
    drop_onto,
    measure_centre,
    measure_height,
)
from paraopt.scene import Scene
from paraopt.view import style
from paraopt.view.content import CableLine, Mark, PathLine, Phase, Readout
from paraopt.view.figures import save_figure
from paraopt.view.legged_actuators import draw_leg_actuators
from paraopt.view.legged_figures import draw_balance, draw_footfalls, draw_support_margin
from paraopt.view.legged_filmstrip import draw_filmstrip
from paraopt.view.motion import list_page_bodies, list_page_cables, mark_link
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
    figures = {
        "actuators": draw_leg_actuators(plan),
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
    centre = measure_centre(machine, X)
    ends = machine.contacts(X)[0]
    paths = [PathLine("centre of gravity", centre, color=style.INK)]
    paths += [PathLine(f"way of {foot}", ends[:, k]) for k, foot in enumerate(machine.names)]
    frames, lines = follow_support(plan, t, X)
    phases = list_page_phases(plan)
    if lines:
        # the first of the frames added is where the centre of gravity presses on the ground
        below = Mark("point below the centre of gravity", len(robot.mechanism.links), (0.0, 0.0, 0.0), style.INK)
        asked = [planned.phase.stability is not None for planned in plan.phases]
        phases = tuple(replace(p, marks=(*p.marks, below)) if a else p for p, a in zip(phases, asked, strict=True))
    return write_page(
        path,
        title=f"{robot.name}: {'certified' if certificate.passed else 'NOT certified'} motion in "
        f"{len(trajectory.marks)} phases",
        bodies=list_page_bodies(plan.task.scene or Scene(robot)),
        times=t,
        poses=np.concatenate([robot.kinematics.poses(X), frames], axis=1),
        cables=[*list_page_cables(plan.task.scene or Scene(robot)), *lines],
        paths=paths,
        readouts=_list_readouts(plan, t, X),
        phases=phases,
        caption=f"{trajectory.duration:.3f} s; feet that stand, feet in the air and locked joints are marked"
        + ("; the centre of gravity stays over the support polygon" if lines else ""),
    )


def list_page_phases(plan: LeggedPlan) -> tuple[Phase, ...]:
    """List the phases of a walk as a page shows them: feet that stand, feet in the air, links of locked joints."""
    machine, mechanism = plan.task.machine, plan.task.machine.robot.mechanism
    carried = {v.name: v.link for v in mechanism.variables}
    phases = []
    for mark in plan.trajectory.marks:
        marks = []
        for foot in machine.feet:
            stands = foot.name in mark.standing
            label, color = ("fixed foot", style.GREEN) if stands else ("free foot", style.VERMILLION)
            marks.append(mark_link(mechanism, label, foot.link, foot.point, color))
            if foot.carrier == foot.link:  # a foot that is a link of its own hides its mark: it takes the colour
                marks.append(mark_link(mechanism, label, foot.link, None, color))
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


def follow_support(plan: LeggedPlan, t: Array, X: Array) -> tuple[Array, tuple[CableLine, ...]]:
    """Follow the support polygon, and the point of the ground under the centre of gravity, for a page.

    Args:
        plan: The plan.
        t: Times of the motion [s], shape (n,).
        X: Configurations then, shape (n, n_variables).

    Returns:
        Poses of frames that come after those of the links, shape (n, k, 4, 4), and the edges as lines between them;
        neither where no phase asks for a support margin.
    """
    machine, task = plan.task.machine, plan.task
    polygons = {
        k: build_polygon(machine, planned.problem.start_configuration.X, planned.phase.standing, task.down)
        for k, planned in enumerate(plan.phases)
        if planned.phase.stability is not None and planned.phase.standing
    }
    corners = max((len(polygon.corners) for polygon in polygons.values()), default=0)
    count = corners + 2 if corners else 0
    frames = np.tile(np.eye(4), (len(t), count, 1, 1))
    if not corners:
        return frames, ()
    frames[:, 0, :3, 3] = drop_onto(task.support, measure_centre(machine, X), task.down)
    running = plan.trajectory.phase_at(t)
    for k, polygon in polygons.items():
        # a polygon of fewer corners than the largest closes early, and lies in its first corner from there on
        order = [j if j < len(polygon.points) else 0 for j in range(corners + 1)]
        frames[running == k, 1:, :3, 3] = polygon.points[order]
    size = max(float(np.max(np.ptp(polygon.points, axis=0))) for polygon in polygons.values())
    radius, start = 0.006 * max(size, 1e-3), len(machine.robot.mechanism.links) + 1
    lines = tuple(
        CableLine(
            f"edge {j + 1} of the support polygon", (start + j, start + j + 1), np.zeros((2, 3)), radius,
            "support polygon", style.GREEN,
        )
        for j in range(corners)
    )  # fmt: skip
    return frames, lines


def _list_readouts(plan: LeggedPlan, t: Array, X: Array) -> list[Readout]:
    """List what a page tells in numbers: margins, and how high the feet are."""
    certificate, machine = plan.certificate, plan.task.machine
    found = []
    asked = [p.phase.stability for p in plan.phases if p.phase.stability is not None]
    for name, values, bound in (
        ("support margin", certificate.margin, min(asked, default=None)),
        ("with inertia", certificate.tipping, plan.task.tipping),
    ):
        known = np.isfinite(values)
        if np.any(known):
            margin = 1e3 * np.interp(t, certificate.t[known], values[known])
            found.append(Readout(name, "mm", margin, None if bound is None else 1e3 * bound))
    # a foot on the ground is at zero, not at what rounding leaves
    heights = np.round(1e3 * _heights(plan, X), 6)
    lifted = [k for k, foot in enumerate(machine.names) if any(foot in mark.lifted for mark in plan.trajectory.marks)]
    if len(lifted) > 4:  # there is room for four; of many feet the highest is told
        return [*found, Readout("highest foot", "mm", heights.max(axis=1))]
    return [*found, *(Readout(f"{machine.names[k]} up", "mm", heights[:, k]) for k in lifted)]


def _heights(plan: LeggedPlan, X: Array) -> Array:
    """Give how far each foot is above its support [m], shape (n, n_feet)."""
    ends = plan.task.machine.contacts(X)[0]
    return measure_height(plan.task.support, ends.reshape(-1, 3)).reshape(ends.shape[:2])
