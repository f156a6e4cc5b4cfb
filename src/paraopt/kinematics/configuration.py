"""A configuration: values of all variables that close the loops, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import SolveError
from paraopt.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class Configuration:
    """Hold a closed configuration; it cannot be built with a residual above its tolerance.

    Attributes:
        mechanism: The mechanism.
        X: Values of all variables in the order active, passive, operational [m or rad], read-only.
        residual: Largest closure residual, lengths divided by the characteristic length [1].
        tolerance: Bound on the residual [1].

    Raises:
        SolveError: The residual is above the tolerance, or a value is not finite.
    """

    mechanism: Mechanism
    X: NDArray[np.float64]
    residual: float
    tolerance: float = 1e-10

    def __post_init__(self) -> None:
        X = np.array(self.X, dtype=float)
        if X.shape != (len(self.mechanism.names),):
            raise SolveError(f"configuration of {self.mechanism.name!r} has shape {X.shape}", X=X)
        if not np.all(np.isfinite(X)) or not self.residual <= self.tolerance:
            raise SolveError(
                f"loops of {self.mechanism.name!r} are open: scaled closure residual is {self.residual:.3g}, "
                f"the bound is {self.tolerance:.3g}; solve for a configuration first",
                X=X,
                residual=self.residual,
            )
        X.flags.writeable = False
        object.__setattr__(self, "X", X)

    def __getitem__(self, name: str) -> float:
        return float(self.X[self.mechanism.index(name)])

    def __iter__(self) -> Iterator[str]:
        return iter(self.mechanism.names)

    @property
    def active(self) -> NDArray[np.float64]:
        """Give the active variables q_a [m or rad], shape (n_active,)."""
        return self.X[: len(self.mechanism.active)]

    @property
    def passive(self) -> NDArray[np.float64]:
        """Give the passive variables q_p [m or rad], shape (n_passive,)."""
        return self.X[len(self.mechanism.active) : -len(self.mechanism.operational)]

    @property
    def operational(self) -> NDArray[np.float64]:
        """Give the operational variables x [m or rad], shape (n_operational,)."""
        return self.X[-len(self.mechanism.operational) :]

    def as_dict(self) -> dict[str, float]:
        """Give the values by name."""
        return {name: float(value) for name, value in zip(self.mechanism.names, self.X, strict=True)}
