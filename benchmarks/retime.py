"""What does retiming cost beside toppra called directly, and how long are the motions beside Drake's Toppra?

The cost is taken on the paths of two RAF tasks, exact derivatives through the closures included:

* paraopt: `TimeOptimal.retime`, with its check at ten times the density of the grid;
* toppra, called directly: its own constraint classes and `compute_trajectory` on the grid that paraopt ends with, and
  the path as a person writes it for toppra, a class whose call evaluates `Path`; nothing is checked afterwards;
* toppra, path stored: the same, but values and derivatives at the grid are evaluated once and looked up.

The durations are compared on splines in three sliding axes, where Drake needs no kinematics of ours: the same spline,
the same limits, the same grid.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint
from benchmarks.tables import duration, table
from benchmarks.timing import Rate, race
from numpy.typing import NDArray
from problems.raf import Parameters, build_problem
from scipy.interpolate import CubicSpline, make_interp_spline

import paraopt as po

Array = NDArray[np.float64]
TASKS = ("free", "cylinder")
OURS, DIRECT, STORED = "paraopt", "toppra, called directly", "toppra, path stored"
OVERHEAD, AGREEMENT = 1.5, 0.005


def measure(rounds: int = 7) -> dict[str, Any]:
    """Race the retimers, and compare durations with Drake's."""
    tasks: dict[str, Any] = {}
    for task in TASKS:
        problem = build_problem(Parameters(task=task))  # type: ignore[arg-type]
        path = po.plan(problem, allow_failed=True).path
        retimer = po.TimeOptimal()
        trajectory = retimer.retime(problem, path)
        grid = trajectory.law(trajectory.law.breaks)
        drives = len(problem.robot.mechanism.active)

        def call_stored(problem: po.Problem, path: po.Path, drives: int, grid: Array) -> Any:
            return _call_toppra(problem, _Stored(path, drives, grid), grid)

        contenders: dict[str, Callable[[], Any]] = {
            OURS: partial(retimer.retime, problem, path),
            DIRECT: partial(_call_toppra, problem, _Evaluated(path, drives), grid),
            STORED: partial(call_stored, problem, path, drives, grid),
        }
        tasks[task] = {
            "rates": race(contenders, OURS, rounds=rounds, slice_seconds=0.2),
            "durations": {OURS: trajectory.duration, DIRECT: float(contenders[DIRECT]().path_interval[1])},
            "n_grid": trajectory.n_grid,
        }
    return {"tasks": tasks, "drake": [_compare_drake(seed) for seed in range(16)]}


def show(result: dict[str, Any]) -> str:
    rows, notes = [], []
    for task, entry in result["tasks"].items():
        rates: dict[str, Rate] = entry["rates"]
        for name, rate in rates.items():
            motion = entry["durations"].get(name)
            rows.append([f"RAF {task}: {name}", duration(rate.seconds), f"{1.0 / rate.ratio:.2f}",
                         "-" if motion is None else f"{motion:.4f} s", f"{100 * rate.spread:.0f} %"])  # fmt: skip
        for name in (DIRECT, STORED):
            over = rates[name].ratio
            told = f"; target at most {OVERHEAD}: {'met' if over <= OVERHEAD else 'MISSED'}" if name == DIRECT else ""
            notes.append(f"RAF {task}: {OURS} over {name}: {over:.2f}{told}")
    if pairs := [pair for pair in result["drake"] if pair is not None]:
        both = [(ours, theirs) for ours, theirs in pairs if theirs is not None]
        worst = max(abs(ours / theirs - 1.0) for ours, theirs in both)
        verdict = "met" if worst <= AGREEMENT else "MISSED"
        notes.append(
            f"Drake's Toppra timed {len(both)} of {len(pairs)} splines that paraopt timed; durations differ by "
            f"{100 * worst:.3f} % at most; target {100 * AGREEMENT} %: {verdict}"
        )
    else:
        notes.append("Drake, not installed: no durations to compare with")
    head = ["retiming", "each", "cost over paraopt", "motion", "spread"]
    return table(head, rows, "\n".join(notes))


class _Evaluated(toppra.interpolator.AbstractGeometricPath):
    """Give the drives along a path to toppra: every call evaluates the path."""

    def __init__(self, path: po.Path, drives: int) -> None:
        self.path, self.drives = path, drives

    def __call__(self, path_positions: Any, order: int = 0) -> Array:
        values = self.path(np.asarray(path_positions, dtype=float), order)
        return np.asarray(values[..., : self.drives])

    @property
    def dof(self) -> int:
        return self.drives

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, 1.0])


class _Stored(_Evaluated):
    """Give the drives at a grid, evaluated once."""

    def __init__(self, path: po.Path, drives: int, grid: Array) -> None:
        super().__init__(path, drives)
        points = path.points(grid)
        self.grid, self.values = grid, [v[:, :drives] for v in (points.X, points.dX, points.ddX)]

    def __call__(self, path_positions: Any, order: int = 0) -> Array:
        index = np.clip(np.searchsorted(self.grid, path_positions), 0, len(self.grid) - 1)
        return np.asarray(self.values[order][index])


def _call_toppra(problem: po.Problem, path: toppra.interpolator.AbstractGeometricPath, grid: Array) -> Any:
    names = problem.robot.mechanism.active
    velocity, acceleration = (problem.bounds.of(quantity, names) for quantity in ("velocity", "acceleration"))
    scheme = toppra.constraint.DiscretizationType.Interpolation
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-velocity, velocity])),
        toppra.constraint.JointAccelerationConstraint(
            np.column_stack([-acceleration, acceleration]), discretization_scheme=scheme
        ),
    ]
    instance = toppra.algorithm.TOPPRA(
        constraints, path, gridpoints=grid, solver_wrapper="seidel", parametrizer="ParametrizeConstAccel"
    )
    return instance.compute_trajectory(0.0, 0.0)


# --- Drake


def _compare_drake(seed: int) -> tuple[float, float | None] | None:
    """Time one random spline in three sliding axes with both; None without Drake."""
    try:
        optimization, plants, tree, trajectories = (
            import_module(f"pydrake.{name}")
            for name in ("multibody.optimization", "multibody.plant", "multibody.tree", "trajectories")
        )
    except ImportError:
        return None
    rng = np.random.default_rng(seed)
    waypoints, places = rng.uniform(-1.0, 1.0, (6, 3)), np.linspace(0.0, 1.0, 6)
    velocity, acceleration = rng.uniform(0.5, 2.0, (2, 3))
    robot = _gantry()
    names = robot.mechanism.active
    limits = po.Limits(
        velocity=dict(zip(names, velocity.tolist(), strict=True)),
        acceleration=dict(zip(names, acceleration.tolist(), strict=True)),
    )
    spline = make_interp_spline(places, waypoints)  # cubic, not-a-knot, as Drake's
    path = po.Path.along(robot, robot.mechanism.operational, spline, np.tile(waypoints[0], 2))
    start, goal = (dict(zip("xyz", point.tolist(), strict=True)) for point in waypoints[[0, -1]])
    problem = po.Problem(po.Scene(robot), start, goal, limits=limits)
    ours = po.TimeOptimal(n_grid=400).retime(problem, path)

    plant = plants.MultibodyPlant(0.0)
    frame = plant.world_frame()
    for name, axis in zip(names, np.eye(3), strict=True):
        body = plant.AddRigidBody(name, tree.SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
        plant.AddJoint(tree.PrismaticJoint(name, frame, body.body_frame(), axis))
        frame = body.body_frame()
    plant.Finalize()
    cubic = CubicSpline(places, waypoints)
    theirs = trajectories.PiecewisePolynomial.CubicWithContinuousSecondDerivatives(places, waypoints.T, False)
    middle = np.linspace(0.0, 1.0, 33)
    if not np.allclose(theirs.vector_values(middle).T, cubic(middle), rtol=0.0, atol=1e-12):
        raise po.BackendError("Drake's spline is another one")
    grid = ours.law(ours.law.breaks)
    retimer = optimization.Toppra(theirs, plant, np.concatenate([[0.0], grid[1:-1], [1.0]]))
    retimer.AddJointVelocityLimit(-velocity, velocity)
    retimer.AddJointAccelerationLimit(-acceleration, acceleration)
    law = retimer.SolvePathParameterization()
    return ours.duration, None if law is None else float(law.end_time())


def _gantry() -> po.Robot:
    links: list[Any] = [po.Base()]
    for father, axis in zip(("base", "slide x", "slide y"), "xyz", strict=True):
        links.append(po.Series(f"slide {axis}", father, joint=po.Prismatic(f"q_{axis}", axis=axis)))
    links.append(po.Mobile("block", coordinates=("x", "y", "z")))
    mechanism = po.Mechanism(
        "gantry",
        links,
        [po.Coincidence("slide z", (0, 0, 0), "block", (0, 0, 0))],
        active=("q_x", "q_y", "q_z"),
        operational=("x", "y", "z"),
        characteristic_length=1.0,
    )
    return po.Robot(mechanism, home=dict.fromkeys(mechanism.names, 0.0))
