"""Wrench-feasible workspace: positions at which the cables hold the platform, at a constant orientation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.modes.cable.facets import FacetOptions, capacity_margins
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.read import read_number

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CableWorkspace:
    """Hold capacity margins over a grid of positions.

    Attributes:
        robot: The cable robot.
        axes: Grid values by coordinate [m], each of shape (n,), in the order of the array's axes.
        orientation: Values of the angles [rad], by name.
        margins: Capacity margins [N], one axis for each coordinate of the grid.
        margin: Least margin of a position that counts [N].
    """

    robot: CableRobot
    axes: Mapping[str, Array]
    orientation: Mapping[str, float]
    margins: Array
    margin: float

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Tell which positions count, in the shape of `margins`."""
        return np.asarray(self.margins >= self.margin)

    @property
    def share(self) -> float:
        """Give the share of the grid's positions that count [1]."""
        return float(np.mean(self.feasible))

    @property
    def volume(self) -> float:
        """Estimate the volume [m^3], in the plane the area [m^2], by one cell for each position that counts."""
        cell = [float(np.mean(np.diff(values))) for values in self.axes.values()]
        return float(np.sum(self.feasible) * np.prod(cell))


def map_workspace(
    robot: CableRobot,
    axes: Mapping[str, ArrayLike] | None = None,
    orientation: Mapping[str, float] | None = None,
    count: int = 41,
    margin: float = 0.0,
    wrench: Sequence[float] | None = None,
    options: FacetOptions | None = None,
) -> CableWorkspace:
    """Compute capacity margins over a grid of positions in one batch.

    Args:
        robot: The cable robot, with at least as many cables as freedoms.
        axes: Grid values of x, y and z (in the plane x, y) [m]; for those not given, `count` values over the stated
            range of the coordinate, or else over the box of the exits, without its faces.
        orientation: Values of the angles [rad] by name; those of the home pose when not given.
        count: Number of values along an axis that is not given.
        margin: Least margin of a position that counts [N].
        wrench: What the cables must balance about the platform's origin [N, N m]; weight and load when None.
        options: How facets are computed.

    Returns:
        The map.

    Raises:
        UnknownNameError: A name is none of the coordinates.
        DefinitionError: An axis has fewer than two values or does not grow; there are fewer cables than freedoms.
    """
    positions = [c for c in robot.coordinates if c in ("x", "y", "z")]
    angles = [c for c in robot.coordinates if c not in positions]
    given = dict(axes or {})
    for name in given:
        if name not in positions:
            raise unknown_name("axis of the workspace", name, positions)
    for name in orientation or {}:
        if name not in angles:
            raise unknown_name("angle of the workspace", name, angles)
    if not isinstance(count, (int, np.integer)) or count < 2:
        raise DefinitionError(f"count is {count!r}; an axis needs a whole number of values, at least 2")
    grid: dict[str, Array] = {}
    for i, name in enumerate(positions):
        if name in given:
            try:
                values = np.asarray(given[name], dtype=float)
            except (TypeError, ValueError) as error:
                raise DefinitionError(f"axis {name!r} is {given[name]!r}; it must be numbers [m]") from error
            if (
                values.ndim != 1
                or len(values) < 2
                or not np.all(np.diff(values) > 0.0)
                or not np.all(np.isfinite(values))
            ):
                raise DefinitionError(f"axis {name!r} is {given[name]!r}; it must be at least two growing values [m]")
            grid[name] = values
            continue
        low, high = robot.ranges.get(name, (-np.inf, np.inf))
        reach = robot.exits[:, i]
        if not (np.isfinite(low) and np.isfinite(high)):
            if np.ptp(reach) == 0.0:
                raise DefinitionError(f"exits of {robot.name!r} span no range of {name!r}; give its axis")
            edge = 0.5 * np.ptp(reach) / count
            low, high = float(np.min(reach) + edge), float(np.max(reach) - edge)
        grid[name] = np.linspace(low, high, count)
    turned = {name: robot.home[name] for name in angles} | dict(orientation or {})
    turned = {name: read_number(value, f"orientation {name!r}", "rad") for name, value in turned.items()}
    mesh = np.meshgrid(*grid.values(), indexing="ij")
    poses = np.empty((mesh[0].size, robot.dof))
    for i, name in enumerate(robot.coordinates):
        poses[:, i] = mesh[positions.index(name)].reshape(-1) if name in grid else turned[name]
    margins = capacity_margins(robot, poses, wrench, options).reshape(mesh[0].shape)
    return CableWorkspace(robot, MappingProxyType(grid), MappingProxyType(turned), margins, margin)
