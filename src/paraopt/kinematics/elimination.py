"""Elimination of the passive variables: the velocity models in their classical form `A xdot + B qdot = 0`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, SolveError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.ranks import RANK_TOLERANCE, compute_rank
from paraopt.mechanism import Mechanism

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VelocityModel:
    """Relate the velocities of drives and platform at one configuration, passive variables eliminated.

    `A xdot + B qdot_a = 0` with `A = O^T K` and `B = O^T M`. The k columns of O are an orthonormal basis of what the
    equations say beyond the passive velocities: `O^T N = 0`, and k = rg[M N K] - rg N. Lengths in the equations are
    divided by the characteristic length; the columns of A and B keep the units of the variables. A loses rank at a
    parallel singularity, B at a serial one; O is defined at both.

    Attributes:
        mechanism: The mechanism.
        O: Basis of the equations that are left, shape (n_equations, k).
        A: `O^T K`, shape (k, n_operational).
        B: `O^T M`, shape (k, n_active).
        M: Columns of the active variables, equations scaled, shape (n_equations, n_active).
        N: Same for the passive variables, shape (n_equations, n_passive).
        K: Same for the operational variables, shape (n_equations, n_operational).
        scale: Unit in which each variable is judged: characteristic length or 1 rad, shape (n_variables,).

    Source: Lahouar, II.28; Lahouar, II.29; Lahouar, II.33.
    """

    mechanism: Mechanism
    O: Array  # noqa: E741 - the source's letter
    A: Array
    B: Array
    M: Array
    N: Array
    K: Array
    scale: Array

    @property
    def G(self) -> Array:
        """Give the inverse velocity model `qdot_a = G xdot`, `G = -B^+ A`, shape (n_active, n_operational).

        With redundant drives (rg M < a) it is the motion of smallest norm; with more drives than freedoms the only one.

        Raises:
            SolveError: At a serial singularity, where B loses rank and some platform motions are impossible.
        """
        self._check_solvable(self._active_scaled, "B", "serial", self._operational_scaled)
        return -self._active_scale[:, None] * (_pseudo_inverse(self._active_scaled) @ self.A)

    @property
    def forward(self) -> Array:
        """Give the direct velocity model `xdot = -A^+ B qdot_a`, shape (n_operational, n_active).

        Raises:
            SolveError: At a parallel singularity, where A loses rank, or when the drives do not determine the platform.
        """
        scaled = self._operational_scaled
        if compute_rank(scaled).value < scaled.shape[1]:
            raise SolveError(
                f"{self.mechanism.name!r} is at a parallel singularity, or under-actuated: the rank of A is "
                f"{compute_rank(scaled).value}, it must be {scaled.shape[1]}; choose another configuration",
                model=self,
            )
        return -self._operational_scale[:, None] * (_pseudo_inverse(scaled) @ self.B)

    @property
    def condition_A(self) -> float:
        """Give the condition number of the scaled A [1]; inf at a parallel singularity."""
        return condition_number(self._operational_scaled)

    @property
    def condition_B(self) -> float:
        """Give the condition number of the scaled B [1]; inf at a serial singularity."""
        return condition_number(self._active_scaled)

    def active_velocities(self, xdot: Mapping[str, float]) -> dict[str, float]:
        """Compute the velocities of the drives that move the platform as wanted.

        Args:
            xdot: Velocity of every operational variable by name [m/s or rad/s].

        Returns:
            Velocities of the active variables by name.

        Raises:
            DefinitionError: A name is missing or does not exist.
            SolveError: At a serial singularity.
        """
        values = self._read(xdot, self.mechanism.operational, "operational")
        return dict(zip(self.mechanism.active, (self.G @ values).tolist(), strict=True))

    def operational_velocities(self, qdot: Mapping[str, float]) -> dict[str, float]:
        """Compute the velocities of the platform from those of the drives.

        Args:
            qdot: Velocity of every active variable by name [m/s or rad/s].

        Returns:
            Velocities of the operational variables by name; with more drives than freedoms those that agree best.

        Raises:
            DefinitionError: A name is missing or does not exist.
            SolveError: At a parallel singularity.
        """
        values = self._read(qdot, self.mechanism.active, "active")
        return dict(zip(self.mechanism.operational, (self.forward @ values).tolist(), strict=True))

    def passive_velocities(self, qdot: Mapping[str, float], xdot: Mapping[str, float]) -> dict[str, float]:
        """Compute the velocities of the passive variables from those of drives and platform.

        `N qdot_p = -(M qdot_a + K xdot)`, the solution of smallest norm where internal mobilities leave a choice.

        Args:
            qdot: Velocity of every active variable by name [m/s or rad/s].
            xdot: Velocity of every operational variable by name [m/s or rad/s].

        Returns:
            Velocities of the passive variables by name.

        Raises:
            DefinitionError: A name is missing or does not exist.
            SolveError: The velocities contradict the closures; the message tells by how much.
        """
        q = self._read(qdot, self.mechanism.active, "active")
        x = self._read(xdot, self.mechanism.operational, "operational")
        wanted = -(self.M @ q + self.K @ x)
        a, p = len(self.mechanism.active), len(self.mechanism.passive)
        scale = self.scale[a : a + p]
        scaled = self.N * scale
        y = _pseudo_inverse(scaled) @ wanted
        miss = float(np.max(np.abs(scaled @ y - wanted), initial=0.0))
        size = float(np.max(np.abs(np.concatenate([self.M * q, self.K * x], axis=1)), initial=0.0))
        if miss > 1e-6 * max(size, 1e-300):
            raise SolveError(
                f"velocities of drives and platform of {self.mechanism.name!r} contradict the closures: the worst "
                f"equation misses by {miss:.3g} of {size:.3g}; take one from the other by the velocity model",
                model=self,
            )
        return dict(zip(self.mechanism.passive, (scale * y).tolist(), strict=True))

    # -- inside ----------------------------------------------------------------------------------------------------

    @property
    def _active_scale(self) -> Array:
        return self.scale[: len(self.mechanism.active)]

    @property
    def _operational_scale(self) -> Array:
        return self.scale[len(self.scale) - len(self.mechanism.operational) :]

    @property
    def _active_scaled(self) -> Array:
        return self.B * self._active_scale

    @property
    def _operational_scaled(self) -> Array:
        return self.A * self._operational_scale

    def _check_solvable(self, matrix: Array, letter: str, kind: str, wanted: Array) -> None:
        """Refuse a matrix whose columns do not span what is asked of it."""
        rank = compute_rank(matrix).value
        both = compute_rank(np.hstack([matrix, wanted])).value
        if rank < both:
            raise SolveError(
                f"{self.mechanism.name!r} is at a {kind} singularity: the rank of {letter} is {rank}, "
                f"{both} are needed; choose another configuration",
                model=self,
            )

    def _read(self, given: Mapping[str, float], wanted: Sequence[str], role: str) -> Array:
        missing = [n for n in wanted if n not in given]
        extra = [n for n in given if n not in wanted]
        if missing or extra:
            raise DefinitionError(
                f"{role} velocities of {self.mechanism.name!r} are those of {list(wanted)}; missing {missing}, "
                f"not {role} {extra}"
            )
        try:
            values = np.array([float(given[n]) for n in wanted])
        except (TypeError, ValueError) as error:
            raise DefinitionError(f"{role} velocities are {dict(given)}; they must be numbers") from error
        if not np.all(np.isfinite(values)):
            raise DefinitionError(f"{role} velocities are {dict(given)}; they must be finite")
        return values


def eliminate_passives(kinematics: Kinematics, configuration: Configuration) -> VelocityModel:
    """Eliminate the passive velocities from `M qdot_a + N qdot_p + K xdot = 0`.

    Args:
        kinematics: The mechanism's functions.
        configuration: Where to linearise.

    Returns:
        The velocity models and the matrices O, A, B.

    Source: Lahouar, II.28; Lahouar, II.29.
    """
    mechanism = kinematics.mechanism
    scale = kinematics.graph.variable_scale
    (E,) = kinematics.functions.scaled_jacobian(configuration.X)
    a, p = len(mechanism.active), len(mechanism.passive)
    M, N, K = E[:, :a], E[:, a : a + p], E[:, a + p :]
    rank_N = compute_rank(N, whole=E).value
    k = compute_rank(E).value - rank_N
    U = np.linalg.svd(N, full_matrices=True)[0] if N.size else np.eye(len(E))
    beyond = U[:, rank_N:]  # all directions of equation space that passive motions do not reach
    # of those, the ones that drives and platform reach: the rest says 0 = 0
    left, _, _ = scipy.linalg.svd(beyond.T @ np.hstack([K, M]), full_matrices=True)
    O = beyond @ left[:, :k]  # noqa: E741 - the source's letter
    unscale = 1.0 / scale
    return VelocityModel(
        mechanism=mechanism,
        O=O,
        A=(O.T @ K) * unscale[a + p :],
        B=(O.T @ M) * unscale[:a],
        M=M * unscale[:a],
        N=N * unscale[a : a + p],
        K=K * unscale[a + p :],
        scale=scale,
    )


def condition_number(matrix: Array) -> float:
    """Give the ratio of the largest to the smallest singular value [1]; inf when the smallest is zero."""
    if matrix.size == 0:
        return 1.0
    values = np.linalg.svd(matrix, compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")


def _pseudo_inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.pinv(matrix, rcond=RANK_TOLERANCE), dtype=float)
