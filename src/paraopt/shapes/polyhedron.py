"""Convex polyhedra: from their vertices or from their facets, with the hull that all computations need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from paraopt.errors import DefinitionError
from paraopt.shapes.base import Shape

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Hull:
    """Hold the boundary of a convex polyhedron; all arrays are read-only.

    Attributes:
        vertices: Corners [m], shape (k, 3).
        triangles: Corners of triangles that cover the boundary, counter-clockwise from outside, shape (m, 3).
        normals: Outward unit normals of the facets, shape (f, 3).
        offsets: The solid is `normals @ x <= offsets` [m], shape (f,).
        edges: Ends of the edges between different facets, as indices of corners, shape (e, 2).
        volume: Volume [m^3].
    """

    vertices: Array
    triangles: NDArray[np.intp]
    normals: Array
    offsets: Array
    edges: NDArray[np.intp]
    volume: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ConvexPolyhedron(Shape):
    """Describe the convex hull of some points.

    Attributes:
        vertices: The points in the solid's own frame [m], shape (k, 3) with k >= 4; points inside the hull are allowed.
    """

    vertices: ArrayLike

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "vertices", as_points(self.vertices, f"vertices of {self.label}"))
        _ = self.hull  # what has no hull is refused here

    @property
    def label(self) -> str:
        """Name the solid in messages."""
        return f"convex polyhedron {self.name!r}" if self.name else "convex polyhedron"

    @cached_property
    def hull(self) -> Hull:
        """Give corners, facets and edges."""
        return build_hull(np.asarray(self.vertices), self.label)

    @property
    def bounding_radius(self) -> float:
        return float(np.max(np.linalg.norm(self.hull.vertices, axis=1)))

    @classmethod
    def from_facets(
        cls, normals: ArrayLike, offsets: ArrayLike, name: str = "", pose: ArrayLike | None = None
    ) -> ConvexPolyhedron:
        """Describe the solid `n_i . x <= d_i`.

        Args:
            normals: Outward normals of the facets, of any length above zero, shape (f, 3).
            offsets: Offsets d_i [m, times the length of the normal], shape (f,).
            name: Name of the solid.
            pose: Pose of its frame, shape (4, 4); the identity when None.

        Returns:
            The polyhedron, by its vertices.

        Raises:
            DefinitionError: The facets are not finite, leave nothing, leave a flat piece, or do not bound it.
        """
        what = f"convex polyhedron {name!r}" if name else "convex polyhedron"
        N = as_points(normals, f"normals of {what}")
        d = as_numbers(offsets, f"offsets of {what}")
        if d.shape != (len(N),):
            raise DefinitionError(f"{what} has {len(N)} normals and offsets of shape {d.shape}; give one for each")
        lengths = np.linalg.norm(N, axis=1)
        if np.any(lengths == 0.0):
            raise DefinitionError(f"normal {int(np.argmin(lengths))} of {what} is zero; it must have a direction")
        vertices = _intersect(N / lengths[:, None], d / lengths, what)
        return cls(vertices=vertices, name=name, **({} if pose is None else {"pose": np.asarray(pose)}))


def build_hull(points: Array, what: str, thinnest: float = 1e-9) -> Hull:
    """Build the convex hull of points.

    Args:
        points: The points [m], shape (n, 3).
        what: Names the solid in messages.
        thinnest: Smallest thickness that is not refused as flat, over the largest extent [1].

    Returns:
        The hull.

    Raises:
        DefinitionError: The points are fewer than four, coincide, or lie in a line or a plane.
    """
    if len(points) < 4:
        raise DefinitionError(f"{what} has {len(points)} vertices; a solid needs at least 4")
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    scale = float(np.max(np.ptp(points, axis=0)))
    if scale < 1e-150:  # squares of smaller numbers vanish
        raise DefinitionError(f"{what} has an extent of {scale} m; its vertices must lie apart")
    local = (points - centre) / scale
    axes = np.linalg.svd(local - local.mean(axis=0), full_matrices=False)[2]
    thickness = float(np.min(np.ptp(local @ axes.T, axis=0)))
    if thickness < thinnest:
        raise DefinitionError(
            f"{what} is flat: {thickness * scale:.3g} m thick, {scale:.3g} m wide; it must have a volume"
        )
    try:
        found = ConvexHull(local)
    except QhullError as error:
        raise DefinitionError(f"{what} has no hull of some volume: {str(error).splitlines()[0]}") from error
    number = np.full(len(points), -1)
    number[found.vertices] = np.arange(len(found.vertices))
    corners = local[found.vertices]
    triangles = number[found.simplices]
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    facet_of, equations = _merge_facets(found.equations)
    normals = equations[:, :3]
    # the facet's plane touches the farthest corner, whatever the rounding inside Qhull
    offsets = np.max(corners @ normals.T, axis=0)
    vertices = points[found.vertices]
    hull = Hull(
        vertices.copy(),
        triangles,
        np.ascontiguousarray(normals),
        offsets * scale + normals @ centre,
        _list_edges(triangles, facet_of),
        float(found.volume) * scale**3,
    )
    for array in (hull.vertices, hull.triangles, hull.normals, hull.offsets, hull.edges):
        array.flags.writeable = False
    return hull


def _merge_facets(equations: Array, tolerance: float = 1e-9) -> tuple[NDArray[np.intp], Array]:
    """Number the planes of triangles, those that lie in one plane alike."""
    facet_of = np.full(len(equations), -1)
    kept: list[Array] = []
    for i in range(len(equations)):
        if facet_of[i] < 0:
            same = (facet_of < 0) & np.all(np.abs(equations - equations[i]) < tolerance, axis=1)
            facet_of[same] = len(kept)
            kept.append(equations[i])
    return facet_of, np.array(kept)


def _list_edges(triangles: NDArray[np.intp], facet_of: NDArray[np.intp]) -> NDArray[np.intp]:
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    facets = np.tile(facet_of, 3)
    pairs, where = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    where = where.ravel()
    low, high = np.full(len(pairs), len(facet_of)), np.full(len(pairs), -1)
    np.minimum.at(low, where, facets)
    np.maximum.at(high, where, facets)
    return np.ascontiguousarray(pairs[low != high])


def _intersect(N: Array, d: Array, what: str) -> Array:
    """Find the corners of `N x <= d`, unit normals."""
    free = [(None, None)] * 3
    for axis in range(3):
        for sign in (1.0, -1.0):
            reach = linprog(-sign * np.eye(3)[axis], A_ub=N, b_ub=d, bounds=free, method="highs")
            if reach.status == 2:
                raise DefinitionError(f"{what} is empty: no point satisfies all {len(N)} facets")
            if reach.status != 0:
                side = f"{'+' if sign > 0 else '-'}{'xyz'[axis]}"
                raise DefinitionError(f"{what} is unbounded towards {side}; its facets must close it")
    # the centre and radius of the largest ball inside
    inner = linprog(
        (0.0, 0.0, 0.0, -1.0), A_ub=np.column_stack([N, np.ones(len(N))]), b_ub=d, bounds=[*free, (0, None)],
        method="highs",
    )  # fmt: skip
    if inner.status != 0 or not inner.x[3] > 1e-12 * max(1.0, float(np.max(np.abs(d)))):
        raise DefinitionError(f"{what} is flat: its facets leave no ball inside; it must have a volume")
    try:
        corners = HalfspaceIntersection(np.column_stack([N, -d]), inner.x[:3]).intersections
    except QhullError as error:
        raise DefinitionError(f"{what} has no corners: {str(error).splitlines()[0]}") from error
    if not np.all(np.isfinite(corners)):
        raise DefinitionError(f"{what} is unbounded; its facets must close it")
    # several facets through one corner give it several times
    scale = float(np.max(np.ptp(corners, axis=0)))
    _, first = np.unique(np.round(corners / (1e-10 * scale)), axis=0, return_index=True)
    return np.asarray(corners[np.sort(first)], dtype=float)


def as_points(values: Any, what: str) -> Array:
    """Copy points into a read-only array of finite floats, shape (k, 3).

    Raises:
        DefinitionError: The shape is another, or an entry is not a finite number below 1e150.
    """
    points = as_numbers(values, what)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise DefinitionError(f"{what} are of shape {points.shape}; it must be (k, 3)")
    points.flags.writeable = False
    return points


def as_numbers(values: Any, what: str) -> Array:
    """Copy values into an array of finite floats of any shape.

    Raises:
        DefinitionError: An entry is not a finite number below 1e150.
    """
    try:
        if np.iscomplexobj(values):
            raise TypeError("complex numbers have no place here")
        numbers = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} are {values!r:.60}; they must be numbers") from error
    bad = np.argwhere(~(np.abs(numbers) < 1e150))  # squares of larger numbers overflow; catches NaN, too
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        raise DefinitionError(f"{what}: entry {index} is {numbers[index]}; every entry must be finite and below 1e150")
    return numbers
