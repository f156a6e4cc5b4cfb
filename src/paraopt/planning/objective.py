"""Objective and constraints of a refinement as one vector function, with exact derivatives, and CasADi's view of it."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import ParaoptError
from paraopt.planning.evaluate import SampleEvaluator

Array = NDArray[np.float64]


class Evaluation:
    """Compute objective, constraints and their exact derivatives for a vector of inner control points.

    The last result is kept, because IPOPT asks for values and derivatives in separate calls.

    Args:
        evaluator: What evaluates the samples.
        basis: Values of all basis functions at the samples, shape (n, controls).
        ends: First and last control point over the unit, shape (2, m).
        energy: Integrals of products of the basis functions' slopes, shape (controls, controls).
        to_physical: What multiplies scaled coordinates, shape (m,).
        weight: Weight of the barriers.
        horizon: Distance at which the distance barrier begins [m].
        floor: Distance below which it goes on as a parabola [m].
    """

    def __init__(
        self,
        evaluator: SampleEvaluator,
        basis: Array,
        ends: Array,
        energy: Array,
        to_physical: Array,
        weight: float,
        horizon: float,
        floor: float,
    ) -> None:
        self.evaluator, self.basis, self.ends, self.energy = evaluator, basis, ends, energy
        self.to_physical, self.weight, self.horizon, self.floor = to_physical, weight, horizon, floor
        self.n, self.controls = basis.shape
        self.m = ends.shape[1]
        self.per_sample = len(evaluator.bounded) + 2 + len(evaluator.pairs)
        self.n_x, self.n_g = (self.controls - 2) * self.m, self.n * self.per_sample
        # each sample feels only the inner control points whose basis functions reach it
        sample, control = np.nonzero(basis[:, 1:-1])
        self._sample, self._control = sample, control
        shape = (len(sample), self.per_sample, self.m)
        rows = np.broadcast_to((sample[:, None] * self.per_sample + np.arange(self.per_sample))[:, :, None], shape)
        columns = np.broadcast_to((control[:, None] * self.m + np.arange(self.m))[:, None, :], shape)
        self._order = np.lexsort((rows.ravel(), columns.ravel()))  # CasADi stores columns first
        self.pattern = ca.Sparsity.triplet(self.n_g, self.n_x, rows.ravel().tolist(), columns.ravel().tolist())
        self.error: ParaoptError | None = None
        self._key: bytes | None = None
        self._value: tuple[float, Array, Array, Array] | None = None

    def __call__(self, x: Array) -> tuple[float, Array, Array, Array]:
        """Return objective, its gradient, constraints, and the nonzeros of their Jacobian."""
        key = x.tobytes()
        if key != self._key or self._value is None:
            self._value = self._compute(x)
            self._key = key
        return self._value

    def _compute(self, x: Array) -> tuple[float, Array, Array, Array]:
        controls = np.vstack([self.ends[0], x.reshape(-1, self.m), self.ends[1]])
        v = self.evaluator(self.basis @ controls * self.to_physical)
        if not v.converged:  # IPOPT takes a shorter step
            return np.nan, np.full(self.n_x, np.nan), np.full(self.n_g, np.nan), np.full(self.pattern.nnz(), np.nan)
        phi, slope = self._barrier(v.distances)
        barrier = float(np.sum(phi) - np.sum(v.logarithms)) / self.n
        d_barrier = (np.einsum("nk,nkm->nm", slope, v.d_distances) - np.sum(v.d_logarithms, axis=1)) / self.n
        half = self.energy @ controls
        f = float(np.sum(controls * half)) + self.weight * barrier
        d_f = 2.0 * half + self.weight * (self.basis.T @ (d_barrier * self.to_physical))
        g = np.hstack([v.bounded, v.margins, v.distances / self.horizon])
        d_g = np.concatenate([v.d_bounded, v.d_margins, v.d_distances / self.horizon], axis=1) * self.to_physical
        reach = self.basis[:, 1:-1][self._sample, self._control]
        nonzeros = (d_g[self._sample] * reach[:, None, None]).ravel()[self._order]
        return f, d_f[1:-1].ravel(), g.ravel(), nonzeros

    def _barrier(self, d: Array) -> tuple[Array, Array]:
        """Evaluate phi and its derivative: logarithmic between floor and horizon, quadratic below, zero beyond."""
        h, e = self.horizon, self.floor
        inside = np.clip(d, e, h)
        phi, slope = -np.log(inside / h) + inside / h - 1.0, -1.0 / inside + 1.0 / h
        below = np.minimum(d - e, 0.0)
        phi += slope * below + 0.5 * below**2 / e**2
        slope = slope + below / e**2
        return phi, np.where(d < h, slope, 0.0)


class Bridge(ca.Callback):
    """Give results of an evaluation to CasADi.

    Args:
        name: Name of the function.
        evaluation: The evaluation.
        outputs: Which of "f", "grad_f", "g", "jac_g" it returns.
        takes_parameters: Whether it has CasADi's second, empty, input.
    """

    def __init__(self, name: str, evaluation: Evaluation, outputs: Sequence[str], takes_parameters: bool) -> None:
        ca.Callback.__init__(self)
        self.evaluation, self.outputs, self.takes_parameters = evaluation, tuple(outputs), takes_parameters
        self.patterns = {
            "f": ca.Sparsity.dense(1, 1),
            "grad_f": ca.Sparsity.dense(evaluation.n_x, 1),
            "g": ca.Sparsity.dense(evaluation.n_g, 1),
            "jac_g": evaluation.pattern,
        }
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 2 if self.takes_parameters else 1

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.evaluation.n_x, 1) if i == 0 else ca.Sparsity(0, 0)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self.patterns[self.outputs[i]]

    def eval(self, arguments: list[ca.DM]) -> list[ca.DM]:
        try:
            results = self.evaluation(np.array(arguments[0].nonzeros()))
        except ParaoptError as error:  # CasADi would turn it into a warning: it is raised again after the solve
            self.evaluation.error = error
            raise
        by_name = dict(zip(("f", "grad_f", "g", "jac_g"), results, strict=True))
        return [ca.DM(self.patterns[k], by_name[k]) if k == "jac_g" else ca.DM(by_name[k]) for k in self.outputs]


def build_length_hessian(evaluation: Evaluation) -> ca.Function:
    """Build the second derivative of the length term as CasADi's `hess_lag`: upper triangle, constant but for lam_f."""
    x, p = ca.MX.sym("x", evaluation.n_x), ca.MX.sym("p", 0, 0)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", evaluation.n_g)
    H = np.triu(2.0 * np.kron(evaluation.energy[1:-1, 1:-1], np.eye(evaluation.m)))
    return ca.Function("hess_lag", [x, p, lam_f, lam_g], [lam_f * ca.sparsify(ca.DM(H))])
