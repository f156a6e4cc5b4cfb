"""The state of a mechanism at a configuration: mobility, ranks, conditions, redundancy, distance to singularities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.margins import Determinants, smallest_and_volume
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.ranks import Rank, compute_rank, independent_rows
from paraopt.kinematics.samples import SampleOptions, find_general_state, split_columns, useful_motions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Condition:
    """Hold one condition on the matrices, with the numbers that decide it.

    Attributes:
        name: Number of the equation in the source, such as "II.23".
        statement: What is compared, such as "rg(K) = r".
        left: Value of the left side.
        right: Value of the right side.
        holds: Whether the statement is true.
        verdict: What this means for the machine.

    Source: Lahouar, II.22; Lahouar, II.27.
    """

    name: str
    statement: str
    left: int
    right: int
    holds: bool
    verdict: str

    def __str__(self) -> str:
        return f"{self.name:5} {self.statement:24} {self.left:3d}, {self.right:3d}  {self.verdict}"


@dataclass(frozen=True, eq=False)
class StateReport:
    """Report what the closure equations say at one configuration.

    Attributes:
        mechanism_name: Name of the mechanism.
        variables: Names of the variables by role: "active", "passive", "operational".
        n_equations: Number of closure equations.
        ranks: Ranks of the scaled matrices "E", "M", "N", "K", "[N K]" and "[M N]".
        general_ranks: The same at configurations around this one, the largest found: a smaller rank here is singular.
        mobility: Degrees of freedom `m = N - rg(E)`.
        internal_mobility: Motions of passive variables alone, as spins of legs, in general.
        idle: Names of the passive variables that take part in them.
        redundant_rows: Number of equations beyond the rank of E here; over-constrained are machines that have some in
            general, see `is_over_constrained`.
        independent_rows: Indices of a subset of equations that spans all of them.
        conditions: The conditions II.22 to II.27 of the source.
        parallel_margin: Distance to a parallel singularity in [0, 1]; see `MotionSpace`.
        serial_margin: Distance to a serial singularity in [0, 1].
        parallel_determinant: Signed, normalised determinant of [N K]; nan when it is not square.
        serial_determinant: Signed, normalised determinant of [M N]; nan when it is not square.

    Source: Lahouar, II.2.
    """

    mechanism_name: str
    variables: Mapping[str, tuple[str, ...]]
    n_equations: int
    ranks: Mapping[str, Rank]
    general_ranks: Mapping[str, int]
    mobility: int
    internal_mobility: int
    idle: tuple[str, ...]
    redundant_rows: int
    independent_rows: NDArray[np.intp]
    conditions: tuple[Condition, ...]
    parallel_margin: float
    serial_margin: float
    parallel_determinant: float
    serial_determinant: float

    @property
    def n_variables(self) -> int:
        """Give the number of variables N."""
        return sum(len(names) for names in self.variables.values())

    @property
    def useful_mobility(self) -> int:
        """Give the degrees of freedom that are not internal."""
        return self.mobility - self.internal_mobility

    @property
    def over_constraint(self) -> int:
        """Give the number of equations that repeat others in general, singular places not counted."""
        return self.n_equations - self.general_ranks["E"]

    @property
    def is_over_constrained(self) -> bool:
        """Tell whether some equations repeat others in general; the machine moves only because its dimensions fit."""
        return self.over_constraint > 0

    @property
    def is_redundant(self) -> bool:
        """Tell whether drives can in general move while everything else rests (II.24)."""
        return self.general_ranks["M"] < len(self.variables["active"])

    @property
    def is_redundantly_actuated(self) -> bool:
        """Tell whether there are more drives than freedoms, so that drives can work against each other."""
        return len(self.variables["active"]) > self._general_mobility

    @property
    def is_under_actuated(self) -> bool:
        """Tell whether the drives are fewer than the freedoms, or than the operational variables need (II.25)."""
        too_few = self.general_ranks["M"] < len(self.variables["operational"])
        return too_few or len(self.variables["active"]) < self._general_mobility

    @property
    def _general_mobility(self) -> int:
        """Give the useful mobility where no closure is singular."""
        return self.n_variables - self.general_ranks["E"] - self.internal_mobility

    @property
    def is_doubtful(self) -> bool:
        """Tell whether some rank hangs on the tolerance: a near-singular place, or a badly scaled description."""
        return any(rank.is_doubtful for rank in self.ranks.values())

    @property
    def kind(self) -> str:
        """Say in words how the drives relate to the freedoms: a property of the machine, not of the configuration."""
        words = {
            "under-actuated": self.is_under_actuated,
            "redundant": self.is_redundant,
            "redundantly actuated": self.is_redundantly_actuated,
            f"over-constrained by {self.over_constraint}": self.is_over_constrained,
        }
        return ", ".join(word for word, applies in words.items() if applies) or "as many drives as freedoms"

    def condition(self, name: str) -> Condition:
        """Find a condition by the number of its equation, such as "II.23"."""
        return next(c for c in self.conditions if c.name == name)

    def __str__(self) -> str:
        ranks = ", ".join(f"rg {name} = {rank.value}" for name, rank in self.ranks.items())
        doubtful = [
            f"{n} (values {r.smallest_kept:.1e} and {r.largest_dropped:.1e} about the cut at {r.cut:.1e})"
            for n, r in self.ranks.items()
            if r.is_doubtful
        ]
        lost = [f"{n} has {r.value} of {self.general_ranks[n]}" for n, r in self.ranks.items()
                if r.value < self.general_ranks[n]]  # fmt: skip
        lines = [
            f"{self.mechanism_name}: {self.n_variables} variables, {self.n_equations} equations, {ranks}",
            f"mobility {self.mobility} = {self.useful_mobility} useful + {self.internal_mobility} idle "
            f"{list(self.idle)}, {self.redundant_rows} redundant equations, rank gap {self.ranks['E'].gap:.1e}",
            f"drives: {self.kind}",
            f"parallel margin {self.parallel_margin:.4f}, serial margin {self.serial_margin:.4f}",
        ]
        if lost:
            lines.append(f"singular: {', '.join(lost)} in general")
        if doubtful:
            lines.append(f"doubtful ranks: {', '.join(doubtful)}")
        return "\n".join([*lines, *(f"  {c}" for c in self.conditions)])


def report_state(
    kinematics: Kinematics, configuration: Configuration, samples: SampleOptions | None = None
) -> StateReport:
    """Analyse the closure equations at a configuration.

    Args:
        kinematics: The mechanism's functions.
        configuration: Where to analyse.
        samples: Configurations around it that stand for the general case.

    Returns:
        Variables, mobility, ranks on the scaled matrices, conditions, and distances to singularities.

    Source: Lahouar, II.21; Lahouar, II.22; Lahouar, II.23; GosselinAngeles1990.
    """
    mechanism = kinematics.mechanism
    general = find_general_state(kinematics, configuration, samples)
    (E,) = kinematics.functions.scaled_jacobian(configuration.X)
    ranks = {name: compute_rank(stack[0], whole=E) for name, stack in split_columns(kinematics, E[None]).items()}
    motions = useful_motions(kinematics, E, general.internal)
    roles = {"active": mechanism.active, "passive": mechanism.passive, "operational": mechanism.operational}
    margins = [
        float(smallest_and_volume(motions[None, mechanism.indices(roles[role])])[0][0])
        for role in ("active", "operational")
    ]
    parallel, serial = Determinants.at(kinematics, configuration)(configuration.X)
    mobility = E.shape[1] - ranks["E"].value
    return StateReport(
        mechanism_name=mechanism.name,
        variables={role: tuple(names) for role, names in roles.items()},
        n_equations=E.shape[0],
        ranks=ranks,
        general_ranks=general.ranks,
        mobility=mobility,
        internal_mobility=general.internal,
        idle=general.idle,
        redundant_rows=E.shape[0] - ranks["E"].value,
        independent_rows=independent_rows(E),
        conditions=_judge_conditions(ranks, mobility, len(mechanism.active), len(mechanism.operational)),
        parallel_margin=margins[0],
        serial_margin=margins[1],
        parallel_determinant=float(parallel[0]),
        serial_determinant=float(serial[0]),
    )


def _judge_conditions(ranks: Mapping[str, Rank], m: int, a: int, r: int) -> tuple[Condition, ...]:
    """Judge II.22 to II.27: m the mobility, a the number of drives, r that of the operational variables."""
    M, N, K = (ranks[name].value for name in ("M", "N", "K"))
    NK, MN = ranks["[N K]"].value, ranks["[M N]"].value

    def judge(name: str, statement: str, left: int, right: int, holds: bool, yes: str, no: str) -> Condition:
        return Condition(name, statement, left, right, holds, yes if holds else no)

    return (
        judge("II.22", "m >= a", m, a, m >= a, "the drives can be commanded freely",
              "more drives than freedoms: they must move in agreement"),
        judge("II.23", "rg(K) = r", K, r, r == K, "the operational variables rest when all else rests",
              "some operational variable enters no equation, or a singularity: choose fewer"),
        judge("II.24", "rg(M) < a", M, a, a > M, "redundant: drives can move while all else rests",
              "no drive moves alone"),
        judge("II.25", "rg(M) < r", M, r, r > M, "under-actuated: more operational variables than the drives can move",
              "the drives can move as many variables as are operational"),
        judge("II.26", "rg[N K] = rg(N) + r", NK, N + r, N + r == NK, "the platform is held when the drives are",
              "dangerous: the platform can move with blocked drives"),
        judge("II.27", "rg[M N] = rg(M) + rg(N)", MN, M + N, MN == M + N, "the drives are held when the platform is",
              "drives can move with a blocked platform: serial singularity, or redundancy"),
    )  # fmt: skip
