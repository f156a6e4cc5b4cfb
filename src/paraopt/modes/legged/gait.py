"""Gaits found by optimisation: the trunk's way that keeps the machine farthest from tipping over, or is run fastest."""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.modes.legged.balance import level_axes
from paraopt.modes.legged.gait_build import DOWN, build_gait, close_legs
from paraopt.modes.legged.gait_fault import explain_fault, find_fault, name_worst
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_motion import Gait, PhaseSamples
from paraopt.modes.legged.gait_options import GaitOptions
from paraopt.modes.legged.gait_program import Answer, GaitProgram, ProgramShape
from paraopt.modes.legged.gait_steps import Footfalls
from paraopt.modes.legged.gait_table import PhaseTable, run_law
from paraopt.spatial import finite_vector

Array = NDArray[np.float64]

# one program per machine and shape: building it costs more than running it
_programs: weakref.WeakKeyDictionary[GaitModel, dict[tuple[ProgramShape, GaitOptions], GaitProgram]] = (
    weakref.WeakKeyDictionary()
)


@dataclass(frozen=True)
class GaitAim:
    """State what a gait is found for.

    Attributes:
        best: "margin" for the largest smallest support margin, "speed" for the shortest time of the steps.
        margin: Smallest support margin that a fast gait keeps [m].
        pace: Longest time of a cycle, or of the whole gait where there is none, over the factor of the steps [s]; for
            the largest margin at some speed.
        scale: Least and largest factor of the steps, where they may be scaled.

    Raises:
        DefinitionError: A number is outside its range.
    """

    best: Literal["margin", "speed"] = "margin"
    margin: float = 0.005
    pace: float | None = None
    scale: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self) -> None:
        if self.best not in ("margin", "speed"):
            raise DefinitionError(f"a gait is best in {self.best!r}; it must be 'margin' or 'speed'")
        if not np.isfinite(self.margin):
            raise DefinitionError(f"support margin of the aim is {self.margin!r} m; it must be finite")
        if self.pace is not None and not (np.isfinite(self.pace) and self.pace > 0):
            raise DefinitionError(f"pace of the aim is {self.pace!r} s; it must be finite and above 0, or None")
        low, high = self.scale
        if not 0 < low <= high < np.inf:
            raise DefinitionError(f"factors of the steps are {self.scale}; they must be 0 < least <= largest")

    @property
    def is_timed(self) -> bool:
        """Tell whether time is part of the aim."""
        return self.best == "speed" or self.pace is not None


def find_gait(
    falls: Footfalls, options: GaitOptions | None = None, gravity: ArrayLike = DOWN, aim: GaitAim | None = None
) -> Gait:
    """Find the trunk's way for given footfalls.

    For the margin, a first program looks for the largest smallest support margin, a second one for the smallest motion
    that keeps nearly all of it. For speed, the times of the phases are found with the way. The gait is then looked at
    more densely, with the loops closed anew; where the margin dips between the samples they are doubled.

    Args:
        falls: Which foot is lifted when, and to where.
        options: What may move, and how it is looked at.
        gravity: Direction of gravity, in the frame of the footholds.
        aim: What is best.

    Returns:
        The gait.

    Raises:
        InfeasibleError: A foothold is out of reach, or a lift leaves no margin; the message names the phase, the foot
            and the value.

    Source: McGheeFrank1968; HettichKortanek1993, discretisation.
    """
    options, aim = options or GaitOptions(), aim or GaitAim()
    down = np.array(finite_vector(gravity, 3, "direction of gravity"))
    if not np.any(down):
        raise DefinitionError("direction of gravity is zero; it must be a direction")
    down = down / np.linalg.norm(down)
    samples, wanted = options.samples, aim
    least = max(options.least_margin, aim.margin) if aim.best == "speed" else options.least_margin
    best: Answer | None = None
    last: Answer | None = None
    for _ in range(options.refinements + 1):
        gait, best, last = _solve(falls, options, down, wanted, samples, best, last)
        looked = gait.sample((samples - 1) * options.density + 1)
        if gait.margin < least:
            break  # more samples only take away
        better: GaitAim | None = wanted
        if _find_excess(gait, looked, options) is None:
            better = _ask_for_more(gait, looked, aim, wanted, options)
        if better is None:
            break
        if better == wanted:
            samples, best, last = 2 * samples - 1, None, None
        wanted = better
    _check(gait, looked, options, least)
    return gait


def list_orders(names: Sequence[str], cyclic: bool = True) -> tuple[tuple[str, ...], ...]:
    """List the orders in which feet can be lifted, each once; up to where the cycle begins when `cyclic`."""
    if cyclic:
        return tuple((names[0], *rest) for rest in itertools.permutations(names[1:]))
    return tuple(itertools.permutations(names))


def _solve(
    falls: Footfalls,
    options: GaitOptions,
    down: Array,
    aim: GaitAim,
    samples: int,
    best: Answer | None,
    last: Answer | None,
) -> tuple[Gait, Answer, Answer]:
    """Solve the programs at some number of samples, from what was found for another aim where there is something.

    Returns:
        The gait, the answer of the largest margin, and the last answer.
    """
    axes = level_axes(down)
    table = PhaseTable.of(falls, down, options.swing_moves)
    shape = ProgramShape(
        len(falls.lifts), falls.cycle, falls.is_periodic, (True,) * (len(falls.lifts) + 1), samples,
        options.swing_moves, is_timed=False,
    )  # fmt: skip
    program = _program(falls.model, shape, options)
    s = run_law(program.tau)
    if best is None:
        best = _find_best(falls, table, program, axes, options)
    if aim.is_timed:
        answer = _solve_timed(falls, options, table, axes, aim, shape, best, last)
    else:
        least = best.margin - options.ease * abs(best.margin)
        calm = program.solve(
            falls, table, axes, best.joints, weights=(0.0, 0.0, 1.0), margin=(least, np.inf), guess=best
        )
        answer = calm if calm.violation <= 1e-6 else best
    gait = build_gait(falls, table, answer.control, answer.joints, s, down, answer.scale, answer.margin, answer.status)
    return gait, best, answer


def _find_best(falls: Footfalls, table: PhaseTable, program: GaitProgram, axes: Array, options: GaitOptions) -> Answer:
    """Find the largest smallest margin."""
    joints = close_legs(falls, table, table.nominal, run_law(program.tau), must=False)
    low, high = falls.model.joint_range
    # where the nominal way is out of reach, each foothold is asked for alone before the whole is tried
    if not np.all((joints >= low) & (joints <= high)):
        fault = find_fault(falls, table, options)
        if fault is not None:
            raise fault
    best = program.solve(falls, table, axes, np.nan_to_num(joints), weights=(1.0, 0.0, options.motion_weight))
    if best.violation > 1e-5:
        raise explain_fault(falls, table, options, best.violation * program.unit, best.status)
    return best


def _ask_for_more(
    gait: Gait, looked: Sequence[PhaseSamples], aim: GaitAim, wanted: GaitAim, options: GaitOptions
) -> GaitAim | None:
    """Say what to ask of the program so that the aim holds between its samples too; None where it does.

    The same aim as before asks for more samples.
    """
    bound = min(found.bound for found in looked)
    dip = gait.margin - bound
    if aim.best == "speed" and bound < aim.margin:
        return replace(wanted, margin=wanted.margin + 1.1 * (aim.margin - bound))
    if aim.pace is not None and wanted.pace is not None:
        first, last = gait.cycle if gait.cycle[1] > gait.cycle[0] else (0, len(gait.phases))
        pace = float(gait.times(looked)[first:last].sum()) / gait.scale
        if pace > 1.001 * aim.pace:
            return replace(wanted, pace=0.999 * wanted.pace * aim.pace / pace)
    return wanted if dip > options.dip else None


def _solve_timed(
    falls: Footfalls,
    options: GaitOptions,
    table: PhaseTable,
    axes: Array,
    aim: GaitAim,
    shape: ProgramShape,
    best: Answer,
    last: Answer | None,
) -> Answer:
    """Find way, times and, where allowed, the length of the steps; shifts that take no time are left out then."""
    if aim.best == "speed" and best.margin < aim.margin + options.dip:
        raise InfeasibleError(
            f"no gait keeps a support margin of {1e3 * aim.margin:.2f} mm: the largest is {1e3 * best.margin:.2f} mm; "
            "ask for less, or let the trunk move farther",
            margin=best.margin,
        )
    scale = aim.scale if falls.is_scalable else (1.0, 1.0)
    fast = aim.best == "speed"
    # what may be lost between the samples is kept on top
    margin = (aim.margin + options.dip, np.inf) if fast else (-np.inf, np.inf)
    weights = (0.0, 1.0, 1e-2) if fast else (1.0, 1e-3, 1e-2)
    pace = np.inf if aim.pace is None else aim.pace
    K = shape.n_phases
    repeat = np.ones(K)
    begin, end = shape.cycle_phases
    if not fast and end > begin:
        repeat = np.where((np.arange(K) >= begin) & (np.arange(K) < end), 1.0, 0.0)
    guess, used = best if last is None else last, replace(shape, is_timed=True)
    if not fast and last is None:  # fast enough first, then as far from the edges as that allows
        guess = _program(falls.model, used, options).solve(
            falls, table, axes, guess.joints, weights=(0.0, 1.0, 1e-2), scale=scale, repeat=repeat, guess=guess
        )
    for _ in range(2):
        program = _program(falls.model, used, options)
        answer = program.solve(
            falls, table, axes, guess.joints, weights=weights, margin=margin, scale=scale, slowest=pace,
            repeat=repeat, guess=guess,
        )  # fmt: skip
        if answer.violation > 1e-5:
            if used != replace(shape, is_timed=True):
                return guess  # a short shift is needed after all
            raise InfeasibleError(
                f"no gait was found that keeps what is asked, {aim}: constraints are missed by {answer.violation:.2g} "
                f"({answer.status})",
                answer=answer,
            )
        quick = [bool(answer.times[2 * i] > 2 * options.least_time) for i in range(len(used.shifts)) if 2 * i < K]
        shifts = (*(a and b for a, b in zip(used.shifts, quick, strict=False)), *used.shifts[len(quick) :])
        if shifts == used.shifts:
            break
        used, guess = replace(used, shifts=shifts), answer
    return answer


def _program(model: GaitModel, shape: ProgramShape, options: GaitOptions) -> GaitProgram:
    known = _programs.setdefault(model, {})
    key = (shape, options)
    if key not in known:
        known[key] = GaitProgram(model, shape, options)
    return known[key]


def _check(gait: Gait, looked: Sequence[PhaseSamples], options: GaitOptions, least: float) -> None:
    """Refuse a gait whose dense look shows too small a margin, a joint out of range, or a leg on another branch."""
    worst = int(np.argmin([found.bound for found in looked]))
    if looked[worst].bound < least:
        raise InfeasibleError(
            f"{name_worst(gait, looked, worst)}; at least {1e3 * least:.2f} mm are asked; choose "
            "another order or shorter steps, let the trunk move farther, or a smaller slope",
            gait=gait,
            phase=gait.phases[worst].name,
            margin=looked[worst].bound,
        )
    excess = _find_excess(gait, looked, options)
    if excess is not None:
        raise InfeasibleError(f"{excess} between the samples; raise `samples` or `refinements`", gait=gait)


def _find_excess(gait: Gait, looked: Sequence[PhaseSamples], options: GaitOptions) -> str | None:
    """Say which joint leaves its range, or which phase stretches a leg, at the denser samples; None where none does."""
    low, high = gait.model.joint_range
    index = gait.model.machine.robot.mechanism.indices(gait.model.joints)
    for phase, found in zip(gait.phases, looked, strict=True):
        q = found.X[:, index]
        excess = np.maximum(low - q, q - high)
        if np.max(excess) > 1e-9:
            joint = int(np.argmax(np.max(excess, axis=0)))
            return (
                f"phase {phase.name!r}: joint {gait.model.joints[joint]!r} leaves its range "
                f"[{low[joint]:.4g}, {high[joint]:.4g}] by {np.max(excess):.3g}"
            )
        if np.min(found.regularity) < 0.5 * options.regularity:
            return (
                f"phase {phase.name!r}: a leg is nearly stretched, its determinant is "
                f"{np.min(found.regularity):.3g} of that at rest"
            )
    return None
