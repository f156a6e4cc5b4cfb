"""The answer of a model, with everything needed to trust it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import SolveError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.ranks import Rank
from paraopt.kinematics.solve import Status
from paraopt.mechanism import Mechanism

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solution:
    """Hold the answer of a model, with everything needed to trust it.

    Attributes:
        mechanism: The mechanism.
        X: Final values of all variables [m or rad], shape (n_variables,).
        status: How the solve ended.
        residual: Largest scaled closure residual [1].
        rank: Rank of the columns that were solved for.
        undetermined: Number of motions, beyond idle ones, that the imposed variables leave free.
        imposed: Imposed values by name.
        deviation: Obtained minus imposed values by name; zero when converged.
        out_of_range: Names of the variables outside their ranges.
        iterations: Number of iterations.
        at_bound: Names of the variables that lie at an end of their range and are held there, when nearest.
        distance: Weighted distance between imposed and obtained values, in characteristic lengths and radians [1].
        solver: What gave the answer: "newton", "sqp" or "ipopt".
    """

    mechanism: Mechanism
    X: Array
    status: Status
    residual: float
    rank: Rank
    undetermined: int
    imposed: Mapping[str, float]
    deviation: Mapping[str, float]
    out_of_range: tuple[str, ...]
    iterations: int
    at_bound: tuple[str, ...] = ()
    distance: float = 0.0
    solver: str = "newton"

    @property
    def configuration(self) -> Configuration:
        """Give the closed configuration with the imposed values.

        Raises:
            SolveError: The solve did not converge; the message tells status, residual and rank.
        """
        if self.status in (Status.FAILED, Status.NEAREST):
            raise SolveError(self.summary, solution=self)
        return Configuration(self.mechanism, self.X, self.residual)

    @property
    def nearest(self) -> Configuration:
        """Give the closed configuration, also when it misses the imposed values.

        Raises:
            SolveError: The loops could not be closed.
        """
        if self.status is Status.FAILED:
            raise SolveError(self.summary, solution=self)
        return Configuration(self.mechanism, self.X, self.residual)

    @property
    def summary(self) -> str:
        """Say in one sentence how the solve ended."""
        worst = max(self.deviation, key=lambda k: abs(self.deviation[k]), default=None)
        miss = ""
        if worst is not None and self.status in (Status.NEAREST, Status.FAILED):
            got = self.imposed[worst] + self.deviation[worst]
            unit = next(v.unit for v in self.mechanism.variables if v.name == worst)
            miss = f"; {worst!r} wanted {self.imposed[worst]:.6g} {unit}, nearest {got:.6g} {unit}"
        if self.at_bound:
            miss += f"; at the end of their range: {', '.join(map(repr, self.at_bound))}"
        return (
            f"{self.mechanism.name!r}: {self.status.value} (scaled residual {self.residual:.2g}, "
            f"rank {self.rank.value}, undetermined {self.undetermined}){miss}"
        )
