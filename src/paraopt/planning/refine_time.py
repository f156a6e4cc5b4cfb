"""Minimum-time refinement: geometry and timing chosen together, and never slower than one after the other."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from paraopt.errors import DefinitionError, RefineError, RetimeError
from paraopt.planning.objective import Objective
from paraopt.planning.problem import Problem
from paraopt.planning.refine import Refined, SplineRefiner
from paraopt.planning.retime_base import Retimer
from paraopt.planning.retime_toppra import TimeOptimal
from paraopt.planning.seed import Seed


@dataclass(frozen=True)
class MinimumTime(SplineRefiner):
    """Refine a seed into the path that is run in the least time near it.

    The best path of `objective` comes first. From there the path and its squared speeds at the samples are chosen
    together, so that the duration is least under the velocity and acceleration limits of the actuators. Both paths are
    timed by a retimer, and the faster one is kept.

    Attributes:
        time: What is made small in the second step.
        time_iterations: Bound on IPOPT's iterations in that step; a path that is not yet the fastest counts too.
        retimer: What times the paths.
    """

    time: Objective = field(default_factory=lambda: Objective(length=0.2, time=1.0, evenness=0.3))
    time_iterations: int = 120
    retimer: Retimer = field(default_factory=TimeOptimal)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.time.time > 0:
            raise DefinitionError("time weighs nothing in the objective of the minimum-time step")
        if self.time_iterations < 1:
            raise DefinitionError(f"time_iterations is {self.time_iterations}; it must be at least 1")

    def refine(self, problem: Problem, seed: Seed, warm: Refined | None = None) -> Refined:
        """Refine a seed.

        Args:
            problem: The problem, with velocity and acceleration limits of all actuators.
            seed: Its seed.
            warm: What was found for a problem that differs little.

        Returns:
            The faster of both paths, with its `duration`; as `SplineRefiner` otherwise.

        Raises:
            RefineError: Not even the first step found a path.
            RetimeError: Its path cannot be timed.
        """
        first = super().refine(problem, seed, warm)
        law = self.retimer.retime(problem, first.path).law
        s = first.path.anchors
        first = replace(first, duration=law.duration, speeds=(s, law(law.time_at(s), 1) ** 2))
        options = {name: getattr(self, name) for name in SplineRefiner.__dataclass_fields__}
        options |= {"objective": self.time, "backend": "ipopt"}
        options |= {"iterations": self.time_iterations, "rounds": min(self.rounds, 3)}
        try:
            second = SplineRefiner(**options).refine(problem, seed, first)
            duration = self.retimer.retime(problem, second.path).duration
        except (RefineError, RetimeError):  # nothing faster was found
            return first
        second = replace(
            second,
            duration=duration,
            iterations=first.iterations + second.iterations,
            rounds=first.rounds + second.rounds,
            evaluations=first.evaluations + second.evaluations,
        )
        return second if np.isfinite(duration) and duration < first.duration else first
