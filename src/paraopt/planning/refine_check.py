"""The dense check of a refined path: what falls short of its bound, where, and by how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.planning.condition import PathBound, PathCondition, read_conditions
from paraopt.planning.nlp import Slack
from paraopt.planning.path import Path
from paraopt.planning.problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Violation:
    """Hold how far a path falls short of its bounds on a dense check, zero where it does not.

    Attributes:
        s: Parameters that were looked at, ascending, shape (n,).
        shortages: By quantity ("clearance" [m], "singularity" [1], "range" and "condition" [scaled]), shape (n,) each.
        pairs: Pairs of bodies that are too close somewhere.
        summary: All of it in a sentence.
    """

    s: Array
    shortages: dict[str, Array]
    pairs: NDArray[np.intp]
    summary: str

    @property
    def clearance(self) -> float:
        """Give the largest shortage of clearance [m]."""
        return float(self.shortages["clearance"].max())

    @property
    def singularity(self) -> float:
        """Give the largest shortage of a singularity margin [1]."""
        return float(self.shortages["singularity"].max())

    @property
    def range(self) -> float:
        """Give the largest excess over a range, in characteristic lengths or radians."""
        return float(self.shortages["range"].max())

    def size(self, horizon: float) -> float:
        """Give the largest shortage of all, clearance over a horizon [m]."""
        scale = {"clearance": horizon}
        return max(float(np.max(short, initial=0.0)) / scale.get(name, 1.0) for name, short in self.shortages.items())

    def places(self, **bounds: float) -> Array:
        """Give the parameters at which something falls short by more than a bound, by quantity, or than 0."""
        return self.s[np.any([short > bounds.get(name, 0.0) for name, short in self.shortages.items()], axis=0)]

    def tighten(self, slack: Slack, old: Array, new: Array, **most: float) -> Slack:
        """Ask for more at the samples beside the places that fall short.

        Args:
            slack: What was added so far, one number for all or one for each inner sample.
            most: What is asked for at most, by quantity: more than a sag between samples is cured by more samples.
            old: Parameters of the samples so far, ends included.
            new: Parameters of the samples from now on, ends included, which hold the old ones.
        """
        tightened = {}
        for name, tiny in (("clearance", 1e-7), ("singularity", 1e-7), ("range", 1e-9), ("condition", 1e-7)):
            before = np.broadcast_to(getattr(slack, name), len(old) - 2)
            added = np.interp(new[1:-1], old[1:-1], before) if len(old) > 2 else np.zeros(len(new) - 2)
            short = np.minimum(self.shortages[name], most.get(name, np.inf))
            for i in np.flatnonzero(short > 0.0):
                right = int(np.clip(np.searchsorted(new, self.s[i]), 1, len(new) - 1))
                for k in (right - 2, right - 1, right, right + 1):  # inner samples count from the second on
                    if 0 <= k - 1 < len(added):
                        near = np.interp(new[k], old[1:-1], before)
                        added[k - 1] = max(added[k - 1], near + 2.0 * short[i] + tiny)
            tightened[name] = added
        return Slack(**tightened)


def check_densely(
    problem: Problem,
    path: Path,
    count: int,
    constraints: Sequence[PathBound | PathCondition] = (),
    tolerance: float = 1e-9,
) -> Violation | None:
    """Look for violations at many points of a path.

    Args:
        problem: The problem.
        path: The path.
        count: Number of intervals between the points.
        constraints: Bounds of the user's own.
        tolerance: How far those may be exceeded, over their scales.

    Returns:
        The violation, or None when there is none.
    """
    s = np.linspace(0.0, 1.0, count + 1)
    X = path.solve(s)
    return check_configurations(problem, X, s, constraints, tolerance, path)


def check_configurations(
    problem: Problem,
    X: Array,
    s: Array,
    constraints: Sequence[PathBound | PathCondition] = (),
    tolerance: float = 1e-9,
    path: Path | None = None,
) -> Violation | None:
    """Look for violations at configurations of a path, and for too small distances between them where it is given.

    Args:
        problem: The problem.
        X: Configurations, shape (n, n_variables).
        s: Their parameters, ascending, shape (n,).
        constraints: Bounds of the user's own.
        tolerance: How far those may be exceeded, over their scales.
        path: The path between the configurations.

    Returns:
        The violation, or None when there is none.
    """
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    scale = problem.robot.kinematics.graph.variable_scale
    beyond = np.max(np.maximum(low - X, X - high) / scale, axis=1, initial=0.0)
    short = np.zeros(len(X))
    if problem.margins.singularity > 0.0:  # no margin is below zero
        margins = problem.space.margins(X)
        smallest = margins.parallel if problem.allow_mode_change else np.minimum(margins.parallel, margins.serial)
        short = problem.margins.singularity - smallest
    conditions = read_conditions(problem.robot.kinematics.graph, (*problem.conditions, *constraints))
    excess = -conditions.levels(X)
    off = np.max(excess, axis=1, initial=0.0)
    off = np.where(off > tolerance, off, 0.0)
    seen, distance, pair = (s, *problem.scene.clearances(X)) if path is None else look_for_closest(problem, path, s, X)
    near = problem.margins.clearance - distance
    if beyond.max() <= 0.0 and short.max() <= 0.0 and near.max() <= 0.0 and off.max() <= 0.0:
        return None
    offending = np.unique(pair[near > 0.0])
    named = ", ".join(problem.scene.pairs[p].name for p in offending)
    tell = []
    if beyond.max() > 0.0:
        i = int(np.argmax(np.max(np.maximum(low - X, X - high) / scale, axis=0)))
        tell.append(f"range of {problem.robot.mechanism.names[i]!r} exceeded by {beyond.max():.2g} (scaled)")
    if short.max() > 0.0:
        tell.append(f"singularity margin short by {short.max():.2g}")
    if near.max() > 0.0:
        tell.append(f"clearance short by {1e3 * near.max():.3g} mm ({named})")
    worst = np.max(excess, axis=0)
    tell += [
        f"{n} off by {w * c:.3g}" for n, c, w in zip(conditions.names, conditions.scales, worst, strict=True) if w > 0
    ]
    first = {"range": beyond, "singularity": np.maximum(short, 0.0), "condition": off}
    where = np.searchsorted(seen, s)
    shortages = {name: np.zeros(len(seen)) for name in first}
    for name, values_ in first.items():
        shortages[name][where] = values_
    shortages["clearance"] = np.maximum(near, 0.0)
    at = {name: float(seen[int(np.argmax(v))]) for name, v in shortages.items() if v.max() > 0.0}
    places = ", ".join(f"{name} at s = {place:.3f}" for name, place in at.items())
    return Violation(seen, shortages, offending, f"{', '.join(tell)}; worst {places}")


def look_for_closest(
    problem: Problem, path: Path, s: Array, X: Array, parts: int = 10, rounds: int = 6
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Measure the clearance at many points of a path, and between them where it may fall below what is asked.

    A distance falls to an edge in a straight line and rises again: between two points it may be lower than at both by
    as much as the slopes around them let it. There the path is divided again.

    Args:
        problem: The problem.
        path: The path.
        s: Parameters, ascending, shape (n,).
        X: Configurations there, shape (n, n_variables).
        parts: Number of parts of a divided interval.
        rounds: Bound on the divisions.

    Returns:
        Parameters of all points that were looked at, smallest distances there [m], and indices of their pairs.
    """
    distance, pair = problem.scene.clearances(X)
    if not problem.scene.pairs:
        return s, distance, pair
    for _ in range(rounds):
        step = np.diff(s)
        slope = np.abs(np.diff(distance)) / step
        steepest = np.maximum(slope, np.maximum(np.append(slope[1:], 0.0), np.append(0.0, slope[:-1])))
        lowest = 0.5 * (distance[:-1] + distance[1:] - steepest * step)
        doubtful = np.flatnonzero((lowest < problem.margins.clearance) & (step > 1e-9))
        if np.min(distance) < problem.margins.clearance or not doubtful.size:
            break
        between = (s[doubtful, None] + step[doubtful, None] * (np.arange(1, parts) / parts)).ravel()
        found, which = problem.scene.clearances(path.solve(between))
        order = np.argsort(np.concatenate([s, between]), kind="stable")
        s = np.concatenate([s, between])[order]
        distance, pair = np.concatenate([distance, found])[order], np.concatenate([pair, which])[order]
    return s, distance, pair
