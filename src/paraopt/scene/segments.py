"""Segments against convex polyhedra, for whole batches: do they meet, how far apart, how deep.

The solid is closed: a segment that touches it meets it, at distance 0. A segment of no length is its one point. A
segment of which a piece lies in a facet's plane and within the facet meets the solid along that piece.

Source: Lahouar, III.2.2 (clipping by the facets; touching and zero length are ours, and so are the distances).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.shapes import Hull

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class HullStack:
    """Hold several convex polyhedra in arrays of one size; shorter ones repeat their last facet, edge or corner.

    Attributes:
        normals: Outward unit normals, shape (h, f, 3).
        offsets: Offsets [m], shape (h, f).
        vertices: Corners [m], shape (h, k, 3).
        starts: First ends of the edges [m], shape (h, e, 3).
        spans: Edges from their first to their second end [m], shape (h, e, 3).
        scale: Extents [m], shape (h,).
    """

    normals: Array
    offsets: Array
    vertices: Array
    starts: Array
    spans: Array
    scale: Array


def stack_hulls(hulls: Sequence[Hull]) -> HullStack:
    """Stack the boundaries of polyhedra."""
    ends = [h.vertices[h.edges] for h in hulls]
    return HullStack(
        _pad([h.normals for h in hulls]),
        _pad([h.offsets for h in hulls]),
        _pad([h.vertices for h in hulls]),
        _pad([e[:, 0] for e in ends]),
        _pad([e[:, 1] - e[:, 0] for e in ends]),
        np.array([np.max(np.abs(h.vertices)) for h in hulls]),
    )


def _pad(arrays: Sequence[Array]) -> Array:
    size = max(len(a) for a in arrays)
    return np.stack([np.concatenate([a, np.repeat(a[-1:], size - len(a), axis=0)]) for a in arrays])


def clip_segments(A: Array, B: Array, normals: Array, offsets: Array) -> tuple[Array, Array]:
    """Cut from segments what lies outside of convex polyhedra.

    With s the unit vector along the segment, `t_i = n_i . s` and `lambda_i = (d_i - n_i . A) / t_i`, what is inside
    lies below the smallest lambda of t > 0 and above the largest lambda of t < 0. A facet parallel to the segment, and
    every facet for a segment of no length, leaves all of it or nothing.

    Args:
        A: First ends in the polyhedra's frames [m], shape (n, 3).
        B: Second ends [m], shape (n, 3).
        normals: Outward unit normals, shape (n, f, 3), or (f, 3) for one polyhedron.
        offsets: Offsets [m], shape (n, f) or (f,).

    Returns:
        Distances from A [m] at which the piece inside begins and ends, shape (n,) each; the segment meets the solid
        if and only if the first is not above the second, and their difference is the length inside.
    """
    span = B - A
    length = np.linalg.norm(span, axis=1)
    s = span / np.maximum(length, _TINY)[:, None]
    t = _dot(normals, s)
    room = offsets - _dot(normals, A)  # below zero: A is outside of this facet
    crosses = np.abs(t) * length[:, None] > _TINY
    with np.errstate(over="ignore"):
        at = room / np.where(crosses, t, 1.0)
    leaving = np.where(crosses & (t > 0.0), at, np.inf)
    entering = np.where(crosses & (t < 0.0), at, -np.inf)
    high = np.minimum(leaving.min(axis=1), length)
    low = np.maximum(entering.max(axis=1), 0.0)
    outside = np.any(~crosses & (room < 0.0), axis=1)
    low = np.where(outside, np.inf, low)
    return low, high


def segments_meet(A: Array, B: Array, normals: Array, offsets: Array) -> NDArray[np.bool_]:
    """Tell which segments meet convex polyhedra, touching included; arguments as for `clip_segments`."""
    low, high = clip_segments(A, B, normals, offsets)
    return low <= high


def measure_segments(
    A: Array, B: Array, stack: HullStack, which: Indices, touching: float = 1e-12
) -> tuple[Array, Array, Array, Array]:
    """Measure segments from convex polyhedra, in penetration the least shift that parts them.

    Apart, the nearest points are an end of the segment and a facet, or the segment and an edge. In penetration the
    least depth is along a facet's normal or along one normal to the segment and an edge: no other direction can be
    that of a facet of the Minkowski difference.

    Args:
        A: First ends in the polyhedra's frames [m], shape (n, 3).
        B: Second ends [m], shape (n, 3).
        stack: The polyhedra.
        which: Polyhedron of each segment, shape (n,).
        touching: Distance below which the normal is that of a facet or of an edge rather than the line between the
            nearest points, over the extent [1].

    Returns:
        Signed distances [m], shape (n,); nearest points of the polyhedra and of the segments [m], shape (n, 3) each;
        unit normals from the polyhedron to the segment, shape (n, 3).
    """
    normals, offsets = stack.normals[which], stack.offsets[which]
    low, high = clip_segments(A, B, normals, offsets)
    on_solid, on_segment = _nearest(A, B, stack, which)
    gap = on_segment - on_solid
    distance = np.linalg.norm(gap, axis=1)
    scale = np.maximum(stack.scale[which], np.max(np.abs(A), axis=1))
    inside = np.flatnonzero((low <= high) | (distance <= touching * scale))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = gap / distance[:, None]
    if inside.size:
        a, b, w = A[inside], B[inside], which[inside]
        depth, axis = _least_depth(a, b, stack, w)
        shift = depth[:, None] * axis
        touched, _ = _nearest(a - shift, b - shift, stack, w)
        distance[inside], normal[inside] = depth, axis
        on_solid[inside], on_segment[inside] = touched, touched + shift
    return distance, on_solid, on_segment, normal


def _nearest(A: Array, B: Array, stack: HullStack, which: Indices) -> tuple[Array, Array]:
    """Give the nearest points of the boundary's facets and edges and of the segments, for segments outside."""
    n, rows = len(A), np.arange(len(A))
    normals, offsets = stack.normals[which], stack.offsets[which]
    starts, spans = stack.starts[which], stack.spans[which]
    on_edges, on_segments = nearest_of_segments(starts, spans, A[:, None, :], (B - A)[:, None, :])
    squares = np.sum((on_edges - on_segments) ** 2, axis=2)
    k = np.argmin(squares, axis=1)
    solid, segment, best = on_edges[rows, k], on_segments[rows, k], squares[rows, k]
    margin = 1e-12 * stack.scale[which]
    for end in (A, B):
        out = _dot(normals, end) - offsets
        # the facet over whose inside a point lies is the farthest violated one
        i = np.argmax(out, axis=1)
        height = out[rows, i]
        foot = end - height[:, None] * normals[rows, i]
        over = np.all(_dot(normals, foot) - offsets <= margin[:, None], axis=1)
        nearer = over & (height >= 0.0) & (height**2 < best)
        solid = np.where(nearer[:, None], foot, solid)
        segment = np.where(nearer[:, None], end, segment)
        best = np.where(nearer, height**2, best)
    return solid.reshape(n, 3), segment.reshape(n, 3)


def _least_depth(A: Array, B: Array, stack: HullStack, which: Indices) -> tuple[Array, Array]:
    """Give the largest gap over all directions that can separate, and that direction, away from the polyhedron."""
    rows = np.arange(len(A))
    normals, spans, vertices = stack.normals[which], stack.spans[which], stack.vertices[which]
    facets = np.minimum(_dot(normals, A), _dot(normals, B)) - stack.offsets[which]
    along = B - A
    length = np.linalg.norm(along, axis=1)
    cross = np.cross(spans, (along / np.maximum(length, _TINY)[:, None])[:, None, :])
    size = np.linalg.norm(cross, axis=2)
    # an edge parallel to the segment gives no direction: the facets beside it do
    useful = size > 1e-9 * np.linalg.norm(spans, axis=2)
    cross /= np.maximum(size, _TINY)[:, :, None]
    reach = np.einsum("nec,nkc->nek", cross, vertices)
    at = _dot(cross, 0.5 * (A + B))
    plus = np.where(useful, at - reach.max(axis=2), -np.inf)
    minus = np.where(useful, reach.min(axis=2) - at, -np.inf)
    gaps = np.concatenate([facets, plus, minus], axis=1)
    axes = np.concatenate([normals, cross, -cross], axis=1)
    k = np.argmax(gaps, axis=1)
    return gaps[rows, k], axes[rows, k]


def nearest_of_segments(P: Array, u: Array, Q: Array, v: Array) -> tuple[Array, Array]:
    """Give nearest points of segments `P + [0, 1] u` and `Q + [0, 1] v`.

    Where several are as near (parallel segments), one of them.

    Args:
        P: First ends of the first segments [m], shape (..., 3).
        u: The first segments from end to end [m], zero allowed.
        Q: First ends of the second segments [m].
        v: The second segments from end to end [m].

    Returns:
        Points on the first and on the second segments [m].
    """
    P, u, Q, v = np.broadcast_arrays(P, u, Q, v)
    w = P - Q
    a, b, c = _inner(u, u), _inner(u, v), _inner(v, v)
    d, e = _inner(u, w), _inner(v, w)
    determinant = a * c - b * b
    skew = determinant > 1e-14 * a * c
    safe = np.where(skew, determinant, 1.0)
    s, t = (b * e - c * d) / safe, (a * e - b * d) / safe
    between = skew & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    a, c = np.maximum(a, _TINY), np.maximum(c, _TINY)
    # an inner pair of points, else an end of one against the other
    S = np.stack([np.clip(s, 0.0, 1.0), 0.0 * s, 0.0 * s + 1.0, np.clip(-d / a, 0, 1), np.clip((b - d) / a, 0, 1)])
    T = np.stack([np.clip(t, 0.0, 1.0), np.clip(e / c, 0, 1), np.clip((e + b) / c, 0, 1), 0.0 * t, 0.0 * t + 1.0])
    gaps = w + S[..., None] * u - T[..., None] * v
    squares = _inner(gaps, gaps)
    squares[0] = np.where(between, squares[0], np.inf)
    k = np.argmin(squares, axis=0)[None]
    S, T = np.take_along_axis(S, k, 0)[0], np.take_along_axis(T, k, 0)[0]
    return P + S[..., None] * u, Q + T[..., None] * v


def _dot(vectors: Array, x: Array) -> Array:
    """Multiply vectors (n, f, 3), or (f, 3) for all, with one vector each, (n, 3)."""
    if vectors.ndim == 2:
        return np.asarray(x @ vectors.T)
    return np.asarray((vectors @ x[:, :, None])[:, :, 0])


def _inner(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...c,...c->...", a, b))
