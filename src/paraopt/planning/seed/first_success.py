"""Several seeders in turn: the first that finds a way gives it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from paraopt.errors import BudgetExceededError, DefinitionError, NoPathError
from paraopt.planning.problem import Problem
from paraopt.planning.seed.base import Seed, Seeder


@dataclass(frozen=True)
class FirstSuccess:
    """Try seeders in turn.

    Attributes:
        seeders: The seeders, the one to be tried first first.
    """

    seeders: Sequence[Seeder]

    def __post_init__(self) -> None:
        object.__setattr__(self, "seeders", tuple(self.seeders))
        if not self.seeders:
            raise DefinitionError("there is no seeder to try; name at least one")

    def seed(self, problem: Problem) -> Seed:
        """Give the way of the first seeder that finds one.

        Args:
            problem: The problem.

        Returns:
            Its seed.

        Raises:
            InfeasibleError: The problem cannot have a solution as stated: no seeder is asked any more.
            NoPathError: None found a way, and one says that there is none at its step.
            BudgetExceededError: None found a way within its budget.
        """
        failures: list[NoPathError | BudgetExceededError] = []
        for seeder in self.seeders:
            try:
                return seeder.seed(problem)
            except (NoPathError, BudgetExceededError) as error:
                failures.append(error)
        told = "; ".join(f"{type(s).__name__}: {e}" for s, e in zip(self.seeders, failures, strict=True))
        proofs = [e for e in failures if isinstance(e, NoPathError)]
        evidence = {**(proofs or failures)[-1].evidence, "failures": tuple(failures)}
        kind = NoPathError if proofs else BudgetExceededError
        raise kind(f"none of {len(failures)} seeders found a way. {told}", **evidence)
