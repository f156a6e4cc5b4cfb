"""Coordinates of free links that no motion changes: held, they let the legs of a machine come apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.model import Kinematics, Start
from paraopt.kinematics.ranks import null_space
from paraopt.kinematics.solve import solve_closure
from paraopt.mechanism import Mobile

Array = NDArray[np.float64]


def passive_coordinates(kinematics: Kinematics) -> tuple[str, ...]:
    """List the passive variables that place free links."""
    mechanism = kinematics.mechanism
    placed = {m.name for link in mechanism.links if isinstance(link, Mobile) for m in link.motions}
    return tuple(name for name in mechanism.passive if name in placed)


def reference_configuration(kinematics: Kinematics, start: Start | None) -> Array:
    """Give a closed configuration near the start, or the start itself where the loops do not close.

    The coordinates of free links keep the values that they have at the start as long as the loops can be closed so:
    a platform that the start does not turn stays unturned.

    Args:
        kinematics: The mechanism's functions.
        start: Where to start; zeros when None.

    Returns:
        Values of all variables, shape (n_variables,).
    """
    rows = kinematics._starts(start)
    origin = rows[0].copy()
    coordinates = kinematics.mechanism.indices(passive_coordinates(kinematics))
    if not coordinates:
        return origin
    angles = [k for k in coordinates if kinematics.mechanism.variables[k].kind == "angle"]
    rows[:, coordinates] = origin[coordinates]
    if len(rows) == 1:
        rows = np.vstack([rows, kinematics._starts(None)[1:]])
        rows[:, coordinates] = origin[coordinates]
    for fixed in (angles, []):
        free = np.ones(len(origin))
        free[fixed] = 0.0
        closed = solve_closure(kinematics.functions, rows, free, kinematics.options)
        if np.any(closed.converged):
            return closed.X[int(np.argmax(closed.converged))]
    return origin


def find_held(kinematics: Kinematics, X: Array, walks: int = 4, step: float = 0.1, seed: int = 0) -> tuple[str, ...]:
    """Find the passive coordinates of free links that are constant on every motion from a configuration.

    Random walks that the closures allow are followed; what has not changed by more than 1e-8 on any of them is
    constant on the branch of the start. Imposing it is consistent where the equations that remain close, which is
    checked on each solution.

    Args:
        kinematics: The mechanism's functions.
        X: Where to start, shape (n_variables,); nothing is held where the loops are open.
        walks: Number of walks, of three steps each.
        step: Length of a step, in characteristic lengths and radians.
        seed: Seed of the directions.

    Returns:
        Names of the coordinates.
    """
    candidates = passive_coordinates(kinematics)
    columns = kinematics.mechanism.indices(candidates)
    if not columns or float(kinematics.scaled_residual(X)[0]) > 1e-9:
        return ()
    random = np.random.default_rng(seed)
    scale = kinematics.graph.variable_scale
    modest = replace(kinematics.options, step_limit=0.2)
    constant = np.ones(len(columns), dtype=bool)
    for _ in range(walks):
        here = X.copy()
        for _ in range(3):
            (E,) = kinematics.functions.scaled_jacobian(here)
            V = null_space(E)
            direction = V @ random.normal(size=V.shape[1])
            size = max(float(np.linalg.norm(direction)), 1e-300)
            closed = solve_closure(
                kinematics.functions, here + scale * direction * step / size, np.ones_like(X), modest
            )
            if not closed.converged[0]:
                break
            here = closed.X[0]
            constant &= np.abs(here[columns] - X[columns]) < 1e-8 * scale[columns]
    return tuple(name for name, still in zip(candidates, constant, strict=True) if still)
