"""Gaits from control points: legs closed, phases named, and the gait whose trunk moves as stated."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.modes.legged.gait_motion import Gait, GaitPhase
from paraopt.modes.legged.gait_steps import Footfalls
from paraopt.modes.legged.gait_table import CONTROL, PhaseTable, bernstein, run_law

Array = NDArray[np.float64]
DOWN = (0.0, 0.0, -1.0)


def hold_trunk(
    falls: Footfalls, shift: float = 0.0, forward: float = 0.0, gravity: ArrayLike = DOWN, samples: int = 9
) -> Gait:
    """Build the gait whose trunk is not optimised: it moves evenly with each foot, shifted away from it.

    Args:
        falls: The footfalls.
        shift: How far the trunk is shifted sideways, away from the lifted foot [m].
        forward: How far it is shifted along its x, all along [m].
        gravity: Direction of gravity.
        samples: Number of samples at which the legs are closed, to start with.

    Returns:
        The gait; its margin may be below zero.

    Raises:
        InfeasibleError: A foot does not reach its foothold.

    Source: Lahouar, IV.3.2.
    """
    down = np.asarray(gravity, dtype=float) / np.linalg.norm(gravity)
    table = PhaseTable.of(falls, down, swing_moves=True)
    control = table.nominal.copy()
    control[:, :, :3] += forward * _axis(control[0, 0, 5])
    side = np.zeros((len(control), 3))
    for k in range(len(control)):
        if table.lifted[k] >= 0:
            across = np.array([-np.sin(control[k, 0, 5]), np.cos(control[k, 0, 5]), 0.0])
            off = (table.before[k, table.lifted[k]] - table.before[k].mean(axis=0)) @ across
            side[k] = -np.sign(off) * shift * across
    swings = [k for k in range(len(control)) if table.lifted[k] >= 0]
    control[swings, :, :3] += side[swings][:, None]
    for k in range(len(control)):
        if table.lifted[k] < 0:  # shifts lead from where the trunk is to where it has to be
            before = control[k - 1, -1] if k > 0 else (control[swings[-1], -1] - falls.cycle_travel)
            after = control[k + 1, 0] if k + 1 < len(control) else control[k, -1]
            if k == 0 and not falls.is_periodic:
                before = control[k, 0]
            control[k] = np.linspace(before, after, CONTROL)
    s = run_law(np.linspace(0.0, 1.0, samples))
    joints = close_legs(falls, table, control, s)
    return build_gait(falls, table, control, joints, s, down, 1.0, float("nan"), "stated")


def close_legs(falls: Footfalls, table: PhaseTable, control: Array, s: Array, must: bool = True) -> Array:
    """Give the joints at parameters s of all phases, shape (n_phases, n, n_joints).

    Args:
        falls: The footfalls.
        table: Their phases.
        control: Control points of the trunk [m, rad], shape (n_phases, 4, 6).
        s: Parameters, shape (n,).
        must: Whether a foot out of reach is refused; else the joints are nan there.
    """
    model, basis, K = falls.model, bernstein(s), len(control)
    normals = falls.normals()
    feet = [table.foot_control(k, normals, falls.height).reshape(CONTROL, -1) for k in range(K)]
    places = np.array([basis @ points for points in feet]).reshape(K * len(s), -1, 3)
    poses = (basis @ control).reshape(K * len(s), 6)
    index = model.machine.robot.mechanism.indices(model.joints)
    if must:
        X, closed = model.solve(poses, places, model.rest), np.ones(len(poses), dtype=bool)
    else:
        X, closed = model.reach(poses, places, model.rest)
    joints = np.where(closed[:, None], X[:, index], np.nan)
    return joints.reshape(K, len(s), -1)


def build_gait(
    falls: Footfalls, table: PhaseTable, control: Array, joints: Array, s: Array, down: Array, scale: float,
    margin: float, status: str,
) -> Gait:  # fmt: skip
    """Name the phases; those in which nothing moves are left out."""
    if scale != 1.0:
        falls = falls.scaled(scale)
        table = PhaseTable.of(falls, down, swing_moves=True)
    normals, phases = falls.normals(), []
    begin, end, cycle = 0, 0, falls.cycle
    parts = [lift.part for lift in falls.lifts]
    for k in range(len(control)):
        is_swing, i = bool(table.lifted[k] >= 0), int(table.lift[k])
        lift = falls.lifts[i]
        is_last = not is_swing and k == len(control) - 1 and not falls.is_periodic
        doing = "swing" if is_swing else "shift to lift"
        name = "back to rest" if is_last else f"{lift.part} {i - parts.index(lift.part) + 1}: {doing} {lift.foot}"
        phase = GaitPhase(
            name, "" if is_last else lift.foot, "swing" if is_swing else "shift", lift.part, control[k],
            table.foot_control(k, normals, falls.height), joints[k], s,
        )  # fmt: skip
        if not is_last and i < cycle[0]:
            begin += not phase.is_still
        if not is_last and i < cycle[1]:
            end += not phase.is_still
        phases.append(phase)
    return Gait(
        falls.model, tuple(p for p in phases if not p.is_still), down, falls.travel, (begin, end), falls.cycle_travel,
        scale, margin, len(s), status,
    )  # fmt: skip


def _axis(gamma: float) -> Array:
    return np.array([np.cos(gamma), np.sin(gamma), 0.0])
