"""Models on arrays: the same answers as one by one, with a status per row."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import paraopt as po
from support import five_bar_robot, raf_robot, two_rpr, two_rpr_values, vector


def poses(count: int, seed: int = 0) -> np.ndarray:
    """Draw poses of the RAF in and around its workspace, many of them out of reach."""
    return np.random.default_rng(seed).uniform((-0.15, -0.15, 0.35), (0.15, 0.15, 0.75), size=(count, 3))


def test_nearest_rows_are_those_of_single_questions() -> None:
    robot = raf_robot()
    x = poses(40)
    batch = robot.kinematics.fit_batch(("x", "y", "z"), x, robot.home_configuration.X)
    assert 5 < batch.count(po.Status.CONVERGED) < 35
    for i in range(0, 40, 4):
        single = robot.kinematics.fit(dict(zip("xyz", x[i].tolist(), strict=True)), robot.home_configuration)
        assert batch.status[i] is single.status
        assert batch.distance[i] == pytest.approx(single.distance, abs=1e-6)
    low, high = robot.limits.bounds(robot.mechanism)
    assert np.all((low - 1e-6 <= batch.X) & (high + 1e-6 >= batch.X))
    assert_allclose(robot.kinematics.scaled_residual(batch.X), batch.residual, atol=1e-14)
    assert np.all(batch.residual < 1e-10)


def test_weights_count_in_batches() -> None:
    robot = five_bar_robot()
    values = [[20.0, 0.0, 1.3], [1.0, 1.0, 1.0]]
    for weight in (1.0, 30.0):
        batch = robot.kinematics.fit_batch(("x", "y", "theta1"), values, robot.home_configuration.X, {"theta1": weight})
        for row, X, distance in zip(values, batch.X, batch.distance, strict=True):
            impose = dict(zip(("x", "y", "theta1"), row, strict=True))
            single = robot.kinematics.fit(impose, robot.home_configuration, {"theta1": weight})
            assert single.distance == pytest.approx(distance, rel=1e-5)
            assert X[0] == pytest.approx(single.X[0], abs=1e-4)


def test_inverse_and_forward_rows_carry_their_status() -> None:
    kinematics = po.Kinematics(two_rpr(), "virtual machine")
    start = vector(kinematics.mechanism, two_rpr_values(1.0, 2.0))
    x = [[1.5, 1.0], [0.0, 0.0], [np.nan, 1.0], [2.0, np.inf], [1.0, -2.0]]
    starts = np.array([vector(kinematics.mechanism, two_rpr_values(*row)) if np.all(np.isfinite(row)) else start
                       for row in x])  # fmt: skip
    batch = kinematics.inverse_batch(x, starts)
    assert [s.name for s in batch.status] == ["CONVERGED", "SINGULAR", "FAILED", "FAILED", "CONVERGED"]
    assert_array_equal(batch.is_exact, [True, True, False, False, True])
    assert_array_equal(batch.undetermined, [0, 1, 0, 0, 0])
    assert np.isinf(batch.residual[2])
    # legs of 1 cannot meet on feet 4 apart; legs of 2 are in one line
    q = [[2.0, 3.0], [1.0, 1.0], [2.0, 2.0]]
    aligned = vector(kinematics.mechanism, two_rpr_values(2.0, 0.0))
    forward = kinematics.forward_batch(q, [start, start, aligned])
    assert [s.name for s in forward.status] == ["CONVERGED", "FAILED", "SINGULAR"]
    assert forward.X[0, -2:] == pytest.approx([(4 - 9 + 16) / 8, np.sqrt(4 - (11 / 8) ** 2)])


def test_rows_that_are_not_finite_fail_alone() -> None:
    robot = raf_robot()
    x = poses(6, seed=1)
    x[2, 1] = np.nan
    batch = robot.kinematics.fit_batch(("x", "y", "z"), x, robot.home_configuration.X)
    assert batch.status[2] is po.Status.FAILED
    assert batch.count(po.Status.FAILED) == 1


def test_rows_from_open_starts_are_answered_or_failed() -> None:
    robot = raf_robot()
    starts = np.random.default_rng(3).uniform(-1, 1, (6, 32))
    batch = robot.kinematics.fit_batch(("x", "y", "z"), poses(6, seed=2), starts)
    low, high = robot.limits.bounds(robot.mechanism)
    answered = batch.status != po.Status.FAILED
    assert np.all(batch.residual[answered] < 1e-10)
    assert np.all((low - 1e-6 <= batch.X) & (high + 1e-6 >= batch.X), axis=1)[answered].all()


def test_no_rows() -> None:
    robot = five_bar_robot()
    for batch in (
        robot.kinematics.inverse_batch(np.empty((0, 2)), robot.home_configuration.X),
        robot.kinematics.fit_batch(("x", "y"), np.empty((0, 2)), robot.home_configuration.X),
    ):
        assert batch.X.shape == (0, 6)
        assert batch.status.shape == (0,)


@pytest.mark.parametrize(
    ("values", "starts", "word"),
    [
        ([[1.0]], None, r"values .* shape \(1, 1\); they must be \(n, 2\)"),
        ([[1.0, 2.0]], [[0.0] * 5], r"starts .* shape \(1, 5\)"),
        ([[1.0, 2.0]] * 3, [[0.0] * 6] * 2, "2 starts for 3 rows"),
        ([["far", 2.0]], None, "must be numbers"),
    ],
)
def test_faulty_rows_are_refused(values: Any, starts: Any, word: str) -> None:
    robot = five_bar_robot()
    with pytest.raises(po.DefinitionError, match=word):
        robot.kinematics.inverse_batch(values, robot.home_configuration.X if starts is None else starts)
