"""The whole scenario: machining, a step with all three legs, machining at the new place, as one task of phases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline

from paraopt.modes.legged.supports import Support
from paraopt.modes.legged.task import LeggedTask, Phase
from paraopt.modes.legged.tripod.geometry import LEGS, POSE
from paraopt.modes.legged.tripod.lock_pose import LockPoseOptions
from paraopt.modes.legged.tripod.machining import check_machining
from paraopt.modes.legged.tripod.step import TripodStep, tripod_step
from paraopt.modes.legged.tripod.walker import WalkingTripod
from paraopt.planning import Margins, Retimer

STANDING = tuple(f"foot {i}" for i in LEGS)


def machine_curve(name: str, curve: BSpline, retimer: Retimer | None = None) -> Phase:
    """Give the phase that follows a way of the platform exactly on three feet (mode PP).

    Args:
        name: Name of the phase.
        curve: Spline of x ... gamma of the platform over [0, 1], such as of `follow_tool`.
        retimer: How it is timed; as the planner says when None.
    """
    return Phase(name, STANDING, POSE, curve=curve, stability=None, retimer=retimer)


def build_step_task(
    step: TripodStep, support: Support, *, margins: Margins | None = None, retimer: Retimer | None = None
) -> LeggedTask:
    """Ask for a step alone.

    Args:
        step: The step.
        support: What the feet stand on.
        margins: Distances to keep.
        retimer: How its phases are timed; as the planner says when None.
    """
    walker = step.walker
    return LeggedTask(
        walker.machine,
        step.phases(retimer),
        support,
        start=walker.configuration(step.pose, step.feet),
        scene=walker.scene,
        margins=margins or Margins(),
    )


def build_scenario(
    walker: WalkingTripod,
    feet: ArrayLike,
    goals: ArrayLike,
    before: BSpline,
    after: BSpline,
    support: Support,
    *,
    order: Sequence[int] = LEGS,
    lift: float = 0.03,
    options: LockPoseOptions | None = None,
    margins: Margins | None = None,
    machining_retimer: Retimer | None = None,
    walking_retimer: Retimer | None = None,
) -> tuple[LeggedTask, TripodStep]:
    """Build the scenario: machining, a step leg after leg, the way to the new work, machining.

    Args:
        walker: The machine.
        feet: Frames of the feet at the first work [m, rad], shape (3, 6).
        goals: Their frames at the second, shape (3, 6).
        before: Way of the platform at the first work, see `follow_tool`.
        after: Way of the platform at the second.
        support: What the feet stand on.
        order: Legs in the order in which they swing.
        lift: How high each foot is lifted half way [m].
        options: How lock poses are searched for.
        margins: Distances to keep.
        machining_retimer: How machining is timed; as the planner says when None.
        walking_retimer: How the other phases are timed; as the planner says when None.

    Returns:
        The task, of three phases and two more for each leg, and the step.

    Raises:
        InfeasibleError: A way of the platform breaks a bound, a foot cannot come off or cannot reach its new frame; the
            message names the phase, what breaks the bound, and by how much.

    Source: Tripod, 3.2, 4.2.
    """
    margins = margins or Margins()
    for name, curve, stand in (("machining", before, feet), ("machining at the new place", after, goals)):
        check_machining(
            walker, curve, stand, clearance=margins.clearance, standing_margin=margins.singularity, phase=name
        )
    step = tripod_step(walker, np.asarray(before(1.0)), feet, goals, order=order, lift=lift, options=options)
    goal = dict(zip(POSE, np.asarray(after(0.0)).tolist(), strict=True))
    phases = [
        machine_curve("machining", before, machining_retimer),
        *step.phases(walking_retimer),
        Phase("way to the new work", STANDING, POSE, goal=goal, stability=None, retimer=walking_retimer),
        machine_curve("machining at the new place", after, machining_retimer),
    ]
    start = walker.configuration(np.asarray(before(0.0)), feet)
    return LeggedTask(walker.machine, phases, support, start=start, scene=walker.scene, margins=margins), step
