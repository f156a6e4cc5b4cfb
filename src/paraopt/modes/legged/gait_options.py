"""What a gait may do: which coordinates of the trunk move, how far, and how finely it is looked at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from paraopt.errors import DefinitionError, unknown_name

Coordinate = Literal["x", "y", "z", "alpha", "beta", "gamma"]
COORDINATES: tuple[Coordinate, ...] = ("x", "y", "z", "alpha", "beta", "gamma")


@dataclass(frozen=True)
class GaitOptions:
    """State how the trunk's way is found.

    Attributes:
        free: Coordinates of the trunk that may leave their nominal way.
        reach: How far a length may leave it [m].
        tilt: How far an angle may leave it [rad].
        regularity: Least determinant of a leg over that at rest [1]: keeps legs from stretching and on their branch.
        reserve: Part of the range of a joint that is left at each end, for what lies between the samples [1].
        swing_moves: Whether the trunk moves while a foot is in the air; else it stands then, and moves before.
        straight: Whether the trunk goes straight from place to place; else along cubics.
        samples: Number of samples of a phase, to begin with.
        density: How much denser the gait is looked at afterwards [1].
        dip: Largest loss of margin between samples [m]; where it is larger the samples are doubled.
        refinements: How often the program may be run again, with more samples or asked for more.
        ease: Share of the best margin that is given up for a smaller motion of the trunk [1].
        least_margin: Smallest margin [m] of a gait that is not refused.
        least_time: Shortest time of a phase, where it is timed [s].
        motion_weight: Weight of the trunk's motion beside the margin, in the search for the best margin [1].
        tolerance: IPOPT's convergence tolerance.
        iterations: Bound on IPOPT's iterations.

    Raises:
        DefinitionError: A number is outside its range.
        UnknownNameError: A coordinate does not exist.
    """

    free: Sequence[Coordinate] = ("x", "y", "z", "gamma")
    reach: float = 0.04
    tilt: float = 0.25
    regularity: float = 0.5
    reserve: float = 0.005
    swing_moves: bool = True
    straight: bool = False
    samples: int = 9
    density: int = 10
    dip: float = 5e-4
    refinements: int = 4
    ease: float = 0.02
    least_margin: float = 0.0
    least_time: float = 0.02
    motion_weight: float = 1e-3
    tolerance: float = 1e-7
    iterations: int = 500

    def __post_init__(self) -> None:
        object.__setattr__(self, "free", tuple(self.free))
        for coordinate in self.free:
            if coordinate not in COORDINATES:
                raise unknown_name("free coordinate of the trunk", coordinate, COORDINATES)
        for name in ("reach", "tilt", "regularity", "dip", "least_time", "motion_weight", "tolerance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise DefinitionError(f"{name} of a gait is {value!r}; it must be a finite number above 0")
        for name, least in (("samples", 5), ("density", 1), ("refinements", 0), ("iterations", 1)):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= least):
                raise DefinitionError(f"{name} of a gait are {value!r}; they must be a whole number from {least}")
        if not 0 <= self.reserve < 0.5:
            raise DefinitionError(f"reserve of a gait is {self.reserve!r}; it must be in [0, 0.5)")
        if not 0 <= self.ease < 1:
            raise DefinitionError(f"ease of a gait is {self.ease!r}; it must be in [0, 1)")
        if not math.isfinite(self.least_margin):
            raise DefinitionError(f"least margin of a gait is {self.least_margin!r} m; it must be finite")
