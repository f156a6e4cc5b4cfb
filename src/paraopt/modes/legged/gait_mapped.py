"""Derivatives of a program whose rows are one function of many samples: made once for a sample, placed for all.

Differentiating the whole as scalar expressions takes longer than solving it; differentiating mapped functions evaluates
slowly. Each sample depends on its own few quantities, which are affine in the unknowns: `u = P z + c`. The Jacobian is
then `diag(J_k) P` and the curvature of the Lagrangian `P^T diag(H_k) P`, with J_k and H_k of one small function.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True, eq=False)
class MappedRows:
    """Hold rows `r(u_k, data_k)` of n samples with their derivatives.

    Attributes:
        function: Map (u, *data) to the rows of one sample.
        count: Number of samples n.
    """

    function: ca.Function
    count: int

    def rows(self, u: ca.MX, data: list[ca.MX]) -> ca.MX:
        """Give the rows of all samples, sample by sample."""
        return ca.vec(self.function.map(self.count)(self._split(u), *data))

    def jacobian(self, u: ca.MX, data: list[ca.MX]) -> ca.MX:
        """Give the derivatives with respect to u of all samples, block by block along the diagonal."""
        inputs = self._inputs()
        J = ca.jacobian(self.function(*inputs), inputs[0])
        made = ca.Function("sample_slopes", inputs, [J], {"cse": True})
        return self._place(made.map(self.count)(self._split(u), *data), J.sparsity())

    def hessian(self, u: ca.MX, data: list[ca.MX], multipliers: ca.MX) -> ca.MX:
        """Give the second derivatives of `multipliers^T rows`, block by block along the diagonal."""
        inputs = self._inputs()
        weight = ca.SX.sym("weight", self.function.size1_out(0))
        H, _ = ca.hessian(ca.dot(weight, self.function(*inputs)), inputs[0])
        made = ca.Function("sample_curvature", [*inputs, weight], [H], {"cse": True})
        weights = ca.reshape(multipliers, self.function.size1_out(0), self.count)
        return self._place(made.map(self.count)(self._split(u), *data, weights), H.sparsity())

    def _inputs(self) -> list[ca.SX]:
        return [ca.SX.sym(f"i{k}", *self.function.size_in(k)) for k in range(self.function.n_in())]

    def _split(self, u: ca.MX) -> ca.MX:
        return ca.reshape(u, self.function.size1_in(0), self.count)

    def _place(self, blocks: ca.MX, one: ca.Sparsity) -> ca.MX:
        """Put blocks that stand side by side along the diagonal; both list their entries in the same order."""
        return ca.sparsity_cast(blocks, ca.diagcat(*[one] * self.count))


def build_derivatives(
    mapped: MappedRows, P: ca.MX, c: ca.MX, data: list[ca.MX], slack: ca.DM, rest: ca.Function, z: ca.MX, p: ca.MX
) -> tuple[dict[str, ca.MX], dict[str, Any]]:
    """Build a program and its derivatives.

    Args:
        mapped: The rows of the samples.
        P: What the unknowns add to the quantities of all samples, shape (n_u, n_z).
        c: These quantities at zero, shape (n_u,).
        data: Other inputs of the samples.
        slack: Constant matrix that is added to the rows of the samples, times z.
        rest: Map (z, p) to the objective and the other rows; scalar expressions.
        z: The unknowns.
        p: The parameters.

    Returns:
        CasADi's problem, and its options "grad_f", "jac_g" and "hess_lag".
    """
    u = ca.mtimes(P, z) + c
    f, others = rest(z, p)
    g = ca.vertcat(mapped.rows(u, data) + ca.mtimes(ca.MX(slack), z), others)
    zs, ps = ca.SX.sym("z", z.numel()), ca.SX.sym("p", p.numel())
    fs, gs = rest(zs, ps)
    sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", gs.numel())
    slopes = ca.Function("rest_slopes", [zs, ps], [ca.gradient(fs, zs), ca.jacobian(gs, zs)])
    H, _ = ca.hessian(sigma * fs + ca.dot(lam, gs), zs)
    curvature = ca.Function("rest_curvature", [zs, ps, sigma, lam], [H])
    grad, J_rest = slopes(z, p)
    J = ca.vertcat(ca.mtimes(mapped.jacobian(u, data), P) + ca.MX(slack), J_rest)
    weight, multipliers = ca.MX.sym("weight"), ca.MX.sym("multipliers", g.numel())
    n_rows = mapped.function.size1_out(0) * mapped.count
    blocks = mapped.hessian(u, data, multipliers[:n_rows])
    H_all = ca.mtimes(P.T, ca.mtimes(blocks, P)) + curvature(z, p, weight, multipliers[n_rows:])
    options = {
        "grad_f": ca.Function("grad_f", [z, p], [f, grad]),
        "jac_g": ca.Function("jac_g", [z, p], [g, J]),
        "hess_lag": ca.Function("hess_lag", [z, p, weight, multipliers], [ca.triu(H_all)]),
    }
    return {"x": z, "p": p, "f": f, "g": g}, options
