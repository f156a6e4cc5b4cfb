"""A leg through the air: the way of its foot, and the pose of the platform that keeps the locked joints as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, SolveError
from paraopt.modes.legged.tripod.chain import TripodModel
from paraopt.modes.legged.tripod.frames import read_feet, read_frame, rotations
from paraopt.modes.legged.tripod.geometry import check_leg

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Swing:
    """Describe the way of a foot to a new frame: `A + s (A' - A) + 4 lift s (1 - s) n`, angles linear in s.

    n is the mean of the normals of the old and the new frame.

    Attributes:
        leg: The leg that swings.
        feet: Frames of all feet before it [m, rad], shape (3, 6).
        goal: The new frame of its foot [m, rad], shape (6,).
        lift: How high the foot is lifted half way [m].

    Raises:
        DefinitionError: A shape is wrong, or the lift is negative or not finite.
    """

    leg: int
    feet: ArrayLike
    goal: ArrayLike
    lift: float = 0.03

    def __post_init__(self) -> None:
        check_leg(self.leg)
        feet, goal = read_feet(self.feet), read_frame(self.goal, f"new frame of foot {self.leg}")
        if not (np.isfinite(self.lift) and self.lift >= 0):
            raise DefinitionError(f"lift of foot {self.leg} is {self.lift} m; it must be finite and not negative")
        turn = goal[3:] - feet[self.leg - 1, 3:]
        goal[3:] -= 2 * np.pi * np.round(turn / (2 * np.pi))  # the short way round
        feet.flags.writeable = goal.flags.writeable = False
        object.__setattr__(self, "feet", feet)
        object.__setattr__(self, "goal", goal)

    @property
    def start(self) -> Array:
        """Give the old frame of the foot, shape (6,)."""
        return np.asarray(self.feet)[self.leg - 1]

    @property
    def normal(self) -> Array:
        """Give the direction in which the foot is lifted, shape (3,)."""
        n = rotations([self.start, np.asarray(self.goal)])[:, :, 2].sum(axis=0)
        return np.asarray(n / np.linalg.norm(n))

    def frames(self, s: ArrayLike) -> Array:
        """Give the frame of the foot at n parameters in [0, 1] [m, rad], shape (n, 6)."""
        t = np.atleast_1d(np.asarray(s, dtype=float))[:, None]
        frames = self.start + t * (np.asarray(self.goal) - self.start)
        frames[:, :3] += 4 * self.lift * t * (1 - t) * self.normal
        return np.asarray(frames)

    def all_frames(self, s: ArrayLike) -> Array:
        """Give the frames of all feet at n parameters, shape (n, 3, 6)."""
        own = self.frames(s)
        frames = np.repeat(np.asarray(self.feet)[None], len(own), axis=0)
        frames[:, self.leg - 1] = own
        return frames

    @property
    def feet_after(self) -> Array:
        """Give the frames of all feet after it, shape (3, 6)."""
        feet = np.array(self.feet)
        feet[self.leg - 1] = self.goal
        return feet


def follow_swing(
    model: TripodModel, swing: Swing, pose: ArrayLike, count: int = 41, steps: int = 8, tolerance: float = 1e-13
) -> Array:
    """Find the poses of the platform along a swing, the locked joints as they are at its beginning.

    All instants are solved together; the swing grows from none to the whole in steps, so that each instant stays on
    the branch of the beginning.

    Args:
        model: The closed forms.
        swing: The swing.
        pose: Pose of the platform at its beginning [m, rad], shape (6,).
        count: Number of instants.
        steps: Number of steps in which the swing grows.
        tolerance: Largest change of a locked joint [rad].

    Returns:
        Poses [m, rad], shape (count, 6).

    Raises:
        SolveError: The locks let go of the platform on the way, or the foot cannot go there with these locks. Evidence:
            "s", the instant, and "share", how much of the swing could be done.

    Source: Tripod, 4.1.
    """
    s = np.linspace(0.0, 1.0, count)
    feet, whole = np.asarray(swing.feet), swing.all_frames(s)
    poses = np.repeat(read_frame(pose)[None], count, axis=0)
    first = model.locks(swing.leg, poses[:1], feet)
    b, sign = first.b, np.sign(np.linalg.det(first.B[0]))
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        there = feet + share * (whole - feet)
        poses, miss, B = hold_locks(model, swing.leg, b, there, poses, tolerance)
        lost = ~(miss <= tolerance) | (np.sign(np.linalg.det(B)) != sign)
        if np.any(lost):
            k = int(np.argmax(lost))
            raise SolveError(
                f"foot {swing.leg} cannot follow its swing with the joints locked at this pose: they let go of the "
                f"platform at s = {s[k]:.2f} of {100 * share:.0f} % of the swing",
                s=float(s[k]),
                share=float(share) - 1.0 / steps,
                leg=swing.leg,
            )
    return poses


def hold_locks(
    model: TripodModel, leg: int, b: Array, feet: Array, poses: Array, tolerance: float = 1e-13, iterations: int = 20
) -> tuple[Array, Array, Array]:
    """Solve `b(pose, feet) = b` for the pose of the platform by Newton's method, at n places together.

    Args:
        model: The closed forms.
        leg: The leg in the air.
        b: Values of the locked joints [rad], shape (1, 6) or (n, 6).
        feet: Frames of the feet, shape (n, 3, 6).
        poses: Where to begin, shape (n, 6).
        tolerance: Largest miss [rad].
        iterations: Bound on the iterations.

    Returns:
        Poses (n, 6), the largest miss at each (n,) [rad], and the matrices of the locks (n, 6, 6).
    """
    poses = poses.copy()
    for _ in range(iterations):
        state = model.locks(leg, poses, feet)
        gap = wrap(state.b - b)
        miss = np.max(np.abs(gap), axis=1)
        if np.max(miss) <= tolerance:
            break
        ridge = 1e-14 * np.eye(6)  # where B is singular the step is long, and the miss tells
        step = np.linalg.solve(state.B + ridge, gap[..., None])[..., 0] * model.scale
        longest = np.max(np.abs(step) / model.scale, axis=1, keepdims=True)
        poses -= step * np.minimum(1.0, 0.5 / np.maximum(longest, 1e-300))
    state = model.locks(leg, poses, feet)
    miss = np.max(np.abs(wrap(state.b - b)), axis=1)
    return poses, np.where(np.isfinite(miss), miss, np.inf), state.B


def fit_platform(
    model: TripodModel, leg: int, b: ArrayLike, feet: ArrayLike, starts: ArrayLike, iterations: int = 200
) -> tuple[Array, Array]:
    """Find the poses of the platform whose locked joints are nearest to given ones: `min |b(pose, feet) - b|`.

    Args:
        model: The closed forms.
        leg: The leg in the air.
        b: Values of the locked joints in the order of `lock_names` [rad], shape (6,).
        feet: Frames of the feet, shape (3, 6).
        starts: Where to begin, shape (n, 6).
        iterations: Bound on the iterations.

    Returns:
        Poses (n, 6) and what is left of `|b(pose, feet) - b|` at each (n,) [rad].

    Source: Tripod, 4.1 (XFKM).
    """
    x, feet, b = np.array(starts, dtype=float, ndmin=2), read_feet(feet), np.asarray(b, dtype=float)
    damping = np.full(len(x), 1e-2)

    def gap_at(poses: Array) -> tuple[Array, Array, Array]:
        state = model.locks(leg, poses, feet)
        gap = wrap(state.b - b)
        return gap, state.B, np.nan_to_num(np.linalg.norm(gap, axis=1), nan=np.inf)

    gap, B, size = gap_at(x)
    for _ in range(iterations):  # Levenberg and Marquardt's method, all starts together
        if np.max(size) <= 1e-13:
            break
        normal = B.transpose(0, 2, 1) @ B + damping[:, None, None] * np.eye(6)
        step = np.linalg.solve(normal, (B.transpose(0, 2, 1) @ gap[..., None]))[..., 0] * model.scale
        trial = x - step
        new_gap, new_B, new_size = gap_at(trial)
        better = new_size < size
        x, gap, size = (np.where(better[:, None], trial, x), np.where(better[:, None], new_gap, gap),
                        np.where(better, new_size, size))  # fmt: skip
        B = np.where(better[:, None, None], new_B, B)
        damping = np.clip(np.where(better, 0.2 * damping, 5.0 * damping), 1e-15, 1e6)
    return x, size


def wrap(angle: Array) -> Array:
    """Bring differences of angles within half a turn [rad]."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
