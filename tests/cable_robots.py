"""Cable robots that the tests of this folder share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.modes.cable import CableRobot

IPANEMA_EXITS = [(x, y, z) for z in (2.0, 0.0) for x, y in ((-2, 1.5), (2, 1.5), (2, -1.5), (-2, -1.5))]
IPANEMA_POINTS = [(0.06 * sx, 0.06 * sy, 0.0) for _ in range(2) for sx, sy in ((-1, 1), (1, 1), (1, -1), (-1, -1))]


def ipanema(**changes: Any) -> CableRobot:
    """IPAnema 1, cable set "original" of CASPR's `IPAnema_1_cables.xml` and `IPAnema_1_bodies.xml`."""
    values: dict[str, Any] = {
        "name": "IPAnema 1",
        "exits": IPANEMA_EXITS,
        "attachments": IPANEMA_POINTS,
        "mass": 25.0,
        "inertia": [[14.0, 0, 0], [0, 14.0, 0], [0, 0, 14.0]],
        "t_max": 720.0,
        "home": {"z": 1.0},
    }
    return CableRobot(**(values | changes))


def planar(side: float = 1.0, half_width: float = 0.1, **changes: Any) -> CableRobot:
    """The planar robot of LARM with the dimensions of `robots.larm_planar`."""
    values: dict[str, Any] = {
        "name": "planar",
        "exits": [(0, 0), (0, side), (side, 0), (side, side)],
        "attachments": [(-half_width, 0), (-half_width, 0), (half_width, 0), (half_width, 0)],
        "mass": 1.0,
        "inertia": 0.01,
        "t_max": 100.0,
        "planar": True,
        "home": {"x": 0.5 * side, "y": 0.5 * side},
    }
    return CableRobot(**(values | changes))


def hanging(drop: float = 0.05, side: float = 1.0, half_width: float = 0.1, **changes: Any) -> CableRobot:
    """The spatial robot of LARM, hanging from a level square, with the dimensions of `robots.larm_spatial`."""
    values: dict[str, Any] = {
        "name": "hanging",
        "exits": [(0, 0, 0), (0, side, 0), (side, 0, 0), (side, side, 0)],
        "attachments": [(-half_width, 0, 0)] * 2 + [(half_width, 0, 0)] * 2,
        "mass": 1.0,
        "centre": (0, 0, -drop),
        "t_max": 100.0,
        "order": "zyx",
        "operational": ("x", "y", "z", "gamma", "beta"),
        "home": {"x": 0.5 * side, "y": 0.5 * side, "z": -0.5 * side},
    }
    return CableRobot(**(values | changes))


def draw_poses(robot: CableRobot, count: int, seed: int, turn: float = 0.3) -> NDArray[np.float64]:
    """Poses within the box of the exits, away from its faces, with rotations of up to `turn` about each axis."""
    random = np.random.default_rng(seed)
    low, high = robot.exits.min(axis=0), robot.exits.max(axis=0)
    width = len(low)
    poses = random.uniform(-turn, turn, (count, robot.dof))
    poses[:, :width] = random.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low), (count, width))
    return poses
