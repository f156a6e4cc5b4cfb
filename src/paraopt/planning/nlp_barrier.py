"""What keeps paths off their bounds: logarithms of determinants, distances, and ways to the ends of ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.planning.evaluate import SampleEvaluator, SampleValues

Array = NDArray[np.float64]
Term = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class Barriers:
    """Hold what keeps paths away from their bounds.

    Attributes:
        weight: Weight of all barriers [1].
        horizon: Distance at which the distance barrier begins [m].
        floor: Distance below which it goes on as a parabola [m].
        share: Share of a variable's range, from either end, in which its barrier acts [1].
        serial: Whether serial singularities count.
    """

    weight: float
    horizon: float
    floor: float
    share: float = 0.05
    serial: bool = True

    def __call__(self, v: SampleValues, evaluator: SampleEvaluator) -> tuple[float, Array, Array]:
        """Give the mean over n samples, with gradients at the samples and Gauss-Newton second derivatives.

        Args:
            v: Values at the samples.
            evaluator: What found them.

        Returns:
            The value [1], gradients, shape (n, m), and second derivatives, shape (n, m, m).
        """
        n, _, m = v.T.shape
        scale = self.weight / n
        if scale == 0.0:
            return 0.0, np.zeros((n, m)), np.zeros((n, m, m))
        k = 2 if self.serial else 1
        slopes, gradients, bends = [np.full((n, k), -1.0)], [v.d_logarithms[:, :k]], [np.ones((n, k))]
        total = -float(np.sum(v.logarithms[:, :k]))
        distances = *rise(v.distances, self.horizon, self.floor), v.d_distances
        for phi, slope, bend, gradient in (distances, *self._ranges(v, evaluator), *self._conditions(v, evaluator)):
            total += float(np.sum(phi))
            slopes.append(slope)
            gradients.append(gradient)
            bends.append(bend)
        G = np.concatenate(gradients, axis=1)
        first = np.einsum("nk,nkm->nm", np.hstack(slopes), G)
        second = G.transpose(0, 2, 1) @ (np.hstack(bends)[:, :, None] * G)
        return scale * total, scale * first, scale * second

    def _ranges(self, v: SampleValues, evaluator: SampleEvaluator) -> list[Term]:
        """Treat the way to either end of a range like a distance; the horizon is a share of the range."""
        low, high = evaluator.low, evaluator.high
        terms = []
        for sign, bound in ((1.0, low), (-1.0, high)):
            of = np.flatnonzero(np.isfinite(bound))
            if not of.size:
                continue
            width = np.where(np.isfinite(high - low), high - low, 1.0)[of]
            left = sign * (v.bounded[:, of] - bound[of])
            phi, slope, bend = rise(left / width, self.share, 0.02 * self.share)
            terms.append((phi, sign * slope / width, bend / width**2, v.d_bounded[:, of]))
        return terms

    @staticmethod
    def _conditions(v: SampleValues, evaluator: SampleEvaluator) -> list[Term]:
        """Treat how far the problem's conditions are inside their bounds like a distance, felt below 1."""
        k, conditions = evaluator.n_barred, evaluator.conditions
        terms = []
        for sign, bound in ((1.0, conditions.lower[:k]), (-1.0, conditions.upper[:k])):
            of = np.flatnonzero(np.isfinite(bound))
            if of.size:
                phi, slope, bend = rise(sign * (v.conditions[:, of] - bound[of]), 1.0, 0.02)
                terms.append((phi, sign * slope, bend, v.d_conditions[:, of]))
        return terms


def rise(d: Array, h: float, e: float) -> tuple[Array, Array, Array]:
    """Evaluate phi and two derivatives: logarithmic between floor e and horizon h, quadratic below, zero beyond."""
    inside = np.clip(d, e, h)
    phi, slope = -np.log(inside / h) + inside / h - 1.0, -1.0 / inside + 1.0 / h
    below = np.minimum(d - e, 0.0)
    phi += slope * below + 0.5 * below**2 / e**2
    slope = slope + below / e**2
    return phi, np.where(d < h, slope, 0.0), np.where(d < h, 1.0 / inside**2, 0.0)
