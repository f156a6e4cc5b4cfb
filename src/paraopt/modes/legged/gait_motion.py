"""A gait: phases from rest to rest, each a cubic of the trunk and of the lifted foot, and what is measured on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, CubicSpline

from paraopt.errors import DefinitionError
from paraopt.modes.legged.balance import SupportPolygon, measure_centre
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_steps import Part
from paraopt.modes.legged.gait_table import CONTROL, bernstein, run_law
from paraopt.modes.legged.machine import LeggedMachine

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GaitPhase:
    """Describe a phase: the trunk shifts over standing feet, or a foot swings to its next foothold.

    Attributes:
        name: Name, such as "cycle 2: swing left rear".
        foot: Foot that swings, or before whose swing the trunk shifts; empty for the last shift back to rest.
        kind: "shift" or "swing".
        part: Part of the gait.
        trunk: Control points of the trunk's cubic [m, rad], shape (4, 6).
        feet: Control points of all feet [m], shape (4, n_feet, 3).
        joints: Joints of the legs, of the branch that is followed, at even parameters, shape (n, n_joints).
        s: These parameters, shape (n,).
    """

    name: str
    foot: str
    kind: Literal["shift", "swing"]
    part: Part
    trunk: Array
    feet: Array
    joints: Array
    s: Array

    def moved(self, travel: Array, steps: Array) -> GaitPhase:
        """Give the same phase elsewhere: the trunk's pose changed by `travel`, all feet by `steps` (3,)."""
        return replace(self, trunk=self.trunk + travel, feet=self.feet + steps)

    @property
    def is_still(self) -> bool:
        """Tell whether nothing moves."""
        return bool(np.ptp(self.trunk, axis=0).max() < 1e-12 and np.ptp(self.feet, axis=0).max() < 1e-12)


@dataclass(frozen=True, eq=False)
class PhaseSamples:
    """Hold what is measured on a phase at n samples.

    Attributes:
        s: Parameters, shape (n,).
        X: Configurations, shape (n, n_variables).
        distances: Distances of the centre of gravity inside each edge of the support polygon [m], shape (n, n_edges).
        edges: Names of the edges.
        regularity: Least determinant of a leg over that at rest [1], shape (n,).
        time: Shortest time of the phase under the law from rest to rest [s].
    """

    s: Array
    X: Array
    distances: Array
    edges: tuple[str, ...]
    regularity: Array
    time: float

    @property
    def margins(self) -> Array:
        """Give the support margin [m], shape (n,)."""
        return np.asarray(self.distances.min(axis=1))

    @property
    def bound(self) -> float:
        """Bound the support margin from below between the samples too [m].

        Between two samples a smooth function dips below both by at most `h^2 / 8 max |d''|`; the second derivative is
        taken from second differences, and counted twice.
        """
        bend = np.max(np.abs(np.diff(self.distances, n=2, axis=0)), axis=0, initial=0.0)
        return float(np.min(self.distances.min(axis=0) - 0.25 * bend))


@dataclass(frozen=True, eq=False)
class Gait:
    """Hold a gait.

    Attributes:
        model: The machine.
        phases: The phases, in order.
        gravity: Unit direction of gravity.
        travel: How far the trunk moves in all, change of its pose [m, rad], shape (6,).
        cycle: First phase of the cycle and first one after it; equal without a cycle.
        cycle_travel: How far it moves in a cycle.
        scale: Factor by which the steps were made longer than stated [1].
        margin: Support margin at the samples of the program [m]; nan for a gait that was stated.
        n_samples: Number of samples of each phase in the program.
        status: How the program ended.
    """

    model: GaitModel
    phases: tuple[GaitPhase, ...]
    gravity: Array
    travel: Array
    cycle: tuple[int, int]
    cycle_travel: Array
    scale: float = 1.0
    margin: float = float("nan")
    n_samples: int = 9
    status: str = ""

    def repeated(self, cycles: int) -> Gait:
        """Give the gait with its cycle repeated, each time from where the one before ended.

        Args:
            cycles: Number of cycles, at least one.

        Raises:
            DefinitionError: There is no cycle, or the number is not a whole one above 0.
        """
        first, last = self.cycle
        if last <= first:
            raise DefinitionError("this gait has no cycle to repeat")
        if not (isinstance(cycles, int) and cycles >= 1):
            raise DefinitionError(f"number of cycles is {cycles!r}; it must be a whole number above 0")
        steps = self.phases[last - 1].feet[-1].mean(axis=0) - self.phases[first].feet[0].mean(axis=0)
        found = list(self.phases[:first])
        for k in range(cycles):
            found += [
                replace(
                    phase.moved(k * self.cycle_travel, k * steps), name=phase.name.replace("cycle ", f"cycle {k + 1}.")
                )
                for phase in self.phases[first:last]
            ]
        more = (cycles - 1) * self.cycle_travel
        found += [phase.moved(more, (cycles - 1) * steps) for phase in self.phases[last:]]
        end = first + cycles * (last - first)
        return replace(
            self,
            phases=tuple(found),
            travel=self.travel + more,
            cycle=(first, end),
            cycle_travel=cycles * self.cycle_travel,
        )

    def with_masses(self, factors: ArrayLike) -> Gait:
        """Give the same motion of a machine whose links are heavier or lighter by factors, one for each mass.

        Raises:
            DefinitionError: There are not as many factors as masses.
        """
        machine = self.model.machine
        masses = dict(machine.masses or {})
        shares = np.asarray(factors, dtype=float).ravel()
        if len(shares) != len(masses):
            raise DefinitionError(f"{len(shares)} factors are given for the masses of {len(masses)} links")
        scaled = {link: float(mass * share) for (link, mass), share in zip(masses.items(), shares, strict=True)}
        heavier: LeggedMachine = replace(machine, masses=scaled)
        return replace(self, model=GaitModel(heavier))

    def sample(self, count: int = 81) -> tuple[PhaseSamples, ...]:
        """Look at every phase at `count` instants, evenly spread in time under the law from rest to rest.

        The loops are closed anew at each, along the branch that the phase holds.

        Raises:
            InfeasibleError: A foot does not reach its foothold somewhere.
        """
        s = run_law(np.linspace(0.0, 1.0, count))
        basis = bernstein(s)
        mechanism, model = self.model.machine.robot.mechanism, self.model
        n, index = len(s), mechanism.indices(model.joints)
        X = np.repeat(model.rest[None], n * len(self.phases), axis=0)
        for k, phase in enumerate(self.phases):
            guess = CubicSpline(phase.s, phase.joints, axis=0)(s) if len(phase.s) > 1 else phase.joints
            X[k * n : (k + 1) * n, index] = guess
        poses = np.concatenate([basis @ phase.trunk for phase in self.phases])
        shape = (-1, len(model.machine.feet), 3)
        places = np.concatenate([(basis @ phase.feet.reshape(CONTROL, -1)).reshape(shape) for phase in self.phases])
        X = model.solve(poses, places, X)
        centres, regularity = measure_centre(model.machine, X), model.regularity(X).min(axis=1)
        found = []
        for k, phase in enumerate(self.phases):
            rows = slice(k * n, (k + 1) * n)
            polygon = self.polygon(phase)
            time = self._measure_time(X[rows][:, index])
            found.append(
                PhaseSamples(s, X[rows], polygon.distances(centres[rows]), polygon.edges, regularity[rows], time)
            )
        return tuple(found)

    def standing(self, phase: GaitPhase) -> tuple[str, ...]:
        """Name the feet that stand during a phase."""
        return tuple(n for n in self.model.machine.names if phase.kind == "shift" or n != phase.foot)

    def polygon(self, phase: GaitPhase) -> SupportPolygon:
        """Give the support polygon of a phase."""
        standing = self.standing(phase)
        index = [self.model.machine.names.index(n) for n in standing]
        return SupportPolygon.over(standing, phase.feet[0, index], self.gravity)

    def curve(self, phase: GaitPhase) -> tuple[tuple[str, ...], BSpline]:
        """Give the coordinates that move in a phase, those of the trunk and of the swinging foot, and their cubic."""
        names, columns = list(self.model.trunk), [phase.trunk]
        if phase.kind == "swing":
            k = self.model.machine.names.index(phase.foot)
            names += self.model.machine.feet[k].variables
            # placing a foot is affine, so that its control points give those of its variables
            columns.append(self.model.carriers_at(phase.feet)[:, 3 * k : 3 * k + 3])
        return tuple(names), BSpline(np.repeat([0.0, 1.0], CONTROL), np.hstack(columns), CONTROL - 1)

    @cached_property
    def length(self) -> float:
        """Give how far the trunk goes in a cycle [m], in all where there is none."""
        return float(np.linalg.norm(self.cycle_travel[:3] if self.cycle[1] > self.cycle[0] else self.travel[:3]))

    def times(self, samples: Sequence[PhaseSamples]) -> Array:
        """Give the shortest time of every phase under the law from rest to rest [s], shape (n_phases,)."""
        return np.array([found.time for found in samples])

    def speed(self, samples: Sequence[PhaseSamples]) -> float:
        """Estimate how far the trunk gets in the time of its cycle [m/s], in all where there is none."""
        first, last = self.cycle if self.cycle[1] > self.cycle[0] else (0, len(self.phases))
        return self.length / float(self.times(samples)[first:last].sum())

    def _measure_time(self, q: Array) -> float:
        """Give the shortest time in which the law from rest to rest keeps the limits of the drives [s]."""
        limits, rate, time = self.model.machine.robot.limits, q, 0.0
        for order, quantity in enumerate(("velocity", "acceleration", "jerk"), start=1):
            rate = np.gradient(rate, 1.0 / (len(q) - 1), axis=0, edge_order=2)
            use = np.max(np.abs(rate) / limits.of(quantity, self.model.joints), initial=0.0)
            time = max(time, float(use) ** (1.0 / order))
        return time
