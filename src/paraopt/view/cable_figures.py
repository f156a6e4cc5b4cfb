"""Draw cable robots: where the cables hold the platform, and tensions and lengths along a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RegularGridInterpolator

from paraopt.errors import DefinitionError
from paraopt.modes.cable import CableRobot, CableWorkspace, MotionChain, TensionBatch, cable_functions
from paraopt.modes.cable.distribution import coordinate_places
from paraopt.planning import Trajectory
from paraopt.view import style
from paraopt.view.canvas import axis_label, in_house_style, new_figure
from paraopt.view.figures import draw_series
from paraopt.view.level_surface import trace_zero_surface
from paraopt.view.space import dress_space

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
SHADES = ("#EEF4F9", "#C6DCEC", "#8FBBDB", "#4F95C4", "#1F6FA8", "#0B4C7C")
"""Colours of growing margins."""


@in_house_style
def draw_cable_workspace(workspace: CableWorkspace, *, title: str | None = None, slices: int = 3) -> Figure:
    """Draw the wrench-feasible workspace: its surface between the exits, and slices with the capacity margin.

    Args:
        workspace: The map, of a robot in space or in the plane.
        title: Heading; the robot's name and the orientation when None.
        slices: Number of slices square to z; ignored in the plane.

    Returns:
        The figure, in metres.

    Raises:
        DefinitionError: No position of the map is feasible: there is nothing to draw.
    """
    if not np.any(workspace.feasible):
        raise DefinitionError(
            f"no position of the map of {workspace.robot.name!r} has a margin of {workspace.margin:g} N (the largest "
            f"is {np.max(workspace.margins):.4g} N): there is nothing to draw"
        )
    heading = title or _heading(workspace)
    if workspace.robot.planar:
        figure = new_figure(5.6, 5.0)
        figure.suptitle(heading, x=0.01, ha="left", fontsize=11, fontweight="bold")
        axes = figure.add_subplot()
        shades = _draw_slice(axes, workspace, workspace.margins)
        _draw_exits_flat(axes, workspace.robot)
        axes.set(xlabel=axis_label("x", "m"), ylabel=axis_label("y", "m"))
        figure.colorbar(shades, ax=axes, label=axis_label("capacity margin", "N"))
        return figure
    slices = max(1, int(slices))
    figure = new_figure(10.2, 5.6)
    figure.suptitle(heading, x=0.01, ha="left", fontsize=11, fontweight="bold")
    grid = figure.add_gridspec(slices, 2, width_ratios=(6.4, 3.4))
    _draw_space(figure.add_subplot(grid[:, 0], projection="3d"), workspace)
    height = workspace.axes["z"]
    # the slices share the height of what is feasible
    found = np.flatnonzero(np.any(workspace.feasible, axis=(0, 1)))
    places = np.linspace(height[found[0]], height[found[-1]], slices + 2)[1:-1]
    panels = []
    for row, place in enumerate(places[::-1]):
        axes = figure.add_subplot(grid[row, 1])
        k = int(np.argmin(np.abs(height - place)))
        shades = _draw_slice(axes, workspace, workspace.margins[:, :, k])
        axes.set_title(f"z = {height[k]:.3g} m")
        axes.set_ylabel(axis_label("y", "m"))
        if row < slices - 1:
            axes.tick_params(labelbottom=False)
        panels.append(axes)
    panels[-1].set_xlabel(axis_label("x", "m"))
    figure.colorbar(shades, ax=panels, label=axis_label("capacity margin", "N"), shrink=0.9)
    return figure


@in_house_style
def draw_tensions(tensions: TensionBatch, *, title: str | None = None) -> Figure:
    """Draw the tensions along a motion, or over its places where no times are known, with their limits.

    Args:
        tensions: Tensions, as of `dynamic_tensions`.
        title: Heading; the robot's name when None.

    Returns:
        The figure. Limits that the cables do not share put each cable on a panel of its own.

    Raises:
        DefinitionError: The tensions have no times.
    """
    robot = tensions.robot
    if tensions.t is None:
        raise DefinitionError(f"tensions of {robot.name!r} have no times; give those of a motion (`dynamic_tensions`)")
    pairs = {c: (float(a), float(b)) for c, a, b in zip(robot.cables, robot.t_min, robot.t_max, strict=True)}
    limits: Any = next(iter(pairs.values())) if len(set(pairs.values())) == 1 else pairs
    return draw_series(
        tensions.t,
        dict(zip(robot.cables, tensions.values.T, strict=True)),
        title=title or f"{robot.name}: tensions",
        ylabel=axis_label("tension", "N"),
        limits=limits,
    )


@in_house_style
def draw_lengths(
    robot: CableRobot, trajectory: Trajectory | MotionChain, t: ArrayLike | None = None, *, title: str | None = None
) -> Figure:
    """Draw the paid-out lengths of the cables along a motion, arcs on the pulleys included.

    Args:
        robot: The cable robot.
        trajectory: A motion of its `robot`.
        t: Times [s]; 401 of them when None.
        title: Heading; the robot's name when None.

    Returns:
        The figure.

    Raises:
        DefinitionError: The trajectory is that of a mechanism without the robot's coordinates.
    """
    times = np.linspace(0.0, trajectory.duration, 401) if t is None else np.asarray(t, dtype=float)
    poses = trajectory(times)[:, coordinate_places(robot, trajectory.robot.mechanism)]
    return draw_series(
        times,
        dict(zip(robot.cables, cable_functions(robot).lengths(poses).T, strict=True)),
        title=title or f"{robot.name}: lengths of the cables",
        ylabel=axis_label("length", "m"),
    )


def _heading(workspace: CableWorkspace) -> str:
    turned = {k: v for k, v in workspace.orientation.items() if v != 0.0}
    angles = ", ".join(f"{k} = {np.degrees(v):.3g}°" for k, v in turned.items()) or "level"
    asked = f", margin above {workspace.margin:.3g} N" if workspace.margin > 0.0 else ""
    return f"{workspace.robot.name}: wrench-feasible workspace, {angles}{asked}"


def _draw_slice(axes: Any, workspace: CableWorkspace, margins: Array) -> Any:
    """Shade a slice where it is feasible, with the boundary as a line; give what the colour bar explains."""
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    x, y = workspace.axes["x"], workspace.axes["y"]
    top = float(np.max(workspace.margins))
    ticks = np.asarray(MaxNLocator(nbins=9).tick_values(workspace.margin, max(top, workspace.margin + 1e-9)))
    levels = np.append(workspace.margin, ticks[ticks > workspace.margin])
    colors = LinearSegmentedColormap.from_list("margin", SHADES)
    shades = axes.contourf(x, y, margins.T, levels=levels, cmap=colors, extend="neither")
    if np.any(margins >= workspace.margin) and np.any(margins < workspace.margin):
        axes.contour(x, y, margins.T, levels=[workspace.margin], colors=[style.INK], linewidths=1.1)
    axes.set_aspect("equal")
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    return shades


def _draw_exits_flat(axes: Any, robot: CableRobot) -> None:
    exits = robot.exits
    axes.plot(exits[:, 0], exits[:, 1], "s", color=style.INK, markersize=5, clip_on=False)
    low, high = exits.min(axis=0), exits.max(axis=0)
    room = 0.04 * float(np.max(high - low))
    axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))


def _draw_space(space: Any, workspace: CableWorkspace) -> None:
    """Draw the surface of the workspace, the exits, and the cables at home."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    robot = workspace.robot
    values = workspace.margins - workspace.margin
    # a layer of infeasible nodes around closes the surface where the map ends
    axes = []
    for line in workspace.axes.values():
        step = 1e-3 * (line[1] - line[0])
        axes.append(np.concatenate([[line[0] - step], line, [line[-1] + step]]))
    closed = np.pad(values, 1, constant_values=-float(np.max(np.abs(values))))
    triangles = trace_zero_surface(axes, closed)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    triangles, normals = triangles[sizes > 0.0], normals[sizes > 0.0] / sizes[sizes > 0.0, None]
    light = np.array([0.35, -0.55, 0.76])
    share = 0.5 + 0.5 * np.abs(normals @ (light / np.linalg.norm(light)))
    base = np.array([int(style.SKY[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    colors = 1.0 - 0.9 * (1.0 - share[:, None] * base)
    surface = Poly3DCollection(triangles, facecolors=colors, edgecolors="none", antialiased=False)
    surface.set_rasterized(True)
    space.add_collection3d(surface)
    exits = robot.exits_in_space()
    held = cable_functions(robot).attachment_points(robot.home_pose)[0]
    inside = RegularGridInterpolator(tuple(axes), closed, bounds_error=False, fill_value=-1.0)
    for exit_, point in zip(exits, held, strict=True):
        line = exit_ + np.linspace(0.0, 1.0, 201)[:, None] * (point - exit_)
        is_hidden = inside(line) > 0.0
        space.plot(*np.where(is_hidden[:, None], np.nan, line).T, color=style.INK, linewidth=1.1, zorder=6)
        hidden = np.where(is_hidden[:, None], line, np.nan)
        space.plot(*hidden.T, color=style.PAPER, linewidth=0.9, linestyle=(0.0, (4.0, 2.0)), zorder=5)
    space.plot(*exits.T, "s", color=style.INK, markersize=4.5)
    _draw_box(space, exits)
    low = np.minimum(exits.min(axis=0), [line[0] for line in workspace.axes.values()])
    high = np.maximum(exits.max(axis=0), [line[-1] for line in workspace.axes.values()])
    room = 0.03 * float(np.max(high - low))
    dress_space(space, low - room, high + room, "m")


def _draw_box(space: Any, exits: Array) -> None:
    """Draw the edges of the box that the exits span."""
    low, high = exits.min(axis=0), exits.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    for i, one in enumerate(corners):
        for other in corners[i + 1 :]:
            if np.sum(one != other) == 1:
                space.plot(*np.column_stack([one, other]), color=style.SLATE, linewidth=0.6, alpha=0.6)
