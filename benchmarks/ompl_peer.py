"""OMPL's RRT-Connect on a problem of paraopt; imported only where OMPL is installed."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from benchmarks.seeds import Attempt, Judge
from numpy.typing import NDArray
from ompl import base, geometric, util

import paraopt as po

Array = NDArray[np.float64]


def search(problem: po.Problem, seed: int, limit: float, bounded: bool) -> Attempt | None:
    """Search a way.

    Args:
        problem: The problem.
        seed: Seed of the random numbers.
        limit: Time that it may take [s].
        bounded: Whether angles without bounds end at -pi and pi.

    Returns:
        What came out; None where no way was found.
    """
    util.noOutputHandler()
    util.RNG.setSeed(seed + 1)
    periodic = np.zeros_like(problem.periodic) if bounded else problem.periodic
    judge = Judge(problem)
    space = base.CompoundStateSpace()
    flat = np.flatnonzero(~periodic)
    real = base.RealVectorStateSpace(len(flat))
    bounds = base.RealVectorBounds(len(flat))
    low, high = _box(problem)
    for k, i in enumerate(flat):
        bounds.setLow(k, float(low[i] * problem.metric[i]))
        bounds.setHigh(k, float(high[i] * problem.metric[i]))
    real.setBounds(bounds)
    space.addSubspace(real, 1.0)
    for i in np.flatnonzero(periodic):
        space.addSubspace(base.SO2StateSpace(), float(problem.metric[i]))

    def read(state: Any) -> Array:
        value = np.empty(len(periodic))
        value[flat] = [state[0][k] for k in range(len(flat))]
        value[flat] /= problem.metric[flat]
        for k, i in enumerate(np.flatnonzero(periodic), start=1):
            value[i] = state[k].value
        return value

    def write(value: Array) -> Any:
        state = space.allocState()
        for k, i in enumerate(flat):
            turned = (value[i] + np.pi) % (2 * np.pi) - np.pi if problem.periodic[i] else value[i]
            state[0][k] = float(turned * problem.metric[i])
        for k, i in enumerate(np.flatnonzero(periodic), start=1):
            state[k].value = float((value[i] + np.pi) % (2 * np.pi) - np.pi)
        return state

    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: judge(read(state)))
    setup.setStartAndGoalStates(write(problem.start_configuration.X[problem.index]), write(problem.goal_values()))
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(judge.spacing / space.getMaximumExtent())
    planner = geometric.RRTConnect(information)
    planner.setRange(5.0 * judge.spacing)
    setup.setPlanner(planner)
    begin = time.perf_counter()
    setup.solve(limit)
    seconds = time.perf_counter() - begin
    if not setup.haveExactSolutionPath():
        return None
    checks = judge.ground.validity.checks
    first = _length(problem, setup.getSolutionPath(), read)
    setup.simplifySolution()
    return Attempt(seconds, first, _length(problem, setup.getSolutionPath(), read), checks)


def _length(problem: po.Problem, path: Any, read: Any) -> float:
    points = np.array([read(path.getState(k)) for k in range(path.getStateCount())])
    return float(np.sum(np.linalg.norm(problem.turn(np.diff(points, axis=0)) * problem.metric, axis=1)))


def _box(problem: po.Problem) -> tuple[Array, Array]:
    """Give the box in which positions are drawn: ranges where there are any, else the distance of the ends around."""
    start, goal = problem.start_configuration.X[problem.index], problem.goal_values()
    reach = float(np.linalg.norm((goal - start) * problem.metric)) / problem.metric
    low, high = np.minimum(start, goal) - reach, np.maximum(start, goal) + reach
    low, high = np.where(problem.periodic, -np.pi, low), np.where(problem.periodic, np.pi, high)
    lower, upper = (bound[problem.index] for bound in problem.bounds.bounds(problem.robot.mechanism))
    return np.where(np.isfinite(lower), lower, low), np.where(np.isfinite(upper), upper, high)
