"""Singularities of a cable robot: rank lost, tensions at zero, equilibria that stop being stable."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from paraopt.errors import BackendError, DefinitionError
from paraopt.modes.cable.equilibrium import EquilibriumOptions, Stability, judge_stability
from paraopt.modes.cable.facets import capacity_margins, scale_moments
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.statics import check_feasibility
from paraopt.modes.cable.wrench import cable_functions

logger = logging.getLogger("paraopt")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StateOptions:
    """Hold what counts as singular.

    Attributes:
        rank: Singular value of the scaled wrench matrix, over the largest, below which rank is lost [1].
        slack: Tension below which a cable counts as slack, as a share of the mean largest tension [1].
        stability: Least curvature of the energy that counts as stable, over weight times length [1].
    """

    rank: float = 1e-9
    slack: float = 1e-9
    stability: float = 1e-9

    def __post_init__(self) -> None:
        for name in ("rank", "slack", "stability"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise DefinitionError(f"{name} tolerance is {getattr(self, name)!r}; it must be in (0, 1)")


@dataclass(frozen=True, eq=False)
class CableState:
    """Tell how a cable robot stands at one pose.

    Attributes:
        robot: The cable robot.
        pose: The pose, shape (dof,).
        singular_values: Singular values of W with moments over the characteristic length, shape (min(dof, n),).
        lost: Unit directions of wrench that no cable gives, in force and moment over the characteristic length, shape
            (dof - rank, dof); they are also those of free motions, with turns times the length.
        hangs: Whether there are fewer cables than freedoms, so that weight holds the rest.
        balanced: Whether tensions of any sign balance weight and load.
        least_tension: Largest value that the least tension can have, whatever the upper limits [N]; at zero some cable
            goes slack, and below it some would have to push. Inf where cables pull against each other, so that all
            tensions can grow together; nan where the platform is not balanced.
        slack: Names of the cables that keep it from growing, where it is not above zero.
        feasible: Whether tensions within their limits balance them.
        margin: Capacity margin [N] where there are enough cables; else the least distance of a tension to a limit.
        stability: Second variation of the energy along motions that keep the lengths; None where there is no such
            motion, where the platform is not balanced, or where weight and load have no energy.
        options: What counts as singular.
    """

    robot: CableRobot
    pose: Array
    singular_values: Array
    lost: Array
    hangs: bool
    balanced: bool
    least_tension: float
    slack: tuple[str, ...]
    feasible: bool
    margin: float
    stability: Stability | None
    options: StateOptions

    @property
    def loses_rank(self) -> bool:
        """Tell whether W has less rank than the number of cables and of freedoms allow."""
        return len(self.lost) > self.robot.dof - len(self.singular_values)

    @property
    def findings(self) -> tuple[str, ...]:
        """Tell what is singular, one sentence for each; none at a regular pose."""
        found = []
        if self.loses_rank:
            names = self.robot.wrench_names
            for direction in self.lost:
                parts = [f"{v:+.3f} {n}" for v, n in zip(direction, names, strict=True) if abs(v) > 1e-3]
                found.append(f"the wrench matrix loses rank: no cable acts along {' '.join(parts)}")
        if not self.balanced:
            found.append("no tensions, of whatever sign, balance weight and load")
        for cable in self.slack:
            if self.least_tension < -self._slack_level:
                found.append(f"cable {cable!r} would have to push, with {-self.least_tension:.4g} N at least")
            else:
                found.append(f"the tension of cable {cable!r} reaches zero")
        if self.balanced and not self.feasible:
            found.append(f"no tensions within their limits balance weight and load (margin {self.margin:.4g} N)")
        # beyond its limits a cable still holds, as long as it pulls
        pulls = self.least_tension >= -self._slack_level
        if self.stability is not None and pulls and not self.stability.is_stable:
            least = f"the energy's least curvature is {self.stability.least:.4g} of weight times length"
            found.append(f"the equilibrium is {self.stability.verdict}: {least}")
        return tuple(found)

    @property
    def is_singular(self) -> bool:
        """Tell whether anything is found."""
        return bool(self.findings)

    @property
    def _slack_level(self) -> float:
        return self.options.slack * float(np.mean(self.robot.t_max))

    def __str__(self) -> str:
        heading = f"{self.robot.name}: least singular value {self.singular_values[-1]:.4g}, margin {self.margin:.4g} N"
        return "\n".join([heading, *(f"  {finding}" for finding in self.findings or ("regular",))])


def report_cable_state(robot: CableRobot, pose: ArrayLike, options: StateOptions | None = None) -> CableState:
    """Report what is singular at a pose at rest, each kind as such.

    * The wrench matrix loses rank: some wrench can be balanced by no tensions, and some motion changes no length.
    * The tension of a cable reaches zero: whatever the tensions that balance weight and load, some cable does not pull.
    * The equilibrium loses its stability: along a motion that keeps all lengths, the energy has no curvature.

    Args:
        robot: The cable robot.
        pose: Values of its coordinates [m, rad], shape (dof,).
        options: What counts as singular.

    Returns:
        The report.

    Raises:
        DefinitionError: The pose has another size.
    """
    options = options or StateOptions()
    point = robot.check_poses(pose)
    functions = cable_functions(robot)
    W, w = functions.both(point)
    A, b = scale_moments(W[0].T, robot.length_scale).T, scale_moments(w[0], robot.length_scale)
    U, values, _ = np.linalg.svd(A)
    rank = int(np.sum(values > options.rank * values[0]))
    lost = U[:, rank:].T
    hangs = robot.n_cables < robot.dof
    verdict = check_feasibility(robot, point[0])
    balanced = bool(np.isfinite(verdict.margin))
    least = np.nan
    slack: tuple[str, ...] = ()
    if balanced:
        least, binding = _raise_least(U[:, :rank].T @ A, U[:, :rank].T @ b)
        if least <= options.slack * float(np.mean(robot.t_max)):
            slack = tuple(c for c, holds in zip(robot.cables, binding, strict=True) if holds)
    margin = verdict.margin if hangs else float(capacity_margins(robot, point)[0])
    stability = None
    if balanced and rank < robot.dof:
        stability = _judge(robot, point[0], verdict.tensions, options.stability)
    return CableState(
        robot, point[0], values, lost, hangs, balanced, least, slack, verdict.is_feasible, margin, stability, options
    )


def _raise_least(A: Array, b: Array) -> tuple[float, NDArray[np.bool_]]:
    """Give the largest least tension that balances b, and which cables keep it from growing.

    maximise s   subject to   A t + b = 0,   t >= s
    """
    d, n = A.shape
    goal, above = np.append(np.zeros(n), -1.0), np.hstack([-np.eye(n), np.ones((n, 1))])
    grown = np.block([[A, np.zeros((d, 1))], [np.ones((1, n)), np.zeros((1, 1))]])
    # tensions that balance nothing, all of them positive, can be added without end
    inner = linprog(goal, above, np.zeros(n), grown, np.append(np.zeros(d), 1.0), (None, None), method="highs")
    if inner.status == 0 and -inner.fun > 1e-9:
        return np.inf, np.zeros(n, dtype=bool)
    size = float(np.linalg.norm(b)) or 1.0  # the solver's tolerances are absolute
    solved = linprog(goal, above, np.zeros(n), grown[:-1], -b / size, (None, None), method="highs")
    if inner.status not in (0, 2) or solved.status != 0:
        raise BackendError(f"HiGHS found no largest tensions: {solved.message}", A=A, b=b)
    return -float(solved.fun) * size, np.abs(solved.ineqlin.marginals) > 1e-9


def _judge(robot: CableRobot, point: Array, tensions: Array, tolerance: float) -> Stability | None:
    """Judge the stability by the energy; None where weight and load have none."""
    try:
        return judge_stability(robot, point, tensions, EquilibriumOptions(stability=tolerance))
    except DefinitionError as error:
        logger.info("stability of %r is not judged: %s", robot.name, error)
        return None
