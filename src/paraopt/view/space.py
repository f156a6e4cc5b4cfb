"""What pictures in space share: surfaces of solids, axes, and what a link is in the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.mechanism import Mechanism
from paraopt.shapes import Box, Capsule, Cone, ConvexPolyhedron, Cylinder, HalfSpace, Mesh, Shape, Sphere, name_kinds
from paraopt.view.canvas import axis_label


def list_link_kinds(mechanism: Mechanism) -> dict[str, str]:
    """Tell for every link the kind that decides its colour.

    Args:
        mechanism: The mechanism.

    Returns:
        By name of link: "base", "platform" where operational variables move it, "actuator" where an actuator does, else
        "robot".
    """
    kinds = {link.name: "robot" for link in mechanism.links}
    kinds |= {v.link: "actuator" for v in mechanism.variables if v.role == "active"}
    kinds |= {v.link: "platform" for v in mechanism.variables if v.role == "operational"}
    return kinds | {mechanism.base.name: "base"}


def dress_space(space: Any, low: NDArray[np.float64], high: NDArray[np.float64], unit: str) -> None:
    """Give the axes in space equal scales, a plain look and names."""
    from matplotlib.ticker import MaxNLocator

    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect(high - low, zoom=0.96)
    space.set_proj_type("persp", focal_length=0.6)
    space.view_init(elev=24, azim=-58)
    for name, axis, extent in zip("xyz", (space.xaxis, space.yaxis, space.zaxis), high - low, strict=True):
        axis.set_pane_color((0.97, 0.975, 0.98, 1.0))
        axis.line.set_color("#9AA5B1")
        axis.set_major_locator(MaxNLocator(nbins=int(np.clip(round(6 * extent / np.max(high - low)), 2, 6))))
        axis.set_label_text(axis_label(name, unit))


def sample_surfaces(
    solid: Shape, about: NDArray[np.float64] | None = None, extent: float = 1.0
) -> list[NDArray[np.float64]]:
    """Sample the surface of any solid as grids of points, one for each convex part.

    Args:
        solid: The solid.
        about: What is looked at, in the frame that carries the solid [m]: a half-space is drawn near it.
        extent: Side of the square that is drawn of a half-space [m].

    Returns:
        Grids [m], as of `sample_surface`.

    Raises:
        DefinitionError: The solid is of an unknown type.
    """
    if isinstance(solid, Mesh):
        return [part @ solid.pose[:3, :3].T + solid.pose[:3, 3] for part in map(sample_surface, solid.solids)]
    return [sample_surface(cut_half_space(solid, about, extent) if isinstance(solid, HalfSpace) else solid)]


def fill_half_space(solid: HalfSpace, low: NDArray[np.float64], high: NDArray[np.float64]) -> ConvexPolyhedron | None:
    """Give what of a half-space lies between two corners of a box [m] of the carrying frame; None if nothing."""
    out = solid.pose[:3, 2]
    normals = np.vstack([np.eye(3), -np.eye(3), out])
    offsets = np.concatenate([high, -low, [out @ solid.pose[:3, 3]]])
    try:
        return ConvexPolyhedron.from_facets(normals, offsets, solid.name)
    except DefinitionError:  # the plane passes by, or touches
        return None


def cut_half_space(solid: HalfSpace, about: NDArray[np.float64] | None, extent: float) -> Box:
    """Give the plate that is drawn of a half-space: a square of its plane, near what is looked at."""
    pose = np.array(solid.pose)
    if about is not None:
        out = pose[:3, 2]
        pose[:3, 3] = about - out * float(out @ (about - pose[:3, 3]))
    thickness = 0.005 * extent
    pose[:3, 3] -= 0.5 * thickness * pose[:3, 2]
    return Box(size=(extent, extent, thickness), pose=pose, name=solid.name)


def sample_surface(solid: Shape, n_around: int = 48, n_along: int = 16) -> NDArray[np.float64]:
    """Sample the surface of a convex solid as a grid of points in the frame that carries it.

    Args:
        solid: A box, sphere, cylinder, capsule, cone or convex polyhedron.
        n_around: Number of steps about the axis of a round solid.
        n_along: Number of steps from pole to pole of a sphere or of the ends of a capsule.

    Returns:
        Points [m], shape (rows, columns, 3); meshes of the grid without area lie between the faces of a polyhedron.

    Raises:
        DefinitionError: The solid is of another type.
    """
    around = np.linspace(0.0, 2.0 * np.pi, n_around + 1)
    match solid:
        case Box():
            # Four side faces and two lids collapsed to the axis.
            half = 0.5 * np.asarray(solid.size)
            ring = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)], dtype=float)
            profile = [(0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)]
            local = np.array([[(*(r * corner), z) for corner in ring] for r, z in profile]) * half
        case Sphere():
            polar = np.linspace(0.0, np.pi, n_along + 1)
            local = _revolve(solid.radius * np.sin(polar), solid.radius * np.cos(polar), around)
        case Cylinder():
            half_length = 0.5 * solid.length
            radii = np.array([0.0, solid.radius, solid.radius, 0.0])
            local = _revolve(radii, np.array([-half_length, -half_length, half_length, half_length]), around)
        case Cone():
            half_length = 0.5 * solid.length
            local = _revolve(np.array([0.0, solid.radius, 0.0]), half_length * np.array([-1.0, -1.0, 1.0]), around)
        case Capsule():
            polar = np.linspace(0.0, 0.5 * np.pi, n_along // 2 + 1)
            cap_r, cap_z = solid.radius * np.sin(polar), solid.radius * np.cos(polar) + 0.5 * solid.length
            local = _revolve(np.r_[cap_r, cap_r[::-1]], np.r_[cap_z, -cap_z[::-1]], around)
        case ConvexPolyhedron():
            a, b, c = (solid.hull.vertices[solid.hull.triangles[:, k]] for k in range(3))
            # a strip of two columns: a triangle from row to row, and lines without area to the next
            local = np.stack([np.stack([a, a], 1), np.stack([a, b], 1), np.stack([c, c], 1)], 1).reshape(-1, 2, 3)
        case _:
            raise DefinitionError(
                f"solid {solid.name!r} is a {type(solid).__name__}; figures draw convex parts of {name_kinds()}"
            )
    points: NDArray[np.float64] = local @ solid.pose[:3, :3].T + solid.pose[:3, 3]
    return points


def _revolve(radii: NDArray[np.float64], heights: NDArray[np.float64], around: NDArray[np.float64]) -> Any:
    """Turn a profile (radii and heights [m]) about z: points of shape (profile, around, 3)."""
    rings = radii[:, None, None] * np.stack([np.cos(around), np.sin(around)], axis=-1)
    return np.concatenate([rings, np.broadcast_to(heights[:, None, None], (*rings.shape[:2], 1))], axis=-1)
