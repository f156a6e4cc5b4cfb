"""Solve a refinement by IPOPT through CasADi."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import ParaoptError
from paraopt.planning.objective import Evaluation, Point

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answer:
    """Hold where a solver ended.

    Attributes:
        x: The last vector.
        multipliers: Those of the constraints, positive at upper bounds.
        iterations: Number of iterations.
        status: What the solver says.
    """

    STUCK: ClassVar[str] = "stuck at an infeasible point"
    x: Array
    multipliers: Array
    iterations: int
    status: str

    @property
    def is_stuck(self) -> bool:
        """Tell whether the solver says that no step comes nearer to feasible."""
        return self.status in (self.STUCK, "Infeasible_Problem_Detected")


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
        rows, columns = evaluation.pattern
        self.patterns = {
            "f": ca.Sparsity.dense(1, 1),
            "grad_f": ca.Sparsity.dense(evaluation.n_x, 1),
            "g": ca.Sparsity.dense(evaluation.n_g, 1),
            "jac_g": ca.Sparsity.triplet(evaluation.n_g, evaluation.n_x, rows.tolist(), columns.tolist()),
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


class Curvature(ca.Callback):
    """Give the second derivative of the Lagrangian to CasADi, as its `hess_lag`: the upper triangle.

    Args:
        evaluation: The evaluation.
    """

    def __init__(self, evaluation: Evaluation) -> None:
        ca.Callback.__init__(self)
        self.evaluation = evaluation
        n, first = evaluation.n_x, evaluation.n_y + evaluation.n_level
        felt = np.ones((n, n), dtype=bool)
        felt[evaluation.n_y : first] = felt[:, evaluation.n_y : first] = False
        i, j = np.indices((n, n))
        felt[first:, first:] = np.abs(i - j)[first:, first:] <= 1
        self._columns, self._rows = np.nonzero(np.triu(felt).T)
        self._pattern = ca.Sparsity.triplet(n, n, self._rows.tolist(), self._columns.tolist())
        self.construct("hess_lag", {})

    def get_n_in(self) -> int:
        return 4

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        sizes = (self.evaluation.n_x, 0, 1, self.evaluation.n_g)
        return ca.Sparsity.dense(sizes[i], 1) if sizes[i] else ca.Sparsity(0, 0)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._pattern

    def eval(self, arguments: list[ca.DM]) -> list[ca.DM]:
        x, _, weight, multipliers = (np.array(a.full()).ravel() for a in arguments)
        try:
            H = self.evaluation.hessian(x, float(weight[0]), multipliers)
        except ParaoptError as error:
            self.evaluation.error = error
            raise
        return [ca.DM(self._pattern, H[self._rows, self._columns])]


class Watch(ca.Callback):
    """Watch the iterates: keep the best feasible one, and stop where a run of them gains nothing.

    At a kink of a distance or a condition a solver that expects smooth functions goes to and fro between its sides, and
    its optimality conditions never hold. The merit is `f + penalty * largest violation` with the penalty above the sum
    of the multipliers, which makes it exact. The search ends where a whole run does not lower it by the tolerance but
    stays near the lowest, as a detour does not, and where the best feasible iterate is as near.

    Args:
        evaluation: What is solved.
        bounds: Those of the constraints.
        tolerance: Gain that counts as progress.
        patience: Length of a run.
        feasible: Violation that counts as none.
    """

    def __init__(
        self,
        evaluation: Evaluation,
        bounds: tuple[Array, Array],
        tolerance: float,
        patience: int = 8,
        feasible: float = 1e-7,
    ) -> None:
        ca.Callback.__init__(self)
        self.evaluation = evaluation
        self.bounds, self.tolerance, self.patience, self.feasible = bounds, tolerance, patience, feasible
        sizes = {"f": 1, "x": evaluation.n_x, "g": evaluation.n_g, "lam_x": evaluation.n_x, "lam_g": evaluation.n_g}
        self._sizes = [sizes.get(name, 0) for name in ca.nlpsol_out()]
        self._at = [ca.nlpsol_out().index(name) for name in ("f", "x", "g", "lam_g")]
        self.best: tuple[Point, Array] | None = None
        self.is_idle = False
        self._seen: list[tuple[float, float]] = []
        self._penalty = 0.0
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return len(self._sizes)

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes[i], 1) if self._sizes[i] else ca.Sparsity(0, 0)

    def eval(self, arguments: list[ca.DM]) -> list[int]:
        f, x, g, multipliers = (arguments[i].full().ravel() for i in self._at)
        low, high = self.bounds
        out = float(np.max(np.maximum(low - g, g - high), initial=0.0))
        if out <= self.feasible and (self.best is None or f[0] < self.best[0].f):
            point = self.evaluation.at(x)
            if np.isfinite(point.f):
                self.best = point, multipliers
        self._penalty = max(self._penalty, 1.5 * float(np.sum(np.abs(multipliers))))
        self._seen.append((float(f[0]), out))
        merits = np.array(self._seen) @ [1.0, self._penalty]
        if len(merits) > self.patience and self.best is not None:
            before, lately = np.min(merits[: -self.patience]), np.min(merits[-self.patience :])
            is_near = max(lately, self.best[0].f) < min(before, lately) + 30.0 * self.tolerance
            self.is_idle = bool(is_near and before - lately < self.tolerance)
        return [int(self.is_idle)]


def solve_by_ipopt(
    functions: Any,
    derivatives: Any,
    evaluation: Evaluation,
    bounds: tuple[Array, Array],
    box: tuple[Array, Array],
    guess: Array,
    *,
    multipliers: Array | None,
    iterations: int,
    tolerance: float,
) -> Answer:
    """Run IPOPT once.

    Args:
        functions: CasADi's problem, "x", "f" and "g".
        derivatives: "grad_f", "jac_g" and "hess_lag".
        evaluation: What computes them.
        bounds: Those of the constraints.
        box: Those of x.
        guess: Where to begin.
        multipliers: Those of the constraints, when the guess is nearly optimal.
        iterations: Bound on the iterations.
        tolerance: Convergence tolerance.

    Source: ipopt.
    """
    warm = multipliers is not None
    # at first, what the barriers of all constraints hold back is this share of the objective, however many they are
    first_barrier = 1e-5 if warm else float(np.clip(0.1 / max(evaluation.n_g, 1), 1e-5, 1e-3))
    settings = {
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "max_iter": iterations,
            "tol": tolerance,
            "acceptable_tol": 30 * tolerance,
            "acceptable_iter": 5,
            "acceptable_obj_change_tol": 1e-5,
            "mu_init": first_barrier,
            "constr_viol_tol": 1e-7,
            **({"warm_start_init_point": "yes", "warm_start_bound_push": 1e-6} if warm else {}),
        },
        "print_time": False,
        "error_on_fail": False,
        "no_nlp_grad": True,
        "show_eval_warnings": False,  # where the loops do not close, IPOPT takes a shorter step
        **derivatives,
    }
    watch = Watch(evaluation, bounds, tolerance)
    settings["iteration_callback"] = watch
    solver = ca.nlpsol("refine", "ipopt", dict(functions), settings)
    start = {"lam_g0": multipliers} if warm else {}
    answer = solver(x0=guess, lbg=bounds[0], ubg=bounds[1], lbx=box[0], ubx=box[1], **start)
    if evaluation.error is not None:
        raise evaluation.error
    stats = solver.stats()
    x, lam = np.asarray(answer["x"]).reshape(-1), np.asarray(answer["lam_g"]).reshape(-1)
    status = stats["return_status"]
    if not stats["success"] and watch.best is not None:
        point, lam = watch.best
        evaluation.recall(point)
        x = point.x
        status = "converged: small gains" if watch.is_idle else f"best feasible iterate before {status}"
    return Answer(x, lam, int(stats["iter_count"]), status)
