"""Every solution of a model, found by starting everywhere; for machines of the library without compiling them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

import paraopt as po

Array = NDArray[np.float64]


def uncompiled(robot: po.Robot) -> po.Kinematics:
    """Give functions that run in CasADi's virtual machine: what is used a few times is not worth compiling."""
    return po.Kinematics(robot.mechanism, backend="virtual machine")


def home_of(robot: po.Robot) -> Array:
    """Give the values at home as the robot states them, which must be all of them; shape (n_variables,)."""
    return np.array([robot.home[name] for name in robot.mechanism.names])


def all_solutions(
    kinematics: po.Kinematics, impose: Mapping[str, float], starts: int, span: float, seed: int = 0
) -> Array:
    """Find the solutions of a model from random starts, with lengths in [-span, span] and angles anywhere.

    Args:
        kinematics: The mechanism's functions.
        impose: Imposed values by name.
        starts: Number of starts.
        span: Largest length of a start.
        seed: Seed of the starts.

    Returns:
        Different solutions with angles in [-pi, pi), shape (n, n_variables).
    """
    mechanism = kinematics.mechanism
    turning = np.array([v.kind == "angle" for v in mechanism.variables])
    bound = np.where(turning, np.pi, span)
    X = np.random.default_rng(seed).uniform(-bound, bound, size=(starts, len(bound)))
    batch = kinematics.solve_batch(tuple(impose), np.tile(list(impose.values()), (starts, 1)), X)
    found: list[Array] = []
    for x in batch.X[batch.converged]:
        x = np.where(turning, np.remainder(x + np.pi, 2 * np.pi) - np.pi, x)
        # solutions that are different differ by far more, those that are the same by some 1e-10
        distances = [np.where(turning, np.abs(np.exp(1j * x) - np.exp(1j * y)), np.abs(x - y)) for y in found]
        if not any(np.max(d) < 1e-6 for d in distances):
            found.append(x)
    return np.array(found).reshape(-1, len(bound))
