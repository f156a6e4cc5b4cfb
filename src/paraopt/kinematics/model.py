"""`Kinematics`: one mechanism, its compiled functions, and every model as a call of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.closure import ClosureGraph, build_closure
from paraopt.errors import DefinitionError, SolveError
from paraopt.kinematics.codegen import Backend
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.functions import FunctionSet
from paraopt.kinematics.legs import Leg, find_legs
from paraopt.kinematics.ranks import Rank, compute_rank
from paraopt.kinematics.solve import ClosureSolution, SolveOptions, Status, solve_closure, solve_nearest
from paraopt.mechanism import Mechanism

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


@dataclass(frozen=True, eq=False)
class Solution:
    """Hold the answer of a model, with everything needed to trust it.

    Attributes:
        mechanism: The mechanism.
        X: Final values of all variables [m or rad], shape (n_variables,).
        status: How the solve ended.
        residual: Largest scaled closure residual [1].
        rank: Rank of the columns that were solved for.
        undetermined: Number of motions, beyond idle ones, that the imposed variables leave free.
        imposed: Imposed values by name.
        deviation: Obtained minus imposed values by name; zero when converged.
        out_of_range: Names of the variables outside their ranges.
        iterations: Number of iterations.
    """

    mechanism: Mechanism
    X: Array
    status: Status
    residual: float
    rank: Rank
    undetermined: int
    imposed: Mapping[str, float]
    deviation: Mapping[str, float]
    out_of_range: tuple[str, ...]
    iterations: int

    @property
    def configuration(self) -> Configuration:
        """Give the closed configuration with the imposed values.

        Raises:
            SolveError: The solve did not converge; the message tells status, residual and rank.
        """
        if self.status in (Status.FAILED, Status.NEAREST):
            raise SolveError(self.summary, solution=self)
        return Configuration(self.mechanism, self.X, self.residual)

    @property
    def nearest(self) -> Configuration:
        """Give the closed configuration, also when it misses the imposed values.

        Raises:
            SolveError: The loops could not be closed.
        """
        if self.status is Status.FAILED:
            raise SolveError(self.summary, solution=self)
        return Configuration(self.mechanism, self.X, self.residual)

    @property
    def summary(self) -> str:
        """Say in one sentence how the solve ended."""
        worst = max(self.deviation, key=lambda k: abs(self.deviation[k]), default=None)
        miss = ""
        if worst is not None and self.status in (Status.NEAREST, Status.FAILED):
            got = self.imposed[worst] + self.deviation[worst]
            unit = next(v.unit for v in self.mechanism.variables if v.name == worst)
            miss = f"; {worst!r} wanted {self.imposed[worst]:.6g} {unit}, nearest {got:.6g} {unit}"
        return (
            f"{self.mechanism.name!r}: {self.status.value} (scaled residual {self.residual:.2g}, "
            f"rank {self.rank.value}, undetermined {self.undetermined}){miss}"
        )


Start = Configuration | Mapping[str, float] | ArrayLike


class Kinematics:
    """Evaluate and solve the closure equations of a mechanism.

    Args:
        mechanism: The description.
        backend: "auto" uses generated C when a compiler is found and CasADi's virtual machine otherwise.
        options: Tolerances of the solves.
    """

    def __init__(self, mechanism: Mechanism, backend: Backend = "auto", options: SolveOptions | None = None) -> None:
        self.mechanism = mechanism
        self.graph: ClosureGraph = build_closure(mechanism)
        self.functions = FunctionSet(self.graph, backend)
        self.options = options or SolveOptions()
        E = self.graph.E
        column_used = np.zeros(len(mechanism.names), dtype=bool)
        column_used[np.asarray(E.sparsity().get_triplet()[1], dtype=int)] = True
        self._structurally_used = column_used

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
        options = options or self.options
        impose = {name: self._read_value(name, value) for name, value in impose.items()}
        index = self.mechanism.indices(impose)
        values = np.array(list(impose.values()))
        free = np.ones(len(self.mechanism.names))
        free[index] = 0.0
        starts = self._starts(start)
        starts[:, index] = values
        exact = solve_closure(self.functions, starts, free, options)
        if np.any(exact.converged):
            best = int(np.argmax(exact.converged))
            return self._conclude(exact.X[best], exact.residual[best], impose, free, exact.iterations, Status.CONVERGED)
        origin = self._starts(start)[0]
        return self._solve_nearest(origin, impose, free, values, index, options, exact.iterations)

    def inverse(self, x: Mapping[str, float], start: Start | None = None) -> Solution:
        """Solve for the joints at an operational pose: `solve` with the operational variables imposed."""
        self._check_complete(x, self.mechanism.operational, "operational")
        return self.solve(x, start)

    def forward(self, q: Mapping[str, float], start: Start | None = None) -> Solution:
        """Solve for the pose at given actuators (XFKM): `solve` with the active variables imposed."""
        self._check_complete(q, self.mechanism.active, "active")
        return self.solve(q, start)

    def solve_batch(
        self, names: Sequence[str], values: ArrayLike, starts: ArrayLike, options: SolveOptions | None = None
    ) -> ClosureSolution:
        """Impose the same variables at n points, each from its own start, without a Python loop over points.

        Args:
            names: Imposed variables.
            values: Imposed values [m or rad], shape (n, n_imposed).
            starts: Starts [m or rad], shape (n, n_variables).
            options: Tolerances; those of this object when None.

        Returns:
            Final values with residual and verdict per sample.
        """
        index = self.mechanism.indices(names)
        X = np.array(starts, dtype=float, ndmin=2)
        X[:, index] = np.asarray(values, dtype=float).reshape(len(X), len(index))
        return solve_closure(self.functions, X, self._free(names), options or self.options)

    # -- derivatives -----------------------------------------------------------------------------------------------

    def tangent(self, X: ArrayLike, independent: Sequence[str]) -> Array:
        """Give the motions of all variables for a unit motion of each independent one (implicit-function theorem).

        Args:
            X: Closed configurations, shape (n, n_variables).
            independent: Names of the independent coordinates.

        Returns:
            `T = dX / d independent`, shape (n, n_variables, n_independent); idle variables stay still.
        """
        X = np.atleast_2d(np.asarray(X, dtype=float))
        D = np.zeros((X.shape[1], len(independent)))
        D[self.mechanism.indices(independent), np.arange(len(independent))] = 1.0
        (T,) = self.functions.tangent(D.shape[1]).batch(X, self._free(independent), D, _DAMPING)
        return T.reshape(len(X), *D.shape)

    def curvature(self, X: ArrayLike, V: ArrayLike, W: ArrayLike, independent: Sequence[str]) -> Array:
        """Give the second-order motion that keeps the loops closed for pairs of velocities, independent ones at rest.

        Args:
            X: Closed configurations, shape (n, n_variables).
            V: First velocities, shape (n, n_variables, k).
            W: Second velocities, same shape.
            independent: Names of the independent coordinates.

        Returns:
            `h` with `E h + F''[V, W] = 0`, shape (n, n_variables, k).
        """
        X, V = np.atleast_2d(np.asarray(X, dtype=float)), np.asarray(V, dtype=float)
        (h,) = self.functions.curvature(V.shape[2]).batch(X, self._free(independent), V, W, _DAMPING)
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

    def _read_value(self, name: str, value: float) -> float:
        self.mechanism.index(name)
        try:
            number = float(value)
        except (TypeError, ValueError) as error:
            raise DefinitionError(f"imposed value of {name!r} is {value!r}; it must be a number") from error
        if not np.isfinite(number):
            raise DefinitionError(f"imposed value of {name!r} is {value}; it must be finite")
        return number

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
                [min(v.range[1], np.pi if v.kind == "angle" else 2 * self.mechanism.length)
                 for v in self.mechanism.variables]
            )  # fmt: skip
            return np.vstack([np.zeros(n), rng.uniform(low, np.maximum(low, high), size=(63, n))])
        if isinstance(start, Configuration):
            return start.X[None, :].copy()
        if isinstance(start, Mapping):
            X = np.zeros(n)
            X[self.mechanism.indices(start)] = list(start.values())
        else:
            X = np.array(start, dtype=float)
        if X.shape != (n,) or not np.all(np.isfinite(X)):
            raise DefinitionError(
                f"start of {self.mechanism.name!r} must be {n} finite numbers; its shape is {X.shape}"
            )
        return X[None, :].copy()

    def _solve_nearest(
        self,
        origin: Array,
        impose: Mapping[str, float],
        free: Array,
        values: Array,
        index: list[int],
        options: SolveOptions,
        spent: int,
    ) -> Solution:
        everything = np.ones_like(free)
        closed = solve_closure(self.functions, origin, everything, options)
        target, weight = origin.copy(), np.zeros_like(origin)
        target[index], weight[index] = values, 1.0
        lower = np.array([v.range[0] for v in self.mechanism.variables])
        upper = np.array([v.range[1] for v in self.mechanism.variables])
        X, iterations, settled = solve_nearest(self.functions, closed.X[0], target, weight, lower, upper, options)
        polished = solve_closure(self.functions, X, everything, replace(options, step_limit=0.05))
        final, residual = polished.X[0], float(polished.residual[0])
        reached = float(np.max(np.abs(final[index] - values) / self.graph.variable_scale[index], initial=0.0))
        closes = bool(polished.converged[0])
        if closes and reached < 1e-6:
            again = final.copy()
            again[index] = values
            exact = solve_closure(self.functions, again, free, options)
            if exact.converged[0]:
                return self._conclude(exact.X[0], exact.residual[0], impose, free, spent + iterations, Status.CONVERGED)
        status = Status.NEAREST if closes and settled else Status.FAILED
        return self._conclude(final, residual, impose, free, spent + iterations, status)

    def _conclude(
        self, X: Array, residual: float, impose: Mapping[str, float], free: Array, iterations: int, status: Status
    ) -> Solution:
        (E,) = self.functions.scaled_jacobian(X)
        used = self._structurally_used  # a column that is empty at this place only is a motion that nothing holds
        solved = used & (free > 0)
        rank, rank_all = compute_rank(E[:, solved], whole=E), compute_rank(E)
        undetermined = int(np.count_nonzero(solved)) - rank.value
        mobility = int(np.count_nonzero(used)) - rank_all.value
        if status is Status.CONVERGED and undetermined > max(mobility - len(impose), 0):
            status = Status.SINGULAR
        obtained = {name: float(X[self.mechanism.index(name)]) for name in impose}
        out = tuple(
            v.name
            for v, value in zip(self.mechanism.variables, X, strict=True)
            if not v.range[0] - 1e-9 <= value <= v.range[1] + 1e-9
        )
        return Solution(
            self.mechanism, X, status, float(residual), rank, undetermined,
            dict(impose), {n: obtained[n] - float(impose[n]) for n in impose}, out, iterations,
        )  # fmt: skip
