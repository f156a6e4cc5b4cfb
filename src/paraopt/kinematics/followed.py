"""What a continuation gives: the branch, why it ended, and what was found there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.free_motion import FreeMotion
from paraopt.mechanism import Mechanism

Array = NDArray[np.float64]


class StopReason(Enum):
    """Say why a continuation ended."""

    ARRIVED = "arrived: the branch was followed to the end of the path"
    SINGULAR = "singular: the columns that are solved for lose rank; the branch folds back or meets another"
    RANGE = "joint range: a variable reaches the end of its range"
    CONTRADICTION = "contradiction: the imposed variables depend on each other, and the path does not respect it"
    NOT_FINITE = "not finite: the path gives a value that is not a finite number"
    STEP = "step below minimum: no step of the path is small enough to be sure of the branch"


@dataclass(frozen=True, eq=False)
class BranchSingularity:
    """Tell what was found where a branch ends at a singularity.

    Attributes:
        kind: "parallel" when the drives are imposed, "serial" when the operational variables are, "constraint" when the
            closures themselves lose rank, "of the imposed variables" otherwise.
        s: Where on the path the smallest singular value is zero, extrapolated from the last steps.
        error: Distance on the path from the last configuration to there.
        distance: Smallest singular value of the solved columns at the last configuration [1].
        motion: Motion that becomes free there with the imposed variables at rest.
        is_fold: Whether the singular value goes to zero like the square root of what is left of the path, as where two
            assembly or working modes meet and end; else it goes evenly, as where branches cross.
    """

    kind: str
    s: float
    error: float
    distance: float
    motion: FreeMotion
    is_fold: bool


@dataclass(frozen=True, eq=False)
class Followed:
    """Hold a branch followed along a path of imposed values.

    Attributes:
        mechanism: The mechanism.
        names: Imposed variables.
        s: Places on the path, from 0 to where it stopped, shape (n,).
        X: Closed configurations there [m or rad], shape (n, n_variables).
        margins: Smallest singular value of the solved columns there [1], shape (n,).
        changes: Relative change of the solved columns in the region of the step that led there [1], shape (n,).
        residual: Largest scaled closure residual of all configurations [1].
        reason: Why it stopped.
        detail: The reason with its names, values and bounds, in one sentence.
        singularity: What was found there, where the reason is a singularity.
        limit: Name of the variable whose range ended the branch, else empty.
        rejections: How many steps each test refused.
        undetermined: Number of motions that the imposed variables leave free; the least motion was followed.
    """

    mechanism: Mechanism
    names: tuple[str, ...]
    s: Array
    X: Array
    margins: Array
    changes: Array
    residual: float
    reason: StopReason
    detail: str
    singularity: BranchSingularity | None
    limit: str
    rejections: Mapping[str, int]
    undetermined: int

    @property
    def arrived(self) -> bool:
        """Tell whether the end of the path was reached."""
        return self.reason is StopReason.ARRIVED

    @property
    def end(self) -> Configuration:
        """Give the last configuration."""
        return Configuration(self.mechanism, self.X[-1], self.residual)

    @property
    def configurations(self) -> tuple[Configuration, ...]:
        """Give all configurations."""
        return tuple(Configuration(self.mechanism, X, self.residual) for X in self.X)

    def __str__(self) -> str:
        return f"{self.mechanism.name!r}, {', '.join(self.names)} imposed: {self.detail} ({len(self.s) - 1} steps)"
