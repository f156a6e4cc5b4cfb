"""The compiled iteration: the same course as the one in Python, whoever sits in the lanes beside."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import paraopt as po
from paraopt.kinematics import c_source, find_compiler
from paraopt.kinematics import newton as newton_module
from paraopt.kinematics.c_source import generate_newton
from paraopt.kinematics.newton import NewtonLoop
from paraopt.kinematics.solve import solve_closure

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler on this machine")
OPTIONS = po.SolveOptions()


def loops(function: Callable[[], po.Robot]) -> tuple[po.Kinematics, po.Kinematics, np.ndarray]:
    robot = function()
    compiled = po.Kinematics(robot.mechanism, "compiled")
    return compiled, po.Kinematics(robot.mechanism, "virtual machine"), robot.home_configuration.X


def spread(kinematics: po.Kinematics, X: np.ndarray, n: int, size: float, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(-size, size, (n, len(X)))
    return X + noise * kinematics.graph.variable_scale


@pytest.mark.parametrize("function", [po.robots.stewart, po.robots.three_rpr, po.robots.five_bar, po.robots.raf])
@pytest.mark.parametrize("imposed", ["active", "operational", "nothing"])
def test_same_course_as_in_python(function: Callable[[], po.Robot], imposed: str) -> None:
    compiled, slow, home = loops(function)
    assert compiled.functions.newton.is_compiled
    assert not slow.functions.newton.is_compiled
    free = np.ones(len(home))
    free[compiled.mechanism.indices(getattr(compiled.mechanism, imposed, ()))] = 0.0
    starts = spread(compiled, home, 40, 0.08)
    ours, theirs = (solve_closure(k.functions, starts, free) for k in (compiled, slow))
    assert_array_equal(ours.converged, theirs.converged)
    assert np.count_nonzero(ours.converged) > 20
    # both close to 1e-12, which the well-conditioned ones among these carry to the values; where the last step is
    # round-off the courses may differ by one
    good = ours.converged
    scale = compiled.graph.variable_scale
    assert np.quantile(np.max(np.abs(ours.X - theirs.X)[good] / scale, axis=1), 0.9) < 1e-10
    assert_array_equal(ours.X[:, free == 0], starts[:, free == 0])
    assert np.all(ours.residual[good] <= OPTIONS.tolerance)
    assert_allclose(ours.residual, compiled.scaled_residual(ours.X), atol=1e-14)


def test_neighbours_do_not_matter() -> None:
    """Alone, in batches of every size around the number of lanes, and in another order: the same bits."""
    compiled, _, home = loops(po.robots.stewart)
    free = np.ones(len(home))
    free[:6] = 0.0
    starts = spread(compiled, home, 13, 0.3)
    starts[4, 7], starts[9, 2] = np.nan, np.inf

    def run(which: object) -> tuple[np.ndarray, ...]:
        return compiled.functions.newton(starts[which], free, 1e-12, 60, 1e-8, 0.5)

    whole = run(slice(None))
    for n in range(1, 14):
        for part, all_of_it in zip(run(slice(n)), whole, strict=True):
            assert_array_equal(part, all_of_it[:n])
    order = np.random.default_rng(1).permutation(13)
    for part, all_of_it in zip(run(order), whole, strict=True):
        assert_array_equal(part, all_of_it[order])
    # what is no number does not converge, takes no time and stays as it is
    assert_array_equal(whole[1][[4, 9]], np.inf)
    assert_array_equal(whole[2][[4, 9]], 0)
    assert_array_equal(whole[0][[4, 9]], starts[[4, 9]])
    assert np.all(whole[1][[0, 1, 2, 3, 5]] < np.inf)


def test_number_of_iterations_is_counted_and_bounded() -> None:
    compiled, _, home = loops(po.robots.five_bar)
    free = np.ones(len(home))
    free[:2] = 0.0
    starts = spread(compiled, home, 8, 0.05)
    starts[:, :2], starts[0] = home[:2], home
    X, residual, count = compiled.functions.newton(starts, free, 1e-12, 60, 1e-8, 0.5)
    assert count[0] == 1  # opened once: closed already
    assert np.all(residual <= 1e-12)
    assert np.all(count[1:] > 2)
    few, rest, bounded = compiled.functions.newton(starts, free, 1e-12, 2, 1e-8, 0.5)
    assert_array_equal(bounded, np.minimum(count, 2))
    assert np.all(rest[1:] > 1e-12)
    # the first point is the start; where the second one is better, it is the first step's
    assert np.max(np.abs(few - X)[1:]) > 1e-9


def test_steps_are_limited() -> None:
    compiled, _, home = loops(po.robots.three_rpr)
    free = np.ones(len(home))
    free[:3] = 0.0
    starts = spread(compiled, home, 8, 0.3)
    _, _, limited = compiled.functions.newton(starts, free, 1e-12, 60, 1e-8, 0.01)
    _, _, plain = compiled.functions.newton(starts, free, 1e-12, 60, 1e-8, 0.5)
    assert np.all(limited > plain)
    X, _, _ = compiled.functions.newton(starts, free, 1e-12, 2, 1e-8, 0.01)
    assert np.max(np.abs(X - starts) / compiled.graph.variable_scale) <= 0.01 * (1 + 1e-12)


def test_nothing_to_close() -> None:
    kinematics = po.Kinematics(po.robots.serial_2r().mechanism, "compiled")
    X = np.array([[0.3, 0.4, *[0.0] * (len(kinematics.mechanism.names) - 2)]])
    solution = solve_closure(kinematics.functions, X, np.ones(X.shape[1]))
    assert solution.converged.all()
    empty = solve_closure(kinematics.functions, X[:0], np.ones(X.shape[1]))
    assert (empty.X.shape, empty.converged.shape, empty.iterations) == ((0, X.shape[1]), (0,), 0)


def test_vectors_know_the_four_operations_only() -> None:
    x, entries, free, damping = ca.SX.sym("x", 2), ca.SX.sym("e", 2), ca.SX.sym("free", 2), ca.SX.sym("damping")
    opening = ca.Function("paraopt_open", [x], [x - 1, ca.SX.ones(2)])
    f = ca.SX.sym("f", 2)
    for step in (ca.sin(f), ca.fabs(f), ca.sqrt(entries), ca.if_else(f > 0, f, entries)):
        correcting = ca.Function("paraopt_correct", [entries, f, free, damping], [step])
        with pytest.raises(po.BackendError, match="four operations only"):
            generate_newton(opening, correcting, [1.0, 1.0], "loop")


def test_constants_fill_all_lanes() -> None:
    """A correction with constants of its own: y = -(f - 0.25) / 4, on f = 4 x - 1, solved at x = 0.5 where f = 1."""
    x, entries, free, damping = ca.SX.sym("x", 2), ca.SX.sym("e", 2), ca.SX.sym("free", 2), ca.SX.sym("damping")
    f = ca.SX.sym("f", 2)
    opening = ca.Function("paraopt_open", [x], [4 * x - 1, ca.SX.ones(2)])
    correcting = ca.Function("paraopt_correct", [entries, f, free, damping], [ca.vertcat(-f[0] / 4, -0.125)])
    loop = NewtonLoop(opening, correcting, np.array([1.0, 2.0]), "compiled")
    X, residual, count = loop(np.array([[0.5, 0.5]] * 5), np.ones(2), 1e-12, 5, 1e-8, 10.0)
    # the second one moves by -0.125 of a scale of 2
    assert_allclose(X, [[0.25, 0.25]] * 5, atol=1e-15)
    assert_allclose(residual, 0.0, atol=1e-12)
    assert_array_equal(count, 2)


def test_long_functions_are_cut_without_a_trace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, _, home = loops(po.robots.stewart)
    free = np.ones(len(home))
    free[:6] = 0.0
    starts = spread(whole, home, 9, 0.1)
    expected = whole.functions.newton(starts, free, 1e-12, 60, 1e-8, 0.5)
    codes = []
    for part in (10**9, 300):
        monkeypatch.setattr(c_source, "_PART", part)
        monkeypatch.setenv("PARAOPT_CACHE", str(tmp_path / str(part)))
        monkeypatch.setattr(newton_module, "generate_newton", lambda *a: codes.append(generate_newton(*a)) or codes[-1])
        cut = po.Kinematics(whole.mechanism, "compiled").functions.newton
        for ours, theirs in zip(cut(starts, free, 1e-12, 60, 1e-8, 0.5), expected, strict=True):
            assert_array_equal(ours, theirs)
    counts = [code.count("static void lanes_correct_") for code in codes]
    assert counts[0] == 0
    assert counts[1] > 5


def test_without_a_compiler_it_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PARAOPT_COMPILE", "0")
    newton = po.Kinematics(po.robots.five_bar().mechanism).functions.newton
    assert not newton.is_compiled
    with pytest.raises(po.BackendError, match="not compiled"):
        newton(np.zeros((1, 6)), np.ones(6), 1e-12, 60, 1e-8, 0.5)
    with pytest.raises(po.BackendError, match="no C compiler"):
        _ = po.Kinematics(po.robots.five_bar().mechanism, "compiled").functions.newton
