"""The certificate: an independent look at a finished trajectory, between the samples of all that made it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import CertificateError, DefinitionError
from paraopt.planning.problem import Problem

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
        derivative: Largest share of disagreement between stated and measured velocities and accelerations [1].
    """

    closure: float = 1e-9
    ends: float = 1e-8
    excess: float = 1e-3
    range: float = 1e-9
    clearance: float = 1e-9
    singularity: float = 1e-9
    derivative: float = 1e-2


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
        tolerances: What is forgiven.

    Returns:
        The certificate, passed or not.
    """
    tolerances = tolerances or Tolerances()
    mechanism, kinematics = problem.robot.mechanism, problem.robot.kinematics
    scale = kinematics.graph.variable_scale
    names = mechanism.names
    n = max(int(at_least), int(np.ceil(trajectory.duration * rate))) + 1
    t = np.linspace(0.0, trajectory.duration, n)
    period = float(t[1] - t[0])
    X, V, A = (np.asarray(trajectory(t, order), dtype=float) for order in (0, 1, 2))
    checks: list[Check] = []

    def add(
        name: str, values: Array, bound: float, unit: str, labels: tuple[str, ...] = ("",), low: bool = False
    ) -> None:
        """Judge the worst of values of shape (n,) or (n, k)."""
        table = np.asarray(values, dtype=float).reshape(len(values), -1)
        table = np.where(np.isfinite(table) | (low & (table == np.inf)), table, -np.inf if low else np.inf)
        flat = int(np.argmin(table) if low else np.argmax(table))
        i, j = divmod(flat, table.shape[1])
        worst = float(table[i, j])
        passed = worst >= bound if low else worst <= bound
        time = float(t[min(i, n - 1)])
        checks.append(
            Check(name, worst, bound, unit, time, labels[min(j, len(labels) - 1)], passed, ">=" if low else "<=")
        )

    # the ends
    ends = np.vstack([X[0] - problem.start_configuration.X, X[-1] - problem.goal_configuration.X])
    angles = np.array([v.kind == "angle" for v in mechanism.variables])
    ends = np.where(angles, (ends + np.pi) % (2 * np.pi) - np.pi, ends)[:, mechanism.indices(mechanism.operational)]
    error = np.abs(ends) / scale[mechanism.indices(mechanism.operational)]
    add("start reached", error[:1], tolerances.ends, "1", tuple(mechanism.operational))
    add("goal reached", np.vstack([np.zeros((n - 1, error.shape[1])), error[1:]]), tolerances.ends, "1",
        tuple(mechanism.operational))  # fmt: skip

    # the closures, in metres: rows without unit are taken over the characteristic length
    residual = kinematics.scaled_residual(X) * mechanism.length
    add("closure residual", residual, tolerances.closure, "m")
    (E,) = kinematics.functions.scaled_jacobian.batch(X)
    slip = np.max(np.abs(np.einsum("nrv,nv->nr", E, V / scale)), axis=1, initial=0.0)
    size = max(float(np.max(np.abs(V / scale))), 1e-12)
    add("closure velocity", slip / size, 1e-6, "1")

    # positions, velocities and accelerations against their limits
    low, high = problem.bounds.bounds(mechanism)
    beyond = np.maximum(low - X, X - high) / scale
    add("range exceeded", np.maximum(beyond, 0.0), tolerances.range, "1", names)
    for quantity, values in (("velocity", V), ("acceleration", A)):
        limits = problem.bounds.of(quantity, names)
        limited = np.flatnonzero(np.isfinite(limits))
        if limited.size:
            share = np.abs(values[:, limited]) / limits[limited]
            add(f"{quantity} / limit", share, 1.0 + tolerances.excess, "1", tuple(names[i] for i in limited))

    # stated derivatives against differences of what they are derivatives of
    measured = np.diff(X, axis=0) / period
    stated = 0.5 * (V[1:] + V[:-1])
    bend = 0.5 * np.abs(np.diff(V, axis=0))  # the mean speed lies between those at the ends
    add("velocity is dX/dt", np.maximum(np.abs(measured - stated) - bend, 0.0) / (scale * size), tolerances.derivative,
        "1", names)  # fmt: skip
    measured = np.diff(V, axis=0) / period
    top = max(float(np.max(np.abs(A / scale))), 1e-12)
    add("acceleration is dV/dt", _outside(measured, A, scale * top), 5 * tolerances.derivative, "1", names)
    rest = np.vstack([np.abs(V[0]), np.abs(V[-1])]) / (scale * size)
    add("at rest at both ends", rest, 1e-6, "1", names)

    # clearance and singularities
    distance, pair = problem.scene.clearances(X)
    labels = [problem.scene.pairs[p].name if p >= 0 else "" for p in pair]
    i = int(np.argmin(distance))
    bound = problem.margins.clearance - tolerances.clearance
    checks.append(
        Check("clearance", float(distance[i]), problem.margins.clearance, "m", float(t[i]), labels[i],
              bool(distance[i] >= bound), ">=")
    )  # fmt: skip
    margins = problem.space.margins(X)
    for name, values in (("parallel margin", margins.parallel), ("serial margin", margins.serial)):
        i = int(np.argmin(np.where(np.isfinite(values), values, -np.inf)))
        bound = problem.margins.singularity
        ok = bool(values[i] >= bound - tolerances.singularity)
        checks.append(Check(name, float(values[i]), bound, "1", float(t[i]), "", ok, ">="))
    determinants = problem.determinants(X)
    for name, values in zip(("parallel determinant", "serial determinant"), determinants, strict=True):
        if not np.all(np.isnan(values)):
            reference = np.sign(problem.determinants(problem.start_configuration.X)[name.startswith("serial")][0])
            add(f"{name} sign", reference * values, np.finfo(float).tiny, "1", low=True)
    return Certificate(tuple(checks), n, period, t, distance, margins.parallel, margins.serial)


def _outside(measured: Array, stated: Array, size: Array) -> Array:
    """Tell how far a difference quotient lies outside the values stated around it.

    Accelerations may jump inside an interval, so the quotient is compared with the span of the stated values from one
    sample before the interval to one after it.
    """
    padded = np.vstack([stated[:1], stated, stated[-1:]])
    window = np.stack([padded[:-3], padded[1:-2], padded[2:-1], padded[3:]])
    low, high = window.min(axis=0), window.max(axis=0)
    return np.maximum(np.maximum(low - measured, measured - high), 0.0) / size
