"""`Kinematics`: one mechanism, its compiled functions, and every model as a call of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.closure import ClosureGraph, Gauge, build_closure
from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics.batch import BatchSolution, answer_exactly, answer_nearest
from paraopt.kinematics.codegen import Backend
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.functions import FunctionSet
from paraopt.kinematics.legs import Leg, find_legs
from paraopt.kinematics.solution import Solution
from paraopt.kinematics.solve import ClosureSolution, SolveOptions, solve_closure
from paraopt.kinematics.xfkm import Question
from paraopt.mechanism import Mechanism

if TYPE_CHECKING:  # built on this module
    from paraopt.kinematics.assembly_modes import AssemblyModes, AssemblyOptions
    from paraopt.kinematics.working_modes import Mode, WorkingModeOptions, WorkingModes

Array = NDArray[np.float64]
_DAMPING = np.array([1e-12])


class Jacobians(NamedTuple):
    """Hold the column blocks of `E = dF/dX`, so that `M qdot_a + N qdot_p + K xdot = 0`.

    Attributes:
        M: Columns of the active variables, shape (n_equations, n_active).
        N: Columns of the passive variables, shape (n_equations, n_passive).
        K: Columns of the operational variables, shape (n_equations, n_operational).
    """

    M: Array
    N: Array
    K: Array


Start = Configuration | Mapping[str, float] | ArrayLike


class Kinematics:
    """Evaluate and solve the closure equations of a mechanism.

    Args:
        mechanism: The description.
        backend: "auto" uses generated C when a compiler is found and CasADi's virtual machine otherwise.
        options: Tolerances of the solves.
        gauges: Quantities read off the configuration, added to the mechanism as passive variables.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        backend: Backend = "auto",
        options: SolveOptions | None = None,
        gauges: Sequence[Gauge] = (),
    ) -> None:
        self.graph: ClosureGraph = build_closure(mechanism, gauges)
        self.mechanism = self.graph.mechanism
        self.gauges = tuple(gauges)
        self.functions = FunctionSet(self.graph, backend)
        self.options = options or SolveOptions()
        E = self.graph.E
        column_used = np.zeros(len(self.mechanism.names), dtype=bool)
        column_used[np.asarray(E.sparsity().get_triplet()[1], dtype=int)] = True
        self._structurally_used = column_used

    def with_gauges(self, *gauges: Gauge) -> Kinematics:
        """Add quantities that can then be imposed, or are solved for, like variables.

        Args:
            gauges: Quantities read off the configuration; those that are there already stay.

        Returns:
            The kinematics of the same mechanism with more passive variables.

        Raises:
            DefinitionError: A gauge has the name of a variable, or its expression cannot be built.
        """
        plain = self.mechanism
        if self.gauges:
            added = {g.name for g in self.gauges}
            plain = replace(plain, links=[k for k in plain.links if not {m.name for m in k.motions} & added])
        return Kinematics(plain, self.functions.backend, self.options, (*self.gauges, *gauges))

    def prepare(self, independent: Sequence[str] | None = None) -> None:
        """Compile, or load from the cache, all functions that planning needs; without it each is made at its first use.

        Args:
            independent: Independent coordinates of the planned path; the operational variables when None.
        """
        m = len(self.mechanism.operational if independent is None else independent)
        self.functions.prepare(m)

    # -- evaluation ------------------------------------------------------------------------------------------------

    def residual(self, X: ArrayLike) -> Array:
        """Evaluate the closure residual F(X) [m or 1], shape (n_equations,)."""
        return self.functions.residual(X)[0]

    def scaled_residual(self, X: ArrayLike) -> Array:
        """Give the largest residual at n points X (n, n_variables), lengths in characteristic lengths [1]."""
        (F,) = self.functions.residual.batch(np.atleast_2d(np.asarray(X, dtype=float)))
        return np.max(np.abs(F) / self.graph.row_scale, axis=1, initial=0.0)

    def jacobians(self, X: ArrayLike) -> Jacobians:
        """Evaluate M, N and K at one point; a block of one column is a matrix too."""
        n = self.graph.F.numel()
        return Jacobians(*[b.reshape(n, w) for b, w in zip(self.functions.jacobians(X), self._widths, strict=True)])

    def jacobians_batch(self, X: ArrayLike) -> Jacobians:
        """Evaluate M, N and K at n points; each block has shape (n, n_equations, n_columns)."""
        n = self.graph.F.numel()
        blocks = zip(self.functions.jacobians.batch(X), self._widths, strict=True)
        return Jacobians(*[b.reshape(len(b), n, w) for b, w in blocks])

    @property
    def _widths(self) -> tuple[int, int, int]:
        m = self.mechanism
        return len(m.active), len(m.passive), len(m.operational)

    def poses(self, X: ArrayLike) -> Array:
        """Evaluate the poses of all links in the world at n points.

        Args:
            X: Values of all variables [m or rad], shape (n, n_variables).

        Returns:
            Homogeneous transforms in the order of `mechanism.links`, shape (n, n_links, 4, 4).
        """
        X = np.atleast_2d(np.asarray(X, dtype=float))
        poses = np.zeros((len(X), len(self.mechanism.links), 4, 4))
        poses[..., 3, 3] = 1.0
        poses[:, :, :3, :] = self.functions.poses.batch(X)[0].reshape(len(X), -1, 3, 4)
        return poses

    def configuration(self, X: ArrayLike) -> Configuration:
        """Check the closures and return the configuration.

        Raises:
            SolveError: The loops are open.
        """
        vector = np.asarray(X, dtype=float)
        return Configuration(self.mechanism, vector, float(self.scaled_residual(vector)[0]))

    @property
    def idle(self) -> tuple[str, ...]:
        """Name the variables that enter no closure equation, whatever their values: internal mobilities."""
        return tuple(n for n, used in zip(self.mechanism.names, self._structurally_used, strict=True) if not used)

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """List the blocks into which the equations fall apart when the platform is imposed; see `find_legs`."""
        return find_legs(self.graph)

    # -- solving ---------------------------------------------------------------------------------------------------

    def solve(
        self, impose: Mapping[str, float], start: Start | None = None, options: SolveOptions | None = None
    ) -> Solution:
        """Impose any set of variables and solve for the rest.

        The exact problem is tried first. When it has no solution near the start, the nearest values are found
        subject to the closures and the joint ranges (XFKM).

        Args:
            impose: Values by name [m or rad].
            start: Where to start: a configuration, values by name (others zero), or all values; zeros and then
                seeded random angles when None.
            options: Tolerances; those of this object when None.

        Returns:
            The answer with status, residual and rank. It never raises for a target that cannot be met.

        Raises:
            DefinitionError: A value is not finite.
            UnknownNameError: A name does not exist.

        Source: Lahouar, II.3; Tripod.
        """
        return self._ask(impose, {}, options, within_ranges=False).answer(self._starts(start))

    def fit(
        self,
        impose: Mapping[str, float],
        start: Start | None = None,
        weights: Mapping[str, float] | None = None,
        options: SolveOptions | None = None,
    ) -> Solution:
        """Come as near to imposed values as closures and joint ranges allow (XFKM).

        `minimise sum w_i^2 (X_i - imposed_i)^2 / s_i^2` over the closed configurations within the ranges. Unlike
        `solve`, an exact solution outside the ranges is no answer. Newton's method is tried first, then sequential
        quadratic programming on the closures, then IPOPT.

        Args:
            impose: Values by name [m or rad].
            start: Where to start, as for `solve`.
            weights: Weight of each imposed variable [1], above 0; 1 where nothing is said.
            options: Tolerances; those of this object when None.

        Returns:
            The answer: CONVERGED or SINGULAR when the values are met, NEAREST when not, with the variables at the ends
            of their ranges, FAILED when the loops could not be closed within the ranges.

        Raises:
            DefinitionError: A value is not finite, or a weight is not finite and above 0.
            UnknownNameError: A name does not exist.

        Source: Lahouar, II.3; Tripod.
        """
        return self._ask(impose, weights or {}, options, within_ranges=True).answer(self._starts(start))

    def inverse(self, x: Mapping[str, float], start: Start | None = None, mode: Mode | None = None) -> Solution:
        """Solve for the joints at an operational pose: `solve` with the operational variables imposed.

        Args:
            x: Operational variables by name [m or rad].
            start: Where to start; see `solve`.
            mode: The working mode wanted, such as "+-" or (1, -1), one sign for each of `legs`; the mode of the start
                when None.

        Raises:
            DefinitionError: The pose is incomplete, or the mode does not name one posture of each leg.
            SolveError: A leg has no such posture at this pose; the modes that exist travel as evidence.
        """
        self._check_complete(x, self.mechanism.operational, "operational")
        return self.solve(x, start if mode is None else self.working_modes(x, start)[mode])

    def working_modes(
        self, x: Mapping[str, float], start: Start | None = None, options: WorkingModeOptions | None = None
    ) -> WorkingModes:
        """Find all inverse solutions at a pose; see `find_working_modes`."""
        from paraopt.kinematics.working_modes import find_working_modes

        self._check_complete(x, self.mechanism.operational, "operational")
        return find_working_modes(self, {n: self._read_value(n, v) for n, v in x.items()}, start, options)

    def forward(self, q: Mapping[str, float], start: Start | None = None) -> Solution:
        """Solve for the pose at given actuators (XFKM): `solve` with the active variables imposed."""
        self._check_complete(q, self.mechanism.active, "active")
        return self.solve(q, start)

    def assembly_modes(
        self, q: Mapping[str, float], options: AssemblyOptions | None = None, start: Start | None = None
    ) -> AssemblyModes:
        """Find all forward solutions for given drives; see `find_assembly_modes`."""
        from paraopt.kinematics.assembly_modes import find_assembly_modes

        self._check_complete(q, self.mechanism.active, "active")
        return find_assembly_modes(self, {n: self._read_value(n, v) for n, v in q.items()}, start, options)

    def solve_batch(
        self,
        names: Sequence[str],
        values: ArrayLike,
        starts: ArrayLike,
        options: SolveOptions | None = None,
        held: Sequence[str] = (),
    ) -> ClosureSolution:
        """Impose the same variables at n points, each from its own start, without a Python loop over points.

        Args:
            names: Imposed variables.
            values: Imposed values [m or rad], shape (n, n_imposed).
            starts: Starts [m or rad], shape (n, n_variables).
            options: Tolerances; those of this object when None.
            held: Variables that keep the values of the starts.

        Returns:
            Final values with residual and verdict per sample.
        """
        index = self.mechanism.indices(names)
        X = np.array(starts, dtype=float, ndmin=2)
        X[:, index] = np.asarray(values, dtype=float).reshape(len(X), len(index))
        return solve_closure(self.functions, X, self._free([*names, *held]), options or self.options)

    def inverse_batch(self, x: ArrayLike, starts: ArrayLike, options: SolveOptions | None = None) -> BatchSolution:
        """Solve the inverse model for n poses at once, in compiled code where there is any.

        Args:
            x: Poses in the order of the operational variables [m or rad], shape (n, n_operational).
            starts: Starts [m or rad], shape (n, n_variables), or one for all.
            options: Tolerances; those of this object when None.

        Returns:
            The answers with a status per row: CONVERGED, SINGULAR, or FAILED.

        Raises:
            DefinitionError: The shapes do not fit; a row that is not finite is FAILED, not an error.
        """
        return self._answer_batch(self.mechanism.operational, x, starts, options)

    def forward_batch(self, q: ArrayLike, starts: ArrayLike, options: SolveOptions | None = None) -> BatchSolution:
        """Solve the forward model for n rows of the active variables, shape (n, n_active); see `inverse_batch`."""
        return self._answer_batch(self.mechanism.active, q, starts, options)

    def fit_batch(
        self,
        names: Sequence[str],
        values: ArrayLike,
        starts: ArrayLike,
        weights: Mapping[str, float] | None = None,
        options: SolveOptions | None = None,
    ) -> BatchSolution:
        """Come as near to imposed values as closures and ranges allow, for n rows at once (XFKM); see `fit`.

        Exact solutions and Newton steps towards the nearest values run on all rows together. Rows that do not settle
        that way are asked one by one.

        Args:
            names: Imposed variables.
            values: Imposed values [m or rad], shape (n, n_imposed).
            starts: Starts [m or rad], shape (n, n_variables), or one for all.
            weights: Weight of each imposed variable [1]; 1 where nothing is said.
            options: Tolerances; those of this object when None.

        Returns:
            The answers with a status per row.

        Raises:
            DefinitionError: The shapes do not fit, or a weight is not above 0.
        """
        question = self._ask(dict.fromkeys(names, 0.0), weights or {}, options, within_ranges=True)
        return answer_nearest(question, *self._read_rows(names, values, starts))

    def _answer_batch(
        self, names: Sequence[str], values: ArrayLike, starts: ArrayLike, options: SolveOptions | None
    ) -> BatchSolution:
        question = self._ask(dict.fromkeys(names, 0.0), {}, options, within_ranges=False)
        return answer_exactly(question, *self._read_rows(names, values, starts))

    def _read_rows(self, names: Sequence[str], values: ArrayLike, starts: ArrayLike) -> tuple[Array, Array]:
        """Read n rows of imposed values and n starts, or one start for all."""
        rows = []
        for wanted, given, what in ((names, values, "values"), (self.mechanism.names, starts, "starts")):
            try:
                rows.append(np.array(given, dtype=float, ndmin=2))
            except (TypeError, ValueError) as error:
                raise DefinitionError(f"{what} of {self.mechanism.name!r} must be numbers: {error}") from error
            if rows[-1].ndim != 2 or rows[-1].shape[1] != len(wanted):
                raise DefinitionError(
                    f"{what} of {self.mechanism.name!r} have shape {rows[-1].shape}; they must be (n, {len(wanted)}), "
                    f"one column for each of {list(wanted)}"
                )
        n = len(rows[0])
        if len(rows[1]) not in (1, n):
            raise DefinitionError(f"there are {len(rows[1])} starts for {n} rows of values; give one for each, or one")
        return rows[0], np.broadcast_to(rows[1], (n, rows[1].shape[1]))

    # -- derivatives -----------------------------------------------------------------------------------------------

    def tangent(self, X: ArrayLike, independent: Sequence[str], held: Sequence[str] = ()) -> Array:
        """Give the motions of all variables for a unit motion of each independent one (implicit-function theorem).

        Args:
            X: Closed configurations, shape (n, n_variables).
            independent: Names of the independent coordinates.
            held: Names of the variables that are locked.

        Returns:
            `T = dX / d independent`, shape (n, n_variables, n_independent); idle variables stay still.
        """
        X = np.atleast_2d(np.asarray(X, dtype=float))
        D = np.zeros((X.shape[1], len(independent)))
        D[self.mechanism.indices(independent), np.arange(len(independent))] = 1.0
        (T,) = self.functions.tangent(D.shape[1]).batch(X, self._free([*independent, *held]), D, _DAMPING)
        return T.reshape(len(X), *D.shape)

    def curvature(
        self, X: ArrayLike, V: ArrayLike, W: ArrayLike, independent: Sequence[str], held: Sequence[str] = ()
    ) -> Array:
        """Give the second-order motion that keeps the loops closed for pairs of velocities, independent ones at rest.

        Args:
            X: Closed configurations, shape (n, n_variables).
            V: First velocities, shape (n, n_variables, k).
            W: Second velocities, same shape.
            independent: Names of the independent coordinates.
            held: Names of the variables that are locked.

        Returns:
            `h` with `E h + F''[V, W] = 0`, shape (n, n_variables, k).
        """
        X, V = np.atleast_2d(np.asarray(X, dtype=float)), np.asarray(V, dtype=float)
        (h,) = self.functions.curvature(V.shape[2]).batch(X, self._free([*independent, *held]), V, W, _DAMPING)
        return h.reshape(V.shape)

    def pose_velocity(self, X: ArrayLike, V: ArrayLike) -> Array:
        """Give the derivatives of the link poses along velocities of the variables.

        Args:
            X: Values, shape (n, n_variables).
            V: Velocities, shape (n, n_variables, k).

        Returns:
            Upper three rows of the derivative of each pose, shape (n, k, n_links, 3, 4).
        """
        X, V = np.atleast_2d(np.asarray(X, dtype=float)), np.asarray(V, dtype=float)
        (flat,) = self.functions.pose_velocity(V.shape[2]).batch(X, V)
        return flat.reshape(len(X), V.shape[2], len(self.mechanism.links), 3, 4)

    # -- inside ----------------------------------------------------------------------------------------------------

    def _ask(
        self,
        impose: Mapping[str, float],
        weights: Mapping[str, float],
        options: SolveOptions | None,
        within_ranges: bool,
    ) -> Question:
        values = {name: self._read_value(name, value) for name, value in impose.items()}
        weight = dict.fromkeys(values, 1.0)
        for name, value in weights.items():
            if name not in values:
                raise unknown_name("imposed variable that has a weight", name, values)
            weight[name] = self._read_value(name, value)
            if weight[name] <= 0:
                raise DefinitionError(f"weight of {name!r} is {weight[name]}; it must be above 0")
        used = self._structurally_used
        return Question(self.functions, used, values, weight, options or self.options, within_ranges)

    def _read_value(self, name: str, value: float) -> float:
        self.mechanism.index(name)
        try:
            number = float(value)
        except (TypeError, ValueError) as error:
            raise DefinitionError(f"imposed value of {name!r} is {value!r}; it must be a number") from error
        if not np.isfinite(number):
            raise DefinitionError(f"imposed value of {name!r} is {value}; it must be finite")
        return number

    def _read_gauges(self, X: Array, given: Mapping[str, float]) -> None:
        """Write what the gauges show into a start that does not say it; their equations are the last ones."""
        count = len(self.gauges)
        for gauge, shown in zip(self.gauges, self.residual(X)[len(self.graph.rows) - count :], strict=True):
            if gauge.name not in given:
                X[self.mechanism.index(gauge.name)] = shown  # expression minus a value of zero

    def _free(self, imposed: Sequence[str]) -> Array:
        free = np.ones(len(self.mechanism.names))
        free[self.mechanism.indices(imposed)] = 0.0
        return free

    def _check_complete(self, given: Mapping[str, float], wanted: Sequence[str], role: str) -> None:
        missing = [name for name in wanted if name not in given]
        extra = [name for name in given if name not in wanted]
        if missing or extra:
            raise DefinitionError(
                f"{role} variables of {self.mechanism.name!r} are {list(wanted)}; missing {missing}, not {role} {extra}"
            )

    def _starts(self, start: Start | None) -> Array:
        n = len(self.mechanism.names)
        if start is None:
            rng = np.random.default_rng(0)
            low = np.array([max(v.range[0], -np.pi if v.kind == "angle" else 0.0) for v in self.mechanism.variables])
            high = np.array(
                [min(v.range[1], np.pi if v.kind == "angle" else 2 * v.scale) for v in self.mechanism.variables]
            )
            return np.vstack([np.zeros(n), rng.uniform(low, np.maximum(low, high), size=(63, n))])
        if isinstance(start, Configuration) and start.mechanism is not self.mechanism and self.gauges:
            start = start.as_dict()  # of the mechanism without its gauges
        if isinstance(start, Configuration):
            return start.X[None, :].copy()
        if isinstance(start, Mapping):
            X = np.zeros(n)
            X[self.mechanism.indices(start)] = [self._read_value(n, v) for n, v in start.items()]
            self._read_gauges(X, start)
        else:
            X = np.array(start, dtype=float)
        if X.shape != (n,) or not np.all(np.isfinite(X)):
            raise DefinitionError(
                f"start of {self.mechanism.name!r} must be {n} finite numbers; its shape is {X.shape}"
            )
        return X[None, :].copy()
