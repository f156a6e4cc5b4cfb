"""The trunk's way as a nonlinear program: largest smallest margin, or shortest time, with every foot in its place."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.interior import build_program, run_program
from paraopt.modes.legged.gait_mapped import MappedRows, build_derivatives
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_options import COORDINATES, GaitOptions
from paraopt.modes.legged.gait_steps import Footfalls
from paraopt.modes.legged.gait_table import CONTROL, PhaseTable, bernstein, run_law

Array = NDArray[np.float64]

# the jerk is left to the time law: its rows make the program three times slower and change its times by a hundredth
DRIVES = ((1, "velocity"), (2, "acceleration"))


@dataclass(frozen=True)
class ProgramShape:
    """Say what makes two programs the same but for their numbers.

    Attributes:
        n_lifts: Number of lifts.
        cycle: First lift of the cycle and first one after it; equal without a cycle.
        is_periodic: Whether the cycle stands alone, its first pose free.
        shifts: Whether the trunk shifts before each lift, and after the last one, with all feet standing.
        samples: Number of samples of a phase.
        swing_moves: Whether the trunk moves while a foot is in the air.
        is_timed: Whether the time of the phases is part of the program.
    """

    n_lifts: int
    cycle: tuple[int, int]
    is_periodic: bool
    shifts: tuple[bool, ...]
    samples: int
    swing_moves: bool
    is_timed: bool

    @property
    def n_phases(self) -> int:
        """Give the number of phases: a shift before each lift, and one after the last unless the cycle stands alone."""
        return 2 * self.n_lifts + (0 if self.is_periodic else 1)

    @property
    def cycle_phases(self) -> tuple[int, int]:
        """Give the first phase of the cycle and the first one after it."""
        return 2 * self.cycle[0], 2 * self.cycle[1]


@dataclass(frozen=True, eq=False)
class Answer:
    """Hold what the program found.

    Attributes:
        control: Control points of the trunk [m, rad], shape (n_phases, 4, 6).
        joints: Joints of the legs at the samples [m or rad], shape (n_phases, n_samples, n_joints).
        margin: Smallest margin at the samples [m].
        scale: Factor of the steps [1].
        times: Times of the phases [s], shape (n_phases,); zero where the program is not timed.
        status: What IPOPT says.
        violation: Largest violation of a constraint, scaled [1].
        iterations: Number of iterations.
    """

    control: Array
    joints: Array
    margin: float
    scale: float
    times: Array
    status: str
    violation: float
    iterations: int


def narrow(ranges: tuple[Array, Array], reserve: float) -> tuple[Array, Array]:
    """Leave out a share of ranges at both of their ends; ranges without end stay as they are."""
    low, high = ranges
    width = np.where(np.isfinite(high - low), high - low, 0.0)
    return low + reserve * width, high - reserve * width


class GaitProgram:
    """Build the program of one shape once, to be solved for many numbers: footholds, gravity, masses, bounds.

    Unknowns are the control points of the trunk about their nominal places, the joints at the samples, the margin, the
    factor of the steps and, where timed, the time of each phase. The feet are where they must be at every sample, and
    the distance of the centre of gravity from every edge of the support polygon, both seen along gravity, is at least
    the margin.

    Args:
        model: The machine.
        shape: Which phases there are.
        options: What may move, and how far.

    Source: McGheeFrank1968; ipopt.
    """

    def __init__(self, model: GaitModel, shape: ProgramShape, options: GaitOptions) -> None:
        self.model, self.shape, self.options = model, shape, options
        self.unit = 0.1 * model.machine.robot.mechanism.length  # lengths of the program, of the order of its margins
        self.tau = np.linspace(0.0, 1.0, shape.samples)
        self.basis = bernstein(run_law(self.tau))
        self.n_feet, self.n_joints = len(model.machine.feet), len(model.joints)
        self._solver = self._build()

    @cached_property
    def spread(self) -> Array:
        """Give the matrix from free deviations to those of all control points, shape (4 n_phases, n_free).

        Knots are shared by neighbouring phases; where the trunk stands, both ends are one. The first and the last knot
        of a whole gait are at rest; those of a cycle are the same.
        """
        shape, K = self.shape, self.shape.n_phases
        label = list(range(K + 1))

        def join(a: int, b: int) -> None:
            old, new = label[b], label[a]
            label[:] = [new if value == old else value for value in label]

        moves = [shape.swing_moves if k % 2 else shape.shifts[k // 2] for k in range(K)]
        for k in range(K):
            if not moves[k]:
                join(k, k + 1)
        first, last = shape.cycle_phases
        if last > first:
            join(first, last)
        fixed = set() if shape.is_periodic else {label[0], label[K]}
        columns = {value: i for i, value in enumerate(dict.fromkeys(v for v in label if v not in fixed))}
        inner = [k for k in range(K) if moves[k] and not self.options.straight]
        M = np.zeros((CONTROL * K, len(columns) + 2 * len(inner)))
        for k in range(K):
            for row, share in enumerate(np.linspace(0.0, 1.0, CONTROL)):
                for knot, weight in ((k, 1.0 - share), (k + 1, share)):
                    if label[knot] in columns and (row in (0, CONTROL - 1) or k not in inner):
                        M[CONTROL * k + row, columns[label[knot]]] += weight
            if k in inner:
                at = len(columns) + 2 * inner.index(k)
                M[CONTROL * k + 1, at] = M[CONTROL * k + 2, at + 1] = 1.0
        return M

    # -- the program ---------------------------------------------------------------------------------------------------

    def _build(self) -> ca.Function:
        K, N, nq, n = self.shape.n_phases, self.shape.samples, self.n_joints, self.n_feet
        free, count = self.spread.shape[1], K * N
        sizes = self._z_split = [6 * free, nq * count, 1, 1, K]
        z = ca.MX.sym("z", sum(sizes))
        p = ca.MX.sym("p", sum(rows * columns for rows, columns in self._parameters().values()))
        given = self._read(p)
        # quantities of a sample: the trunk's pose, the joints, the places of the feet
        width = 6 + nq + 3 * n
        poses = np.kron(np.eye(K), self.basis) @ self.spread  # of the control points' deviations, at the samples
        fixed = np.zeros((count, width, sum(sizes)))
        for i, unit in enumerate(np.where(np.arange(6) < 3, self.unit, 1.0)):
            fixed[:, i, i * free : (i + 1) * free] = unit * poses
        at = 6 * free + np.arange(count)[:, None] * nq + np.arange(nq)
        fixed[np.arange(count)[:, None], 6 + np.arange(nq), at] = 1.0
        scaled = ca.vec(ca.vertcat(given["pose 1"], ca.MX(nq, count), given["place 1"]))
        before, after = sum(sizes[:3]), K
        P = ca.MX(ca.sparsify(ca.DM(fixed.reshape(-1, sum(sizes))))) + ca.horzcat(
            ca.MX(width * count, before), scaled, ca.MX(width * count, after)
        )
        c = ca.vec(ca.vertcat(given["pose 0"], ca.MX.zeros(nq, count), given["place 0"]))
        data = [given["tails"], given["heads"], ca.repmat(given["axes"], 1, count)]
        margin = np.zeros((count, 5 * n, sum(sizes)))
        margin[:, 3 * n : 4 * n, before - 1] = -1.0  # distances less the margin
        slack = ca.sparsify(ca.DM(margin.reshape(-1, sum(sizes))))
        mapped = MappedRows(self._sample(), count)
        problem, derivatives = build_derivatives(mapped, P, c, data, slack, self._rest(), z, p)
        return build_program("gait", problem, self.options.iterations, self.options.tolerance, derivatives)

    def _read(self, p: ca.MX | ca.SX) -> dict[str, Any]:
        """Split the parameters by name."""
        found, at = {}, 0
        for name, (rows, columns) in self._parameters().items():
            found[name] = ca.reshape(p[at : at + rows * columns], rows, columns)
            at += rows * columns
        return found

    def _rest(self) -> ca.Function:
        """Map unknowns and parameters to the objective and to the rows of drives and pace."""
        K, N, nq = self.shape.n_phases, self.shape.samples, self.n_joints
        z = ca.SX.sym("z", sum(self._z_split))
        p = ca.SX.sym("p", sum(rows * columns for rows, columns in self._parameters().values()))
        d, q, t, scale, T = ca.vertsplit(z, [0, *np.cumsum(self._z_split).tolist()])
        d, q, given = ca.reshape(d, -1, 6), ca.reshape(q, nq, K * N), self._read(p)
        pace = ca.dot(given["repeat"], T) / scale if self.shape.is_timed else ca.SX(0)
        rows = ca.vertcat(self._drives(q, T), pace) if self.shape.is_timed else ca.SX(0, 1)
        # the ways between control points, and how far they are from where they would be nominally
        differences = np.kron(np.eye(K), np.diff(np.eye(CONTROL), axis=0)) @ self.spread
        motion = ca.sumsqr(ca.sparsify(ca.DM(differences)) @ d)
        motion += 1e-2 * ca.sumsqr(ca.sparsify(ca.DM(self.spread)) @ d)
        w = given["weights"]
        return ca.Function("rest", [z, p], [-w[0] * t + w[1] * pace + w[2] * motion / K, rows])

    def _parameters(self) -> dict[str, tuple[int, int]]:
        K, N, n = self.shape.n_phases, self.shape.samples, self.n_feet
        return {
            "pose 0": (6, K * N), "pose 1": (6, K * N), "place 0": (3 * n, K * N), "place 1": (3 * n, K * N),
            "tails": (n * n, K * N), "heads": (n * n, K * N), "axes": (6, 1), "repeat": (K, 1), "weights": (3, 1),
        }  # fmt: skip

    def _sample(self) -> ca.Function:
        """Map one sample to gaps at the feet and distances from edges, in units of the program, and to regularity."""
        n, nq = self.n_feet, self.n_joints
        u = ca.SX.sym("u", 6 + nq + 3 * n)
        p, q, places = ca.vertsplit(u, [0, 6, 6 + nq, 6 + nq + 3 * n])
        tails, heads = ca.SX.sym("tails", n * n), ca.SX.sym("heads", n * n)
        axes = ca.SX.sym("axes", 6)
        feet, centre, regularity = self.model.stance(p, q)
        wanted = ca.reshape(places, 3, n).T
        H = ca.reshape(axes, 3, 2)
        level = ca.mtimes(wanted, H)
        tail, head = ca.reshape(tails, n, n).T @ level, ca.reshape(heads, n, n).T @ level
        along, off = head - tail, ca.repmat(ca.mtimes(centre.T, H), n, 1) - tail
        cross = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]
        distances = cross / ca.sqrt(along[:, 0] ** 2 + along[:, 1] ** 2) / self.unit
        gaps = ca.vec((feet - wanted).T) / self.unit
        rows = ca.densify(ca.vertcat(gaps, distances, regularity))
        return ca.Function("sample", [u, tails, heads, axes], [rows], {"cse": True})

    def _drives(self, q: ca.SX, T: ca.SX) -> ca.SX:
        """Bound differences of the joints between samples by what the drives can do in the time of a phase."""
        limits, h, N = self.model.machine.robot.limits, float(self.tau[1]), self.shape.samples
        rows = []
        for order, quantity in DRIVES:
            bound = limits.of(quantity, self.model.joints)
            used = np.flatnonzero(np.isfinite(bound)).tolist()
            if not used:
                continue
            D = ca.DM(np.diff(np.eye(N), n=order, axis=0).T / h**order)
            for k in range(self.shape.n_phases):
                use = ca.diag(1.0 / ca.DM(bound[used])) @ q[used, k * N : (k + 1) * N] @ D
                use = ca.vec(use)
                rows += [T[k] ** order - use, T[k] ** order + use]
        return ca.vertcat(*rows)

    def estimate_times(self, joints: Array) -> Array:
        """Give the shortest times of phases in which the joints keep their limits, by differences of the samples [s].

        Args:
            joints: Joints at the samples [m or rad], shape (n_phases, n_samples, n_joints).
        """
        limits, h = self.model.machine.robot.limits, float(self.tau[1])
        times = np.full(len(joints), self.options.least_time)
        for order, quantity in DRIVES:
            use = np.abs(np.diff(joints, n=order, axis=1)) / h**order / limits.of(quantity, self.model.joints)
            times = np.maximum(times, np.max(use, axis=(1, 2), initial=0.0) ** (1.0 / order))
        return times

    # -- its numbers ---------------------------------------------------------------------------------------------------

    def solve(
        self,
        falls: Footfalls,
        table: PhaseTable,
        axes: Array,
        joints: Array,
        *,
        weights: tuple[float, float, float],
        margin: tuple[float, float] = (-np.inf, np.inf),
        scale: tuple[float, float] = (1.0, 1.0),
        slowest: float = np.inf,
        repeat: Array | None = None,
        guess: Answer | None = None,
    ) -> Answer:
        """Solve the program.

        Args:
            falls: The footfalls, of the program's shape.
            table: Their phases.
            axes: Axes of the level plane, shape (2, 3).
            joints: Joints at the samples to begin with, shape (n_phases, n_samples, n_joints).
            weights: Weights of the margin [1/unit], of the time over the factor of the steps [1/s], and of the motion.
            margin: Least and largest margin [m].
            scale: Least and largest factor of the steps.
            slowest: Largest time over the factor of the steps [s].
            repeat: How often each phase counts in the time, shape (n_phases,); once when None.
            guess: Where to begin, when not at the nominal way.

        Returns:
            Where IPOPT ended.

        Raises:
            BackendError: IPOPT failed in an unexpected way.
        """
        K, N, options = self.shape.n_phases, self.shape.samples, self.options
        rest_places, rest_pose = self.model.rest_places, self.model.rest_pose
        normals = falls.normals()
        nominal = (self.basis @ table.nominal).reshape(K * N, 6)
        places = np.array(
            [self.basis @ table.foot_control(k, normals, falls.height).reshape(CONTROL, -1) for k in range(K)]
        ).reshape(K * N, -1)
        bare = np.array(
            [self.basis @ table.foot_control(k, 0 * normals, falls.height).reshape(CONTROL, -1) for k in range(K)]
        ).reshape(K * N, -1)
        selections = np.zeros((2, K, self.n_feet, self.n_feet))
        for k, edges in enumerate(table.edges):
            # where there are fewer edges than feet the last one is counted again
            for e in range(self.n_feet):
                a, b = edges[min(e, len(edges) - 1)]
                selections[0, k, e, a] = selections[1, k, e, b] = 1.0
        pose_1 = nominal - rest_pose if falls.is_scalable else 0 * nominal
        place_1 = bare - rest_places.ravel() if falls.is_scalable else 0 * places
        values = [
            nominal - pose_1, pose_1, places - place_1, place_1,
            np.repeat(selections[0], N, axis=0), np.repeat(selections[1], N, axis=0),
            axes, np.ones(K) if repeat is None else repeat, weights,
        ]  # fmt: skip
        parameters = np.concatenate([np.asarray(v, dtype=float).ravel() for v in values])
        free = self.spread.shape[1]
        most = self._largest_deviations()
        low_q, high_q = (np.tile(b, K * N) for b in narrow(self.model.joint_range, options.reserve))
        at_most = np.concatenate([most, high_q, [margin[1] / self.unit, scale[1]], np.full(K, 20.0)])
        at_least = np.concatenate([-most, low_q, [margin[0] / self.unit, scale[0]], np.full(K, options.least_time)])
        if guess is None:
            begin = np.concatenate([np.zeros(6 * free), joints.ravel(), [-1.0, 1.0], self.estimate_times(joints)])
        else:
            deviation = (guess.control - self._nominal_control(table, falls, guess.scale)).reshape(-1, 6)
            d = np.linalg.lstsq(self.spread, deviation / np.where(np.arange(6) < 3, self.unit, 1.0), rcond=None)[0]
            times = self.estimate_times(guess.joints)
            begin = np.concatenate([d.T.ravel(), guess.joints.ravel(), [guess.margin / self.unit, guess.scale], times])
        # by sample: the feet in their places, the edges, the legs
        n, endless = self.n_feet, np.full(2 * self.n_feet, np.inf)
        lower = [np.tile(np.concatenate([np.zeros(4 * n), np.full(n, options.regularity)]), K * N)]
        upper = [np.tile(np.concatenate([np.zeros(3 * n), endless]), K * N)]
        if self.shape.is_timed:
            n_drive = int(self._solver.size1_in("lbg")) - 5 * n * K * N - 1
            lower += [np.zeros(n_drive), np.zeros(1)]
            upper += [np.full(n_drive, np.inf), np.array([slowest])]
        bounds = np.concatenate(lower), np.concatenate(upper)
        z, g, iterations, status = run_program(
            self._solver, begin, parameters, (at_least, at_most), bounds, what="the gait"
        )
        parts = np.split(z, np.cumsum(self._z_split)[:-1])
        deviation = self.spread @ (parts[0].reshape(6, free).T * np.where(np.arange(6) < 3, self.unit, 1.0))
        found = float(parts[3][0])
        control = self._nominal_control(table, falls, found) + deviation.reshape(K, CONTROL, 6)
        violation = float(np.max(np.maximum(bounds[0] - g, g - bounds[1])))
        return Answer(
            control, parts[1].reshape(K, N, self.n_joints), float(parts[2][0] * self.unit), found,
            parts[4] if self.shape.is_timed else np.zeros(K), status, violation, iterations,
        )  # fmt: skip

    def _largest_deviations(self) -> Array:
        """Give the bounds of the free deviations, coordinate by coordinate, in units of the program."""
        options, free = self.options, self.spread.shape[1]
        most = [options.reach / self.unit] * 3 + [options.tilt] * 3
        return np.repeat([m if c in options.free else 0.0 for m, c in zip(most, COORDINATES, strict=True)], free)

    def _nominal_control(self, table: PhaseTable, falls: Footfalls, scale: float) -> Array:
        if not falls.is_scalable:
            return table.nominal
        return np.asarray(self.model.rest_pose + scale * (table.nominal - self.model.rest_pose))
