"""Where a platform hangs: poses of least energy with cables that only pull, and how firmly they hold.

`minimise V(pose)  subject to  l_i(pose) <= paid-out length` (XFKM with an energy): the multipliers are the tensions,
never negative; a cable that is shorter than paid out is slack. The found pose is polished by Newton steps on balance
and lengths of the taut cables, and judged by the second variation of the energy along the motions that keep these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from paraopt.errors import DefinitionError, SolveError
from paraopt.kinematics.interior import run_program
from paraopt.kinematics.multistart import estimate_missing
from paraopt.kinematics.ranks import null_space
from paraopt.modes.cable.energy import Energy, Place, energy_of
from paraopt.modes.cable.hanging import Equilibria, EquilibriumOptions, HangingPose, Stability
from paraopt.modes.cable.model import CableRobot

Array = NDArray[np.float64]

TURN = 2.0
"""Bound on each component of a turn in one chart: Cayley's vector of a right angle [1]."""


def judge_stability(
    robot: CableRobot, pose: ArrayLike, tensions: ArrayLike, options: EquilibriumOptions | None = None
) -> Stability:
    """Judge whether an equilibrium holds, by the second variation of the energy.

    `v^T (d^2 V + sum t_i d^2 l_i) v > 0` for all motions v that keep the lengths of the cables with a tension. A cable
    whose tension is zero holds nothing: the verdict is then that of the platform without it.

    Args:
        robot: The cable robot.
        pose: Values of its coordinates [m, rad], shape (dof,).
        tensions: Tensions that balance weight and load there [N], shape (n,).
        options: What counts as taut and as stable.

    Returns:
        The second variation.

    Raises:
        DefinitionError: The shapes do not fit, or the load has no energy.

    Source: CarricatoMerlet2013.
    """
    options = options or EquilibriumOptions()
    energy = energy_of(robot)
    t = np.asarray(tensions, dtype=float)
    if t.shape != (robot.n_cables,):
        raise DefinitionError(f"tensions of {robot.name!r} have shape {t.shape}; it must be ({robot.n_cables},)")
    return _judge(energy, Place.at(robot, pose), t / energy.reference, options)


def find_equilibrium(
    robot: CableRobot, lengths: ArrayLike, start: ArrayLike | None = None, options: EquilibriumOptions | None = None
) -> HangingPose:
    """Let a platform come to rest from a start, with given lengths of cable.

    Args:
        robot: The cable robot.
        lengths: Paid-out length of each cable [m], shape (n,).
        start: Values of the coordinates to start from [m, rad], shape (dof,); the home pose when None.
        options: Tolerances.

    Returns:
        The equilibrium.

    Raises:
        DefinitionError: The lengths do not fit, or nothing pulls the platform down.
        SolveError: No equilibrium was found: the cables are too short to reach the platform together.

    Source: Lahouar, II.3; CarricatoMerlet2013; ipopt.
    """
    options = options or EquilibriumOptions()
    energy, paid = energy_of(robot), _read_lengths(robot, lengths)
    place = Place.at(robot, robot.home_pose if start is None else start)
    found = _settle(energy, place, paid, options)
    if found is None:
        raise SolveError(
            f"{robot.name!r} comes to no rest from {np.round(place.pose(robot), 6).tolist()} with the lengths "
            f"{np.round(paid, 6).tolist()} m: no pose lies within all of them, or the search did not settle; start "
            "elsewhere or pay out more",
            lengths=paid,
        )
    return found


def find_equilibria(robot: CableRobot, lengths: ArrayLike, options: EquilibriumOptions | None = None) -> Equilibria:
    """Find all stable equilibria of a platform with given lengths of cable, from many starts.

    Args:
        robot: The cable robot.
        lengths: Paid-out length of each cable [m], shape (n,).
        options: Tolerances, and when to stop.

    Returns:
        The equilibria.

    Raises:
        DefinitionError: The lengths do not fit, or nothing pulls the platform down.
        SolveError: From no start did the platform come to rest.

    Source: CarricatoMerlet2013; BoenderRinnooyKan1987; ipopt.
    """
    options = options or EquilibriumOptions()
    energy, paid = energy_of(robot), _read_lengths(robot, lengths)
    random = np.random.default_rng(options.seed)
    exits = robot.exits_in_space()
    reach = float(np.min(paid))
    found: list[HangingPose] = []
    hits: list[int] = []
    starts = 0
    continuous = False
    while starts < options.max_starts and not continuous:
        p = random.uniform(exits.min(axis=0) - reach, exits.max(axis=0) + reach)
        if robot.planar:
            p[2], turned = 0.0, Rotation.from_euler("z", random.uniform(-np.pi, np.pi))
        else:
            turned = Rotation.from_quat(random.normal(size=4))
        starts += 1
        here = _settle(energy, Place(p, turned.as_matrix()), paid, options)
        if here is not None:
            same = [k for k, other in enumerate(found) if _distance(here, other) < options.merge_distance]
            if same:
                hits[same[0]] += 1
            else:
                found.append(here)
                hits.append(1)
        neutral = sum(not pose.stability.is_stable for pose in found)
        continuous = len(found) >= options.max_found or (len(found) >= 8 and neutral > 0.5 * len(found))
        if 1 not in hits and estimate_missing(sum(hits), len(found)) < options.missing_probability:
            break
    if not found:
        raise SolveError(
            f"{robot.name!r} comes to no rest from {starts} starts with the lengths {np.round(paid, 6).tolist()} m; "
            "the cables are too short to reach the platform together",
            lengths=paid,
        )
    order = sorted(range(len(found)), key=lambda k: found[k].energy)
    return Equilibria(
        tuple(found[k] for k in order), tuple(hits[k] for k in order), starts,
        estimate_missing(sum(hits), len(found)), continuous,
    )  # fmt: skip


# --- Inside


def _read_lengths(robot: CableRobot, lengths: ArrayLike) -> Array:
    paid = np.array(lengths, dtype=float)
    if paid.shape != (robot.n_cables,) or not np.all(np.isfinite(paid) & (paid > 0)):
        raise DefinitionError(
            f"lengths of {robot.name!r} are {np.asarray(lengths).tolist()} m; there must be {robot.n_cables}, one for "
            f"each of {list(robot.cables)}, all above 0"
        )
    return paid


def _settle(energy: Energy, start: Place, paid: Array, options: EquilibriumOptions) -> HangingPose | None:
    """Let the platform come to rest from a start; None where that fails."""
    robot = energy.robot
    for _ in range(4):
        found = _descend(energy, start, paid, options)
        if found is None or found.stability.verdict != "unstable":
            return found
        # from a start of the same symmetry the descent ends on a saddle: step off it, the way it falls
        start = Place.at(robot, found.pose).moved(robot, 0.1 * found.stability.softest)
    return None


def _descend(energy: Energy, start: Place, paid: Array, options: EquilibriumOptions) -> HangingPose | None:
    """Minimise the energy from a start and polish what is found, which may be a saddle; None where that fails."""
    robot, L = energy.robot, energy.robot.length_scale
    box = np.full(robot.dof, np.inf)
    if not robot.planar:
        box[3:] = TURN
    bounds = np.full(robot.n_cables, -np.inf), paid / L
    place, what = start, f"the energy of {robot.name!r}"
    for _ in range(8):  # a chart reaches less than half a turn: go on from its edge in one around it
        parameters = np.concatenate([place.p, place.R.ravel()])
        z = run_program(energy.program, np.zeros(robot.dof), parameters, (-box, box), bounds, what)[0]
        if not np.all(np.isfinite(z)):
            return None
        place = place.moved(robot, z)
        if np.all(np.abs(z) < 0.999 * box):
            break
    _, slope, spans, J, _ = energy.at(place, np.zeros(robot.n_cables))
    near = spans > paid / L - 1e-4
    t = np.zeros(robot.n_cables)
    t[near] = nnls(J[near].T, -slope)[0] if near.any() else 0.0
    taut = t > max(1e-6, options.slack)
    for _ in range(2 * robot.n_cables + 1):  # the taut cables, one exchanged at a time
        place, t = _polish(energy, place, np.where(taut, t, 0.0), taut, paid / L)
        excess = energy.at(place, t)[2] - paid / L
        if np.min(t) < -options.slack:
            taut[np.argmin(t)] = False
        elif np.max(excess) > options.residual and not taut[np.argmax(excess)]:
            taut[np.argmax(excess)] = True
        else:
            break
    return _conclude(energy, place, t, paid / L, options)


def _polish(
    energy: Energy, place: Place, t: Array, taut: NDArray[np.bool_], paid: Array, iterations: int = 30
) -> tuple[Place, Array]:
    """Solve balance and lengths of the taut cables by Newton's method, scaled; the best is for the caller to judge."""
    dof = energy.robot.dof
    residual = np.inf
    for _ in range(iterations):
        _, slope, spans, J, H = energy.at(place, t)
        balance, gap = slope + J.T @ t, (spans - paid)[taut]
        before, residual = residual, max(np.abs(balance).max(), np.abs(gap).max(initial=0.0))
        if residual <= 1e-14 or (residual < 1e-10 and residual > 0.5 * before):
            break
        A = J[taut]
        matrix = np.block([[H, A.T], [A, np.zeros((len(A), len(A)))]])
        step = np.linalg.lstsq(matrix, -np.concatenate([balance, gap]), rcond=1e-12)[0]
        step[:dof] *= min(1.0, 0.2 / max(np.abs(step[:dof]).max(), 1e-300))
        place = place.moved(energy.robot, step[:dof])
        t = t.copy()
        t[taut] += step[dof:]
    return place, t


def _conclude(energy: Energy, place: Place, t: Array, paid: Array, options: EquilibriumOptions) -> HangingPose | None:
    """Check balance, lengths and signs, and tell what was found; None where it is no equilibrium."""
    robot, L = energy.robot, energy.robot.length_scale
    V, slope, spans, J, _ = energy.at(place, t)
    left = float(np.abs(slope + J.T @ t).max())
    if left > options.residual or np.max(spans - paid) > options.residual or np.min(t) < -options.slack:
        return None
    stability = _judge(energy, place, t, options)
    pose = place.pose(robot)
    slack = {c: float(L * by) for c, by in zip(robot.cables, paid - spans, strict=True) if by > options.residual}
    loose = [c for c, v in zip(robot.cables, t, strict=True) if v <= options.slack and c not in slack]
    joules = energy.reference * L * V - (float(robot.load[2] * pose[2]) if robot.planar else 0.0)
    return HangingPose(
        robot, pose, place.R, energy.reference * t, L * spans, slack, tuple(loose), left, joules, stability
    )


def _judge(energy: Energy, place: Place, t: Array, options: EquilibriumOptions) -> Stability:
    _, _, _, J, H = energy.at(place, t)
    Z = null_space(J[np.abs(t) > options.slack])
    if not Z.shape[1]:
        return Stability(np.zeros(0), np.zeros(energy.robot.dof), options.stability)
    values, vectors = np.linalg.eigh(Z.T @ H @ Z)
    return Stability(values, Z @ vectors[:, 0], options.stability)


def _distance(one: HangingPose, other: HangingPose) -> float:
    turn = Rotation.from_matrix(one.R @ other.R.T).magnitude()
    shift = np.linalg.norm((one.pose - other.pose)[: 2 if one.robot.planar else 3])
    return float(max(shift / one.robot.length_scale, turn))
