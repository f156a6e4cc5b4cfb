"""Balance of a machine that moves: inertia counts beside weight, so that speed may tip over what stands at rest.

Every link is a mass in its centre; the turning of links about their own centres is left out. With u upwards, A and B
the feet at an edge and e = AB / |AB|, the moment of weight and inertia about the edge, over that of the weight alone at
a metre's distance, is

`d = |AB| / |AB across u| sum_i w_i (e x (r_i - A)) . (u + a_i / g)`,  w_i = m_i / sum m.

At rest it is the distance of the projected centre of gravity from the edge; in motion it is zero where the zero moment
point reaches the edge, and the machine begins to tip over. It is linear in the accelerations a_i, hence in the
acceleration and the squared speed of a path's parameter: retimers can hold it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.closure import ClosureGraph
from paraopt.errors import DefinitionError
from paraopt.kinematics.codegen import Backend, CompiledFunction
from paraopt.modes.legged.balance import SupportPolygon, level_axes, weigh_links
from paraopt.modes.legged.machine import LeggedMachine
from paraopt.planning import PathPoints, PathRows, Problem

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665  # m/s^2


def measure_tipping(
    machine: LeggedMachine,
    polygon: SupportPolygon,
    X: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    gravity: float = STANDARD_GRAVITY,
) -> Array:
    """Measure how far n states of a machine are from tipping over each edge.

    Args:
        machine: The machine.
        polygon: The polygon of the feet that stand, three at least.
        X: Values of all variables [m or rad], shape (n, n_variables).
        velocity: Their velocities [m/s or rad/s], same shape.
        acceleration: Their accelerations [m/s^2 or rad/s^2], same shape.
        gravity: Acceleration of gravity [m/s^2].

    Returns:
        Distances d of the module's head [m], below zero where the machine tips over, shape (n, n_edges).

    Source: VukobratovicBorovac2004.
    """
    places, _, accelerations = _move_masses(machine, X, velocity, acceleration)
    arms = _build_arms(polygon, places)
    weights = weigh_links(machine)[1][:, 3]
    felt = -polygon.down + accelerations / gravity
    return np.asarray(np.einsum("i,neix,nix->ne", weights, arms, felt))


@dataclass(frozen=True, eq=False)
class TippingConstraint:
    """Time a path so that inertia does not tip the machine over: a constraint of a retimer.

    Attributes:
        machine: The machine.
        polygon: The polygon of the feet that stand.
        margin: Least distance d of the module's head [m].
        gravity: Acceleration of gravity [m/s^2].

    Raises:
        DefinitionError: The feet make no polygon; gravity is not finite and above zero.
    """

    machine: LeggedMachine
    polygon: SupportPolygon
    margin: float = 0.0
    gravity: float = STANDARD_GRAVITY

    def __post_init__(self) -> None:
        if len(self.polygon.corners) < 3:
            raise DefinitionError(f"feet {list(self.polygon.corners)} make no polygon: nothing keeps from tipping over")
        if not (np.isfinite(self.gravity) and self.gravity > 0):
            raise DefinitionError(f"acceleration of gravity is {self.gravity} m/s^2; it must be finite and above 0")

    def rows(self, problem: Problem, points: PathPoints) -> PathRows:
        """Give one row for each edge: `margin - d <= 0`."""
        places, first, second = _move_masses(self.machine, points.X, points.dX, points.ddX)
        arms = _build_arms(self.polygon, places)
        weights = weigh_links(self.machine)[1][:, 3]
        a, b, d = (
            np.einsum("i,neix,nix->ne", weights, arms, part)
            for part in (first, second, np.broadcast_to(-self.polygon.down, first.shape))
        )
        names = tuple(f"tipping over the edge {edge}" for edge in self.polygon.edges)
        return PathRows(names, -a / self.gravity, -b / self.gravity, self.margin - d)


def _build_arms(polygon: SupportPolygon, places: Array) -> Array:
    """Give `|AB| / |AB across u| e x (r_i - A)` for each edge and mass, shape (n, n_edges, n_links, 3)."""
    starts = polygon.points
    sides = np.roll(starts, -1, axis=0) - starts
    across = np.linalg.norm(sides @ level_axes(polygon.down).T, axis=1)
    return np.cross((sides / across[:, None])[None, :, None, :], places[:, None, :, :] - starts[None, :, None, :])


def _move_masses(machine: LeggedMachine, X: ArrayLike, V: ArrayLike, A: ArrayLike) -> tuple[Array, Array, Array]:
    """Give places, velocities and accelerations of the links' centres of mass, shape (n, n_links, 3) each."""
    links, weights = weigh_links(machine)
    rows = [np.atleast_2d(np.asarray(values, dtype=float)) for values in (X, V, A)]
    kinematics = machine.robot.kinematics
    function = _motion_function(kinematics.graph, links, kinematics.functions.backend)
    places, first, second = function.batch(*rows, weights[:, :3] / weights[:, 3:])
    shape = (len(rows[0]), len(links), 3)
    return places.reshape(shape), first.reshape(shape), second.reshape(shape)


@lru_cache(maxsize=64)
def _motion_function(graph: ClosureGraph, links: tuple[str, ...], backend: Backend) -> CompiledFunction:
    """Map X, its two derivatives and a point of each link to the points' places and two derivatives."""
    n = graph.X.numel()
    V, A = ca.SX.sym("V", n), ca.SX.sym("A", n)
    points = ca.SX.sym("points", len(links), 3)
    placed = [graph.X_W[link][:3, :3] @ points[i, :].T + graph.X_W[link][:3, 3] for i, link in enumerate(links)]
    places = ca.vertcat(*placed)
    first = ca.jtimes(places, graph.X, V)
    second = ca.jtimes(first, graph.X, V) + ca.jtimes(places, graph.X, A)
    outputs = [ca.densify(ca.reshape(values, 3, len(links)).T) for values in (places, first, second)]
    function = ca.Function("paraopt_mass_motion", [graph.X, V, A, points], outputs, {"cse": True})
    return CompiledFunction(function, backend)
