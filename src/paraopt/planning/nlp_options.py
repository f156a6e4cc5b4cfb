"""What may be chosen for a refinement: the spline, the objective, the barriers, the conditions, the solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.planning.condition import PathBound, PathCondition
from paraopt.planning.nlp_spline import ToolPath, Waypoint
from paraopt.planning.objective import Objective
from paraopt.planning.problem import Problem
from paraopt.planning.seed import Seed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NlpOptions:
    """Choose the spline, the objective, the barriers and the solver of a refinement.

    Attributes:
        controls: Number of control points; chosen from the seed when None.
        degree: Degree of the spline, at least 3.
        samples_per_control: Samples for each control point.
        objective: What a path should be good at.
        barrier: Weight of the barriers at first [1].
        final_barrier: Weight to which they are driven down, by factors of a hundred; it decides the result, the first
            weight does not.
        horizon: Distance at which the distance barrier begins [m]; four times the clearance, and at least a hundredth
            of the machine's size, when None.
        rest: Whether the first derivative of the path vanishes at both ends, instead of being free.
        waypoints: Places to pass through, in their order.
        tool_paths: Curves to follow exactly, in their order.
        constraints: Bounds of the user's own.
        backend: "sqp" (sequential quadratic programs, by OSQP), or "ipopt" (interior points).
        iterations: Bound on the solver's iterations.
        tolerance: Convergence tolerance of the solver.
    """

    controls: int | None = None
    degree: int = 3
    samples_per_control: int = 3
    objective: Objective = field(default_factory=Objective)
    barrier: float = 1e-4
    final_barrier: float = 1e-6
    horizon: float | None = None
    rest: bool = False
    waypoints: Sequence[Waypoint] = ()
    tool_paths: Sequence[ToolPath] = ()
    constraints: Sequence[PathBound | PathCondition] = ()
    backend: Literal["sqp", "ipopt"] = "sqp"
    iterations: int = 120
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        if self.degree < 3:
            raise DefinitionError(f"degree of the spline is {self.degree}; accelerations need at least 3")
        if self.controls is not None and self.controls < self.degree + 1:
            raise DefinitionError(f"number of control points is {self.controls}; it must be at least {self.degree + 1}")
        for name in ("samples_per_control", "iterations"):
            if getattr(self, name) < 1:
                raise DefinitionError(f"{name} is {getattr(self, name)}; it must be at least 1")
        for name, label in (("barrier", "barrier weight"), ("final_barrier", "final barrier weight")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise DefinitionError(f"{label} is {value}; it must be finite and not negative")
        for name in ("horizon", "tolerance"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise DefinitionError(f"{name} is {value}; it must be finite and above 0")
        if self.backend not in ("ipopt", "sqp"):
            raise DefinitionError(f"backend is {self.backend!r}; it must be 'ipopt' or 'sqp'")
        for name in ("waypoints", "tool_paths", "constraints"):
            object.__setattr__(self, name, tuple(getattr(self, name)))

    def count_controls(self, seed: Seed) -> int:
        """Give the number of control points for a seed: four more for each of its corners."""
        return self.controls or int(np.clip(8 + 4 * (len(seed.points) - 2), max(8, self.degree + 1), 24))

    def choose_horizon(self, problem: Problem) -> float:
        """Give the distance at which the distance barrier begins [m]."""
        if self.horizon is not None:
            return self.horizon
        return max(4.0 * problem.margins.clearance, 0.01 * problem.robot.mechanism.length)

    @property
    def weights(self) -> tuple[float, ...]:
        """Give the weights of the barriers, one for each solution."""
        weights = [self.barrier]
        while weights[-1] > self.final_barrier:
            lower = 1e-2 * weights[-1]
            # no further round for what round-off leaves above the final weight
            weights.append(lower if lower > self.final_barrier * (1.0 + 1e-9) else self.final_barrier)
        return tuple(weights)


@dataclass(frozen=True)
class Slack:
    """Hold what is added to the margins at the samples so that they hold between them.

    Attributes:
        clearance: A number, or one for each inner sample [m].
        singularity: Likewise [1].
        range: Likewise, in characteristic lengths or radians.
        condition: Likewise, for conditions, over their scales.
    """

    clearance: float | Array = 0.0
    singularity: float | Array = 0.0
    range: float | Array = 0.0
    condition: float | Array = 0.0
