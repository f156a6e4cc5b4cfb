"""Distances by formula where coal's own routine is wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
