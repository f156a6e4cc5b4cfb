"""Draw a search in the space of its coordinates, with what stood in its way brought back there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.planning import Problem, Seed
from paraopt.view import style
from paraopt.view.canvas import axis_label, in_house_style, new_figure
from paraopt.view.level_surface import Levels, sample_levels, trace_zero_surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SURFACES = (("singular", style.SLATE, 0.16), ("obstacle", style.KIND_COLORS["obstacle"], 0.28))
"""Name, colour and opacity of the surfaces."""


@in_house_style
def draw_search(
    seed: Seed | None,
    problem: Problem | None = None,
    *,
    title: str,
    nodes: int = 24,
    surroundings: float = 0.15,
    box: tuple[Any, Any] | None = None,
    view: tuple[float, float] = (22.0, -60.0),
) -> Figure:
    """Draw the positions that a search explored and queued, its way, and the surfaces that bound it.

    The axes are the coordinates of the search. The singular surface is where det [N K] = 0; the obstacles are brought
    back to the coordinates: their surface is where a solid of the robot comes as near to another one as is allowed.

    Args:
        seed: What the search found; None to draw the problem alone.
        problem: The problem; that of the seed when None.
        title: Heading of the figure.
        nodes: Number of nodes of the surfaces' grid along each coordinate.
        surroundings: How far around the positions is shown, as a share of their extent [1].
        box: Least and largest values to show [m or rad], shape (3,) each; chosen from the positions when None.
        view: Elevation and azimuth of the eye [degrees].

    Returns:
        The figure.

    Raises:
        DefinitionError: There are not three coordinates, or neither a seed nor a problem.

    Source: Lahouar, figures III.23 to III.31.
    """
    if problem is None:
        if seed is None:
            raise DefinitionError("there is neither a seed nor a problem: nothing to draw")
        problem = seed.problem
    names = problem.independent
    if len(names) != 3:
        raise DefinitionError(f"a search in {len(names)} coordinates {list(names)} cannot be drawn; it must be in 3")
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    start, goal = problem.start_configuration.X[problem.index], problem.goal_values()
    low, high = _choose_box(seed, np.array([start, goal]), problem, surroundings) if box is None else map(np.array, box)
    figure = new_figure(7.2, 5.6)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    axes: Any = figure.add_subplot(projection="3d")
    levels = sample_levels(problem, low, high, (nodes, nodes, nodes))
    for (name, color, opacity), values in zip(SURFACES, _values(levels, problem), strict=True):
        triangles = trace_zero_surface(levels.axes, values)
        if len(triangles):
            surface = Poly3DCollection(triangles, facecolor=color, alpha=opacity, linewidth=0.0, label=name)
            axes.add_collection3d(surface)
    if seed is not None:
        waiting = set(map(tuple, seed.queued.tolist()))
        looked_at = [point for point in seed.explored.tolist() if tuple(point) not in waiting]
        for label, points, color, size in (
            (f"explored ({len(looked_at)})", np.array(looked_at).reshape(-1, 3), style.GREEN, 5.0),
            (f"queued ({len(seed.queued)})", seed.queued, style.ORANGE, 14.0),
        ):
            if len(points):
                axes.scatter(*points.T, s=size, color=color, depthshade=False, linewidths=0.0, label=label)
        axes.plot(*seed.points.T, color=style.BLUE, linewidth=2.4, marker=".", label="path", zorder=10)
    straight = np.array([start, goal])
    axes.plot(*straight.T, color=style.INK, linewidth=1.1, linestyle=(0, (4, 3)), label="straight", zorder=9)
    for word, point, face in (("start", start, style.PAPER), ("goal", goal, style.INK)):
        axes.plot(
            *point[:, None], marker="o" if word == "start" else "s", markersize=6.5, markerfacecolor=face,
            markeredgecolor=style.INK, linestyle="none", label=word, zorder=12,
        )  # fmt: skip
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    kinds = {v.name: v.unit for v in problem.robot.mechanism.variables}
    for name, axis in zip(names, (axes.xaxis, axes.yaxis, axes.zaxis), strict=True):
        axis.set_pane_color((0.97, 0.975, 0.98, 1.0))
        axis.set_label_text(axis_label(name, kinds[name]))
    extent = (high - low) * problem.metric
    axes.set_box_aspect(np.maximum(extent / np.max(extent), 0.45), zoom=1.12)
    axes.view_init(elev=view[0], azim=view[1])
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=4)
    return figure


def _values(levels: Levels, problem: Problem) -> tuple[Array, Array]:
    """Give what vanishes on each surface; nan everywhere where there is nothing to meet."""
    clearance = levels.clearance if problem.scene.pairs else np.full_like(levels.clearance, np.nan)
    return levels.determinant, clearance


def _choose_box(seed: Seed | None, ends: Array, problem: Problem, surroundings: float) -> tuple[Array, Array]:
    """Choose what to show: all positions, with a little room, never thin in any coordinate."""
    points = ends if seed is None else np.vstack([ends, seed.points, seed.explored, seed.queued.reshape(-1, 3)])
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.max((high - low) * problem.metric) / problem.metric
    half = np.maximum(0.5 * (high - low), 0.2 * span) + surroundings * 0.5 * span
    lower, upper = (bound[problem.index] for bound in problem.bounds.bounds(problem.robot.mechanism))
    middle = 0.5 * (low + high)
    return np.maximum(middle - half, lower), np.minimum(middle + half, upper)
