"""The tripod: planning times beside the number of phases, closed forms beside the general solver."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from benchmarks.tables import count, duration, table
from benchmarks.timing import Rate, race

import paraopt as po
from paraopt.modes.legged import LeggedTask, PlaneSupport, plan_legged
from paraopt.modes.legged import tripod as tr

POSES = 1000
STAGES = ("prepare", "seed", "refine", "retime", "verify")


@dataclass(frozen=True)
class Planned:
    """Hold how long a task took to plan.

    Attributes:
        phases: Number of phases.
        locking: Time for the lock poses [s].
        stages: Times of the stages, over all phases [s].
        motion: Duration of the motion [s].
        smallest: Smallest singular value of the locks over all swings [1].
        tilt: The same from a tilt of 0.3 rad [1].
    """

    phases: int
    locking: float
    stages: dict[str, float]
    motion: float
    smallest: float
    tilt: float

    @property
    def total(self) -> float:
        return self.locking + sum(self.stages.values())


@dataclass(frozen=True)
class TripodResult:
    """Hold both measurements."""

    tasks: dict[str, Planned] = field(default_factory=dict)
    inverse: dict[str, Rate] = field(default_factory=dict)


def measure() -> TripodResult:
    """Plan a swing, a step and the scenario, after one plan that compiles; race the inverse models."""
    walker = po.robots.walking_tripod()
    _ = plan_task(walker, "swing")
    tasks = {name: plan_task(walker, name) for name in ("swing", "step", "scenario")}
    return TripodResult(tasks, race_inverse(walker))


def build_task(walker: tr.WalkingTripod, name: str) -> tuple[LeggedTask, tr.TripodStep]:
    """Build what `problems/tripod.py` does by default."""
    home, pose = walker.geometry.home_feet, walker.geometry.home_pose
    way = (0.08 if name == "swing" else 0.06, 0.0, 0.0)
    goals, support = tr.move_frames(home, way), PlaneSupport(walker.sole)
    if name == "scenario":
        works = [tr.follow_tool(tr.lean_round(0.03, 0.12, 0.2, at), (0.0, 0.0, -0.1)) for at in ((0, 0, 0), way)]
        return tr.build_scenario(walker, home, goals, works[0], works[1], support)
    step = tr.tripod_step(walker, pose, home, goals, order=(1,) if name == "swing" else tr.LEGS)
    return tr.build_step_task(step, support), step


def plan_task(walker: tr.WalkingTripod, name: str) -> Planned:
    """Plan one task; its certificate is passed, or this raises."""
    begin = time.perf_counter()
    task, step = build_task(walker, name)
    locking = time.perf_counter() - begin
    plan = plan_legged(task)
    tilt = min(tr.smallest_from_tilt(walker, leg.swing) for leg in step.legs)
    stages = {stage: plan.timings[stage] for stage in STAGES}
    return Planned(len(plan.phases), locking, stages, plan.trajectory.duration, step.smallest, tilt)


def race_inverse(walker: tr.WalkingTripod) -> dict[str, Rate]:
    """Race the closed forms against the general solver, on poses around home with feet on uneven ground."""
    rng = np.random.default_rng(0)
    poses = walker.geometry.home_pose + rng.uniform(-1, 1, (POSES, 6)) * (0.05, 0.05, 0.05, 0.35, 0.35, 0.35)
    feet = walker.geometry.home_feet + rng.uniform(-1, 1, (POSES, 3, 6)) * (0.03, 0.03, 0.03, 0.2, 0.2, 0.4)
    x, start = np.hstack([poses, feet.reshape(POSES, 18)]), walker.robot.home_configuration.X
    kinematics = walker.robot.kinematics
    contenders = {
        "closed forms, in batch": lambda: walker.model.inverse(poses, feet),
        "general solver, in batch": lambda: kinematics.inverse_batch(x, start),
    }
    return race(contenders, "general solver, in batch", units=POSES, rounds=5)


def show(result: TripodResult) -> str:
    """Write the tables."""
    rows = [
        [
            name, str(p.phases), duration(p.locking), *[duration(p.stages[s]) for s in STAGES], duration(p.total),
            duration(p.motion), f"{p.smallest:.3f}", f"{p.tilt:.3f}",
        ]
        for name, p in result.tasks.items()
    ]  # fmt: skip
    head = ["task", "phases", "lock poses", *STAGES, "total", "motion", "locks", "from 0.3 rad"]
    note = (
        "lock poses: search for the poses from which the locks hold best; locks: smallest singular value of their\n"
        "matrix over all swings, beside that from the source's tilt of 0.3 rad. All plans are certified."
    )
    speeds = [[name, count(r.per_second), f"{r.ratio:.3g}"] for name, r in result.inverse.items()]
    return "\n".join(
        [
            "The tripod: planning times, compiled before",
            table(head, rows, note),
            "",
            f"The tripod: inverse model, {POSES} poses at once",
            table(["", "poses/s", "speed"], speeds),
        ]
    )
