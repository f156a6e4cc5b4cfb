"""Newton's method on one branch: solve for the rest with a fixed rank, and measure how far the answer can be trusted.

Everything here is scaled: lengths are divided by the characteristic length. Let A be the columns of `E = dF/dX` that
are solved for, r their rank in general, and `A = U S V^T` with the r largest singular values kept. Redundant equations
and idle variables then cost nothing: they lie in what is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.ranks import compute_rank
from paraopt.kinematics.samples import sample_configurations

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BranchPoint:
    """Hold a closed configuration with the factors of its solved columns.

    Attributes:
        z: Scaled values of all variables [1], shape (n_variables,).
        E: Scaled Jacobian [1], shape (n_equations, n_variables).
        U: Left singular vectors of A, shape (n_equations, r).
        S: Singular values of A [1], largest first, shape (r,).
        V: Right singular vectors of A, shape (n_solved, r).
    """

    z: Array
    E: Array
    U: Array
    S: Array
    V: Array

    @property
    def margin(self) -> float:
        """Give the smallest singular value of the solved columns [1]; one where nothing is solved for."""
        return float(self.S[-1]) if self.S.size else 1.0


@dataclass(frozen=True, eq=False)
class Correction:
    """Hold the outcome of Newton's method.

    Attributes:
        z: Final scaled values [1], shape (n_variables,).
        converged: Whether the closures are met.
        first: Length of the first correction [1].
        rate: Largest ratio of a correction to the one before it, where both are above round-off [1].
        residual: Largest scaled closure residual [1].
    """

    z: Array
    converged: bool
    first: float
    rate: float
    residual: float


class Corrector:
    """Solve the closures for the variables that are not imposed, by Newton's method with a fixed rank.

    Args:
        kinematics: The mechanism's functions.
        names: Imposed variables.
        start: A configuration on the branch; the rank is the largest around it.
        iterations: Bound on the number of Newton iterations.
    """

    def __init__(
        self, kinematics: Kinematics, names: Sequence[str], start: Configuration, iterations: int = 10
    ) -> None:
        self.scale = kinematics.graph.variable_scale
        self.tolerance = kinematics.options.tolerance
        self.iterations = iterations
        self._row_scale = kinematics.graph.row_scale
        self._functions = kinematics.functions
        self.imposed = np.array(kinematics.mechanism.indices(names), dtype=int)
        fixed = set(kinematics.idle) | set(names)
        self.solved = np.array([i for i, n in enumerate(kinematics.mechanism.names) if n not in fixed], dtype=int)
        (E,) = kinematics.functions.scaled_jacobian.batch(sample_configurations(kinematics, start))
        self.rank = max(compute_rank(matrix[:, self.solved], whole=matrix).value for matrix in E)
        self.constraint_rank = max(compute_rank(matrix).value for matrix in E)

    @property
    def undetermined(self) -> int:
        """Give the number of motions, idle variables not counted, that the imposed variables leave free."""
        return len(self.solved) - self.rank

    @property
    def dependent(self) -> int:
        """Give the number of relations that the closures force upon the imposed variables alone."""
        return self.constraint_rank - self.rank

    def point(self, z: Array) -> BranchPoint:
        """Factor the solved columns at scaled values."""
        (E,) = self._functions.scaled_jacobian(z * self.scale)
        U, S, Vt = np.linalg.svd(E[:, self.solved], full_matrices=False)
        r = self.rank
        return BranchPoint(z, E, U[:, :r], S[:r], Vt[:r].T)

    def constraint_margin(self, point: BranchPoint) -> float:
        """Give the smallest singular value of E itself [1]: zero where the closures lose rank."""
        values = np.linalg.svd(point.E, compute_uv=False)
        return float(values[self.constraint_rank - 1]) if self.constraint_rank else 1.0

    def weakest(self, point: BranchPoint) -> Array:
        """Give the scaled motion, of length one, that becomes free where the margin is zero; shape (n_variables,)."""
        motion = np.zeros(len(point.z))
        if point.S.size:
            motion[self.solved] = point.V[:, -1]
        return motion

    def motion(self, point: BranchPoint, change: Array) -> Array:
        """Give the motion of all variables for a change of the imposed ones, at first order: the predictor.

        Args:
            point: Where.
            change: Scaled change of the imposed variables [1], shape (n_imposed,).

        Returns:
            Scaled motion [1], shape (n_variables,); the least one where the imposed variables leave motions free.
        """
        step = np.zeros(len(point.z))
        step[self.imposed] = change
        step[self.solved] = -self._apply_inverse(point, point.E[:, self.imposed] @ change)
        return step

    def correct(self, z: Array, values: Array) -> Correction:
        """Close the loops from a prediction.

        Args:
            z: Predicted scaled values [1], shape (n_variables,).
            values: Scaled values of the imposed variables [1], shape (n_imposed,).

        Returns:
            The outcome; it is converged only if the residual is below the tolerance and the iteration settled.
        """
        z = z.copy()
        z[self.imposed] = values
        first, rate, last = 0.0, 0.0, np.inf
        for k in range(self.iterations):
            residual = self._residual(z)
            worst = float(np.max(np.abs(residual), initial=0.0))
            if not np.isfinite(worst):
                return Correction(z, False, np.inf, np.inf, worst)
            if worst <= 1e-15 or (worst <= self.tolerance and last <= 1e-9):
                return Correction(z, True, first, rate, worst)
            point = self.point(z)
            step = -self._apply_inverse(point, residual)
            size = float(np.linalg.norm(step))
            if k == 0:
                first = size
            elif size > 1e-9:  # below, both are round-off over the smallest singular value
                rate = max(rate, size / max(last, 1e-300))
            if not np.isfinite(size) or size > 10.0:
                return Correction(z, False, first, np.inf, worst)
            z[self.solved] += step
            last = size
        worst = float(np.max(np.abs(self._residual(z)), initial=0.0))
        return Correction(z, bool(worst <= self.tolerance), first, rate, worst)

    def relative_change(self, point: BranchPoint, others: Array) -> float:
        """Compare the solved columns at other places with those at a point: `max |A^-1 (A_other - A)|`.

        Args:
            point: Where A is factored.
            others: Scaled values [1], shape (n, n_variables).

        Returns:
            The largest spectral norm [1]. Below one, the determinant of A has the same sign at all places, and no two
            solutions for the same imposed values lie among them.
        """
        if not point.S.size:
            return 0.0
        (E,) = self._functions.scaled_jacobian.batch(others * self.scale)
        change = point.U.T @ (E - point.E)[:, :, self.solved] @ point.V / np.maximum(point.S, 1e-300)[:, None]
        return float(np.max(np.linalg.norm(change, 2, axis=(1, 2))))

    def determinant_ratio(self, point: BranchPoint, other: BranchPoint) -> float:
        """Give `det A_other / det A` on the rows and motions of the first point; its sign tells a change of side."""
        if not point.S.size:
            return 1.0
        ratio = point.U.T @ other.E[:, self.solved] @ point.V / np.maximum(point.S, 1e-300)[:, None]
        return float(np.linalg.det(ratio))

    def _apply_inverse(self, point: BranchPoint, rows: Array) -> Array:
        return point.V @ ((point.U.T @ rows) / np.maximum(point.S, 1e-300))

    def _residual(self, z: Array) -> Array:
        return self._functions.residual(z * self.scale)[0] / self._row_scale
