"""The inverse model of the tripod in closed form, written once in CasADi, with its exact derivatives."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.kinematics import CompiledFunction
from paraopt.modes.legged.tripod.frames import rotation_zyx
from paraopt.modes.legged.tripod.geometry import LEGS, POSE, TripodGeometry, foot_names, leg_names, lock_names

Array = NDArray[np.float64]


def build_chain(geometry: TripodGeometry, leg: int, pose: ca.SX, foot: ca.SX) -> ca.SX:
    """Build q1 ... q6, the lengths of both actuators and the angles of their pivots, in closed form.

    With u = unit(P_L -> P_R), lc = unit(A -> P_C), v3 = unit(u x lc), and w' the direction of w_a normal to v3:

        q6 = pi/2 - angle(lc normal to u, v_c, u)    q5 = pi/2 - angle(u, lc, v3)    q4 = |P_C - A|
        q3 = angle(lc, w', v3)    q2 = angle(w', w_a, w' x v3)    q1 = angle(u_a, v3 normal to w_a, w_a)
        q_L, q_R = sqrt(q4^2 + d^2 -+ 2 q4 d sin q5)

    where v_c runs from the *platform's* origin to P_C, and the normal of q2 is w' x v3: printed are the world's origin,
    which makes q6 depend on where the world is, and u.

    Args:
        geometry: Dimensions.
        leg: Number of the leg.
        pose: x, y, z, alpha, beta, gamma of the platform [m, rad], shape (6,).
        foot: Those of the leg's foot, shape (6,).

    Returns:
        The values in the order of `leg_names` [m or rad], shape (10,).

    Source: Tripod, 1-8.
    """
    R, turn = rotation_zyx(pose[3], pose[4], pose[5]), geometry.azimuth(leg)
    out, across = ca.DM([np.cos(turn), np.sin(turn), 0]), ca.DM([-np.sin(turn), np.cos(turn), 0])
    v_c = R @ out
    u = R @ across
    centre = pose[:3] + geometry.centre_radius * v_c
    d = geometry.half_width
    R_a, A = rotation_zyx(foot[3], foot[4], foot[5]), foot[:3]
    u_a, w_a = R_a[:, 0], R_a[:, 2]
    way = centre - A
    q4 = ca.norm_2(way)
    lc = way / q4
    v3 = _unit(ca.cross(u, lc))
    w = _normal_part(w_a, v3)
    q5 = ca.pi / 2 - _angle(u, lc, v3)
    rise = 2 * q4 * d * ca.sin(q5)
    jacks = [ca.sqrt(q4**2 + d**2 + sign * rise) for sign in (-1, 1)]
    pivots = [_angle(way + sign * d * u, w, v3) for sign in (-1, 1)]
    return ca.vertcat(
        _angle(u_a, _normal_part(v3, w_a), w_a),
        _angle(w, w_a, ca.cross(w, v3)),
        _angle(lc, w, v3),
        q4,
        q5,
        ca.pi / 2 - _angle(_normal_part(lc, u), v_c, u),
        *jacks,
        *pivots,
    )


def _unit(v: ca.SX) -> ca.SX:
    return v / ca.norm_2(v)


def _angle(a: ca.SX, b: ca.SX, normal: ca.SX) -> ca.SX:
    """Give the signed angle from a to b about the unit normal of their plane (Tripod, 1)."""
    return ca.atan2(ca.dot(normal, ca.cross(a, b)), ca.dot(a, b))


def _normal_part(a: ca.SX, normal: ca.SX) -> ca.SX:
    """Give the direction of a in the plane of a unit normal (Tripod, 2)."""
    return _unit(a - ca.dot(a, normal) * normal)


class LockState(NamedTuple):
    """Hold locked joints and what moves them, at n places.

    Attributes:
        b: Values of the locked joints [rad], shape (n, 6).
        B: Derivatives with respect to the platform, in radians per characteristic length or radian, shape (n, 6, 6).
        by_feet: Derivatives with respect to the frames of the feet, unscaled, shape (n, 6, 18).
    """

    b: Array
    B: Array
    by_feet: Array


class TripodModel:
    """Evaluate the closed forms in batches.

    Args:
        geometry: Dimensions.
    """

    def __init__(self, geometry: TripodGeometry) -> None:
        self.geometry = geometry
        self.names = tuple(n for i in LEGS for n in leg_names(i))
        pose, feet = ca.SX.sym("pose", 6), ca.SX.sym("feet", 18)
        self._symbols = pose, feet
        self._values = ca.vertcat(*[build_chain(geometry, i, pose, feet[6 * i - 6 : 6 * i]) for i in LEGS])
        self.scale = np.array([geometry.radius] * 3 + [1.0] * 3)
        """Unit in which each coordinate of the platform is judged: r_p [m] or 1 rad."""

    @cached_property
    def _inverse(self) -> tuple[CompiledFunction, CompiledFunction]:
        pose, feet = self._symbols
        slopes = [ca.jacobian(self._values, pose), ca.jacobian(self._values, feet)]
        plain, steep = CompiledFunction.together(
            [
                ca.Function("tripod_inverse", [pose, feet], [self._values], {"cse": True}),
                ca.Function("tripod_slopes", [pose, feet], [self._values, *slopes], {"cse": True}),
            ]
        )
        return plain, steep

    @cached_property
    def _locks(self) -> tuple[tuple[CompiledFunction, CompiledFunction], ...]:
        pose, feet = self._symbols
        u, v = ca.SX.sym("u", 6), ca.SX.sym("v", 6)
        made = []
        for i in LEGS:
            b = self._values[[self.names.index(n) for n in lock_names(i)]]
            B = ca.jacobian(b, pose) @ ca.diag(ca.DM(self.scale))
            product = ca.dot(u, B @ v)
            made += [
                ca.Function(f"tripod_lock_{i}", [pose, feet], [b, B, ca.jacobian(b, feet)], {"cse": True}),
                ca.Function(
                    f"tripod_lock_slope_{i}",
                    [pose, feet, u, v],
                    [ca.gradient(product, pose), ca.gradient(product, feet)],
                    {"cse": True},
                ),
            ]
        built = CompiledFunction.together(made)
        return tuple((built[2 * k], built[2 * k + 1]) for k in range(3))

    def inverse(self, poses: ArrayLike, feet: ArrayLike) -> Array:
        """Solve for the equivalent chains, the actuators and their pivots.

        Args:
            poses: Poses of the platform [m, rad], shape (n, 6).
            feet: Frames of the feet [m, rad], shape (n, 3, 6), or (3, 6) for all.

        Returns:
            Values in the order of `names` [m or rad], shape (n, 30).
        """
        return self._inverse[0].batch(*_read(poses, feet))[0]

    def slopes(self, poses: ArrayLike, feet: ArrayLike) -> tuple[Array, Array, Array]:
        """Give the inverse model with its derivatives.

        Returns:
            Values, shape (n, 30); derivatives with respect to the platform, (n, 30, 6), and to the feet, (n, 30, 18).
        """
        return self._inverse[1].batch(*_read(poses, feet))  # type: ignore[return-value]

    def locks(self, leg: int, poses: ArrayLike, feet: ArrayLike) -> LockState:
        """Give the joints that are locked while a leg is in the air, and the matrix that they hold the platform by."""
        return LockState(*self._locks[leg - 1][0].batch(*_read(poses, feet)))

    def lock_slopes(self, leg: int, poses: ArrayLike, feet: ArrayLike, u: Array, v: Array) -> tuple[Array, Array]:
        """Give the derivatives of `u^T B v`: of a singular value of B, where u and v are its vectors.

        Args:
            leg: The leg in the air.
            poses: Shape (n, 6).
            feet: Shape (n, 3, 6) or (3, 6).
            u: Left vectors, shape (n, 6).
            v: Right vectors, shape (n, 6).

        Returns:
            Derivatives with respect to the platform, shape (n, 6), and to the feet, shape (n, 18), unscaled.
        """
        return self._locks[leg - 1][1].batch(*_read(poses, feet), u, v)  # type: ignore[return-value]

    def configurations(self, names: tuple[str, ...], poses: ArrayLike, feet: ArrayLike) -> Array:
        """Give whole configurations of the robot in closed form.

        Args:
            names: Variables of the robot in their order: those of the legs, of the platform, and of free feet if any.
            poses: Poses of the platform, shape (n, 6).
            feet: Frames of the feet, shape (n, 3, 6) or (3, 6).

        Returns:
            Values of all variables [m or rad], shape (n, n_variables).
        """
        poses, feet = _read(poses, feet)
        n = max(len(poses), len(feet))
        table = np.hstack([self.inverse(poses, feet), *(np.broadcast_to(a, (n, a.shape[1])) for a in (poses, feet))])
        return table[:, self.places(names)]

    def places(self, names: tuple[str, ...]) -> NDArray[np.intp]:
        """Give the place of each variable of the robot among chains (30), platform (6) and feet (18)."""
        return _places(self.names, names)


@lru_cache(maxsize=16)
def _places(chain: tuple[str, ...], names: tuple[str, ...]) -> NDArray[np.intp]:
    known = [*chain, *POSE, *(n for i in LEGS for n in foot_names(i))]
    return np.array([known.index(n) for n in names])


@lru_cache(maxsize=8)
def tripod_model(geometry: TripodGeometry) -> TripodModel:
    """Give the closed forms for a geometry; made once."""
    return TripodModel(geometry)


def _read(poses: ArrayLike, feet: ArrayLike) -> tuple[Array, Array]:
    poses = np.atleast_2d(np.asarray(poses, dtype=float))
    feet = np.asarray(feet, dtype=float).reshape(-1, 18)
    return poses, feet
