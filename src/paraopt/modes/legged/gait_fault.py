"""Why a gait cannot be: which phase, which foot, and by how much."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import InfeasibleError
from paraopt.kinematics.interior import build_program, run_program
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_motion import Gait, PhaseSamples
from paraopt.modes.legged.gait_options import COORDINATES, GaitOptions
from paraopt.modes.legged.gait_steps import Footfalls
from paraopt.modes.legged.gait_table import CONTROL, PhaseTable, bernstein

Array = NDArray[np.float64]


def name_worst(gait: Gait, looked: Sequence[PhaseSamples], worst: int) -> str:
    """Say in which phase the support margin is smallest, over which edge, and how large it is."""
    phase, found = gait.phases[worst], looked[worst]
    edge = found.edges[int(np.argmin(found.distances.min(axis=0)))]
    doing = f"foot {phase.foot!r} in the air" if phase.kind == "swing" else "all feet standing"
    return (
        f"phase {phase.name!r}, {doing}: the best smallest support margin is {1e3 * found.bound:.2f} mm, over the edge "
        f"{edge}"
    )


def explain_fault(
    falls: Footfalls, table: PhaseTable, options: GaitOptions, violation: float, status: str
) -> InfeasibleError:
    """Say why the program of a whole gait has no solution.

    Args:
        falls: The footfalls.
        table: Their phases.
        options: What the trunk may do.
        violation: Largest gap that the whole program left [m].
        status: How it ended.

    Returns:
        The error, to be raised.
    """
    return find_fault(falls, table, options) or InfeasibleError(
        f"no trunk motion joins the phases: constraints are off by {1e3 * violation:.3g} mm at best ({status}), though "
        "each foothold alone can be reached; let the trunk move farther, lower `regularity`, or take shorter steps",
        gap=violation,
    )


def find_fault(falls: Footfalls, table: PhaseTable, options: GaitOptions) -> InfeasibleError | None:
    """Find out which foothold of which phase cannot be reached, and whether a joint's range is to blame.

    At the beginning, the middle and the end of each phase the trunk is put where all feet come nearest to their places.

    Args:
        falls: The footfalls.
        table: Their phases.
        options: What the trunk may do.

    Returns:
        The error, to be raised; None where each foothold can be reached.
    """
    model = falls.model
    program, unit = _build_nearest(model)
    low, high = model.joint_range
    free = 4.0 * np.pi * np.ones_like(low)
    normals = falls.normals()
    most = np.array([options.reach] * 3 + [options.tilt] * 3) * [c in options.free for c in COORDINATES]
    start = model.rest[model.machine.robot.mechanism.indices(model.joints)]
    for k in range(len(table.lifted)):
        control = table.foot_control(k, normals, falls.height)
        for s in (0.0, 0.5, 1.0):
            weights = bernstein(np.array([s]))
            places = (weights @ control.reshape(CONTROL, -1)).ravel()
            pose = (weights @ table.nominal[k]).ravel()
            # the trunk returns to rest at both ends, where it is not free
            is_end = (k == 0 and s == 0.0) or (k == len(table.lifted) - 1 and s == 1.0)
            room = 0 * most if is_end and not falls.is_periodic else most
            gaps, q = _come_near(program, model, pose, room, places, (low, high), start)
            if gaps.max() <= max(1e-5, 1e-3 * unit):
                continue
            foot = int(np.argmax(gaps))
            name = model.machine.names[foot]
            doing = "swing" if foot == table.lifted[k] else "stand"
            lift = falls.lifts[int(table.lift[k])]
            text = (
                f"phase {k + 1} of {len(table.lifted)}, lift of {lift.foot!r}: foot {name!r} cannot {doing} where it "
                f"must: {1e3 * gaps[foot]:.2f} mm are lacking"
            )
            wider, _ = _come_near(program, model, pose, room, places, (-free, free), start)
            if wider.max() < 0.1 * gaps.max():
                at = np.minimum(q - low, high - q)
                joint = int(np.argmin(at))
                text += (
                    f"; without joint ranges it can: {model.joints[joint]!r} is at the end of its range "
                    f"[{low[joint]:.4g}, {high[joint]:.4g}]"
                )
            else:
                text += "; take a shorter step, or let the trunk move farther (`reach`, `free`)"
            return InfeasibleError(text, foot=name, phase=k, gap=float(gaps[foot]))
    return None


def _build_nearest(model: GaitModel) -> tuple[ca.Function, float]:
    unit = 0.1 * model.machine.robot.mechanism.length
    p, q, places = ca.MX.sym("p", 6), ca.MX.sym("q", len(model.joints)), ca.MX.sym("places", 3 * len(model.legs))
    feet = model.stance(p, q)[0]
    gaps = (ca.vec(feet.T) - places) / unit
    problem = {"x": ca.vertcat(p, q), "p": places, "f": ca.sumsqr(gaps), "g": ca.MX(0, 1)}
    return build_program("nearest_stance", problem, 300, 1e-9), unit


def _come_near(
    program: ca.Function,
    model: GaitModel,
    pose: Array,
    room: Array,
    places: Array,
    ranges: tuple[Array, Array],
    q: Array,
) -> tuple[Array, Array]:
    """Bring all feet as near to their places as trunk and joints allow: gaps by foot [m], and the joints."""
    box = np.concatenate([pose - room, ranges[0]]), np.concatenate([pose + room, ranges[1]])
    empty = np.zeros(0)
    z, _, _, _ = run_program(program, np.concatenate([pose, q]), places, box, (empty, empty), "the nearest stance")
    feet = np.asarray(model.stance(z[:6], z[6:])[0])
    return np.linalg.norm(feet - places.reshape(-1, 3), axis=1), z[6:]
