"""Energy of a hanging platform: weight and load, with the lengths of its cables, their slopes and its curvature.

Around a pose with origin p and rotation R the platform moves by scaled steps z: its origin by L xi, its axes by the
rotation of vector rho, turned by Cayley's map. All derivatives are taken at z = 0, so that no pose is singular, and the
slope of the energy with tensions, `d(V + t . l)/dz`, is what `W t + w = 0` says, with the sign turned.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from paraopt.errors import DefinitionError
from paraopt.kinematics import CompiledFunction
from paraopt.kinematics.interior import build_program
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.wrench import lay_over_pulley

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Place:
    """Hold where a platform is.

    Attributes:
        p: Its origin in the world [m], shape (3,).
        R: Its rotation in the world, shape (3, 3).
    """

    p: Array
    R: Array

    @classmethod
    def at(cls, robot: CableRobot, pose: ArrayLike) -> Place:
        """Give the place at values of a robot's coordinates, shape (dof,)."""
        named = dict(zip(robot.coordinates, robot.check_poses(pose)[0].tolist(), strict=True))
        p = np.array([named["x"], named["y"], named.get("z", 0.0)])
        if robot.planar:
            return cls(p, Rotation.from_euler("z", named["theta"]).as_matrix())
        turns = [named[m.name] for m in robot.platform.motions if m.kind == "angle"]
        return cls(p, Rotation.from_euler(robot.order.upper(), turns).as_matrix())

    def pose(self, robot: CableRobot) -> Array:
        """Give the values of a robot's coordinates [m, rad], shape (dof,)."""
        if robot.planar:
            return np.array([*self.p[:2], np.arctan2(self.R[1, 0], self.R[0, 0])])
        first, second, third = ("xyz".index(a) for a in robot.order)
        sign = 1.0 if (first, second, third) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1.0
        # the entry of the matrix that holds the sine of the middle angle alone
        middle = np.arcsin(np.clip(sign * self.R[first, third], -1.0, 1.0))
        if abs(self.R[first, third]) < 1.0 - 1e-14:
            one = np.arctan2(-sign * self.R[second, third], self.R[third, third])
            last = np.arctan2(-sign * self.R[first, second], self.R[first, first])
        else:  # first and last axis agree: one angle says all
            one, last = np.arctan2(sign * self.R[third, second], self.R[second, second]), 0.0
        return np.array([*self.p, one, middle, last])

    def moved(self, robot: CableRobot, z: ArrayLike) -> Place:
        """Give the place after a scaled step, shape (dof,)."""
        step = np.asarray(z, dtype=float)
        shift, turn = np.zeros(3), np.zeros(3)
        if robot.planar:
            shift[:2], turn[2] = step[:2], step[2]
            turned = Rotation.from_rotvec(turn).as_matrix()
        else:
            shift, turn = step[:3], step[3:]
            turned = np.array(ca.DM(_cayley(ca.DM(turn))))
        R = turned @ self.R
        U, _, Vt = np.linalg.svd(R)  # the nearest rotation: many steps must not stretch the platform
        return Place(self.p + robot.length_scale * shift, U @ Vt)


class Energy:
    """Evaluate energy, lengths and their derivatives of a cable robot; see the module.

    Args:
        robot: The cable robot.

    Raises:
        DefinitionError: No force pulls the platform, or a constant moment acts in space, which has no energy.
    """

    def __init__(self, robot: CableRobot) -> None:
        self.robot = robot
        force = np.zeros(3)
        force[: 2 if robot.planar else 3] = robot.load[: 2 if robot.planar else 3]
        self.force: Array = force
        self.reference = float(np.linalg.norm(robot.mass * robot.gravity + force))
        if not self.reference > 1e-9 * max(robot.weight, float(np.linalg.norm(force)), 1e-300):
            raise DefinitionError(
                f"nothing pulls the platform of {robot.name!r} into its cables: weight and load add up to "
                f"{self.reference:.3g} N; state gravity or a load"
            )
        if not robot.planar and np.any(robot.load[3:]):
            raise DefinitionError(
                f"load of {robot.name!r} has the moment {robot.load[3:].tolist()} N m; a moment that is constant in "
                "space has no potential energy: state it by forces, or solve the closure `Equilibrium`"
            )

    @cached_property
    def evaluate(self) -> CompiledFunction:
        """Map (p, R row by row, t) to the scaled energy, its slope, the scaled lengths, their slopes, the curvature.

        Energy is scaled by the force of reference times L, lengths by L, tensions by the force of reference. The
        curvature is that of `V + t . l`, shape (dof, dof).
        """
        z, (p, R, t), V, lengths = self._expressions
        lagrangian = V + ca.dot(t, lengths)
        outputs = [V, ca.jacobian(V, z), lengths, ca.jacobian(lengths, z), ca.hessian(lagrangian, z)[0]]
        at_rest = [ca.densify(e) for e in ca.substitute(outputs, [z], [ca.DM.zeros(z.numel())])]
        function = ca.Function("paraopt_cable_energy", [p, R, t], at_rest, {"cse": True})
        # a few calls for each run of IPOPT: to compile C for every robot would cost more than it saves
        return CompiledFunction(function, "virtual machine")

    @cached_property
    def program(self) -> ca.Function:
        """Build the program: the least energy over z with no cable longer than paid out; parameters p, R."""
        z, (p, R, _), V, lengths = self._expressions
        parameters = ca.vertcat(p, R)
        return build_program("paraopt_hanging", {"x": z, "p": parameters, "f": V, "g": lengths}, 400, 1e-9)

    @cached_property
    def _expressions(self) -> tuple[ca.SX, tuple[ca.SX, ca.SX, ca.SX], ca.SX, ca.SX]:
        robot, L = self.robot, self.robot.length_scale
        z, p0, R0 = ca.SX.sym("z", robot.dof), ca.SX.sym("p", 3), ca.SX.sym("R", 9)
        t = ca.SX.sym("t", robot.n_cables)
        if robot.planar:
            shift, turned = ca.vertcat(z[:2], 0), ca.SX.eye(3)
            turned[0, 0], turned[0, 1], turned[1, 0], turned[1, 1] = (
                ca.cos(z[2]),
                -ca.sin(z[2]),
                ca.sin(z[2]),
                ca.cos(z[2]),
            )
        else:
            shift, turned = z[:3], _cayley(z[3:])
        p, R = p0 + L * shift, turned @ ca.reshape(R0, 3, 3).T
        weight = robot.mass * robot.gravity
        V = -ca.dot(ca.DM(weight), p + R @ ca.DM(robot.centre)) - ca.dot(ca.DM(self.force), p)
        if robot.planar:
            V -= float(robot.load[2]) * z[2]
        ends = zip(
            robot.exits_in_space(), robot.attachments_in_space(), robot.pulleys or [None] * robot.n_cables, strict=True
        )
        lengths = []
        for exit_, point, pulley in ends:
            span = p + R @ ca.DM(point) - ca.DM(exit_)
            lengths.append(ca.norm_2(span) if pulley is None else lay_over_pulley(span, exit_, pulley)[0])
        return z, (p0, R0, t), V / (self.reference * L), ca.vertcat(*lengths) / L

    def at(self, place: Place, tensions: Array) -> tuple[float, Array, Array, Array, Array]:
        """Evaluate at a place with scaled tensions; see `evaluate`."""
        V, slope, lengths, J, H = self.evaluate(place.p, place.R.ravel(), tensions)
        n, dof = self.robot.n_cables, self.robot.dof
        return float(np.ravel(V)[0]), slope.reshape(dof), lengths.reshape(n), J.reshape(n, dof), H.reshape(dof, dof)


@lru_cache(maxsize=32)
def energy_of(robot: CableRobot) -> Energy:
    """Give the energy of a cable robot, compiled once."""
    return Energy(robot)


def _cayley(rho: ca.SX) -> ca.SX:
    """Build the rotation whose first order is the vector rho; it reaches all turns below half a one."""
    S = ca.skew(rho)
    return ca.SX.eye(3) + (S + 0.5 * S @ S) * (4.0 / (4.0 + ca.sumsqr(rho)))
