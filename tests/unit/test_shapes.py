"""Bodies: sizes and poses that are refused, placement between points, and bounds that contain them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.shapes import (
    Cone,
    ConvexPolyhedron,
    DecomposeOptions,
    HalfSpace,
    Mesh,
    Shape,
    decompose,
    decompose_mesh,
    load_mesh,
)

CORNERS = np.array(np.meshgrid(*[(0.0, 1.0)] * 3, indexing="ij")).reshape(3, -1).T
TRIANGLES = np.array(
    [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
     (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)]
)  # fmt: skip

KINDS: dict[str, Callable[..., Shape]] = {
    "box": lambda **o: po.Box(size=(0.1, 0.2, 0.3), **o),
    "sphere": lambda **o: po.Sphere(radius=0.1, **o),
    "cylinder": lambda **o: po.Cylinder(radius=0.1, length=0.5, **o),
    "capsule": lambda **o: po.Capsule(radius=0.1, length=0.5, **o),
    "cone": lambda **o: Cone(radius=0.1, length=0.5, **o),
    "half-space": lambda **o: HalfSpace(**o),
    "convex polyhedron": lambda **o: ConvexPolyhedron(vertices=CORNERS, **o),
    "mesh": lambda **o: Mesh(vertices=CORNERS, triangles=TRIANGLES, **o),
}
BAD_NUMBERS = [0, 0.0, -0.1, np.nan, np.inf, -np.inf, "wide", None, [1.0]]


@pytest.mark.parametrize("value", BAD_NUMBERS)
@pytest.mark.parametrize(
    ("build", "quantity"),
    [
        (lambda v: po.Sphere(radius=v, name="ball"), "radius of sphere 'ball'"),
        (lambda v: po.Cylinder(radius=v, length=1.0, name="rod"), "radius of cylinder 'rod'"),
        (lambda v: po.Cylinder(radius=1.0, length=v, name="rod"), "length of cylinder 'rod'"),
        (lambda v: po.Capsule(radius=v, length=1.0), "radius of capsule"),
        (lambda v: po.Capsule(radius=1.0, length=v), "length of capsule"),
        (lambda v: Cone(radius=v, length=1.0, name="tip"), "radius of cone 'tip'"),
        (lambda v: Cone(radius=1.0, length=v, name="tip"), "length of cone 'tip'"),
        (lambda v: po.Box(size=(1.0, v, 1.0), name="crate"), "(size|side) of box 'crate'"),
        (lambda v: po.Cylinder.between((0, 0, 0), (0, 0, 1), v, name="rod"), "radius of cylinder 'rod'"),
        (lambda v: po.Capsule.between((0, 0, 0), (0, 0, 1), v, name="rod"), "radius of capsule 'rod'"),
    ],
)
def test_bad_sizes_are_refused_by_name(build: Callable[[Any], Shape], quantity: str, value: Any) -> None:
    with pytest.raises(po.DefinitionError, match=quantity):
        build(value)


@pytest.mark.parametrize("size", [(1, 2), (1, 2, 3, 4), 1.0, "box", None])
def test_a_box_has_three_sides(size: Any) -> None:
    with pytest.raises(po.DefinitionError, match="size of box 'crate'"):
        po.Box(size=size, name="crate")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "pose",
    [np.eye(3), np.full((4, 4), np.nan), 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]), (0, 0, 1), None],
    ids=["3 x 3", "nan", "stretched", "mirrored", "point", "none"],
)
def test_bad_poses_are_refused_by_name(kind: str, pose: Any) -> None:
    with pytest.raises(po.DefinitionError, match=f"pose of {kind} 'thing'"):
        KINDS[kind](name="thing", pose=pose)


@pytest.mark.parametrize("kind", KINDS)
def test_shapes_are_frozen_and_copy_their_pose(kind: str) -> None:
    pose = po.transform((1, 2, 3))
    shape = KINDS[kind](pose=pose)
    pose[0, 3] = 9.0
    assert shape.pose[0, 3] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        shape.pose[0, 3] = 5.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        shape.name = "other"  # type: ignore[misc]
    assert_allclose(KINDS[kind]().pose, np.eye(4), atol=0)


def test_sizes_are_kept_as_floats() -> None:
    assert (po.Cylinder(radius=1, length=np.float32(2)).radius, po.Sphere(radius=np.int64(3)).radius) == (1.0, 3.0)
    size = np.array([1.0, 2.0, 3.0])
    box = po.Box(size=size)
    size[0] = 9.0
    assert_allclose(box.size, (1, 2, 3), atol=0)


@pytest.mark.parametrize("kind", [po.Cylinder, po.Capsule, Cone])
@pytest.mark.parametrize(
    ("first", "second"),
    [((0, 0, 0), (0, 0, 1)), ((0, 0, 1), (0, 0, 0)), ((1, 2, 3), (1, 5, 7)), ((-0.1, 0.2, 0), (0.3, -0.2, 0.5))],
)
def test_between_two_points(kind: Any, first: Any, second: Any) -> None:
    shape = kind.between(first, second, radius=0.05, name="rod")
    assert shape.length == pytest.approx(np.linalg.norm(np.subtract(second, first)), rel=1e-15)
    ends = shape.pose @ np.array([[0, 0], [0, 0], [-0.5, 0.5], [0, 0]]) * shape.length
    assert_allclose(shape.pose[:3, 3] + ends[:3].T, [first, second], atol=1e-14)  # a few roundings of 7
    assert (shape.radius, shape.name) == (0.05, "rod")


@pytest.mark.parametrize("kind", [po.Cylinder, po.Capsule, Cone])
def test_between_one_point_and_itself_is_refused(kind: Any) -> None:
    with pytest.raises(po.DefinitionError, match="zero length"):
        kind.between((1, 2, 3), (1, 2, 3), radius=0.1)
    with pytest.raises(po.DefinitionError, match="segment end"):
        kind.between((1, 2, np.nan), (1, 2, 3), radius=0.1)


def test_bounding_radius_reaches_the_farthest_point() -> None:
    assert po.Box(size=(2, 4, 4)).bounding_radius == pytest.approx(3.0, rel=1e-15)
    assert po.Sphere(radius=0.3).bounding_radius == 0.3
    assert po.Cylinder(radius=3, length=8).bounding_radius == pytest.approx(5.0, rel=1e-15)
    assert po.Capsule(radius=3, length=8).bounding_radius == 7.0
    assert Cone(radius=3, length=8).bounding_radius == pytest.approx(5.0, rel=1e-15)
    assert HalfSpace().bounding_radius == np.inf
    assert ConvexPolyhedron(vertices=CORNERS).bounding_radius == pytest.approx(np.sqrt(3), rel=1e-15)
    assert Mesh(vertices=CORNERS, triangles=TRIANGLES).bounding_radius == pytest.approx(np.sqrt(3), rel=1e-15)


def test_a_bare_shape_has_no_size() -> None:
    with pytest.raises(po.DefinitionError, match="shape 'thing': a bare Shape has no size"):
        _ = Shape(name="thing").bounding_radius


def test_labels_name_the_solid() -> None:
    assert po.Sphere(radius=1).label == "sphere"
    assert po.Sphere(radius=1, name="ball").label == "sphere 'ball'"


# --- Half-spaces


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -2), (1, 2, 3), (1e-200, 0, 0)])
def test_a_half_space_lies_behind_its_plane(normal: tuple[float, ...]) -> None:
    plane = HalfSpace.behind((1, 2, 3), normal, name="wall")
    assert_allclose(plane.pose[:3, 3], (1, 2, 3), atol=0)
    large = np.array(normal) / np.max(np.abs(normal))
    assert_allclose(plane.pose[:3, 2], large / np.linalg.norm(large), atol=1e-15)
    assert (plane.name, plane.label) == ("wall", "half-space 'wall'")


@pytest.mark.parametrize(("point", "normal"), [((0, 0, 0), (0, 0, 0)), ((0, np.nan, 0), (0, 0, 1)), ((0, 0), (0, 1))])
def test_planes_without_a_direction_are_refused(point: Any, normal: Any) -> None:
    with pytest.raises(po.DefinitionError, match=r"(normal|point) of"):
        HalfSpace.behind(point, normal)


# --- Convex polyhedra


def test_a_cube_has_its_corners_facets_and_edges() -> None:
    inner = np.vstack([CORNERS, [(0.5, 0.5, 0.5), (1.0, 0.5, 0.5)]])  # inside, and on a face
    cube = ConvexPolyhedron(vertices=inner, name="cube")
    hull = cube.hull
    assert (len(hull.vertices), len(hull.normals), len(hull.edges)) == (8, 6, 12)
    assert hull.volume == pytest.approx(1.0, rel=1e-12)
    assert_allclose(np.sort(np.abs(hull.normals), axis=1), np.tile((0, 0, 1), (6, 1)), atol=1e-12)
    assert_allclose(np.diff(hull.vertices[hull.edges], axis=1)[:, 0] ** 2 @ np.ones(3), 1.0, atol=1e-12)
    a, b, c = (hull.vertices[hull.triangles[:, k]] for k in range(3))
    outwards = np.cross(b - a, c - a)
    assert np.all(np.einsum("ij,ij->i", outwards, a - 0.5) > 0)
    assert 0.5 * np.linalg.norm(outwards, axis=1).sum() == pytest.approx(6.0, rel=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        hull.normals[0, 0] = 3.0
    assert dataclasses.replace(cube, name="other").hull.volume == hull.volume


@pytest.mark.parametrize("seed", range(8))
def test_vertices_and_facets_tell_the_same_solid(seed: int) -> None:
    random = np.random.default_rng(seed)
    size = 10.0 ** random.uniform(-4, 4)
    one = ConvexPolyhedron(vertices=size * (random.normal(size=(random.integers(4, 25), 3)) + random.normal(size=3)))
    scales = random.uniform(0.1, 10, len(one.hull.normals))
    other = ConvexPolyhedron.from_facets(one.hull.normals * scales[:, None], one.hull.offsets * scales, name="same")
    assert other.hull.volume == pytest.approx(one.hull.volume, rel=1e-9)
    for vertex in one.hull.vertices:
        assert np.min(np.linalg.norm(other.hull.vertices - vertex, axis=1)) < 1e-9 * size
    # Euler's formula, with facets that are merged
    assert len(one.hull.vertices) - len(one.hull.edges) + len(one.hull.normals) == 2


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (CORNERS[:3], "convex polyhedron 'stone' has 3 vertices; a solid needs at least 4"),
        (CORNERS * (1, 1, 0), "'stone' is flat: 0 m thick, 1 m wide"),
        (CORNERS * (1, 1, 1e-12), "'stone' is flat: 1e-12 m thick"),
        (CORNERS * (1, 0, 0), "'stone' is flat"),
        (np.zeros((5, 3)), "'stone' has an extent of 0.0 m"),
        (np.where(CORNERS == 1, np.nan, 0), "vertices of convex polyhedron 'stone': entry .* is nan"),
        (CORNERS * 1e200, "every entry must be finite and below 1e150"),
        (np.where(CORNERS == 1, np.inf, 0), "vertices of convex polyhedron 'stone'"),
        (CORNERS[:, :2], r"are of shape \(8, 2\); it must be \(k, 3\)"),
        ("stone", "must be numbers"),
        (1j * CORNERS, "must be numbers"),
        (None, "vertices of convex polyhedron 'stone'"),
    ],
)
def test_vertices_without_a_volume_are_refused(vertices: Any, message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        ConvexPolyhedron(vertices=vertices, name="stone")


SIDES = np.vstack([np.eye(3), -np.eye(3)])


@pytest.mark.parametrize(
    ("normals", "offsets", "message"),
    [
        (SIDES[:5], np.ones(5), r"'stone' is unbounded towards -z"),
        (SIDES[:3], np.ones(3), r"'stone' is unbounded towards -"),
        (SIDES, -np.ones(6), "'stone' is empty: no point satisfies all 6 facets"),
        (SIDES, np.array([1, 1, 1, 1, 1, -1.0]), "'stone' is flat: its facets leave no ball"),
        (SIDES * 0, np.ones(6), "normal 0 of convex polyhedron 'stone' is zero"),
        (SIDES, np.ones(5), r"has 6 normals and offsets of shape \(5,\)"),
        (SIDES, np.full(6, np.nan), "offsets of convex polyhedron 'stone'"),
        (SIDES * np.nan, np.ones(6), "normals of convex polyhedron 'stone'"),
    ],
)
def test_facets_that_do_not_bound_a_solid_are_refused(normals: Any, offsets: Any, message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        ConvexPolyhedron.from_facets(normals, offsets, name="stone")


# --- Meshes


def bracket() -> tuple[np.ndarray, np.ndarray]:
    """Give an L: an outline in x and z, drawn out along y; it fills 0.36 x 0.5 of a hull of 0.68 x 0.5."""
    outline = np.array([(0, 0), (1, 0), (1, 0.2), (0.2, 0.2), (0.2, 1), (0, 1)])
    vertices = np.array([(x, y, z) for y in (0.0, 0.5) for x, z in outline])
    front = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    sides = [(k, k + 6, (k + 1) % 6 + 6) for k in range(6)] + [(k, (k + 1) % 6 + 6, (k + 1) % 6) for k in range(6)]
    return vertices, np.array(front + [(a + 6, c + 6, b + 6) for a, b, c in front] + sides)


def test_a_convex_mesh_is_its_own_part() -> None:
    mesh = Mesh(vertices=CORNERS, triangles=TRIANGLES, name="cube")
    assert mesh.parts == ()
    assert [solid.hull.volume for solid in mesh.solids] == [pytest.approx(1.0, rel=1e-12)]
    assert mesh.departure < 1e-15
    # whichever side is called the outside
    assert len(Mesh(vertices=CORNERS, triangles=TRIANGLES[:, ::-1]).solids) == 1
    assert decompose_mesh(CORNERS, TRIANGLES, "cube").parts == ()


@pytest.mark.parametrize(
    ("vertices", "triangles", "parts", "message"),
    [
        (*bracket(), (), "mesh 'L' is not convex: it fills 0.529412 of its hull"),
        (*bracket(), [bracket()[0][:4]], r"part 1. is flat"),
        (*bracket(), [CORNERS * (1, 0.5, 0.2)], "leave out some of it: a point sticks out by 0.8 m"),
        (CORNERS, TRIANGLES[1:], (), "is not closed: the side between vertices 0 and [123] belongs to 1 triangle;"),
        (CORNERS, np.vstack([TRIANGLES[:1, ::-1], TRIANGLES[1:]]), (), "turned the same way"),
        (CORNERS, [(0, 1, 8)], (), "triangle 0 of mesh 'L' is .*numbers from 0 to 7"),
        (CORNERS, [(0, 1, 1)], (), "its corners must differ"),
        (CORNERS, [(0, 1, 1.5)], (), "numbers from 0 to 7"),
        (CORNERS, [(0, 1)], (), r"of shape \(1, 2\)"),
        (CORNERS, "cube", (), "must be whole numbers"),
        (CORNERS, [], (), "of shape"),
        (CORNERS * np.nan, TRIANGLES, (), "vertices of mesh 'L'"),
        (CORNERS * (1, 1, 0), TRIANGLES, (), "mesh 'L' is flat"),
        (CORNERS, TRIANGLES, 3, "parts of mesh 'L'"),
        (CORNERS, TRIANGLES, [CORNERS * np.nan], "part 1 of mesh 'L'"),
    ],
)
def test_meshes_without_a_volume_or_parts_are_refused(vertices: Any, triangles: Any, parts: Any, message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        Mesh(vertices=vertices, triangles=triangles, parts=parts, name="L")


def test_a_mesh_that_is_not_convex_is_cut_into_parts_that_cover_it() -> None:
    pytest.importorskip("coacd")
    vertices, triangles = bracket()
    pose = po.transform((1, 2, 3))
    mesh = decompose_mesh(0.01 * vertices + 5.0, triangles, "L", pose)
    assert len(mesh.parts) >= 2
    assert mesh.departure < 1e-12
    assert_allclose(mesh.pose, pose, atol=0)
    # the parts fill the L, 0.18, and little more: less than an eighth of the hollow, which is 0.16
    assert 0.18e-6 * (1 - 1e-9) < sum(solid.hull.volume for solid in mesh.solids) < 0.2e-6
    assert len(decompose_mesh(vertices, triangles, options=DecomposeOptions(most_parts=1)).parts) == 1
    again = decompose_mesh(0.01 * vertices + 5.0, triangles, "L", pose)
    assert all(np.array_equal(a, b) for a, b in zip(mesh.parts, again.parts, strict=True))


@pytest.mark.parametrize("suffix", [".stl", ".obj"])
def test_meshes_are_read_from_files(suffix: str, tmp_path: Any) -> None:
    trimesh, _ = pytest.importorskip("trimesh"), pytest.importorskip("coacd")
    vertices, triangles = bracket()
    trimesh.Trimesh(1e3 * vertices, triangles).export(tmp_path / f"bracket{suffix}")
    mesh = load_mesh(tmp_path / f"bracket{suffix}", scale=1e-3)
    assert (mesh.name, np.shape(mesh.vertices), np.shape(mesh.triangles)) == ("bracket", (12, 3), (20, 3))
    assert_allclose(np.ptp(mesh.vertices, axis=0), (1, 0.5, 1), atol=1e-6)
    with pytest.raises(po.DefinitionError, match=r"nothing.stl: there is no such file"):
        load_mesh(tmp_path / "nothing.stl")
    with pytest.raises(po.DefinitionError, match="scale of"):
        load_mesh(tmp_path / f"bracket{suffix}", scale=0.0)
    (tmp_path / "junk.stl").write_text("junk", encoding="utf-8")
    with pytest.raises(po.DefinitionError, match=r"junk.stl"):
        load_mesh(tmp_path / "junk.stl")


def test_missing_libraries_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    def missing(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(decompose.importlib, "import_module", missing)
    with pytest.raises(po.MissingBackendError, match=r"'coacd', which is not installed: pip install 'paraopt\[mesh\]'"):
        decompose_mesh(*bracket())
    with pytest.raises(po.MissingBackendError, match="'trimesh'"):
        load_mesh(tmp_path / "any.stl")


@pytest.mark.parametrize("options", [{"concavity": 0.0}, {"concavity": np.nan}, {"most_parts": 0}, {"most_parts": 1.5}])
def test_bad_options_of_cutting_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(po.DefinitionError):
        DecomposeOptions(**options)
