"""A legged machine: a robot with feet, and the masses that its balance depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.closure import ClosureGraph
from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics.codegen import CompiledFunction
from paraopt.mechanism import Mechanism, Series
from paraopt.mechanism.links import as_point
from paraopt.robot import Robot
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Foot:
    """Describe a foot: where it touches what it stands on, and the variables that place it there.

    A foot stands where its *carrier* is, a link that its own variables alone move in the world. Where these are held,
    the foot stands still; where they move, it is in the air. The end of the leg is tied to the carrier by closures, or
    is the carrier itself.

    Attributes:
        name: Name.
        variables: Variables that move the carrier, all of them.
        link: Link of the leg that ends in the foot.
        point: Point of contact on it [m].
        carrier: Link that the variables move; `link` itself when None.
        carrier_point: The same point of contact on the carrier [m]; `point` when None and the carrier is the link,
            else the carrier's origin.
        upright: Direction on the carrier that is along the support's normal while the foot stands, for a foot that
            stands on its sole; None for a foot that stands on a point.
        sole: Corners of the sole on the carrier [m], in the plane of the contact point across `upright`: what the
            support polygon is made of, so that a machine may stand on two feet or one. The point of contact when empty.
    """

    name: str
    variables: Sequence[str]
    link: str
    point: Sequence[float] = (0.0, 0.0, 0.0)
    carrier: str | None = None
    carrier_point: Sequence[float] | None = None
    upright: Sequence[float] | None = None
    sole: Sequence[Sequence[float]] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise DefinitionError(f"name of a foot is {self.name!r}; it must be a non-empty string")
        if isinstance(self.variables, str) or not self.variables:
            raise DefinitionError(f"variables of foot {self.name!r} are {self.variables!r}; name those that move it")
        object.__setattr__(self, "variables", tuple(self.variables))
        object.__setattr__(self, "point", as_point(self.point, f"point of foot {self.name!r}"))
        if self.carrier is None:
            object.__setattr__(self, "carrier", self.link)
        at = self.carrier_point
        if at is None:
            at = self.point if self.carrier == self.link else (0.0, 0.0, 0.0)
        object.__setattr__(self, "carrier_point", as_point(at, f"carrier point of foot {self.name!r}"))
        if self.upright is not None:
            direction = finite_vector(self.upright, 3, f"upright direction of foot {self.name!r}")
            size = float(np.linalg.norm(direction))
            if size == 0.0:
                raise DefinitionError(f"upright direction of foot {self.name!r} is zero; it must be a direction")
            object.__setattr__(self, "upright", tuple((direction / size).tolist()))
        corners = tuple(as_point(corner, f"corner of the sole of foot {self.name!r}") for corner in self.sole)
        object.__setattr__(self, "sole", corners)
        if not corners:
            return
        if self.upright is None or len(corners) < 3:
            raise DefinitionError(
                f"sole of foot {self.name!r} has {len(corners)} corners, and its upright direction is {self.upright}; "
                "a sole needs three corners and an upright direction"
            )
        above = (np.array(corners) - np.array(self.carrier_point)) @ np.array(self.upright)
        if not np.all(np.abs(above) <= 1e-9):
            worst = int(np.argmax(np.abs(above)))
            raise DefinitionError(
                f"corner {worst} of the sole of foot {self.name!r} is {above[worst]:.3g} m out of the plane of its "
                "point of contact; a sole is flat"
            )


@dataclass(frozen=True, eq=False)
class LeggedMachine:
    """Describe a machine that stands on feet.

    Attributes:
        robot: The robot.
        feet: Its feet, in the order in which they are drawn and reported.
        masses: Mass of each link that has one [kg]; those of the robot when None.
        centres: Centre of mass of each of these links in its own frame [m]; those of the robot when None, and a link's
            origin where nothing is said.

    Raises:
        DefinitionError: A foot's variables are not those that move its carrier; two feet share a variable; there is no
            mass at all.
        UnknownNameError: A link or a variable does not exist.
    """

    robot: Robot
    feet: Sequence[Foot]
    masses: Mapping[str, float] | None = None
    centres: Mapping[str, Sequence[float]] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "feet", tuple(self.feet))
        mechanism = self.robot.mechanism
        links = [link.name for link in mechanism.links]
        names = [foot.name for foot in self.feet]
        if not names or len(set(names)) < len(names):
            raise DefinitionError(f"feet of {self.robot.name!r} are {names}; there must be some, of different names")
        taken: dict[str, str] = {}
        for foot in self.feet:
            for link in (foot.link, str(foot.carrier)):
                if link not in links:
                    raise unknown_name(f"link of foot {foot.name!r}", link, links)
            moved_by = find_motions(mechanism, str(foot.carrier))
            if set(moved_by) != set(foot.variables):
                raise DefinitionError(
                    f"carrier {foot.carrier!r} of foot {foot.name!r} is moved by {list(moved_by)}, but the foot names "
                    f"{list(foot.variables)}; name all variables that move the carrier, and no others"
                )
            for name in foot.variables:
                if name in taken:
                    raise DefinitionError(f"variable {name!r} moves two feet, {taken[name]!r} and {foot.name!r}")
                taken[name] = foot.name
        masses = dict(self.robot.masses if self.masses is None else self.masses)
        centres = dict(self.robot.centres if self.centres is None else self.centres)
        for link, mass in masses.items():
            if link not in links:
                raise unknown_name("link that has a mass", link, links)
            if not (np.isfinite(mass) and mass >= 0):
                raise DefinitionError(f"mass of link {link!r} is {mass!r} kg; it must be finite and not negative")
        if not sum(masses.values()) > 0:
            raise DefinitionError(f"links of {self.robot.name!r} have no mass; state it in Robot(masses=...)")
        for link, point in centres.items():
            if link not in links:
                raise unknown_name("link that has a centre of mass", link, links)
            centres[link] = as_point(point, f"centre of mass of link {link!r}")
        object.__setattr__(self, "masses", MappingProxyType(masses))
        object.__setattr__(self, "centres", MappingProxyType(centres))

    @property
    def names(self) -> tuple[str, ...]:
        """Name the feet."""
        return tuple(foot.name for foot in self.feet)

    @property
    def mass(self) -> float:
        """Give the mass of the whole machine [kg]."""
        return float(sum((self.masses or {}).values()))

    def foot(self, name: str) -> Foot:
        """Find a foot by name.

        Raises:
            UnknownNameError: There is no such foot.
        """
        for foot in self.feet:
            if foot.name == name:
                return foot
        raise unknown_name(f"foot of {self.robot.name!r}", name, self.names)

    def contacts(self, X: Array) -> tuple[Array, Array]:
        """Give the points of contact of all feet, as the legs have them and as the carriers have them.

        Args:
            X: Values of all variables, shape (n, n_variables).

        Returns:
            Points in the world [m] of the ends of the legs and of the carriers, each of shape (n, n_feet, 3).
        """
        ends, carriers, _ = self._contacts.batch(np.atleast_2d(np.asarray(X, dtype=float)))
        return ends.reshape(-1, len(self.feet), 3), carriers.reshape(-1, len(self.feet), 3)

    def corners(self, X: Array, name: str) -> Array:
        """Give the points on which a foot stands, as its carrier has them: the corners of its sole, or its point.

        Args:
            X: Values of all variables, shape (n, n_variables).
            name: Name of the foot.

        Returns:
            Points in the world [m], shape (n, n_corners, 3).
        """
        foot, rows = self.foot(name), np.atleast_2d(np.asarray(X, dtype=float))
        if not foot.sole:
            return self.contacts(rows)[1][:, [self.names.index(name)]]
        return self._corners[name].batch(rows)[0].reshape(len(rows), -1, 3)

    def uprights(self, X: Array) -> Array:
        """Give the upright direction of every foot in the world, zero for feet on points; shape (n, n_feet, 3)."""
        return self._contacts.batch(np.atleast_2d(np.asarray(X, dtype=float)))[2].reshape(-1, len(self.feet), 3)

    def contact_slopes(self, X: Array) -> tuple[Array, Array]:
        """Give the points of contact at the ends of the legs, and their derivatives with respect to all variables.

        Args:
            X: Values of all variables, shape (n, n_variables).

        Returns:
            Points in the world [m], shape (n, n_feet, 3), and derivatives, shape (n, n_feet, 3, n_variables).
        """
        points = np.atleast_2d(np.asarray(X, dtype=float))
        ends, slopes = self._contact_slopes.batch(points)
        shape = (len(points), len(self.feet), 3)
        return ends.reshape(shape), slopes.reshape(*shape, points.shape[1])

    @cached_property
    def _contact_slopes(self) -> CompiledFunction:
        graph = self.robot.kinematics.graph
        ends = ca.vertcat(*[_place(graph, foot.link, foot.point) for foot in self.feet])
        function = ca.Function("paraopt_contact_slopes", [graph.X], [ends, ca.jacobian(ends, graph.X)], {"cse": True})
        return CompiledFunction(function, self.robot.kinematics.functions.backend)

    @cached_property
    def _corners(self) -> dict[str, CompiledFunction]:
        graph, backend = self.robot.kinematics.graph, self.robot.kinematics.functions.backend
        found = {}
        for foot in self.feet:
            if foot.sole:
                points = ca.densify(ca.horzcat(*[_place(graph, str(foot.carrier), corner) for corner in foot.sole]).T)
                function = ca.Function("paraopt_sole", [graph.X], [points], {"cse": True})
                found[foot.name] = CompiledFunction(function, backend)
        return found

    @cached_property
    def _contacts(self) -> CompiledFunction:
        graph = self.robot.kinematics.graph
        ends = [_place(graph, foot.link, foot.point) for foot in self.feet]
        carriers = [_place(graph, str(foot.carrier), foot.carrier_point or (0.0, 0.0, 0.0)) for foot in self.feet]
        uprights = [
            ca.SX.zeros(3) if foot.upright is None else graph.X_W[str(foot.carrier)][:3, :3] @ ca.DM(list(foot.upright))
            for foot in self.feet
        ]
        # one row for each foot, as the compiled functions give rows first
        outputs = [ca.densify(ca.horzcat(*group).T) for group in (ends, carriers, uprights)]
        return CompiledFunction(
            ca.Function("paraopt_contacts", [graph.X], outputs, {"cse": True}), self.robot.kinematics.functions.backend
        )


def _place(graph: ClosureGraph, link: str, point: Sequence[float]) -> ca.SX:
    return graph.X_W[link][:3, :3] @ ca.DM(list(point)) + graph.X_W[link][:3, 3]


def find_motions(mechanism: Mechanism, name: str) -> list[str]:
    """List the variables that move a link in the world, from the tree alone."""
    found: list[str] = []
    link = mechanism.link(name)
    while True:
        found += [m.name for m in link.motions]
        if not isinstance(link, Series):
            return found
        link = mechanism.link(link.father)
