"""From a task to one planning problem for each phase, all on the same mechanism, each beginning where the last ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError, ParaoptError
from paraopt.kinematics import Configuration
from paraopt.kinematics.ranks import RANK_TOLERANCE, null_space
from paraopt.modes.legged.balance import SupportPolygon, build_polygon, measure_centre
from paraopt.modes.legged.conditions import StabilityCondition
from paraopt.modes.legged.machine import find_motions
from paraopt.modes.legged.supports import measure_height
from paraopt.modes.legged.task import LeggedTask, Phase
from paraopt.planning import Problem
from paraopt.scene import Scene

Array = NDArray[np.float64]
_T = TypeVar("_T")


@dataclass(frozen=True)
class PhaseTolerances:
    """State what is forgiven where phases meet.

    Attributes:
        continuity: Largest difference between a stated value and that with which the phase before ends [m or rad].
        support: Largest distance of a standing foot from its support [m], and angle from the support's normal [rad].
    """

    continuity: float = 1e-9
    support: float = 1e-6


def build_problems(task: LeggedTask, tolerances: PhaseTolerances | None = None) -> tuple[Problem, ...]:
    """Build the planning problem of every phase.

    Standing feet and locked joints are held, the phase's coordinates move, the centre of gravity stays over the feet
    and lifted feet stay over the ground. All problems share the robot, so that its functions are compiled once.

    Args:
        task: The task.
        tolerances: What is forgiven where phases meet.

    Returns:
        One problem for each phase; it starts at the goal configuration of the one before.

    Raises:
        DefinitionError: A stated value differs from that with which the phase before ends.
        InfeasibleError: A goal is out of reach, a foot that is to stand does not touch its support, the centre of
            gravity is not over the standing feet, a lock leaves another motion than the phase asks for. The message
            names the phase, the foot and the value.
    """
    tolerances = tolerances or PhaseTolerances()
    here = solve_start(task)
    problems: list[Problem] = []
    for phase in task.phases:
        check_continuity(task, phase, here, tolerances)
        problem = name_phase(phase, task, partial(build_problem, task, phase, here))
        check_stance(task, phase, here, tolerances, "at the start")
        check_lock(task, phase, problem)
        here = reach_goal(task, phase, problem)
        check_stance(task, phase, here, tolerances, "at the goal")
        problems.append(problem)
    return tuple(problems)


def solve_start(task: LeggedTask) -> Configuration:
    """Solve the configuration in which a task begins.

    Raises:
        DefinitionError: The task names a variable that is not operational.
        InfeasibleError: It is out of reach.
    """
    if isinstance(task.start, Configuration):
        return task.start
    robot = task.machine.robot
    home = {name: robot.home[name] for name in robot.mechanism.operational}
    stated = {**home, **task.start}
    if task.start:
        return Problem(_scene(task), start=stated, goal=stated, limits=task.limits).start_configuration
    return robot.home_configuration


def build_problem(task: LeggedTask, phase: Phase, start: Configuration) -> Problem:
    """Build the planning problem of one phase.

    Args:
        task: The task.
        phase: The phase.
        start: Where it starts.

    Returns:
        The problem, whose goal is the phase's: coordinates that it leaves out come back to where they started.
    """
    goal = {name: start[name] for name in phase.coordinates}
    if phase.curve is not None:
        goal.update(zip(phase.coordinates, np.asarray(phase.curve(1.0)).tolist(), strict=True))
    goal.update(phase.goal)
    return Problem(
        _scene(task),
        start=start,
        goal=goal,
        margins=task.margins,
        limits=task.limits,
        coordinates=phase.coordinates,
        held=phase.held(task.machine),
        conditions=build_conditions(task, phase, start),
    )


def build_conditions(task: LeggedTask, phase: Phase, start: Configuration) -> tuple[StabilityCondition, ...]:
    """Build what a phase must keep: the centre of gravity within each edge of the support polygon."""
    if phase.stability is None or not phase.standing:
        return ()
    polygon = find_polygon(task, phase, start)
    if len(polygon.corners) < 3:
        return ()  # refused as a stance
    # an edge is out of sight of the barrier at a good share of the polygon's size
    size = float(np.max(np.linalg.norm(polygon.points - polygon.points.mean(axis=0), axis=1)))
    return (StabilityCondition(task.machine, polygon, phase.stability, horizon=0.2 * size),)


def find_polygon(task: LeggedTask, phase: Phase, start: Configuration) -> SupportPolygon:
    """Build the support polygon of the feet that stand in a phase."""
    return build_polygon(task.machine, start.X, phase.standing, task.down)


def check_continuity(task: LeggedTask, phase: Phase, here: Configuration, tolerances: PhaseTolerances) -> None:
    """Refuse values that a phase states at its beginning and that are not those where the phase before ends.

    Raises:
        DefinitionError: The message names the phase, the variable, its foot and both values.
    """
    stated = [(name, value, "starts with") for name, value in phase.start.items()]
    if isinstance(phase.locked, Mapping):
        stated += [(name, value, "locks") for name, value in phase.locked.items()]
    if phase.curve is not None:
        first = np.asarray(phase.curve(0.0)).tolist()
        stated += [(n, v, "has a curve that begins with") for n, v in zip(phase.coordinates, first, strict=True)]
    for name, value, what in stated:
        if not abs(here[name] - value) <= tolerances.continuity:
            unit = here.mechanism.variables[here.mechanism.index(name)].unit
            raise DefinitionError(
                f"phase {phase.name!r} {what} {name!r}{_of_foot(task, name)} at {value:.9g} {unit}, but the machine "
                f"arrives with {here[name]:.9g} {unit}; they must agree to {tolerances.continuity:g} {unit}",
                phase=phase,
                configuration=here,
            )


def check_stance(task: LeggedTask, phase: Phase, here: Configuration, tolerances: PhaseTolerances, when: str) -> None:
    """Refuse a stance whose feet do not touch their support, or that tips over.

    Raises:
        InfeasibleError: The message names the phase, the foot and the height or the support margin.
    """
    machine = task.machine
    _, contacts = machine.contacts(here.X)
    uprights = machine.uprights(here.X)
    for k, name in enumerate(machine.names):
        height = float(measure_height(task.support, contacts[0, k]))
        if name not in phase.standing:
            if not height >= -tolerances.support:
                raise InfeasibleError(
                    f"phase {phase.name!r}: {when} the lifted foot {name!r} is {-1e3 * height:.3f} mm in "
                    f"{task.support.name!r}; keep it above",
                    phase=phase, foot=name, height=height, configuration=here,
                )  # fmt: skip
            continue
        if not abs(height) <= tolerances.support:
            where = "above" if height > 0 else "below"
            raise InfeasibleError(
                f"phase {phase.name!r}: foot {name!r} is to stand {when}, but is {1e3 * abs(height):.3f} mm {where} "
                f"{task.support.name!r} (up to {1e3 * tolerances.support:g} mm are allowed); let it come down before",
                phase=phase, foot=name, height=height, configuration=here,
            )  # fmt: skip
        if machine.foot(name).upright is not None:
            normal = task.support.tangent_plane(contacts[0, k])[1]
            lean = float(np.arctan2(np.linalg.norm(np.cross(uprights[0, k], normal)), uprights[0, k] @ normal))
            if not lean <= tolerances.support:
                raise InfeasibleError(
                    f"phase {phase.name!r}: foot {name!r} is to stand {when}, but leans {np.degrees(lean):.4f} degrees "
                    f"from the normal of {task.support.name!r} there; set it down flat",
                    phase=phase, foot=name, lean=lean, configuration=here,
                )  # fmt: skip
    if phase.stability is None:
        return
    if not phase.standing:
        raise InfeasibleError(
            f"phase {phase.name!r}: no foot stands, and a support margin of {1e3 * phase.stability:.3g} mm is asked; "
            "let feet stand, or ask for no margin (stability=None)",
            phase=phase,
        )
    polygon = find_polygon(task, phase, here)
    margin = float(polygon.margin(measure_centre(machine, here.X))[0])
    if not margin >= phase.stability - 1e-9 or len(polygon.corners) < 3:
        few = "" if len(polygon.corners) > 2 else "; its polygon is a line, and no pose stands on it without falling"
        raise InfeasibleError(
            f"phase {phase.name!r} {_lifting(task, phase)}: {when} the support margin over feet "
            f"{list(phase.standing)} is {1e3 * margin:.3f} mm, {1e3 * phase.stability:.3g} mm is asked{few}; shift the "
            "trunk away from the lifted foot before, or tilt the support less",
            phase=phase, feet=phase.lifted(machine), margin=margin, configuration=here, polygon=polygon,
        )  # fmt: skip


def check_lock(task: LeggedTask, phase: Phase, problem: Problem) -> None:
    """Refuse a phase whose held variables leave other motions than those of its coordinates.

    Raises:
        InfeasibleError: The message names the phase, what is held, and the margin or the number of motions that is
            wrong.
    """
    kinematics, start = problem.robot.kinematics, problem.start_configuration
    mechanism, coordinates = kinematics.mechanism, list(phase.coordinates)
    # a coordinate that no closure ties, such as the turn of a foot about its own point, moves by itself
    still = {*problem.held, *kinematics.idle} - set(coordinates)
    free = [i for i, v in enumerate(mechanism.variables) if v.name not in still]
    (E,) = kinematics.functions.scaled_jacobian(start.X)
    motions = null_space(E[:, free])
    # a rod that turns about its own axis counts for nothing
    inner = [i for i in free if mechanism.variables[i].role == "passive" and mechanism.names[i] not in coordinates]
    left, wanted = motions.shape[1] - null_space(E[:, inner]).shape[1], len(coordinates)
    stand = f"feet {list(phase.standing)} stand" + (f" and {list(phase.locked)} are locked" if phase.locked else "")
    told = f"phase {phase.name!r} {_lifting(task, phase)}: while {stand}, "
    rows = motions[[free.index(i) for i in mechanism.indices(coordinates)]]
    _, sizes, ways = np.linalg.svd(rows)
    smallest = float(sizes[wanted - 1]) if len(sizes) >= wanted else 0.0
    evidence = {"phase": phase, "mobility": left, "margin": smallest, "configuration": start}
    if left < wanted:
        raise InfeasibleError(
            f"{told}{left or 'no'} motions are left, but {wanted} coordinates {coordinates} are to move; lock less, "
            "or move fewer",
            **evidence,
        )
    asked = problem.margins.singularity
    if left > wanted or not smallest >= asked:
        way = np.abs(motions @ ways[-1])
        loose = [mechanism.names[free[i]] for i in np.argsort(-way)[:3]]
        rank = int(np.count_nonzero(sizes > RANK_TOLERANCE))
        what = "can move by themselves" if rank < left else "move far while the coordinates hardly do"
        raise InfeasibleError(
            f"{told}the coordinates {coordinates} determine {rank} of {left} motions, with a smallest singular value "
            f"of {smallest:.2g} ({asked:g} is asked): {loose} {what}; begin at another pose, or lock other joints",
            **evidence,
            loose=tuple(loose),
        )


def reach_goal(task: LeggedTask, phase: Phase, problem: Problem) -> Configuration:
    """Solve the configuration in which a phase ends.

    Raises:
        InfeasibleError: It is out of reach, or out of a range; the message names the phase, the foot that does not
            reach its place, by how much, and the joints at the ends of their ranges.
    """
    mechanism = problem.robot.mechanism
    try:
        goal = problem.goal_configuration
    except InfeasibleError as error:
        raise InfeasibleError(_explain_reach(task, phase, problem, None), phase=phase, **error.evidence) from error
    low, high = problem.bounds.bounds(mechanism)
    beyond = np.maximum(low - goal.X, goal.X - high) / problem.robot.kinematics.graph.variable_scale
    beyond[mechanism.indices(problem.robot.kinematics.idle)] = -np.inf
    worst = int(np.argmax(beyond))
    if beyond[worst] > 1e-9:
        raise InfeasibleError(
            _explain_reach(task, phase, problem, worst, goal), phase=phase, configuration=goal,
            variable=mechanism.names[worst],
        )  # fmt: skip
    return goal


def name_phase(phase: Phase, task: LeggedTask, act: Callable[[], _T], stage: str = "") -> _T:
    """Run a stage of one phase; its failures are told with the phase and the feet it lifts, evidence included."""
    try:
        return act()
    except ParaoptError as error:
        doing = f" ({stage})" if stage else ""
        evidence = {**error.evidence, "phase": phase}
        raise type(error)(f"phase {phase.name!r} {_lifting(task, phase)}{doing}: {error}", **evidence) from error


def _explain_reach(
    task: LeggedTask, phase: Phase, problem: Problem, worst: int | None, goal: Configuration | None = None
) -> str:
    """Say how far a lifted foot stays from its place while all else is where it should be."""
    machine, mechanism = task.machine, problem.robot.mechanism
    lifted = [n for n in phase.lifted(machine) if set(machine.foot(n).variables) <= set(phase.coordinates)]
    start = problem.start_configuration
    goal_values = {name: problem.goal[name] for name in problem.stated}
    wanted = {**{name: start[name] for name in problem.held}, **goal_values}
    soft = {name for foot in lifted for name in machine.foot(foot).variables}
    hard = [name for name in wanted if name not in soft]
    bounds = problem.bounds.bounds(mechanism)
    told = f"phase {phase.name!r} {_lifting(task, phase)}: "
    if worst is not None and goal is not None:
        unit = mechanism.variables[worst].unit
        told += (
            f"the goal is out of the range of {mechanism.names[worst]!r}{_of_leg(task, mechanism.names[worst])}: "
            f"{goal.X[worst]:.6g} {unit} is not in "
            f"[{bounds[0][worst]:.6g}, {bounds[1][worst]:.6g}] {unit}"
        )
    else:
        told += "the goal is out of reach"
    nearest = problem.robot.kinematics.fit(wanted, start, dict.fromkeys(hard, 100.0))
    if lifted:
        there = start.X.copy()
        there[mechanism.indices(wanted)] = list(wanted.values())
        gaps = np.linalg.norm(machine.contacts(there)[1][0] - machine.contacts(nearest.X)[1][0], axis=1)
        gap = {foot: float(gaps[machine.names.index(foot)]) for foot in lifted}
        if any(value > 1e-6 for value in gap.values()):
            told += "; " + ", ".join(
                f"foot {foot!r} stays {1e3 * value:.1f} mm from its place" for foot, value in gap.items()
            )
    if nearest.at_bound:
        told += f"; at the end of their ranges are {list(nearest.at_bound)}"
    return told + "; bring the trunk nearer, take a shorter step, or widen the range"


def _lifting(task: LeggedTask, phase: Phase) -> str:
    """Say which feet a phase lifts."""
    lifted = phase.lifted(task.machine)
    if not lifted:
        return "(all feet stand)"
    return f"(lifting {', '.join(map(repr, lifted))})"


def _of_foot(task: LeggedTask, name: str) -> str:
    owner = next((foot.name for foot in task.machine.feet if name in foot.variables), None)
    return "" if owner is None else f" of foot {owner!r}"


def _of_leg(task: LeggedTask, name: str) -> str:
    """Say to which leg a joint belongs, if to one."""
    owners = [foot.name for foot in task.machine.feet if name in find_motions(task.machine.robot.mechanism, foot.link)]
    return f" in the leg of foot {owners[0]!r}" if len(owners) == 1 else ""


def _scene(task: LeggedTask) -> Scene:
    return task.scene or Scene(task.machine.robot)
