"""Cable robots that the tests of this folder share."""

from __future__ import annotations

from typing import Any

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
