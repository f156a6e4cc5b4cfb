"""Draw paths among obstacles: in space, from above and from the side."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from paraopt.errors import DefinitionError
from paraopt.shapes import HalfSpace, Shape
from paraopt.spatial import finite_vector
from paraopt.view import style
from paraopt.view.canvas import axis_label, display_scale, in_house_style, new_figure
from paraopt.view.content import PathLine, finite_array
from paraopt.view.render import list_faces
from paraopt.view.space import dress_space, fill_half_space, sample_surfaces

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
    cables: Any = (),
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
        cables: Ends of cables at some instants from start to goal [m], shape (n, n_cables, 2, 3); the goal's are drawn
            in full, the earlier the fainter. The picture holds them whole.
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
    strands = _read_cables(cables)
    clouds.append(strands.reshape(-1, 3))
    finite = [solid for solid in obstacles if not isinstance(solid, HalfSpace)]
    surfaces = [sample_surfaces(solid) for solid in finite]
    low, high = _choose_limits(np.vstack(clouds), list(itertools.chain(*surfaces)), surroundings)
    planes = [fill_half_space(solid, low, high) for solid in obstacles if isinstance(solid, HalfSpace)]
    surfaces += [sample_surfaces(solid) for solid in planes if solid is not None]
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

    shown = 0
    for parts in surfaces:
        visible = [factor * part for part in parts]
        visible = [s for s in visible if np.all(s.min(axis=(0, 1)) < high) and np.all(s.max(axis=(0, 1)) > low)]
        shown += bool(visible)
        for surface in visible:
            _draw_solid(space, np.clip(surface, low, high))
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
    for index, instant in enumerate(factor * strands):
        # the goal last, dark; what was before it is a shadow of it
        last = index == len(strands) - 1
        thin: dict[str, Any] = {"color": style.CABLE, "linewidth": 1.2 if last else 0.8, "zorder": 6 if last else 5}
        thin["alpha"] = 1.0 if last else 0.15 + 0.35 * index / len(strands)
        for k, ends_of_cable in enumerate(instant):
            space.plot(*ends_of_cable.T, label="cables" if last and k == 0 else None, **thin)
            above.plot(*ends_of_cable[:, :2].T, **thin)
            front.plot(*ends_of_cable[:, [0, 2]].T, **thin)
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
    if shown:
        from matplotlib.patches import Patch

        handles.append(Patch(facecolor=OBSTACLE, alpha=0.3, edgecolor=OBSTACLE))
        labels.append("obstacle" if shown == 1 else "obstacles")
    figure.legend(handles, labels, loc="outside lower left", ncols=min(len(labels), 6))
    return figure


def _read_cables(cables: Any) -> NDArray[np.float64]:
    """Copy ends of cables into an array (n, n_cables, 2, 3), without instants where there are no cables."""
    if np.size(cables) == 0:
        return np.empty((0, 0, 2, 3))
    return finite_array(cables, (None, None, 2, 3), "cables")


def _draw_solid(space: Any, surface: NDArray[np.float64]) -> None:
    """Draw the faces of a convex solid; those that clipping made flat are left out."""
    from matplotlib.colors import LightSource, to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners, normals = list_faces(surface)
    if len(corners):
        bright = 0.65 + 0.35 * np.clip(normals @ LightSource(225.0, 20.0).direction, 0.0, 1.0)
        colors = bright[:, None] * np.array(to_rgb(OBSTACLE))
        space.add_collection3d(Poly3DCollection(corners, facecolors=colors, linewidths=0, alpha=0.28), autolim=False)


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
