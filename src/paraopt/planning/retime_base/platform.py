"""The tool point and its link along a path: linear and angular velocity and acceleration, and bounds on their norms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.codegen import CompiledFunction
from paraopt.planning.path import PathPoints
from paraopt.planning.retime_base.rows import PathRows
from paraopt.robot import Robot

Array = NDArray[np.float64]
KINDS = ("linear", "angular")
FACES = 16  # over a half circle: the polygon within it is at most 0.5 % narrower


@dataclass(frozen=True, eq=False)
class PlatformMotion:
    """Hold how the platform moves along a path.

    Attributes:
        first: Linear velocity of the tool point [m] and angular velocity of its link [rad] for a unit speed of the
            parameter, shape (n, 2, 3).
        second: Accelerations for a unit speed of the parameter that does not change, same shape.
        velocity: Bounds on the norms of the velocities [m/s, rad/s], inf where there is none, shape (2,).
        acceleration: Bounds on the norms of the accelerations, shape (2,).
    """

    first: Array
    second: Array
    velocity: Array
    acceleration: Array

    @classmethod
    def along(cls, robot: Robot, points: PathPoints, bounds: Array) -> PlatformMotion:
        """Evaluate the motion from exact derivatives of the path.

        Args:
            robot: The machine.
            points: Points of the path.
            bounds: Bounds in the order of `PLATFORM_LIMITS`.
        """
        values = _tool_function(robot).batch(points.X, points.dX, points.ddX)
        first, second = (np.stack([values[k], values[k + 1]], axis=1) for k in (0, 2))
        return cls(first, second, bounds[:2], bounds[2:])

    def shares(self, speed: Array, acceleration: Array) -> tuple[Array, Array]:
        """Give norms over bounds for speeds and accelerations of the parameter of shape (n,); two of shape (n, 2)."""
        v, a = speed[:, None, None], acceleration[:, None, None]
        return (
            np.linalg.norm(self.first * v, axis=2) / self.velocity,
            np.linalg.norm(self.first * a + self.second * v**2, axis=2) / self.acceleration,
        )

    def rows(self) -> PathRows:
        """Give sound bounds that are linear in the acceleration and the squared speed of the parameter.

        `|p'|^2 s'^2 <= v^2` is the bound on the speed as it is. The acceleration `p' s'' + p'' s'^2` lies in the plane
        of p' and p'', on that side of p' on which p'' lies: the half disc of its bound is replaced by a polygon in it,
        whose corners are on the circle. Where the path is straight nothing is lost, elsewhere up to 0.5 %.
        """
        n = len(self.first)
        parts = [PathRows.none(n)]
        corners = np.pi / FACES
        turns = (np.arange(FACES) + 0.5) * corners  # normals of the faces
        for k, kind in enumerate(KINDS):
            p, q = self.first[:, k], self.second[:, k]
            size = np.linalg.norm(p, axis=1)
            if np.isfinite(self.velocity[k]):
                b = (size / self.velocity[k])[:, None] ** 2
                parts.append(
                    PathRows((f"{kind} velocity of the platform",), np.zeros((n, 1)), b, np.full((n, 1), -1.0))
                )
            if np.isfinite(self.acceleration[k]):
                along = np.einsum("ni,ni->n", p, q) / np.where(size > 0.0, size, 1.0)
                across = np.linalg.norm(q - p * (along / np.where(size > 0.0, size, 1.0))[:, None], axis=1)
                reach = self.acceleration[k] * np.cos(0.5 * corners)
                a = np.outer(size, np.cos(turns)) / reach
                b = (np.outer(along, np.cos(turns)) + np.outer(across, np.sin(turns))) / reach
                names = (f"{kind} acceleration of the platform",) * FACES
                parts.append(PathRows(names, a, b, np.full((n, FACES), -1.0)))
        return PathRows.join(parts)


@lru_cache(maxsize=32)
def _tool_function(robot: Robot) -> CompiledFunction:
    """Map X and its two derivatives to the velocity and angular velocity, and the acceleration and angular one."""
    graph, mechanism = robot.kinematics.graph, robot.mechanism
    carrier = next(v.link for v in mechanism.variables if v.role == "operational")
    link, point = robot.tool or (carrier, (0.0, 0.0, 0.0))
    pose = graph.X_W[link]
    at, turned = pose[:3, :3] @ ca.DM(np.asarray(point, dtype=float)) + pose[:3, 3], pose[:3, :3]
    n = graph.X.numel()
    V, A = ca.SX.sym("V", n), ca.SX.sym("A", n)

    def rate(value: ca.SX, velocity: ca.SX) -> ca.SX:
        return ca.reshape(ca.jtimes(ca.vec(value), graph.X, velocity), value.shape)

    def axial(matrix: ca.SX) -> ca.SX:
        """Give the axial vector of the skew part."""
        return 0.5 * ca.vertcat(matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1])

    # the symmetric part of R'' R^T is R' R'^T, which turns nothing
    second = [rate(rate(value, V), V) + rate(value, A) for value in (at, turned)]
    outputs = [rate(at, V), axial(rate(turned, V) @ turned.T), second[0], axial(second[1] @ turned.T)]
    function = ca.Function("paraopt_tool_motion", [graph.X, V, A], [ca.densify(o) for o in outputs], {"cse": True})
    return CompiledFunction(function, robot.kinematics.functions.backend)
