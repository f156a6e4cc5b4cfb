"""What winches pay out along a motion, arcs on the pulleys included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.cable.chain import MotionChain
from paraopt.modes.cable.distribution import coordinate_places
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.wrench import cable_functions
from paraopt.planning import Trajectory

Array = NDArray[np.float64]


def name_paid_out(robot: CableRobot) -> tuple[str, ...]:
    """Name the lengths that winches pay out.

    Over an eye it is the distance from exit to attachment, a variable of the machine, and bears the cable's name. Over
    a pulley it is another length, and is called "paid-out" and the cable's name, so that none is taken for the other.
    """
    pulleys = robot.pulleys or (None,) * robot.n_cables
    return tuple(c if p is None else f"paid-out {c}" for c, p in zip(robot.cables, pulleys, strict=True))


@dataclass(frozen=True, eq=False)
class WinchMotion:
    """Give the lengths that winches pay out along a motion, for controller programs and figures.

    Attributes:
        robot: The cable robot.
        motion: A motion of its `robot`, or a chain of them.

    Raises:
        DefinitionError: The motion is that of a mechanism without the robot's coordinates.
    """

    robot: CableRobot
    motion: Trajectory | MotionChain

    def __post_init__(self) -> None:
        coordinate_places(self.robot, self.motion.robot.mechanism)

    @property
    def names(self) -> tuple[str, ...]:
        """Name the lengths, see `name_paid_out`."""
        return name_paid_out(self.robot)

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        return self.motion.duration

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate the lengths, or their derivatives with respect to time.

        Args:
            t: Times in [0, duration] [s], a number or shape (n,).
            order: 0 for lengths [m], 1 for speeds [m/s], 2 for accelerations [m/s^2].

        Returns:
            Shape (n_cables,) for a number, (n, n_cables) for an array.

        Raises:
            DefinitionError: A time is outside, or the order is another.
        """
        if order not in (0, 1, 2):
            raise DefinitionError(f"order is {order!r}; it must be 0, 1 or 2")
        state = self.motion.state(np.atleast_1d(np.asarray(t, dtype=float)))
        places = coordinate_places(self.robot, self.motion.robot.mechanism)
        poses, first, second = (v[:, places] for v in (state.X, state.velocity, state.acceleration))
        functions = cable_functions(self.robot)
        values = functions.length_motion(poses, first, second)[order - 1] if order else functions.lengths(poses)
        return values[0] if np.ndim(t) == 0 else values
