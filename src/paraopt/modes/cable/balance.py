"""From a cable robot to a machine whose closures hold its balance, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from paraopt.errors import DefinitionError, unknown_name
from paraopt.mechanism import Equilibrium, Mobile, Tension
from paraopt.modes.cable.model import PLATFORM, CableRobot
from paraopt.robot import Robot
from paraopt.spatial import transform


def name_tension(cable: str) -> str:
    """Give the name of the variable that holds the tension of a cable."""
    return f"tension {cable}"


def build_hanging(robot: CableRobot, operational: Sequence[str] | None = None) -> Robot:
    """Build the machine of a cable robot with its balance among the closures.

    Tensions become variables and balance becomes equations, so that there are as many independent coordinates as
    cables: with fewer cables than freedoms some coordinates of the pose, the others follow from the weight; with more
    cables all of the pose and some tensions. Everything that solves, differentiates and plans then does so through
    equilibria. Those that it follows need not be stable: see `judge_stability`.

    Args:
        robot: The cable robot; its cables leave through eyes, not over pulleys.
        operational: The independent coordinates, as many as cables: coordinates of the pose, and tensions by
            `name_tension`; those of the robot when None.

    Returns:
        The machine.

    Raises:
        DefinitionError: There are not as many independent coordinates as cables, or there are pulleys.
        UnknownNameError: A coordinate does not exist.

    Source: CarricatoMerlet2013.
    """
    chosen = tuple(robot.operational if operational is None else operational)
    tensions = [name_tension(c) for c in robot.cables]
    if len(chosen) != robot.n_cables:
        raise DefinitionError(
            f"{robot.name!r} has {robot.n_cables} cables and {len(chosen)} independent coordinates {list(chosen)}; "
            f"with its balance it has as many as cables: choose among {[*robot.coordinates, *tensions]}"
        )
    if robot.pulleys is not None and any(p is not None for p in robot.pulleys):
        raise DefinitionError(
            f"{robot.name!r} has pulleys, and its mechanism straight cables from exit to attachment; replace the "
            "pulleys by eyes, or ask `find_equilibrium`, which lays the cables over them"
        )
    n = 2 if robot.planar else 3
    load = np.zeros(6)
    load[[0, 1, 5] if robot.planar else slice(None)] = robot.load
    pulls = [
        Tension(t, "base", exit_[:n], PLATFORM, point[:n], (low, high))
        for t, exit_, point, low, high in zip(
            tensions, robot.exits_in_space().tolist(), robot.attachments_in_space().tolist(),
            robot.t_min.tolist(), robot.t_max.tolist(), strict=True,
        )
    ]  # fmt: skip
    balance = Equilibrium(
        PLATFORM, pulls, mass=robot.mass, centre=robot.centre.tolist(), force=load[:3].tolist(),
        moment=load[3:].tolist(), gravity=robot.gravity.tolist(),
        reference_force=None if robot.weight or np.any(load[:3]) else float(np.max(robot.t_max)),
    )  # fmt: skip
    plain = robot.robot
    mechanism = replace(plain.mechanism, closures=(*plain.mechanism.closures, balance), operational=chosen)
    even = max(balance.scale / robot.n_cables, float(np.min(robot.t_min)))
    home = {**plain.home, **dict.fromkeys(tensions, even)}
    return replace(plain, mechanism=mechanism, home=home)


def read_hanging(robot: Robot, cables: Sequence[str] | None = None) -> CableRobot:
    """Read the cable robot that a machine with an `Equilibrium` describes, to find its equilibria by energy.

    Args:
        robot: The machine; one link of it is in balance under cables from the base.
        cables: Names of the variables that are the lengths of the cables, in the order of the tensions: the cables bear
            their names, and have their limits of speed and acceleration. Names of the tensions, without limits, when
            None.

    Returns:
        The cable robot.

    Raises:
        DefinitionError: There is not one equilibrium of a free link under cables from the base, or there are more or
            fewer names than cables.
        UnknownNameError: A name is none of the machine's actuators.
    """
    mechanism = robot.mechanism
    found = [c for c in mechanism.constraints if isinstance(c, Equilibrium)]
    base = mechanism.base
    if len(found) != 1:
        raise DefinitionError(f"{robot.name!r} has {len(found)} equilibria; it must have one to be a hanging platform")
    balance = found[0]
    link = mechanism.link(balance.link)
    if not isinstance(link, Mobile) or len(link.motions) != (3 if mechanism.planar else 6):
        raise DefinitionError(f"{balance.link!r} of {robot.name!r} is not a free link; only a free platform hangs")
    ends = [{t.link_A: t.point_A, t.link_B: t.point_B} for t in balance.tensions]
    for tension, points in zip(balance.tensions, ends, strict=True):
        if set(points) != {base.name, link.name}:
            raise DefinitionError(f"tension {tension.name!r} of {robot.name!r} is not between base and {link.name!r}")
    if any(balance.at):
        raise DefinitionError(
            f"the force in {balance.name!r} acts at {balance.at} m; only at the origin of {link.name!r} is it a load"
        )
    names = [t.name for t in balance.tensions]
    limits: dict[str, Any] = {}
    if cables is not None:
        names = list(cables)
        if unknown := [c for c in names if c not in mechanism.active]:
            raise unknown_name(f"length of a cable of {robot.name!r}", unknown[0], mechanism.active)
        for key in ("velocity", "acceleration"):
            bounds = robot.limits.of(key, names)
            limits[key] = bounds.tolist() if np.all(np.isfinite(bounds)) else None
    n = 2 if mechanism.planar else 3
    X_WB = transform(base.at, base.rotation)
    exits = [(X_WB[:3, :3] @ np.array(p[base.name]) + X_WB[:3, 3])[:n] for p in ends]
    load = np.array([*balance.force, *balance.moment])
    free = {m.name.removeprefix(link.prefix): m.name for m in link.motions}
    return CableRobot(
        name=robot.name, exits=exits, attachments=[p[link.name][:n] for p in ends], mass=balance.mass,
        t_min=[t.range[0] for t in balance.tensions], t_max=[t.range[1] for t in balance.tensions],
        home={c: robot.home.get(name, 0.0) for c, name in free.items()}, centre=balance.centre, planar=mechanism.planar,
        gravity=balance.gravity, load=load[[0, 1, 5]] if mechanism.planar else load,
        cables=names, order=link.order, source=robot.source, **limits,
    )  # fmt: skip
