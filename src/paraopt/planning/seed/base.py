"""What every seeder returns: a chain of valid configurations from the start to the goal."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from paraopt.planning.problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Seed:
    """Hold a polyline from start to goal in the independent coordinates.

    Attributes:
        problem: The problem it answers.
        points: Corners of the polyline, shape (k, m), angles unwrapped.
        X: Closed configurations at the corners, shape (k, n_variables).
        explored: Positions that were found valid, shape (n, m).
        blocked: Positions that were found not valid, shape (n, m).
        switches: Positions where the search changed between depth and breadth, shape (n, m).
        checks: Number of poses that were judged.
        step: Step of the grid [m].
        straight_reason: What blocks the straight motion from start to goal; "valid" when nothing does.
    """

    problem: Problem
    points: Array
    X: Array
    explored: Array = field(repr=False)
    blocked: Array = field(repr=False)
    switches: Array = field(repr=False)
    checks: int = 0
    step: float = 0.0
    straight_reason: str = "valid"

    @cached_property
    def length(self) -> float:
        """Give the length in the problem's metric [m]."""
        return float(np.sum(np.linalg.norm(np.diff(self.points * self.problem.metric, axis=0), axis=1)))

    @property
    def arc(self) -> Array:
        """Give the share of the length reached at each corner, from 0 to 1; shape (k,)."""
        steps = np.linalg.norm(np.diff(self.points * self.problem.metric, axis=0), axis=1)
        total = np.concatenate([[0.0], np.cumsum(steps)])
        return total / total[-1] if total[-1] > 0 else np.linspace(0.0, 1.0, len(total))

    def at(self, s: Array) -> Array:
        """Interpolate the polyline at shares of its length; shape (n, m)."""
        arc = self.arc
        return np.column_stack([np.interp(s, arc, self.points[:, j]) for j in range(self.points.shape[1])])


class Seeder(Protocol):
    """Find a first way from start to goal."""

    def seed(self, problem: Problem) -> Seed:
        """Search a chain of valid configurations, or raise an error that says why there is none."""
        ...
