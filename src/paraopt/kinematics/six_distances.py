"""All poses of a platform of which six points are at given distances from six fixed points, by continuation.

With Study's coordinates q = (e, g) of a pose, rotation e and translation p = g e* / (e . e), each distance is a
quadratic equation `q^T Q q = 0`, and e . g = 0. For general points and distances there are 40 complex solutions. Those
of one general complex platform are found once, by loops of its parameters that permute them; those of any platform
follow by tracking the 40 paths from there.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import SolveError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

GENERAL_COUNT = 40  # theorem: number of complex solutions for general points and distances


@dataclass(frozen=True, eq=False)
class SixDistances:
    """Hold six distances between points of the base and of the platform.

    Attributes:
        base: Points of the base [m], shape (6, 3).
        platform: Points of the platform in its frame [m], shape (6, 3).
        lengths: Distances [m], shape (6,).
    """

    base: Array
    platform: Array
    lengths: Array


@dataclass(frozen=True, eq=False)
class SixDistancePoses:
    """Hold the poses of a platform on six distances.

    Attributes:
        R: Rotations of the real solutions, shape (n, 3, 3).
        p: Origins of the platform [m], shape (n, 3).
        finite: Number of different finite complex solutions.
        lost: Number of solutions, of 40, that are multiple, at infinity or were not reached.
    """

    R: Array
    p: Array
    finite: int
    lost: int


def solve_six_distances(problem: SixDistances, imaginary: float = 1e-5) -> SixDistancePoses:
    """Find all real poses.

    Args:
        problem: Points and distances.
        imaginary: Largest imaginary part of a solution that may be real, to be polished [1].

    Returns:
        The poses, and how the paths ended.

    Source: Husty1996; SommeseWampler2005; Chablat1998, 1.5.2 (the number 40).
    """
    origin, middle = problem.base.mean(axis=0), problem.platform.mean(axis=0)
    unit = float(max(np.mean(problem.lengths), np.max(np.abs(problem.base - origin)), 1e-300))
    target = np.hstack(
        [(problem.platform - middle) / unit, (problem.base - origin) / unit, (problem.lengths[:, None] / unit) ** 2]
    ).astype(complex)
    start, solutions = _general_platform()
    random = np.random.default_rng(0)
    distinct = np.zeros((0, 8), dtype=complex)
    # a path that was lost on the straight line, or jumped to another, is found on a way round
    for detour in (None, random, random):
        way = [start] if detour is None else [start, _draw(detour, 6, 7)]
        ends, arrived = solutions, np.ones(len(solutions), dtype=bool)
        for here, there in pairwise([*way, target]):
            ends, ok = _track(here, there, ends)
            arrived &= ok
        # the rotation of a solution at infinity has no length
        finite = arrived & (np.abs(np.sum(ends[:, :4] ** 2, axis=1)) > 1e-8)
        distinct = _distinct(np.concatenate([distinct, ends[finite]]))
        if len(distinct) >= GENERAL_COUNT:
            break
    e, g = distinct[:, :4], distinct[:, 4:]
    largest = np.take_along_axis(e, np.argmax(np.abs(e), axis=1)[:, None], axis=1)
    e, g = e / largest, g / largest
    real = np.max(np.abs(np.hstack([e, g]).imag), axis=1, initial=0.0) < imaginary * (1.0 + np.max(np.abs(g), axis=1))
    e_r, g_r = e[real].real, g[real].real
    R = np.array([_rotation(k) for k in e_r]).reshape(-1, 3, 3)
    p = np.array([_translation(k, h) for k, h in zip(e_r, g_r, strict=True)]).reshape(-1, 3)
    return SixDistancePoses(R, origin + unit * p - R @ middle, len(distinct), max(GENERAL_COUNT - len(distinct), 0))


# --- Equations. Quaternions are (scalar, vector); `a e` and `e a` are L(a) e and R(a) e for a vector a.

_LEFT = np.zeros((3, 4, 4))
_RIGHT = np.zeros((3, 4, 4))
for _k in range(3):
    for _sign, _table in ((1.0, _LEFT), (-1.0, _RIGHT)):
        _i, _j = (_k + 1) % 3, (_k + 2) % 3
        _table[_k, 0, 1 + _k], _table[_k, 1 + _k, 0] = -1.0, 1.0
        _table[_k, 1 + _j, 1 + _i], _table[_k, 1 + _i, 1 + _j] = _sign, -_sign


def _forms(parameters: Complex, velocity: Complex) -> tuple[Complex, Complex]:
    """Build the quadratic forms Q of the six equations, and their derivatives along a motion of the parameters.

    Args:
        parameters: Platform point a, base point b and squared distance of each leg, shape (n, 6, 7).
        velocity: Their derivatives, same shape.

    Returns:
        Q and Q', shape (n, 6, 8, 8), of `g.g + (a.a + b.b - s) e.e + 2 g.(e a) - 2 g.(b e) - 2 (b e).(e a)`.
    """
    a, b, s = parameters[..., :3], parameters[..., 3:6], parameters[..., 6]
    da, db, ds = velocity[..., :3], velocity[..., 3:6], velocity[..., 6]
    Ra, Lb, dRa, dLb = (x @ T.reshape(3, 16) for x, T in ((a, _RIGHT), (b, _LEFT), (da, _RIGHT), (db, _LEFT)))
    Ra, Lb, dRa, dLb = (m.reshape(*m.shape[:-1], 4, 4) for m in (Ra, Lb, dRa, dLb))
    eye = np.eye(4)

    def assemble(scalar: Complex, product: Complex, mixed: Complex, last: float) -> Complex:
        Q = np.zeros((*scalar.shape, 8, 8), dtype=complex)
        Q[..., :4, :4] = scalar[..., None, None] * eye - product - product.swapaxes(-1, -2)
        Q[..., 4:, :4] = mixed
        Q[..., :4, 4:] = mixed.swapaxes(-1, -2)
        Q[..., 4:, 4:] = last * eye
        return Q

    LbT, dLbT = Lb.swapaxes(-1, -2), dLb.swapaxes(-1, -2)
    Q = assemble(np.sum(a * a + b * b, axis=-1) - s, LbT @ Ra, Ra - Lb, 1.0)
    dQ = assemble(2.0 * np.sum(a * da + b * db, axis=-1) - ds, dLbT @ Ra + LbT @ dRa, dRa - dLb, 0.0)
    return Q, dQ


def _system(q: Complex, Q: Complex, patch: Complex) -> tuple[Complex, Complex]:
    """Evaluate the eight equations and their Jacobian; the last one keeps q on a plane."""
    Qq = (Q @ q[:, None, :, None])[..., 0]
    J = np.empty((len(q), 8, 8), dtype=complex)
    J[:, :6] = 2.0 * Qq
    J[:, 6] = np.concatenate([q[:, 4:], q[:, :4]], axis=1)
    J[:, 7] = patch
    H = np.empty((len(q), 8), dtype=complex)
    H[:, :6] = np.sum(Qq * q[:, None, :], axis=-1)
    H[:, 6] = np.sum(q[:, :4] * q[:, 4:], axis=1)
    H[:, 7] = np.sum(patch * q, axis=1) - 1.0
    return H, J


def _track(
    start: Complex, target: Complex, solutions: Complex, smallest: float = 1e-6
) -> tuple[Complex, NDArray[np.bool_]]:
    """Follow solutions while the parameters move on a straight line, each with its own steps.

    Predictor of fourth order, three Newton corrections; a step is repeated with half its size where these do not
    contract, and the next one is doubled where they hardly had to.

    Returns:
        The ends, and whether each path arrived; a path that did not is left where its steps became too small.
    """
    q = np.array(solutions)
    n = len(q)
    t, h = np.zeros(n), np.full(n, 0.02)
    velocity = target - start
    alive = np.arange(n)
    while alive.size:
        here, x = t[alive], q[alive] / np.linalg.norm(q[alive], axis=1, keepdims=True)
        step = np.minimum(h[alive], 1.0 - here)
        patch = x.conj()

        def slope(y: Complex, at: Array, patch: Complex = patch) -> Complex:
            Q, dQ = _forms(start + at[:, None, None] * velocity, np.broadcast_to(velocity, (len(at), 6, 7)))
            _, J = _system(y, Q, patch)
            rhs = np.zeros((len(y), 8), dtype=complex)
            rhs[:, :6] = -np.sum((dQ @ y[:, None, :, None])[..., 0] * y[:, None, :], axis=-1)
            return _solve(J, rhs)

        k1 = slope(x, here)
        k2 = slope(x + 0.5 * step[:, None] * k1, here + 0.5 * step)
        k3 = slope(x + 0.5 * step[:, None] * k2, here + 0.5 * step)
        k4 = slope(x + step[:, None] * k3, here + step)
        y = x + step[:, None] / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        Q, _ = _forms(start + (here + step)[:, None, None] * velocity, np.broadcast_to(velocity, (len(x), 6, 7)))
        sizes = []
        for _ in range(3):
            H, J = _system(y, Q, patch)
            correction = _solve(J, -H)
            y = y + correction
            sizes.append(np.linalg.norm(correction, axis=1))
        first, last = sizes[0], sizes[2]
        good = np.isfinite(last) & (last < 1e-9) & (first < 1e-2) & (sizes[1] < 0.2 * first + 1e-12)
        ok = alive[good]
        q[ok], t[ok] = y[good], (here + step)[good]
        h[ok] = np.where(first[good] < 1e-4, 2.0, 1.0) * h[ok]
        h[alive[~good]] = 0.5 * step[~good]
        alive = alive[(t[alive] < 1.0) & (h[alive] > smallest)]
    return q / np.linalg.norm(q, axis=1, keepdims=True), t >= 1.0


def _solve(J: Complex, rhs: Complex) -> Complex:
    """Solve stacks of linear systems; a singular one gives what is not finite, and its step is refused."""
    try:
        return np.asarray(np.linalg.solve(J, rhs[..., None])[..., 0])
    except np.linalg.LinAlgError:
        result = np.full(rhs.shape, np.nan + 0j)
        for k in range(len(J)):
            if np.linalg.cond(J[k]) < 1e15:
                result[k] = np.linalg.solve(J[k], rhs[k])
        return result


def _distinct(q: Complex, tolerance: float = 1e-6) -> Complex:
    """Keep one of the points that are equal up to a factor."""
    kept: list[Complex] = []
    for x in q:
        x = x / np.linalg.norm(x)
        if all(1.0 - abs(np.vdot(y, x)) > tolerance**2 for y in kept):
            kept.append(x)
    return np.array(kept, dtype=complex).reshape(-1, 8)


# --- The general platform from which all paths start


@functools.cache
def _general_platform() -> tuple[Complex, Complex]:
    """Find the 40 solutions of one general complex platform.

    One solution is chosen, with distances that fit. Moving the parameters along a closed loop carries solutions into
    others; loops are repeated until there are 40.
    """
    random = np.random.default_rng(1996)

    e, g = _draw(random, 4), _draw(random, 4)
    g -= e * (e @ g) / (e @ e)
    q = np.concatenate([e, g])[None]
    home = _draw(random, 6, 7)
    home[:, 6] = 0.0
    Q, _ = _forms(home[None], np.zeros((1, 6, 7), dtype=complex))
    home[:, 6] = np.einsum("i,kij,j->k", q[0], Q[0], q[0]) / (e @ e)
    known = _distinct(q)
    for _ in range(60):
        moved = known
        for here, there in pairwise([home, _draw(random, 6, 7), _draw(random, 6, 7), home]):
            moved, arrived = _track(here, there, moved)
            moved = moved[arrived]
        known = _distinct(np.concatenate([known, moved]))
        if len(known) >= GENERAL_COUNT:
            return home, known
    raise SolveError(f"loops of a general six-legged platform joined {len(known)} solutions; there are {GENERAL_COUNT}")


def _draw(random: np.random.Generator, *shape: int) -> Complex:
    """Draw complex parameters of the size of a machine scaled to one."""
    return 0.6 * (random.normal(size=shape) + 1j * random.normal(size=shape)) / np.sqrt(2.0)


def _rotation(e: Array) -> Array:
    """Give the rotation of a quaternion of any length."""
    w, v = e[0], e[1:]
    x, y, z = v
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(((w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * cross) / (e @ e))


def _translation(e: Array, g: Array) -> Array:
    """Give the vector part of `g e* / (e . e)`."""
    return np.asarray((-g[0] * e[1:] + e[0] * g[1:] - np.cross(g[1:], e[1:])) / (e @ e))
