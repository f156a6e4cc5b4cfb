"""Draw paths among obstacles: in space, from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from paraopt.errors import DefinitionError
from paraopt.shapes import Shape
from paraopt.spatial import finite_vector
from paraopt.view import style
from paraopt.view.canvas import axis_label, display_scale, in_house_style, new_figure
from paraopt.view.content import PathLine
from paraopt.view.space import dress_space, sample_surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OBSTACLE = style.KIND_COLORS["obstacle"]


@in_house_style
def draw_path(
    paths: Sequence[PathLine],
    obstacles: Sequence[Shape] = (),
    *,
    start: Any = None,
    goal: Any = None,
    title: str,
    surroundings: float = 1.0,
) -> Figure:
    """Draw paths among obstacles in space, seen from above (x-y) and seen from the front (x-z).

    The picture holds the paths and what of the obstacles lies near them: those far away are left out, and a floor or a
    wall is cut at the border.

    Args:
        paths: Lines to draw [m].
        obstacles: Solids whose `pose` is in the world: translucent in space, silhouettes in the projections.
        start: First point [m], shape (3,), marked; None for none.
        goal: Last point [m], shape (3,), marked; None for none.
        title: Heading of the figure.
        surroundings: How far around the paths obstacles are shown, as a share of the paths' extent [1].

    Returns:
        The figure; axes are in millimetres where everything lies within two metres, else in metres.

    Raises:
        DefinitionError: There is nothing to draw, or a point is not three finite numbers.
    """
    ends = {
        word: finite_vector(point, 3, word) for word, point in (("start", start), ("goal", goal)) if point is not None
    }
    clouds = [line.points for line in paths] + [point[None, :] for point in ends.values()]
    if not clouds:
        raise DefinitionError("paths is empty and there is neither start nor goal: nothing to draw")
    low, high = _choose_limits(np.vstack(clouds), [sample_surface(solid) for solid in obstacles], surroundings)
    factor, unit = display_scale("m", low, high)
    low, high = factor * low, factor * high

    extent = high - low
    height, width_space = 5.6, 5.4  # inches
    width_flat = float(np.clip((height - 2.0) * extent[0] / (extent[1] + extent[2]), 1.8, 4.5))
    figure = new_figure(width_space + width_flat + 0.8, height)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    ratios = {"width_ratios": (width_space, width_flat + 0.8), "height_ratios": (extent[1], extent[2])}
    grid = figure.add_gridspec(2, 2, **ratios)
    space: Any = figure.add_subplot(grid[:, 0], projection="3d")
    above, front = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])

    near = 0
    for solid in obstacles:
        surface = factor * sample_surface(solid)
        if np.any(surface.min(axis=(0, 1)) >= high) or np.any(surface.max(axis=(0, 1)) <= low):
            continue
        near += 1
        x, y, z = np.moveaxis(np.clip(surface, low, high), -1, 0)
        space.plot_surface(x, y, z, color=OBSTACLE, alpha=0.28, linewidth=0, rstride=1, cstride=1, shade=True)
        for axes, (i, j) in ((above, (0, 1)), (front, (0, 2))):
            _draw_silhouette(axes, surface.reshape(-1, 3)[:, [i, j]])
    for index, line in enumerate(paths):
        points = factor * line.points
        look: dict[str, Any] = {
            "color": line.color or style.path_color(index),
            "linestyle": (0, (4, 2.5)) if line.dashed else "-",
            "linewidth": 1.5 if line.dashed else 2.0,
        }
        space.plot(*points.T, label=line.name, zorder=10, **look)
        above.plot(points[:, 0], points[:, 1], **look)
        front.plot(points[:, 0], points[:, 2], **look)
    for word, point in ends.items():
        marker: dict[str, Any] = {
            "marker": "o" if word == "start" else "s",
            "markersize": 6.5,
            "markerfacecolor": style.PAPER if word == "start" else style.INK,
            "markeredgecolor": style.INK,
            "linestyle": "none",
            "zorder": 12,
        }
        x, y, z = factor * point
        space.plot([x], [y], [z], label=word, **marker)
        above.plot([x], [y], **marker)
        front.plot([x], [z], **marker)

    for axes, (i, j), name in ((above, (0, 1), "from above"), (front, (0, 2), "from the front")):
        axes.set_title(name, fontsize=8.5, fontweight="normal", color=style.MUTED)
        axes.set(xlim=(low[i], high[i]), ylim=(low[j], high[j]), aspect="equal", anchor="W")
        axes.set(xlabel=axis_label("xyz"[i], unit), ylabel=axis_label("xyz"[j], unit))
    dress_space(space, low, high, unit)
    handles, labels = space.get_legend_handles_labels()
    if near:
        from matplotlib.patches import Patch

        handles.append(Patch(facecolor=OBSTACLE, alpha=0.3, edgecolor=OBSTACLE))
        labels.append("obstacle" if near == 1 else "obstacles")
    figure.legend(handles, labels, loc="outside lower left", ncols=min(len(labels), 6))
    return figure


def _draw_silhouette(axes: Axes, points: NDArray[np.float64]) -> None:
    """Draw the outline of a convex solid from points of its surface, projected, shape (k, 2)."""
    from matplotlib.patches import Polygon

    outline = points[ConvexHull(points).vertices]
    axes.add_patch(Polygon(outline, facecolor=OBSTACLE, alpha=0.22, linewidth=0))
    axes.add_patch(Polygon(outline, fill=False, edgecolor=OBSTACLE, linewidth=1.1))


def _choose_limits(
    points: NDArray[np.float64], surfaces: Sequence[NDArray[np.float64]], surroundings: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Choose the corners of the box to show: the paths, and the obstacles as far as they lie near them."""
    low, high = points.min(axis=0), points.max(axis=0)
    span = max(float(np.max(high - low)), 1e-3)
    reach_low, reach_high = low - surroundings * span, high + surroundings * span
    for surface in surfaces:
        corners = surface.reshape(-1, 3)
        a, b = corners.min(axis=0), corners.max(axis=0)
        if np.all(a <= reach_high) and np.all(b >= reach_low):
            whole = np.max(b - a) <= 1.5 * span  # what is not much larger than the paths is not cut
            low = np.minimum(low, a if whole else np.maximum(a, reach_low))
            high = np.maximum(high, b if whole else np.minimum(b, reach_high))
    # A flat path still needs depth to be looked at.
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    half = np.maximum(half, 0.2 * span) + 0.05 * span
    return middle - half, middle + half
