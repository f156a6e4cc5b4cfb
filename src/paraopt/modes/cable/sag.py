"""Whether cables are light enough to be taken for straight lines without mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import InfeasibleError
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.read import read_for_cables, read_number, read_rows
from paraopt.modes.cable.wrench import cable_functions
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sag:
    """Hold how far cables hang below their straight lines.

    Attributes:
        robot: The cable robot.
        deflections: Largest distance from the straight line [m], shape (k, n); inf for a cable without tension.
        ratios: The same over the straight length [1], shape (k, n).
    """

    robot: CableRobot
    deflections: Array
    ratios: Array

    def check(self, bound: float) -> Sag:
        """Give itself where every cable is straight enough.

        Args:
            bound: Largest deflection [m].

        Raises:
            InfeasibleError: A cable hangs lower; the message names it.
        """
        bound = read_number(bound, "bound of the sag", "m", above=0.0)
        if np.all(self.deflections <= bound):
            return self
        k, i = np.unravel_index(int(np.argmax(self.deflections)), self.deflections.shape)
        raise InfeasibleError(
            f"cable {self.robot.cables[i]!r} hangs {1e3 * self.deflections[k, i]:.4g} mm below its straight line at "
            f"pose {k}; the bound is {1e3 * bound:.4g} mm: ask for more tension, or for lighter cables",
            sag=self,
        )


def estimate_sag(
    robot: CableRobot,
    poses: ArrayLike,
    tensions: ArrayLike,
    density: ArrayLike,
    gravity: Sequence[float] | None = None,
) -> Sag:
    """Estimate how far cables hang below straight lines, by the parabola to which a taut cable's catenary comes near.

    A cable of mass m per length, straight length L and tension t, whose line spans H across gravity g, is off the line,
    at right angles to it in the middle, by

        d = m g L H / (8 t)

    The estimate is good to a share of about (d / L)^2.

    Args:
        robot: The cable robot.
        poses: Poses, shape (k, dof).
        tensions: Tensions there [N], shape (k, n), or (n,) or one number for all poses.
        density: Mass of the cables per length [kg/m], one for all or one for each.
        gravity: Acceleration of free fall that bends the cables [m/s^2]; when None the robot's, or (0, 0, -9.81) for a
            robot in a level plane, whose platform does not feel it.

    Returns:
        The deflections.

    Raises:
        DefinitionError: An argument has another size, or a density is not above zero.
    """
    points = robot.check_poses(poses)
    mass = read_for_cables(density, robot.cables, "density", "kg/m", above=0.0)
    fall = np.asarray(robot.gravity, dtype=float) if gravity is None else finite_vector(gravity, 3, "gravity")
    if gravity is None and not np.any(fall):
        fall = np.array([0.0, 0.0, -9.81])
    strength = float(np.linalg.norm(fall))
    down = fall / strength if strength > 0.0 else fall
    functions = cable_functions(robot)
    t = read_rows(tensions, len(points), robot.n_cables, "tensions", alone=True)
    spans = functions.attachment_points(points) - functions.leaving_points(points)
    lengths = np.linalg.norm(spans, axis=2)
    across = np.linalg.norm(spans - (spans @ down)[:, :, None] * down, axis=2)
    load = mass * strength * lengths * across / 8.0
    deflections = np.where(load > 0.0, np.inf, 0.0)
    np.divide(load, t, out=deflections, where=t > 0.0)
    return Sag(robot, deflections, deflections / lengths)
