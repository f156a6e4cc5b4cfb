"""How long does a forward model take? Actuators imposed, the loops closed from a start that is 5 to 10 % away.

Everybody solves the same equations from the same starts to the same tolerance on one core: the closure residual F(X),
lengths in characteristic lengths, of the Gough-Stewart platform, the 3-RPR and the five-bar. Targets are closed
configurations around home; their actuators are imposed and every other variable starts 5 to 10 % of a characteristic
length, or of a radian, off. Only what closes the loops to the tolerance counts, by our measure of the residual.

* batch: 600 starts in one compiled call; one call: `Kinematics.solve_batch` of one start from Python, which tells the
  residual and whether it converged, as the peers do; forward(): `Kinematics.forward`, with ranks, uniqueness, ranges;
* scipy.optimize.root (hybr): our compiled F, with our exact Jacobian and without;
* Drake's SNOPT and IPOPT: our compiled F and its exact Jacobian as a constraint in Python ("callback"), and F as
  Drake's own expressions ("symbolic"); programs are built once, only `Solve` is timed.

The second table tells what the first use costs: what `jacobians` and the forward model need, built and compiled into an
empty cache, and then loaded from it.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.optimize
from benchmarks.peers_models import DrakeProgram, load_peer
from benchmarks.tables import duration, table
from numpy.typing import NDArray

import paraopt as po
from paraopt.kinematics import find_compiler

Array = NDArray[np.float64]
TOLERANCE = 1e-10
ROBOTS = (po.robots.stewart, po.robots.three_rpr, po.robots.five_bar)
BATCH, ONE, MODEL = "paraopt, batch", "paraopt, one call", "paraopt, forward()"
COPIES, REPEATS = 600, 3
TARGETS = (("Drake", BATCH, 100.0), ("Drake", ONE, 10.0), ("Drake", MODEL, 10.0), ("scipy", BATCH, 20.0))


@dataclass(frozen=True, eq=False)
class Task:
    """Hold what is to be solved.

    Attributes:
        robot: The robot.
        kinematics: Its functions.
        starts: Starts that hold the imposed values [m or rad], shape (n, n_variables).
        imposed: Places of the imposed variables.
        unknown: Places of the others.
    """

    robot: po.Robot
    kinematics: po.Kinematics
    starts: Array
    imposed: list[int]
    unknown: list[int]


def measure(n_starts: int = 60) -> dict[str, Any]:
    """Solve every start by every contender, start after start."""
    result: dict[str, Any] = {"n_starts": n_starts, "tolerance": TOLERANCE, "robots": {}, "first use": {}}
    result["compiled"] = find_compiler() is not None
    result["drake"] = load_peer("pydrake.solvers") is not None
    for build in ROBOTS:
        task = _set_task(build(), n_starts)
        result["robots"][task.robot.mechanism.name] = _race(task)
    for build in ROBOTS:
        mechanism = build().mechanism
        result["first use"][mechanism.name] = _first_use(mechanism)
    return result


def show(result: dict[str, Any]) -> str:
    rows, verdicts = [], []
    for name, times in result["robots"].items():
        best = times[BATCH]["seconds"]
        for contender, entry in times.items():
            share = f"{100 * entry['solved']:.0f} %"
            if entry["seconds"] is None:
                rows.append([f"{name}: {contender}", "-", "-", "-", "-", share])
                continue
            ratios = [f"{entry['seconds'] / times[ours]['seconds']:.3g}" for ours in (BATCH, ONE, MODEL)]
            rows.append([f"{name}: {contender}", duration(entry["seconds"]), *ratios, share])
        for peer, ours, target in TARGETS:
            theirs = [e["seconds"] for c, e in times.items() if c.startswith(peer) and e["seconds"] is not None]
            if theirs and best:
                gain = min(theirs) / times[ours]["seconds"]
                word = "met" if gain >= target else "MISSED"
                verdicts.append(f"{name}: {ours} over the fastest of {peer}: {gain:.3g}; target {target:g}: {word}")
    if not result["drake"]:
        verdicts.append("Drake is not installed here: pip install 'paraopt[bench]'")
    if not result["compiled"]:
        verdicts.append("no C compiler was found: nothing is compiled here")
    note = "\n".join([f"median of {result['n_starts']} starts each, tolerance {result['tolerance']:g}", *verdicts])
    head = ["forward model", "per solve", "over batch", "over one call", "over forward()", "solved"]
    first = [
        [name, *[duration(entry[k]) if entry[k] is not None else "-" for k in ("build", "compile", "load")]]
        for name, entry in result["first use"].items()
    ]
    second = table(["first use", "build", "compile", "load"], first, "M, N, K and the forward model; one core")
    return f"{table(head, rows, note)}\n\n{second}"


def _set_task(robot: po.Robot, n: int, seed: int = 0) -> Task:
    """Choose closed configurations around home, and starts 5 to 10 % away from them."""
    mechanism = robot.mechanism
    kinematics = po.Kinematics(mechanism, options=po.SolveOptions(tolerance=TOLERANCE))
    random, scale = np.random.default_rng(seed), kinematics.graph.variable_scale
    home, imposed = robot.home_configuration.X, mechanism.indices(mechanism.active)
    place = mechanism.indices(mechanism.operational)
    poses = home[place] + random.uniform(-0.1, 0.1, (4 * n, len(place))) * scale[place]
    closed = kinematics.solve_batch(mechanism.operational, poses, np.tile(home, (len(poses), 1)))
    targets = closed.X[closed.converged][:n]
    away = random.uniform(0.05, 0.1, targets.shape) * random.choice((-1.0, 1.0), targets.shape) * scale
    away[:, imposed] = 0.0
    unknown = [i for i in range(len(home)) if i not in imposed]
    return Task(robot, kinematics, targets + away, imposed, unknown)


def _race(task: Task) -> dict[str, dict[str, Any]]:
    """Solve each start by each contender in turn, three times; the fastest counts: warm caches for all."""
    kinematics, starts, imposed = task.kinematics, task.starts, task.imposed
    contenders = _contenders(task)
    contenders[BATCH](starts[0])  # what is made at the first use is made here
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for start in starts:
        for name, solve in contenders.items():
            spent = []
            for _ in range(REPEATS):
                begin = time.perf_counter()
                X = solve(start)
                spent.append(time.perf_counter() - begin)
            kept = np.max(np.abs(X - start)[imposed], initial=0.0) == 0.0
            if kept and kinematics.scaled_residual(X)[0] <= TOLERANCE:
                times[name].append(min(spent) / (COPIES if name == BATCH else 1))
    return {
        name: {"seconds": statistics.median(t) if t else None, "solved": len(t) / len(starts)}
        for name, t in times.items()
    }


def _contenders(task: Task) -> dict[str, Callable[[Array], Array]]:
    """Build the peers; each maps a start to its answer, both in our units."""
    graph, functions = task.kinematics.graph, task.kinematics.functions
    scale, rows, unknown, imposed = graph.variable_scale, graph.row_scale, np.array(task.unknown), task.imposed
    F, E = functions.residual.bind(), functions.scaled_jacobian.bind()
    shape = functions.scaled_jacobian.out_shapes[0]

    def residual(z: Array) -> Array:
        np.multiply(z, scale, out=F.inputs[0])
        F()
        return F.outputs[0] / rows

    def jacobian(z: Array) -> Array:
        np.multiply(z, scale, out=E.inputs[0])
        E()
        return E.outputs[0].reshape(shape).copy()

    def root(exact: bool) -> Callable[[Array], Array]:
        z = np.empty(len(scale))

        def f(y: Array) -> Array:
            z[unknown] = y
            return residual(z)

        def J(y: Array) -> Array:
            z[unknown] = y
            return jacobian(z)[:, unknown]

        def solve(start: Array) -> Array:
            z[:] = start / scale
            answer = scipy.optimize.root(f, z[unknown], jac=J if exact else None, tol=TOLERANCE)
            X = start.copy()
            X[unknown] = answer.x * scale[unknown]
            return X

        return solve

    kinematics, active = task.kinematics, task.robot.mechanism.active

    def batch(start: Array) -> Array:
        # this start among all the others
        many[0] = start
        return kinematics.solve_batch(active, many[:, imposed], many).X[0]

    def one(start: Array) -> Array:
        return kinematics.solve_batch(active, start[imposed], start).X[0]

    def forward(start: Array) -> Array:
        return kinematics.forward(dict(zip(active, start[imposed].tolist(), strict=True)), start).X

    many = np.resize(task.starts, (COPIES, len(scale)))
    contenders: dict[str, Callable[[Array], Array]] = {
        BATCH: batch, ONE: one, MODEL: forward,
        "scipy root, exact Jacobian": root(True), "scipy root, differences": root(False),
    }  # fmt: skip
    if load_peer("pydrake.solvers") is None:
        return contenders
    z = ca.SX.sym("z", len(scale))
    scaled = ca.Function("F", [z], [ca.substitute(graph.F, graph.X, z * ca.DM(scale)) / ca.DM(rows)])

    def drake(form: str, solver: str) -> Callable[[Array], Array]:
        program = DrakeProgram(scaled, residual, jacobian, imposed, form, solver, TOLERANCE)

        def solve(start: Array) -> Array:
            X = program(start / scale) * scale
            X[imposed] = start[imposed]
            return X

        return solve

    for solver in ("SNOPT", "IPOPT"):
        for form in ("callback", "symbolic"):
            contenders[f"Drake {solver}, {form}"] = drake(form, solver)
    return contenders


def _first_use(mechanism: po.Mechanism) -> dict[str, float | None]:
    """Time building, compiling and loading what evaluates M, N, K and solves the forward model."""
    entry: dict[str, float | None] = {"compile": None, "load": None}
    begin = time.perf_counter()
    _ = po.Kinematics(mechanism).graph.blocks
    entry["build"] = time.perf_counter() - begin
    if not find_compiler():
        return entry
    with _empty_cache():
        for key in ("compile", "load"):
            kinematics = po.Kinematics(mechanism, backend="compiled")
            _ = kinematics.graph.blocks
            begin = time.perf_counter()
            _ = kinematics.functions.jacobians, kinematics.functions.newton, kinematics.functions.scaled_jacobian
            entry[key] = time.perf_counter() - begin
    return entry


@contextmanager
def _empty_cache() -> Iterator[None]:
    before = os.environ.get("PARAOPT_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PARAOPT_CACHE"] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ["PARAOPT_CACHE"]
            else:
                os.environ["PARAOPT_CACHE"] = before
