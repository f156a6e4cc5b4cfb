"""Leg after leg: the platform goes where the locks hold it best, then the foot goes to its new frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.legged.task import Phase
from paraopt.modes.legged.tripod.frames import read_feet, read_frame
from paraopt.modes.legged.tripod.geometry import (
    LEGS,
    POSE,
    foot_names,
    lock_names,
)
from paraopt.modes.legged.tripod.lock_pose import LockPose, LockPoseOptions, find_lock_pose
from paraopt.modes.legged.tripod.swing import Swing
from paraopt.modes.legged.tripod.swing_state import smallest_from_tilt
from paraopt.modes.legged.tripod.walker import WalkingTripod
from paraopt.planning import Retimer

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LegStep:
    """Hold what one leg does: the reconfiguration before its swing, and the swing.

    Attributes:
        swing: Way of the foot.
        lock: Pose at which the joints are locked, and all that follows from it.
    """

    swing: Swing
    lock: LockPose

    @property
    def leg(self) -> int:
        """Give the number of the leg."""
        return self.swing.leg

    @property
    def pose_after(self) -> Array:
        """Give the pose of the platform when the foot is down again, shape (6,)."""
        return self.lock.state.poses[-1]


@dataclass(frozen=True, eq=False)
class TripodStep:
    """Hold a step of several legs, one after the other.

    Attributes:
        walker: The machine.
        pose: Pose of the platform before it [m, rad], shape (6,).
        feet: Frames of the feet before it, shape (3, 6).
        legs: What each leg does, in order.
    """

    walker: WalkingTripod
    pose: Array
    feet: Array
    legs: tuple[LegStep, ...] = field(default_factory=tuple)

    @property
    def pose_after(self) -> Array:
        """Give the pose of the platform after it, shape (6,)."""
        return self.legs[-1].pose_after if self.legs else self.pose

    @property
    def feet_after(self) -> Array:
        """Give the frames of the feet after it, shape (3, 6)."""
        return self.legs[-1].swing.feet_after if self.legs else self.feet

    @property
    def smallest(self) -> float:
        """Give the smallest singular value of the locks' matrix over all swings [1]."""
        return min((leg.lock.smallest for leg in self.legs), default=np.inf)

    @property
    def summary(self) -> str:
        """Say for each leg where it is locked, and how well the locks hold beside the source's tilt."""
        lines = []
        for leg in self.legs:
            x, y, z, *angles = leg.lock.pose.tolist()
            where = f"({1e3 * x:.1f}, {1e3 * y:.1f}, {1e3 * z:.1f}) mm, ({', '.join(f'{a:.3f}' for a in angles)}) rad"
            lines.append(
                f"foot {leg.leg} locked at {where}: smallest singular value over its swing {leg.lock.smallest:.4f}, "
                f"from a tilt of 0.3 rad {smallest_from_tilt(self.walker, leg.swing):.4f}"
            )
        return "\n".join(lines)

    def phases(self, retimer: Retimer | None = None, word: str = "") -> tuple[Phase, ...]:
        """List the phases: reconfiguration (mode PP) and swing (mode BE) of each leg.

        Args:
            retimer: How they are timed; as the planner says when None.
            word: What is put before their names.
        """
        made = []
        for step in self.legs:
            i, foot = step.leg, f"foot {step.leg}"
            names = foot_names(i)
            over = step.swing.frames(0.5)[0]
            made += [
                Phase(
                    f"{word}reconfiguration for {foot}",
                    standing=[f"foot {k}" for k in LEGS],
                    coordinates=POSE,
                    goal=_values(POSE, step.lock.pose),
                    stability=None,
                    retimer=retimer,
                ),
                Phase(
                    f"{word}swing of {foot}",
                    standing=[f"foot {k}" for k in LEGS if k != i],
                    coordinates=names,
                    goal=_values(names, np.asarray(step.swing.goal)),
                    locked=lock_names(i),
                    via=[_values(names, over)],
                    stability=None,
                    retimer=retimer,
                ),
            ]
        return tuple(made)


def _values(names: Sequence[str], values: Array) -> dict[str, float]:
    return dict(zip(names, np.asarray(values).tolist(), strict=True))


def tripod_step(
    walker: WalkingTripod,
    pose: ArrayLike,
    feet: ArrayLike,
    goals: ArrayLike,
    *,
    order: Sequence[int] = LEGS,
    lift: float = 0.03,
    options: LockPoseOptions | None = None,
    word: str = "",
) -> TripodStep:
    """Plan a step: for each leg the best pose to lock its joints at, then the swing of its foot.

    Args:
        walker: The machine.
        pose: Pose of the platform before it [m, rad], shape (6,).
        feet: Frames of the feet before it [m, rad], shape (3, 6).
        goals: Their frames after it, on ground of any shape, shape (3, 6).
        order: Legs in the order in which they swing; those left out stay.
        lift: How high each foot is lifted half way [m].
        options: How lock poses are searched for.
        word: What is put before the names of phases in messages.

    Returns:
        The step.

    Raises:
        DefinitionError: The order names a leg twice, or one that does not exist.
        InfeasibleError: A foot cannot come off, or cannot reach its new frame; the message names phase, foot, margin.

    Source: Tripod, 3.2.
    """
    pose, feet, goals = read_frame(pose), read_feet(feet), read_feet(goals)
    if len(set(order)) != len(order) or not set(order) <= set(LEGS):
        raise DefinitionError(f"order of the legs is {list(order)}; it must name some of {list(LEGS)}, each once")
    here, stands = pose, feet
    steps: list[LegStep] = []
    for i in order:
        swing = Swing(i, stands, goals[i - 1], lift)
        near = walker.geometry.rest_pose(0.5 * (stands + swing.feet_after))
        lock = find_lock_pose(walker, swing, near, options, start=here, phase=f"{word}swing of foot {i}")
        steps.append(LegStep(swing, lock))
        here, stands = steps[-1].pose_after, swing.feet_after
    return TripodStep(walker, pose, feet, tuple(steps))
