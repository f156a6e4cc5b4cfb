"""The certificate: an independent look at a finished trajectory, between the samples of all that made it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import CertificateError, DefinitionError
from paraopt.kinematics import Configuration
from paraopt.kinematics import Margins as SingularityMargins
from paraopt.planning.differences import measure_disagreement
from paraopt.planning.path import PathPoints
from paraopt.planning.problem import Problem
from paraopt.planning.trajectory import Motion, Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tolerances:
    """State what a certificate forgives.

    Attributes:
        closure: Largest closure residual [m].
        ends: Largest distance between the ends of the motion and what was asked, scaled [1].
        excess: Share by which a velocity, acceleration or jerk limit may be exceeded [1].
        range: Distance by which a range may be exceeded, scaled [1].
        clearance: Distance by which the clearance margin may be missed [m].
        singularity: Amount by which the singularity margin may be missed [1].
        condition: Amount by which a condition may be missed, over its scale [1].
        derivative: Largest disagreement between stated and measured velocities and accelerations, as a share of their
            largest value [1].
        slip: Largest rate at which the stated velocities open the loops, as a share of the largest velocity [1].
        rest: Largest velocity at the ends, as a share of the largest velocity [1].
    """

    closure: float = 1e-9
    ends: float = 1e-8
    excess: float = 1e-3
    range: float = 1e-9
    clearance: float = 1e-9
    singularity: float = 1e-9
    condition: float = 1e-6
    derivative: float = 1e-2
    slip: float = 1e-6
    rest: float = 1e-6


@dataclass(frozen=True)
class Check:
    """Hold one line of a certificate.

    Attributes:
        name: What was checked.
        value: Worst value found.
        bound: Bound on it.
        unit: Unit of both.
        time: When it was found [s].
        where: Which joint, pair or kind.
        passed: Whether the bound holds.
        sense: "<=" or ">=".
    """

    name: str
    value: float
    bound: float
    unit: str
    time: float
    where: str
    passed: bool
    sense: str = "<="

    def __str__(self) -> str:
        verdict = "ok  " if self.passed else "FAIL"
        place = f", {self.where}" if self.where else ""
        return (
            f"{verdict} {self.name:<22} {self.value:>11.4g} {self.sense} {self.bound:<9.4g} {self.unit:<6} "
            f"at {self.time:.4f} s{place}"
        )


@dataclass(frozen=True, eq=False)
class Certificate:
    """Hold the verdict on a trajectory.

    Attributes:
        checks: One line for each dimension.
        n_samples: Number of times that were looked at.
        period: Time between them [s].
        t: The times [s], shape (n,).
        clearance: Smallest distance at each time [m]; inf without pairs.
        parallel_margin: Parallel margin at each time [1].
        serial_margin: Serial margin at each time [1].
    """

    checks: tuple[Check, ...]
    n_samples: int
    period: float
    t: Array = field(repr=False)
    clearance: Array = field(repr=False)
    parallel_margin: Array = field(repr=False)
    serial_margin: Array = field(repr=False)

    @property
    def passed(self) -> bool:
        """Tell whether every check holds."""
        return all(check.passed for check in self.checks)

    @property
    def failures(self) -> tuple[Check, ...]:
        """List the checks that fail."""
        return tuple(check for check in self.checks if not check.passed)

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise DefinitionError(f"no check is called {name!r}; the certificate has {[c.name for c in self.checks]}")

    def __str__(self) -> str:
        head = "certified" if self.passed else f"NOT certified: {len(self.failures)} check(s) fail"
        return f"{head}, {self.n_samples} samples, every {1e3 * self.period:.3g} ms\n" + "\n".join(
            str(check) for check in self.checks
        )

    def check_passed(self) -> None:
        """Refuse a trajectory that fails.

        Raises:
            CertificateError: Some check fails; the message lists them.
        """
        if not self.passed:
            raise CertificateError(
                "the trajectory is not certified:\n" + "\n".join(str(check) for check in self.failures),
                certificate=self,
            )


def verify(
    problem: Problem,
    trajectory: Motion,
    *,
    rate: float = 1000.0,
    at_least: int = 1000,
    check_jerk: bool = False,
    tolerances: Tolerances | None = None,
) -> Certificate:
    """Look at a trajectory densely and judge it against the problem.

    Nothing of the seeder, refiner or retimer is used: closures, Jacobians and distances are evaluated afresh at the
    positions that the trajectory gives. Stated velocities and accelerations are compared with differences of what they
    are derivatives of, and both are held against the limits.

    Args:
        problem: The problem.
        trajectory: The motion.
        rate: Samples per second [Hz].
        at_least: Smallest number of intervals between samples; never less than four.
        check_jerk: Whether differences of the accelerations must respect the jerk limits.
        tolerances: What is forgiven.

    Returns:
        The certificate, passed or not.

    Raises:
        DefinitionError: The duration or the rate is not finite and above 0.
    """
    tolerances = tolerances or Tolerances()
    for name, value, unit in (("duration of the trajectory", trajectory.duration, "s"), ("rate", rate, "Hz")):
        if not (np.isfinite(value) and value > 0):
            raise DefinitionError(f"{name} is {value} {unit}; it must be finite and above 0")
    n = max(int(at_least), int(np.ceil(trajectory.duration * rate)), 4) + 1
    t = np.linspace(0.0, trajectory.duration, n)
    if isinstance(trajectory, Trajectory):  # one pass for all three
        state = trajectory.state(t)
        X, V, A = state.X, state.velocity, state.acceleration
    else:
        X, V, A = (np.asarray(trajectory(t, order), dtype=float) for order in (0, 1, 2))
    ledger = _Ledger(t)
    _check_ends(ledger, problem, X, tolerances)
    _check_closures(ledger, problem, X, V, tolerances)
    _check_range(ledger, problem, X, tolerances)
    _check_limit(ledger, problem, "velocity", V, [X], tolerances.excess)
    _check_limit(ledger, problem, "acceleration", A, [V, X], tolerances.excess)
    _check_platform(ledger, problem, X, V, tolerances.excess)
    _check_derivatives(ledger, problem, trajectory, X, V, A, tolerances)
    _check_dynamics(ledger, problem, t, X, V, A, tolerances.excess)
    if check_jerk:
        _check_limit(ledger, problem, "jerk", None, [A, V, X], tolerances.excess)
    _check_held(ledger, problem, X)
    _check_conditions(ledger, problem, X, tolerances)
    clearance, margins = _check_space(ledger, problem, X, tolerances)
    return Certificate(tuple(ledger.checks), n, float(t[1]), t, clearance, margins.parallel, margins.serial)


class _Ledger:
    """Collect checks; values that are not numbers count as the worst."""

    def __init__(self, t: Array) -> None:
        self.t = t
        self.checks: list[Check] = []

    def largest(
        self, name: str, values: Array, bound: float, unit: str, labels: Sequence[str] = ("",), at: int = 0
    ) -> None:
        """Judge the largest of values of shape (n,) or (n, k) against an upper bound.

        Args:
            name: Name of the check.
            values: Values; row i belongs to the instant `at + i`.
            bound: Upper bound.
            unit: Unit of both.
            labels: Name of each column.
            at: Index of the first row's instant.
        """
        table = np.asarray(values, dtype=float).reshape(len(values), -1)
        table = np.where(np.isnan(table), np.inf, table)
        i, j = divmod(int(np.argmax(table)), table.shape[1])
        worst = float(table[i, j])
        self.checks.append(Check(name, worst, bound, unit, float(self.t[at + i]), labels[j], worst <= bound))

    def worse(self, *ways: tuple[str, Array, float, str, Sequence[str], int]) -> None:
        """Judge a quantity in several ways: the first verdict is kept, unless it holds and others do not.

        Args:
            ways: Arguments of `largest`, for each way.
        """
        for way in ways:
            self.largest(*way)
        first, *others = self.checks[-len(ways) :]
        failed = [] if not first.passed else [check for check in others if not check.passed]
        self.checks[-len(ways) :] = [max(failed, key=lambda check: check.value, default=first)]

    def smallest(self, name: str, values: Array, bound: float, unit: str, allowance: float, where: str = "") -> None:
        """Judge the smallest of values of shape (n,) against a lower bound that may be missed by an allowance."""
        table = np.where(np.isnan(values), -np.inf, values)
        i = int(np.argmin(table))
        passed = bool(table[i] >= bound - allowance)
        self.checks.append(Check(name, float(table[i]), bound, unit, float(self.t[i]), where, passed, ">="))


def _check_ends(ledger: _Ledger, problem: Problem, X: Array, tolerances: Tolerances) -> None:
    """Compare the ends with what was asked: the start's whole configuration, the goal's as far as it was stated."""
    mechanism, kinematics = problem.robot.mechanism, problem.robot.kinematics
    angles = np.array([v.kind == "angle" for v in mechanism.variables])
    for label, i, stated, wanted in (
        ("start reached", 0, problem.start, problem.start_configuration),
        ("goal reached", len(X) - 1, problem.goal, problem.goal_configuration),
    ):
        gap = X[i] - wanted.X
        gap = np.abs(np.where(angles, (gap + np.pi) % (2 * np.pi) - np.pi, gap)) / kinematics.graph.variable_scale
        # a goal stated by its pose may be reached on whatever branch the start leads to
        whole = i == 0 or isinstance(stated, Configuration)
        judged = [
            k
            for k, v in enumerate(mechanism.variables)
            if (whole or v.name in problem.stated) and v.name not in kinematics.idle
        ]
        ledger.largest(label, gap[None, judged], tolerances.ends, "1", [mechanism.names[k] for k in judged], at=i)


def _check_closures(ledger: _Ledger, problem: Problem, X: Array, V: Array, tolerances: Tolerances) -> None:
    """Check F(X) = 0 in metres (rows without unit times the characteristic length), and E V = 0 against the speed."""
    kinematics, scale = problem.robot.kinematics, problem.robot.kinematics.graph.variable_scale
    residual = kinematics.scaled_residual(X) * problem.robot.mechanism.length
    ledger.largest("closure residual", residual, tolerances.closure, "m")
    (E,) = kinematics.functions.scaled_jacobian.batch(X)
    slip = np.max(np.abs((E @ (V / scale)[:, :, None])[:, :, 0]), axis=1, initial=0.0)
    ledger.largest("closure velocity", slip / _size(V / scale), tolerances.slip, "1")


def _check_range(ledger: _Ledger, problem: Problem, X: Array, tolerances: Tolerances) -> None:
    """Check the positions of all variables."""
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    beyond = np.maximum(low - X, X - high) / problem.robot.kinematics.graph.variable_scale
    names = problem.robot.mechanism.names
    ledger.largest("range exceeded", np.maximum(beyond, 0.0), tolerances.range, "1", names)


def _check_held(ledger: _Ledger, problem: Problem, X: Array) -> None:
    """Check that locked variables stay at their values at the start, in characteristic lengths or radians."""
    if problem.held:
        index = problem.robot.mechanism.indices(problem.held)
        scale = problem.robot.kinematics.graph.variable_scale[index]
        drift = np.abs(X[:, index] - problem.start_configuration.X[index]) / scale
        ledger.largest("held variables move", drift, 1e-9, "1", problem.held)


def _check_conditions(ledger: _Ledger, problem: Problem, X: Array, tolerances: Tolerances) -> None:
    """Check the problem's conditions, each in its own unit."""
    conditions = problem.condition_set
    if not len(conditions):
        return
    finite = np.all(np.isfinite(X), axis=1)
    values = conditions.values(np.where(finite[:, None], X, problem.start_configuration.X))
    values = np.where(finite[:, None], values, np.nan)
    for k, (name, scale) in enumerate(zip(conditions.names, conditions.scales, strict=True)):
        low, high, allowance = (v * scale for v in (conditions.lower[k], conditions.upper[k], tolerances.condition))
        if np.isfinite(low):
            ledger.smallest(name, values[:, k] * scale, float(low), "", float(allowance))
        if np.isfinite(high):
            ledger.largest(name, values[:, k] * scale, float(high + allowance), "")


def _check_limit(
    ledger: _Ledger, problem: Problem, quantity: str, stated: Array | None, sources: Sequence[Array], excess: float
) -> None:
    """Check a derivative of all variables that have a limit of it.

    The stated values are judged, and so are differences of the positions and of lower derivatives. These are weighted
    means of the true derivative, which never exceed the largest value in their interval: nothing has to be forgiven.

    Args:
        ledger: Where the verdict goes.
        problem: The problem.
        quantity: "velocity", "acceleration" or "jerk".
        stated: The stated derivative, shape (n, n_variables); None when there is none.
        sources: What is differenced: the derivative below first, the positions last; shape (n, n_variables) each.
        excess: Share by which the limit may be exceeded [1].
    """
    mechanism, kinematics = problem.robot.mechanism, problem.robot.kinematics
    limits = problem.bounds.of(quantity, mechanism.names)
    limited = np.flatnonzero(np.isfinite(limits))
    if not limited.size:
        return
    names, limits, period = [mechanism.names[i] for i in limited], limits[limited], float(ledger.t[1])
    ways: list[tuple[Array, Sequence[str], int]] = []
    if stated is not None:
        ways.append((np.abs(stated[:, limited]) / limits, names, 0))
    for order, source in enumerate(sources, start=1):
        values = source[:, limited]
        # closed loops are known to the tolerance of the solves; derivatives have the same number of digits
        size = kinematics.graph.variable_scale[limited] if order == len(sources) else np.max(np.abs(values), axis=0)
        noise = 2.0**order * kinematics.options.tolerance * float(np.max(size / limits, initial=0.0))
        reach = (10.0 * noise / max(excess, 1e-9)) ** (1.0 / order)  # over such times noise is a tenth of the excess
        k = int(np.clip(np.ceil(reach / period), 1, (len(values) - 1) // (order + 1))) if np.isfinite(reach) else 1
        for _ in range(order):
            values = values[k:] - values[:-k]
        labels = [f"{name}, by differences" for name in names]
        ways.append((np.abs(values) / (limits * (k * period) ** order), labels, order * k // 2))
    ledger.worse(*((f"{quantity} / limit", share, 1.0 + excess, "1", labels, at) for share, labels, at in ways))


def _check_platform(ledger: _Ledger, problem: Problem, X: Array, V: Array, excess: float) -> None:
    """Check the speeds of the tool point and its link, and differences of them, where the platform has limits.

    The stated velocities of all variables are used; that they belong to the positions is checked elsewhere.
    """
    bounds = problem.bounds.platform()
    if not np.any(np.isfinite(bounds)):
        return
    robot, period = problem.robot, float(ledger.t[1])
    carrier = next(v.link for v in robot.mechanism.variables if v.role == "operational")
    link, point = robot.tool or (carrier, (0.0, 0.0, 0.0))
    i = [k.name for k in robot.mechanism.links].index(link)
    finite = np.all(np.isfinite(X) & np.isfinite(V), axis=1)
    safe = np.where(finite[:, None], X, problem.start_configuration.X)
    turned = robot.kinematics.poses(safe)[:, i, :3, :3]
    rate = robot.kinematics.pose_velocity(safe, np.where(finite[:, None], V, 0.0)[:, :, None])[:, 0, i]
    linear = rate[:, :, :3] @ np.asarray(point) + rate[:, :, 3]
    spin = rate[:, :, :3] @ turned.transpose(0, 2, 1)
    angular = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    for k, (kind, speed) in enumerate((("linear", linear), ("angular", angular))):
        speed = np.where(finite[:, None], speed, np.nan)
        for quantity, values, bound in (
            ("velocity", speed, bounds[k]),
            # a mean over an interval is no longer than the longest acceleration in it
            ("acceleration", np.diff(speed, axis=0) / period, bounds[k + 2]),
        ):
            if np.isfinite(bound):
                share = np.linalg.norm(values, axis=1) / bound
                ledger.largest(f"{kind} {quantity}", share, 1.0 + excess, "1", ["platform / limit"])


def _check_dynamics(ledger: _Ledger, problem: Problem, t: Array, X: Array, V: Array, A: Array, excess: float) -> None:
    """Check bounds on speed and acceleration that the problem states: time itself is the parameter of the path.

    With `s = t` the speed of the parameter is one and its acceleration zero. The stated derivatives are used; that they
    belong to the positions is checked elsewhere.
    """
    if not problem.dynamics:
        return
    finite = np.all(np.isfinite(X) & np.isfinite(V) & np.isfinite(A), axis=1)
    safe = np.where(finite[:, None], X, problem.start_configuration.X)
    V, A = (np.where(finite[:, None], values, 0.0) for values in (V, A))
    points = PathPoints(t, safe, V, A, problem.space.tangent(safe))
    for constraint in problem.dynamics:
        rows = getattr(constraint, "judge", constraint.rows)(problem, points)
        if not rows.count:
            continue
        asked = np.where(finite[:, None], rows(np.ones(len(t)), np.zeros(len(t))), np.nan)
        at_rest = np.max(np.abs(rows.c), axis=0, initial=0.0)
        share = asked / np.where(at_rest > 0.0, at_rest, 1.0)
        ledger.largest(f"dynamics, {type(constraint).__name__}", share, excess, "1", rows.names)


def _check_derivatives(
    ledger: _Ledger, problem: Problem, motion: Motion, X: Array, V: Array, A: Array, tolerances: Tolerances
) -> None:
    """Compare stated derivatives with differences of what they are derivatives of, and ask for rest at the ends."""
    names, scale = problem.robot.mechanism.names, problem.robot.kinematics.graph.variable_scale
    speed, bound = _size(V / scale), tolerances.derivative
    for name, order, values, derivative, size in (
        ("velocity is dX/dt", 1, X, V, speed),
        ("acceleration is dV/dt", 2, V, A, _size(A / scale)),
    ):
        gap = measure_disagreement(motion, ledger.t, order, values, derivative, scale * size, bound)
        ledger.largest(name, gap, bound, "1", names)
    for label, i in (("at rest at start", 0), ("at rest at goal", len(X) - 1)):
        ledger.largest(label, np.abs(V[i : i + 1]) / (scale * speed), tolerances.rest, "1", names, at=i)


def _check_space(
    ledger: _Ledger, problem: Problem, X: Array, tolerances: Tolerances
) -> tuple[Array, SingularityMargins]:
    """Check clearance, singularity margins, and that no determinant changes its sign."""
    finite = np.all(np.isfinite(X), axis=1)
    safe = np.where(finite[:, None], X, problem.start_configuration.X)
    clearance, pair = problem.scene.clearances(safe)
    clearance = np.where(finite, clearance, np.nan)
    closest = pair[int(np.argmin(np.where(finite, clearance, -np.inf)))]
    where = problem.scene.pairs[closest].name if closest >= 0 else "no pair to check"
    ledger.smallest("clearance", clearance, problem.margins.clearance, "m", tolerances.clearance, where)
    margins = problem.space.margins(safe)
    asked = problem.margins.singularity
    ledger.smallest("parallel margin", margins.parallel, asked, "1", tolerances.singularity)
    # a motion that may change its working mode may cross serial singularities, never parallel ones
    serial = 0.0 if problem.allow_mode_change else asked
    ledger.smallest("serial margin", margins.serial, serial, "1", tolerances.singularity)
    references = problem.determinants(problem.start_configuration.X)
    for name, values, reference in zip(
        ("parallel determinant", "serial determinant"), problem.determinants(safe), references, strict=True
    ):
        if not np.isnan(reference[0]) and not (problem.allow_mode_change and name.startswith("serial")):
            signed = np.sign(reference[0]) * values
            ledger.smallest(name, signed, 0.0, "1", -float(np.finfo(float).tiny))
    return clearance, margins


def _size(values: Array) -> float:
    """Give the largest finite magnitude, never zero."""
    return max(float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0)), 1e-12)
