"""Pictures of robots: solids where they are, the nearest in front, lines for links without solids."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po
from paraopt.view import draw_robot, style
from paraopt.view.render import Camera, Solid, list_faces, render
from paraopt.view.robot_figure import COLORS, list_pieces
from paraopt.view.space import list_link_kinds, sample_surface

RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
# one pixel per unit, seen from above: x to the right, y upwards
ABOVE = Camera(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([20.0, 20.0]), np.array([0.0, 0.0, 1.0]))


def box(size: Any, at: Any, color: Any, group: int, angles: Any = (0, 0, 0)) -> Solid:
    return Solid(sample_surface(po.Box(size=size, pose=po.transform(at, angles))), color, group)


def hue(pixel: Any) -> str:
    return "red" if pixel[0] > pixel[1] else "green"


def arm(shapes: Any = None, **options: Any) -> po.Robot:
    """One driven link on a base, in space."""
    links = [po.Base(), po.Series("arm", "base", (0, 0, 0.1), po.Revolute("q", "y")), po.Mobile("tool")]
    closures = [po.Weld("arm", "tool", (0.3, 0, 0))]
    mechanism = po.Mechanism("arm", links, closures, ["q"], ["x", "z"])
    home = {"x": 0.3, "y": 0.0, "z": 0.1, "q": 0.0}
    return po.Robot(mechanism, home, shapes={} if shapes is None else shapes, **options)


# --- Rendering


def test_a_box_fills_its_pixels_and_no_others() -> None:
    picture = render([box((10, 6, 4), (3, -2, 0), RED, 0)], ABOVE, 40, 40)
    rows, columns = np.nonzero(picture[..., 3])
    assert (columns.min(), columns.max()) == (18, 28)  # pixel centres at 23 - 5 ... 23 + 5
    assert (rows.min(), rows.max()) == (15, 21)
    assert len(rows) == 11 * 7


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_lies_in_front_hides_what_lies_behind(order: tuple[int, int]) -> None:
    """Also where boxes interlock: each is the nearer one on one side."""
    solids = [box((20, 8, 1), (0, 0, 0), RED, 0, (0, 0.2, 0)), box((20, 8, 1), (0, 0, 0), GREEN, 1, (0, -0.2, 0))]
    picture = render([solids[k] for k in order], ABOVE, 40, 40)
    assert hue(picture[20, 14]) == "red"  # turned about y by +0.2: up where x < 0
    assert hue(picture[20, 26]) == "green"


def test_a_rod_inside_its_cylinder_is_not_seen() -> None:
    """Slanted in every direction, at many angles: painters that sort whole faces fail here."""
    for angle in np.linspace(0.0, 3.0, 13):
        pose = po.transform((0, 0, 0), (angle, 0.4, angle / 2))
        outer = sample_surface(po.Capsule(radius=4.0, length=20.0, pose=pose))
        inner = sample_surface(po.Cylinder(radius=2.0, length=16.0, pose=pose))
        picture = render([Solid(inner, GREEN, 0), Solid(outer, RED, 1)], ABOVE, 40, 40)
        drawn = picture[picture[..., 3] > 0]
        assert len(drawn) > 60
        assert np.all(drawn[:, 0] > drawn[:, 1])


def test_solids_end_in_dark_lines_and_join_without_within_a_group() -> None:
    first = box((10, 10, 2), (-5, 0, 0), RED, 0)

    def inner_line(group: int) -> float:
        picture = render([first, box((10, 10, 2), (5, 0, 0), RED, group)], ABOVE, 40, 40)
        return float(picture[20, 19:22, 0].min())

    plain = float(render([first], ABOVE, 40, 40)[20, 15, 0])
    assert inner_line(0) == pytest.approx(plain)
    assert inner_line(1) == pytest.approx(0.45 * plain)


def test_nothing_gives_an_empty_picture() -> None:
    assert not render([], ABOVE, 4, 3)[..., 3].any()
    far = render([box((1, 1, 1), (500, 0, 0), RED, 0)], ABOVE, 4, 3)
    assert far.shape == (3, 4, 4)
    assert not far[..., 3].any()


@pytest.mark.parametrize(
    "solid",
    [
        po.Box(size=(1, 2, 3), pose=po.transform((1, 2, 3), (0.1, 0.2, 0.3))),
        po.Sphere(radius=0.5, pose=po.transform((3, 0, 0))),
        po.Cylinder(radius=0.5, length=2.0),
        po.Capsule(radius=0.5, length=2.0),
    ],
)
def test_normals_point_outwards_and_faces_are_flat(solid: Any) -> None:
    corners, normals = list_faces(sample_surface(solid))
    centre = solid.pose[:3, 3]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=0, atol=1e-12)
    assert np.all(np.einsum("ij,ij->i", normals, corners.mean(axis=1) - centre) > 0)
    heights = np.einsum("ij,ikj->ik", normals, corners - corners[:, :1])
    np.testing.assert_allclose(heights, 0.0, rtol=0, atol=1e-9)


# --- Robots


def test_the_picture_stands_where_the_axes_say(tmp_path: Path, looked_at: Any) -> None:
    """The rendered picture and the axes are two layers: a small ball must lie where matplotlib projects its centre."""
    from mpl_toolkits.mplot3d import proj3d

    ball = po.Sphere(radius=0.01, pose=po.transform((0.02, -0.07, 0.05)))
    plate = po.Box(size=(0.3, 0.3, 0.01), pose=po.transform((0, 0, -0.2)))
    figure = draw_robot(arm({"base": [plate], "tool": [ball]}), tmp_path / "arm.png", resolution=100.0)
    pixels = looked_at.read_png(tmp_path / "arm.png")
    space = figure.axes[0]
    centre = 1e3 * np.array([0.3 + 0.02, 0.0 - 0.07, 0.1 + 0.05])
    x, y, _ = proj3d.proj_transform(*centre, space.get_proj())
    expected = space.transData.transform((x, y))  # pixels of the figure at its own resolution, 100 per inch
    blueness = pixels[..., 2] - pixels[..., 0]
    legend = int(0.9 * 100)
    rows, columns = np.nonzero(blueness[:-legend] > 0.3)
    middle = np.array([columns.mean() + 0.5, len(pixels) - rows.mean() - 0.5])
    np.testing.assert_allclose(middle, expected, rtol=0, atol=2.0)
    assert np.ptp(columns) == pytest.approx(np.ptp(rows), abs=2)


def test_pieces_are_the_solids_in_the_world() -> None:
    robot = po.robots.raf()
    pieces = list_pieces(robot, robot.home_configuration)
    solids = [piece for piece in pieces if not piece.line]
    assert len(solids) == sum(len(shapes) for shapes in robot.shapes.values())
    poses = robot.kinematics.poses(robot.home_configuration.X)[0]
    names = [link.name for link in robot.mechanism.links]
    tip = poses[names.index("platform")] @ [0.0, 0.0, robot.tool[1][2], 1.0]  # type: ignore[index]
    highest = max(solids, key=lambda piece: piece.points[..., 2].max())
    assert highest.kind == "platform"
    assert highest.points[..., 2].max() == pytest.approx(tip[2], abs=1e-12)


@pytest.mark.parametrize("build", [po.robots.larm_planar, po.robots.larm_spatial])
def test_cables_are_solid_lines_as_long_as_their_variables(build: Any) -> None:
    robot = build()
    configuration = robot.home_configuration
    lines = [piece for piece in list_pieces(robot, configuration) if piece.line]
    # nothing beside them: the legs that they stand for are not drawn a second time
    assert {line.kind for line in lines} == {"cable"}
    assert all(not line.dashed for line in lines)
    lengths = sorted(float(np.linalg.norm(np.diff(line.points, axis=0))) for line in lines)
    np.testing.assert_allclose(lengths, sorted(configuration.active), rtol=1e-9)
    # without them the legs are lines that an actuator moves, in the same places
    bare = [p for p in list_pieces(dataclasses.replace(robot, cables=()), configuration) if p.line]
    legs = [p.points for p in bare if p.kind == "actuator"]
    for cable in lines:
        assert any(np.allclose(cable.points, leg, rtol=0, atol=1e-9) for leg in legs)


def test_cables_are_in_the_picture_and_in_the_legend(tmp_path: Path, looked_at: Any) -> None:
    robot = po.robots.larm_spatial()
    bare = dataclasses.replace(robot, cables=[])
    with_cables, without = draw_robot(robot, tmp_path / "a.png"), draw_robot(bare, tmp_path / "b.png")
    assert "cables" in looked_at.texts(with_cables)
    assert "cables" not in looked_at.texts(without)
    pictures = [looked_at.read_png(tmp_path / name) for name in ("a.png", "b.png")]
    dark = [int(np.count_nonzero(picture.max(axis=-1) < 0.35)) for picture in pictures]
    assert dark[0] > dark[1] + 500


def test_a_cable_that_is_no_leg_is_drawn_beside_the_legs() -> None:
    hose = po.Cable(link_A="base", point_A=(0, 0, 0.5), link_B="tool", point_B=(0, 0, 0), radius=0.01, name="hose")
    robot = dataclasses.replace(arm(), cables=[hose])
    pieces = list_pieces(robot, robot.home_configuration)
    (cable,) = [p for p in pieces if p.kind == "cable"]
    np.testing.assert_allclose(cable.points, [[0, 0, 0.5], [0.3, 0, 0.1]], rtol=0, atol=1e-9)
    assert len(pieces) == len(list_pieces(arm(), robot.home_configuration)) + 1


def test_a_link_without_solids_is_a_line_and_a_tool_without_any_a_dot() -> None:
    robot = arm()
    pieces = list_pieces(robot, robot.home_configuration)
    by_kind = {piece.kind: piece for piece in pieces}
    np.testing.assert_allclose(by_kind["actuator"].points, [[0, 0, 0.1], [0.3, 0, 0.1]], rtol=0, atol=1e-9)
    np.testing.assert_allclose(by_kind["platform"].points, [[0.3, 0, 0.1]], rtol=0, atol=1e-9)


def test_kinds_follow_the_roles_of_the_variables() -> None:
    kinds = list_link_kinds(po.robots.raf().mechanism)
    assert {name for name, kind in kinds.items() if kind == "actuator"} == {"rod 1", "rod 2", "rod 3"}
    assert kinds["base"] == "base"
    assert kinds["platform"] == "platform"
    assert kinds["forearm A+"] == "robot"


def test_a_planar_robot_is_drawn_in_its_plane(looked_at: Any) -> None:
    robot = po.robots.five_bar()
    figure = draw_robot(robot)
    (axes,) = figure.axes
    assert axes.get_aspect() == 1.0
    configuration = robot.home_configuration
    tip = np.array([configuration["x"], configuration["y"]])
    dots = [line for line in axes.get_lines() if len(line.get_xdata()) == 1]
    (at_tip,) = [dot for dot in dots if dot.get_markerfacecolor() == COLORS["platform"]]
    np.testing.assert_allclose(at_tip.get_xydata()[0], tip, rtol=1e-9)
    elbow = 8.0 * np.array([np.cos(configuration["theta1"]), np.sin(configuration["theta1"])])
    assert any(np.allclose(dot.get_xydata()[0], elbow) for dot in dots)
    for word in (
        "five-bar",
        "mobility 2, 6 variables, 4 equations of rank 4",
        "x [m]",
        "y [m]",
        "links moved by an actuator",
    ):
        assert word in looked_at.texts(figure), word


def test_a_robot_in_space_tells_its_facts_and_units(looked_at: Any) -> None:
    figure = draw_robot(po.robots.raf())
    texts = looked_at.texts(figure)
    for word in ("RAF", "mobility 6 (3 idle), 32 variables, 33 equations of rank 26", "x [mm]", "z [mm]", "base"):
        assert word in texts, word


def test_another_configuration_is_drawn_when_asked() -> None:
    robot = po.robots.five_bar()
    there = robot.kinematics.inverse({"x": 5.0, "y": 6.0}, start=robot.home).configuration
    (axes,) = draw_robot(robot, configuration=there).axes
    assert any(np.allclose(line.get_xydata()[0], (5.0, 6.0)) for line in axes.get_lines() if len(line.get_xdata()) == 1)


@pytest.mark.parametrize("name", ["five_bar", "raf"])
def test_the_picture_is_the_same_every_time(name: str, tmp_path: Path) -> None:
    robot = getattr(po.robots, name)()
    for file in ("one.png", "two.png"):
        draw_robot(robot, tmp_path / file, resolution=60.0)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(po.DefinitionError, match=r"must end in \.png or \.svg"):
        draw_robot(po.robots.five_bar(), tmp_path / "robot.pdf")


def test_a_robot_that_cannot_be_assembled_is_refused() -> None:
    robot = po.robots.five_bar()
    far = po.Robot(robot.mechanism, {**robot.home, "x": 100.0})
    with pytest.raises(po.SolveError):
        draw_robot(far)


def test_kinds_have_colours_that_differ_in_greyscale() -> None:
    from matplotlib.colors import to_rgb

    grey = {kind: float(np.dot(to_rgb(color), (0.299, 0.587, 0.114))) for kind, color in COLORS.items()}
    for other in ("actuator", "robot"):  # a step of 0.15 is some 40 of 256 shades
        assert abs(grey["base"] - grey[other]) > 0.15
    assert COLORS["platform"] == style.BLUE
