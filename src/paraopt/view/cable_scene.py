"""A filmstrip of a cable robot among obstacles: platform, cables and solids at several instants, side by side."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.cable import MotionChain
from paraopt.planning import Trajectory
from paraopt.scene import Scene
from paraopt.scene.pairs import WORLD
from paraopt.shapes import Cylinder, HalfSpace, Shape
from paraopt.view import style
from paraopt.view.canvas import in_house_style, new_figure
from paraopt.view.motion import list_cable_ends
from paraopt.view.render import Camera, Solid, render
from paraopt.view.space import list_link_kinds, sample_surfaces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@in_house_style
def draw_cable_scene(
    scene: Scene,
    motion: Trajectory | MotionChain,
    *,
    times: ArrayLike | None = None,
    columns: int = 4,
    azimuth: float = -62.0,
    elevation: float = 24.0,
    width: float = 2.6,
    resolution: float = 160.0,
    title: str | None = None,
) -> Figure:
    """Draw robot, cables and obstacles at several instants, seen from one place; a planar robot from above.

    Args:
        scene: The scene; half-spaces are not drawn.
        motion: A motion of its robot, or a chain of them.
        times: Instants [s]; start, end and two or more between, as many as fill one row, when None.
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
    instants = np.atleast_1d(
        np.linspace(0.0, motion.duration, max(columns, 2)) if times is None else np.asarray(times, dtype=float)
    )
    if not instants.size or columns < 1:
        raise DefinitionError(f"{instants.size} instants in {columns} columns: there is nothing to draw")
    X = motion(instants)
    if scene.robot.mechanism.planar:
        azimuth, elevation = -90.0, 90.0
    right, up, view = _aim(math.radians(azimuth), math.radians(elevation))
    pictures = _list_solids(scene, X)
    # one window for all
    seen = np.vstack([s.surface.reshape(-1, 3) for solids in pictures for s in solids]) @ np.column_stack([right, up])
    low, high = seen.min(axis=0), seen.max(axis=0)
    pad = 0.04 * float(np.max(high - low))
    low, high = low - pad, high + pad
    scale = width / float(high[0] - low[0])  # inches per metre
    height = scale * float(high[1] - low[1])
    fine = 2.0 * resolution
    pixels = (round(fine * width), round(fine * height))
    camera = Camera(fine * scale * np.array([right, up]), -fine * scale * low, view)

    count = min(columns, len(instants))
    rows = math.ceil(len(instants) / count)
    head, gap = 0.3, 0.12
    figure = new_figure(count * (width + gap) + gap, rows * (height + head) + 0.5)
    figure.set_layout_engine("none")
    total = figure.get_size_inches()
    heading = title or f"{scene.robot.name}: {motion.duration:.3g} s"
    figure.text(gap / total[0], 1.0 - 0.1 / total[1], heading, fontsize=11, fontweight="bold", va="top")
    for k, (t, solids) in enumerate(zip(instants.tolist(), pictures, strict=True)):
        row, column = divmod(k, count)
        left, bottom = gap + column * (width + gap), total[1] - 0.4 - (row + 1) * (height + head) + 0.05
        axes = figure.add_axes((left / total[0], bottom / total[1], width / total[0], height / total[1]))
        picture = render(solids, camera, *pixels)
        axes.imshow(picture, origin="lower", extent=(low[0], high[0], low[1], high[1]), interpolation="antialiased")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.set_axis_off()
        above: Any = {"transform": axes.transAxes, "va": "bottom", "fontsize": 8.5}
        axes.text(0.0, 1.01, f"{t:.2f} s", color=style.MUTED, **above)
    return figure


def _list_solids(scene: Scene, X: Array) -> list[list[Solid]]:
    """List what is drawn at each configuration."""
    from matplotlib.colors import to_rgb

    kinds = {**list_link_kinds(scene.robot.mechanism), "world": "obstacle"}
    poses, ends = scene.robot.kinematics.poses(X), list_cable_ends(scene, X)
    size = float(np.max(np.ptp(ends.reshape(-1, 3), axis=0)))
    solids = [(b, b.shape) for b in scene.bodies if isinstance(b.shape, Shape) and not isinstance(b.shape, HalfSpace)]
    shapes = [(b, sample_surfaces(shape), to_rgb(style.KIND_COLORS[kinds[b.link]])) for b, shape in solids]
    pictures = []
    for place, pairs in zip(poses, ends, strict=True):
        drawn = []
        for group, (body, surfaces, color) in enumerate(shapes):
            X_WB = np.eye(4) if body.frame == WORLD else place[body.frame]
            drawn += [Solid(surface @ X_WB[:3, :3].T + X_WB[:3, 3], color, group) for surface in surfaces]
        for i, (a, b) in enumerate(pairs):
            line = Cylinder.between(a, b, 0.0022 * size, "cable")  # a width that is seen
            color = to_rgb(style.CABLE)
            drawn += [Solid(surface, color, len(shapes) + i) for surface in sample_surfaces(line)]
        pictures.append(drawn)
    return pictures


def _aim(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """Give the directions to the right, upwards and towards the person who looks."""
    view = np.array([
        math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation),
    ])  # fmt: skip
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    return right, np.cross(view, right), view
