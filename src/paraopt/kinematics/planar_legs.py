"""Planar platforms: with its drive held, a leg is a circle, a line or an angle; three legs make one sextic.

Points of the plane are complex numbers. Let p be the platform's origin and u = e^{i theta} its rotation. A leg whose
two free joints, counted from the base, are

* RR keeps a point of the platform on a circle: `|p + u b - c|^2 = l^2`;
* PR keeps a point of the platform on a fixed line: `Im(conj(d) (p + u b - c)) = 0`;
* RP keeps a line of the platform on a fixed point: `Im(conj(u d) (c - p - u b)) = 0`;
* PP keeps the rotation: `u = u0`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.model import Kinematics
from paraopt.mechanism import Base, Coincidence, Mechanism, Mobile, Series, Weld

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Kind = Literal["RR", "PR", "RP", "PP"]


@dataclass(frozen=True)
class PlanarLeg:
    """Hold what one leg imposes on the platform.

    Attributes:
        kind: Free joints from the base to the platform, "R" or "P" each.
        c: Fixed point of the base [m].
        b: Fixed point of the platform, in its frame [m].
        d: Direction of the slide, in the base for PR, in the platform for RP; `u0` for PP.
        length: Distance l of RR [m].
    """

    kind: Kind
    c: complex
    b: complex
    d: complex
    length: float


@dataclass(frozen=True, eq=False)
class PlanarProblem:
    """Hold the legs of a platform in the plane.

    Attributes:
        legs: What each leg imposes.
        turns: Whether the platform can turn; its rotation is 1 where it cannot.
        unit: Length in which residuals are judged [m].
        platform: The free link.
    """

    legs: tuple[PlanarLeg, ...]
    turns: bool
    unit: float
    platform: Mobile

    def residual(self, poses: Array) -> tuple[Array, Array]:
        """Evaluate the conditions of all legs and their derivatives.

        Args:
            poses: x [m], y [m], theta [rad], shape (n, 3).

        Returns:
            Residuals in units of length, shape (n, n_legs), and their Jacobian with lengths in these units, shape
            (n, n_legs, 3).
        """
        p, u = (poses[:, 0] + 1j * poses[:, 1]) / self.unit, np.exp(1j * poses[:, 2])
        F, J = [], []
        for leg in self.legs:
            b, c, d = leg.b / self.unit, leg.c / self.unit, leg.d
            gap = p + u * b - c
            turned = 1j * u * b
            if leg.kind == "RR":
                far = np.maximum(np.abs(gap), 1e-12)
                # distances keep the derivative of order one also far away
                F.append(far - leg.length / self.unit)
                J.append([gap.real / far, gap.imag / far, (np.conj(gap) * turned).real / far])
            elif leg.kind == "PR":
                n = np.full(len(p), np.conj(d))
                F.append((n * gap).imag)
                J.append([n.imag, n.real, (n * turned).imag])
            elif leg.kind == "RP":
                n = np.conj(u * d)
                F.append((n * gap).imag)
                J.append([n.imag, n.real, (n * turned - 1j * n * gap).imag])
            else:
                F.append((np.conj(d) * u).imag)
                zero = np.zeros(len(p))
                J.append([zero, zero, (np.conj(d) * u).real])
        return np.stack(F, axis=1), np.stack([np.stack(row, axis=1) for row in J], axis=1)


@dataclass(frozen=True, eq=False)
class PlanarPoses:
    """Hold the poses of a platform on its legs.

    Attributes:
        poses: x [m], y [m], theta [rad], shape (n, 3).
        degree: Number of complex solutions, multiple ones counted so: the degree of the polynomial in e^{i theta}, or
            of what two circles or lines have in common where the rotation is held.
        is_continuous: Whether the platform can move with its drives held, from some solution or everywhere.
    """

    poses: Array
    degree: int
    is_continuous: bool


# --- From the mechanism to the legs


def read_planar_legs(kinematics: Kinematics, X: Array) -> PlanarProblem | None:
    """Read what the legs impose on a platform, the drives having their values.

    Args:
        kinematics: The mechanism's functions.
        X: Values of all variables, of which those of the drives are used; shape (n_variables,).

    Returns:
        The problem; None where the mechanism is no planar platform with three such legs, or two for a point.
    """
    mechanism = kinematics.mechanism
    mobiles = [link for link in mechanism.links if isinstance(link, Mobile)]
    if not mechanism.planar or len(mobiles) != 1 or kinematics.idle:
        return None
    platform = mobiles[0]
    coordinates = {m.name for m in platform.motions}
    turns = any(m.kind == "angle" for m in platform.motions)
    if coordinates != set(mechanism.operational) or len(coordinates) != 2 + turns:
        return None
    if len({m.axis for m in platform.motions if m.kind == "length"}) != 2:
        return None
    legs = kinematics.legs
    if len(legs) != 2 + turns or len(mechanism.constraints) != len(legs):
        return None
    found = [_read_leg(mechanism, constraint, platform, X) for constraint in mechanism.constraints]
    if any(leg is None for leg in found):
        return None
    return PlanarProblem(tuple(leg for leg in found if leg is not None), turns, mechanism.length, platform)


@dataclass(frozen=True)
class _Free:
    """One free joint at zero: where it is, along what it slides (None for a hinge)."""

    at: complex
    along: complex | None


def _read_leg(mechanism: Mechanism, constraint: object, platform: Mobile, X: Array) -> PlanarLeg | None:
    if not isinstance(constraint, (Coincidence, Weld)):
        return None
    ends = {}
    for link, point in zip((constraint.link_A, constraint.link_B), _ends(constraint), strict=True):
        root, chain = _chain(mechanism, link)
        walked = _walk(mechanism, chain, X, start=root if isinstance(root, Base) else None)
        ends[root.name] = (*walked, point)
    if set(ends) != {mechanism.base.name, platform.name}:
        return None
    # pose of the platform when all free joints are at zero
    (z_A, r_A, low, (at_A, turn_A)), (z_B, r_B, high, (at_B, turn_B)) = ends[mechanism.base.name], ends[platform.name]
    tip, held = z_A + r_A * at_A, z_B + r_B * at_B
    if isinstance(constraint, Weld):
        u0 = (r_A * turn_A) / (r_B * turn_B)
        joints = list(low)
    else:
        u0 = 1.0 + 0.0j
        joints = [*low, _Free(tip, None)]
    p0 = tip - u0 * held
    joints += [_Free(p0 + u0 * j.at, None if j.along is None else u0 * j.along) for j in reversed(high)]
    if len(joints) != 2:
        return None
    first, second = joints
    if first.along is None and second.along is None:
        return PlanarLeg("RR", first.at, (second.at - p0) / u0, 1.0, abs(second.at - first.at))
    if first.along is not None and second.along is None:
        return PlanarLeg("PR", second.at, (second.at - p0) / u0, first.along, 0.0)
    if second.along is not None and first.along is None:
        return PlanarLeg("RP", first.at, (first.at - p0) / u0, second.along / u0, 0.0)
    return PlanarLeg("PP", 0.0, 0.0, u0, 0.0)


def _ends(constraint: Coincidence | Weld) -> tuple[tuple[complex, complex], tuple[complex, complex]]:
    """Give point and rotation of both ends in the frames of their links."""
    if isinstance(constraint, Coincidence):
        a, b = constraint.point_A, constraint.point_B
        return (complex(a[0], a[1]), 1.0 + 0j), (complex(b[0], b[1]), 1.0 + 0j)
    at = complex(constraint.at[0], constraint.at[1])
    return (at, complex(np.exp(1j * constraint.rotation[2]))), (0j, 1.0 + 0j)


def _chain(mechanism: Mechanism, link_name: str) -> tuple[Base | Mobile, list[Series]]:
    """Give the root of a link, base or platform, and the links from there."""
    chain: list[Series] = []
    link = mechanism.link(link_name)
    while isinstance(link, Series):
        chain.insert(0, link)
        link = mechanism.link(link.father)
    return link, chain  # type: ignore[return-value]


def _walk(
    mechanism: Mechanism, chain: Sequence[Series], X: Array, start: Base | None
) -> tuple[complex, complex, list[_Free]]:
    """Follow a chain with its drives at their values and its free joints at zero."""
    z, r = 0j, 1.0 + 0j
    if start is not None:
        z, r = complex(start.at[0], start.at[1]), complex(np.exp(1j * start.rotation[2]))
    free: list[_Free] = []
    for link in chain:
        z += r * complex(link.at[0], link.at[1])
        r *= complex(np.exp(1j * link.rotation[2]))
        for motion in link.motions:
            held = motion.name in mechanism.active
            value = float(X[mechanism.index(motion.name)]) if held else 0.0
            along = {"x": r, "y": 1j * r, "z": None}[motion.axis]
            if not held:
                free.append(_Free(z, along))
            elif along is None:
                r *= complex(np.exp(1j * value))
            else:
                z += along * value
    return z, r, free


# --- From the legs to the poses


def solve_planar(problem: PlanarProblem, tolerance: float = 1e-10) -> PlanarPoses:
    """Find all poses of the platform.

    x and y are eliminated: with the origins moved to the centre of a circle and to its point on the platform, if there
    is a circle, the two other conditions are linear in p, with coefficients of degree 1 in u and 1/u. Their solution,
    inserted in the last condition and multiplied by the square of their determinant, is a trigonometric polynomial
    of degree 3 at most, hence 6 roots u. Its coefficients are exact from samples, by Fourier's transform, the roots
    are the eigenvalues of the companion matrix; those near the unit circle are candidates, polished by Newton on the
    conditions themselves.

    Args:
        problem: The legs.
        tolerance: Bound on the residual of a pose, in units of length [1].

    Returns:
        The poses.

    Source: Chablat1998, 1.5.2 (number of solutions by the characteristic polynomial).
    """
    held = [leg for leg in problem.legs if leg.kind == "PP"]
    if held or not problem.turns:
        angles, vanishes = np.array([np.angle(held[0].d) if held else 0.0]), False
        degree = 2 if any(leg.kind == "RR" for leg in problem.legs) else 1
    else:
        angles, degree, vanishes = _candidate_angles(problem)
    candidates = np.array([pose for theta in angles for pose in _candidate_poses(problem, theta)]).reshape(-1, 3)
    poses, residual, rank = _polish(problem, candidates)
    good = residual <= tolerance
    if held:  # the sine that is judged does not tell half a turn
        good &= np.cos(poses[:, 2] - np.angle(held[0].d)) > 0
    poses, rank = _distinct(problem, poses[good], rank[good])
    unknowns = 2 + problem.turns
    moving = [k for k in np.flatnonzero(rank < unknowns) if _is_moving(problem, poses[k], tolerance)]
    return PlanarPoses(poses, degree, vanishes or bool(moving))


def _linear_form(leg: PlanarLeg, first: PlanarLeg, u: Complex) -> tuple[Complex, Complex]:
    """Write a leg's condition as `Re(conj(A) p) = B` in the frame of the first leg, A and B for each u.

    The condition of a circle is its difference from the circle of the first leg.
    """
    b, c = leg.b - first.b, leg.c - first.c
    if leg.kind == "RR":
        A = 2.0 * (u * b - c)
        return A, (leg.length**2 - first.length**2 - np.abs(u * b - c) ** 2).astype(complex)
    n = 1j * leg.d * (np.ones_like(u) if leg.kind == "PR" else u)
    return n, ((np.conj(n) * (c - u * b)).real).astype(complex)


def _split(problem: PlanarProblem) -> tuple[PlanarLeg, PlanarLeg, PlanarLeg]:
    """Put a circle first, if there is one."""
    legs = sorted(problem.legs, key=lambda leg: leg.kind != "RR")
    return legs[0], legs[1], legs[2]


def _candidate_angles(problem: PlanarProblem, samples: int = 16) -> tuple[Array, int, bool]:
    """Find the angles at which the conditions may hold together.

    Returns:
        The angles [rad], the degree of the polynomial in u, and whether it is zero everywhere.
    """
    first, second, third = _split(problem)
    u = np.exp(2j * np.pi * np.arange(samples) / samples)
    (A1, B1), (A2, B2) = _linear_form(second, first, u), _linear_form(third, first, u)
    D = (np.conj(A1) * A2).imag
    p_D = 1j * (A1 * B2 - A2 * B1)  # p times D
    if first.kind == "RR":
        G = np.abs(p_D) ** 2 - (first.length * D) ** 2
        size = np.max(np.abs(p_D) ** 2 + (first.length * D) ** 2)
    else:
        A0, B0 = _linear_form(first, first, u)
        G = (np.conj(A0) * p_D).real - B0.real * D
        size = np.max(np.abs(p_D) + np.abs(B0 * D))
    coefficients = np.fft.fft(G) / samples
    order = 3
    polynomial = np.concatenate([coefficients[-order:], coefficients[: order + 1]])  # u^-3 ... u^3
    if np.max(np.abs(polynomial)) <= 1e-12 * max(float(size), 1e-300):
        return np.linspace(-np.pi, np.pi, 24, endpoint=False), 0, True
    cut = 1e-12 * np.max(np.abs(polynomial))
    while len(polynomial) > 1 and abs(polynomial[-1]) <= cut:  # real: both ends vanish together
        polynomial = polynomial[1:-1]
    roots = np.roots(polynomial[::-1])
    near = np.abs(np.log(np.maximum(np.abs(roots), 1e-300))) < 0.02
    return np.angle(roots[near]), len(polynomial) - 1, False


def _candidate_poses(problem: PlanarProblem, theta: float) -> list[tuple[float, float, float]]:
    """Find the places of the platform for one rotation: common points of lines and circles, nearly common ones too."""
    u = np.exp(1j * np.array([theta]))
    legs = [leg for leg in sorted(problem.legs, key=lambda leg: leg.kind != "RR") if leg.kind != "PP"]
    if len(legs) < 2:
        return [(0.0, 0.0, theta)]
    first = legs[0]
    forms = [_linear_form(leg, first, u) for leg in legs[1:]]
    if first.kind != "RR":
        forms.append(_linear_form(first, first, u))
    A, B = np.array([f[0][0] for f in forms]), np.array([f[1][0].real for f in forms])
    rows = np.column_stack([A.real, A.imag])
    places = []
    if len(forms) > 1:
        (x, y), *_ = np.linalg.lstsq(rows, B, rcond=None)
        places.append(complex(x, y))
    if first.kind == "RR":
        # lines may coincide: any of them with the circle then says all
        for a, b in zip(A, B, strict=True):
            if abs(a) > 1e-9 * problem.unit:
                foot, half = b * a / abs(a) ** 2, first.length**2 - (b / abs(a)) ** 2
                reach = np.sqrt(max(half, 0.0)) * 1j * a / abs(a)
                places += [foot + reach, foot - reach]
        if np.all(np.abs(A) <= 1e-9 * problem.unit):
            places += [first.length * np.exp(1j * k) for k in (0.3, 2.4, 4.5)]
    shift = first.c - u[0] * first.b
    return [(float((z + shift).real), float((z + shift).imag), float(theta)) for z in places]


def _polish(problem: PlanarProblem, poses: Array, iterations: int = 40) -> tuple[Array, Array, NDArray[np.intp]]:
    """Take Newton steps on the conditions; give the poses, their residuals and the ranks of the Jacobian."""
    poses = poses.copy()
    if not len(poses):
        return poses, np.zeros(0), np.zeros(0, dtype=np.intp)
    scale = np.array([problem.unit, problem.unit, 1.0])
    unknowns = 2 + problem.turns
    best, best_residual = poses.copy(), np.full(len(poses), np.inf)
    idle = 0
    for _ in range(iterations):
        F, J = problem.residual(poses)
        size = np.max(np.abs(F), axis=1)
        better = size < best_residual
        best[better], best_residual[better] = poses[better], size[better]
        idle = 0 if np.any(better & (size > 1e-14)) else idle + 1
        if idle == 3:  # all are at round-off, or lead nowhere
            break
        step = (np.linalg.pinv(J[:, :, :unknowns], rcond=1e-9) @ F[:, :, None])[:, :, 0]
        step *= np.minimum(1.0, 0.5 / np.maximum(np.max(np.abs(step), axis=1, keepdims=True), 1e-300))
        poses[:, :unknowns] -= scale[:unknowns] * step
    _, J = problem.residual(best)
    rank = np.array([np.linalg.matrix_rank(j[:, :unknowns], tol=1e-6) for j in J], dtype=np.intp)
    return best, best_residual, rank


def _distinct(problem: PlanarProblem, poses: Array, rank: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    kept: list[int] = []
    marks = np.column_stack([poses[:, :2] / problem.unit, np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    for k in range(len(poses)):
        # the root of a double solution is known to the root of its residual only
        apart = 1e-6 if rank[k] == 2 + problem.turns else 1e-4
        if all(np.max(np.abs(marks[j] - marks[k])) > apart for j in kept):
            kept.append(k)
    return poses[kept], rank[kept]


def _is_moving(problem: PlanarProblem, pose: Array, tolerance: float) -> bool:
    """Tell whether the platform can leave a singular pose with its drives held."""
    _, J = problem.residual(pose[None])
    unknowns = 2 + problem.turns
    direction = np.linalg.svd(J[0][:, :unknowns])[2][-1]
    scale = np.array([problem.unit, problem.unit, 1.0])[:unknowns]
    for length in (0.05, -0.05):
        away = pose.copy()
        away[:unknowns] += length * scale * direction
        there, residual, _ = _polish(problem, away[None])
        gone = np.max(np.abs((there[0] - pose)[:unknowns] / scale))
        if residual[0] <= tolerance and gone > 0.01:
            return True
    return False
