"""The door to IPOPT for models: nearest closed configuration by an interior-point method, from far starts too."""

from __future__ import annotations

import weakref
from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BackendError
from paraopt.kinematics.functions import FunctionSet

Array = NDArray[np.float64]

# one solver per mechanism and choice of rows: building it costs more than running it
_solvers: weakref.WeakKeyDictionary[FunctionSet, dict[tuple[int, ...], ca.Function]] = weakref.WeakKeyDictionary()


def solve_interior(
    functions: FunctionSet,
    start: Array,
    target: Array,
    weight: Array,
    lower: Array,
    upper: Array,
    rows: NDArray[np.intp],
    iterations: int = 500,
) -> tuple[Array, int, str]:
    """Minimise `1/2 sum w_i^2 (X_i - target_i)^2 / s_i^2` subject to `F(X) = 0` and the joint ranges, by IPOPT.

    Args:
        functions: Functions of the mechanism.
        start: Where to start, open or closed [m or rad], shape (n_variables,).
        target: Wanted values; entries of zero weight are ignored.
        weight: Weight of each variable [1], zero where nothing is wanted.
        lower: Lowest values, may be -inf.
        upper: Highest values, may be inf.
        rows: Equations that are imposed: independent ones, so that IPOPT's multipliers exist.
        iterations: Bound on its iterations.

    Returns:
        The last iterate [m or rad], the number of iterations, and IPOPT's own word on how it ended. Whether the loops
        are closed is for the caller to check.

    Raises:
        BackendError: IPOPT failed in an unexpected way.

    Source: ipopt; Lahouar, II.3.
    """
    scale = functions.graph.variable_scale
    known, key = _solvers.setdefault(functions, {}), (iterations, *rows.tolist())
    if key not in known:
        known[key] = _build(functions, rows.tolist(), iterations)
    solver = known[key]
    wanted = np.where(weight > 0, target, 0.0) / scale
    try:
        answer = solver(
            x0=np.clip(start, lower, upper) / scale, p=np.concatenate([wanted, weight]),
            lbx=lower / scale, ubx=upper / scale, lbg=0.0, ubg=0.0,
        )  # fmt: skip
    except RuntimeError as error:
        raise BackendError(f"IPOPT failed on {functions.graph.mechanism.name!r}: {error}", start=start) from error
    stats = solver.stats()
    return np.asarray(answer["x"]).ravel() * scale, int(stats["iter_count"]), str(stats["return_status"])


def build_program(
    name: str,
    problem: Mapping[str, ca.MX],
    iterations: int = 500,
    tolerance: float = 1e-8,
    derivatives: Mapping[str, ca.Function] | None = None,
) -> ca.Function:
    """Build a nonlinear program from expressions, to be run for many numbers.

    Args:
        name: Name of the program.
        problem: CasADi's "x", "p", "f" and "g".
        iterations: Bound on IPOPT's iterations.
        tolerance: Its convergence tolerance [1].
        derivatives: CasADi's options "grad_f", "jac_g" and "hess_lag", where they are known; else they are made from
            the problem, written out in scalars.

    Returns:
        What `run_program` runs.

    Source: ipopt.
    """
    options = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": tolerance,
        "ipopt.constr_viol_tol": tolerance,
        "ipopt.max_iter": iterations,
        "error_on_fail": False,
        # scalar expressions evaluate several times faster than calls of mapped functions
        **(dict(derivatives) if derivatives is not None else {"expand": True}),
    }
    return ca.nlpsol(name, "ipopt", dict(problem), options)


def run_program(
    program: ca.Function,
    start: Array,
    parameters: Array,
    box: tuple[Array, Array],
    bounds: tuple[Array, Array],
    what: str = "a program",
) -> tuple[Array, Array, int, str]:
    """Run a program that `build_program` built.

    Args:
        program: The program.
        start: Where to begin, shape (n,).
        parameters: Its numbers, shape (k,).
        box: Lowest and highest x.
        bounds: Lowest and highest g.
        what: How an error calls it.

    Returns:
        The last x, the constraints g there, the number of iterations, and IPOPT's own word on how it ended. Whether the
        bounds are met is for the caller to check.

    Raises:
        BackendError: IPOPT failed in an unexpected way.
    """
    try:
        answer = program(x0=np.clip(start, *box), p=parameters, lbx=box[0], ubx=box[1], lbg=bounds[0], ubg=bounds[1])
    except RuntimeError as error:
        raise BackendError(f"IPOPT failed on {what}: {error}", start=start) from error
    stats = program.stats()
    x, g = (np.asarray(answer[name]).reshape(-1) for name in ("x", "g"))
    return x, g, int(stats["iter_count"]), str(stats["return_status"])


def _build(functions: FunctionSet, rows: list[int], iterations: int) -> ca.Function:
    graph = functions.graph
    n = graph.X.numel()
    z, p = ca.SX.sym("z", n), ca.SX.sym("p", 2 * n)
    (closures,) = ca.substitute(
        [(graph.F / ca.DM(graph.row_scale))[rows]], [graph.X], [ca.DM(graph.variable_scale) * z]
    )
    distance = 0.5 * ca.sumsqr(p[n:] * (z - p[:n]))
    options = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-11,
        "ipopt.constr_viol_tol": 1e-12,
        "ipopt.max_iter": iterations,
    }
    return ca.nlpsol("nearest", "ipopt", {"x": z, "p": p, "f": distance, "g": closures}, options)
