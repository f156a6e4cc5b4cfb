"""Broad phase: every solid in a capsule, and the distance between capsules as a lower bound, for whole batches."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics import CompiledFunction
from paraopt.shapes import Box, Capsule, Cone, ConvexPolyhedron, Cylinder, HalfSpace, Mesh, Shape, Sphere

Array = NDArray[np.float64]
_TINY = 1e-300


def enclose(shape: Shape) -> tuple[Array, float]:
    """Enclose a solid in a capsule.

    Args:
        shape: The solid; of a half-space, which nothing encloses, its plane's origin is given with radius 0.

    Returns:
        Ends of the capsule's segment in the solid's own frame [m], shape (2, 3), and its radius [m].

    Raises:
        DefinitionError: The solid is of an unknown kind.
    """
    if isinstance(shape, ConvexPolyhedron):
        return enclose_points(shape.hull.vertices)
    if isinstance(shape, Mesh):
        return enclose_points(np.vstack([solid.hull.vertices for solid in shape.solids]))
    axis, low, high, radius = 2, 0.0, 0.0, 0.0
    if isinstance(shape, Capsule):
        low, high, radius = -0.5 * shape.length, 0.5 * shape.length, shape.radius
    elif isinstance(shape, Cylinder):
        low, high, radius = -0.5 * shape.length, 0.5 * shape.length, shape.radius
        # the flat ends stick out of the round ones at the rim, unless the segment reaches the ends and the radius grows
        if high <= radius:
            low, high, radius = 0.0, 0.0, float(np.hypot(high, radius))
    elif isinstance(shape, Cone):
        # the round end about the base holds the rim, the other one only has to hold the apex
        low, radius = -0.5 * shape.length, shape.radius
        high = max(low, 0.5 * shape.length - radius)
    elif isinstance(shape, Box):
        size = 0.5 * np.asarray(shape.size)
        axis = int(np.argmax(size))
        low, high, radius = -float(size[axis]), float(size[axis]), float(np.linalg.norm(np.delete(size, axis)))
    elif isinstance(shape, Sphere):
        radius = shape.radius
    elif not isinstance(shape, HalfSpace):
        raise DefinitionError(f"{shape.label} cannot be checked for collision; nothing is known of its size")
    ends = np.zeros((2, 3))
    ends[:, axis] = low, high
    return ends, radius


def enclose_points(points: Array) -> tuple[Array, float]:
    """Enclose points (n, 3) in a capsule along the direction in which they spread most; ends and radius as above."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    axes = np.linalg.svd(points - centre, full_matrices=False)[2]
    local = (points - centre) @ axes.T
    # the axis runs through the middle of what is seen along it
    middle = 0.5 * (local[:, 1:].min(axis=0) + local[:, 1:].max(axis=0))
    across = np.linalg.norm(local[:, 1:] - middle, axis=1)
    radius = float(across.max()) * (1.0 + 1e-12)
    # a point off the axis lets the round end begin before it
    share = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    low, high = float(np.min(local[:, 0] + share)), float(np.max(local[:, 0] - share))
    if low > high:
        low = high = 0.5 * (low + high)
        radius = float(np.max(np.hypot(across, local[:, 0] - low))) * (1.0 + 1e-12)
    ends = np.column_stack([(low, high), np.tile(middle, (2, 1))])
    return centre + ends @ axes, radius


@functools.cache
def segment_distance() -> CompiledFunction:
    """Compile the distance between two segments.

    Returns:
        A function of the ends of both segments [m], (2, 3) each, that gives their distance [m].
    """
    P, Q = ca.SX.sym("P", 2, 3), ca.SX.sym("Q", 2, 3)
    u, v, w = P[1, :] - P[0, :], Q[1, :] - Q[0, :], P[0, :] - Q[0, :]
    a, b, c = ca.dot(u, u), ca.dot(u, v), ca.dot(v, v)
    d, e = ca.dot(u, w), ca.dot(v, w)
    determinant = a * c - b * b

    def ratio(x: ca.SX, y: ca.SX) -> ca.SX:  # clipped to the segment; zero for a segment of no length
        return ca.fmin(ca.fmax(x / ca.fmax(y, _TINY), 0.0), 1.0)

    s = ratio(b * e - c * d, determinant) * (determinant > 1e-12 * a * c)  # parallel segments: any s will do
    t = ratio(b * s + e, c)
    s = ratio(b * t - d, a)
    gap = w + s * u - t * v
    function = ca.Function("paraopt_segment_distance", [P, Q], [ca.sqrt(ca.dot(gap, gap))], {"cse": True})
    return CompiledFunction(function)
