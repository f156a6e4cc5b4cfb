"""The certificate of a walk: that of every phase, and what holds between and beyond them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import CertificateError, DefinitionError
from paraopt.modes.legged.balance import build_polygon, measure_centre
from paraopt.modes.legged.machine import LeggedMachine
from paraopt.modes.legged.supports import measure_height
from paraopt.modes.legged.task import LeggedTask
from paraopt.modes.legged.tipping import measure_tipping
from paraopt.modes.legged.trajectory import LeggedTrajectory
from paraopt.planning import Certificate, Check, Problem, verify
from paraopt.planning.trajectory import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeggedTolerances:
    """State what the certificate of a walk forgives.

    Attributes:
        lock: Largest drift of a locked variable [m or rad].
        foot: Largest drift of the point of contact of a standing foot [m], and of its direction [rad].
        support: Largest distance of a standing foot from its support [m]; how deep a lifted one may be in it.
        continuity: Largest jump of a variable between phases [m or rad].
        rest: Largest speed where phases meet, as a share of the largest in both phases [1].
        margin: Amount by which the support margin may be missed [m].
        tipping: Share of the distance between rest and tipping by which the latter may be missed [1].
    """

    lock: float = 1e-9
    foot: float = 1e-9
    support: float = 1e-6
    continuity: float = 1e-9
    rest: float = 1e-6
    margin: float = 1e-9
    tipping: float = 1e-3


@dataclass(frozen=True, eq=False)
class LeggedCertificate:
    """Hold the verdict on a motion through phases.

    Attributes:
        names: Names of the phases.
        phases: Certificate of each phase, whose times begin with the phase.
        starts: When each phase begins [s].
        checks: What holds over all phases, in the time of the whole motion.
        t: Times that were looked at, over all phases [s], shape (n,).
        margin: Support margin then [m], nan where none is asked, shape (n,).
        centre: Centre of gravity then [m], shape (n, 3).
        tipping: Distance from tipping over then, with the inertia of what moves [m], nan where no support margin is
            asked, shape (n,).
    """

    names: tuple[str, ...]
    phases: tuple[Certificate, ...]
    starts: tuple[float, ...]
    checks: tuple[Check, ...]
    t: Array = field(repr=False)
    margin: Array = field(repr=False)
    centre: Array = field(repr=False)
    tipping: Array = field(repr=False)

    @property
    def passed(self) -> bool:
        """Tell whether every check of every phase, and over all phases, holds."""
        return all(check.passed for check in self.checks) and all(phase.passed for phase in self.phases)

    @property
    def failures(self) -> tuple[tuple[str, Check], ...]:
        """List the checks that fail, each with the name of its phase, or "" for those over all phases."""
        inside = [
            (name, check) for name, phase in zip(self.names, self.phases, strict=True) for check in phase.failures
        ]
        return (*(("", check) for check in self.checks if not check.passed), *inside)

    @property
    def smallest_margin(self) -> float:
        """Give the smallest support margin where one is asked [m]; inf where none is."""
        return float(np.min(self.margin, where=~np.isnan(self.margin), initial=np.inf))

    @property
    def smallest_tipping(self) -> float:
        """Give the smallest distance from tipping over with the inertia of what moves [m]; inf where none is known."""
        return float(np.min(self.tipping, where=~np.isnan(self.tipping), initial=np.inf))

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise DefinitionError(f"no check is called {name!r}; over all phases there are {[c.name for c in self.checks]}")

    def __str__(self) -> str:
        n = sum(phase.n_samples for phase in self.phases)
        head = "certified" if self.passed else f"NOT certified: {len(self.failures)} check(s) fail"
        lines = [f"{head}, {len(self.phases)} phases, {n} samples", *(str(check) for check in self.checks)]
        for name, phase in zip(self.names, self.phases, strict=True):
            failed = [f"  {check}" for check in phase.failures]
            lines += [f"{'ok  ' if phase.passed else 'FAIL'} phase {name!r}, {len(phase.checks)} checks", *failed]
        return "\n".join(lines)

    def check_passed(self) -> None:
        """Refuse a motion that fails.

        Raises:
            CertificateError: Some check fails; the message lists them with their phases.
        """
        if not self.passed:
            told = [f"{check}{f' [phase {name!r}]' if name else ''}" for name, check in self.failures]
            raise CertificateError("the motion is not certified:\n" + "\n".join(told), certificate=self)


def verify_legged(
    task: LeggedTask,
    problems: Sequence[Problem],
    trajectory: LeggedTrajectory,
    *,
    rate: float = 1000.0,
    at_least: int | Sequence[int] = 1000,
    check_jerk: bool | Sequence[bool] = False,
    tolerances: LeggedTolerances | None = None,
) -> LeggedCertificate:
    """Look at a motion through phases densely and judge it against the task.

    Every phase is judged by `verify`. Over all phases, from poses evaluated afresh: the support margin, the drift of
    standing feet, measured at the ends of the legs, and of locked joints, feet on and over the ground, and continuity
    and rest where phases meet.

    Args:
        task: The task.
        problems: Its problems, see `build_problems`.
        trajectory: The motion.
        rate: Samples per second [Hz].
        at_least: Smallest number of intervals between samples, in every phase or for each.
        check_jerk: Whether the jerk limits must hold, in every phase or for each.
        tolerances: What is forgiven over all phases.

    Returns:
        The certificate, passed or not.

    Raises:
        DefinitionError: The motion has other phases than the task, or its marks tell other feet or locks.
    """
    names = tuple(phase.name for phase in task.phases)
    if names != tuple(mark.name for mark in trajectory.marks) or len(problems) != len(names):
        raise DefinitionError(
            f"the motion has the phases {[mark.name for mark in trajectory.marks]}, the task {list(names)}"
        )
    for phase, mark in zip(task.phases, trajectory.marks, strict=True):
        # pages and figures tell what marks say: they must say what is certified
        said = (set(mark.standing), set(mark.lifted), set(mark.locked))
        if said != (set(phase.standing), set(phase.lifted(task.machine)), set(phase.locked)):
            raise DefinitionError(
                f"phase {mark.name!r} is marked as standing on {list(mark.standing)}, lifting {list(mark.lifted)} and "
                f"locking {list(mark.locked)}; the task has it stand on {list(phase.standing)}, lift "
                f"{list(phase.lifted(task.machine))} and lock {list(phase.locked)}"
            )
    counts = [at_least] * len(names) if isinstance(at_least, int) else list(at_least)
    jerks = [check_jerk] * len(names) if isinstance(check_jerk, bool) else list(check_jerk)
    certificates = tuple(
        verify(problem, part, rate=rate, at_least=count, check_jerk=jerk)
        for problem, part, count, jerk in zip(problems, trajectory.parts, counts, jerks, strict=True)
    )
    ledger = _Ledger(task, tolerances or LeggedTolerances())
    for k, certificate in enumerate(certificates):
        ledger.look(k, trajectory, problems[k], certificate.t)
    ledger.look_at_borders(trajectory)
    return LeggedCertificate(
        names, certificates, tuple(mark.start for mark in trajectory.marks), ledger.conclude(),
        np.concatenate(ledger.times), np.concatenate(ledger.margins), np.concatenate(ledger.centres),
        np.concatenate(ledger.tippings),
    )  # fmt: skip


class _Ledger:
    """Collect the worst of each quantity over all phases; values that are not numbers count as the worst."""

    def __init__(self, task: LeggedTask, tolerances: LeggedTolerances) -> None:
        self.task, self.tolerances = task, tolerances
        self.found: dict[str, Check] = {}
        self.times: list[Array] = []
        self.margins: list[Array] = []
        self.centres: list[Array] = []
        self.tippings: list[Array] = []

    def look(self, k: int, trajectory: LeggedTrajectory, problem: Problem, t: Array) -> None:
        """Judge one phase at times of its own."""
        task, phase, machine = self.task, self.task.phases[k], self.task.machine
        X = np.asarray(trajectory.parts[k](t), dtype=float)
        finite = np.all(np.isfinite(X), axis=1)
        safe = np.where(finite[:, None], X, problem.start_configuration.X)
        clock = trajectory.marks[k].start + t
        margin, centre = self._judge_balance(k, machine, safe, finite, clock)
        self.tippings.append(self._judge_tipping(k, trajectory.parts[k], t, safe, finite, clock))
        self.times.append(clock)
        self.margins.append(margin)
        self.centres.append(centre)
        start = problem.start_configuration.X[None]
        ends, _ = machine.contacts(safe)
        fixed, _ = machine.contacts(start)
        uprights, upright = machine.uprights(safe), machine.uprights(start)
        height = measure_height(task.support, ends.reshape(-1, 3)).reshape(ends.shape[:2])
        for i, foot in enumerate(machine.names):
            where = f"phase {phase.name!r}, foot {foot!r}"

            def judge(name: str, values: Array, bound: float, unit: str, where: str = where) -> None:
                self._largest(name, np.where(finite, values, np.inf), bound, unit, clock, where)

            if foot not in phase.standing:
                lowest = height[:, i]
                if machine.foot(foot).sole:
                    corners = machine.corners(safe, foot)
                    above = measure_height(task.support, corners.reshape(-1, 3)).reshape(corners.shape[:2])
                    lowest = np.minimum(lowest, above.min(axis=1))
                judge("lifted feet in the ground", 0.0 - lowest, self.tolerances.support, "m")
                continue
            drift = np.linalg.norm(ends[:, i] - fixed[:, i], axis=1)
            judge("standing feet move", drift, self.tolerances.foot, "m")
            judge("standing feet off support", np.abs(height[:, i]), self.tolerances.support, "m")
            if machine.foot(foot).upright is not None:
                turned = np.linalg.norm(uprights[:, i] - upright[:, i], axis=1)
                judge("standing feet turn", turned, self.tolerances.foot, "rad")
        for name in phase.locked:
            i = machine.robot.mechanism.index(name)
            values = np.where(finite, np.abs(X[:, i] - start[0, i]), np.inf)
            unit = machine.robot.mechanism.variables[i].unit
            self._largest(
                "locked joints move", values, self.tolerances.lock, unit, clock, f"phase {phase.name!r}, {name!r}"
            )

    def _judge_balance(
        self, k: int, machine: LeggedMachine, safe: Array, finite: Array, clock: Array
    ) -> tuple[Array, Array]:
        """Judge the support margin of one phase, and give it with the centre of gravity at every sample."""
        task, phase = self.task, self.task.phases[k]
        centre = measure_centre(machine, safe)
        if phase.stability is None:
            return np.full(len(safe), np.nan), centre
        # the feet are where the motion has them at first; that they stay there is judged beside
        margin = (
            build_polygon(machine, safe[0], phase.standing, task.down).margin(centre)
            if phase.standing
            else np.full(len(safe), -np.inf)
        )
        margin = np.where(finite, margin, -np.inf)
        i = int(np.argmin(margin))
        lifted = phase.lifted(machine)
        check = Check(
            "support margin", float(margin[i]), phase.stability, "m", float(clock[i]),
            f"phase {phase.name!r}{f', lifting {lifted[0]!r}' if lifted else ''}",
            bool(margin[i] >= phase.stability - self.tolerances.margin), ">=",
        )  # fmt: skip
        # phases may ask for different margins: the one that is nearest to its bound is told
        worst = self.found.get(check.name)
        if worst is None or check.value - check.bound < worst.value - worst.bound:
            self.found[check.name] = check
        return margin, centre

    def _judge_tipping(self, k: int, motion: Motion, t: Array, safe: Array, finite: Array, clock: Array) -> Array:
        """Measure how far one phase is from tipping over in motion, and judge it where the task asks for it."""
        task, phase = self.task, self.task.phases[k]
        unknown = np.full(len(t), np.nan)
        if phase.stability is None or not phase.standing:
            return unknown
        polygon = build_polygon(task.machine, safe[0], phase.standing, task.down)
        if len(polygon.corners) < 3:
            return unknown
        V, A = (np.asarray(motion(t, order), dtype=float) for order in (1, 2))
        known = finite & np.all(np.isfinite(V) & np.isfinite(A), axis=1)
        V, A = (np.where(known[:, None], values, 0.0) for values in (V, A))
        edges = measure_tipping(task.machine, polygon, safe, V, A)
        least = np.where(known, np.min(edges, axis=1), -np.inf)
        if task.tipping is not None:
            rest = polygon.distances(measure_centre(task.machine, safe))
            allowance = self.tolerances.tipping * np.maximum(rest - task.tipping, 0.0)
            short = np.where(known, np.min(edges + allowance, axis=1), -np.inf)
            i = int(np.argmin(short))
            worst = self.found.get("distance from tipping")
            if worst is None or least[i] < worst.value or (worst.passed and short[i] < task.tipping):
                self.found["distance from tipping"] = Check(
                    "distance from tipping", float(least[i]), task.tipping, "m", float(clock[i]),
                    f"phase {phase.name!r}", bool(short[i] >= task.tipping), ">=",
                )  # fmt: skip
        return least

    def look_at_borders(self, trajectory: LeggedTrajectory) -> None:
        """Judge continuity, and rest on both sides, where phases meet, and at both ends."""
        mechanism = trajectory.robot.mechanism
        scale = trajectory.robot.kinematics.graph.variable_scale
        parts, marks = trajectory.parts, trajectory.marks
        speeds = []
        for part in parts:
            V = np.abs(np.asarray(part(np.linspace(0.0, part.duration, 41), 1))) / scale
            speeds.append(float(np.max(V, where=np.isfinite(V), initial=1e-12)))
        for k, (part, mark) in enumerate(zip(parts, marks, strict=True)):
            for at, clock, side in ((0.0, mark.start, "begins"), (part.duration, mark.end, "ends")):
                V = np.abs(np.asarray(part(at, 1))) / (scale * speeds[k])
                i = int(np.argmax(np.where(np.isnan(V), np.inf, V)))
                where = f"phase {mark.name!r} {side}, {mechanism.names[i]!r}"
                self._largest(
                    "contacts change at rest", V[i : i + 1], self.tolerances.rest, "1", np.array([clock]), where
                )
            if k + 1 < len(parts):
                jump = np.abs(np.asarray(parts[k + 1](0.0)) - np.asarray(part(part.duration)))
                i = int(np.argmax(np.where(np.isnan(jump), np.inf, jump)))
                where = f"phase {mark.name!r} to {marks[k + 1].name!r}, {mechanism.names[i]!r}"
                clocks = np.array([mark.end])
                unit = mechanism.variables[i].unit
                self._largest("pose jumps", jump[i : i + 1], self.tolerances.continuity, unit, clocks, where)

    def conclude(self) -> tuple[Check, ...]:
        """Give the checks."""
        return tuple(self.found.values())

    def _largest(self, name: str, values: Array, bound: float, unit: str, clock: Array, where: str) -> None:
        """Judge the largest of values (n,) at times (n,) against an upper bound; the worst of all calls is kept."""
        table = np.where(np.isnan(values), np.inf, values)
        i = int(np.argmax(table))
        worst = self.found.get(name)
        if worst is None or table[i] > worst.value:
            value = float(table[i])
            self.found[name] = Check(name, value, bound, unit, float(clock[i]), where, value <= bound)
