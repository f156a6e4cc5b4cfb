"""How many poses of a cable robot with 8 cables and 6 freedoms are judged per second, beside a linear program per pose?

The robot is IPAnema 1 with the numbers of CASPR's files and a least tension of 10 N, at poses drawn over its frame. All
contenders tell whether tensions within their limits hold the platform; their verdicts are compared before they race.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from benchmarks.tables import count, table
from benchmarks.timing import race
from numpy.typing import NDArray
from scipy.optimize import linprog

from paraopt.modes.cable import (
    CableRobot,
    cable_functions,
    capacity_gradients,
    capacity_margins,
    check_feasibility,
    distribute,
    distribute_batch,
)

Array = NDArray[np.float64]
FACETS = "facets, batch: verdict and margin"
TARGET = 50_000.0
"""Verdicts per second that are wanted on one core."""


def build_robot() -> CableRobot:
    """Build IPAnema 1: cable set "original" of CASPR's files, platform of 25 kg, tensions from 10 to 720 N."""
    corners = ((-1, 1), (1, 1), (1, -1), (-1, -1))
    return CableRobot(
        name="IPAnema 1",
        exits=[(2.0 * x, 1.5 * y, z) for z in (2.0, 0.0) for x, y in corners],
        attachments=[(0.06 * x, 0.06 * y, 0.0) for _ in range(2) for x, y in corners],
        mass=25.0,
        inertia=np.diag([14.0, 14.0, 14.0]),
        t_min=10.0,
        t_max=720.0,
        home={"z": 1.0},
    )


def draw_poses(count_: int, seed: int) -> Array:
    """Draw poses over the frame, with rotations of up to 0.3 rad about each axis."""
    random = np.random.default_rng(seed)
    low, high = np.array([-1.8, -1.3, 0.1, -0.3, -0.3, -0.3]), np.array([1.8, 1.3, 1.9, 0.3, 0.3, 0.3])
    return random.uniform(low, high, (count_, 6))


def measure(n_batch: int = 20_000, n_single: int = 200, rounds: int = 9, seed: int = 0) -> dict[str, Any]:
    """Race the verdicts per pose, after comparing them on the poses that all contenders judge."""
    robot = build_robot()
    poses = draw_poses(n_batch, seed)
    few = poses[:n_single]
    W, w = cable_functions(robot).both(few)
    bounds = np.column_stack([robot.t_min, robot.t_max])

    def solve_programs() -> NDArray[np.bool_]:
        solved = [
            linprog(np.zeros(8), A_eq=A, b_eq=-b, bounds=bounds, method="highs") for A, b in zip(W, w, strict=True)
        ]
        return np.array([s.status == 0 for s in solved])

    margins = capacity_margins(robot, poses)
    feasible = few[margins[:n_single] > 0.0]
    tensions = distribute_batch(robot, poses)
    agree = {
        "linear programs": float(np.mean(solve_programs() == (margins[:n_single] >= 0.0))),
        "tensions in batch": float(np.mean(tensions.feasible == (margins >= 0.0))),
    }
    batch = race(
        {
            FACETS: lambda: capacity_margins(robot, poses),
            "tensions of least norm, batch": lambda: distribute_batch(robot, poses),
            "margin with its gradient, batch": lambda: capacity_gradients(robot, poses),
        },
        FACETS,
        units=n_batch,
        rounds=rounds,
    )
    single = race(
        {"linear program per pose (HiGHS)": solve_programs}, "linear program per pose (HiGHS)", n_single, rounds
    )
    margin = race(
        {"with margin and reason, per pose (HiGHS)": lambda: [check_feasibility(robot, p) for p in few]},
        "with margin and reason, per pose (HiGHS)",
        n_single,
        rounds,
    )
    chosen = race(
        {"tensions, per pose (OSQP and polish)": lambda: [distribute(robot, p) for p in feasible]},
        "tensions, per pose (OSQP and polish)",
        len(feasible),
        rounds,
    )
    return {
        "agreement": agree,
        "feasible": float(np.mean(margins >= 0.0)),
        "target": TARGET,
        "rates": batch | single | margin | chosen,
    }


def show(result: dict[str, Any]) -> str:
    """Write the rates as a table."""
    rates = result["rates"]
    reference = rates["linear program per pose (HiGHS)"].seconds
    rows = [
        [name, count(rate.per_second), f"{reference / rate.seconds:.3g}", f"{100 * rate.spread:.0f} %"]
        for name, rate in rates.items()
    ]
    agree = ", ".join(f"{name} {100 * share:.2f} %" for name, share in result["agreement"].items())
    met = "met" if rates[FACETS].per_second >= result["target"] else "missed"
    note = (
        f"{100 * result['feasible']:.0f} % of the poses are feasible; agreement with the facets: {agree}.\n"
        f"Target of {count(result['target'])} verdicts per second on one core: {met}."
    )
    return "Cable robot, 8 cables and 6 freedoms\n" + table(
        ["verdict", "poses/s", "x linear program", "spread"], rows, note
    )
