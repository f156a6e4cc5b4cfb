"""What the refiner sees at its samples: values against the kinematics, gradients against finite differences."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import paraopt as po
from motions import problem_of, turning_problem
from paraopt.planning.evaluate import SampleEvaluator, SampleValues
from support import assert_derivative

CASES = {
    # poses inside the range of the barriers: near the cylinder, near the box, beside the ball
    "raf cylinder": (lambda: problem_of("cylinder"), [[0.01, -0.05, 0.481], [-0.03, -0.045, 0.47]]),
    "raf box": (lambda: problem_of("box"), [[0.012, 0.021, 0.458], [-0.044, 0.01, 0.462]]),
    "3-RPR ball": (lambda: turning_problem(True), [[0.02, -0.12, 3.1], [-0.11, 0.07, 3.25]]),
}


def _evaluator(name: str) -> tuple[po.Problem, np.ndarray, SampleEvaluator]:
    problem, values = CASES[name][0](), np.array(CASES[name][1])
    names, X = problem.independent, np.tile(problem.start_configuration.X, (2, 1))
    start = X[:, problem.robot.mechanism.indices(names)].copy()
    for share in np.linspace(0.0, 1.0, 31)[1:]:
        closed = problem.robot.kinematics.solve_batch(names, start + share * (values - start), X)
        assert np.all(closed.converged)
        X = closed.X
    pairs = problem.scene.near_pairs(X, 0.05)
    assert len(pairs) > 0
    return problem, values, SampleEvaluator(problem, X, pairs)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("what", ["bounded", "margins", "logarithms", "distances"])
def test_gradients_are_exact(name: str, what: str) -> None:
    _, values, evaluator = _evaluator(name)
    # distances have kinks where the nearest points change sides: small steps stay on one side of them. coal's witness
    # points are good to some 1e-9 m, over a step of 1e-5 m that is 1e-4
    step, tolerance = (1e-4, 1e-4) if what == "distances" else (1e-3, 1e-7)
    for i in range(len(values)):

        def evaluate(point: np.ndarray, i: int = i) -> np.ndarray:
            moved = values.copy()
            moved[i] = point
            return getattr(evaluator(moved), what)[i]

        analytic = getattr(evaluator(values), f"d_{what}")[i]
        assert_derivative(analytic, evaluate, values[i], step=step, tolerance=tolerance)


@pytest.mark.parametrize("name", CASES)
def test_values_are_those_of_kinematics_and_scene(name: str) -> None:
    problem, values, evaluator = _evaluator(name)
    result = evaluator(values)
    assert result.converged
    assert np.max(problem.robot.kinematics.scaled_residual(result.X)) <= 1e-12
    np.testing.assert_array_equal(result.X[:, problem.robot.mechanism.indices(problem.independent)], values)
    margins = problem.space.margins(result.X)
    # the same quantity by another algorithm (singular values against eigenvalues): half the digits at worst
    np.testing.assert_allclose(result.margins, np.column_stack([margins.parallel, margins.serial]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        result.logarithms, np.column_stack([margins.log_parallel, margins.log_serial]), rtol=0, atol=1e-9
    )
    smallest, pair = problem.scene.clearances(result.X)
    near = [list(evaluator.pairs).index(p) for p in pair]
    np.testing.assert_allclose(result.distances[[0, 1], near], smallest, rtol=0, atol=1e-9)
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    scale = problem.robot.kinematics.graph.variable_scale
    bounded = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
    np.testing.assert_array_equal(evaluator.bounded, bounded)
    np.testing.assert_array_equal(result.bounded, result.X[:, bounded] / scale[bounded])


def test_own_quantities_and_second_derivatives_are_exact() -> None:
    problem, values, plain = _evaluator("3-RPR ball")
    bounds = [
        po.PathBound("turn", lambda v, X: ca.sin(v["theta"]) * X["rod 1"][0, 3], scale=0.5),
        po.PathBound("leg", lambda v, _: v["rho1"] ** 2 + v["phi2"]),
    ]
    evaluator = SampleEvaluator(problem, plain(values).X, plain.pairs, bounds)
    result = evaluator(values)
    names = problem.robot.mechanism.names
    expected = result.X[:, names.index("rho1")] ** 2 + result.X[:, names.index("phi2")]
    np.testing.assert_allclose(result.conditions[:, 1], expected, rtol=0, atol=1e-12)
    second = evaluator.second(result.X, result.T)
    weights = np.array([[0.7, -0.4], [0.2, 1.1]])
    bent = evaluator.conditions.curvature(result.X, result.T, second, weights)
    margins = evaluator.bend_margins(result.X, result.T, weights)
    for i in range(len(values)):

        def at(point: np.ndarray, i: int = i) -> SampleValues:
            moved = values.copy()
            moved[i] = point
            return evaluator(moved)

        assert_derivative(
            result.d_conditions[i], lambda p, at=at, i=i: at(p).conditions[i], values[i], step=1e-3, tolerance=1e-7
        )
        # second derivatives against first ones: every variable, the own quantities, the margins
        assert_derivative(second[i], lambda p, at=at, i=i: at(p).T[i], values[i], step=1e-3, tolerance=1e-6)
        for matrix, name in ((bent[i], "d_conditions"), (margins[i], "d_margins")):
            slope = lambda p, at=at, i=i, name=name: weights[i] @ getattr(at(p), name)[i]  # noqa: E731
            assert_derivative(matrix, slope, values[i], step=1e-3, tolerance=1e-5)


def test_what_cannot_be_closed_is_said_and_forgotten() -> None:
    _, values, evaluator = _evaluator("raf cylinder")
    before = evaluator(values)
    far = values.copy()
    far[1, 2] = 1.5
    assert not evaluator(far).converged
    # the failed samples do not spoil the next evaluation
    after = evaluator(values)
    assert after.converged
    # both are solved to a scaled residual of 1e-12
    np.testing.assert_allclose(after.X, before.X, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", CASES)
def test_distances_bend_as_their_gradients_do(name: str) -> None:
    _, values, evaluator = _evaluator(name)
    result = evaluator(values)
    near = np.min(result.distances, axis=1)
    weights = np.where(result.distances == near[:, None], 3.0, 0.0)  # of the nearest pair of each sample
    bent = evaluator.bend_distances(result.X, result.T, weights)
    assert np.max(np.abs(bent)) > 1.0  # a body as round as 0.3 m or less, or a turn about a point as near [1/m]
    for i in range(len(values)):

        def slope(point: np.ndarray, i: int = i) -> np.ndarray:
            moved = values.copy()
            moved[i] = point
            return weights[i] @ evaluator(moved).d_distances[i]

        # witness points leave normals free by 2e-4 at worst: that over steps of 0.1 mm to 1 mm
        assert_derivative(bent[i], slope, values[i], step=1e-3, tolerance=0.1)
        np.testing.assert_allclose(bent[i], bent[i].T, rtol=0, atol=1e-12)
    assert not np.any(evaluator.bend_distances(result.X, result.T, np.zeros_like(weights)))


def test_a_large_step_does_not_close_the_loops_on_another_solution() -> None:
    problem, values, plain = _evaluator("raf cylinder")
    X = plain(values).X
    far = values.copy()
    far[0] = (-0.2325, 0.0555, 0.2238)  # half a reach away: what is predicted there is nothing like the robot
    walked = X
    for share in np.linspace(0.0, 1.0, 101)[1:]:
        closed = problem.space.solve(values + share * (far - values), walked)
        assert np.all(closed.converged)
        walked = closed.X
    unbounded = SampleEvaluator(problem, X, plain.pairs, reach=np.inf)(far)
    assert unbounded.converged  # closed, and with the signs of the start
    assert np.max(np.abs(unbounded.X - walked)) > 1.0  # but it is not where the motion leads
    bounded = SampleEvaluator(problem, X, plain.pairs)
    assert not bounded(far).converged
    # a shorter step is taken as before
    near = bounded(values + 0.1 * (far - values))
    assert near.converged


def test_samples_are_followed_again_from_an_earlier_result() -> None:
    _, values, evaluator = _evaluator("raf box")
    first = evaluator(values)
    evaluator(values + 0.01)
    assert np.max(np.abs(evaluator.near - first.X)) > 1e-3
    evaluator.follow_from(first)
    np.testing.assert_array_equal(evaluator.near, first.X)


def test_evaluations_are_counted() -> None:
    _, values, evaluator = _evaluator("raf box")
    for _ in range(3):
        evaluator(values)
    assert evaluator.evaluations == 3
