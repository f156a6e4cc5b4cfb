"""The one door to mesh libraries: convex parts by coacd, files by trimesh; both come with the extra `mesh`."""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import BackendError, DefinitionError, MissingBackendError
from paraopt.shapes.mesh import Mesh, as_triangles, check_closed, check_convex, list_surface_points, outside_of
from paraopt.shapes.polyhedron import ConvexPolyhedron, as_points

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DecomposeOptions:
    """Choose how finely a mesh is cut into convex parts.

    Attributes:
        concavity: Depth of a hollow that need not be cut out, over the extent of the mesh [1]; the parts fill it.
        most_parts: Largest number of parts; no bound when None.
        seed: Seed of the search for cuts.

    Raises:
        DefinitionError: The concavity is not in [0.01, 1], or the number of parts is below 1.
    """

    concavity: float = 0.05
    most_parts: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.01 <= self.concavity <= 1.0:
            raise DefinitionError(f"concavity is {self.concavity!r}; it must be from 0.01 to 1")
        if self.most_parts is not None and not (isinstance(self.most_parts, int) and self.most_parts >= 1):
            raise DefinitionError(f"most_parts is {self.most_parts!r}; it must be a whole number above 0, or None")


def decompose_mesh(
    vertices: ArrayLike,
    triangles: ArrayLike,
    name: str = "",
    pose: ArrayLike | None = None,
    options: DecomposeOptions | None = None,
) -> Mesh:
    """Find convex parts that cover a closed mesh; a convex one is its own part and needs no library.

    The library cuts with small gaps: points of the mesh that it leaves outside are added to the nearest part, so that
    the parts are rather too large than too small.

    Args:
        vertices: Corners [m], shape (k, 3).
        triangles: Corners of each triangle, counter-clockwise from outside, shape (m, 3).
        name: Name of the solid.
        pose: Its pose in the frame that carries it, shape (4, 4); the identity when None.
        options: How finely it is cut.

    Returns:
        The mesh with its parts.

    Raises:
        DefinitionError: The mesh is not closed, or not finite.
        MissingBackendError: The mesh is not convex and coacd is not installed.
        BackendError: coacd failed.
    """
    what = f"mesh {name!r}" if name else "mesh"
    points = as_points(vertices, f"vertices of {what}")
    corners = as_triangles(triangles, len(points), what)
    check_closed(corners, what)
    placed: dict[str, Any] = {"name": name, **({} if pose is None else {"pose": np.asarray(pose)})}
    try:
        check_convex(points, corners, what)
    except DefinitionError:
        parts = _cut(points, corners, what, options or DecomposeOptions())
        return Mesh(vertices=points, triangles=corners, parts=_cover(points, corners, parts), **placed)
    return Mesh(vertices=points, triangles=corners, **placed)


def load_mesh(
    path: str | os.PathLike[str],
    scale: float = 1.0,
    name: str = "",
    pose: ArrayLike | None = None,
    options: DecomposeOptions | None = None,
) -> Mesh:
    """Read a mesh from an STL, OBJ or other file and find its convex parts.

    Args:
        path: The file.
        scale: Metres per unit of the file, 1e-3 where it holds millimetres.
        name: Name of the solid; that of the file, without its ending, when empty.
        pose: Its pose in the frame that carries it, shape (4, 4); the identity when None.
        options: How finely it is cut.

    Returns:
        The mesh with its parts.

    Raises:
        DefinitionError: The file cannot be read, or its mesh is not closed.
        MissingBackendError: trimesh, or coacd for a mesh that is not convex, is not installed.
    """
    file = Path(path)
    trimesh = _import("trimesh")
    if not (np.isfinite(scale) and scale > 0):
        raise DefinitionError(f"scale of {file.name} is {scale!r}; it must be finite and above 0")
    if not file.is_file():
        raise DefinitionError(f"{file.name}: there is no such file")
    try:
        read = trimesh.load(file, force="mesh")
        read.merge_vertices()
        vertices, triangles = np.asarray(read.vertices, dtype=float), np.asarray(read.faces)
    except Exception as error:  # the readers of a dozen formats raise what they like
        raise DefinitionError(f"{file.name} cannot be read as a mesh: {error}") from error
    if not len(triangles):
        raise DefinitionError(f"{file.name} cannot be read as a mesh: it holds no triangle")
    return decompose_mesh(scale * vertices, triangles, name or file.stem, pose, options)


def _cut(points: Array, triangles: NDArray[np.intp], what: str, options: DecomposeOptions) -> list[Array]:
    coacd = _import("coacd")
    # its thresholds are in part absolute: it is given a mesh of extent 2 about the origin
    centre, half = 0.5 * (points.min(axis=0) + points.max(axis=0)), 0.5 * float(np.max(np.ptp(points, axis=0)))
    try:
        coacd.set_log_level("off")
        found = coacd.run_coacd(
            coacd.Mesh((points - centre) / half, np.asarray(triangles)),
            threshold=options.concavity,
            max_convex_hull=-1 if options.most_parts is None else options.most_parts,
            seed=options.seed,
        )
    except Exception as error:
        raise BackendError(f"coacd failed on {what}: {error}") from error
    if not found:
        raise BackendError(f"coacd found no convex part of {what}")
    return [centre + half * np.asarray(part[0], dtype=float) for part in found]


def _cover(points: Array, triangles: NDArray[np.intp], parts: list[Array]) -> list[Array]:
    """Add the points of the mesh that lie outside all parts to the nearest one."""
    surface = list_surface_points(points, triangles)
    out = outside_of(surface, [ConvexPolyhedron(vertices=part) for part in parts])
    missed, nearest = out.min(axis=1) > 0.0, out.argmin(axis=1)
    grown = [np.vstack([part, surface[missed & (nearest == k)]]) for k, part in enumerate(parts)]
    return [ConvexPolyhedron(vertices=part).hull.vertices for part in grown]


def _import(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingBackendError(
            f"meshes need {name!r}, which is not installed: pip install 'paraopt[mesh]'"
        ) from error
