"""The graph: from a mechanism to its closure equations F(X) = 0 and poses, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, singledispatch
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.mechanism import (
    Base,
    Closure,
    Coincidence,
    Coupling,
    Equilibrium,
    Link,
    Mechanism,
    Motion,
    ParallelAxes,
    ParallelPlanes,
    PerpendicularAxes,
    PointOnLine,
    PointOnPlane,
    Prismatic,
    Revolute,
    Series,
    Weld,
)
from paraopt.mechanism.closures import unit
from paraopt.mechanism.joints import UNLIMITED, Kind, Range
from paraopt.spatial import rotation_about, rotation_xyz

Unit = Literal["m", "1", "N", "N m"]


@dataclass(frozen=True)
class Row:
    """Describe one closure equation.

    Attributes:
        name: Name of the closure and component.
        unit: "m", "1" for an equation without dimension, "N" or "N m".
        force: Unit in which its forces are judged [N], where it has any.
        closure: Name of the constraint, or gauge, that it belongs to.
    """

    name: str
    unit: Unit
    force: float = 1.0
    closure: str = ""


@dataclass(frozen=True, eq=False)
class ClosureGraph:
    """Hold the closure equations of a mechanism as symbolic expressions.

    Attributes:
        mechanism: The mechanism.
        X: All variables in the order active, passive, operational; shape (n_variables,).
        F: Closure residual, zero when the loops are closed; shape (n_equations,), units as in `rows`.
        rows: Name and unit of each equation.
        X_W: Pose of every link in the world, 4 x 4, by name.
    """

    mechanism: Mechanism
    X: ca.SX
    F: ca.SX
    rows: tuple[Row, ...]
    X_W: Mapping[str, ca.SX]

    @cached_property
    def E(self) -> ca.SX:
        """Give the Jacobian `E = dF/dX = [M N K]`; shape (n_equations, n_variables)."""
        return ca.jacobian(self.F, self.X)

    @cached_property
    def blocks(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Give M (active), N (passive) and K (operational), the column blocks of E."""
        a, p = len(self.mechanism.active), len(self.mechanism.passive)
        return self.E[:, :a], self.E[:, a : a + p], self.E[:, a + p :]

    @cached_property
    def variable_scale(self) -> NDArray[np.float64]:
        """Give the unit in which each variable is judged: the characteristic length [m], 1 rad, or a weight [N]."""
        return np.array([v.scale for v in self.mechanism.variables])

    @cached_property
    def row_scale(self) -> NDArray[np.float64]:
        """Give the unit in which each equation is judged: the characteristic length [m], 1, a weight, or both."""
        L = self.mechanism.length
        scales = [{"m": L, "1": 1.0, "N": row.force, "N m": row.force * L}[row.unit] for row in self.rows]
        return np.array(scales)


@dataclass(frozen=True, eq=False)
class Gauge:
    """Name a quantity that can be read off a configuration, so that it can be imposed or solved for like a variable.

    It becomes a passive variable of the equations, tied to its expression by an equation of its own.

    Attributes:
        name: Name of the variable.
        expression: Function of the values of all variables and of the poses (4 x 4) of all links in the world, each by
            name, that gives a CasADi scalar [m or rad].
        kind: "length" [m] or "angle" [rad]; an angle is not reduced to a turn.
        range: Lowest and highest value [m or rad].
    """

    name: str
    expression: Callable[[Mapping[str, ca.SX], Mapping[str, ca.SX]], ca.SX]
    kind: Kind = "length"
    range: Range = UNLIMITED


def build_closure(mechanism: Mechanism, gauges: Sequence[Gauge] = ()) -> ClosureGraph:
    """Build the closure equations and the link poses of a mechanism.

    Args:
        mechanism: The description.
        gauges: Quantities that are added as passive variables, each with one equation.

    Returns:
        The graph; `F(X) = 0` where the loops are closed, `E Xdot = M qdot_a + N qdot_p + K xdot = 0` on a motion.

    Raises:
        DefinitionError: A gauge has the name of a variable, or its expression cannot be built or is no scalar.

    Source: Lahouar, II.1, II.2.
    """
    if gauges:
        mechanism = _add_gauges(mechanism, gauges)
    X = ca.SX.sym("X", len(mechanism.names))
    value = {name: X[i] for i, name in enumerate(mechanism.names)}
    X_W: dict[str, ca.SX] = {}
    for link in mechanism.ordered_links:
        father = X_W[link.father] if isinstance(link, Series) else ca.SX.eye(4)
        X_W[link.name] = father @ _constant_placement(link) @ _joint_transform(link.motions, value)
    equations: list[ca.SX] = []
    rows: list[Row] = []
    symbols = Symbols(mechanism, value, X_W)
    for constraint in mechanism.constraints:
        for expression, new in build_equations(constraint, symbols):
            equations.append(expression)
            rows += [replace(row, closure=constraint.name) for row in new]
    for gauge in gauges:
        equations.append(read_expression(gauge.expression, value, X_W, f"gauge {gauge.name!r}") - value[gauge.name])
        rows.append(Row(f"gauge {gauge.name}", "m" if gauge.kind == "length" else "1", closure=gauge.name))
    F = ca.vertcat(*equations) if equations else ca.SX(0, 1)
    return ClosureGraph(mechanism, X, F, tuple(rows), X_W)


def _add_gauges(mechanism: Mechanism, gauges: Sequence[Gauge]) -> Mechanism:
    """Add a variable for each gauge, as the joint of a link that carries nothing."""
    base, links = mechanism.base.name, []
    for gauge in gauges:
        joint = (
            Revolute(gauge.name, "z", gauge.range) if gauge.kind == "angle" else Prismatic(gauge.name, "x", gauge.range)
        )
        links.append(Series(f"gauge {gauge.name}", base, joint=joint))
    # the unit in which lengths are judged is that of the machine, not of its gauges
    return replace(mechanism, links=(*mechanism.links, *links), characteristic_length=mechanism.length)


Expression = Callable[[Mapping[str, ca.SX], Mapping[str, ca.SX]], ca.SX]


def read_expression(expression: Expression, value: Mapping[str, ca.SX], X_W: Mapping[str, ca.SX], what: str) -> ca.SX:
    """Build a scalar that a person states as a function of variables and link poses.

    Args:
        expression: Function of the values of all variables and of the poses (4 x 4) of all links, each by name.
        value: Symbols of the variables.
        X_W: Poses of the links in the world.
        what: How an error calls the expression.

    Returns:
        The scalar.

    Raises:
        UnknownNameError: It asks for a variable or a link that does not exist.
        DefinitionError: It cannot be built, or is no scalar.
    """
    try:
        built = ca.SX(expression(value, X_W))
    except KeyError as error:
        raise unknown_name(f"variable or link in {what}", str(error.args[0]), [*value, *X_W]) from error
    except (TypeError, ValueError, RuntimeError, NotImplementedError, IndexError) as error:
        raise DefinitionError(f"expression of {what} cannot be built: {error}") from error
    if built.shape != (1, 1):
        raise DefinitionError(f"expression of {what} has shape {built.shape}; it must be a scalar")
    return built


Equations = list[tuple[ca.SX, list[Row]]]


@dataclass(frozen=True, eq=False)
class Symbols:
    """Hold what equations are made of.

    Attributes:
        mechanism: The mechanism.
        value: Every variable, by name.
        X_W: Pose of every link in the world, by name.
    """

    mechanism: Mechanism
    value: Mapping[str, ca.SX]
    X_W: Mapping[str, ca.SX]

    def choose(self, in_plane: str, in_space: str = "xyz") -> str:
        """Choose the axes of a vector equation: out-of-plane rows are never built."""
        return in_plane if self.mechanism.planar else in_space

    def point(self, link: str, p_L: Any) -> ca.SX:
        """Build a point of a link in the world [m]."""
        X_WL = self.X_W[link]
        return X_WL[:3, :3] @ ca.DM(p_L) + X_WL[:3, 3]

    def direction(self, link: str, direction: Any) -> ca.SX:
        """Build a unit vector of a link in the world."""
        return self.X_W[link][:3, :3] @ ca.sparsify(ca.DM(unit(direction)))

    def gap(self, constraint: Any) -> ca.SX:
        """Build the way from the second point of a constraint to its first one, in the world [m]."""
        return self.point(constraint.link_A, constraint.point_A) - self.point(constraint.link_B, constraint.point_B)


@singledispatch
def build_equations(constraint: Closure, symbols: Symbols) -> Equations:
    """Build the equations of one simple constraint.

    Args:
        constraint: The constraint.
        symbols: Variables and poses of links.

    Returns:
        Residuals, each with the names and units of its rows.

    Raises:
        DefinitionError: The kind of constraint is not known.

    Source: Lahouar, II.1.
    """
    raise DefinitionError(f"no equations are known for a closure of type {type(constraint).__name__}")


@build_equations.register
def _(constraint: Coincidence, symbols: Symbols) -> Equations:
    return [_along_axes(symbols.gap(constraint), constraint.name, "m", symbols.choose("xy"))]


@build_equations.register
def _(constraint: ParallelAxes, symbols: Symbols) -> Equations:
    u_A = symbols.direction(constraint.link_A, constraint.axis_A)
    u_B = symbols.direction(constraint.link_B, constraint.axis_B)
    return [_along_axes(ca.cross(u_A, u_B), constraint.name, "1", symbols.choose("z"))]


@build_equations.register
def _(constraint: ParallelPlanes, symbols: Symbols) -> Equations:
    n_A = symbols.direction(constraint.link_A, constraint.normal_A)
    n_B = symbols.direction(constraint.link_B, constraint.normal_B)
    return [_along_axes(ca.cross(n_A, n_B), constraint.name, "1", symbols.choose("z"))]


@build_equations.register
def _(constraint: PerpendicularAxes, symbols: Symbols) -> Equations:
    u_A = symbols.direction(constraint.link_A, constraint.axis_A)
    u_B = symbols.direction(constraint.link_B, constraint.axis_B)
    return [(ca.dot(u_A, u_B), [Row(constraint.name, "1")])]


@build_equations.register
def _(constraint: PointOnLine, symbols: Symbols) -> Equations:
    u_B = symbols.direction(constraint.link_B, constraint.axis_B)
    return [_along_axes(ca.cross(symbols.gap(constraint), u_B), constraint.name, "m", symbols.choose("z"))]


@build_equations.register
def _(constraint: PointOnPlane, symbols: Symbols) -> Equations:
    n_B = symbols.direction(constraint.link_B, constraint.normal_B)
    return [(ca.dot(symbols.gap(constraint), n_B), [Row(constraint.name, "m")])]


@build_equations.register
def _(constraint: Weld, symbols: Symbols) -> Equations:
    X_AB = _constant_transform(constraint.at, constraint.rotation)
    difference = symbols.X_W[constraint.link_A] @ X_AB - symbols.X_W[constraint.link_B]
    # in the plane the cosine and the sine of one direction say all; one alone would allow half a turn
    axes, columns = symbols.choose("xy"), symbols.choose("x")
    turned = [_along_axes(difference[:3, "xyz".index(c)], f"{constraint.name} [e{c}]", "1", axes) for c in columns]
    return [_along_axes(difference[:3, 3], constraint.name, "m", axes), *turned]


@build_equations.register
def _(constraint: Coupling, symbols: Symbols) -> Equations:
    variables = {v.name: v for v in symbols.mechanism.variables}
    kind = constraint.check_kinds({name: v.kind for name, v in variables.items()})
    factors = {**constraint.coefficients, **constraint.radii}
    relation = sum(factor * symbols.value[name] for name, factor in factors.items()) - getattr(constraint, kind)
    units: dict[str, Unit] = {"length": "m", "angle": "1", "force": "N"}
    return [(relation, [Row(constraint.name, units[kind], max(variables[name].scale for name in factors))])]


@build_equations.register
def _(constraint: Equilibrium, symbols: Symbols) -> Equations:
    c = symbols.point(constraint.link, constraint.centre)
    weight, load = constraint.mass * np.array(constraint.gravity), np.array(constraint.force)
    force = ca.SX(ca.DM(weight + load))
    moment = ca.DM(constraint.moment) + ca.cross(symbols.point(constraint.link, constraint.at) - c, ca.SX(ca.DM(load)))
    for tension in constraint.tensions:
        pull = symbols.gap(tension)  # from the attachment to the exit
        if constraint.link == tension.link_B:
            held = symbols.point(tension.link_B, tension.point_B)
        else:
            pull, held = -pull, symbols.point(tension.link_A, tension.point_A)
        on_link = symbols.value[tension.name] * pull / ca.norm_2(pull)
        force += on_link
        moment += ca.cross(held - c, on_link)
    parts: list[tuple[ca.SX, str, Unit, str]] = [
        (force, "force", "N", symbols.choose("xy")),
        (moment, "moment", "N m", symbols.choose("z")),
    ]
    return [_along_axes(v, f"{constraint.name}, {what}", u, axes, constraint.scale) for v, what, u, axes in parts]


def _along_axes(vector: ca.SX, name: str, unit: Unit, axes: str, force: float = 1.0) -> tuple[ca.SX, list[Row]]:
    components = ca.vertcat(*[vector["xyz".index(axis)] for axis in axes])
    return components, [Row(f"{name} [{axis}]", unit, force) for axis in axes]


def _constant_placement(link: Link) -> ca.SX:
    if not isinstance(link, (Base, Series)):
        return ca.SX.eye(4)
    return _constant_transform(link.at, link.rotation)


def _constant_transform(at: Any, rotation: Any) -> ca.SX:
    X = ca.SX.eye(4)
    # exact quarter turns keep the graph sparse: cos(pi/2) = 6e-17 would tie everything to everything
    R = np.asarray(ca.DM(rotation_xyz(*rotation)))
    R[np.abs(R) < 1e-15] = 0.0
    X[:3, :3] = ca.sparsify(ca.DM(R))
    X[:3, 3] = ca.sparsify(ca.DM(at))
    return X


def _joint_transform(motions: tuple[Motion, ...], value: Mapping[str, ca.SX]) -> ca.SX:
    X = ca.SX.eye(4)
    for m in motions:
        step = ca.SX.eye(4)
        if m.kind == "angle":
            step[:3, :3] = rotation_about(m.axis, value[m.name])
        else:
            step["xyz".index(m.axis), 3] = value[m.name]
        X = X @ step
    return X
