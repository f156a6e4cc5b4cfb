"""Plan a walk: every phase by the same pipeline, on one mechanism; then one trajectory and one certificate."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError, RefineError
from paraopt.kinematics import Configuration
from paraopt.modes.legged.certificate import LeggedCertificate, LeggedTolerances, verify_legged
from paraopt.modes.legged.conditions import HeightCondition
from paraopt.modes.legged.phases import PhaseTolerances, build_problems, find_polygon, name_phase
from paraopt.modes.legged.task import LeggedTask, Phase
from paraopt.modes.legged.tipping import TippingConstraint
from paraopt.modes.legged.trajectory import LeggedTrajectory, PhaseMark
from paraopt.planning import (
    JerkLimited,
    Path,
    Problem,
    Refined,
    Retimer,
    RRTConnect,
    Seed,
    Seeder,
    SplineRefiner,
    TimeOptimal,
    Trajectory,
    Validity,
    Waypoint,
    check_ends,
)
from paraopt.planning.ground import Ground, Spot
from paraopt.planning.refine_check import check_densely
from paraopt.planning.seed.base import choose_step
from paraopt.planning.validity import VALID

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]
STAGES = ("prepare", "seed", "refine", "retime", "verify")


@dataclass(frozen=True, eq=False)
class PhasePlan:
    """Hold how one phase was planned.

    Attributes:
        phase: What was asked.
        problem: The planning problem made of it.
        seed: First way, through the places to pass; None for a phase that follows a given curve.
        refined: The path, with how it was reached.
        trajectory: The timed motion, in the phase's own time.
        retimer: What timed it.
    """

    phase: Phase
    problem: Problem
    seed: Seed | None
    refined: Refined
    trajectory: Trajectory
    retimer: Retimer


@dataclass(frozen=True, eq=False)
class LeggedPlan:
    """Hold a planned walk and what led to it.

    Attributes:
        task: What was asked.
        phases: How each phase was planned.
        trajectory: The motion through all phases.
        certificate: The independent verdict.
        timings: Seconds spent in each stage, over all phases.
        options: Options of the stages.
    """

    task: LeggedTask
    phases: tuple[PhasePlan, ...]
    trajectory: LeggedTrajectory
    certificate: LeggedCertificate
    timings: Mapping[str, float]
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """Say in a few lines what came out."""
        c = self.certificate
        worst_phase = max(self.trajectory.marks, key=lambda mark: mark.duration)
        lines = [
            f"{self.task.machine.robot.name}: {'certified' if c.passed else 'NOT certified'} motion of "
            f"{self.trajectory.duration:.3f} s in {len(self.phases)} phases, the longest {worst_phase.name!r} of "
            f"{worst_phase.duration:.3f} s",
        ]
        for name in (
            "support margin",
            "distance from tipping",
            "standing feet move",
            "locked joints move",
            "pose jumps",
        ):
            check = next((check for check in c.checks if check.name == name), None)
            if check is not None:
                lines.append(f"{name} {check.value:.4g} {check.unit} ({check.sense} {check.bound:g}), {check.where}")
        if self.task.tipping is None and np.isfinite(c.smallest_tipping):
            lines.append(f"distance from tipping {c.smallest_tipping:.4g} m with the inertia of what moves (not asked)")
        lines.append("seconds: " + ", ".join(f"{s} {self.timings[s]:.2f}" for s in STAGES if s in self.timings))
        return "\n".join(lines)


def plan_legged(
    task: LeggedTask,
    *,
    seeder: Seeder | None = None,
    refiner: SplineRefiner | None = None,
    retimer: Retimer | None = None,
    tolerances: PhaseTolerances | None = None,
    accept: LeggedTolerances | None = None,
    progress: Progress | None = None,
    allow_failed: bool = False,
) -> LeggedPlan:
    """Plan every phase of a task: seed, refine, retime, verify, with one compiled mechanism for all.

    A phase is seeded by the straight ways through its places to pass; a seeder is asked only where one is blocked.

    Args:
        task: What is asked.
        seeder: Finds ways where the straight one is blocked; `RRTConnect()` when None.
        refiner: Makes ways short and smooth; `SplineRefiner(controls=10)` when None.
        retimer: Times phases that do not say how; `choose_retimer(task)` when None.
        tolerances: What is forgiven where phases meet.
        accept: What the certificate forgives over all phases.
        progress: Called with the name of each finished phase and its seconds.
        allow_failed: Return a plan that its certificate contradicts, instead of raising.

    Returns:
        The plan, with its certificate.

    Raises:
        DefinitionError: The task contradicts itself; see `build_problems`.
        InfeasibleError: A phase cannot be; the message names the phase, the foot and the value.
        SolveError: A stage failed; the message names the phase, the evidence is attached.
        CertificateError: The certificate contradicts the plan, and `allow_failed` is not set.
    """
    seeder, refiner = seeder or RRTConnect(), refiner or SplineRefiner(controls=10)
    retimer = retimer or choose_retimer(task)
    timings = dict.fromkeys(STAGES, 0.0)

    def run(stage: str, phase: Phase, act: Callable[[], Any]) -> Any:
        begin = time.perf_counter()
        result = name_phase(phase, task, act, stage)
        timings[stage] += time.perf_counter() - begin
        return result

    begin = time.perf_counter()
    problems = build_problems(task, tolerances)
    timings["prepare"] = time.perf_counter() - begin
    plans: list[PhasePlan] = []
    for phase, problem in zip(task.phases, problems, strict=True):
        begin = time.perf_counter()
        how = run("retime", phase, partial(keep_upright, task, phase, problem, phase.retimer or retimer))
        seed: Seed | None = None
        if phase.curve is None:
            seed = run("seed", phase, partial(seed_phase, phase, problem, seeder))
            refined = run("refine", phase, partial(refine_phase, task, phase, problem, seed, refiner))
        else:
            refined = run("refine", phase, partial(follow_curve, task, phase, problem))
        trajectory = run("retime", phase, partial(how.retime, problem, refined.path))
        plans.append(PhasePlan(phase, problem, seed, refined, trajectory, how))
        if progress is not None:
            progress(phase.name, time.perf_counter() - begin)
    whole = join_phases(task, plans)
    begin = time.perf_counter()
    certificate = verify_legged(
        task,
        problems,
        whole,
        # ten times denser than whatever the refiner and the retimer looked at
        at_least=[10 * max(p.refined.n_samples, p.trajectory.n_grid) for p in plans],
        check_jerk=[p.retimer.bounds_jerk for p in plans],
        tolerances=accept,
    )
    timings["verify"] = time.perf_counter() - begin
    options = {"seeder": seeder, "refiner": refiner, "retimer": retimer}
    result = LeggedPlan(task, tuple(plans), whole, certificate, timings, options)
    if not allow_failed:
        certificate.check_passed()
    return result


def choose_retimer(task: LeggedTask) -> Retimer:
    """Choose a retimer: jerk-limited where every actuator has a jerk limit, else the fastest without one."""
    robot = task.machine.robot
    limits = robot.limits if task.limits is None else task.limits
    limited = np.isfinite(limits.of("jerk", robot.mechanism.active))
    # a phase is short: on the finer grid of long motions it would gain some 0.2 % for twice the effort
    return JerkLimited(n_grid=100, enough=1e-2) if bool(np.all(limited)) else TimeOptimal()


def keep_upright(task: LeggedTask, phase: Phase, problem: Problem, retimer: Retimer) -> Retimer:
    """Let a retimer count the inertia of what moves, where the task and the phase ask for it.

    Raises:
        DefinitionError: The retimer takes no constraints.
    """
    if task.tipping is None or phase.stability is None:
        return retimer
    if not isinstance(retimer, (JerkLimited, TimeOptimal)):
        raise DefinitionError(f"retimer {retimer!r} takes no constraints, and the task asks not to tip over in motion")
    polygon = find_polygon(task, phase, problem.start_configuration)
    constraint = TippingConstraint(task.machine, polygon, task.tipping)
    return replace(retimer, constraints=(*retimer.constraints, constraint))


def seed_phase(phase: Phase, problem: Problem, seeder: Seeder, resolution: float = 0.5) -> Seed:
    """Find a first way from start to goal through the places to pass.

    Args:
        phase: The phase.
        problem: Its problem.
        seeder: Finds the ways that are not straight.
        resolution: Distance between checked positions, as a share of the step that suits the problem [1].

    Returns:
        The seed; its corners are the places to pass, and those of ways round obstacles.

    Raises:
        InfeasibleError: An end or a place to pass is not valid, or no way exists.
    """
    validity = Validity(problem)
    check_ends(problem, validity)
    stops = _list_stops(phase, problem)
    lengths = np.linalg.norm(np.diff(stops, axis=0) * problem.metric, axis=1)
    step = choose_step(problem, float(np.max(lengths)))
    ground = Ground(problem, validity, resolution * step, max_checks=100_000)
    chain = [ground.origin]
    straight = VALID
    for k, stop in enumerate(stops[1:]):
        reason, last = ground.edge(chain[-1], stop)
        if last is not None:
            chain.append(last)
            continue
        straight = reason if straight == VALID else straight
        is_last = k + 2 == len(stops)
        goal = problem.goal_configuration if is_last else _solve_place(problem, validity, k + 1, stop)
        here = problem.robot.kinematics.configuration(chain[-1].X)
        found = seeder.seed(replace(problem, start=here, goal=goal))
        T = problem.space.tangent(found.X)
        chain += [Spot(v, X, t) for v, X, t in zip(found.points[1:], found.X[1:], T[1:], strict=True)]
    return Seed.along(ground, chain, step=step, straight_reason=straight)


def refine_phase(task: LeggedTask, phase: Phase, problem: Problem, seed: Seed, refiner: SplineRefiner) -> Refined:
    """Refine a seed, exactly through the places to pass, lifted feet over the ground."""
    waypoints = (*refiner.waypoints, *(Waypoint(values) for values in phase.via))
    constraints = (*refiner.constraints, *keep_feet_up(task, phase))
    return replace(refiner, waypoints=waypoints, constraints=constraints).refine(problem, seed)


def keep_feet_up(task: LeggedTask, phase: Phase) -> tuple[HeightCondition, ...]:
    """Build what keeps the lifted feet of a phase over the ground."""
    lifted = phase.lifted(task.machine)
    return (HeightCondition(task.machine, lifted, task.support),) if lifted else ()


def follow_curve(task: LeggedTask, phase: Phase, problem: Problem, count: int = 64) -> Refined:
    """Follow the given curve of a phase exactly.

    Args:
        task: The task.
        phase: The phase.
        problem: Its problem.
        count: Number of configurations that are kept along it; ten times as many are judged.

    Returns:
        The path.

    Raises:
        SolveError: The closures fail on the curve.
        RefineError: A bound does not hold on it; the message says which, and by how much.
    """
    if phase.curve is None:
        raise RefineError("there is no curve to follow")
    check_ends(problem, Validity(problem))
    start = problem.start_configuration.X
    path = Path.along(problem.robot, phase.coordinates, phase.curve, start, count, problem.held)
    violation = check_densely(problem, path, 10 * count, keep_feet_up(task, phase))
    if violation is not None:
        raise RefineError(f"the given curve breaks a bound: {violation.summary}", path=path, violation=violation)
    return Refined(path, path.length(problem.metric), 0, 0, 0.0, count, 0)


def join_phases(task: LeggedTask, plans: list[PhasePlan]) -> LeggedTrajectory:
    """Put the motions of all phases one after the other, with their marks."""
    marks: list[PhaseMark] = []
    clock = 0.0
    for plan in plans:
        phase, end = plan.phase, clock + plan.trajectory.duration
        lifted = phase.lifted(task.machine)
        marks.append(PhaseMark(phase.name, clock, end, tuple(phase.standing), lifted, tuple(phase.locked)))
        clock = end
    return LeggedTrajectory(task.machine.robot, [plan.trajectory for plan in plans], marks)


def _solve_place(problem: Problem, validity: Validity, k: int, stop: Array) -> Configuration:
    """Solve a place to pass through, or tell what is wrong there."""
    there = replace(problem, goal=dict(zip(problem.independent, stop.tolist(), strict=True)))
    try:
        check_ends(there, validity)
    except InfeasibleError as error:
        told = str(error).removeprefix("goal ")
        raise InfeasibleError(f"place {k} to pass through {told}", **error.evidence) from error
    return there.goal_configuration


def _list_stops(phase: Phase, problem: Problem) -> Array:
    """Give start, places to pass and goal in the independent coordinates, shape (k, m).

    What a place leaves out is taken from the straight way between start and goal.
    """
    start, goal = problem.start_configuration.X[problem.index], problem.goal_values()
    stops = [start]
    for k, values in enumerate(phase.via, start=1):
        stop = start + (goal - start) * (k / (len(phase.via) + 1))
        for name, value in values.items():
            stop[problem.independent.index(name)] = value
        stops.append(stop)
    return np.array([*stops, goal])
