"""Can the planar 3-RPR move where the straight way is singular or blocked, and which of its assemblies can it reach?

T0 to T2 after Lahouar, III.3 (legs of 10 to 200, platform side 15, base side 75, theta in [0, pi]); its frames cannot
be recovered, base and goal are ours. T0, as it reads plainly: start and goal on opposite sides of det A = 0. T1: the
straight way crosses det A = 0 twice. T2: T1 with a gripper of radius 1, and an obstacle of radius 3 in its way. modes:
the six assemblies of the machine of Innocenti (Chablat1998, tables 2 and 3) for legs of 15, 15.4, 12, pair by pair.

Expected: T0 is refused, the straight motion meets det A = 0 at 41.46 % of the way. T1 and T2: seeds below 127 and
certified paths of about 118 in the metric sqrt(dx^2 + dy^2 + (15 dtheta)^2), |det (n_x, n_y, (R b) x n)| above 0.2.
modes:
6 of 15 pairs are joined, four of them by a full turn of theta, and 9 refused. Exit code 0 where all of this holds.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

import numpy as np
import tyro

import paraopt as po


@dataclass(frozen=True)
class Parameters:
    """Plan a task of the 3-RPR."""

    task: Literal["T0", "T1", "T2", "modes"] = "T1"
    """Which task."""
    margins: po.Margins = field(default_factory=lambda: po.Margins(clearance=0.0, singularity=0.01))
    """Clearance [m] and distance to singularities."""
    step: float = 5.0
    """Step of the search's grid in the tasks T1 and T2 [m]."""


def build_problem(p: Parameters) -> po.Problem:
    """Place the robot, the obstacle, and both ends."""
    plain = ((0.0, 0.0), (75.0, 0.0), (37.5, 64.952))
    robot = po.robots.three_rpr(plain) if p.task == "T0" else po.robots.three_rpr()
    gripper = po.Cylinder(name="gripper", radius=1.0, length=1.0, pose=po.transform((7.5, -20.67, 0.0)))
    disc = po.Cylinder(name="disc", radius=3.0, length=3.0, pose=po.transform((15.6, -8.8, 0.0)))
    robot = replace(robot, shapes={"platform": [gripper]} if p.task == "T2" else {})  # the legs pass above the disc
    ends = ((20.0, 0.0, 0.3), (60.0, -50.0, 0.6) if p.task == "T0" else (-60.0, 50.0, 0.6))
    start, goal = (dict(zip(("x", "y", "theta"), end, strict=True)) for end in ends)
    limits = replace(robot.limits, position={"theta": (0.0, np.pi)})
    scene = po.Scene(robot, [disc] if p.task == "T2" else [])
    return po.Problem(scene, start, goal, margins=p.margins, limits=limits, characteristic_length=15.0)


def find_least_determinant(plan: po.Plan) -> float:
    """Give the least |det (n_x, n_y, (R b) x n)| along a motion [m]."""
    names = plan.problem.robot.mechanism.names
    X = plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 5001))
    n = np.exp(1j * X[:, [names.index(f"phi{i}") for i in (1, 2, 3)]])
    arm = np.exp(1j * X[:, [names.index("theta")]]) * np.array([0.0, 15.0, 7.5 + 12.990j])
    return float(np.min(np.abs(np.linalg.det(np.stack([n.real, n.imag, (arm.conj() * n).imag], axis=-1)))))


def join_modes(p: Parameters) -> int:
    """Try all pairs of assemblies, count those that are answered right."""
    robot = replace(po.robots.three_rpr_innocenti(), shapes={})
    modes = robot.kinematics.assembly_modes({"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}).modes
    right = {"joined": 0, "refused": 0}
    for (i, a), (j, b) in combinations(enumerate(modes, start=1), 2):
        goal = {name: b.configuration[name] for name in robot.mechanism.operational}
        try:
            plan = po.plan(po.Problem(po.Scene(robot), a.configuration, goal, margins=p.margins))
        except po.InfeasibleError as error:
            right["refused"] += a.sign != b.sign and error.evidence.get("reason") == "branch"
            print(f"{i}-{j}: refused, determinants {a.determinant:+.4f} and {b.determinant:+.4f}")
            continue
        right["joined"] += a.sign == b.sign
        turns = round((plan.seed.points[-1, 2] - goal["theta"]) / (2 * np.pi))
        least = plan.certificate["parallel determinant"].value  # of one sign on a dense check
        print(f"{i}-{j}: joined, path of {plan.refined.length:.1f} m, {turns} turns, |det| above {least:.4f}")
    print(", ".join(f"{count} pairs {answer}" for answer, count in right.items()))
    return 0 if sum(right.values()) == len(modes) * (len(modes) - 1) // 2 else 1


def main(p: Parameters) -> int:
    """Plan, and say what came out."""
    try:
        if p.task == "modes":
            return join_modes(p)
        # the barrier of distances begins at the size of the obstacle
        plan = po.plan(build_problem(p), seeder=po.MixedSearch(step=p.step), refiner=po.SplineRefiner(horizon=3.0))
    except po.ParaoptError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 0 if p.task == "T0" and error.evidence.get("reason") == "branch" else 1
    least = find_least_determinant(plan)
    print(f"{plan.summary}\nleast |det (n_x, n_y, (R b) x n)|: {least:.3f} m")
    return 0 if p.task != "T0" and least >= 0.2 else 1


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
