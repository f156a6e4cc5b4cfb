"""How short, how fast and how alike do the refiners of a path come out, on one core?

T1 and T2 of the planning example in their metric, with the determinant of the legs' lines kept above 0.2 and clearance
above 0 on a dense check; the three RAF tasks; five-bar, Delta, Stewart. Both solvers refine the same seeds. Then the
second start on the same problem, and minimum-time refinement against refining and retiming one after the other. Seconds
are those of the processor, the least of several runs after a warm-up.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import casadi as ca
import numpy as np
from benchmarks.tables import table

import paraopt as po
from problems import delta, raf, stewart, three_rpr

LENGTHS = {"T1": 116.8, "T2": 117.2}  # best known 116.45 and 116.73 with 160 nodes, not proved to be the shortest
SECONDS = {"T1": 0.1, "T2": 0.1, "RAF free": 0.3, "RAF cylinder": 0.3, "RAF box": 0.3}
DETERMINANT = 0.2  # m
RUNS = 5
T = TypeVar("T")


@dataclass(frozen=True)
class Entry:
    """Hold what came out for one problem and one solver; lengths in the metric of the problem."""

    length: float
    seconds: float
    again: float
    iterations: int
    rounds: int
    clearance: float
    determinant: float


def determinant(values: Mapping[str, ca.SX], _: object) -> ca.SX:
    """Build det of the rows (n_x, n_y, (R b) x n) of the 3-RPR, n along the legs, b on the platform [m]."""
    turn = ca.vertcat(ca.cos(values["theta"]), ca.sin(values["theta"]))
    rows = []
    for i, (bx, by) in enumerate(((0.0, 0.0), (15.0, 0.0), (7.5, 12.990)), start=1):
        n = ca.vertcat(ca.cos(values[f"phi{i}"]), ca.sin(values[f"phi{i}"]))
        arm = ca.vertcat(turn[0] * bx - turn[1] * by, turn[1] * bx + turn[0] * by)
        rows.append(ca.horzcat(n[0], n[1], arm[0] * n[1] - arm[1] * n[0]))
    return ca.det(ca.vertcat(*rows))


def list_problems() -> dict[str, tuple[po.Problem, dict[str, Any]]]:
    """State the problems, each with its bounds."""
    found: dict[str, tuple[po.Problem, dict[str, Any]]] = {}
    for task in ("T1", "T2"):
        problem = three_rpr.build_problem(three_rpr.Parameters(task, margins=po.Margins(0.0, 0.0)))
        found[task] = problem, {"constraints": (po.PathBound("determinant", determinant, lower=DETERMINANT),)}
    for task in ("free", "cylinder", "box"):
        found[f"RAF {task}"] = raf.build_problem(raf.Parameters(task=task)), {}  # type: ignore[arg-type]
    five_bar = po.Problem(po.Scene(po.robots.five_bar()), {"x": 6.0, "y": 7.0}, {"x": 5.0, "y": 8.0})
    found["five-bar"] = five_bar, {}
    options = delta.Parameters()
    pick, place = (dict(zip("xyz", pose, strict=True)) for pose in (options.pick, options.place))
    found["Delta"] = po.Problem(delta.build_scene(options), pick, place, margins=options.margins), {}
    found["Stewart"] = stewart.build_problem(stewart.Parameters()), {}
    return found


def measure() -> dict[str, Any]:
    """Refine every problem by both solvers and in the least time."""
    entries: dict[str, dict[str, Any]] = {}
    for name, (problem, options) in list_problems().items():
        problem.robot.kinematics.prepare(problem.independent)
        seed = po.MixedSearch(step=5.0 if name in LENGTHS else None).seed(problem)
        entry: dict[str, Any] = {"seed": seed.length}
        for backend in ("sqp", "ipopt"):
            refiner = po.SplineRefiner(backend=backend, **options)
            refined, seconds = _least(lambda: refiner.refine(problem, seed))  # noqa: B023 - called at once
            _, again = _least(lambda: refiner.refine(problem, seed, warm=refined))  # noqa: B023
            clearance, least = _look(problem, refined.path, name in LENGTHS)
            entry[backend] = asdict(
                Entry(refined.length, seconds, again, refined.iterations, refined.rounds, clearance, least)
            )
            if backend == "sqp":
                entry["one after the other"] = po.TimeOptimal().retime(problem, refined.path).duration
        begin = time.process_time()
        fast = po.MinimumTime(**options).refine(problem, seed)
        entry["together"], entry["seconds together"] = fast.duration, time.process_time() - begin
        entries[name] = entry
    return {"problems": entries}


def show(result: dict[str, Any]) -> str:
    rows, notes = [], []
    for name, entry in result["problems"].items():
        sqp, ipopt = entry["sqp"], entry["ipopt"]
        gap = abs(sqp["length"] - ipopt["length"]) / min(sqp["length"], ipopt["length"])
        rows.append(
            [
                name,
                *(f"{value:.5g}" for value in (entry["seed"], sqp["length"], ipopt["length"])),
                f"{100 * gap:.3f}",
                *(f"{value:.3f}" for value in (sqp["seconds"], sqp["again"], ipopt["seconds"])),
                f"{sqp['iterations']} / {ipopt['iterations']}",
                f"{entry['one after the other']:.4f}",
                f"{entry['together']:.4f}",
                f"{entry['seconds together']:.1f}",
            ]
        )
        if name in LENGTHS:
            held = sqp["determinant"] >= DETERMINANT - 1e-4 and sqp["clearance"] >= -1e-9
            verdict = "met" if sqp["length"] <= LENGTHS[name] and held else "MISSED"
            notes.append(
                f"{name}: {sqp['length']:.2f}, target {LENGTHS[name]} {verdict}; determinant above "
                f"{sqp['determinant']:.4f}, clearance {sqp['clearance']:.4f}"
            )
        if name in SECONDS:
            verdict = "met" if sqp["seconds"] <= SECONDS[name] else "MISSED"
            notes.append(f"{name}: {sqp['seconds']:.3f} s, target {SECONDS[name]} s {verdict}")
    head = ["refinement", "seed", "sqp", "ipopt", "gap [%]", "sqp [s]", "again [s]", "ipopt [s]", "iterations",
            "then timed [s]", "together [s]", "took [s]"]  # fmt: skip
    return table(head, rows, "\n".join(notes))


def _least(act: Callable[[], T]) -> tuple[T, float]:
    """Run something several times; give its result and the least time of the processor."""
    result, seconds = act(), np.inf
    for _ in range(RUNS):
        begin = time.process_time()
        result = act()
        seconds = min(seconds, time.process_time() - begin)
    return result, float(seconds)


def _look(problem: po.Problem, path: po.Path, legs: bool) -> tuple[float, float]:
    """Measure the least clearance and determinant at ten thousand places."""
    X = path.solve(np.linspace(0.0, 1.0, 10001))
    distance, _ = problem.scene.clearances(X)
    if not legs:
        return float(np.min(distance)), float("nan")
    names = problem.robot.mechanism.names
    n = np.exp(1j * X[:, [names.index(f"phi{i}") for i in (1, 2, 3)]])
    arm = np.exp(1j * X[:, [names.index("theta")]]) * np.array([0.0, 15.0, 7.5 + 12.990j])
    rows = np.stack([n.real, n.imag, (arm.conj() * n).imag], axis=-1)
    return float(np.min(distance)), float(np.min(np.abs(np.linalg.det(rows))))
