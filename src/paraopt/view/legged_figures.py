"""Figures of a walk: support margin in time, which foot stands when, and balance seen from above."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.legged import (
    LeggedMachine,
    LeggedPlan,
    PhaseMark,
    build_polygon,
    measure_centre,
    measure_support,
    measure_worst_support,
)
from paraopt.view import style
from paraopt.view.canvas import axis_label, display_scale, in_house_style, new_figure
from paraopt.view.figures import LIMIT_DASHES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@in_house_style
def draw_support_margin(
    plan: LeggedPlan,
    *,
    others: Mapping[str, LeggedMachine] | None = None,
    mass_share: float | None = None,
    inertia: bool = False,
    count: int = 120,
    title: str | None = None,
) -> Figure:
    """Draw the support margin in time, with the phases shaded by the foot that they lift.

    Args:
        plan: The plan.
        others: Machines with other masses, by what the legend calls them: the same motion with their margin.
        mass_share: Share by which every mass may differ by itself, such as 0.1: the smallest margin that this leaves is
            drawn as well, dashed; see `measure_worst_support`.
        inertia: Whether the distance from tipping over is drawn as well, with the inertia of what moves; see
            `measure_tipping`.
        count: Samples in each phase.
        title: Heading of the figure.

    Returns:
        The figure; margins in millimetres where all are below two metres.

    Raises:
        DefinitionError: No phase asks for a support margin.
    """
    marks = plan.trajectory.marks
    asked = [phase.phase.stability for phase in plan.phases]
    if all(value is None for value in asked):
        raise DefinitionError("no phase asks for a support margin (stability); there is nothing to draw")
    compared = bool(others) or mass_share is not None or inertia
    machines = {"as planned" if compared else "": plan.task.machine, **(others or {})}
    curves = {name: _sample_margin(plan, machine, count) for name, machine in machines.items()}
    worst = "" if mass_share is None else f"worst masses within ±{100 * mass_share:g} %"
    if mass_share is not None:
        curves[worst] = _sample_margin(plan, plan.task.machine, count, mass_share)
    if inertia:
        curves["with inertia"] = _read_tipping(plan)
    factor, unit = display_scale("m", *(margin for _, margin in curves.values()))
    figure = new_figure(_choose_width(marks), 3.4)
    heading = title or f"{plan.task.machine.robot.name}: support margin"
    figure.suptitle(heading, x=0.01, ha="left", fontsize=11, fontweight="bold")
    axes = figure.subplots()
    _shade_phases(axes, marks, plan.task.machine.names)
    for k, (name, (t, margin)) in enumerate(curves.items()):
        look: Any = {"color": style.INK if k == 0 else style.series_color(k - 1), "linewidth": 1.7 if k == 0 else 1.0}
        if name == worst:
            look |= {"color": style.INK, "linestyle": (0.0, (2.0, 1.5))}
        if inertia and name == "with inertia":
            look |= {"color": style.SLATE, "linewidth": 0.9}
        axes.plot(t, factor * margin, label=name or None, zorder=3 - 0.1 * k, **look)
    for mark, bound in zip(marks, asked, strict=True):
        if bound is not None:
            span = [mark.start, mark.end]
            axes.plot(span, [factor * bound] * 2, color="#A84600", linewidth=1.1, linestyle=LIMIT_DASHES, zorder=2.5)
    t, margin = next(iter(curves.values()))
    i = int(np.nanargmin(margin))
    ring: dict[str, Any] = {"markersize": 6, "markerfacecolor": style.PAPER, "markeredgecolor": style.INK, "zorder": 5}
    axes.plot([t[i]], [factor * margin[i]], "o", **ring)
    axes.annotate(
        f"least {factor * margin[i]:.3g} {unit} at {t[i]:.3g} s".replace("-", "−"),
        (t[i], factor * margin[i]), xytext=(0, 8), textcoords="offset points", ha="center", fontsize=8, zorder=6,
        bbox={"facecolor": style.PAPER, "alpha": 0.8, "edgecolor": "none", "pad": 1.0},
    )  # fmt: skip
    axes.axhline(0.0, color=style.MUTED, linewidth=0.8, zorder=1.5)
    axes.set(xlim=(marks[0].start, marks[-1].end), xlabel="time [s]", ylabel=axis_label("support margin", unit))
    axes.margins(y=0.15)
    handles = _list_handles(marks, plan.task.machine.names, "lifting ")
    if compared:
        handles += axes.get_legend_handles_labels()[0]
    if handles:
        place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2, "columnspacing": 1.2}
        axes.legend(handles=handles, ncols=min(len(handles), 4), **place)
    return figure


@in_house_style
def draw_footfalls(marks: Sequence[PhaseMark], *, title: str = "Footfalls", feet: Sequence[str] = ()) -> Figure:
    """Draw a bar for each foot while it stands, and the phases below.

    Args:
        marks: When each phase runs, and on which feet.
        title: Heading of the figure.
        feet: Names of the feet from top to bottom; those of the first phase when empty.

    Returns:
        The figure.

    Raises:
        DefinitionError: There is no phase.
    """
    if not marks:
        raise DefinitionError("there is no phase: nothing to draw")
    names = list(feet) or sorted({*marks[0].standing, *marks[0].lifted})
    figure = new_figure(_choose_width(marks), 1.1 + 0.34 * len(names))
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    axes = figure.subplots()
    for row, name in enumerate(names):
        color = style.series_color(row)
        for start, end in _join_spans([(m.start, m.end) for m in marks if name in m.standing]):
            axes.barh(row, end - start, left=start, height=0.62, color=color, zorder=2)
        for start, end in _join_spans([(m.start, m.end) for m in marks if name in m.lifted]):
            look: Any = {"facecolor": style.PAPER, "edgecolor": color, "linewidth": 1.0, "hatch": "////", "zorder": 2}
            axes.barh(row, end - start, left=start, height=0.62, **look)
    for border in [mark.start for mark in marks[1:]]:
        axes.axvline(border, color="#C4CCD5", linewidth=0.6, zorder=1)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.4, -0.6), xlim=(marks[0].start, marks[-1].end), xlabel="time [s]")
    axes.grid(visible=False)
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=style.SLATE, label="stands"),
        Patch(facecolor=style.PAPER, edgecolor=style.SLATE, hatch="////", label="in the air"),
    ]
    axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    return figure


@in_house_style
def draw_balance(plan: LeggedPlan, *, count: int = 60, title: str | None = None) -> Figure:
    """Draw from above where feet stand, the way of the centre of gravity, and the support polygons it stays in.

    Args:
        plan: The plan.
        count: Samples in each phase.
        title: Heading of the figure.

    Returns:
        The figure, in x and y of the world.
    """
    machine, marks = plan.task.machine, plan.trajectory.marks
    samples = _sample_phases(plan, count)
    centres = [measure_centre(machine, X) for _, X in samples]
    contacts = [machine.contacts(X)[1] for _, X in samples]
    factor, unit = display_scale("m", *contacts, *centres)
    figure = new_figure(6.4, 4.6)
    heading = title or f"{machine.robot.name}: balance seen from above"
    figure.suptitle(heading, x=0.01, ha="left", fontsize=11, fontweight="bold")
    axes = figure.subplots()
    from matplotlib.patches import Polygon

    for mark, (_, X), centre in zip(marks, samples, centres, strict=True):
        color = _phase_color(mark, machine.names)
        if mark.standing and mark.lifted:
            corners = factor * build_polygon(machine, X[0], mark.standing, plan.task.down).points[:, :2]
            axes.add_patch(Polygon(corners, facecolor=color, alpha=0.06, edgecolor="none", zorder=1))
            axes.add_patch(Polygon(corners, facecolor="none", edgecolor=color, linewidth=0.7, alpha=0.6, zorder=1.5))
        # while a foot is lifted it often hardly moves: there it is thick, in the colour of its polygon
        wide: Any = {"color": color, "linewidth": 4.5} if mark.lifted else {"color": style.INK, "linewidth": 1.6}
        axes.plot(*(factor * centre[:, :2]).T, solid_capstyle="round", zorder=3.5 if mark.lifted else 3, **wide)
    for k, name in enumerate(machine.names):
        ways = factor * np.vstack([points[:, k, :2] for points in contacts])
        stood = [p[0, k, :2] for p, mark in zip(contacts, marks, strict=True) if name in mark.standing]
        color = style.series_color(k)
        axes.plot(*ways.T, color=color, linewidth=0.8, alpha=0.7, zorder=2)
        look: Any = {"markersize": 5, "linestyle": "none", "zorder": 4, "color": color}
        axes.plot(*(factor * np.array(stood).reshape(-1, 2)).T, marker="o", label=name, **look)
    axes.plot([], [], color=style.INK, linewidth=1.6, label="centre of gravity")
    axes.plot([], [], color=style.MUTED, linewidth=4.5, label="while a foot is lifted")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel=axis_label("x", unit), ylabel=axis_label("y", unit))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2, columnspacing=1.2)
    return figure


def _sample_phases(plan: LeggedPlan, count: int) -> list[tuple[Array, Array]]:
    """Give times of the whole motion and configurations of every phase."""
    found = []
    for part, mark in zip(plan.trajectory.parts, plan.trajectory.marks, strict=True):
        t = np.linspace(0.0, part.duration, count)
        found.append((mark.start + t, np.asarray(part(t))))
    return found


def _sample_margin(
    plan: LeggedPlan, machine: LeggedMachine, count: int, mass_share: float = 0.0
) -> tuple[Array, Array]:
    """Give the support margin of a machine that makes the plan's motion; nan where none is asked, and between phases.

    Where a foot comes off or down the margin jumps: the line is broken there.
    """
    times, margins = [], []
    for phase, (t, X) in zip(plan.phases, _sample_phases(plan, count), strict=True):
        margin = np.full(len(t), np.nan)
        standing, down = phase.phase.standing, plan.task.down
        if phase.phase.stability is not None and standing:
            margin = measure_support(machine, X, standing, down)
            if mass_share > 0.0 and len(build_polygon(machine, X[0], standing, down).corners) > 2:
                margin = measure_worst_support(machine, X, standing, mass_share, down)
        times.append(np.append(t, t[-1]))
        margins.append(np.append(margin, np.nan))
    return np.concatenate(times), np.concatenate(margins)


def _read_tipping(plan: LeggedPlan) -> tuple[Array, Array]:
    """Give the distance from tipping over that the certificate found, broken where phases meet."""
    certificate = plan.certificate
    starts = np.cumsum([0, *(phase.n_samples for phase in certificate.phases)])[1:-1]
    return np.insert(certificate.t, starts, certificate.t[starts]), np.insert(certificate.tipping, starts, np.nan)


def _join_spans(spans: Sequence[tuple[float, float]], slack: float = 1e-9) -> list[tuple[float, float]]:
    """Join spans of time that follow each other without a gap."""
    joined: list[tuple[float, float]] = []
    for start, end in spans:
        if joined and start <= joined[-1][1] + slack:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return joined


def _phase_color(mark: PhaseMark, feet: Sequence[str]) -> str:
    return style.series_color(list(feet).index(mark.lifted[0])) if mark.lifted else style.MUTED


def _shade_phases(axes: Axes, marks: Sequence[PhaseMark], feet: Sequence[str]) -> None:
    for mark in marks:
        if mark.lifted:
            axes.axvspan(mark.start, mark.end, color=_phase_color(mark, feet), alpha=0.16, linewidth=0, zorder=0.5)


def _list_handles(marks: Sequence[PhaseMark], feet: Sequence[str], word: str) -> list[Any]:
    from matplotlib.patches import Patch

    lifted = [foot for foot in feet if any(mark.lifted and mark.lifted[0] == foot for mark in marks)]
    colors = [style.series_color(list(feet).index(foot)) for foot in lifted]
    return [Patch(facecolor=c, alpha=0.3, label=f"{word}{f}") for f, c in zip(lifted, colors, strict=True)]


def _choose_width(marks: Sequence[PhaseMark]) -> float:
    """Give room to every phase [in]."""
    return float(np.clip(3.0 + 0.28 * len(marks), 7.2, 13.0))
