"""Actuators of a walk: a column for each leg, since a dozen curves in one panel cannot be told apart."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from paraopt.modes.legged import LeggedMachine, LeggedPlan
from paraopt.modes.legged.machine import find_motions
from paraopt.view import style
from paraopt.view.canvas import axis_label, display_scale, in_house_style, new_figure
from paraopt.view.figures import LIMIT_DASHES, draw_actuators

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
QUANTITIES = (("position", ""), ("velocity", "/s"), ("acceleration", "/s²"))


def draw_leg_actuators(plan: LeggedPlan, *, count: int = 1601, title: str | None = None) -> Figure:
    """Draw position, velocity and acceleration of every actuator in time, with limits, a column for each leg.

    Where legs have no actuators of their own, as where two share one, all are drawn in one column.

    Args:
        plan: The plan.
        count: Samples over the whole motion.
        title: Heading of the figure.

    Returns:
        The figure; the phases in which a foot is in the air are shaded in its column.
    """
    machine, bounds = plan.task.machine, plan.phases[0].problem.bounds
    mechanism = machine.robot.mechanism
    names = tuple(mechanism.active)
    index = mechanism.indices(names)
    state = plan.trajectory.state(np.linspace(0.0, plan.trajectory.duration, count))
    values = [rows[:, index] for rows in (state.X, state.velocity, state.acceleration)]
    low, high = bounds.bounds(mechanism)
    rates = [bounds.of(quantity, names) for quantity in ("velocity", "acceleration")]
    limits = [np.column_stack([low[index], high[index]]), *(np.column_stack([-rate, rate]) for rate in rates)]
    units = [mechanism.variables[i].unit for i in index]
    heading = title or f"{machine.robot.name}: actuators"
    legs = _group_by_leg(machine, names)
    if not legs:
        p, v, a = limits
        return draw_actuators(
            state.t, names, *values, units=units, position_limits=p, velocity_limits=v, acceleration_limits=a,
            title=heading,
        )  # fmt: skip
    return _draw_columns(plan, state.t, values, limits, units, legs, heading)


@in_house_style
def _draw_columns(
    plan: LeggedPlan, t: Array, values: list[Array], limits: list[Array], units: list[str],
    legs: dict[str, dict[str, int]], heading: str,
) -> Figure:  # fmt: skip
    figure = new_figure(1.0 + 2.6 * len(legs), 7.2)
    figure.suptitle(heading, x=0.01, ha="left", fontsize=11, fontweight="bold")
    panels = figure.subplots(3, len(legs), sharex=True, sharey="row", squeeze=False)
    for column, (leg, joints) in enumerate(legs.items()):
        for row, (what, per) in enumerate(QUANTITIES):
            axes: Axes = panels[row, column]
            members = list(joints.values())
            factor, unit = display_scale(units[members[0]], values[row], limits[row])
            for mark in plan.trajectory.marks:
                if leg in mark.lifted:
                    axes.axvspan(mark.start, mark.end, color=style.SLATE, alpha=0.12, linewidth=0, zorder=0.5)
            for k, (joint, i) in enumerate(joints.items()):
                axes.plot(t, factor * values[row][:, i], color=style.series_color(k), linewidth=1.1, label=joint)
            # bounds that differ are drawn in the colour of their joint
            shared = bool(np.all(limits[row][members] == limits[row][members[0]]))
            for k, i in enumerate(members[:1] if shared else members):
                for bound in limits[row][i][np.isfinite(limits[row][i])]:
                    look: Any = {"color": style.MUTED if shared else style.series_color(k), "linewidth": 0.9}
                    axes.axhline(factor * bound, linestyle=LIMIT_DASHES, zorder=1.5, **look)
            if column == 0:
                axes.set_ylabel(axis_label(what, unit + per))
            axes.margins(y=0.08)
        panels[0, column].set_title(leg)
        panels[0, column].set_xlim(t[0], t[-1])
        panels[-1, column].set_xlabel("time [s]")
    _write_legend(panels[0, 0], figure, [list(joints) for joints in legs.values()])
    figure.align_ylabels(panels[:, 0])
    return figure


def _write_legend(axes: Axes, figure: Figure, joints: list[list[str]]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    longest = max(joints, key=len)
    words = [names[k] if all(k < len(n) and n[k] == names[k] for n in joints) else f"joint {k + 1}"
             for names in (longest,) for k in range(len(longest))]  # fmt: skip
    handles: list[Any] = [Line2D([], [], color=style.series_color(k), label=word) for k, word in enumerate(words)]
    handles.append(Line2D([], [], color=style.MUTED, linestyle=LIMIT_DASHES, linewidth=0.9, label="limits"))
    handles.append(Patch(facecolor=style.SLATE, alpha=0.2, label="foot in the air"))
    figure.legend(handles=handles, loc="upper right", ncols=len(handles), columnspacing=1.2)


def _group_by_leg(machine: LeggedMachine, names: tuple[str, ...]) -> dict[str, dict[str, int]]:
    """Give the actuators of each leg, by what they are called without the foot's name, with their places.

    Nothing where a leg has none, where two legs share one, or where some belong to no leg.
    """
    mechanism = machine.robot.mechanism
    legs: dict[str, dict[str, int]] = {}
    for foot in machine.feet:
        moved = set(find_motions(mechanism, foot.link))
        legs[foot.name] = {
            name.removeprefix(f"{foot.name} "): i for i, name in enumerate(names) if name in moved
        }  # fmt: skip
    found = sorted(i for joints in legs.values() for i in joints.values())
    units = {mechanism.variables[mechanism.index(name)].unit for name in names}
    return legs if found == list(range(len(names))) and all(legs.values()) and len(units) == 1 else {}
