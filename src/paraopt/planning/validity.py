"""Whether a pose may be part of a motion, for batches: closures on the same branch, limits, margins, clearance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.kinematics import Configuration, SolveOptions, report_state
from paraopt.kinematics import Margins as SingularityMargins
from paraopt.kinematics.ranks import compute_rank
from paraopt.planning.problem import Problem

Array = NDArray[np.float64]

VALID = "valid"


@dataclass(frozen=True, eq=False)
class Verdict:
    """Hold the judgement of n poses.

    Attributes:
        valid: Whether each pose may be used, shape (n,).
        X: Values of all variables at each pose, shape (n, n_variables).
        T: Motions `dX / d independent` where valid, else zero; shape (n, n_variables, m).
        reasons: "valid", or what is wrong first: "closure", "limit of ...", "condition ...",
            "branch", "singularity", "collision ...".
    """

    valid: NDArray[np.bool_]
    X: Array
    T: Array
    reasons: tuple[str, ...]


class Validity:
    """Judge poses of a problem in the independent coordinates.

    Cheap tests come first, and the later ones see only the poses that passed the earlier ones.

    Args:
        problem: The problem.
        reach: Largest departure of any variable from its linear prediction, in characteristic lengths or radians;
            beyond it the branch counts as lost.
        collisions: Whether solids count.
    """

    def __init__(self, problem: Problem, reach: float = 0.5, collisions: bool = True) -> None:
        self.problem = problem
        self.reach = reach
        self._near = bool(problem.scene.pairs) and collisions
        self.checks = 0
        self._low, self._high = problem.bounds.bounds(problem.robot.mechanism)
        self._independent = problem.index
        self._names = problem.robot.mechanism.names
        self._scale = problem.robot.kinematics.graph.variable_scale
        self._options = SolveOptions(iterations=25)
        self.conditions = problem.condition_set

    @cached_property
    def signs(self) -> tuple[float, float]:
        """Give the signs of the determinants of [N K] and [M N] at the start; nan where any sign is good."""
        parallel, serial = self.problem.determinants.signs(self.problem.start_configuration.X)
        return float(parallel[0]), float("nan") if self.problem.allow_mode_change else float(serial[0])

    @cached_property
    def level_names(self) -> tuple[str, ...]:
        """Name the quantities of `levels` as `judge` names what is wrong."""
        ranges = [f"limit of {self._names[i]}" for i in self._bounded]
        near = ["collision between positions"] if self._near else []
        return (*ranges, "singularity", "singularity", *self.conditions.names, *near)

    def levels(self, X: Array, T: Array) -> Array:
        """Measure how far n closed configurations are from their bounds, each in the quantity's own unit.

        Args:
            X: Configurations, shape (n, n_variables).
            T: Motions `dX / d independent` there.

        Returns:
            Distances from the bounds, not negative where valid, shape (n, n_levels).
        """
        problem = self.problem
        inside = np.minimum(X - self._low, self._high - X)[:, self._bounded] / self._scale[self._bounded]
        margins = problem.space.margins(X, T)
        columns = [inside, np.column_stack([margins.parallel, self._serial(margins)]) - problem.margins.singularity]
        if len(self.conditions):
            columns.append(self.conditions.levels(X))
        if self._near:
            columns.append(problem.scene.clearances(X)[0][:, None] - problem.margins.clearance)
        return np.hstack(columns)

    @cached_property
    def _bounded(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.isfinite(self._low) | np.isfinite(self._high))

    def _serial(self, margins: SingularityMargins) -> Array:
        return np.ones_like(margins.serial) if self.problem.allow_mode_change else margins.serial

    def judge(self, values: Array, starts: Array, tangents: Array) -> Verdict:
        """Solve and judge n poses.

        Args:
            values: Independent coordinates, shape (n, m).
            starts: A neighbouring configuration for each pose, shape (n, n_variables).
            tangents: Motions `dX / d independent` at the starts, shape (n, n_variables, m).

        Returns:
            The verdict.
        """
        predicted = starts + np.einsum("nvm,nm->nv", tangents, values - starts[:, self._independent])
        closed = self.problem.space.solve(values, predicted, self._options)
        n = len(closed.X)
        self.checks += n
        reasons = np.full(n, VALID, dtype=object)
        reasons[~closed.converged] = "closure"
        jump = np.max(np.abs(closed.X - predicted) / self._scale, axis=1)
        reasons[closed.converged & (jump > self.reach)] = "branch"
        return self._judge_closed(closed.X, reasons)

    def judge_configurations(self, X: Array) -> Verdict:
        """Judge n closed configurations, shape (n, n_variables)."""
        self.checks += len(X)
        return self._judge_closed(X, np.full(len(X), VALID, dtype=object))

    def _judge_closed(self, X: Array, reasons: NDArray[np.object_]) -> Verdict:
        problem = self.problem
        excess = np.maximum(self._low - X, X - self._high) / self._scale
        worst = np.argmax(excess, axis=1)
        for i in np.flatnonzero((reasons == VALID) & (np.max(excess, axis=1) > 1e-9)):
            reasons[i] = f"limit of {self._names[worst[i]]}"
        if len(self.conditions) and (left := np.flatnonzero(reasons == VALID)).size:
            levels = self.conditions.levels(X[left])
            lowest = np.argmin(np.where(np.isnan(levels), -np.inf, levels), axis=1)
            for i, k, level in zip(left, lowest, levels, strict=True):
                if not level[k] >= -1e-9:
                    reasons[i] = f"condition {self.conditions.names[k]}"
        if self._near and (left := np.flatnonzero(reasons == VALID)).size:
            for i, pair in zip(left, problem.scene.too_close(X[left], problem.margins.clearance), strict=True):
                if pair >= 0:
                    reasons[i] = f"collision {problem.scene.pairs[pair].name}"
        if (left := np.flatnonzero(reasons == VALID)).size:
            signs = problem.determinants.signs(X[left])
            wrong = np.any([(s != sign) & (sign == sign) for s, sign in zip(signs, self.signs, strict=True)], axis=0)
            reasons[left[wrong]] = "branch"
        T = np.zeros((*X.shape, len(self._independent)))
        if (left := np.flatnonzero(reasons == VALID)).size:
            T[left] = problem.space.tangent(X[left])
            margins = problem.space.margins(X[left], T[left])
            close = np.minimum(margins.parallel, self._serial(margins)) < problem.margins.singularity
            reasons[left[close]] = "singularity"
        return Verdict(reasons == VALID, X, T, tuple(reasons.tolist()))


def check_ends(problem: Problem, validity: Validity) -> None:
    """Refuse a problem whose start or goal is not valid, or whose ends lie on different branches.

    Args:
        problem: The problem.
        validity: Its judge.

    Raises:
        DefinitionError: The independent coordinates are not as many as the degrees of freedom.
        InfeasibleError: The message names the end, what is wrong there, the value and the bound. Evidence: the
            configuration, the reason, the determinants of [N K] and [M N] at both ends, and where the straight motion
            meets the singularity that parts them.
    """
    mobility = _count_freedoms(problem)
    if mobility != len(problem.independent):
        role = "actuators" if problem.allow_mode_change else "operational variables"
        role = role if problem.coordinates is None else "coordinates"
        held = f" with {len(problem.held)} variables held" if problem.held else ""
        raise DefinitionError(
            f"{problem.robot.name!r} has {mobility} useful degrees of freedom at the start{held}, but "
            f"{len(problem.independent)} {role} {list(problem.independent)}: a path in these does not "
            f"determine the motion; name as many {role} as there are degrees of freedom",
            mobility=mobility,
        )
    for label, configuration in (
        ("start", problem.start_configuration),
        ("goal", problem.goal_configuration),
    ):
        X = configuration.X[None, :]
        verdict = validity.judge_configurations(X)
        if verdict.valid[0]:
            continue
        reason = verdict.reasons[0]
        evidence: dict[str, object] = {"configuration": configuration, "reason": reason}
        text = _explain(problem, X, reason)
        if reason == "branch":
            crossing = find_crossing(problem)
            if crossing is not None:
                text += f"; the straight motion meets it first at {100 * crossing:.2f} % of the way"
            ends = (problem.start_configuration.X, X[0])
            evidence |= {"crossing": crossing, "determinants": problem.determinants(np.array(ends))}
        raise InfeasibleError(f"{label} {text}", **evidence)
    if isinstance(problem.goal, Configuration) and not problem.allow_mode_change:
        _check_same_branch(problem, problem.goal)


def _count_freedoms(problem: Problem) -> int:
    """Count the motions at the start that change more than idle variables, while others are held."""
    kinematics, mechanism = problem.robot.kinematics, problem.robot.mechanism
    (E,) = kinematics.functions.scaled_jacobian(problem.start_configuration.X)
    free = [i for i, name in enumerate(mechanism.names) if name not in problem.held]
    alone = [i for i in free if mechanism.variables[i].role == "passive"]
    mobility, internal = (
        len(columns) - compute_rank(E[:, columns], whole=E).value if columns else 0 for columns in (free, alone)
    )
    if not internal:  # the general case has no more internal mobility than any place: it need not be sampled
        return mobility
    report = report_state(kinematics, problem.start_configuration)
    return mobility - min(internal, report.internal_mobility)


def find_crossing(problem: Problem, count: int = 200) -> float | None:
    """Find where the straight motion from start to goal first changes the sign of a determinant that must keep it.

    Args:
        problem: The problem.
        count: Number of steps of the motion.

    Returns:
        The share of the way, or None where no change is met before the closures fail.
    """
    X = problem.start_configuration.X[None, :]
    first, last = X[0, problem.index].copy(), problem.goal_values()
    kept = 1 if problem.allow_mode_change else 2

    def step(X: Array, t: float) -> tuple[Array, bool]:
        values = (first + t * (last - first))[None, :]
        predicted = X + np.einsum("nvm,nm->nv", problem.space.tangent(X), values - X[:, problem.index])
        closed = problem.space.solve(values, predicted)
        return closed.X, bool(closed.converged[0])

    def signs(X: Array) -> Array:
        found = np.array(problem.determinants.signs(X))[:kept, 0]
        return found[~np.isnan(found)]

    reference = signs(X)
    low = 0.0
    for high in np.linspace(0.0, 1.0, count + 1)[1:].tolist():
        beyond, closes = step(X, high)
        if not closes:
            return None
        if np.all(signs(beyond) == reference):
            X, low = beyond, high
            continue
        for _ in range(40):
            middle = 0.5 * (low + high)
            between, closes = step(X, middle)
            if closes and np.all(signs(between) == reference):
                X, low = between, middle
            else:
                high = middle
        return 0.5 * (low + high)
    return None


def _check_same_branch(problem: Problem, goal: Configuration) -> None:
    """Refuse a goal configuration that a straight walk from the start shows to be another solution of the same pose.

    Determinants of equal signs do not prove that two solutions lie on one branch; a regular walk that arrives elsewhere
    proves that they do not. Where the walk meets a singularity nothing is concluded here.
    """
    index = problem.index
    X = problem.start_configuration.X[None, :]
    first, last = X[0, index].copy(), problem.goal_values()
    steps = max(8, int(np.ceil(np.max(np.abs(last - first) * problem.metric) / (0.1 * problem.robot.mechanism.length))))
    for t in np.linspace(0.0, 1.0, steps + 1)[1:]:
        values = first + t * (last - first)
        T = problem.space.tangent(X)
        predicted = X + np.einsum("nvm,nm->nv", T, values - X[:, index])
        closed = problem.space.solve(values[None, :], predicted)
        if not closed.converged[0]:
            return
        margins = problem.space.margins(closed.X)
        if min(margins.parallel[0], margins.serial[0]) < 1e-3:
            return
        X = closed.X
    name, gap = compare_configurations(problem, X[0], goal.X)
    if gap > 1e-6:
        i = problem.robot.mechanism.index(name)
        unit = problem.robot.mechanism.variables[i].unit
        raise InfeasibleError(
            f"goal lies on another branch than the start: moving straight there ends with {name!r} at {X[0, i]:.4f} "
            f"{unit}, the goal has {goal.X[i]:.4f} {unit}; state the goal by its pose, or start on the goal's branch",
            reached=X[0],
            goal=goal,
        )


def compare_configurations(problem: Problem, X: Array, Y: Array) -> tuple[str, float]:
    """Find the variable in which two configurations differ most, idle ones and full turns left out.

    Args:
        problem: The problem.
        X: First configuration, shape (n_variables,).
        Y: Second configuration, shape (n_variables,).

    Returns:
        Its name, and the difference in characteristic lengths or radians.
    """
    mechanism, kinematics = problem.robot.mechanism, problem.robot.kinematics
    angles = np.array([v.kind == "angle" for v in mechanism.variables])
    gap = X - Y
    gap = np.where(angles, (gap + np.pi) % (2 * np.pi) - np.pi, gap) / kinematics.graph.variable_scale
    gap[mechanism.indices(kinematics.idle)] = 0.0
    worst = int(np.argmax(np.abs(gap)))
    return mechanism.names[worst], float(abs(gap[worst]))


def _explain(problem: Problem, X: Array, reason: str) -> str:
    mechanism = problem.robot.mechanism
    if reason.startswith("collision"):
        distance, pair = problem.scene.clearances(X)
        return (
            f"is in collision or too close: {problem.scene.pairs[pair[0]].name} at {1e3 * distance[0]:.2f} mm, "
            f"the clearance margin is {1e3 * problem.margins.clearance:.2f} mm; move the obstacle or the pose"
        )
    if reason.startswith("condition "):
        conditions = problem.condition_set
        k = conditions.names.index(reason.removeprefix("condition "))
        scale = conditions.scales[k]
        value, low, high = conditions.values(X)[0, k] * scale, conditions.lower[k] * scale, conditions.upper[k] * scale
        return f"breaks the condition {conditions.names[k]!r}: {value:.6g} is not in [{low:.6g}, {high:.6g}]"
    if reason == "singularity":
        margins = problem.space.margins(X)
        serial = "" if problem.allow_mode_change else f", serial margin {margins.serial[0]:.4f}"
        return (
            f"is too near a singularity: parallel margin {margins.parallel[0]:.4f}{serial}, the bound is "
            f"{problem.margins.singularity:.4f}"
        )
    if reason.startswith("limit of "):
        name = reason.removeprefix("limit of ")
        i = mechanism.index(name)
        low, high = problem.bounds.bounds(mechanism)
        unit = mechanism.variables[i].unit
        return f"is out of the range of {name!r}: {X[0, i]:.6g} {unit} is not in [{low[i]:.6g}, {high[i]:.6g}] {unit}"
    ours, theirs = problem.determinants(problem.start_configuration.X), problem.determinants(X)
    kept = ("[N K]",) if problem.allow_mode_change else ("[N K]", "[M N]")
    changed = [k for k, a, b in zip(kept, ours, theirs, strict=False) if np.sign(a[0]) != np.sign(b[0])]
    kinds = {"[N K]": "a parallel singularity", "[M N]": "a serial singularity"}
    between = " and ".join(kinds[k] for k in changed)
    return (
        f"lies on another branch than the start: the determinant of {' and '.join(changed)} has the other sign, "
        f"so a motion between them crosses {between} (or turns a spherical joint through its gimbal position)"
    )
