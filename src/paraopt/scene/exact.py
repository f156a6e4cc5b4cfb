"""Distances by formula: where coal's own routine is wrong, and where segments with a radius meet in whole batches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from paraopt.scene.segments import nearest_of_segments

Array = NDArray[np.float64]


def measure_point_and_cylinder(points: Array, radius: Array, half: Array) -> tuple[Array, Array, Array]:
    """Measure points from the surface of upright cylinders, inside as outside.

    Args:
        points: Points in the cylinders' own frames, whose z axis is the cylinder's [m], shape (n, 3).
        radius: Radii of the cylinders [m], shape (n,).
        half: Half their lengths [m], shape (n,).

    Returns:
        Signed distances [m], shape (n,), negative inside; nearest points of the surfaces [m], shape (n, 3); outward
        unit normals there, shape (n, 3).
    """
    across, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    outward = np.zeros_like(points)
    outward[:, 0] = 1.0  # on the axis any direction is as near
    off = across > 0.0
    outward[off, :2] = points[off, :2] / across[off, None]
    along = np.zeros_like(points)
    along[:, 2] = np.where(z < 0.0, -1.0, 1.0)
    side, end = across - radius, np.abs(z) - half
    # outside: the nearest point is that of the solid; inside: that of the nearer face
    gap = np.maximum(side, 0.0)[:, None] * outward + np.maximum(end, 0.0)[:, None] * along
    distance = np.linalg.norm(gap, axis=1)
    inside = distance == 0.0
    normal = np.where((side > end)[:, None], outward, along)
    normal[~inside] = gap[~inside] / distance[~inside, None]
    distance[inside] = np.maximum(side, end)[inside]
    return distance, points - distance[:, None] * normal, normal


def pose_segments(ends: Array, along: Array) -> Array:
    """Give poses in the middle of segments, their z axis along them.

    Args:
        ends: Ends of the segments [m], shape (..., 2, 3).
        along: Vectors along them, which a segment of no length lacks, shape (..., 3); where zero, z is the world's.

    Returns:
        Poses, shape (..., 4, 4).
    """
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    z = np.where(length > 0.0, along / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    x = find_perpendicular(z)
    X = np.zeros((*z.shape[:-1], 4, 4))
    X[..., :3, 0], X[..., :3, 1], X[..., :3, 2] = x, np.cross(z, x), z
    X[..., :3, 3] = ends.mean(axis=-2)
    X[..., 3, 3] = 1.0
    return X


def find_perpendicular(z: Array) -> Array:
    """Give a unit vector normal to each of some unit vectors, shape (..., 3)."""
    helper = np.eye(3)[np.argmin(np.abs(z), axis=-1)]
    x = np.cross(helper, z)
    return np.asarray(x / np.linalg.norm(x, axis=-1, keepdims=True))


def part_cores(points: Array, normals: Array, radii: Array, axes: Array) -> None:
    """Give a direction to balls and capsules whose cores (centres, axes) meet, where coal has none or a wrong one.

    Any direction normal to both axes parts them by the same, shortest way.

    Args:
        points: Witness points [m], shape (k, 2, 3); corrected in place.
        normals: Normals, zero or a unit vector, shape (k, 3); corrected in place.
        radii: Radii of both bodies [m], shape (k, 2).
        axes: Unit vectors along both, zero for balls, shape (k, 2, 3).
    """
    middle = points[:, 0] - radii[:, :1] * normals
    across = np.cross(axes[:, 0], axes[:, 1])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    one = np.where(np.any(axes[:, 0] != 0.0, axis=1)[:, None], axes[:, 0], axes[:, 1])
    one[~np.any(one != 0.0, axis=1)] = (0.0, 0.0, 1.0)
    normals[:] = np.where(size > 1e-9, across / np.maximum(size, 1e-300), find_perpendicular(one))
    points[:] = middle[:, None] + np.stack([radii[:, :1] * normals, -radii[:, 1:] * normals], axis=1)


def measure_cores(P: Array, Q: Array, radii: Array, met: float = 1e-12) -> tuple[Array, Array, Array]:
    """Measure segments with a radius (cables, capsules, balls) from each other.

    Args:
        P: Ends of the first segments [m], shape (k, 2, 3).
        Q: Ends of the second segments [m], shape (k, 2, 3).
        radii: Radii of both [m], shape (k, 2).
        met: Distance of the segments up to which they cross and the normal is one across both [m].

    Returns:
        Signed distances [m], shape (k,); nearest points of the surfaces [m], shape (k, 2, 3); unit normals from the
        first to the second, shape (k, 3).
    """
    u, v = P[:, 1] - P[:, 0], Q[:, 1] - Q[:, 0]
    one, other = nearest_of_segments(P[:, 0], u, Q[:, 0], v)
    gap = other - one
    distance = np.linalg.norm(gap, axis=1)
    apart = (distance > met)[:, None]
    normal = np.where(apart, gap / np.maximum(distance, met)[:, None], 0.0)
    points = np.stack([one + radii[:, :1] * normal, other - radii[:, 1:] * normal], axis=1)
    crossed = np.flatnonzero(~apart)
    if crossed.size:
        axes = np.stack([u[crossed], v[crossed]], axis=1)
        axes /= np.maximum(np.linalg.norm(axes, axis=2, keepdims=True), 1e-300)
        way, out = points[crossed], normal[crossed]
        part_cores(way, out, radii[crossed], axes)
        points[crossed], normal[crossed] = way, out
    return distance - radii.sum(axis=1), points, normal


def measure_segments_and_planes(ends: Array, planes: Array, radii: Array) -> tuple[Array, Array, Array]:
    """Measure segments with a radius from half-spaces: the lower end counts.

    Args:
        ends: Ends of the segments [m], shape (k, 2, 3).
        planes: Poses of the half-spaces, which fill `z <= 0` of their own frames, shape (k, 4, 4).
        radii: Radii of the segments [m], shape (k,).

    Returns:
        Signed distances [m], shape (k,); nearest points of the half-space and of the segment [m], shape (k, 2, 3); unit
        normals from the half-space to the segment, shape (k, 3).
    """
    out = planes[:, :3, 2].copy()
    heights = np.einsum("ki,kei->ke", out, ends - planes[:, None, :3, 3])
    rows, lower = np.arange(len(ends)), np.argmin(heights, axis=1)
    end, height = ends[rows, lower], heights[rows, lower]
    points = np.stack([end - height[:, None] * out, end - radii[:, None] * out], axis=1)
    return height - radii, points, out
