"""Where to lock: the pose from which the locks hold the platform best over the whole coming swing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from paraopt.errors import DefinitionError, InfeasibleError, SolveError
from paraopt.modes.legged.tripod.foot_way import check_foot_way
from paraopt.modes.legged.tripod.frames import read_frame, tilt_frame
from paraopt.modes.legged.tripod.swing import Swing
from paraopt.modes.legged.tripod.swing_state import SwingState
from paraopt.modes.legged.tripod.walker import WalkingTripod

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LockPoseOptions:
    """Choose how a lock pose is searched for.

    Attributes:
        lock_margin: Smallest singular value of the locks' matrix that is accepted [1].
        clearance: Distance that checked bodies keep over the swing [m].
        standing_margin: Distance to parallel singularities on three feet, before and after the swing [1].
        swing_margin: Distance to parallel singularities during the swing [1]; poses that do not keep it are left out.
        stroke_margin: Distance that lengths keep from the ends of their ranges [m].
        angle_margin: Distance that angles keep from the ends of their ranges [rad].
        count: Number of instants of the swing.
        tilt: Tilt of the first start about P_L P_R of the leg, the leg's side down [rad].
        starts: Number of starts, that one and random ones.
        spread: Half the width of the box around the pose in which random starts lie [m, rad].
        seed: Seed of the random starts.
        iterations: Bound on the iterations from each start.
        tolerance: Gain in the smallest singular value at which the search ends [1].
        feasibility: What bounds may be missed by, in r_p, radians or of the margin [1].
        penalty: What a missed bound costs at first, in singular values [1]; more where bounds stay missed.
    """

    lock_margin: float = 0.02
    clearance: float = 0.006
    standing_margin: float = 0.08
    swing_margin: float = 0.06
    stroke_margin: float = 0.004
    angle_margin: float = 0.02
    count: int = 13
    tilt: float = 0.3
    starts: int = 4
    spread: tuple[float, float] = (0.04, 0.35)
    seed: int = 0
    iterations: int = 60
    tolerance: float = 1e-5
    feasibility: float = 1e-6
    penalty: float = 2.0

    def __post_init__(self) -> None:
        for name in ("lock_margin", "clearance", "standing_margin", "swing_margin", "stroke_margin", "angle_margin"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise DefinitionError(f"{name} of a lock pose is {value}; it must be finite and not negative")
        for name, least in (("count", 3), ("starts", 1), ("iterations", 1)):
            if getattr(self, name) < least:
                raise DefinitionError(f"{name} of a lock pose is {getattr(self, name)}; it must be at least {least}")


@dataclass(frozen=True, eq=False)
class LockPose:
    """Hold a lock pose and the swing from it.

    Attributes:
        state: The swing.
        iterations: Iterations over all starts.
        found: Smallest singular value that each start led to [1]; nan where it led to none.
        active: What keeps it from being better, such as "qL 2 at 0.456 m".
    """

    state: SwingState
    iterations: int
    found: tuple[float, ...]
    active: tuple[str, ...]

    @property
    def pose(self) -> Array:
        """Give the pose [m, rad], shape (6,)."""
        return self.state.pose

    @property
    def smallest(self) -> float:
        """Give the smallest singular value of the locks' matrix over the swing [1]."""
        return self.state.smallest


def find_lock_pose(
    walker: WalkingTripod,
    swing: Swing,
    near: ArrayLike,
    options: LockPoseOptions | None = None,
    start: ArrayLike | None = None,
    phase: str = "",
) -> LockPose:
    """Find the pose from which the smallest singular value of the locks' matrix over a swing is largest.

    `maximise min over s of sigma_min(B(x(s), feet(s)))` over the pose x(0), subject to the ranges of all joints and
    actuators, to the distance of bodies over the whole swing, and to the distance to singularities on three feet before
    and after it. A sequence of linear programs with a trust region; all derivatives are exact. It begins at the pose
    tilted about P_L P_R of the leg, and at random poses around.

    Args:
        walker: The machine.
        swing: The swing.
        near: Pose of the platform around which to search [m, rad], shape (6,).
        options: How to search.
        start: Where the platform is now; of poses that are equally good within a hundredth, the nearest is taken.
        phase: How messages call the phase.

    Returns:
        The best pose.

    Raises:
        InfeasibleError: No start led to a pose that holds all bounds. Evidence: "margin" and "state" of the nearest
            one, where there is any.
    """
    options = options or LockPoseOptions()
    near = read_frame(near)
    check_foot_way(walker, swing, options.clearance, phase)
    rng = np.random.default_rng(options.seed)
    width = np.repeat(options.spread, 3)
    azimuth = walker.geometry.azimuth(swing.leg)
    starts = [tilt_frame(near, azimuth, options.tilt)]
    starts += list(near + rng.uniform(-1, 1, size=(options.starts - len(starts), 6)) * width)
    climbs: list[_Climb] = []
    found, shares, iterations = [], [], 0
    for begin in starts:
        try:
            climb = _climb(walker, swing, begin, options)
        except SolveError as error:  # from there the locks do not carry the platform through the swing
            shares.append(float(error.evidence.get("share", 0.0)))
            found.append(float("nan"))
            continue
        iterations += climb.iterations
        climbs.append(climb)
        found.append(climb.state.smallest if climb.bounds.shortfall <= options.feasibility else float("nan"))
    holding = [c for c in climbs if c.bounds.shortfall <= options.feasibility]
    steered = [c for c in holding if float(np.min(c.state.swing_margins())) >= options.swing_margin]
    good = [c for c in steered if c.state.smallest >= options.lock_margin]
    if not good:
        where = f"phase {phase!r}: " if phase else ""
        told, margin, nearest = _explain(swing, climbs, holding, steered, options, shares)
        raise InfeasibleError(
            f"{where}foot {swing.leg} cannot {told}", leg=swing.leg, margin=margin, state=nearest and nearest.state
        )
    top, here = max(c.state.smallest for c in good), near if start is None else read_frame(start)
    best = min(
        (c for c in good if c.state.smallest >= 0.99 * top),
        key=lambda c: float(np.linalg.norm((c.state.pose - here) / walker.model.scale)),
    )
    return LockPose(best.state, iterations, tuple(found), best.bounds.active)


def _explain(
    swing: Swing,
    climbs: Sequence[_Climb],
    holding: Sequence[_Climb],
    steered: Sequence[_Climb],
    options: LockPoseOptions,
    shares: Sequence[float],
) -> tuple[str, float, _Climb | None]:
    """Say what no pose could do, with the margin of the nearest one and that one."""
    if not climbs:
        left = (1.0 - max(shares)) * float(np.linalg.norm(np.asarray(swing.goal)[:3] - swing.start[:3]))
        return (
            f"reach its new frame from any of {options.starts} poses: the locks let go of the platform "
            f"{1e3 * left:.0f} mm before at best, after {100 * max(shares):.0f} % of its way; place it nearer"
        ), -left, None  # fmt: skip
    if not holding:
        nearest = min(climbs, key=lambda c: c.bounds.shortfall)
        return f"reach its new frame: {nearest.bounds.worst}; place it nearer", -nearest.bounds.shortfall, nearest
    if not steered:
        nearest = max(holding, key=lambda c: float(np.min(c.state.swing_margins())))
        margin = float(np.min(nearest.state.swing_margins()))
        return (
            "be led by the actuators with the joints locked: the distance to singularities over its swing is "
            f"{margin:.3g}, asked {options.swing_margin:g}"
        ), margin, nearest  # fmt: skip
    nearest = max(steered, key=lambda c: c.state.smallest)
    return (
        "come off: the best lock pose holds the platform with a smallest singular value of "
        f"{nearest.state.smallest:.3g}, asked {options.lock_margin:g}"
    ), nearest.state.smallest, nearest  # fmt: skip


# --- One climb


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Hold rows `value + slope . step >= 0` that a swing must obey, scaled.

    Attributes:
        values: What is left of each bound [1], shape (n,).
        slopes: Derivatives with respect to the scaled first pose, shape (n, 6).
        describe: Gives what a row is about, and what is wrong where it is missed.
    """

    values: Array
    slopes: Array
    describe: Callable[[int], tuple[str, str]]

    @property
    def shortfall(self) -> float:
        return float(np.max(-self.values, initial=0.0))

    @property
    def worst(self) -> str:
        return self.describe(int(np.argmin(self.values)))[1]

    @property
    def active(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(self.describe(int(k))[0] for k in np.flatnonzero(self.values < 1e-3)))


@dataclass(frozen=True, eq=False)
class _Climb:
    state: SwingState
    bounds: _Bounds
    iterations: int


def _climb(walker: WalkingTripod, swing: Swing, start: Array, options: LockPoseOptions) -> _Climb:
    """Climb from one start: linear programs in a trust region, with a penalty on what the bounds are missed by."""
    state = SwingState.at(walker, swing, start, options.count)
    bounds = _build_bounds(state, options)
    radius, penalty, iteration = 0.1, options.penalty, 0
    while iteration < options.iterations and radius > 1e-9:
        iteration += 1
        sigma, slopes = state.singular_slopes()
        step, promised = _solve_program(sigma.ravel(), slopes.reshape(-1, 6), bounds, radius, penalty)
        here = state.smallest - penalty * bounds.shortfall
        if promised - here <= options.tolerance:
            if bounds.shortfall <= options.feasibility or penalty > 1e3:
                break
            penalty *= 5.0  # the bounds are not yet worth enough
            continue
        trial = state.moved(step)
        if trial is None:
            radius *= 0.3
            continue
        new_bounds = _build_bounds(trial, options)
        gained = trial.smallest - penalty * new_bounds.shortfall - here
        share = gained / (promised - here)
        if share > 0.1:
            state, bounds = trial, new_bounds
        if share < 0.3:
            radius *= 0.4
        elif share > 0.7 and float(np.max(np.abs(step))) > 0.9 * radius:
            radius = min(2.0 * radius, 0.3)
    state, bounds, steps = _restore(state, bounds, options)
    return _Climb(state, bounds, iteration + steps)


def _restore(
    state: SwingState, bounds: _Bounds, options: LockPoseOptions, most: int = 10
) -> tuple[SwingState, _Bounds, int]:
    """Go back within bounds that a climb still misses by little: only they count, over short ways."""
    for step_ in range(most):
        miss = bounds.shortfall
        if not 0.1 * options.feasibility < miss < 0.01:
            return state, bounds, step_
        sigma, slopes = state.singular_slopes()
        step, _ = _solve_program(sigma.ravel(), slopes.reshape(-1, 6), bounds, 20.0 * miss, 1e4)
        trial = state.moved(step)
        new_bounds = None if trial is None else _build_bounds(trial, options)
        if trial is None or new_bounds is None or new_bounds.shortfall >= miss:
            return state, bounds, step_ + 1
        state, bounds = trial, new_bounds
    return state, bounds, most


def _solve_program(sigma: Array, slopes: Array, bounds: _Bounds, radius: float, penalty: float) -> tuple[Array, float]:
    """Maximise `t - penalty * v` with sigma + slopes d >= t and values + slopes d >= -v, |d| <= radius."""
    n, m = len(sigma), len(bounds.values)
    A = np.zeros((n + m, 8))
    A[:n, :6], A[:n, 6] = -slopes, 1.0
    A[n:, :6], A[n:, 7] = -bounds.slopes, -1.0
    rhs = np.concatenate([sigma, bounds.values])
    cost = np.array([0.0] * 6 + [-1.0, penalty])
    box = [(-radius, radius)] * 6 + [(0.0, None), (0.0, None)]
    answer = linprog(cost, A_ub=A, b_ub=rhs, bounds=box, method="highs")
    if answer.x is None:
        raise SolveError(f"the linear program of a lock pose failed: {answer.message}")
    return np.asarray(answer.x[:6]), -float(answer.fun)


def _build_bounds(state: SwingState, options: LockPoseOptions) -> _Bounds:
    """Collect ranges, distances and standing margins of a swing; what is far from its bound is left out."""
    mechanism, length = state.walker.robot.mechanism, state.walker.geometry.radius
    low, high = state.walker.ranges
    angle = np.array([v.kind == "angle" for v in mechanism.variables])
    margin = np.where(angle, options.angle_margin, options.stroke_margin)
    scale = np.where(angle, 1.0, length)
    room = np.stack([(state.X - low - margin) / scale, (high - margin - state.X) / scale])
    side, instant, variable = np.nonzero(room < 0.15)
    sign = np.where(side == 0, 1.0, -1.0)
    steep = sign[:, None] * state.motions[instant, variable] / scale[variable, None]
    distances, gradients, pairs = state.distances(options.clearance + 0.03)
    standing, standing_slopes = state.standing_margins()
    values = [room[side, instant, variable], (distances.ravel() - options.clearance) / length]
    slopes = [steep, gradients.reshape(-1, 6) / length, standing_slopes]

    def describe(row: int) -> tuple[str, str]:
        if row < len(side):
            v, end = mechanism.variables[variable[row]], ("least", "greatest")[side[row]]
            bound = (low, high)[side[row]][variable[row]]
            value = state.X[instant[row], variable[row]]
            return f"{v.name} at its {end}, {bound:.4g} {v.unit}", (
                f"{v.name!r} would be {value:.4g} {v.unit}; its {end} is {bound:.4g} {v.unit}, "
                f"{margin[variable[row]]:g} {v.unit} kept from it"
            )
        row -= len(side)
        if row < distances.size:
            pair = state.walker.scene.pairs[pairs[row % len(pairs)]].name
            return f"clearance of {pair}", (
                f"{pair} would be {1e3 * distances.flat[row]:.3g} mm apart, asked {1e3 * options.clearance:g} mm"
            )
        word = ("before", "after")[row - distances.size]
        return f"standing margin {word} the swing", (
            f"the distance to singularities on three feet {word} it would be {standing[row - distances.size]:.3g}, "
            f"asked {options.standing_margin:g}"
        )

    return _Bounds(np.concatenate([*values, standing - options.standing_margin]), np.concatenate(slopes), describe)
