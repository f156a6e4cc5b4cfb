"""Conditions on configurations beyond closures, ranges, space and singularities, with exact derivatives.

Two kinds are one to seed, refinement and certificate: a bound on any scalar that can be read off a configuration, and
an object that computes its quantities by itself, such as the margins of cable tensions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

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


class PathCondition(Protocol):
    """Compute quantities that must stay above bounds, for batches of configurations.

    The quantities are scaled: one that is 1 above its bound is out of sight of it.
    """

    @property
    def names(self) -> Sequence[str]:
        """Name the k quantities in messages."""
        ...

    @property
    def lower(self) -> Array:
        """Give the lowest allowed values [1], shape (k,)."""
        ...

    def values(self, X: Array) -> Array:
        """Evaluate at closed configurations (n, n_variables); shape (n, k)."""
        ...

    def gradients(self, X: Array, T: Array) -> tuple[Array, Array]:
        """Evaluate with derivatives along motions.

        Args:
            X: Closed configurations, shape (n, n_variables).
            T: Motions `dX / d independent`, shape (n, n_variables, m).

        Returns:
            Values, shape (n, k), and derivatives with respect to the independent coordinates, shape (n, k, m).
        """
        ...


@lru_cache(maxsize=64)
def read_conditions(graph: ClosureGraph, conditions: tuple[PathBound | PathCondition, ...]) -> ConditionSet:
    """Give the evaluator of conditions on a graph; made once."""
    return ConditionSet(graph, conditions)


class ConditionSet:
    """Evaluate conditions in batches, with first derivatives, and second ones of those that are expressions.

    Attributes:
        names: Name of each quantity.
        scales: What each is divided by, in its own unit.
        lower: Lowest values over the scales, shape (k,).
        upper: Highest values over the scales, shape (k,).

    Args:
        graph: The closure graph.
        conditions: The conditions.

    Raises:
        DefinitionError: Two quantities have one name, or bounds are not as many as names.
    """

    def __init__(self, graph: ClosureGraph, conditions: Sequence[PathBound | PathCondition]) -> None:
        self.names: list[str] = []
        scales: list[float] = []
        lower: list[float] = []
        upper: list[float] = []
        self._others: list[tuple[PathCondition, slice]] = []
        bounds: list[PathBound] = []
        places: list[int] = []
        for condition in conditions:
            if isinstance(condition, PathBound):
                places.append(len(self.names))
                bounds.append(condition)
                self.names.append(condition.name)
                scales.append(condition.scale)
                lower.append(condition.lower / condition.scale)
                upper.append(condition.upper / condition.scale)
                continue
            names, lowest = list(condition.names), np.asarray(condition.lower, dtype=float)
            if lowest.shape != (len(names),):
                raise DefinitionError(
                    f"condition on {names} has bounds of shape {lowest.shape}; give one for each name"
                )
            self._others.append((condition, slice(len(self.names), len(self.names) + len(names))))
            self.names += names
            scales += [1.0] * len(names)
            lower += lowest.tolist()
            upper += [np.inf] * len(names)
        if doubled := sorted({n for n in self.names if self.names.count(n) > 1}):
            raise DefinitionError(f"path constraints {doubled} appear twice; give them different names")
        self.scales, self.lower, self.upper = np.array(scales), np.array(lower), np.array(upper)
        self._places = np.array(places, dtype=int)
        if not bounds:
            return
        X = graph.X
        values = ca.vertcat(*[bound.build(graph) for bound in bounds])
        multipliers = ca.SX.sym("multipliers", len(bounds))
        slopes = ca.jacobian(values, X)
        curved = ca.jacobian(ca.jtimes(values, X, multipliers, True), X)
        self._first, self._second = CompiledFunction.together(
            [
                ca.Function("paraopt_condition", [X], [values, slopes], {"cse": True}),
                ca.Function(
                    "paraopt_condition_curvature", [X, multipliers], [slopes.T @ multipliers, curved], {"cse": True}
                ),
            ]
        )

    def __len__(self) -> int:
        return len(self.names)

    def __call__(self, X: Array, T: Array) -> tuple[Array, Array]:
        """Evaluate at n configurations.

        Args:
            X: Configurations, shape (n, n_variables).
            T: Motions `dX / d independent`, shape (n, n_variables, m).

        Returns:
            Values over their scales, shape (n, k), and derivatives with respect to the independent coordinates, shape
            (n, k, m).
        """
        values, slopes = np.empty((len(X), len(self))), np.empty((len(X), len(self), T.shape[2]))
        if self._places.size:
            found, along = self._first.batch(X)
            values[:, self._places] = found.reshape(len(X), -1)
            slopes[:, self._places] = along.reshape(len(X), -1, X.shape[1]) @ T
        for condition, part in self._others:
            values[:, part], slopes[:, part] = condition.gradients(X, T)
        return values, slopes

    def values(self, X: Array) -> Array:
        """Evaluate values over their scales alone, shape (n, k)."""
        values = np.empty((len(X), len(self)))
        if self._places.size:
            values[:, self._places] = self._first.batch(X)[0].reshape(len(X), -1)
        for condition, part in self._others:
            values[:, part] = condition.values(X)
        return values

    def levels(self, X: Array) -> Array:
        """Give how far the quantities are inside their bounds, over their scales, shape (n, k)."""
        values = self.values(X)
        return np.minimum(values - self.lower, self.upper - values)

    def curvature(self, X: Array, T: Array, H: Array, multipliers: Array) -> Array:
        """Give second derivatives of `multipliers . values` with respect to the independent coordinates.

        Quantities that are no expressions enter as if they were flat.

        Args:
            X: Configurations, shape (n, n_variables).
            T: Motions, shape (n, n_variables, m).
            H: Second derivatives of all variables, shape (n, n_variables, m, m).
            multipliers: Shape (n, k).

        Returns:
            Shape (n, m, m): `T^T (d2 c / dX2) T + (dc / dX) H`.
        """
        n, width = X.shape
        if not self._places.size:
            return np.zeros((n, T.shape[2], T.shape[2]))
        slopes, curved = self._second.batch(X, multipliers[:, self._places])
        bent = T.transpose(0, 2, 1) @ curved.reshape(n, width, width) @ T
        return bent + np.einsum("nv,nvij->nij", slopes.reshape(n, width), H)
