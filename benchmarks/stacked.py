"""How do building, compiling and evaluating M, N and K grow with the machine? One to eight stacked Stewart platforms.

Four of them are the Logabex: 24 degrees of freedom, 96 variables, 72 equations. The targets: its M, N and K are built
in seconds, and an evaluation grows like the number of legs. Each closure holds two platforms and one leg, so the
non-zero entries do so; the matrices in full have a number of entries that grows like its square: what writes their
zeros, or compiles them, cannot stay linear.

The exponent p of a column is that of the best fit time ~ legs^p from two platforms on, where the cost of a call fades.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from benchmarks.tables import duration, table
from benchmarks.timing import Rate, race

import paraopt as po
from paraopt.closure import build_closure
from paraopt.kinematics import find_compiler

STAGES = tuple(range(1, 9))
LOGABEX = 4
BUILD_TARGET = 5.0  # s
LINEAR = 1.2  # largest exponent that is called linear: what is measured scatters
COLUMNS = ("build", "compile", "one point", "virtual machine", "batch")


def measure(n_batch: int = 64, rounds: int = 9) -> dict[str, Any]:
    """Time each size of the stack; the evaluations of all sizes are raced side by side."""
    entries: dict[int, dict[str, Any]] = {}
    points: dict[str, Callable[[], object]] = {}
    slow: dict[str, Callable[[], object]] = {}
    batches: dict[str, Callable[[], object]] = {}
    for n in STAGES:
        robot = po.robots.logabex(stages=n)
        mechanism = robot.mechanism
        X = np.array([robot.home[name] for name in mechanism.names])
        entry: dict[str, Any] = {"build": statistics.median(_time(_build, mechanism) for _ in range(3))}
        kinematics = po.Kinematics(mechanism, backend="virtual machine")
        slow[str(n)] = _bind(kinematics, X)
        entry["entries"] = kinematics.graph.E.nnz()
        entry["shape"] = kinematics.graph.E.shape
        if find_compiler():
            kinematics = po.Kinematics(mechanism, backend="compiled")
            _ = kinematics.graph.blocks
            with _empty_cache():
                entry["compile"] = _time(_compile, kinematics)
            points[str(n)] = _bind(kinematics, X)
        many = np.tile(X, (n_batch, 1))
        batches[str(n)] = partial(kinematics.jacobians_batch, many)
        entries[n] = entry
    for name, contenders, units in (
        ("one point", points, 1),
        ("virtual machine", slow, 1),
        ("batch", batches, n_batch),
    ):
        rates: dict[str, Rate] = race(contenders, "1", units, rounds) if contenders else {}
        for key, rate in rates.items():
            entries[int(key)][name] = rate.seconds
            entries[int(key)][f"{name}, growth"] = 1.0 / rate.ratio
    return {
        "n_batch": n_batch,
        "stages": entries,
        "exponents": {c: _exponent(entries, c) for c in COLUMNS if c in entries[1]},
    }


def show(result: dict[str, Any]) -> str:
    entries, exponents = result["stages"], result["exponents"]
    columns = [c for c in COLUMNS if c in exponents]
    fastest = "one point" if "one point" in exponents else "virtual machine"
    rows = []
    for n, e in entries.items():
        name = f"{n} ({e['shape'][0]} x {e['shape'][1]}, {e['entries']} entries)"
        rows.append([name, *[duration(e[c]) for c in columns], duration(e[fastest] / (6 * int(n)))])
    rows.append(["exponent p", *[f"{exponents[c]:.2f}" for c in columns], ""])
    built = next(e["build"] for n, e in entries.items() if int(n) == LOGABEX)
    growth = exponents[fastest]
    note = (
        f"M, N and K of the Logabex ({LOGABEX} platforms, 24 freedoms) are built in {duration(built)}; target "
        f"{BUILD_TARGET:g} s: {'met' if built < BUILD_TARGET else 'MISSED'}\n"
        f"an evaluation grows like legs^{growth:.2f}; target linear, at most {LINEAR:g}: "
        f"{'met' if growth <= LINEAR else 'MISSED'}\n"
        f"batch: of {result['n_batch']}, per point; compile: the function of M, N and K alone, into an empty cache"
    )
    if "compile" not in exponents:
        note += "\nno C compiler was found: nothing is compiled here"
    return table(["stacked platforms", *columns, f"{fastest}, per leg"], rows, note)


def _build(mechanism: po.Mechanism) -> object:
    return build_closure(mechanism).blocks


def _compile(kinematics: po.Kinematics) -> object:
    return kinematics.functions.jacobians


def _bind(kinematics: po.Kinematics, X: np.ndarray) -> Callable[[], object]:
    bound = kinematics.functions.jacobians.bind()
    bound.inputs[0][...] = X
    return bound


def _time(act: Callable[[Any], object], argument: Any) -> float:
    begin = time.perf_counter()
    act(argument)
    return time.perf_counter() - begin


def _exponent(entries: dict[int, dict[str, Any]], column: str) -> float:
    sizes = np.log([n for n in entries if n > 1])
    # of raced columns the medians of ratios round by round, which forgive what else the machine does
    times = np.log([e.get(f"{column}, growth", e[column]) for n, e in entries.items() if n > 1])
    return float(np.polyfit(sizes, times, 1)[0])


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
