"""Broad phase: every solid in a capsule, and the distance between capsules as a lower bound, for whole batches."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics import CompiledFunction
from paraopt.shapes import Box, Capsule, Cylinder, Shape, Sphere

Array = NDArray[np.float64]
_TINY = 1e-300


def enclose(shape: Shape) -> tuple[Array, float]:
    """Enclose a solid in a capsule.

    Args:
        shape: The solid.

    Returns:
        Ends of the capsule's segment in the solid's own frame [m], shape (2, 3), and its radius [m].
    """
    if isinstance(shape, Capsule):
        half, radius, axis = 0.5 * shape.length, shape.radius, 2
    elif isinstance(shape, Cylinder):
        half, radius, axis = 0.5 * shape.length, shape.radius, 2
        # the flat ends stick out of the round ones at the rim, unless the segment reaches the ends and the radius grows
        if half <= radius:
            half, radius = 0.0, float(np.hypot(half, radius))
    elif isinstance(shape, Box):
        size = 0.5 * np.asarray(shape.size)
        axis = int(np.argmax(size))
        half, radius = float(size[axis]), float(np.linalg.norm(np.delete(size, axis)))
    elif isinstance(shape, Sphere):
        half, radius, axis = 0.0, shape.radius, 2
    else:
        half, radius, axis = 0.0, shape.bounding_radius, 2
    ends = np.zeros((2, 3))
    ends[0, axis], ends[1, axis] = -half, half
    return ends, radius


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
