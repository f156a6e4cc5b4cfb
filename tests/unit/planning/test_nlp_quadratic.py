"""Quadratic programs of a step: their conditions of optimality, whatever the guess; linear ones that tell conflicts."""

from __future__ import annotations

import numpy as np
import pytest
import qpsolvers
import scipy.sparse as sp

import paraopt as po
from paraopt.planning import nlp_quadratic
from paraopt.planning.nlp_conflict import find_conflict
from paraopt.planning.nlp_quadratic import QuadraticProgram

Array = np.ndarray


def random_program(seed: int, n: int = 12, k: int = 20, spread: float = 3.0) -> QuadraticProgram:
    """Build a program of which zero is a point, with curvatures that differ by 10^(2 spread)."""
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(n, n)))[0]
    P = turn @ np.diag(10.0 ** random.uniform(-spread, spread, n)) @ turn.T
    G = random.normal(size=(k, n))
    G /= np.linalg.norm(G, axis=1, keepdims=True)
    q = random.normal(size=n)
    return QuadraticProgram(0.5 * (P + P.T), q, G, random.uniform(0.0, 0.3, k), -np.ones(n), np.ones(n))


def assert_optimal(program: QuadraticProgram, z: Array, y: Array) -> None:
    """Check feasibility, signs, complementarity, and that the gradient is balanced by rows and box."""
    assert np.max(program.G @ z - program.h) < 1e-7
    assert np.all((program.low - 1e-9 <= z) & (z <= program.high + 1e-9))
    assert np.all(y >= 0.0)
    size = 1.0 + np.max(y)
    assert np.max(np.abs(y * (program.G @ z - program.h))) < 1e-6 * size
    slope = program.P @ z + program.q + program.G.T @ y
    inside = (z > program.low + 1e-7) & (z < program.high - 1e-7)
    assert np.max(np.abs(slope[inside]), initial=0.0) < 1e-6 * size
    assert np.all(slope[z >= program.high - 1e-7] < 1e-6 * size)  # it pushes outwards
    assert np.all(slope[z <= program.low + 1e-7] > -1e-6 * size)


@pytest.mark.parametrize("seed", range(30))
def test_the_conditions_of_optimality_hold_whatever_is_likely(seed: int) -> None:
    program = random_program(seed)
    random = np.random.default_rng(100 + seed)
    found = [program.solve(likely) for likely in (np.zeros(20, dtype=bool), random.uniform(size=20) < 0.3)]
    for optimum in found:
        assert optimum.is_exact
        assert_optimal(program, optimum.z, optimum.y)
    np.testing.assert_allclose(found[0].z, found[1].z, rtol=0, atol=1e-6)
    # asked again with the rows that push it is done at once, without a solver
    again = program._exchange(np.concatenate([(found[0].y > 0).astype(int), _sides(program, found[0].z)]), 1)
    assert again is not None
    np.testing.assert_allclose(again.z, found[0].z, rtol=0, atol=1e-9)


def _sides(program: QuadraticProgram, z: Array) -> Array:
    return np.where(z >= program.high - 1e-9, 1, np.where(z <= program.low + 1e-9, -1, 0))


def test_rows_that_are_there_twice_do_no_harm() -> None:
    program = random_program(3)
    twice = QuadraticProgram(
        program.P, program.q, np.vstack([program.G] * 2), np.tile(program.h, 2), program.low, program.high
    )
    optimum = twice.solve(np.ones(40, dtype=bool))
    np.testing.assert_allclose(optimum.z, program.solve(np.zeros(20, dtype=bool)).z, rtol=0, atol=1e-3)


def test_what_osqp_finds_is_taken_where_no_exchange_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    program = random_program(5)
    exact = program.solve(np.zeros(20, dtype=bool))
    asked: list[float] = []
    solve = qpsolvers.solve_problem

    def listen(*arguments: object, **options: float) -> qpsolvers.Solution:
        asked.append(options["eps_abs"])
        return solve(*arguments, **options)

    monkeypatch.setattr(QuadraticProgram, "_exchange", lambda *_: None)
    monkeypatch.setattr(nlp_quadratic.qpsolvers, "solve_problem", listen)
    rough = program.solve(np.zeros(20, dtype=bool), (1e-3, 1e-7))
    assert asked == [1e-3, 1e-7]
    assert not rough.is_exact
    np.testing.assert_allclose(rough.z, exact.z, rtol=0, atol=1e-4)


def test_a_failure_of_osqp_is_told() -> None:
    program = random_program(1)
    bent = QuadraticProgram(-program.P, program.q, program.G, program.h, program.low, program.high)
    with pytest.raises(po.BackendError, match="OSQP failed on the quadratic program of a step"):
        bent.solve(np.zeros(20, dtype=bool))


def test_a_conflict_tells_what_a_step_can_reach_and_what_forbids_more() -> None:
    # x >= 1 and x <= -1 cannot both hold, y >= 3 is too far for one step; z is free
    J = sp.csr_matrix(np.diag([1.0, 1.0, 1.0])[[0, 0, 1, 2]])
    low, high = np.array([1.0, -np.inf, -np.inf, -5.0]), np.array([np.inf, -1.0, 5.0, 5.0])
    box = np.full(3, -np.inf), np.full(3, np.inf)
    found = find_conflict(J, low, high, box, 10.0, 1.0)
    assert found is not None
    assert found.reachable == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(found.weights, [0.5, 0.5, 0.0, 0.0], rtol=0, atol=1e-9)
    # one of them alone can be met, as far as the step reaches
    alone = find_conflict(J, low, np.array([np.inf, np.inf, 5.0, 5.0]), box, 0.4, 1.0)
    assert alone is not None
    assert alone.reachable == pytest.approx(0.6, abs=1e-9)


def test_a_bound_that_holds_counts_as_far_as_it_stands_against() -> None:
    # x >= 1 is broken; x <= 0.25 holds and must go on to
    J = sp.csr_matrix(np.array([[1.0], [1.0]]))
    found = find_conflict(J, np.array([1.0, -np.inf]), np.array([np.inf, 0.25]), (-np.ones(1), np.ones(1)), 1.0, 1.0)
    assert found is not None
    assert found.reachable == pytest.approx(0.75, abs=1e-9)
    np.testing.assert_allclose(found.weights, [1.0, 1.0], rtol=0, atol=1e-9)
