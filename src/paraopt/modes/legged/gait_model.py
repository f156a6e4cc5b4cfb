"""What a gait needs of a legged machine: trunk, legs, footholds and centre of gravity, as one CasADi function."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.kinematics import SolveOptions
from paraopt.kinematics.codegen import CompiledFunction
from paraopt.mechanism import Mobile, Series
from paraopt.modes.legged.balance import build_centre
from paraopt.modes.legged.machine import LeggedMachine

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GaitModel:
    """See a legged machine as a trunk that is carried by legs on footholds.

    Every foot must end a chain of three joints that hangs from one free link, the trunk, and be tied to a carrier that
    three translations place in the world: with the trunk's pose and the footholds imposed, the joints follow.

    Attributes:
        machine: The machine.

    Raises:
        DefinitionError: The feet do not hang from one free link, or a carrier is not placed by translations.
    """

    machine: LeggedMachine

    def __post_init__(self) -> None:
        trunks = {foot.name: self._chain(foot.link)[0] for foot in self.machine.feet}
        if len(set(trunks.values())) != 1:
            raise DefinitionError(
                f"feet of {self.machine.robot.name!r} hang from {trunks}; a gait needs one free trunk"
            )
        free = self.machine.robot.mechanism.link(next(iter(trunks.values())))
        if not isinstance(free, Mobile) or len(free.motions) != 6:
            raise DefinitionError(
                f"feet of {self.machine.robot.name!r} hang from {free.name!r}; a gait needs a trunk that is free in "
                "space, a Mobile link of six coordinates"
            )
        for foot, leg in zip(self.machine.feet, self.legs, strict=True):
            if len(leg) != 3:
                raise DefinitionError(
                    f"leg of foot {foot.name!r} has the joints {list(leg)}; a gait needs three that place the foot"
                )
        _ = self._places  # refuses carriers that are not placed by translations

    @cached_property
    def trunk(self) -> tuple[str, ...]:
        """Name the six coordinates of the trunk: x, y, z [m], alpha, beta, gamma [rad]."""
        free = self.machine.robot.mechanism.link(self._chain(self.machine.feet[0].link)[0])
        return tuple(m.name for m in free.motions)

    @cached_property
    def legs(self) -> tuple[tuple[str, ...], ...]:
        """Name the joints between trunk and foot, for each foot, from the trunk down."""
        return tuple(self._chain(foot.link)[1] for foot in self.machine.feet)

    @property
    def joints(self) -> tuple[str, ...]:
        """Name the joints of all legs."""
        return tuple(name for leg in self.legs for name in leg)

    @property
    def carriers(self) -> tuple[str, ...]:
        """Name the variables of all footholds, three for each foot."""
        return tuple(name for foot in self.machine.feet for name in foot.variables)

    @cached_property
    def rest(self) -> Array:
        """Give the machine at rest, its home configuration, shape (n_variables,)."""
        return self.machine.robot.home_configuration.X

    @cached_property
    def rest_pose(self) -> Array:
        """Give the pose of the trunk at rest [m, rad], shape (6,)."""
        return self.rest[self.machine.robot.mechanism.indices(self.trunk)]

    @cached_property
    def rest_places(self) -> Array:
        """Give the footholds at rest [m], shape (n_feet, 3)."""
        return np.asarray(self.machine.contacts(self.rest)[1][0])

    @cached_property
    def joint_range(self) -> tuple[Array, Array]:
        """Give the lowest and highest values of the joints of the legs [m or rad], those of the limits included."""
        robot = self.machine.robot
        low, high = robot.limits.bounds(robot.mechanism)
        index = robot.mechanism.indices(self.joints)
        return low[index], high[index]

    @cached_property
    def stance(self) -> ca.Function:
        """Map (trunk pose, joints) to the feet's points (n_feet, 3), the centre of gravity (3,) [m], and regularity.

        The regularity (n_feet,) of a leg is the determinant of its foot's motions by its joints, over that at rest:
        zero where the leg is stretched or folded, below zero on another branch [1]. Links that neither trunk nor legs
        move, such as a head, stay as they are at rest.
        """
        mechanism, graph = self.machine.robot.mechanism, self.machine.robot.kinematics.graph
        p, q = ca.SX.sym("p", 6), ca.SX.sym("q", len(self.joints))
        values = ca.SX(ca.DM(self.rest))
        values[mechanism.indices(self.trunk)] = p
        values[mechanism.indices(self.joints)] = q
        feet = [graph.X_W[f.link][:3, :3] @ ca.DM(list(f.point)) + graph.X_W[f.link][:3, 3] for f in self.machine.feet]
        determinants = ca.vertcat(
            *[
                ca.det(ca.jacobian(foot, graph.X)[:, mechanism.indices(leg)])
                for foot, leg in zip(feet, self.legs, strict=True)
            ]
        )
        at_rest = ca.substitute(determinants, graph.X, ca.DM(self.rest))
        outputs = [ca.horzcat(*feet).T, build_centre(self.machine), determinants / at_rest]
        outputs = ca.substitute(outputs, [graph.X], [values])
        return ca.Function("paraopt_stance", [p, q], outputs, {"cse": True})

    @cached_property
    def _compiled_stance(self) -> CompiledFunction:
        return CompiledFunction(self.stance, self.machine.robot.kinematics.functions.backend)

    def regularity(self, X: Array) -> Array:
        """Give the determinant of every leg over that at rest [1], shape (n, n_feet); see `stance`."""
        index = self.machine.robot.mechanism.indices
        return self._compiled_stance.batch(X[:, index(self.trunk)], X[:, index(self.joints)])[2]

    def carriers_at(self, places: ArrayLike) -> Array:
        """Give the variables of the footholds that put them at places in the world.

        Args:
            places: Places [m], shape (..., n_feet, 3).

        Returns:
            Values [m], shape (..., n_feet * 3), in the order of `carriers`.
        """
        inverses, origins = self._places
        off = np.asarray(places, dtype=float) - origins
        values = np.einsum("fij,...fj->...fi", inverses, off)
        return values.reshape(*values.shape[:-2], -1)

    def solve(self, poses: ArrayLike, places: ArrayLike, starts: ArrayLike) -> Array:
        """Close the loops at n trunk poses and footholds, near given configurations.

        Args:
            poses: Trunk poses [m, rad], shape (n, 6).
            places: Footholds [m], shape (n, n_feet, 3).
            starts: Configurations [m or rad], shape (n, n_variables) or one for all.

        Returns:
            Closed configurations, shape (n, n_variables).

        Raises:
            InfeasibleError: A foot does not reach its foothold; the message names it and how much is lacking.
        """
        X, closed = self.reach(poses, places, starts)
        if not np.all(closed):
            worst = int(np.argmin(closed))
            ends, carriers = self.machine.contacts(X[worst])
            gaps = np.linalg.norm(ends[0] - carriers[0], axis=1)
            foot = int(np.argmax(gaps))
            raise InfeasibleError(
                f"foot {self.machine.names[foot]!r} does not reach its foothold: {1e3 * gaps[foot]:.2f} mm are "
                "lacking; bring the trunk nearer or take a shorter step",
                X=X[worst],
                index=worst,
            )
        return X

    def reach(self, poses: ArrayLike, places: ArrayLike, starts: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Close the loops as far as possible: configurations (n, n_variables), and which of them are closed (n,)."""
        mechanism = self.machine.robot.mechanism
        poses = np.atleast_2d(np.asarray(poses, dtype=float))
        carriers = self.carriers_at(places).reshape(len(poses), -1)
        X = np.array(np.broadcast_to(np.asarray(starts, dtype=float), (len(poses), len(mechanism.names))))
        names = [*self.trunk, *self.carriers]
        closed = self.machine.robot.kinematics.solve_batch(
            names, np.hstack([poses, carriers]), X, SolveOptions(iterations=60)
        )
        return closed.X, np.asarray(closed.converged)

    def _chain(self, link: str) -> tuple[str, tuple[str, ...]]:
        """Give the link that a leg hangs from, and the variables between them."""
        mechanism = self.machine.robot.mechanism
        found: list[str] = []
        here = mechanism.link(link)
        while isinstance(here, Series):
            found = [*(m.name for m in here.motions), *found]
            here = mechanism.link(here.father)
        return here.name, tuple(found)

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """Give what turns places into variables: inverse directions (n_feet, 3, 3) and places at zero (n_feet, 3)."""
        mechanism = self.machine.robot.mechanism
        X = np.zeros((1, len(mechanism.names)))
        origins = self.machine.contacts(X)[1][0]
        inverses = []
        for k, foot in enumerate(self.machine.feet):
            kinds = [mechanism.variables[mechanism.index(name)].kind for name in foot.variables]
            if len(kinds) != 3 or any(kind != "length" for kind in kinds):
                raise DefinitionError(
                    f"carrier of foot {foot.name!r} is moved by {list(foot.variables)}; a gait needs three translations"
                )
            moved = np.zeros((3, len(mechanism.names)))
            moved[range(3), mechanism.indices(foot.variables)] = 1.0
            inverses.append(np.linalg.inv((self.machine.contacts(moved)[1][:, k] - origins[k]).T))
        return np.array(inverses), np.asarray(origins)
