"""The functions that every model needs, each a CasADi graph compiled once per mechanism.

All linear solves are regularised least squares over *all* rows of the scaled Jacobian, `(A^T A + lambda) y = A^T b`
with `A = E diag(free)`, factored symbolically (sparse LDL^T), with the iterative refinement of the residual. One graph
therefore serves every choice of imposed variables, redundant rows and idle freedoms included: a fixed or idle column
is a zero column, and receives no motion.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.closure import ClosureGraph
from paraopt.kinematics.codegen import Backend, CompiledFunction
from paraopt.kinematics.newton import NewtonLoop

_REFINEMENTS = 2
_CSE = {"cse": True}


class FunctionSet:
    """Build and keep the compiled functions of one closure graph; each is made when first used.

    Args:
        graph: The closure graph.
        backend: See `CompiledFunction`.
    """

    def __init__(self, graph: ClosureGraph, backend: Backend = "auto") -> None:
        self.graph = graph
        self.backend: Backend = backend
        self._by_width: dict[tuple[str, int], CompiledFunction] = {}

    def prepare(self, width: int) -> None:
        """Make the functions of a motion space of some dimension, side by side: compilers run outside Python.

        Args:
            width: Number of independent coordinates.
        """
        _ = self._stacked_poses, self._scaled_residual, self._factor_forms  # shared: built before the threads
        wanted: list[Callable[[], object]] = [
            lambda: (self.tangent(width), self.curvature(1), self.curvature(width * (width + 1) // 2)),
            lambda: self.newton.is_compiled or self.step,
            lambda: self.pose_velocity(width),
            lambda: self.scaled_jacobian,
            lambda: self.jacobians,
            lambda: self.residual,
            lambda: self.poses,
        ]
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            for made in [pool.submit(make) for make in wanted]:
                made.result()

    @cached_property
    def residual(self) -> CompiledFunction:
        """Map X to F [m or 1], shape (n_equations,)."""
        return self._compile("residual", [self.graph.X], [self.graph.F])

    @cached_property
    def jacobians(self) -> CompiledFunction:
        """Map X to M, N, K, in units of F over units of X."""
        return self._compile("jacobians", [self.graph.X], list(self.graph.blocks))

    @cached_property
    def scaled_jacobian(self) -> CompiledFunction:
        """Map X to the scaled E [1], shape (n_equations, n_variables)."""
        return self._compile("scaled_jacobian", [self.graph.X], [self._scaled_jacobian])

    @cached_property
    def poses(self) -> CompiledFunction:
        """Map X to the poses of all links in the world, 3 x 4 each, stacked; shape (3 n_links, 4)."""
        return self._compile("poses", [self.graph.X], [self._stacked_poses])

    @property
    def step(self) -> CompiledFunction:
        """Map (X, free, damping) to the damped Newton step [m or rad] and the scaled residual at X [1].

        Source: Marquardt1963.
        """
        return self._solver("step", 0)

    def tangent(self, width: int) -> CompiledFunction:
        """Map (X, free, D, damping) to the motions T of all variables that impose the directions D.

        `E T = 0` and `T = D` on the variables that are not free. D and T have shape (n_variables, width).
        """
        return self._solver("tangent", width)

    def curvature(self, width: int) -> CompiledFunction:
        """Map (X, free, V, W, damping) to the second-order motions that keep the loops closed, imposed ones being zero.

        Column k solves `E h = -F''[V_k, W_k]` with h zero on the variables that are not free; so that on a motion with
        velocity V = W and imposed acceleration a, the acceleration of all variables is `T a + h`.
        """
        return self._solver("curvature", width)

    @cached_property
    def newton(self) -> NewtonLoop:
        """Close the loops from many starts in one compiled call; see `solve_closure`."""
        X, E, f = self.graph.X, self._scaled_jacobian, self._scaled_residual
        opening = ca.Function("paraopt_open", [X], [f, ca.vertcat(*E.nonzeros())], _CSE)
        entries, b = ca.SX.sym("entries", E.nnz()), ca.SX.sym("f", f.numel())
        free, damping = ca.SX.sym("free", X.numel()), ca.SX.sym("damping")
        factor, once, _ = self._factor_forms
        y = once(*factor(ca.SX(E.sparsity(), entries), free, damping), -b)
        correcting = ca.Function("paraopt_correct", [entries, b, free, damping], [free * y], _CSE)
        return NewtonLoop(opening, correcting, self.graph.variable_scale, self.backend)

    @cached_property
    def ranges(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Give the lowest and the highest values of the variables [m or rad], possibly infinite."""
        low, high = zip(*[v.range for v in self.graph.mechanism.variables], strict=True)
        return np.array(low), np.array(high)

    # -- graphs of the solvers -------------------------------------------------------------------------------------

    def _build_step(self, width: int) -> ca.Function:
        X, free, damping = self._symbols()
        f = self._residual_form(X)
        y = self._solve(self._factor(X, free, damping), -f, 0)
        return ca.Function("paraopt_step", [X, free, damping], [self._variable_scale * free * y, f])

    def _build_tangent(self, width: int) -> ca.Function:
        X, free, damping = self._symbols()
        D = ca.MX.sym("D", X.numel(), width)
        imposed = ca.diag((1 - free) / self._variable_scale) @ D
        y = self._solve(self._factor(X, free, damping), -(self._jacobian_form(X) @ imposed), _REFINEMENTS)
        T = ca.diag(self._variable_scale) @ (imposed + ca.diag(free) @ y)
        return ca.Function(f"paraopt_tangent{width}", [X, free, D, damping], [T])

    def _build_curvature(self, width: int) -> ca.Function:
        X, free, damping = self._symbols()
        V, W = ca.MX.sym("V", X.numel(), width), ca.MX.sym("W", X.numel(), width)
        c = self._second_form.map(width)(ca.repmat(X, 1, width), V, W)
        y = self._solve(self._factor(X, free, damping), -c, _REFINEMENTS)
        H = ca.diag(self._variable_scale) @ ca.diag(free) @ y
        return ca.Function(f"paraopt_curvature{width}", [X, free, V, W, damping], [H])

    def _solver(self, kind: str, width: int) -> CompiledFunction:
        """Give a solver; those of the motion space of the operational variables are compiled together."""
        if (kind, width) not in self._by_width:
            m = len(self.graph.mechanism.operational)
            usual = [("tangent", m), ("curvature", 1), ("curvature", m * (m + 1) // 2)]
            keys = list(dict.fromkeys(usual)) if (kind, width) in usual else [(kind, width)]
            builders = {"step": self._build_step, "tangent": self._build_tangent, "curvature": self._build_curvature}
            made = CompiledFunction.together([builders[k](w) for k, w in keys], self.backend)
            self._by_width.update(zip(keys, made, strict=True))
        return self._by_width[kind, width]

    @cached_property
    def closure_hessian(self) -> CompiledFunction:
        """Map (X, multipliers) to the scaled second derivatives of `multipliers . F`, shape (n, n) [1]."""
        X = self.graph.X
        multipliers = ca.SX.sym("multipliers", self._scaled_residual.numel())
        gradient = ca.jtimes(self._scaled_residual, X, multipliers, True)
        scale = ca.diag(self._variable_scale)
        return self._compile("closure_hessian", [X, multipliers], [scale @ ca.jacobian(gradient, X) @ scale])

    def pose_velocity(self, width: int) -> CompiledFunction:
        """Map (X, V) to the derivatives of the stacked poses along the columns of V; shape (width, 12 n_links)."""
        key = ("pose_velocity", width)
        if key not in self._by_width:
            V = ca.SX.sym("V", self.graph.X.numel(), width)
            derivative = ca.jtimes(ca.vec(self._stacked_poses.T), self.graph.X, V).T
            self._by_width[key] = self._compile(f"pose_velocity{width}", [self.graph.X, V], [derivative])
        return self._by_width[key]

    # -- expressions -----------------------------------------------------------------------------------------------

    def _symbols(self) -> tuple[ca.MX, ca.MX, ca.MX]:
        n = self.graph.X.numel()
        return ca.MX.sym("X", n), ca.MX.sym("free", n), ca.MX.sym("damping")

    @cached_property
    def _variable_scale(self) -> ca.DM:
        return ca.DM(self.graph.variable_scale)

    @cached_property
    def _scaled_residual(self) -> ca.SX:
        return self.graph.F / ca.DM(self.graph.row_scale)

    @cached_property
    def _scaled_jacobian(self) -> ca.SX:
        return ca.diag(1 / ca.DM(self.graph.row_scale)) @ self.graph.E @ ca.diag(self._variable_scale)

    @cached_property
    def _stacked_poses(self) -> ca.SX:
        return ca.vertcat(*[self.graph.X_W[link.name][:3, :] for link in self.graph.mechanism.links])

    # The pieces below are called, not expanded, by the graphs above: their code exists once, and compiles in seconds.

    @cached_property
    def _residual_form(self) -> ca.Function:
        return ca.Function("residual_form", [self.graph.X], [self._scaled_residual], _CSE)

    @cached_property
    def _jacobian_form(self) -> ca.Function:
        return ca.Function("jacobian_form", [self.graph.X], [self._scaled_jacobian], _CSE)

    @cached_property
    def _second_form(self) -> ca.Function:
        n = self.graph.X.numel()
        v, w = ca.SX.sym("v", n), ca.SX.sym("w", n)
        second = ca.jtimes(ca.jtimes(self._scaled_residual, self.graph.X, v), self.graph.X, w)
        return ca.Function("second_form", [self.graph.X, v, w], [second], _CSE)

    @cached_property
    def _factor_forms(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """Build the factorisation, the solve with its factors, and the solve with refinement."""
        n = self.graph.X.numel()
        free, damping = ca.SX.sym("free", n), ca.SX.sym("damping")
        A = ca.SX.sym("A", self._scaled_jacobian.sparsity())
        masked = A @ ca.diag(free)
        D, LT, p = ca.ldl(masked.T @ masked + damping * ca.SX.eye(n))
        factor = ca.Function("factor", [A, free, damping], [masked, D, LT], _CSE)

        A_ = ca.SX.sym("A", masked.sparsity())
        D_, LT_ = ca.SX.sym("D", D.sparsity()), ca.SX.sym("LT", LT.sparsity())
        b, y = ca.SX.sym("b", masked.size1()), ca.SX.sym("y", n)
        once = ca.Function("solve", [A_, D_, LT_, b], [ca.ldl_solve(A_.T @ b, D_, LT_, p)], _CSE)
        again = y + ca.ldl_solve(A_.T @ (b - A_ @ y), D_, LT_, p)
        refine = ca.Function("refine", [A_, D_, LT_, b, y], [again], _CSE)
        return factor, once, refine

    def _factor(self, X: ca.MX, free: ca.MX, damping: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        A, D, LT = self._factor_forms[0](self._jacobian_form(X), free, damping)
        return A, D, LT

    def _solve(self, factors: tuple[ca.MX, ca.MX, ca.MX], b: ca.MX, refinements: int) -> ca.MX:
        _, once, refine = self._factor_forms
        columns = []
        for k in range(b.size2()):
            y = once(*factors, b[:, k])
            for _ in range(refinements):
                y = refine(*factors, b[:, k], y)
            columns.append(y)
        return ca.horzcat(*columns)

    def _compile(self, name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> CompiledFunction:
        return CompiledFunction(ca.Function(f"paraopt_{name}", inputs, outputs, _CSE), self.backend)
