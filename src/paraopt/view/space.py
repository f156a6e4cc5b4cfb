"""What pictures in space share: surfaces of solids, axes, and what a link is in the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.mechanism import Mechanism
from paraopt.shapes import Box, Capsule, Cylinder, Shape, Sphere
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


def sample_surface(solid: Shape, n_around: int = 48, n_along: int = 16) -> NDArray[np.float64]:
    """Sample the surface of a convex solid as a grid of points in the frame that carries it.

    Args:
        solid: A box, sphere, cylinder or capsule.
        n_around: Number of steps about the axis of a round solid.
        n_along: Number of steps from pole to pole of a sphere or of the ends of a capsule.

    Returns:
        Points [m], shape (rows, columns, 3).

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
        case Capsule():
            polar = np.linspace(0.0, 0.5 * np.pi, n_along // 2 + 1)
            cap_r, cap_z = solid.radius * np.sin(polar), solid.radius * np.cos(polar) + 0.5 * solid.length
            local = _revolve(np.r_[cap_r, cap_r[::-1]], np.r_[cap_z, -cap_z[::-1]], around)
        case _:
            raise DefinitionError(
                f"solid {solid.name!r} is a {type(solid).__name__}; figures draw Box, Sphere, Cylinder and Capsule"
            )
    points: NDArray[np.float64] = local @ solid.pose[:3, :3].T + solid.pose[:3, 3]
    return points


def _revolve(radii: NDArray[np.float64], heights: NDArray[np.float64], around: NDArray[np.float64]) -> Any:
    """Turn a profile (radii and heights [m]) about z: points of shape (profile, around, 3)."""
    rings = radii[:, None, None] * np.stack([np.cos(around), np.sin(around)], axis=-1)
    return np.concatenate([rings, np.broadcast_to(heights[:, None, None], (*rings.shape[:2], 1))], axis=-1)
