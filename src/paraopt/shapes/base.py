"""What all solids share: a name, a pose in the frame that carries them, and sizes that are checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.spatial import check_pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """Hold what all solids share.

    Attributes:
        name: Name within its link or scene; chosen by the owner when empty.
        pose: Pose of the solid in the frame that carries it, shape (4, 4).
    """

    name: str = ""
    pose: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise DefinitionError(f"name of a {type(self).__name__.lower()} is {self.name!r}; it must be a string")
        object.__setattr__(self, "pose", check_pose(self.pose, f"pose of {self.label}"))

    @property
    def label(self) -> str:
        """Name the solid in messages."""
        return f"{type(self).__name__.lower()} {self.name!r}" if self.name else type(self).__name__.lower()

    @property
    def bounding_radius(self) -> float:
        """Give the radius of the sphere about the solid's origin that contains it [m]."""
        raise DefinitionError(f"{self.label}: a bare Shape has no size; use one of the solids")

    def _check_size(self, quantity: str, value: Any) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError) as error:
            raise DefinitionError(f"{quantity} of {self.label} is {value!r}; it must be a number of metres") from error
        if not 0.0 < number < 1e150:  # squares of larger numbers overflow
            raise DefinitionError(f"{quantity} of {self.label} is {number} m; it must be finite and above 0")
        return number
