"""Paths among obstacles: in space, from above and from the front."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po
from motions import OBSTACLES, plan_of, problem_of
from paraopt.view import PathLine, draw_path, save_figure, style
from paraopt.view.motion import trace

S = np.linspace(0.0, 1.0, 41)
ARCH = np.column_stack([0.2 * S - 0.1, 0.05 * np.sin(np.pi * S), 0.5 + 0.0 * S])
SHAPES = [
    po.Box(name="box", size=(0.05, 0.05, 0.05), pose=po.transform((0.0, 0.0, 0.5))),
    po.Sphere(name="sphere", radius=0.02, pose=po.transform((0.1, 0.1, 0.5))),
    po.Cylinder(name="cylinder", radius=0.02, length=0.1, pose=po.transform((-0.1, 0.1, 0.5), (0.3, 0.0, 0.0))),
    po.Capsule(name="capsule", radius=0.02, length=0.1, pose=po.transform((0.0, -0.1, 0.5), (0.0, 1.0, 0.0))),
]


def test_a_path_is_drawn_from_three_sides(looked_at: Any) -> None:
    figure = draw_path([PathLine("way", ARCH)], SHAPES, start=ARCH[0], goal=ARCH[-1], title="Path")
    space, above, front = figure.axes
    texts = looked_at.texts(figure)
    for word in (
        "Path",
        "from above",
        "from the front",
        "x [mm]",
        "y [mm]",
        "z [mm]",
        "way",
        "start",
        "goal",
        "obstacles",
    ):
        assert word in texts, word
    for axes, (i, j) in ((above, (0, 1)), (front, (0, 2))):
        (curve,) = [line for line in axes.get_lines() if len(line.get_xdata()) == len(ARCH)]
        np.testing.assert_allclose(curve.get_xdata(), 1e3 * ARCH[:, i], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(curve.get_ydata(), 1e3 * ARCH[:, j], rtol=1e-12, atol=1e-12)
        assert axes.get_aspect() == 1.0
        assert len(axes.patches) == 2 * len(SHAPES)  # face and outline of each silhouette
    assert space.name == "3d"


def test_a_silhouette_is_where_the_obstacle_is() -> None:
    _, above, front = draw_path([PathLine("way", ARCH)], SHAPES[:1], title="").axes
    for axes, middle in ((above, (0.0, 0.0)), (front, (0.0, 500.0))):
        corners = axes.patches[0].get_xy()
        np.testing.assert_allclose(corners.min(axis=0), np.array(middle) - 25.0, rtol=0, atol=1e-9)
        np.testing.assert_allclose(corners.max(axis=0), np.array(middle) + 25.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("task", ["cylinder", "box"])
def test_the_planned_path_stays_off_the_silhouette_of_what_it_avoids(task: str) -> None:
    """Seen from where it passes, at the side or below, the way of the tool's tip stays off the obstacle."""
    points = trace(problem_of(task), plan_of(task).path(np.linspace(0.0, 1.0, 101)))
    straight = np.linspace(points[0], points[-1], 101)
    _, above, front = draw_path([PathLine("refined path", points)], OBSTACLES[task], title=task).axes
    outline = (above if task == "cylinder" else front).patches[0].get_path()
    shown = [0, 1] if task == "cylinder" else [0, 2]
    assert not outline.contains_points(1e3 * points[:, shown]).any()
    assert outline.contains_points(1e3 * straight[:, shown]).any()


def test_obstacles_far_away_are_left_out() -> None:
    far = po.Sphere(name="far", radius=0.02, pose=po.transform((50.0, 0.0, 0.0)))
    _, above, _ = draw_path([PathLine("way", ARCH)], [far], title="").axes
    assert len(above.patches) == 0
    assert above.get_xlim()[1] < 1000.0


def test_a_point_alone_is_enough() -> None:
    figure = draw_path([], start=(0.0, 0.0, 0.0), title="Start")
    assert len(figure.axes) == 3
    low, high = figure.axes[1].get_xlim()
    assert low < 0.0 < high


def test_a_saved_figure_is_not_blank(tmp_path: Path, looked_at: Any) -> None:
    figure = draw_path([PathLine("way", ARCH)], SHAPES, title="Path")
    pixels = looked_at.read_png(save_figure(figure, tmp_path / "path.png", resolution=60))
    assert pixels.var() > 1e-3


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (([],), {}, "nothing to draw"),
        (([], SHAPES), {}, "nothing to draw"),
        (([PathLine("way", ARCH)],), {"start": (0.0, 0.0)}, "start"),
        (([PathLine("way", ARCH)],), {"goal": (0.0, 0.0, np.nan)}, "goal"),
    ],
)
def test_faulty_paths_are_refused(arguments: tuple[Any, ...], options: dict[str, Any], words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        draw_path(*arguments, **options, title="")


def test_cables_are_held_whole_and_the_last_stand_out(looked_at: Any) -> None:
    line = PathLine("way", [[0.4, 0.5, 0.0], [0.6, 0.5, 0.0]])
    ends = np.array([[[(0, 0, 0.3), (x, 0.5, 0)], [(1, 1, 0.3), (x, 0.5, 0)]] for x in (0.4, 0.5, 0.6)])
    figure = draw_path([line], cables=ends, title="cables")
    assert looked_at.texts(figure).count("cables") == 2  # the title, and one entry of the legend
    above = figure.axes[1]
    drawn = [k for k in above.get_lines() if k.get_color() == style.CABLE]
    assert len(drawn) == 6
    alphas = [k.get_alpha() for k in drawn]
    assert alphas == sorted(alphas)
    assert alphas[-2:] == [1.0, 1.0]
    np.testing.assert_allclose(drawn[-1].get_xydata(), 1e3 * ends[-1, 1, :, :2], rtol=0, atol=1e-9)
    (left, right), (low, high) = above.get_xlim(), above.get_ylim()
    assert left < 0 < 1000 < right
    assert low < 0 < 1000 < high
    bare = draw_path([line], title="no cables")
    assert bare.axes[1].get_xlim()[0] > 0
    with pytest.raises(po.DefinitionError, match="cables: shape is"):
        draw_path([line], cables=ends[0], title="")
