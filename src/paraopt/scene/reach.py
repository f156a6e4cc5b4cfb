"""Which pairs never come near each other: evidence from configurations all over the reach of a robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics.solve import solve_closure
from paraopt.robot import Robot

Array = NDArray[np.float64]


def walk_configurations(robot: Robot, count: int, seed: int, step: float = 0.2, stride: int = 4) -> Array:
    """Walk through the configurations of a robot, along motions that the closures allow, within the limits.

    All walkers start at home. Each keeps its direction as long as it can, turning a little at every step, and takes a
    new one where the loops do not close or a limit is met.

    Args:
        robot: The machine.
        count: Number of configurations.
        seed: Seed of the directions.
        step: Length of a step, in characteristic lengths and radians.
        stride: Number of steps from one configuration that is kept to the next.

    Returns:
        Closed configurations within the limits [m or rad], the home first, shape (count, n_variables).

    Raises:
        DefinitionError: The count is below 1.
    """
    if not (isinstance(count, int) and count >= 1):
        raise DefinitionError(f"number of samples is {count!r}; it must be a whole number above 0")
    kinematics, random = robot.kinematics, np.random.default_rng(seed)
    scale = kinematics.graph.variable_scale
    low, high = robot.limits.bounds(robot.mechanism)
    home = robot.home_configuration.X
    # as many walkers as make a batch worth while, as few as let each walk far
    here = np.tile(home, (min(32, max(2, count // 50)), 1))
    heading = random.normal(size=here.shape)
    found, n_found = [home[None]], 1
    idle = steps = 0
    while n_found < count:
        (E,) = kinematics.functions.scaled_jacobian.batch(here)
        # what moves no closure is dropped: the part of the heading in the null space, by a damped projection
        gram = E @ E.transpose(0, 2, 1) + 1e-9 * np.eye(E.shape[1])
        forced = np.linalg.solve(gram, E @ heading[:, :, None])
        direction = heading - (E.transpose(0, 2, 1) @ forced)[:, :, 0]
        size = np.linalg.norm(direction, axis=1, keepdims=True)
        start = here + scale * direction * (step / np.maximum(size, 1e-12))
        closed = solve_closure(kinematics.functions, start, np.ones(len(scale)), kinematics.options)
        good = closed.converged & np.all((low <= closed.X) & (high >= closed.X), axis=1) & (size[:, 0] > 1e-9)
        good &= np.linalg.norm((closed.X - here) / scale, axis=1) < 2.0 * step  # no jump to another branch
        here = np.where(good[:, None], closed.X, here)
        heading = np.where(good[:, None], direction / np.maximum(size, 1e-12), 0.0)
        heading += np.where(good[:, None], 0.3, 1.0) * random.normal(size=here.shape) / np.sqrt(here.shape[1])
        steps += 1
        if good.any() and steps % stride == 0:
            found.append(closed.X[good])
            n_found += int(good.sum())
        idle = 0 if good.any() else idle + 1
        if idle > 200:
            raise DefinitionError(
                f"{robot.name!r}: no step of {step} characteristic lengths leads away from {n_found} configurations "
                "within the limits; widen the limits or shorten the step"
            )
    return np.concatenate(found)[:count]
