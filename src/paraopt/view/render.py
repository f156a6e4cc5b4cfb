"""Render convex solids seen from far away: nearest face per pixel, flat shades, and dark lines where solids end.

Matplotlib paints whole faces from the farthest to the nearest, which shows a rod through the wall of its cylinder; here
every pixel takes the face that is nearest there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LIGHT = (-0.35, 0.5, 0.8)
"""Direction from which light comes: to the right, upwards and towards the person who looks [1]."""

CREASE = 0.75
"""Cosine of the angle between two faces beyond which their common edge is drawn [1]."""


TIE = 1e-3
"""Difference of depth below which two faces count as equally near, as a share of the scene's extent [1]."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Hold a convex solid to render.

    Attributes:
        surface: Grid of points on its surface, shape (rows, columns, 3).
        color: Red, green and blue in [0, 1].
        group: Number that solids without a line between them share.
    """

    surface: Array
    color: tuple[float, float, float]
    group: int


@dataclass(frozen=True, eq=False)
class Camera:
    """Hold how points of the world come to the picture: a parallel projection.

    Attributes:
        across: Pixels to the right and upwards per unit along x, y and z, shape (2, 3).
        offset: Pixel at which the origin of the world lies, shape (2,).
        view: Unit direction from the scene to the person who looks, shape (3,).
    """

    across: Array
    offset: Array
    view: Array


def render(solids: Sequence[Solid], camera: Camera, width: int, height: int) -> Array:
    """Render solids.

    Args:
        solids: What to render.
        camera: From where.
        width: Width of the picture [pixels].
        height: Height of the picture [pixels].

    Returns:
        Red, green, blue and opacity in [0, 1], the lowest row first, shape (height, width, 4).
    """
    depth = np.full((height, width), -np.inf)
    face = np.full((height, width), -1)
    colors: list[Array] = []
    normals: list[Array] = []
    groups: list[int] = []
    count = 0
    clouds = [solid.surface.reshape(-1, 3) for solid in solids]
    # where surfaces coincide, such as those of balls at a joint, the solid named first is seen whole
    tie = TIE * float(np.max(np.ptp(np.vstack(clouds), axis=0))) if clouds else 0.0
    for solid in solids:
        corners, outwards = list_faces(solid.surface)
        seen = outwards @ camera.view > 1e-9
        corners, outwards = corners[seen], outwards[seen]
        for points, normal in zip(corners, outwards, strict=True):
            _fill(points, normal, camera, depth, face, count, tie)
            count += 1
        colors.append(shade(solid.color, outwards, camera))
        normals.append(outwards)
        groups += [solid.group] * len(outwards)
    picture = np.ones((height, width, 4))
    picture[..., 3] = 0.0
    if not count:
        return picture
    drawn = face >= 0
    picture[drawn, :3] = np.vstack(colors)[face[drawn]]
    picture[drawn, 3] = 1.0
    _draw_borders(picture, face, np.vstack(normals), np.array(groups))
    return picture


def list_faces(surface: Array) -> tuple[Array, Array]:
    """List the faces of a grid on a convex solid.

    Args:
        surface: Points, shape (rows, columns, 3).

    Returns:
        Corners, shape (n, 4, 3), and unit normals that point outwards, shape (n, 3); faces without area are left out.
    """
    grid = (surface[:-1, :-1], surface[1:, :-1], surface[1:, 1:], surface[:-1, 1:])
    corners = np.stack(grid, axis=2).reshape(-1, 4, 3)
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    lengths = np.linalg.norm(normals, axis=1)
    kept = lengths > 1e-9 * np.max(lengths)
    corners, normals = corners[kept], normals[kept] / lengths[kept, None]
    outwards = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - surface.reshape(-1, 3).mean(axis=0))
    return corners, normals * np.where(outwards < 0.0, -1.0, 1.0)[:, None]


def shade(color: tuple[float, float, float], normals: Array, camera: Camera) -> Array:
    """Lighten a colour where a face looks to the light and darken it elsewhere; shape (n, 3)."""
    right, up = camera.across / np.linalg.norm(camera.across, axis=1, keepdims=True)
    towards = LIGHT[0] * right + LIGHT[1] * up + LIGHT[2] * camera.view
    bright = np.clip(normals @ (towards / np.linalg.norm(towards)), 0.0, 1.0)[:, None]
    shaded: Array = np.clip((0.55 + 0.45 * bright) * np.array(color) + 0.2 * bright**6, 0.0, 1.0)
    return shaded


def _fill(
    points: Array, normal: Array, camera: Camera, depth: Array, face: NDArray[np.intp], number: int, tie: float
) -> None:
    """Give a flat convex face the pixels at which it is the nearest so far by more than a tie."""
    flat = points @ camera.across.T + camera.offset
    low = np.maximum(np.ceil(flat.min(axis=0) - 0.5).astype(int), 0)
    high = np.minimum(np.floor(flat.max(axis=0) + 0.5).astype(int), np.array(face.shape[::-1]) - 1)
    if np.any(low > high):
        return
    x = np.arange(low[0], high[0] + 1)[None, :]
    y = np.arange(low[1], high[1] + 1)[:, None]
    edges = np.roll(flat, -1, axis=0) - flat
    turned = sum(edges[k - 1, 0] * edges[k, 1] - edges[k - 1, 1] * edges[k, 0] for k in range(4))
    inside = np.ones((y.size, x.size), dtype=bool)
    for (x0, y0), (dx, dy) in zip(flat, edges, strict=True):
        slack = 1e-6 * (abs(dx) + abs(dy))  # pixels on a common border must not fall between both faces
        inside &= np.sign(turned) * (dx * (y - y0) - dy * (x - x0)) >= -slack
    if not inside.any():
        return
    # depth is linear over the face: its slopes follow from the plane n . p = constant
    p = points.mean(axis=0)
    slopes = np.linalg.solve(np.vstack([camera.across, normal]), np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]))
    slope_x, slope_y = camera.view @ slopes
    centre = camera.across @ p + camera.offset
    near = camera.view @ p + slope_x * (x - centre[0]) + slope_y * (y - centre[1])
    window = (slice(low[1], high[1] + 1), slice(low[0], high[0] + 1))
    won = inside & (near > depth[window] + tie)
    depth[window][won] = near[won]
    face[window][won] = number


def _draw_borders(picture: Array, face: NDArray[np.intp], normals: Array, groups: NDArray[np.intp]) -> None:
    """Darken pixels beside another solid, beside the background, and, a little, at the sharp edges of a solid."""
    group = np.where(face >= 0, groups[face], -1)
    border = np.zeros(face.shape, dtype=bool)
    crease = np.zeros(face.shape, dtype=bool)
    for axis in (0, 1):
        ahead: tuple[slice, ...] = tuple(slice(1, None) if k == axis else slice(None) for k in (0, 1))
        back: tuple[slice, ...] = tuple(slice(None, -1) if k == axis else slice(None) for k in (0, 1))
        differs = group[ahead] != group[back]
        border[ahead] |= differs
        border[back] |= differs
        a, b = normals[face[ahead]], normals[face[back]]
        sharp = ~differs & (np.einsum("ijk,ijk->ij", a, b) < CREASE)
        crease[ahead] |= sharp
    border &= face >= 0
    crease &= (face >= 0) & ~border
    picture[border, :3] *= 0.45
    picture[crease, :3] *= 0.75
