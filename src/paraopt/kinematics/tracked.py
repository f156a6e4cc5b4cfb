"""What tracking gives: the configuration and the verdict of each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.configuration import Configuration

Array = NDArray[np.float64]


class TrackStatus(Enum):
    """Say how a step ended."""

    OK = "ok: the command is followed"
    LIMITED = "limited: a bound holds the command back"
    RELAXED = "infeasible relaxed: no motion keeps all bounds; accelerations gave way"


@dataclass(frozen=True, eq=False)
class TrackStep:
    """Hold one step.

    Attributes:
        configuration: Closed configuration at its end.
        velocity: Velocity of all variables over the step, change over period [m/s or rad/s], shape (n_variables,).
        status: How it ended.
        limited_by: What holds the command back: "velocity of 'theta1'", "acceleration of ...", "position of ...",
            "parallel singularity", "serial singularity", "length of the step" where the loops do not close farther on.
        error: Distance of the motion from the command, lengths in characteristic lengths [1/s].
        margins: Distances to singularities at its end [1], by kind, of the kinds that are watched.
        relaxation: By which part accelerations pass their limits [1]; 0 unless relaxed.
    """

    configuration: Configuration
    velocity: Array
    status: TrackStatus
    limited_by: tuple[str, ...]
    error: float
    margins: Mapping[str, float]
    relaxation: float

    @property
    def summary(self) -> str:
        """Say in one sentence how the step ended."""
        return f"{self.status.value}{': ' if self.limited_by else ''}{', '.join(self.limited_by)}"


@dataclass(frozen=True, eq=False)
class Tracked:
    """Hold a sequence of steps.

    Attributes:
        period: Duration of a step [s].
        X: Closed configurations, the start first [m or rad], shape (n + 1, n_variables).
        velocities: Velocities over the steps [m/s or rad/s], shape (n, n_variables).
        residuals: Largest scaled closure residual at the end of each step [1], shape (n,).
        errors: Distance of the motion from the command [1/s], shape (n,).
        margins: Distances to singularities at the end of each step [1], shape (n,) by kind, of the kinds watched.
        relaxations: By which part accelerations pass their limits [1], shape (n,); 0 unless relaxed.
        statuses: How each step ended.
        limited_by: What held each step back.
        end: The last step.
    """

    period: float
    X: Array
    velocities: Array
    residuals: Array
    errors: Array
    margins: Mapping[str, Array]
    relaxations: Array
    statuses: tuple[TrackStatus, ...]
    limited_by: tuple[tuple[str, ...], ...]
    end: TrackStep
