"""The free choices of a gait: orders of the feet compared, and what uncertain masses cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from paraopt.errors import InfeasibleError
from paraopt.modes.legged.balance import measure_worst_support
from paraopt.modes.legged.gait import GaitAim, find_gait, list_orders
from paraopt.modes.legged.gait_build import DOWN
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_motion import Gait
from paraopt.modes.legged.gait_options import GaitOptions
from paraopt.modes.legged.gait_steps import build_walk
from paraopt.modes.legged.supports import Support


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
    aim: GaitAim | None = None,
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
    aim = aim or GaitAim()
    orders = list_orders(model.machine.names, cyclic=not ends) if orders is None else orders
    found: list[GaitChoice] = []
    for order in orders:
        falls = build_walk(model, support, order, step, lift, heading, ends)
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

    Args:
        gait: The gait.
        spread: Largest share by which a mass is wrong [1].
        count: Number of instants of each phase.

    Returns:
        The margin [m], at the instants.

    Raises:
        DefinitionError: The share is not in [0, 1).
    """
    return min(
        float(np.min(measure_worst_support(gait.model.machine, looked.X, gait.standing(phase), spread, gait.gravity)))
        for phase, looked in zip(gait.phases, gait.sample(count), strict=True)
    )
