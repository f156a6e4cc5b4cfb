"""What do M, N and K cost beside the neighbouring tools? The Gough-Stewart platform, the 3-RPR and the five-bar.

* paraopt, batch: all points in one call of `Kinematics.jacobians_batch`;
* generated C, loop in C: what CasADi's generator writes for the same matrices, untouched, compiled with the same flags
  and called point after point by a loop in C: the floor that the batch is held against; and the same without zeros;
* paraopt, one point: the compiled function through its buffers, from Python;
* finite differences: forward differences of our compiled residual, all points in one batch;
* Pinocchio: `computeJointJacobians`, the constraints' `calc` and `getConstraintsJacobian` of the same tree and points
  that coincide, from Python;
* MuJoCo: `mj_kinematics`, `mj_comPos` and `mj_makeConstraint` of the same tree with `connect` equalities, from Python.

Before the race each peer's Jacobian is compared with ours at closed points: the row spaces are the same.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from benchmarks.peers_models import mujoco_jacobian, pinocchio_jacobian, same_motions
from benchmarks.tables import count, duration, table
from benchmarks.timing import Rate, race
from numpy.typing import NDArray

import paraopt as po
from paraopt.kinematics import find_compiler

Array = NDArray[np.float64]
ROBOTS = (po.robots.stewart, po.robots.three_rpr, po.robots.five_bar)
BATCH, LOOP, ENTRIES = "paraopt, batch", "generated C, loop in C", "generated C, loop in C, entries alone"
LIMIT = 1.5  # largest cost of the batch over that of the generated C
FLAGS = ("-O3", "-fPIC", "-shared", "-fno-math-errno", "-ffp-contract=off", "-w")  # those of our compiled functions
_MAIN = r"""
int loop(long long n, const double* X, double* M, double* N, double* K) {
  long long i; int flag = 0;
  long long iw[%(iw)d + 1]; double w[%(w)d + 1];
  for (i = 0; i < n && !flag; ++i) {
    const double* arg[%(arg)d + 1] = {X + i*%(x)d};
    double* res[%(res)d + 1] = {M + i*%(M)d, N + i*%(N)d, K + i*%(K)d};
    flag = plain(arg, res, iw, w, 0);
  }
  return flag;
}
"""


def measure(n_batch: int = 1000, rounds: int = 15) -> dict[str, Any]:
    """Race all contenders on each robot."""
    result: dict[str, Any] = {"n_batch": n_batch, "compiled": find_compiler() is not None, "robots": {}}
    for build in ROBOTS:
        robot = build()
        result["robots"][robot.mechanism.name] = _race(robot, n_batch, rounds)
    return result


def show(result: dict[str, Any]) -> str:
    rows, notes = [], []
    for name, entry in result["robots"].items():
        rates: dict[str, Rate] = entry["rates"]
        for contender, rate in rates.items():
            cost = f"{1.0 / rate.ratio:.3g}"
            rows.append([f"{name}: {contender}", count(rate.per_second), duration(rate.seconds), cost,
                         f"{100 * rate.spread:.0f} %"])  # fmt: skip
        for peer in entry["missing"]:
            rows.append([f"{name}: {peer}, not installed", "-", "-", "-", "-"])
        if LOOP in rates:
            share = rates[LOOP].ratio
            word = "met" if share <= LIMIT else "MISSED"
            notes.append(f"{name}: {BATCH} over {LOOP}: {share:.2f}; target at most {LIMIT:g}: {word}")
        notes += [f"{name}: the motions of {p} and ours differ by {d:.0e}" for p, d in entry["differences"].items()]
    if not result["compiled"]:
        notes.append("no C compiler was found: nothing is compiled here")
    head = ["M, N, K", "per second", "each", f"cost over {BATCH}", "spread"]
    return table(head, rows, "\n".join([f"batch of {result['n_batch']} points", *notes]))


def _race(robot: po.Robot, n: int, rounds: int) -> dict[str, Any]:
    mechanism, kinematics = robot.mechanism, robot.kinematics
    home, scale = robot.home_configuration.X, kinematics.graph.variable_scale
    place = mechanism.indices(mechanism.operational)
    poses = home[place] + np.random.default_rng(0).uniform(-0.1, 0.1, (2 * n, len(place))) * scale[place]
    closed = kinematics.solve_batch(mechanism.operational, poses, np.tile(home, (len(poses), 1)))
    X = np.ascontiguousarray(closed.X[closed.converged][:n])
    bound = kinematics.functions.jacobians.bind()
    bound.inputs[0][...] = X[0]
    contenders: dict[str, tuple[Callable[[], object], int]] = {
        BATCH: (partial(kinematics.jacobians_batch, X), len(X)),
        "paraopt, one point": (bound, 1),
        "finite differences": (partial(_differences, kinematics, X), len(X)),
    }
    ours = np.concatenate(kinematics.jacobians_batch(X), axis=2)
    if find_compiler():
        loop, outputs = _generated_loop(kinematics, X)
        loop()
        theirs = np.concatenate(outputs, axis=2)
        if not np.allclose(ours, theirs, rtol=0, atol=1e-12 * np.max(np.abs(ours))):
            raise po.BackendError("the generated C gives other matrices than the batch")
        contenders[LOOP] = loop, len(X)
        entries, _kept = _generated_loop(kinematics, X, dense=False)  # what it writes into must stay
        contenders[ENTRIES] = entries, len(X)
    missing, differences = [], {}
    for name, build in (("Pinocchio", pinocchio_jacobian), ("MuJoCo", mujoco_jacobian)):
        peer = build(mechanism)
        if peer is None:
            missing.append(name)
            continue
        evaluate, order = peer
        points = [np.ascontiguousarray(x[order]) for x in X]
        differences[name] = max(same_motions(ours[k][:, order], evaluate(points[k])) for k in range(20))
        contenders[f"{name}, from Python"] = partial(_each, evaluate, points), len(X)
    units = {name: count for name, (_, count) in contenders.items()}
    rates = race({name: act for name, (act, _) in contenders.items()}, BATCH, 1, rounds)
    return {
        "rates": {
            name: Rate(rate.seconds / units[name], rate.spread, rate.ratio * units[name] / units[BATCH])
            for name, rate in rates.items()
        },
        "missing": missing,
        "differences": differences,
    }


def _each(evaluate: Callable[[Array], Array], points: list[Array]) -> None:
    for point in points:
        evaluate(point)


def _differences(kinematics: po.Kinematics, X: Array) -> Array:
    """Give E at n points by forward differences, shape (n, n_equations, n_variables)."""
    step = 1e-7 * kinematics.graph.variable_scale
    n, width = X.shape
    shifted = np.empty((n, width + 1, width))
    shifted[:] = X[:, None, :]
    shifted[:, np.arange(1, width + 1), np.arange(width)] += step
    (F,) = kinematics.functions.residual.batch(shifted.reshape(-1, width))
    F = F.reshape(n, width + 1, -1)
    E: Array = ((F[:, 1:] - F[:, :1]) / step[:, None]).transpose(0, 2, 1)
    return E


def _generated_loop(kinematics: po.Kinematics, X: Array, dense: bool = True) -> tuple[Callable[[], int], list[Array]]:
    """Compile what CasADi generates, and a loop around it; rows first and dense as ours, or without the zeros."""
    graph = kinematics.graph
    blocks = [ca.densify(b.T) if dense else b.T for b in graph.blocks]  # CasADi writes columns first
    function = ca.Function("plain", [graph.X], blocks, {"cse": True})
    generator = ca.CodeGenerator("plain.c")
    generator.add(function)
    sizes = {
        "iw": function.sz_iw(), "w": function.sz_w(), "arg": function.sz_arg(), "res": function.sz_res(),
        "x": X.shape[1], **{letter: block.nnz() for letter, block in zip("MNK", blocks, strict=True)},
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "plain.c", Path(folder) / "plain.so"
        source.write_text(generator.dump() + _MAIN % sizes)
        subprocess.run([find_compiler() or "cc", *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
        entry = ctypes.CDLL(str(library)).loop
    entry.argtypes = [ctypes.c_longlong, *[ctypes.c_void_p] * 4]
    outputs = [np.empty((len(X), *block.T.shape)) for block in blocks]
    return partial(entry, len(X), *[a.ctypes.data for a in (X, *outputs)]), outputs
