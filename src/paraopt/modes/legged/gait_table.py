"""The phases of footfalls in numbers: who is in the air, where the feet are, which edges hold the machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import InfeasibleError
from paraopt.modes.legged.balance import SupportPolygon
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_steps import Footfalls

Array = NDArray[np.float64]

CONTROL = 4  # control points of a cubic piece: the foot leaves and lands along the normal


def bernstein(s: Array) -> Array:
    """Give the weights of the four control points of a cubic piece at n parameters, shape (n, 4)."""
    s = np.asarray(s, dtype=float)[:, None]
    return np.hstack([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3])


def run_law(tau: Array) -> Array:
    """Give the path parameter at shares of the time of a phase: at rest at both ends, with no acceleration there."""
    return np.asarray(tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2))


def order_edges(model: GaitModel, places: Array, standing: Sequence[int], gravity: Array) -> list[tuple[int, int]]:
    """Give the edges of the support polygon, counter-clockwise, as pairs of numbers of feet.

    Args:
        model: The machine.
        places: Footholds [m], shape (n_feet, 3).
        standing: Numbers of the feet that stand.
        gravity: Direction of gravity.

    Raises:
        InfeasibleError: Fewer than three feet stand, or all on one line.
    """
    names = model.machine.names
    polygon = SupportPolygon.over([names[k] for k in standing], places[list(standing)], gravity)
    if len(polygon.corners) < 3:
        raise InfeasibleError(
            f"feet {[names[k] for k in standing]} stand on one line or fewer; a machine that is not to tip over needs "
            "three that do not",
            places=places,
        )
    corners = [names.index(corner) for corner in polygon.corners]
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


@dataclass(frozen=True, eq=False)
class PhaseTable:
    """List the phases of footfalls in numbers.

    Attributes:
        lifted: Number of the foot in the air, -1 where all stand, shape (n_phases,).
        lift: Number of the lift that the phase belongs to, shape (n_phases,).
        before: Footholds when the phase begins [m], shape (n_phases, n_feet, 3).
        after: Footholds when it ends [m], same shape.
        nominal: Nominal control points of the trunk [m, rad], shape (n_phases, 4, 6).
        edges: Edges of the support polygon for each phase.
    """

    lifted: NDArray[np.intp]
    lift: NDArray[np.intp]
    before: Array
    after: Array
    nominal: Array
    edges: tuple[list[tuple[int, int]], ...]

    @classmethod
    def of(cls, falls: Footfalls, gravity: Array, swing_moves: bool) -> PhaseTable:
        """List the phases: before each lift a shift of the trunk, then the swing; a last shift back to rest."""
        places, poses = falls.all_places, falls.all_poses
        lifted, lift, before, after, nominal, edges = [], [], [], [], [], []
        count = len(falls.lifts)
        all_feet = range(len(places[0]))
        for i in range(count + (0 if falls.is_periodic else 1)):
            here = places[i]
            # the nominal trunk moves with the foot, or before it where it has to stand while the foot moves
            ends = poses[i], poses[i] if swing_moves or i == count else poses[i + 1]
            lifted.append(-1)
            lift.append(min(i, count - 1))
            before.append(here)
            after.append(here)
            nominal.append(np.linspace(*ends, CONTROL))
            edges.append(order_edges(falls.model, here, list(all_feet), gravity))
            if i == count:
                break
            foot = falls.feet[i]
            lifted.append(foot)
            lift.append(i)
            before.append(here)
            after.append(places[i + 1])
            nominal.append(np.linspace(ends[1], poses[i + 1], CONTROL))
            edges.append(order_edges(falls.model, here, [k for k in all_feet if k != foot], gravity))
        return cls(np.array(lifted), np.array(lift), np.array(before), np.array(after), np.array(nominal), tuple(edges))

    def foot_control(self, phase: int, normals: Array, height: float) -> Array:
        """Give the control points of all feet in a phase [m], shape (4, n_feet, 3).

        The cubic of a lifted foot begins and ends along the normal; its middle is `height` above that of its
        ends.
        """
        points = np.repeat(self.before[phase][None], CONTROL, axis=0)
        foot = self.lifted[phase]
        if foot >= 0:
            points[2:, foot] = self.after[phase, foot]
            points[1:3, foot] += height / 0.75 * normals[self.lift[phase]]
        return points
