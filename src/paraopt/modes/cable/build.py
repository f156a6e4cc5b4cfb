"""From the description of a cable robot to its mechanism and its machine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.mechanism import Base, Coincidence, Link, Mechanism, Mobile, Prismatic, Revolute, Series, Universal
from paraopt.robot import Limits, Robot
from paraopt.shapes import Cable
from paraopt.spatial import rotation_about

if TYPE_CHECKING:
    from paraopt.modes.cable.model import CableRobot

Array = NDArray[np.float64]

PLATFORM = "platform"
"""Name of the link that the cables hold."""


def build_platform(robot: CableRobot) -> Mobile:
    """Build the link that the cables hold."""
    return Mobile(PLATFORM, ranges=robot.ranges, order="xyz" if robot.planar else robot.order)


def build_mechanism(robot: CableRobot) -> Mechanism:
    """Build the mechanism: for each cable a pulley that swings and a straight line of variable length.

    At home the line lies on the third axis of its pulley, far from the cardan's singular direction.

    Raises:
        DefinitionError: A cable has no length at home.
    """
    links: list[Link] = [Base()]
    closures: list[Coincidence] = []
    ends = _home_ends(robot)
    for name, exit_, point, end in zip(robot.cables, robot.exits, robot.attachments, ends, strict=True):
        length = float(np.linalg.norm(end))
        if length == 0.0:
            raise DefinitionError(f"cable {name!r} of {robot.name!r} has no length at home; move the home pose")
        if robot.planar:
            links.append(Series(f"pulley {name}", "base", exit_, Revolute(f"pulley {name}")))
        else:
            d = end / length
            turn = (math.atan2(-d[1], d[2]), math.asin(min(1.0, max(-1.0, d[0]))), 0.0)
            swing = Universal(f"pulley {name}", axes=("x", "y"))
            links.append(Series(f"pulley {name}", "base", exit_, swing, rotation=turn))
        line = Prismatic(name, axis="x" if robot.planar else "z", range=robot.lengths)
        links.append(Series(f"cable {name}", f"pulley {name}", joint=line))
        closures.append(Coincidence(f"cable {name}", (0.0,) * len(exit_), PLATFORM, point))
    links.append(build_platform(robot))
    return Mechanism(
        robot.name, links, closures, robot.cables, robot.operational, planar=robot.planar,
        characteristic_length=robot.length_scale,
    )  # fmt: skip


def build_robot(robot: CableRobot) -> Robot:
    """Build the machine for scenes and planning, with the cables as bodies."""
    return Robot(
        robot.mechanism,
        home=_home_values(robot),
        shapes={link: s for link, s in (("base", robot.frame), (PLATFORM, robot.solids)) if s},
        limits=_limits(robot),
        masses={PLATFORM: robot.mass},
        centres={PLATFORM: robot.centre.tolist()},
        cables=build_bodies(robot),
        tool=None if robot.tool is None else (PLATFORM, robot.tool),
        source=robot.source,
    )


def build_bodies(robot: CableRobot) -> tuple[Cable, ...]:
    """Build the cables as bodies of a scene, from exit to attachment."""
    ends = zip(robot.cables, robot.exits_in_space(), robot.attachments_in_space(), robot.radius, strict=True)
    return tuple(
        Cable(
            link_A="base", point_A=exit_.tolist(), link_B=PLATFORM, point_B=point.tolist(), radius=float(radius),
            ignore=robot.ignore, name=name if name.startswith("cable") else f"cable {name}",
        )
        for name, exit_, point, radius in ends
    )  # fmt: skip


def _home_ends(robot: CableRobot) -> Array:
    """Give the vectors from exits to attachments at home [m], shape (n, 3)."""
    R = np.eye(3)
    turns = {m.name: m.axis for m in build_platform(robot).motions if m.kind == "angle"}
    for coordinate, axis in ({"theta": "z"} if robot.planar else turns).items():
        R = R @ np.asarray(rotation_about(axis, robot.home[coordinate]))
    origin = np.array([robot.home["x"], robot.home["y"], robot.home.get("z", 0.0)])
    return np.asarray(origin + robot.attachments_in_space() @ R.T - robot.exits_in_space())


def _home_values(robot: CableRobot) -> dict[str, float]:
    values = dict(robot.home)
    for name, end in zip(robot.cables, _home_ends(robot), strict=True):
        values[name] = float(np.linalg.norm(end))
        if robot.planar:
            values[f"pulley {name}"] = math.atan2(end[1], end[0])
    return values


def _limits(robot: CableRobot) -> Limits:
    def by_name(values: Any) -> dict[str, float]:
        return {} if values is None else dict(zip(robot.cables, map(float, values), strict=True))

    return Limits(velocity=by_name(robot.velocity), acceleration=by_name(robot.acceleration), jerk=by_name(robot.jerk))
