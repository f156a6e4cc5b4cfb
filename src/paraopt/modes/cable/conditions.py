"""The conditions of the planar four-cable robot of LARM: where it can be held, told without any tension."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.cable.read import read_number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SquareConditions:
    """Tell where four cables from the corners of a square can hold a platform at two points of its axis.

    The corners are (0, 0), (0, L), (L, 0), (L, L); the platform's points at -h and +h of its axis are held from the
    sides x = 0 and x = L. In the plane every wrench can be balanced by positive tensions if and only if the line
    through both points leaves the square through these two sides, not at their ends. That is said of the platform
    whose point -h looks to the side x = 0, turned by less than a right angle; turned over, with its cables crossed, it
    can be held too (`has_wrench_closure` tells), and the conditions leave it out.

    Attributes:
        side: Side L of the square [m].
        half_width: Distance h of the points from the platform's origin [m].

    Raises:
        DefinitionError: A size is not above zero, or the platform is as wide as the square.

    Source: Lahouar, IV.1-IV.4 (checked form).
    """

    side: float = 1.0
    half_width: float = 0.1

    def __post_init__(self) -> None:
        for key in ("side", "half_width"):
            object.__setattr__(self, key, read_number(getattr(self, key), f"{key} of the square", "m", above=0.0))
        if 2.0 * self.half_width >= self.side:
            raise DefinitionError(
                f"the platform is {2.0 * self.half_width:g} m wide; it must be narrower than the square's side, "
                f"{self.side:g} m"
            )

    def rotation_bounds(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Give the lowest and highest rotation [rad] at positions of the platform's origin within the square.

            -psi_1 <= theta <= psi_2
            psi_1 = min(atan((L - y) / x), atan(y / (L - x)))
            psi_2 = min(atan(y / x), atan((L - y) / (L - x)))

        Args:
            x: First coordinates [m], shape (k,) or a number.
            y: Second coordinates [m], same shape.

        Returns:
            `-psi_1` and `psi_2`, same shape.

        Source: Lahouar, IV.5, IV.6 (checked form).
        """
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        left, right, below, above = x, self.side - x, y, self.side - y
        lowest = -np.minimum(np.arctan2(above, left), np.arctan2(below, right))
        return np.asarray(lowest), np.asarray(np.minimum(np.arctan2(below, left), np.arctan2(above, right)))

    def margins(self, poses: ArrayLike) -> Array:
        """Give the angle by which poses keep from the bounds on the rotation [rad], negative beyond; shape (k,).

        Rotations count as they are, not modulo a full turn. Outside the bounds on the position, IV.1 to IV.3, the
        margin is -pi.

        Args:
            poses: Values of (x, y, theta), or (x, y, z, theta) where the platform hangs below the square; shape (k, 3)
                or (k, 4).

        Raises:
            DefinitionError: The shape is another, or a number is not finite.
        """
        try:
            table = np.atleast_2d(np.asarray(poses, dtype=float))
        except (TypeError, ValueError) as error:
            raise DefinitionError(f"poses are {poses!r}; they must be numbers") from error
        if table.ndim != 2 or table.shape[1] not in (3, 4):
            raise DefinitionError(
                f"poses have shape {np.shape(poses)}; it must be (k, 3) of x, y, theta, or (k, 4) of x, y, z, theta"
            )
        if not np.all(np.isfinite(table)):
            raise DefinitionError(f"pose {int(np.argwhere(~np.isfinite(table))[0, 0])} is not finite")
        x, y, theta = table[:, 0], table[:, 1], table[:, -1]
        low, high = self.rotation_bounds(x, y)
        is_inside = (x >= self.half_width) & (x <= self.side - self.half_width) & (y >= 0.0) & (y <= self.side)
        if table.shape[1] == 4:
            is_inside &= (table[:, 2] >= -self.side) & (table[:, 2] < 0.0)
        return np.where(is_inside, np.minimum(theta - low, high - theta), -np.pi)

    def hold(self, poses: ArrayLike) -> NDArray[np.bool_]:
        """Tell at which poses the conditions hold; shape (k,)."""
        return np.asarray(self.margins(poses) >= 0.0)
