"""Exact functions of the pose: paid-out lengths, wrench matrix, wrenches of weight, load and inertia.

With `p` the platform's origin and `R` its rotation, cable i with tension t_i pulls its attachment `p + R b_i` along the
unit vector `u_i` towards where it leaves the exit or the pulley. Equilibrium of the platform about its origin reads

    W t + w = 0,    W = [u_i; (R b_i) x u_i],    w = [m g; (R c) x m g] + load

and in motion w loses the wrench of inertia `[m a_c; (R c) x m a_c + I alpha + omega x I omega]`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import SolveError
from paraopt.kinematics import CompiledFunction
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.winch import Pulley
from paraopt.spatial import rotation_about

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CableFunctions:
    """Evaluate a cable robot at many poses at once, by compiled functions.

    Poses are arrays (k, dof) in the order of `CableRobot.coordinates`; one pose of shape (dof,) counts as k = 1. In the
    plane wrenches are (fx, fy, mz). Ask for it by `cable_functions`, which keeps what was compiled.

    Attributes:
        robot: The cable robot.
    """

    robot: CableRobot

    def lengths(self, poses: ArrayLike) -> Array:
        """Give the lengths of cable beyond the exits, the arcs on the pulleys included [m], shape (k, n)."""
        return self._geometry(poses)[0]

    def length_rates(self, poses: ArrayLike) -> Array:
        """Give the derivatives of the lengths with respect to the pose, shape (k, n, dof)."""
        return self._geometry(poses)[1]

    def length_motion(self, poses: ArrayLike, first: ArrayLike, second: ArrayLike) -> tuple[Array, Array]:
        """Give the first and second derivatives of the lengths along motions of the pose, each of shape (k, n).

        Args:
            poses: Poses, shape (k, dof).
            first: Their first derivatives, same shape.
            second: Their second derivatives, same shape.
        """
        check = self.robot.check_poses
        rate, change = self._length_motion.batch(check(poses), check(first), check(second))
        return rate, change

    def leaving_points(self, poses: ArrayLike) -> Array:
        """Give the points at which the free parts of the cables begin, on pulleys or at exits [m], shape (k, n, 3)."""
        return self._geometry(poses)[2].reshape(-1, self.robot.n_cables, 3)

    def attachment_points(self, poses: ArrayLike) -> Array:
        """Give the attachments in the world [m], shape (k, n, 3)."""
        return self._geometry(poses)[3].reshape(-1, self.robot.n_cables, 3)

    def winch_angles(self, poses: ArrayLike) -> Array:
        """Give the angles of the winches [rad], shape (k, n).

        Raises:
            SolveError: The robot has no drums.
        """
        drums = self.robot.drums
        if drums is None:
            raise SolveError(f"{self.robot.name!r} has no drums; state them to turn lengths into angles")
        lengths = self.lengths(poses)
        return np.stack([drum.angles(lengths[:, i]) for i, drum in enumerate(drums)], axis=1)

    def wrench_matrix(self, poses: ArrayLike) -> Array:
        """Give W [1, m], shape (k, dof, n)."""
        return self._wrench.batch(self.robot.check_poses(poses))[0]

    def wrench(self, poses: ArrayLike) -> Array:
        """Give w at rest: weight and load about the platform's origin [N, N m], shape (k, dof)."""
        return self._wrench.batch(self.robot.check_poses(poses))[1]

    def both(self, poses: ArrayLike) -> tuple[Array, Array]:
        """Give W and w together, shapes (k, dof, n) and (k, dof)."""
        W, w = self._wrench.batch(self.robot.check_poses(poses))
        self._check(W)
        return W, w

    def derivatives(self, poses: ArrayLike) -> tuple[Array, Array]:
        """Give the derivatives of W and w with respect to the pose, shapes (k, dof, n, dof) and (k, dof, dof)."""
        dW, dw = self._derivatives.batch(self.robot.check_poses(poses))
        return dW.reshape(len(dW), self.robot.dof, self.robot.n_cables, self.robot.dof), dw

    def twists(self, poses: ArrayLike) -> Array:
        """Give the twists of the platform for unit rates of the coordinates, in the order of wrenches.

        Velocity of its origin and angular velocity in axes of the world, shape (k, dof, dof).
        """
        return self._twists.batch(self.robot.check_poses(poses))[0]

    def inertia_wrench(self, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> Array:
        """Give the wrench that the platform's inertia needs in a motion, about its origin [N, N m], shape (k, dof).

        Args:
            poses: Poses, shape (k, dof).
            velocities: Derivatives of the coordinates with respect to time, same shape.
            accelerations: Second derivatives, same shape.
        """
        check = self.robot.check_poses
        return self._inertia.batch(check(poses), check(velocities), check(accelerations))[0]

    def dynamic_wrench(self, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> Array:
        """Give what the cables must balance in a motion: weight and load less inertia, shape (k, dof)."""
        return np.asarray(self.wrench(poses) - self.inertia_wrench(poses, velocities, accelerations))

    # --- Expressions

    @cached_property
    def _pose(self) -> ca.SX:
        return ca.SX.sym("pose", self.robot.dof)

    @cached_property
    def _frame(self) -> tuple[ca.SX, ca.SX]:
        """Give origin and rotation of the platform."""
        named = dict(zip(self.robot.coordinates, ca.vertsplit(self._pose), strict=True))
        turns = {m.name: m.axis for m in self.robot.platform.motions if m.kind == "angle"}
        if self.robot.planar:
            turns = {"theta": "z"}
        R = ca.SX.eye(3)
        for coordinate, axis in turns.items():
            R = R @ rotation_about(axis, named[coordinate])
        return ca.vertcat(named["x"], named["y"], named.get("z", ca.SX(0))), R

    @cached_property
    def _cables(self) -> list[tuple[ca.SX, ca.SX, ca.SX, ca.SX]]:
        """Give for each cable the length, the unit pull, the leaving point and the arm of the force."""
        p, R = self._frame
        pulleys: Sequence[Pulley | None] = self.robot.pulleys or (None,) * self.robot.n_cables
        made = []
        ends = zip(self.robot.exits_in_space(), self.robot.attachments_in_space(), pulleys, strict=True)
        for exit_, point, pulley in ends:
            arm = R @ ca.DM(point)
            span = p + arm - ca.DM(exit_)
            if pulley is None:
                length = ca.norm_2(span)
                made.append((length, -span / length, ca.SX(ca.DM(exit_)), arm))
            else:
                made.append((*lay_over_pulley(span, exit_, pulley), arm))
        return made

    def _as_wrench(self, force: ca.SX, moment: ca.SX) -> ca.SX:
        return ca.vertcat(force[:2], moment[2]) if self.robot.planar else ca.vertcat(force, moment)

    @cached_property
    def _at_rest(self) -> tuple[ca.SX, ca.SX]:
        W = ca.horzcat(*[self._as_wrench(pull, ca.cross(arm, pull)) for _, pull, _, arm in self._cables])
        arm = self._frame[1] @ ca.DM(self.robot.centre)
        weight = self.robot.mass * ca.DM(self.robot.gravity)
        return W, self._as_wrench(weight, ca.cross(arm, weight)) + ca.DM(self.robot.load)

    def _compile(self, name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> CompiledFunction:
        return CompiledFunction(
            ca.Function(f"paraopt_cable_{name}", inputs, list(map(ca.densify, outputs)), {"cse": True})
        )

    @cached_property
    def _length_function(self) -> CompiledFunction:
        lengths = ca.vertcat(*[length for length, _, _, _ in self._cables])
        points = ca.vertcat(*[point for _, _, point, _ in self._cables])
        held = ca.vertcat(*[self._frame[0] + arm for _, _, _, arm in self._cables])
        return self._compile("lengths", [self._pose], [lengths, ca.jacobian(lengths, self._pose), points, held])

    @cached_property
    def _length_motion(self) -> CompiledFunction:
        V, A = ca.SX.sym("V", self.robot.dof), ca.SX.sym("A", self.robot.dof)
        lengths = ca.vertcat(*[length for length, _, _, _ in self._cables])
        rate = ca.jtimes(lengths, self._pose, V)
        change = ca.jtimes(rate, self._pose, V) + ca.jtimes(rate, V, A)
        return self._compile("length_motion", [self._pose, V, A], [rate, change])

    def _geometry(self, poses: ArrayLike) -> tuple[Array, ...]:
        values = self._length_function.batch(self.robot.check_poses(poses))
        self._check(values[0])
        return values

    @cached_property
    def _wrench(self) -> CompiledFunction:
        return self._compile("wrench", [self._pose], list(self._at_rest))

    @cached_property
    def _derivatives(self) -> CompiledFunction:
        W, w = self._at_rest
        return self._compile(
            "wrench_rates", [self._pose], [ca.jacobian(ca.vec(W.T), self._pose), ca.jacobian(w, self._pose)]
        )

    @cached_property
    def _twists(self) -> CompiledFunction:
        p, R = self._frame
        columns = []
        for coordinate in ca.vertsplit(self._pose):
            turning = ca.reshape(ca.jacobian(ca.vec(R), coordinate), 3, 3) @ R.T
            omega = ca.vertcat(turning[2, 1], turning[0, 2], turning[1, 0])
            columns.append(self._as_wrench(ca.jacobian(p, coordinate), omega))
        return self._compile("twists", [self._pose], [ca.horzcat(*columns)])

    @cached_property
    def _inertia(self) -> CompiledFunction:
        p, R = self._frame
        V, A = ca.SX.sym("V", self.robot.dof), ca.SX.sym("A", self.robot.dof)

        def rate(value: ca.SX) -> ca.SX:
            flat = ca.vec(value)
            moved = ca.jtimes(flat, self._pose, V) + ca.jtimes(flat, V, A)
            return ca.reshape(moved, value.shape)

        arm = R @ ca.DM(self.robot.centre)
        force = self.robot.mass * rate(rate(p + arm))
        turning = rate(R) @ R.T
        omega = ca.vertcat(turning[2, 1], turning[0, 2], turning[1, 0])
        spin = R @ ca.DM(self.robot.inertia) @ R.T @ omega
        wrench = self._as_wrench(force, ca.cross(arm, force) + rate(spin))
        return self._compile("inertia", [self._pose, V, A], [wrench])

    def _check(self, values: Array) -> None:
        bad = np.flatnonzero(~np.all(np.isfinite(values), axis=tuple(range(1, values.ndim))))
        if bad.size:
            raise SolveError(
                f"a cable of {self.robot.name!r} has no straight part at pose {int(bad[0])}: its attachment lies on "
                "its exit, inside its pulley or on the pulley's axis; move the pose",
                index=int(bad[0]),
            )


@lru_cache(maxsize=32)
def cable_functions(robot: CableRobot) -> CableFunctions:
    """Give the functions of a cable robot, compiled once."""
    return CableFunctions(robot)


def lay_over_pulley(span: ca.SX, exit_: Array, pulley: Pulley) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Lay a cable over a pulley that swivels towards the attachment.

    In the wheel's plane (radial, axial) the cable comes in at (0, 0) along the axis, the centre is (r, 0), and after an
    angle b on the wheel the cable leaves along (sin b, cos b). The swivel leaves the length stationary, so that the
    length's derivative along a motion of the attachment is that of the free part alone.

    Args:
        span: From the exit to the attachment [m], shape (3,).
        exit_: The exit [m].
        pulley: The pulley.

    Returns:
        The length on the wheel and beyond [m], the unit pull on the attachment, and the point where the wheel is left.
        An attachment inside the wheel gives NaN, which is refused after the evaluation.

    Source: Pott2012.
    """
    axis, r = ca.DM(pulley.axis), pulley.radius
    height = ca.dot(span, axis)
    beside = span - height * axis
    radial = ca.norm_2(beside)
    outward = beside / radial
    x = radial - r
    free = ca.sqrt(x**2 + height**2 - r**2)
    angle = ca.atan2(free * x + r * height, free * height - r * x)
    angle = ca.if_else(angle < 0, angle + 2 * ca.pi, angle)
    along = ca.sin(angle) * outward + ca.cos(angle) * axis
    leaving = ca.DM(exit_) + r * outward + r * (-ca.cos(angle) * outward + ca.sin(angle) * axis)
    return r * angle + free, -along, leaving
