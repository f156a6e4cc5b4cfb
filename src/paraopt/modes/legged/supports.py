"""What feet stand on: a plane of any tilt, or a surface that is known by the frames of its footholds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]


class Support(Protocol):
    """Give the surface near a point by its tangent plane."""

    @property
    def name(self) -> str:
        """Name it in messages."""
        ...

    def tangent_plane(self, p_W: ArrayLike) -> tuple[Array, Array]:
        """Give the plane that stands for the surface near n points.

        Args:
            p_W: Points in the world [m], shape (3,) or (n, 3).

        Returns:
            A point of the plane [m] and its unit normal, out of the ground, each of the shape of `p_W`.
        """
        ...


@dataclass(frozen=True, eq=False)
class PlaneSupport:
    """Describe a plane.

    Attributes:
        point: A point of it in the world [m].
        normal: Direction out of the ground; of any length but zero.
        name: What messages call it.
    """

    point: Sequence[float] = (0.0, 0.0, 0.0)
    normal: Sequence[float] = (0.0, 0.0, 1.0)
    name: str = "ground"

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", finite_vector(self.point, 3, f"point of support {self.name!r}"))
        normal = finite_vector(self.normal, 3, f"normal of support {self.name!r}")
        size = float(np.linalg.norm(normal))
        if size == 0.0:
            raise DefinitionError(f"normal of support {self.name!r} is zero; it must be a direction")
        object.__setattr__(self, "normal", finite_vector(normal / size, 3, "normal"))

    @classmethod
    def tilted(
        cls, slope: float, heading: float = 0.0, point: Sequence[float] = (0.0, 0.0, 0.0), name: str = "ground"
    ) -> PlaneSupport:
        """Describe a plane that rises towards a heading.

        Args:
            slope: Angle of rise [rad], above zero uphill.
            heading: Direction of the steepest rise, from x towards y [rad].
            point: A point of it [m].
            name: What messages call it.
        """
        rise = math.sin(slope)
        return cls(point, (-rise * math.cos(heading), -rise * math.sin(heading), math.cos(slope)), name)

    def tangent_plane(self, p_W: ArrayLike) -> tuple[Array, Array]:
        """Give the plane itself; see `Support`."""
        shape = np.shape(p_W)
        return np.array(np.broadcast_to(self.point, shape)), np.array(np.broadcast_to(self.normal, shape))


@dataclass(frozen=True, eq=False)
class FrameSupport:
    """Describe a surface, such as a slightly curved one, by frames on it; near a point the nearest frame stands for it.

    Attributes:
        frames: Poses X_WS of the frames in the world, their z axis out of the ground, shape (k, 4, 4).
        name: What messages call it.
    """

    frames: ArrayLike
    name: str = "ground"

    def __post_init__(self) -> None:
        frames = np.array(self.frames, dtype=float)
        if frames.ndim == 2:
            frames = frames[None]
        if frames.ndim != 3 or frames.shape[1:] != (4, 4) or not len(frames) or not np.all(np.isfinite(frames)):
            raise DefinitionError(
                f"frames of support {self.name!r} have shape {frames.shape}; they must be k finite poses, (k, 4, 4)"
            )
        R = frames[:, :3, :3]
        skew = np.max(np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)), axis=(1, 2))
        if np.any(skew > 1e-9) or np.any(np.linalg.det(R) < 0):
            worst = int(np.argmax(np.where(np.linalg.det(R) < 0, np.inf, skew)))
            raise DefinitionError(f"frame {worst} of support {self.name!r} is no pose: its axes are not orthonormal")
        frames.flags.writeable = False
        object.__setattr__(self, "frames", frames)

    def tangent_plane(self, p_W: ArrayLike) -> tuple[Array, Array]:
        """Give the plane of x and y of the nearest frame; see `Support`."""
        points, frames = np.asarray(p_W, dtype=float), np.asarray(self.frames)
        nearest = np.argmin(np.linalg.norm(points[..., None, :] - frames[:, :3, 3], axis=-1), axis=-1)
        return frames[nearest, :3, 3], frames[nearest, :3, 2]


def measure_height(support: Support, p_W: ArrayLike) -> Array:
    """Measure how far points are above a support, along its normal.

    Args:
        support: The support.
        p_W: Points in the world [m], shape (3,) or (n, 3).

    Returns:
        Signed distances [m], shape () or (n,); below zero in the ground.
    """
    origin, normal = support.tangent_plane(p_W)
    return np.asarray(np.sum((np.asarray(p_W, dtype=float) - origin) * normal, axis=-1))


def drop_onto(support: Support, p_W: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -1.0)) -> Array:
    """Find the points of a support under or over given ones, along gravity.

    Args:
        support: The support.
        p_W: Points in the world [m], shape (3,) or (n, 3).
        gravity: Direction of gravity.

    Returns:
        Points on the support's tangent plane near them [m], of the same shape.

    Raises:
        DefinitionError: The support is a wall: gravity runs along it.
    """
    points = np.asarray(p_W, dtype=float)
    down = np.asarray(gravity, dtype=float)
    origin, normal = support.tangent_plane(points)
    steep = normal @ down
    if np.any(np.abs(steep) < 1e-9 * np.linalg.norm(down)):
        raise DefinitionError(f"support {support.name!r} is a wall: gravity runs along it; no point lies under another")
    return points + (np.sum((origin - points) * normal, axis=-1) / steep)[..., None] * down
