"""Why there is no feasible path: constraints that are broken, where and by how much, and what forbids to mend them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import linprog

if TYPE_CHECKING:
    from paraopt.planning.nlp import Nlp

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shortfall:
    """Name a constraint that a vector breaks, or that stands against mending others.

    Attributes:
        what: The constraint.
        at: Where on the path, in [0, 1].
        amount: By how much it is broken, in the constraint's own scale; 0 where it is met.
        is_timing: Whether it is a limit of a drive, which a slower law would hold.
        measure: What an amount of 1 is in SI.
        unit: Its unit.
        weight: How much it stands against a smaller largest violation; those that are broken weigh one together. Zero
            where that is not known.
    """

    what: str
    at: float
    amount: float
    is_timing: bool = False
    measure: float = 1.0
    unit: str = ""
    weight: float = 0.0

    def __str__(self) -> str:
        size = self.amount * self.measure
        units = {"m": f" ({1e3 * size:.3g} mm)", "rad": f" ({size:.3g} rad)"}
        return f"{self.what} is off its bound by {self.amount:.3g} at s = {self.at:.3f}{units.get(self.unit, '')}"


@dataclass(frozen=True, eq=False)
class Conflict:
    """Hold how far the largest violation can be brought down by a step, and what stands against more.

    Attributes:
        reachable: The least largest violation of the linearised constraints.
        weights: How much each constraint stands against less, not negative, shape (n_g,); those that are violated weigh
            one together. Where nothing else weighs and no bound of the step is met, it is a proof for the linear model.
    """

    reachable: float
    weights: Array


def find_conflict(
    J: sp.csr_matrix, low: Array, high: Array, box: tuple[Array, Array], radius: float, out: float
) -> Conflict | None:
    """Minimise t with `low - t <= J d <= high + t` for violated rows, and no t for the others, `|d| <= radius`.

    Args:
        J: Jacobian of the constraints, shape (n_g, n).
        low: Lower bounds of their change, shape (n_g,).
        high: Upper bounds of their change, shape (n_g,).
        box: Bounds of the step, shape (n,) each.
        radius: Bound on its entries.
        out: The largest violation without a step.

    Returns:
        The conflict; None where the linear program fails.
    """
    reach = radius * np.asarray(abs(J).sum(axis=1)).ravel()
    upper, lower = np.flatnonzero(high < reach), np.flatnonzero(low > -reach)
    rows = np.concatenate([upper, lower])
    bounds = np.concatenate([high[upper], -low[lower]])
    G = sp.vstack([J[upper], -J[lower]], format="csr") * radius
    n, width = J.shape[1], np.maximum(np.asarray(abs(G).sum(axis=1)).ravel(), 1e-12)
    share = np.where(bounds < 0.0, -out, 0.0)
    table = sp.hstack([G, sp.csr_matrix(share[:, None])], format="csr")
    solved = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=sp.diags(1.0 / width) @ table,
        b_ub=bounds / width,
        bounds=np.vstack([
            np.column_stack([np.maximum(box[0] / radius, -1.0), np.minimum(box[1] / radius, 1.0)]), [[0.0, 1.0]]
        ]),
        method="highs",
    )  # fmt: skip
    if solved.status != 0:
        return None
    weights = np.zeros(J.shape[0])
    np.add.at(weights, rows, -solved.ineqlin.marginals / width * out)
    return Conflict(float(solved.x[-1]) * out, weights)


def list_shortfalls(nlp: Nlp, x: Array, tolerance: float, radius: float = 0.05) -> list[Shortfall]:
    """List what a vector breaks, and what stands against mending it, each constraint at one place.

    Args:
        nlp: The program.
        x: The vector.
        tolerance: What is let pass.
        radius: Size of the steps that are asked for something better.

    Returns:
        The broken constraints, those first that weigh most in the conflict; then those that are met and weigh.
    """
    if not np.all(np.isfinite(x)):
        return [Shortfall("the solution", 0.0, np.inf)]
    evaluation = nlp.evaluation
    _, _, g, nonzeros = evaluation(x)
    excess = np.maximum(nlp.lower - g, g - nlp.upper)
    excess = np.where(np.isnan(excess), np.inf, excess)
    broken, out = excess > tolerance, float(np.max(excess, initial=0.0))
    if not np.any(broken):
        return []
    weights = np.zeros(len(g))
    if np.isfinite(out):
        J = sp.csr_matrix((nonzeros, evaluation.pattern), shape=(evaluation.n_g, evaluation.n_x))
        box = (nlp.box[0] - x, nlp.box[1] - x)
        found = find_conflict(J, nlp.lower - g, nlp.upper - g, box, radius, out)
        weights = weights if found is None else found.weights
    listed: dict[str, Shortfall] = {}
    # the worst row stands for a broken constraint, the heaviest one for a constraint that is met
    for row in np.lexsort((-weights, np.where(broken, -excess, 0.0), ~broken)):
        if not (broken[row] or weights[row] > 0.01):
            continue
        what, at = nlp.describe(int(row))
        if what in listed:
            listed[what] = replace(listed[what], weight=listed[what].weight + float(weights[row]))
            continue
        by_sample = row < evaluation.n * len(nlp.labels)
        measure, unit = nlp.measures[row % len(nlp.labels)] if by_sample else (1.0, "")
        is_timing = bool(row >= len(g) - evaluation.n_rows)
        amount = float(excess[row]) if broken[row] else 0.0
        listed[what] = Shortfall(what, at, amount, is_timing, measure, unit, float(weights[row]))
    return sorted(listed.values(), key=lambda one: (one.amount == 0.0, -one.weight, -one.amount))


def tell_shortfalls(shortfalls: Sequence[Shortfall], most: int = 4) -> str:
    """Say what is broken, and what stands against mending it."""
    broken = [one for one in shortfalls if one.amount > 0.0]
    told = "; ".join(str(one) for one in broken[:most])
    more = f"; and {len(broken) - most} others" if len(broken) > most else ""
    against = [f"{one.what} at s = {one.at:.3f}" for one in shortfalls if one.amount <= 0.0][:most]
    return told + more + (f"; against them stand {', '.join(against)}" if against else "")
