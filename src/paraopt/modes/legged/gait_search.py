"""The free choices of a gait: orders of the feet compared, and what uncertain masses cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.modes.legged.balance import level_axes
from paraopt.modes.legged.gait import DOWN, Aim, find_gait, list_orders
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_motion import Gait
from paraopt.modes.legged.gait_options import GaitOptions
from paraopt.modes.legged.gait_steps import plan_walk
from paraopt.modes.legged.supports import Support

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GaitChoice:
    """Hold what one order of the feet gives.

    Attributes:
        order: Names of the feet in the order in which they are lifted.
        gait: The best gait of that order; None where there is none.
        margin: Its smallest support margin, between the samples too [m]; -inf without a gait.
        speed: Its speed under the law from rest to rest [m/s]; zero without a gait.
        refusal: Why there is none, empty where there is one.
    """

    order: tuple[str, ...]
    gait: Gait | None
    margin: float
    speed: float
    refusal: str = ""


def compare_orders(
    model: GaitModel,
    support: Support,
    orders: Sequence[Sequence[str]] | None = None,
    step: float = 0.06,
    lift: float = 0.02,
    heading: float = 0.0,
    ends: bool = False,
    options: GaitOptions | None = None,
    gravity: ArrayLike = DOWN,
    aim: Aim | None = None,
) -> tuple[GaitChoice, ...]:
    """Find the best gait of every order of the feet.

    Args:
        model: The machine.
        support: What it stands on.
        orders: The orders; when None all of them, up to where the cycle begins where it stands alone.
        step: Length of a step, before it is scaled [m].
        lift: Height to which a foot is lifted [m].
        heading: Direction of the walk from the trunk's x towards y [rad].
        ends: Whether the walk has a start and an end; else the cycle stands alone.
        options: What may move.
        gravity: Direction of gravity.
        aim: What is best.

    Returns:
        A choice for each order, best first: by margin or by speed, as the aim says.
    """
    aim = aim or Aim()
    orders = list_orders(model.machine.names, cyclic=not ends) if orders is None else orders
    found: list[GaitChoice] = []
    for order in orders:
        falls = plan_walk(model, support, order, step, lift, heading, ends)
        try:
            gait = find_gait(falls, options, gravity, aim)
        except InfeasibleError as error:
            found.append(GaitChoice(tuple(order), None, -np.inf, 0.0, str(error)))
            continue
        looked = gait.sample()
        found.append(GaitChoice(tuple(order), gait, min(each.bound for each in looked), gait.speed(looked)))
    # ties, such as of mirrored orders, stay in the order of the list
    return tuple(sorted(found, key=lambda c: -round(c.margin if aim.best == "margin" else c.speed, 6)))


def measure_mass_margin(gait: Gait, spread: float = 0.1, count: int = 81) -> float:
    """Give the smallest support margin when every mass may be wrong by a share, each for itself.

    Over an edge the distance of the centre of gravity is `sum m_i d_i / sum m_i`, d_i being that of link i. Its least
    value over a box of masses has the links below it as heavy as they can be and those above it as light: with the
    links sorted by d_i it is the least over where the sorted list is cut, so that the worst case is exact.

    Args:
        gait: The gait.
        spread: Largest share by which a mass is wrong [1].
        count: Number of instants of each phase.

    Returns:
        The margin [m], at the instants.

    Raises:
        DefinitionError: The share is not in [0, 1).
    """
    if not 0.0 <= spread < 1.0:
        raise DefinitionError(f"share by which masses are wrong is {spread}; it must be in [0, 1)")
    machine = gait.model.machine
    masses, centres = dict(machine.masses or {}), dict(machine.centres or {})
    names = [link.name for link in machine.robot.mechanism.links]
    index = [names.index(link) for link in masses]
    points = np.array([[*centres.get(link, (0.0, 0.0, 0.0)), 1.0] for link in masses])
    m = np.array(list(masses.values()))
    axes = level_axes(gait.gravity)
    least = np.inf
    for phase, looked in zip(gait.phases, gait.sample(count), strict=True):
        polygon = gait.polygon(phase)
        poses = machine.robot.kinematics.functions.poses.batch(looked.X)[0].reshape(len(looked.X), -1, 3, 4)[:, index]
        p = np.einsum("nlij,lj->nli", poses, points)
        corners = polygon.points @ axes.T
        steps = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1)[:, None]
        d = (p @ axes.T) @ normals.T - np.sum(normals * corners, axis=1)  # (n, links, edges)
        order = np.argsort(d, axis=1)
        d, mass = np.take_along_axis(d, order, axis=1), m[order]
        heavy, light = (1.0 + spread) * mass, (1.0 - spread) * mass
        moment = np.cumsum(heavy * d, axis=1) + np.sum(light * d, axis=1, keepdims=True) - np.cumsum(light * d, axis=1)
        total = np.cumsum(heavy, axis=1) + np.sum(light, axis=1, keepdims=True) - np.cumsum(light, axis=1)
        least = min(least, float(np.min(moment / total)))
    return least
