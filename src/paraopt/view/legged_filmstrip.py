"""A filmstrip of a motion: the robot at several instants, side by side, its feet marked as they stand or not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics import Configuration
from paraopt.modes.legged import LeggedPlan
from paraopt.view import style
from paraopt.view.canvas import in_house_style, new_figure
from paraopt.view.render import Camera, Solid, render
from paraopt.view.robot_figure import COLORS, list_pieces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@in_house_style
def draw_filmstrip(
    plan: LeggedPlan,
    *,
    times: ArrayLike | None = None,
    columns: int = 4,
    azimuth: float = -65.0,
    elevation: float = 14.0,
    width: float = 2.4,
    resolution: float = 160.0,
    title: str | None = None,
) -> Figure:
    """Draw the robot at several instants, seen from one place.

    Args:
        plan: The plan.
        times: Instants [s]; when None the middle of every phase, at most twelve.
        columns: Pictures in a row.
        azimuth: From where it is seen, about z [deg]; -90 looks along y.
        elevation: How much from above [deg].
        width: Width of a picture [in].
        resolution: Pixels per inch.
        title: Heading of the figure.

    Returns:
        The figure.

    Raises:
        DefinitionError: There is no instant, or one is outside the motion.
    """
    trajectory, machine = plan.trajectory, plan.task.machine
    instants = np.atleast_1d(_choose_times(plan) if times is None else np.asarray(times, dtype=float))
    if not instants.size or columns < 1:
        raise DefinitionError(f"{instants.size} instants in {columns} columns: there is nothing to draw")
    X = trajectory(instants)
    scenes = [_list_solids(plan, x) for x in X]
    contacts = machine.contacts(X)[0]
    right, up, view = _aim(math.radians(azimuth), math.radians(elevation))
    # one window for all: what moves, and the feet
    clouds = [np.vstack([s.surface.reshape(-1, 3) for s, moves in solids if moves]) for solids in scenes]
    seen = np.vstack([*clouds, contacts.reshape(-1, 3)]) @ np.column_stack([right, up])
    low, high = seen.min(axis=0), seen.max(axis=0)
    pad = 0.06 * float(np.max(high - low))
    low, high = low - pad, high + pad
    scale = width / float(high[0] - low[0])  # inches per metre
    height = scale * float(high[1] - low[1])
    fine = 2.0 * resolution
    pixels = (round(fine * width), round(fine * height))
    camera = Camera(fine * scale * np.array([right, up]), -fine * scale * low, view)

    count = min(columns, len(instants))
    rows = math.ceil(len(instants) / count)
    head, gap = 0.38, 0.12
    figure = new_figure(count * (width + gap) + gap, rows * (height + head) + 0.75)
    figure.set_layout_engine("none")
    total = figure.get_size_inches()
    heading = title or f"{machine.robot.name}: {trajectory.duration:.3g} s in {len(trajectory.marks)} phases"
    figure.text(gap / total[0], 1.0 - 0.1 / total[1], heading, fontsize=11, fontweight="bold", va="top")
    for k, (t, solids) in enumerate(zip(instants.tolist(), scenes, strict=True)):
        row, column = divmod(k, count)
        left, bottom = gap + column * (width + gap), total[1] - 0.35 - (row + 1) * (height + head)
        axes = figure.add_axes((left / total[0], bottom / total[1], width / total[0], height / total[1]))
        picture = render([solid for solid, _ in solids], camera, *pixels)
        axes.imshow(picture, origin="lower", extent=(low[0], high[0], low[1], high[1]), interpolation="antialiased")
        mark = trajectory.marks[int(trajectory.phase_at(t))]
        for foot, point in zip(machine.names, contacts[k], strict=True):
            _mark_foot(axes, np.array([point @ right, point @ up]), foot in mark.standing)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.set_axis_off()
        above: Any = {"transform": axes.transAxes, "va": "bottom", "fontsize": 8.0}
        axes.text(0.0, 1.02, mark.name, color=style.INK, **above)
        axes.text(1.0, 1.02, f"{t:.2f} s", color=style.MUTED, ha="right", **above)
    _write_legend(figure)
    return figure


def _choose_times(plan: LeggedPlan, most: int = 12) -> Array:
    marks = plan.trajectory.marks
    chosen = np.unique(np.linspace(0, len(marks) - 1, min(most, len(marks))).round().astype(int))
    return np.array([0.5 * (marks[k].start + marks[k].end) for k in chosen])


def _list_solids(plan: LeggedPlan, X: Array) -> list[tuple[Solid, bool]]:
    """List what is drawn of the robot at one instant, and whether it moves."""
    from matplotlib.colors import to_rgb

    robot = plan.task.machine.robot
    residual = float(robot.kinematics.scaled_residual(X)[0])
    pieces = list_pieces(robot, Configuration(robot.mechanism, X, residual))
    return [
        (Solid(piece.points, to_rgb(COLORS[piece.kind]), group), piece.kind != "base")
        for group, piece in enumerate(pieces)
        if not piece.line
    ]


def _aim(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """Give the directions to the right, upwards and towards the person who looks."""
    view = np.array([
        math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation),
    ])  # fmt: skip
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    return right, np.cross(view, right), view


def _mark_foot(axes: Any, at: Array, stands: bool) -> None:
    """Mark a foot: a full disc while it stands, a ring while it is in the air."""
    fill = style.GREEN if stands else style.PAPER
    edge = style.GREEN if stands else style.VERMILLION
    axes.plot(*at, "o", markersize=4.5, markerfacecolor=fill, markeredgecolor=edge, markeredgewidth=1.3, zorder=4)


def _write_legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D

    looks: Sequence[tuple[str, str, str]] = (
        ("stands", style.GREEN, style.GREEN),
        ("in the air", style.PAPER, style.VERMILLION),
    )
    handles = []
    for word, fill, edge in looks:
        disc: Any = {"marker": "o", "markersize": 5, "markerfacecolor": fill, "markeredgecolor": edge}
        handles.append(Line2D([], [], linestyle="none", label=f"foot {word}", **disc))
    figure.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.0), ncols=2, columnspacing=1.2)
