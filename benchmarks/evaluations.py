"""How often per second are M, N and K of the RAF obtained, and in which way?

One evaluation gives all three matrices (33 x 32 numbers) at one point. Contenders:

* compiled: generated C; one point through preallocated buffers, or a batch in one call;
* virtual machine: the same graph through CasADi's interpreter; one point through buffers, or mapped over a batch;
* CasADi called with arrays: what one gets without buffers;
* finite differences: forward differences of the *compiled* residual, its 33 points evaluated in one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import casadi as ca
import numpy as np
from benchmarks.tables import count, duration, table
from benchmarks.timing import Rate, race
from numpy.typing import NDArray

import paraopt as po
from paraopt.kinematics import find_compiler

Array = NDArray[np.float64]
SINGLE, BATCH = "one point", "batch"


def measure(n_batch: int = 1000, rounds: int = 15) -> dict[str, Any]:
    """Race the contenders, one point at a time and in batches."""
    robot = po.robots.raf()
    mechanism, home = robot.mechanism, robot.home_configuration.X
    backend: Literal["compiled", "virtual machine"] = "compiled" if find_compiler() else "virtual machine"
    fast = po.Kinematics(mechanism, backend=backend)
    slow = po.Kinematics(mechanism, backend="virtual machine")
    X = home + np.random.default_rng(0).normal(scale=0.02, size=(n_batch, len(home)))
    exact = np.concatenate(fast.jacobians_batch(X), axis=2)
    step = 1e-7 * slow.graph.variable_scale

    def differences(points: Array) -> Array:
        """Give E at n points, shape (n, n_equations, n_variables)."""
        n, width = points.shape
        shifted = np.empty((n, width + 1, width))
        shifted[:] = points[:, None, :]
        shifted[:, np.arange(1, width + 1), np.arange(width)] += step
        (F,) = fast.functions.residual.batch(shifted.reshape(-1, width))
        F = F.reshape(n, width + 1, -1)
        E: Array = ((F[:, 1:] - F[:, :1]) / step[:, None]).transpose(0, 2, 1)
        return E

    named = ca.Function("jacobians", [slow.graph.X], list(slow.graph.blocks))
    one = X[:1].copy()
    single: dict[str, Callable[[], object]] = {}
    batch: dict[str, Callable[[], object]] = {}
    for name, kinematics in (("compiled", fast), ("virtual machine", slow)):
        if name == "compiled" and backend != "compiled":
            continue
        bound = kinematics.functions.jacobians.bind()
        bound.inputs[0][...] = home
        single[name] = bound
        batch[name] = lambda k=kinematics: k.jacobians_batch(X)  # type: ignore[misc]
    single["CasADi called with arrays"] = lambda: [np.asarray(block) for block in named(home)]
    single["finite differences"] = lambda: differences(one)
    batch["finite differences"] = lambda: differences(X)

    virtual = np.concatenate(slow.jacobians_batch(X), axis=2)
    return {
        "n_batch": n_batch,
        "backend": backend,
        "shapes": {k: list(v.shape) for k, v in zip("MNK", fast.jacobians(home), strict=True)},
        "largest difference compiled - virtual machine": float(np.max(np.abs(exact - virtual))),
        "largest error of finite differences": float(np.max(np.abs(differences(X) - exact))),
        SINGLE: race(single, "virtual machine", rounds=rounds),
        BATCH: race(batch, "virtual machine", units=n_batch, rounds=rounds),
    }


def show(result: dict[str, Any]) -> str:
    rows = []
    for kind in (SINGLE, BATCH):
        rates: dict[str, Rate] = result[kind]
        label = kind if kind == SINGLE else f"{kind} of {result['n_batch']}"
        for name, rate in rates.items():
            rows.append(
                [f"{name}, {label}", count(rate.per_second), duration(rate.seconds), f"{rate.ratio:.3g}",
                 f"{100 * rate.spread:.0f} %"]
            )  # fmt: skip
    note = (
        f"ratio: to the virtual machine, {SINGLE} and {BATCH} each; target of the compiled one: 5\n"
        f"compiled and virtual machine differ by {result['largest difference compiled - virtual machine']:.1e}, "
        f"finite differences from the exact ones by {result['largest error of finite differences']:.1e}"
    )
    if result["backend"] == "compiled":
        gains = [result[k]["compiled"].ratio / result[k]["finite differences"].ratio for k in (SINGLE, BATCH)]
        note += f"\ncompiled over finite differences: {gains[0]:.3g} at one point, {gains[1]:.3g} in the batch"
    else:
        note += "\nno C compiler was found: nothing is compiled here"
    return table(["M, N, K of the RAF", "per second", "each", "ratio", "spread"], rows, note)
