"""Bounds of a user's own on a path: any scalar that can be read off a configuration, with exact derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.closure import ClosureGraph, read_expression
from paraopt.errors import DefinitionError
from paraopt.kinematics.codegen import CompiledFunction

Array = NDArray[np.float64]
Expression = Callable[[Mapping[str, ca.SX], Mapping[str, ca.SX]], ca.SX]


@dataclass(frozen=True, eq=False)
class PathBound:
    """Hold a quantity within bounds all along a path.

    Attributes:
        name: What messages call it.
        expression: Function of the values of all variables and of the poses (4 x 4) of all links in the world, each by
            name, that gives a CasADi scalar; as for a `Gauge`.
        lower: Lowest value, in the quantity's own unit.
        upper: Highest value.
        scale: What the quantity is divided by before it is judged; a change of about 1 should matter.

    Raises:
        DefinitionError: The bounds leave no value, or the scale is not above zero.
    """

    name: str
    expression: Expression
    lower: float = -np.inf
    upper: float = np.inf
    scale: float = 1.0

    def __post_init__(self) -> None:
        if not (self.lower <= self.upper and self.lower < np.inf and self.upper > -np.inf):
            raise DefinitionError(
                f"bounds of {self.name!r} are [{self.lower}, {self.upper}]; the lower must not be above the upper"
            )
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise DefinitionError(f"scale of {self.name!r} is {self.scale}; it must be finite and above 0")

    def build(self, graph: ClosureGraph) -> ca.SX:
        """Build the expression over its scale, in the variables of a closure graph.

        Raises:
            UnknownNameError: It asks for a variable or a link that does not exist.
            DefinitionError: It cannot be built, or is no scalar.
        """
        value = {name: graph.X[i] for i, name in enumerate(graph.mechanism.names)}
        return read_expression(self.expression, value, graph.X_W, repr(self.name)) / self.scale


@lru_cache(maxsize=64)
def read_constraints(graph: ClosureGraph, constraints: tuple[PathBound, ...]) -> ConstraintSet:
    """Give the evaluator of quantities on a graph; made once."""
    return ConstraintSet(graph, constraints)


class ConstraintSet:
    """Evaluate a user's quantities over their scales, in batches, with first and second derivatives.

    Args:
        graph: The closure graph.
        constraints: The quantities.
    """

    def __init__(self, graph: ClosureGraph, constraints: Sequence[PathBound]) -> None:
        self.constraints = tuple(constraints)
        names = [c.name for c in self.constraints]
        if doubled := sorted({n for n in names if names.count(n) > 1}):
            raise DefinitionError(f"path constraints {doubled} appear twice; give them different names")
        self.lower = np.array([c.lower / c.scale for c in self.constraints])
        self.upper = np.array([c.upper / c.scale for c in self.constraints])
        if not self.constraints:
            return
        X = graph.X
        values = ca.vertcat(*[c.build(graph) for c in self.constraints])
        multipliers = ca.SX.sym("multipliers", len(self.constraints))
        slopes = ca.jacobian(values, X)
        curved = ca.jacobian(ca.jtimes(values, X, multipliers, True), X)
        self._first, self._second = CompiledFunction.together(
            [
                ca.Function("paraopt_held", [X], [values, slopes], {"cse": True}),
                ca.Function(
                    "paraopt_held_curvature", [X, multipliers], [slopes.T @ multipliers, curved], {"cse": True}
                ),
            ]
        )

    def __len__(self) -> int:
        return len(self.constraints)

    def __call__(self, X: Array, T: Array) -> tuple[Array, Array]:
        """Evaluate at n configurations.

        Args:
            X: Configurations, shape (n, n_variables).
            T: Motions `dX / d independent`, shape (n, n_variables, m).

        Returns:
            Values, shape (n, k), and derivatives with respect to the independent coordinates, shape (n, k, m).
        """
        k = len(self)
        if not k:
            return np.zeros((len(X), 0)), np.zeros((len(X), 0, T.shape[2]))
        values, slopes = self._first.batch(X)
        return values.reshape(len(X), k), slopes.reshape(len(X), k, X.shape[1]) @ T

    def values(self, X: Array) -> Array:
        """Evaluate values alone, shape (n, k)."""
        return self._first.batch(X)[0].reshape(len(X), len(self)) if len(self) else np.zeros((len(X), 0))

    def curvature(self, X: Array, T: Array, H: Array, multipliers: Array) -> Array:
        """Give second derivatives of `multipliers . values` with respect to the independent coordinates.

        Args:
            X: Configurations, shape (n, n_variables).
            T: Motions, shape (n, n_variables, m).
            H: Second derivatives of all variables, shape (n, n_variables, m, m).
            multipliers: Shape (n, k).

        Returns:
            Shape (n, m, m): `T^T (d2 c / dX2) T + (dc / dX) H`.
        """
        slopes, curved = self._second.batch(X, multipliers)
        n, width = X.shape
        bent = T.transpose(0, 2, 1) @ curved.reshape(n, width, width) @ T
        return bent + np.einsum("nv,nvij->nij", slopes.reshape(n, width), H)
