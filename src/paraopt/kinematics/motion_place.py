"""One place of a motion: the motions that the closures allow there, the margins with their slopes, and the way back.

Everything is scaled: lengths are divided by the characteristic length. The rank of E is that of the general case, so
that the dimension of the motion space never changes along a motion.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.functions import FunctionSet
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.ranks import RANK_TOLERANCE, compute_rank
from paraopt.kinematics.samples import sample_configurations
from paraopt.kinematics.solve import SolveOptions, solve_closure

Array = NDArray[np.float64]
KINDS = ("parallel", "serial")


@dataclass(frozen=True, eq=False)
class MotionFrame:
    """Hold what is the same at all places of a mechanism.

    Attributes:
        functions: Compiled functions.
        options: Tolerances of the closing.
        scale: Unit of each variable [m or rad], shape (n_variables,).
        row_scale: Unit of each equation [m or 1], shape (n_equations,).
        rank: Rank of E in general.
        rows: Variables that tell each kind of singularity: the active ones parallel, the operational ones serial.
        counts: Rank in general of these rows of a basis of the motions.
    """

    functions: FunctionSet
    options: SolveOptions
    scale: Array
    row_scale: Array
    rank: int
    rows: dict[str, list[int]]
    counts: dict[str, int]

    @property
    def mobility(self) -> int:
        """Give the dimension of the motion space, idle motions included."""
        return len(self.scale) - self.rank


# A frame follows from the mechanism alone; it is kept as long as its kinematics live, and holds no reference to them.
_FRAMES: weakref.WeakKeyDictionary[Kinematics, MotionFrame] = weakref.WeakKeyDictionary()


def find_frame(kinematics: Kinematics, configuration: Configuration) -> MotionFrame:
    """Find the ranks that hold in general; at the first call for a mechanism they are computed.

    Args:
        kinematics: The mechanism's functions.
        configuration: Around which the general case is looked for.

    Returns:
        The frame.
    """
    if kinematics not in _FRAMES:
        mechanism = kinematics.mechanism
        (E,) = kinematics.functions.scaled_jacobian.batch(sample_configurations(kinematics, configuration))
        rank = max(compute_rank(matrix).value for matrix in E)
        rows = {"parallel": mechanism.indices(mechanism.active), "serial": mechanism.indices(mechanism.operational)}
        bases = [np.linalg.svd(matrix, full_matrices=True)[2][rank:].T for matrix in E]
        counts = {
            kind: max(int(np.count_nonzero(np.linalg.svd(V[r], compute_uv=False) > RANK_TOLERANCE)) for V in bases)
            if bases[0].shape[1]
            else 0
            for kind, r in rows.items()
        }
        _FRAMES[kinematics] = MotionFrame(
            kinematics.functions, kinematics.options, kinematics.graph.variable_scale, kinematics.graph.row_scale,
            rank, rows, counts,
        )  # fmt: skip
    return _FRAMES[kinematics]


class MotionPlace:
    """Judge one closed configuration.

    Args:
        frame: What is the same everywhere.
        X: The configuration [m or rad], shape (n_variables,).
        residual: Its largest scaled closure residual [1].
    """

    def __init__(self, frame: MotionFrame, X: Array, residual: float = 0.0) -> None:
        self.frame, self.X, self.residual = frame, X, residual

    @cached_property
    def _factors(self) -> tuple[Array, Array, Array, Array]:
        """Give U, S, W with `E = U S W` of the general rank, and the rest of the right vectors: the motions."""
        (E,) = self.frame.functions.scaled_jacobian(self.X)
        U, S, Vt = np.linalg.svd(E, full_matrices=True)
        r = self.frame.rank
        return U[:, :r], np.maximum(S[:r], 1e-300), Vt[:r], Vt[r:].T

    @property
    def V(self) -> Array:
        """Give an orthonormal basis of the scaled motions, shape (n_variables, mobility)."""
        return self._factors[3]

    def margin(self, kind: str) -> float:
        """Give the distance to a kind of singularity [1]; one where nothing can be lost."""
        return self._triple(kind)[1]

    def slope(self, kind: str) -> Array:
        """Give the derivative of the margin along the motions V, shape (mobility,).

        With `V_rows = u sigma w^T`, `d sigma = u^T dV w = l . F''[dX, V w]` where `l = -(E^+)^T u`, because the motions
        stay among the motions: `E dV = -dE V`.
        """
        u, _, w = self._triple(kind)
        picked = np.zeros(len(self.X))
        picked[self.frame.rows[kind]] = u
        U, S, W, _ = self._factors
        multipliers = -U @ ((W @ picked) / S)
        (hessian,) = self.frame.functions.closure_hessian(self.X, multipliers)
        return np.asarray(self.V.T @ (hessian @ (self.V @ w)))

    def close(self, X: Array) -> tuple[Array, float]:
        """Close the loops near this place, with the least motion.

        The factors of E here serve for all iterations: over one short step they contract well. Where they do not, the
        general solve takes over.

        Args:
            X: Values that nearly close the loops [m or rad], shape (n_variables,).

        Returns:
            Closed values, and the largest scaled residual [1].
        """
        frame, X = self.frame, X.copy()
        U, S, W, _ = self._factors
        last = np.inf
        for _ in range(12):
            residual = frame.functions.residual(X)[0] / frame.row_scale
            worst = float(np.max(np.abs(residual), initial=0.0))
            if worst <= 1e-15 or (worst <= 1e-13 and worst > 0.5 * last):
                return X, worst
            if not worst < 0.5 * last:
                break
            last = worst
            X -= frame.scale * (W.T @ ((U.T @ residual) / S))
        if last <= frame.options.tolerance:
            return X, float(np.max(np.abs(frame.functions.residual(X)[0] / frame.row_scale), initial=0.0))
        closed = solve_closure(frame.functions, X, np.ones_like(X), frame.options)
        return closed.X[0], float(closed.residual[0])

    @cached_property
    def _triples(self) -> dict[str, tuple[Array, float, Array]]:
        return {}

    def _triple(self, kind: str) -> tuple[Array, float, Array]:
        """Give the smallest singular value of the rows of V that tell a kind, with its left and right vectors."""
        if kind not in self._triples:
            rows, count = self.frame.rows[kind], self.frame.counts[kind]
            if not count:
                self._triples[kind] = (np.zeros(len(rows)), 1.0, np.zeros(self.V.shape[1]))
            else:
                u, sigma, wt = np.linalg.svd(self.V[rows], full_matrices=False)
                self._triples[kind] = (u[:, count - 1], float(sigma[count - 1]), wt[count - 1])
        return self._triples[kind]
