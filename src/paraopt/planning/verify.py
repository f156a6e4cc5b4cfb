"""The certificate: an independent look at a finished trajectory, between the samples of all that made it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import CertificateError, DefinitionError
from paraopt.kinematics import Configuration
from paraopt.kinematics import Margins as SingularityMargins
from paraopt.planning.problem import Problem
from paraopt.planning.trajectory import Trajectory

Array = NDArray[np.float64]


class Motion(Protocol):
    """Give all variables in time; what `verify` needs of a trajectory."""

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        ...

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate values (order 0), velocities (1) or accelerations (2)."""
        ...


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
    positions that the trajectory gives. Velocities and accelerations are judged twice: against their limits, and
    against differences of the positions and of the velocities.

    Args:
        problem: The problem.
        trajectory: The motion.
        rate: Samples per second [Hz].
        at_least: Smallest number of samples.
        check_jerk: Whether differences of the accelerations must respect the jerk limits.
        tolerances: What is forgiven.

    Returns:
        The certificate, passed or not.
    """
    tolerances = tolerances or Tolerances()
    n = max(int(at_least), int(np.ceil(trajectory.duration * rate))) + 1
    t = np.linspace(0.0, trajectory.duration, n)
    if isinstance(trajectory, Trajectory):  # one pass for all three
        state = trajectory.state(t)
        X, V, A = state.X, state.velocity, state.acceleration
    else:
        X, V, A = (np.asarray(trajectory(t, order), dtype=float) for order in (0, 1, 2))
    ledger = _Ledger(t)
    _check_ends(ledger, problem, X, tolerances)
    _check_closures(ledger, problem, X, V, tolerances)
    _check_limits(ledger, problem, X, V, A, tolerances)
    _check_derivatives(ledger, problem, X, V, A, tolerances)
    if check_jerk:
        _check_jerk(ledger, problem, A, tolerances)
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
            if (whole or v.role == "operational") and v.name not in kinematics.idle
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


def _check_limits(ledger: _Ledger, problem: Problem, X: Array, V: Array, A: Array, tolerances: Tolerances) -> None:
    """Check positions, velocities and accelerations of all variables that have limits."""
    mechanism = problem.robot.mechanism
    low, high = problem.bounds.bounds(mechanism)
    beyond = np.maximum(low - X, X - high) / problem.robot.kinematics.graph.variable_scale
    ledger.largest("range exceeded", np.maximum(beyond, 0.0), tolerances.range, "1", mechanism.names)
    for quantity, values in (("velocity", V), ("acceleration", A)):
        limits = problem.bounds.of(quantity, mechanism.names)
        limited = np.flatnonzero(np.isfinite(limits))
        if limited.size:
            share = np.abs(values[:, limited]) / limits[limited]
            labels = [mechanism.names[i] for i in limited]
            ledger.largest(f"{quantity} / limit", share, 1.0 + tolerances.excess, "1", labels)


def _check_derivatives(ledger: _Ledger, problem: Problem, X: Array, V: Array, A: Array, tolerances: Tolerances) -> None:
    """Compare stated derivatives with differences of what they are derivatives of, and ask for rest at the ends."""
    names, scale = problem.robot.mechanism.names, problem.robot.kinematics.graph.variable_scale
    period = float(ledger.t[1])
    speed = _size(V / scale)
    for name, values, derivative, size in (
        ("velocity is dX/dt", X, V, speed),
        ("acceleration is dV/dt", V, A, _size(A / scale)),
    ):
        gap = _outside(np.diff(values, axis=0) / period, derivative) / (scale * size)
        ledger.largest(name, gap, tolerances.derivative, "1", names)
    for label, i in (("at rest at start", 0), ("at rest at goal", len(X) - 1)):
        ledger.largest(label, np.abs(V[i : i + 1]) / (scale * speed), tolerances.rest, "1", names, at=i)


def _check_jerk(ledger: _Ledger, problem: Problem, A: Array, tolerances: Tolerances) -> None:
    """Check that accelerations change no faster than the jerk limits allow between two instants."""
    names = problem.robot.mechanism.names
    limits = problem.bounds.of("jerk", names)
    limited = np.flatnonzero(np.isfinite(limits))
    if limited.size:
        share = np.abs(np.diff(A[:, limited], axis=0)) / (float(ledger.t[1]) * limits[limited])
        ledger.largest("jerk / limit", share, 1.0 + tolerances.excess, "1", [names[i] for i in limited])


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
    ledger.smallest("serial margin", margins.serial, asked, "1", tolerances.singularity)
    references = problem.determinants(problem.start_configuration.X)
    for name, values, reference in zip(
        ("parallel determinant", "serial determinant"), problem.determinants(safe), references, strict=True
    ):
        if not np.isnan(reference[0]):
            signed = np.sign(reference[0]) * values
            ledger.smallest(name, signed, 0.0, "1", -float(np.finfo(float).tiny))
    return clearance, margins


def _size(values: Array) -> float:
    """Give the largest finite magnitude, never zero."""
    return max(float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0)), 1e-12)


def _outside(measured: Array, stated: Array) -> Array:
    """Tell how far difference quotients lie outside the values stated around them.

    Accelerations may jump inside an interval, so the quotient is compared with the span of the stated values from one
    sample before the interval to one after it.

    Args:
        measured: Difference quotients, shape (n - 1, k).
        stated: Derivatives, shape (n, k).

    Returns:
        Distances from the spans, shape (n - 1, k); inf where a value is not a number.
    """
    padded = np.vstack([stated[:1], stated, stated[-1:]])
    window = np.stack([padded[:-3], padded[1:-2], padded[2:-1], padded[3:]])
    gap = np.maximum(window.min(axis=0) - measured, measured - window.max(axis=0))
    return np.where(np.isnan(gap), np.inf, np.maximum(gap, 0.0))
