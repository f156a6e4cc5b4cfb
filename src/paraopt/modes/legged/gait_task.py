"""From a gait to a task: phases that follow it exactly, ready to be timed and certified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from paraopt.modes.legged.gait_motion import Gait
from paraopt.modes.legged.supports import Support
from paraopt.modes.legged.task import LeggedTask, Phase
from paraopt.planning import Margins, Retimer
from paraopt.robot import Limits
from paraopt.scene import Scene


def build_gait_task(
    gait: Gait,
    support: Support,
    stability: float = 0.0,
    scene: Scene | None = None,
    margins: Margins | None = None,
    limits: Limits | None = None,
    retimer: Retimer | None = None,
    tipping: float | None = None,
) -> LeggedTask:
    """Build the task that runs a gait.

    Args:
        gait: The gait.
        support: What the machine stands on.
        stability: Smallest support margin that the certificate asks for [m].
        scene: The machine among obstacles; without obstacles when None.
        margins: Distances to keep from obstacles and singularities; those of `LeggedTask` when None.
        limits: Bounds of the drives; those of the robot when None.
        retimer: How the phases are timed; as the planner says when None.
        tipping: Smallest distance from tipping over with the inertia of what moves [m], below the support margin; not
            asked when None. A gait found for speed needs it.

    Returns:
        The task: one phase for each of the gait's, in which standing feet are held and the trunk and the lifted foot
        follow the gait's cubics.
    """
    model = gait.model
    phases: list[Phase] = []
    for phase in gait.phases:
        names, curve = gait.curve(phase)
        goal = dict(zip(names, np.asarray(curve(1.0)).tolist(), strict=True))
        standing = gait.standing(phase)
        phases.append(Phase(phase.name, standing, names, goal, curve=curve, stability=stability, retimer=retimer))
    first = gait.phases[0]
    start = dict(zip(model.trunk, first.trunk[0].tolist(), strict=True))
    start |= dict(zip(model.carriers, model.carriers_at(first.feet[0]).tolist(), strict=True))
    return LeggedTask(
        model.machine, phases, support, start, scene, Margins() if margins is None else margins, limits,
        tuple(gait.gravity.tolist()), tipping,
    )  # fmt: skip


def list_footfalls(gait: Gait, times: Sequence[float]) -> list[tuple[str, float, float]]:
    """List when each foot is in the air.

    Args:
        gait: The gait.
        times: Duration of each phase [s], such as `Gait.times` gives.

    Returns:
        For each swing the foot, when it comes off and when it stands again [s].
    """
    ends = np.cumsum(np.asarray(times, dtype=float))
    return [
        (phase.foot, float(end - duration), float(end))
        for phase, duration, end in zip(gait.phases, times, ends, strict=True)
        if phase.kind == "swing"
    ]
