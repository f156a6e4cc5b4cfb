"""The conditions of the square against tensions in the plane."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from cable_robots import planar
from paraopt.errors import DefinitionError
from paraopt.modes.cable import SquareConditions, cable_functions, has_wrench_closure

BAND = 1e-6
"""Angle from the bounds within which round-off may decide [rad]."""


@pytest.mark.parametrize(("side", "half_width"), [(1.0, 0.1), (4.0, 0.5)])
def test_conditions_agree_with_wrench_closure(side: float, half_width: float) -> None:
    conditions, robot = SquareConditions(side, half_width), planar(side, half_width)
    random = np.random.default_rng(20)
    k = 20_000
    x, y = random.uniform(half_width, side - half_width, k), random.uniform(0.0, side, k)
    poses = np.column_stack([x, y, random.uniform(-0.5 * np.pi, 0.5 * np.pi, k)])
    # half of the rotations are near a bound, where the verdict changes
    low, high = conditions.rotation_bounds(x, y)
    near = np.where(random.random(k) < 0.5, low, high) + random.choice([-1, 1], k) * 10.0 ** random.uniform(-5, -1, k)
    poses[::2, 2] = near[::2]
    margins = conditions.margins(poses)
    clear = np.abs(margins) > BAND
    assert np.mean(clear) > 0.99
    holds = conditions.hold(poses)
    assert 0.2 < np.mean(holds) < 0.8
    assert np.array_equal(holds[clear], has_wrench_closure(robot, poses)[clear])


def test_conditions_agree_with_linear_programs_on_tensions() -> None:
    """Wrench closure: tensions of one or more that balance nothing, and columns of full rank."""
    conditions, robot = SquareConditions(), planar()
    random = np.random.default_rng(21)
    k = 2000
    poses = np.column_stack([random.uniform(0.1, 0.9, k), random.uniform(0, 1, k), random.uniform(-1.5, 1.5, k)])
    W = cable_functions(robot).wrench_matrix(poses)
    solved = np.array([linprog(np.ones(4), A_eq=A, b_eq=np.zeros(3), bounds=(1, None)).status == 0 for A in W])
    clear = np.abs(conditions.margins(poses)) > BAND
    assert np.array_equal(conditions.hold(poses)[clear], solved[clear])


def test_a_heavy_platform_hangs_level_with_what_the_bounds_say() -> None:
    """Turned about the middle, the line through both points leaves the square through its corners at 45 degrees."""
    conditions = SquareConditions()
    low, high = conditions.rotation_bounds(0.5, 0.5)
    assert (float(low), float(high)) == pytest.approx((-np.pi / 4, np.pi / 4))
    low, high = conditions.rotation_bounds(np.array([0.2]), np.array([0.9]))
    assert low[0] == pytest.approx(-np.arctan2(0.1, 0.2))
    assert high[0] == pytest.approx(np.arctan2(0.1, 0.8))


def test_bounds_on_the_position() -> None:
    conditions = SquareConditions()
    inside = [0.5, 0.5, -0.5, 0.0]
    assert conditions.hold(inside)[0]
    for place, value in ((0, 0.05), (0, 0.95), (1, -0.1), (1, 1.1), (2, 0.1), (2, -1.1)):
        pose = list(inside)
        pose[place] = value
        assert not conditions.hold(pose)[0]


def test_sizes_are_checked() -> None:
    with pytest.raises(DefinitionError, match="narrower"):
        SquareConditions(side=1.0, half_width=0.5)
    with pytest.raises(DefinitionError, match="side"):
        SquareConditions(side=0.0)
    with pytest.raises(DefinitionError, match=r"\(k, 3\)"):
        SquareConditions().hold([0.1, 0.2])
    with pytest.raises(DefinitionError, match="must be numbers"):
        SquareConditions().hold("middle")
    with pytest.raises(DefinitionError, match="pose 1 is not finite"):
        SquareConditions().hold([[0.5, 0.5, 0.0], [0.5, np.nan, 0.0]])


def test_turned_over_the_platform_is_left_out() -> None:
    """With its cables crossed it can be held as well; the conditions are those of the plain posture."""
    assert has_wrench_closure(planar(), [0.5, 0.5, np.pi])[0]
    assert not SquareConditions().hold([0.5, 0.5, np.pi])[0]
