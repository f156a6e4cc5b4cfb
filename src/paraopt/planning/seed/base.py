"""What every seeder returns: a chain of valid configurations from the start to the goal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.planning.ground import Ground, Spot
from paraopt.planning.problem import Problem
from paraopt.planning.validity import Validity, check_ends, compare_configurations

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
        queued: Positions that were found valid and still waited to be looked at, shape (n, m).
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
    queued: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)

    @classmethod
    def along(
        cls,
        ground: Ground,
        spots: Sequence[Spot],
        *,
        step: float,
        straight_reason: str,
        switches: Sequence[Array] = (),
        queued: Sequence[Array] = (),
    ) -> Seed:
        """Collect what a search has found.

        Args:
            ground: Where it looked.
            spots: The way.
            step: Step of the search [m].
            straight_reason: What blocks the straight motion.
            switches: Positions where it changed its mode.
            queued: Positions that it had not looked at yet.
        """
        m = len(ground.problem.independent)
        explored, blocked, turns, waiting = (
            np.array(part, dtype=float).reshape(-1, m) for part in (ground.explored, ground.blocked, switches, queued)
        )
        return cls(
            ground.problem,
            np.array([spot.value for spot in spots]),
            np.array([spot.X for spot in spots]),
            explored,
            blocked,
            turns,
            ground.validity.checks,
            step,
            straight_reason,
            waiting,
        )

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


def begin_search(problem: Problem) -> tuple[Validity, float]:
    """Judge both ends, as every seeder does before it searches.

    Args:
        problem: The problem.

    Returns:
        The judge, and the distance between the ends in the problem's metric [m].

    Raises:
        InfeasibleError: The start or the goal is not valid, or they lie on different branches.
        DefinitionError: They are the same.
    """
    validity = Validity(problem)
    check_ends(problem, validity)
    start, goal = problem.start_configuration, problem.goal_configuration
    distance = float(np.linalg.norm((problem.goal_values() - start.X[problem.index]) * problem.metric))
    if distance == 0.0 and compare_configurations(problem, start.X, goal.X)[1] < 1e-9:
        raise DefinitionError("start and goal are the same pose: there is nothing to plan", start=start, goal=goal)
    return validity, distance


def choose_step(problem: Problem, distance: float) -> float:
    """Choose the step of a search: an eighth of the distance, but no small share of the machine's size [m]."""
    length = problem.characteristic_length or problem.robot.mechanism.length
    if distance < 1e-9 * length:  # two solutions of the same coordinates: the way between them leads far away
        return length / 8.0
    return max(distance / 8.0, length / 32.0)


def try_straight(ground: Ground) -> tuple[str, Spot | None]:
    """Check the straight motion from start to goal; see `Ground.edge`."""
    origin = ground.origin
    reason, last = ground.edge(origin, ground.toward(origin.value, ground.problem.goal_values()))
    if last is not None and not ground.is_goal(last):
        return "branch", None
    return reason, last


def sample_region(problem: Problem, random: np.random.Generator, count: int, reach: float) -> Array:
    """Draw positions around start and goal.

    Args:
        problem: The problem.
        random: Source of random numbers.
        count: How many.
        reach: How far beyond the box of start and goal, in the problem's metric [m]; ranges and full turns bound it.

    Returns:
        Positions, uniform in the box, shape (count, m).
    """
    start, goal = problem.start_configuration.X[problem.index], problem.goal_values()
    beyond = reach / problem.metric
    low, high = np.minimum(start, goal) - beyond, np.maximum(start, goal) + beyond
    # half a turn to both sides of the middle holds every angle once
    middle = 0.5 * (start + goal)
    low = np.where(problem.periodic, np.maximum(low, middle - np.pi), low)
    high = np.where(problem.periodic, np.minimum(high, middle + np.pi), high)
    lower, upper = (bound[problem.index] for bound in problem.bounds.bounds(problem.robot.mechanism))
    return random.uniform(np.maximum(low, lower), np.minimum(high, upper), size=(count, len(start)))


def check_options(**options: float) -> None:
    """Refuse options of a seeder that are not finite and above 0.

    Raises:
        DefinitionError: The message names the option and its value.
    """
    for name, value in options.items():
        if not (np.isfinite(value) and value > 0):
            raise DefinitionError(f"{name} of the search is {value}; it must be finite and above 0")
