"""What does a first way cost, and how long is it, compared with the RRT-Connect of OMPL?

All contenders ask the same judge, `Validity`, whether a pose may be used: closures on the branch of the start, ranges,
singularity margin, clearance. Those of paraopt ask for many poses at once, OMPL for one after the other; each is then
reached from the nearest pose known to be valid. Lines are checked at the same spacing, in the same metric; those of
paraopt also between their positions. "angles bounded" is a space whose angles end at -pi and pi, as for a search that
does not know of circles. The random ones run with several seeds: success, and medians over those that succeed.

The length is that of the first way, and after shortening by each one's own means (`straighten`; `simplifySolution`).
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from benchmarks.tables import duration, table
from numpy.typing import NDArray

import paraopt as po
from paraopt.planning.ground import Ground
from paraopt.planning.seed.base import choose_step
from paraopt.planning.validity import Validity
from problems import raf, stewart, three_rpr

Array = NDArray[np.float64]
RESOLUTION = 0.2


@dataclass(frozen=True)
class Attempt:
    """Hold what one search gave: seconds to a way, its length before and after shortening [m], poses judged."""

    seconds: float
    length: float
    shortened: float
    checks: int


def list_problems() -> dict[str, po.Problem]:
    """State the four problems."""
    machine = replace(po.robots.three_rpr_innocenti(), shapes={})
    modes = machine.kinematics.assembly_modes({"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}).modes
    a, b = (next(m.configuration for m in modes if abs(m.configuration["x"] - x) < 0.5) for x in (14.94, -8.68))
    goal = {name: b[name] for name in machine.mechanism.operational}
    return {
        "3-RPR T1": three_rpr.build_problem(three_rpr.Parameters()),
        "3-RPR, other assembly": po.Problem(po.Scene(machine), a, goal, margins=po.Margins(0.0, 0.01)),
        "RAF box": raf.build_problem(raf.Parameters(task="box")),
        "Stewart": stewart.build_problem(stewart.Parameters()),
    }


def measure(runs: int = 7, limit: float = 20.0) -> dict[str, Any]:
    """Run all contenders on all problems.

    Args:
        runs: Attempts of each, with other random numbers where there are any.
        limit: Time that one attempt of OMPL may take [s].
    """
    results: dict[str, dict[str, list[Attempt | None]]] = {}
    contenders: dict[str, Callable[[po.Problem, int], Attempt | None]] = {
        "mixed search": lambda problem, _: _ours(problem, po.MixedSearch()),
        "RRTConnect": lambda problem, k: _ours(problem, po.RRTConnect(random_seed=k)),
    }
    try:
        from benchmarks.ompl_peer import search
    except ImportError:
        pass
    else:
        contenders["OMPL RRT-Connect"] = lambda problem, k: search(problem, k, limit, bounded=False)
        contenders["OMPL, angles bounded"] = lambda problem, k: search(problem, k, limit, bounded=True)
    for name, problem in list_problems().items():
        problem.robot.kinematics.prepare(problem.independent)
        bounded = "OMPL, angles bounded"
        chosen = {label: act for label, act in contenders.items() if label != bounded or np.any(problem.periodic)}
        results[name] = {label: [] for label in chosen}
        for k in range(runs):  # in turn, so that what else the machine does falls on all of them
            for label, act in chosen.items():
                results[name][label].append(act(problem, k))
    return {"results": results, "has_peer": "OMPL RRT-Connect" in contenders}


def _ours(problem: po.Problem, seeder: po.MixedSearch | po.RRTConnect) -> Attempt | None:
    """Time a seeder without shortening, then with it."""
    begin = time.perf_counter()
    try:
        first = replace(seeder, cuts=0).seed(problem)
        seconds = time.perf_counter() - begin
        return Attempt(seconds, first.length, replace(seeder, cuts=4).seed(problem).length, first.checks)
    except (po.NoPathError, po.BudgetExceededError):
        return None


class Judge:
    """Judge single poses with the problem's validity, each reached from the nearest one that is known to be valid."""

    def __init__(self, problem: po.Problem) -> None:
        start, goal = problem.start_configuration.X[problem.index], problem.goal_values()
        distance = float(np.linalg.norm((goal - start) * problem.metric))
        self.spacing = RESOLUTION * choose_step(problem, distance)
        self.ground = Ground(problem, Validity(problem), self.spacing, 10**9)
        self.spots = [self.ground.origin, self.ground.goal]
        self._values = np.zeros((1024, len(start)))
        self._values[:2] = [spot.value for spot in self.spots]

    def __call__(self, value: Array) -> bool:
        size = len(self.spots)
        nearest = int(np.argmin(self.ground.distances(self._values[:size], value)))
        (spot,), _ = self.ground.place(value[None], [self.spots[nearest]])
        if spot is None:
            return False
        if size == len(self._values):
            self._values = np.vstack([self._values, np.zeros_like(self._values)])
        self._values[size] = spot.value
        self.spots.append(spot)
        return True


def show(result: dict[str, Any]) -> str:
    rows = []
    for name, contenders in result["results"].items():
        for label, attempts in contenders.items():
            good = [a for a in attempts if a is not None]
            if good:
                median = {k: statistics.median(getattr(a, k) for a in good) for k in Attempt.__dataclass_fields__}
                figures = [
                    duration(median["seconds"]), f"{median['length']:.4g}", f"{median['shortened']:.4g}",
                    f"{median['checks']:.0f}",
                ]  # fmt: skip
            else:
                figures = ["-"] * 4
            rows.append([name, label, f"{len(good)}/{len(attempts)}", *figures])
        if not result["has_peer"]:
            rows.append([name, "OMPL RRT-Connect", "not installed", "-", "-", "-", "-"])
    note = "times to the first way, without shortening; lengths in the problem's metric"
    return table(["problem", "search", "success", "time", "first [m]", "shortened [m]", "poses judged"], rows, note)
