"""Draw a robot at rest: its solids in space, or from above if it is planar; links without solids as lines."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from paraopt.kinematics import Configuration, report_state
from paraopt.mechanism import Base, LinkClosure, Mechanism, Mobile, Series
from paraopt.robot import Robot
from paraopt.shapes import Cylinder, Sphere
from paraopt.spatial import transform
from paraopt.view import style
from paraopt.view.canvas import axis_label, display_scale, in_house_style, new_figure, save_figure
from paraopt.view.graph_content import count
from paraopt.view.render import Camera, Solid, render
from paraopt.view.space import dress_space, list_link_kinds, sample_surface, sample_surfaces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLORS = {**style.KIND_COLORS, "robot": "#B4BFCA", "cable": style.CABLE}
LABELS = {
    "base": "base",
    "robot": "links",
    "actuator": "links moved by an actuator",
    "platform": "platform or tool",
    "cable": "cables",
}
ELEVATION, AZIMUTH = 22.0, -56.0
"""From where a robot in space is seen [deg]."""

MIN_WIDTH = 4.6
"""Least width of a figure [in]: the legend must find room."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Hold one thing to draw, in the world.

    Attributes:
        kind: "base", "robot", "actuator", "platform" or "cable".
        points: Grid of points on the surface of a convex solid, shape (rows, columns, 3), or the vertices of a line,
            shape (k, 3) [m]; a single one is drawn as a dot.
        line: Whether it is a line or a dot.
        dashed: Whether the line is dashed.
    """

    kind: str
    points: Array
    line: bool = False
    dashed: bool = False


@in_house_style
def draw_robot(
    robot: Robot,
    path: str | os.PathLike[str] | None = None,
    *,
    configuration: Configuration | None = None,
    resolution: float = 160.0,
) -> Figure:
    """Draw a robot at home or at another configuration.

    Colours tell the base, the links that an actuator moves, the platform, and the other links. A link without solids is
    drawn as a line through the points at which others are tied to it; where an actuator changes its length the line is
    solid, elsewhere dashed. Cables are thin lines from end to end. A planar robot is seen from above.

    Args:
        robot: The robot.
        path: File to write, "*.png" or "*.svg"; none when None.
        configuration: Where it stands; at home when None.
        resolution: Pixels per inch of a PNG.

    Returns:
        The figure; axes are in millimetres where everything lies within two metres, else in metres.

    Raises:
        SolveError: The loops cannot be closed at home.
        DefinitionError: The suffix of the file is neither ".png" nor ".svg".
        OSError: The file cannot be written.
    """
    where = robot.home_configuration if configuration is None else configuration
    pieces = list_pieces(robot, where)
    cloud = np.vstack([piece.points.reshape(-1, 3) for piece in pieces])
    factor, unit = display_scale("m", cloud)
    cloud = factor * cloud
    pieces = [Piece(p.kind, factor * p.points, p.line, p.dashed) for p in pieces]
    if robot.mechanism.planar:
        pivots = [(factor * point, held) for point, held in _list_pivots(robot, where)]
        figure = _draw_flat(pieces, pivots, cloud, unit)
    else:
        figure = _draw_space(pieces, cloud, unit, resolution)
    _write_heading(figure, robot, where)
    _write_legend(figure, pieces)
    if path is not None:
        save_figure(figure, path, resolution=resolution)
    return figure


def list_pieces(robot: Robot, configuration: Configuration) -> list[Piece]:
    """List what is drawn of a robot: its solids, its cables, and lines for links that have neither.

    Args:
        robot: The robot.
        configuration: Where it stands.

    Returns:
        Solids and lines in the world.
    """
    kinds = list_link_kinds(robot.mechanism)
    poses = _poses_by_link(robot, configuration)
    cables = [
        np.array([_move(poses[link], np.array(point)) for link, point in zip(cable.links, cable.points, strict=True)])
        for cable in robot.cables
    ]
    pieces = []
    for link in robot.mechanism.links:
        X_WL = poses[link.name]
        for solid in robot.shapes.get(link.name, ()):
            surfaces = sample_surfaces(solid, np.zeros(3), 3.0 * robot.mechanism.length)
            pieces += [Piece(kinds[link.name], _move(X_WL, surface)) for surface in surfaces]
        driven = kinds[link.name] in ("actuator", "platform", "base")
        lines = [] if robot.shapes.get(link.name) else [_move(X_WL, k) for k in _list_lines(robot.mechanism, link.name)]
        # a stroke is drawn even where there are solids: tubes that do not reach each other must not look cut off
        if isinstance(link, Series) and any(m.kind == "length" for m in link.motions):
            lines.append(np.array([_move(poses[link.father], np.array(link.at)), X_WL[:3, 3]]))
        if not lines and not robot.shapes.get(link.name) and kinds[link.name] == "platform":
            lines.append(X_WL[None, :3, 3])
        # a leg of variable length that stands for a cable is that cable
        lines = [line for line in lines if not any(_is_same_line(line, cable, robot) for cable in cables)]
        pieces += [Piece(kinds[link.name], line, line=True, dashed=not driven) for line in lines]
    return pieces + [Piece("cable", cable, line=True) for cable in cables]


def _is_same_line(line: Array, cable: Array, robot: Robot) -> bool:
    """Tell whether a line runs from end to end of a cable, in either direction."""
    near = 1e-6 * robot.mechanism.length
    return line.shape == cable.shape and any(np.allclose(line, way, rtol=0, atol=near) for way in (cable, cable[::-1]))


def _poses_by_link(robot: Robot, configuration: Configuration) -> dict[str, Array]:
    poses = robot.kinematics.poses(configuration.X)[0]
    return {link.name: pose for link, pose in zip(robot.mechanism.links, poses, strict=True)}


def _move(X_WL: Array, points: Array) -> Array:
    moved: Array = points @ X_WL[:3, :3].T + X_WL[:3, 3]
    return moved


def _list_lines(mechanism: Mechanism, name: str) -> Iterator[Array]:
    """Give the lines that stand for a link: between two points of it, or around three or more [m]."""
    link = mechanism.link(name)
    points: list[Sequence[float]] = [] if isinstance(link, (Base, Mobile)) else [(0.0, 0.0, 0.0)]
    points += [k.at for k in mechanism.links if isinstance(k, Series) and k.father == name]
    for closure in _list_joints(mechanism):
        for end, anchor in zip((closure.link_A, closure.link_B), closure.anchors, strict=True):
            if end == name and anchor is not None:
                points.append(anchor)
    corners = np.unique(np.round(np.array(points, dtype=float).reshape(-1, 3), 9), axis=0)
    if len(corners) == 2:
        yield corners
    elif len(corners) > 2:
        # around the middle, in the plane that fits the points best
        centred = corners - corners.mean(axis=0)
        u, v = np.linalg.svd(centred)[2][:2]
        order = np.argsort(np.arctan2(centred @ v, centred @ u))
        yield corners[[*order, order[0]]]


def _list_joints(mechanism: Mechanism) -> list[LinkClosure]:
    return [c for c in mechanism.closures if isinstance(c, LinkClosure)]


def _list_pivots(robot: Robot, configuration: Configuration) -> Iterator[tuple[Array, bool]]:
    """Give the points in the world about which links turn [m], and whether the base holds them."""
    base = robot.mechanism.base.name
    poses = _poses_by_link(robot, configuration)
    for link in robot.mechanism.links:
        if isinstance(link, Series) and any(m.kind == "angle" for m in link.motions):
            yield poses[link.name][:3, 3], link.father == base
    for closure in _list_joints(robot.mechanism):
        first, second = closure.anchors
        if first is not None and second is not None:
            yield _move(poses[closure.link_A], np.array(first)), base in (closure.link_A, closure.link_B)


# --- In space


def _draw_space(pieces: Sequence[Piece], cloud: Array, unit: str, resolution: float) -> Figure:
    """Render the solids over axes in space; lines become thin tubes, so that what lies in front hides them."""
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d import proj3d

    low, high = cloud.min(axis=0), cloud.max(axis=0)
    span = float(np.max(high - low))
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 0.08 * span) + 0.03 * span
    low, high = middle - half, middle + half
    side = 6.0  # inches; the figure is cut to what the axes take of this square
    figure = new_figure(side, side)
    figure.set_layout_engine("none")
    space: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    dress_space(space, low, high, unit)
    space.set_box_aspect(high - low, zoom=1.0)
    space.set_proj_type("ortho")
    space.view_init(elev=ELEVATION, azim=AZIMUTH)
    _number_axes(space, low, high)

    # scale and shift the square so that the box of the axes fills the figure
    space.apply_aspect()

    def project(points: Array) -> Array:
        x, y, _ = proj3d.proj_transform(*points.T, space.get_proj())
        fractions: Array = figure.transFigure.inverted().transform(space.transData.transform(np.column_stack([x, y])))
        return side * fractions

    shown = project(np.array(list(itertools.product(*zip(low, high, strict=True)))))
    scale = float(min(4.7 / np.ptp(shown[:, 0]), 5.4 / np.ptp(shown[:, 1])))
    width, height = (scale * np.ptp(shown, axis=0)).tolist()
    left, bottom, top = max(0.85, 0.5 * (MIN_WIDTH - width)), 1.2, 0.75
    total = np.array([width + 2 * left, height + bottom + top])
    shift = np.array([left, bottom]) - scale * shown.min(axis=0)

    # the projection is parallel, hence known from four points
    origin, *ends = scale * project(middle + span * np.vstack([np.zeros(3), np.eye(3)])) + shift
    across = np.column_stack([end - origin for end in ends]) / span
    elevation, azimuth = np.radians([ELEVATION, AZIMUTH])
    view = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    fine = 2.0 * resolution  # pixels per inch; halved when drawn, which smooths steps
    camera = Camera(fine * across, fine * (origin - across @ middle), np.array(view))
    thin = (0.0035 * span, 0.0022 * span)
    solids = [
        Solid(surface, to_rgb(COLORS[piece.kind]), group)
        for group, piece in enumerate(pieces)
        for surface in (_tubes(piece, thin[piece.kind == "cable"]) if piece.line else [piece.points])
    ]
    columns, rows = (round(v) for v in (fine * total).tolist())
    picture = render(solids, camera, columns, rows)

    figure.set_size_inches(*total)
    space.set_position((*(shift / total), *(scale * side / total)))
    over = figure.add_axes((0.0, 0.0, columns / fine / total[0], rows / fine / total[1]))
    over.imshow(picture, origin="lower", aspect="auto", interpolation="antialiased")
    over.set_axis_off()
    return figure


def _number_axes(space: Any, low: Array, high: Array) -> None:
    """Choose few numbers, none where two axes meet, and keep them and the names clear of the axes."""
    from matplotlib.ticker import MaxNLocator

    extents = high - low
    # where the numbers of x end those of y begin; matplotlib shifts numbers in proportion to the other extents
    shares = {space.xaxis: (0.04, 0.88), space.yaxis: (0.12, 0.96), space.zaxis: (0.0, 1.0)}
    for k, (axis, (first, last)) in enumerate(shares.items()):
        locator = MaxNLocator(nbins=int(np.clip(round(6 * extents[k] / extents.max()), 3, 6)))
        start, end = low[k] + first * extents[k], low[k] + last * extents[k]
        axis.set_ticks([value for value in locator.tick_values(low[k], high[k]) if start <= value <= end])
    slim = float(min(extents.max() / max(extents[0], extents[1]), 4.0))
    space.zaxis.set_tick_params(pad=11.0 * slim - 8.0)
    space.xaxis.labelpad = space.yaxis.labelpad = 6.0
    space.zaxis.labelpad = 25.0 * slim - 21.0


def _tubes(piece: Piece, radius: float) -> list[Array]:
    """Turn a line into thin tubes, a dashed one into a row of them, and a dot into a ball."""
    if len(piece.points) == 1:
        return [sample_surface(Sphere(radius=5.0 * radius, pose=transform(piece.points[0])), n_around=24)]
    tubes = []
    for a, b in itertools.pairwise(piece.points):
        length = float(np.linalg.norm(b - a))
        if length < radius:
            continue
        n = max(1, round(length / (12.0 * radius))) if piece.dashed else 1
        for k in range(n):
            end = (k + 0.6) / n if piece.dashed else 1.0
            tube = Cylinder.between(a + (k / n) * (b - a), a + end * (b - a), radius)
            tubes.append(sample_surface(tube, n_around=8))
    return tubes


# --- In the plane


def _draw_flat(pieces: Sequence[Piece], pivots: Sequence[tuple[Array, bool]], cloud: Array, unit: str) -> Figure:
    """Draw outlines of the solids seen from above, pivots as circles, and the ground where the base holds links."""
    from matplotlib.patches import Polygon

    cloud = np.vstack([cloud, *(point for point, _ in pivots)])
    low, high = cloud.min(axis=0)[:2], cloud.max(axis=0)[:2]
    span = float(np.max(high - low))
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 0.2 * span) + 0.09 * span
    low, high = middle - half, middle + half
    scale = float(min(5.2 / (2 * half[0]), 5.2 / (2 * half[1])))
    width, height = (2.0 * half * scale).tolist()
    left, bottom = 0.75, 1.0
    total = (max(width + left + 0.3, MIN_WIDTH), height + bottom + 0.75)
    left += 0.5 * (total[0] - (width + left + 0.3))
    figure = new_figure(*total)
    figure.set_layout_engine("none")
    axes = figure.add_axes((left / total[0], bottom / total[1], width / total[0], height / total[1]))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set(xlabel=axis_label("x", unit), ylabel=axis_label("y", unit))
    depth = {"base": 1.0, "robot": 2.0, "platform": 2.2, "actuator": 2.4}
    for piece in pieces:
        color = COLORS[piece.kind]
        if piece.line:
            dashes: Any = (0.0, (3.0, 2.0)) if piece.dashed else "-"
            width = 1.3 if piece.kind == "cable" else 2.0
            if len(piece.points) == 1:
                look: dict[str, Any] = {"markerfacecolor": color, "markeredgecolor": _darken(color), "zorder": 5}
                axes.plot(*piece.points[:, :2].T, "o", markersize=9, **look)
            else:
                axes.plot(*piece.points[:, :2].T, color=color, linewidth=width, linestyle=dashes, zorder=1.5)
            continue
        points = piece.points.reshape(-1, 3)[:, :2]
        outline = points[ConvexHull(points).vertices]
        axes.add_patch(
            Polygon(outline, facecolor=color, edgecolor=_darken(color), linewidth=0.9, zorder=depth[piece.kind])
        )
    size = 0.16 / scale  # inches, in the unit of the axes
    for point, held in pivots:
        if held:
            x, y = point[:2]
            foot = y - 1.1 * size
            feet: dict[str, Any] = {"edgecolor": style.INK, "linewidth": 0.9, "zorder": 3.5}
            axes.add_patch(Polygon([(x - 0.7 * size, foot), (x + 0.7 * size, foot), (x, y)], facecolor="white", **feet))
            soil = [(x - size, foot - 0.45 * size), (x + size, foot - 0.45 * size), (x + size, foot), (x - size, foot)]
            axes.add_patch(
                Polygon(soil, facecolor="none", edgecolor=style.INK, hatch="//////", linewidth=0, zorder=3.5)
            )
        axes.plot(*point[:2], "o", markersize=4.5, markerfacecolor="white", markeredgecolor=style.INK, zorder=4)
    return figure


def _darken(color: str) -> Any:
    from matplotlib.colors import to_rgb

    return tuple(0.62 * c for c in to_rgb(color))


# --- Words


def _write_heading(figure: Figure, robot: Robot, configuration: Configuration) -> None:
    """Write the name, and below it mobility, variables and equations as computed at the configuration."""
    state = report_state(robot.kinematics, configuration)
    idle = f" ({len(state.idle)} idle)" if state.idle else ""
    facts = (
        f"mobility {state.mobility}{idle}, {count(state.n_variables, 'variable')}, "
        f"{count(state.n_equations, 'equation')} of rank {state.ranks['E'].value}"
    )
    width, height = figure.get_size_inches()
    left, top = 0.15 / width, 1.0 - 0.12 / height
    figure.text(left, top, robot.name, fontsize=11, fontweight="bold", va="top")
    figure.text(left, top - 0.22 / height, facts, fontsize=8.5, color=style.MUTED, va="top")


def _write_legend(figure: Figure, pieces: Sequence[Piece]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    for kind, label in LABELS.items():
        if any(p.kind == kind and not p.line for p in pieces):
            handles.append(Patch(facecolor=COLORS[kind], edgecolor=_darken(COLORS[kind]), linewidth=0.8, label=label))
        elif any(p.kind == kind and len(p.points) == 1 for p in pieces):
            dot: Any = {"markerfacecolor": COLORS[kind], "markeredgecolor": _darken(COLORS[kind]), "markersize": 9}
            handles.append(Line2D([], [], linestyle="none", marker="o", label=label, **dot))
        elif any(p.kind == kind and p.line for p in pieces):
            dashed = all(p.dashed for p in pieces if p.kind == kind)
            look: Any = "--" if dashed else "-"
            text = label if kind == "cable" else f"{label}, without solids"
            handles.append(Line2D([], [], color=COLORS[kind], linewidth=1.8, linestyle=look, label=text))
    columns = len(handles) if figure.get_size_inches()[0] > 1.75 * len(handles) else 2
    figure.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.0), ncols=columns, columnspacing=1.2)
