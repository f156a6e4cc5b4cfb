"""Draw paths among obstacles: in space, from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from paraopt.errors import DefinitionError
from paraopt.shapes import Box, Capsule, Cylinder, Shape, Sphere
from paraopt.spatial import finite_vector
from paraopt.view import style
from paraopt.view.canvas import axis_label, display_scale, in_house_style, new_figure
from paraopt.view.content import PathLine

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
    low, high = _choose_limits(np.vstack(clouds), [_surface(solid) for solid in obstacles], surroundings)
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
        surface = factor * _surface(solid)
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
    _dress_space(space, low, high, unit)
    handles, labels = space.get_legend_handles_labels()
    if near:
        from matplotlib.patches import Patch

        handles.append(Patch(facecolor=OBSTACLE, alpha=0.3, edgecolor=OBSTACLE))
        labels.append("obstacle" if near == 1 else "obstacles")
    figure.legend(handles, labels, loc="outside lower left", ncols=min(len(labels), 6))
    return figure


def _dress_space(space: Any, low: NDArray[np.float64], high: NDArray[np.float64], unit: str) -> None:
    """Give the axes in space equal scales, a plain look and names."""
    from matplotlib.ticker import MaxNLocator

    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect(high - low, zoom=0.96)
    space.set_proj_type("persp", focal_length=0.6)
    space.view_init(elev=24, azim=-58)
    for name, axis, extent in zip("xyz", (space.xaxis, space.yaxis, space.zaxis), high - low, strict=True):
        axis.set_pane_color((0.97, 0.975, 0.98, 1.0))
        axis.line.set_color("#9AA5B1")
        axis.set_major_locator(MaxNLocator(nbins=int(np.clip(round(6 * extent / np.max(high - low)), 2, 6))))
        axis.set_label_text(axis_label(name, unit))


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


def _surface(solid: Shape, n_around: int = 48, n_along: int = 16) -> NDArray[np.float64]:
    """Sample the surface of a solid as a grid of world points [m], shape (rows, columns, 3)."""
    around = np.linspace(0.0, 2.0 * np.pi, n_around + 1)
    match solid:
        case Box():
            # Four side faces and two lids collapsed to the axis.
            half = 0.5 * np.asarray(solid.size)
            ring = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)], dtype=float)
            profile = [(0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)]
            local = np.array([[(*(r * corner), z) for corner in ring] for r, z in profile]) * half
        case Sphere():
            polar = np.linspace(0.0, np.pi, n_along + 1)
            local = _revolve(solid.radius * np.sin(polar), solid.radius * np.cos(polar), around)
        case Cylinder():
            half_length = 0.5 * solid.length
            radii = np.array([0.0, solid.radius, solid.radius, 0.0])
            local = _revolve(radii, np.array([-half_length, -half_length, half_length, half_length]), around)
        case Capsule():
            polar = np.linspace(0.0, 0.5 * np.pi, n_along // 2 + 1)
            cap_r, cap_z = solid.radius * np.sin(polar), solid.radius * np.cos(polar) + 0.5 * solid.length
            local = _revolve(np.r_[cap_r, cap_r[::-1]], np.r_[cap_z, -cap_z[::-1]], around)
        case _:
            raise DefinitionError(
                f"obstacle {solid.name!r} is a {type(solid).__name__}; figures draw Box, Sphere, Cylinder and Capsule"
            )
    points: NDArray[np.float64] = local @ solid.pose[:3, :3].T + solid.pose[:3, 3]
    return points


def _revolve(radii: NDArray[np.float64], heights: NDArray[np.float64], around: NDArray[np.float64]) -> Any:
    """Turn a profile (radii and heights [m]) about z: points of shape (profile, around, 3)."""
    rings = radii[:, None, None] * np.stack([np.cos(around), np.sin(around)], axis=-1)
    return np.concatenate([rings, np.broadcast_to(heights[:, None, None], (*rings.shape[:2], 1))], axis=-1)
