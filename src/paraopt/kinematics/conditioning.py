"""Conditioning of the velocity models: condition numbers of A and B, and isotropic configurations by optimisation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import BackendError, DefinitionError, SolveError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.elimination import condition_number, eliminate_passives
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.ranks import RANK_TOLERANCE, independent_rows

Array = NDArray[np.float64]
Letter = Literal["A", "B"]


def condition_numbers(kinematics: Kinematics, X: ArrayLike) -> tuple[Array, Array]:
    """Compute the condition numbers of A and B at n closed configurations.

    `A xdot + B qdot_a = 0` is what is left of the closures when the passive velocities are eliminated; columns are
    scaled by the characteristic length. They are 1 where the motion is equally easy in all directions, and inf at
    parallel (A) and serial (B) singularities.

    Args:
        kinematics: The mechanism's functions.
        X: Closed configurations [m or rad], shape (n, n_variables).

    Returns:
        Condition numbers of A and of B [1], shape (n,) each.

    Source: Lahouar, II.29; Chablat1998; SalisburyCraig1982.
    """
    X = np.atleast_2d(np.asarray(X, dtype=float))
    mechanism = kinematics.mechanism
    (E,) = kinematics.functions.scaled_jacobian.batch(X)
    a, p = len(mechanism.active), len(mechanism.passive)
    largest = np.asarray(np.linalg.norm(E, 2, axis=(1, 2)), dtype=float)[:, None]
    rank_N, rank_E = _rank(E[:, :, a : a + p], largest), _rank(E, largest)
    values_A, values_B = np.full(len(X), np.inf), np.full(len(X), np.inf)
    U = np.linalg.svd(E[:, :, a : a + p], full_matrices=True)[0]
    for n in np.unique(rank_N):  # as a rule all samples at once
        for k in np.unique(rank_E[rank_N == n] - n):
            chosen = np.flatnonzero((rank_N == n) & (rank_E - n == k))
            beyond = U[chosen, :, n:].transpose(0, 2, 1)
            A, B = beyond @ E[chosen, :, a + p :], beyond @ E[chosen, :, :a]
            left = np.linalg.svd(np.concatenate([A, B], axis=2), full_matrices=True)[0][:, :, :k]
            values_A[chosen], values_B[chosen] = (_ratio(left.transpose(0, 2, 1) @ m) for m in (A, B))
    return values_A, values_B


def _rank(stack: Array, largest: Array) -> NDArray[np.intp]:
    """Count the singular values of a stack of matrices above a fraction of given largest ones, shape (n, 1)."""
    if not stack.size:
        return np.zeros(len(stack), dtype=int)
    values = np.linalg.svd(stack, compute_uv=False)
    kept: NDArray[np.intp] = np.count_nonzero(values > RANK_TOLERANCE * np.maximum(largest, 1e-300), axis=1)
    return kept


def _ratio(stack: Array) -> Array:
    if stack.shape[1] == 0 or stack.shape[2] == 0:
        return np.ones(len(stack))
    values = np.linalg.svd(stack, compute_uv=False)
    result = np.full(len(stack), np.inf)
    return np.divide(values[:, 0], values[:, -1], out=result, where=values[:, -1] > 0)


@dataclass(frozen=True)
class IsotropyOptions:
    """Choose how an isotropic configuration is looked for.

    Attributes:
        iterations: Bound on IPOPT's iterations.
        tolerance: IPOPT's tolerance [1].
        isotropy: Condition number above which the answer is not called isotropic: this plus 1 [1].
    """

    iterations: int = 300
    tolerance: float = 1e-10
    isotropy: float = 1e-4


@dataclass(frozen=True, eq=False)
class Isotropy:
    """Hold the best conditioned configuration that was found.

    Attributes:
        configuration: The configuration.
        condition: Condition number of the matrix there [1].
        matrix: "A" or "B".
        is_isotropic: Whether the condition number is 1 within the tolerance of the options.
        iterations: Number of IPOPT's iterations.
    """

    configuration: Configuration
    condition: float
    matrix: Letter
    is_isotropic: bool
    iterations: int


def find_isotropic(
    kinematics: Kinematics,
    start: Configuration,
    matrix: Letter = "A",
    fixed: Mapping[str, float] | None = None,
    options: IsotropyOptions | None = None,
) -> Isotropy:
    """Find the best conditioned configuration near a start, isotropic if there is one.

    `minimise log(tr(S) / k) - log(det S) / k` with `S = A^T A` (or `B B^T`), which is zero exactly where all singular
    values agree, subject to the closures and the joint ranges, by IPOPT with exact second derivatives. `A^T A` is taken
    as `K^T (1 - P_N) K`, P_N being the projection on what passive motions reach.

    Args:
        kinematics: The mechanism's functions.
        start: Where to start.
        matrix: "A" for the platform's side, "B" for the drives'.
        fixed: Variables that keep a value, by name [m or rad].
        options: Tolerances.

    Returns:
        The configuration and its condition number. It is a local optimum.

    Raises:
        DefinitionError: The matrix is neither "A" nor "B", or a fixed value is not finite.
        SolveError: IPOPT found no closed optimum; the last iterate is attached.

    Source: SalisburyCraig1982; Chablat1998; ipopt.
    """
    options = options or IsotropyOptions()
    if matrix not in ("A", "B"):
        raise DefinitionError(f"matrix is {matrix!r}; it must be 'A' or 'B'")
    mechanism, graph = kinematics.mechanism, kinematics.graph
    scale = graph.variable_scale
    lower = np.array([v.range[0] for v in mechanism.variables]) / scale
    upper = np.array([v.range[1] for v in mechanism.variables]) / scale
    for name, value in (fixed or {}).items():
        i = mechanism.index(name)
        if not np.isfinite(value):
            raise DefinitionError(f"fixed value of {name!r} is {value}; it must be finite")
        lower[i] = upper[i] = value / scale[i]
    model = eliminate_passives(kinematics, start)
    size = model.A.shape if matrix == "A" else model.B.shape
    here = model.condition_A if matrix == "A" else model.condition_B
    if not here < 1e12 or size[0] < size[1]:
        raise SolveError(
            f"{matrix} of {mechanism.name!r} has shape {size} and is singular at the start: it has no condition number "
            "there; start at a regular configuration",
            model=model,
        )
    inside = bool(np.all((lower <= start.X / scale) & (start.X / scale <= upper)))
    if inside and here < 1.0 + 1e-8:  # nothing to gain: some machines have a matrix that is isotropic everywhere
        return Isotropy(start, here, matrix, True, 0)
    z = ca.SX.sym("z", len(scale))
    (E0,) = kinematics.functions.scaled_jacobian(start.X)
    rows = independent_rows(E0).tolist()
    objective, closures = ca.substitute(
        [_anisotropy(kinematics, matrix, rows), (graph.F / ca.DM(graph.row_scale))[rows]],
        [graph.X],
        [ca.DM(scale) * z],
    )
    problem = {"x": z, "f": objective, "g": closures}
    settings = {
        "ipopt.print_level": 0,
        "print_time": False,
        "ipopt.sb": "yes",
        "ipopt.tol": options.tolerance,
        "ipopt.max_iter": options.iterations,
    }
    try:
        solver = ca.nlpsol("isotropy", "ipopt", problem, settings)
        answer = solver(x0=start.X / scale, lbx=lower, ubx=upper, lbg=0.0, ubg=0.0)
    except RuntimeError as error:
        raise BackendError(f"IPOPT failed on the isotropy of {mechanism.name!r}: {error}") from error
    stats = solver.stats()
    X = np.asarray(answer["x"]).ravel() * scale
    closed = kinematics.solve({n: float(X[mechanism.index(n)]) for n in mechanism.operational}, X)
    if not np.all(np.isfinite(X)) or np.max(np.abs(closed.X - X) / scale) > 1e-6:
        raise SolveError(
            f"no well conditioned configuration of {mechanism.name!r} was found: IPOPT ended with "
            f"{stats['return_status']!r} after {stats['iter_count']} iterations; start elsewhere",
            X=X,
            stats=stats,
        )
    model = eliminate_passives(kinematics, closed.configuration)
    condition = model.condition_A if matrix == "A" else model.condition_B
    return Isotropy(
        closed.configuration, condition, matrix, condition < 1.0 + options.isotropy, int(stats["iter_count"])
    )


def _anisotropy(kinematics: Kinematics, matrix: Letter, rows: list[int]) -> ca.SX:
    """Build the objective: logarithm of the arithmetic over the geometric mean of the squared singular values."""
    graph, mechanism = kinematics.graph, kinematics.mechanism
    E = (ca.diag(1 / ca.DM(graph.row_scale)) @ graph.E @ ca.diag(ca.DM(graph.variable_scale)))[rows, :]
    a, p = len(mechanism.active), len(mechanism.passive)
    M, N, K = E[:, :a], E[:, a : a + p], E[:, a + p :]
    wanted = K if matrix == "A" else M
    S = wanted.T @ wanted
    if p:
        # regularised: internal mobilities leave zero columns in N
        gram = N.T @ N + 1e-12 * ca.SX.eye(p)
        D, LT, order = ca.ldl(gram)
        S -= (N.T @ wanted).T @ ca.ldl_solve(ca.densify(N.T @ wanted), D, LT, order)
    k = S.size1()
    D, _, _ = ca.ldl(S + 1e-14 * ca.SX.eye(k))
    return ca.log(ca.trace(S) / k) - ca.sum1(ca.log(D)) / k


__all__ = ["Isotropy", "IsotropyOptions", "condition_number", "condition_numbers", "find_isotropic"]
