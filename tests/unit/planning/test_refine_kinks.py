"""Refinement where functions have kinks: edges of boxes that turn, nearest facets of tensions that change places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import paraopt as po
from paraopt.io import load_caspr
from paraopt.planning import Problem, nlp_ipopt
from paraopt.planning.nlp_ipopt import Answer, Bridge, solve_by_ipopt

DATA = Path(__file__).resolve().parents[2] / "data" / "caspr" / "IPAnema_1"
START = np.array([1.0, 2.5])
Array = np.ndarray


class Valley:
    """Minimise `y^2 + 5 (x - 0.3)^2 + 0.1 x` over `1 <= y - slope |x - 0.3|`: the optimum is the kink, (0.3, 1)."""

    n_x = n_y = 2
    n_g, n_level = 1, 0
    pattern = (np.array([0, 0]), np.array([0, 1]))
    error = None

    def __init__(self, slope: float) -> None:
        self.slope, self.seen, self.recalled = slope, 0, None

    def __call__(self, x: Array) -> tuple[float, Array, Array, Array]:
        self.seen += 1
        side = 1.0 if x[0] > 0.3 else -1.0
        g = np.array([x[1] - self.slope * abs(x[0] - 0.3)])
        f = float(x[1] ** 2 + 5.0 * (x[0] - 0.3) ** 2 + 0.1 * x[0])
        return f, np.array([10.0 * (x[0] - 0.3) + 0.1, 2.0 * x[1]]), g, np.array([-self.slope * side, 1.0])

    def at(self, x: Array) -> SimpleNamespace:
        return SimpleNamespace(x=np.array(x), f=self(x)[0])

    def recall(self, point: SimpleNamespace) -> None:
        self.recalled = point

    def hessian(self, x: Array, weight: float, multipliers: Array) -> Array:
        return weight * np.diag([10.0, 2.0])


def _solve(valley: Valley, iterations: int = 120) -> Answer:
    x = ca.MX.sym("x", 2)
    bridge = Bridge("nlp", valley, ("f", "g"), False)
    f, g = bridge(x)
    grad_f = Bridge("grad_f", valley, ("f", "grad_f"), True)
    jac_g = Bridge("jac_g", valley, ("g", "jac_g"), True)
    second = nlp_ipopt.Curvature(valley)
    free = np.full(2, np.inf)
    return solve_by_ipopt(
        {"x": x, "f": f, "g": g},
        {"grad_f": grad_f, "jac_g": jac_g, "hess_lag": second},
        valley,
        (np.ones(1), np.full(1, np.inf)),
        (-free, free),
        START,
        multipliers=None,
        iterations=iterations,
        tolerance=1e-5,
    )


def test_ipopt_ends_at_a_kink_where_nothing_is_gained_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    valley = Valley(0.1)
    answer = _solve(valley)
    assert answer.status == "converged: small gains"
    assert answer.iterations < 80
    assert answer.x[1] - 0.1 * abs(answer.x[0] - 0.3) >= 1.0 - 1e-7
    assert valley.recalled is not None  # what is known there is known again
    np.testing.assert_array_equal(valley.recalled.x, answer.x)
    assert valley(answer.x)[0] < 1.03 * 1.001  # of the optimum
    # without the watch it goes to and fro until the bound on the iterations, and ends off the bound
    monkeypatch.setattr(nlp_ipopt.Watch, "eval", lambda self, arguments: [0])
    blind = _solve(Valley(0.1))
    assert blind.status == "Maximum_Iterations_Exceeded"
    assert blind.x[1] - 0.1 * abs(blind.x[0] - 0.3) < 1.0 - 1e-4


def test_the_best_feasible_iterate_is_what_remains_of_a_search_that_does_not_end() -> None:
    valley = Valley(0.6)  # from side to side over a tenth: no small gains
    answer = _solve(valley)
    assert answer.status == "best feasible iterate before Maximum_Iterations_Exceeded"
    assert not answer.is_stuck
    assert answer.iterations == 120
    assert answer.x[1] - 0.6 * abs(answer.x[0] - 0.3) >= 1.0 - 1e-7
    assert 1.03 <= valley(answer.x)[0] < 0.5 * valley(START)[0]


def rise() -> Problem:
    """State a platform that hangs from four cables, low on both sides of a wall."""
    robot = po.robots.larm_hanging(tension=(0.5, 8.0))
    wall = po.Box(name="wall", size=(0.06, 0.6, 0.25), pose=po.transform((0.5, 0.5, -0.875)))
    cables = po.cable.read_hanging(robot, robot.mechanism.active)
    pose = {"y": 0.45, "z": -0.85, "gamma": 0.0}
    margin = po.cable.TensionMargin(cables, robot.mechanism, margin=0.2 * cables.weight / cables.n_cables)
    return po.Problem(
        po.Scene(robot, [wall]), {"x": 0.25, **pose}, {"x": 0.75, **pose},
        margins=po.Margins(clearance=0.01, singularity=0.01), conditions=(margin,),
    )  # fmt: skip


def ipanema() -> Problem:
    """State eight cables that carry a platform past a ball."""
    plate = po.Box(name="plate", size=(0.12, 0.12, 0.04))
    cables = replace(load_caspr(DATA).robot, velocity=1.0, acceleration=3.0, jerk=60.0, solids=[plate], t_min=10.0)
    ball = po.Sphere(name="ball", radius=0.15, pose=po.transform((0, 0, 1.0)))
    level = dict.fromkeys(cables.coordinates, 0.0)
    margin = po.cable.TensionMargin(cables, cables.robot.mechanism, margin=0.2 * cables.weight / cables.n_cables)
    return po.Problem(
        po.Scene(cables.robot, [ball]), level | {"x": -0.8, "y": 0.1, "z": 1.0}, level | {"x": 0.8, "y": 0.1, "z": 1.0},
        margins=po.Margins(clearance=0.01, singularity=0.01), conditions=(margin,),
    )  # fmt: skip


@pytest.mark.parametrize("state", [rise, ipanema])
def test_both_solvers_agree_on_machines_with_kinks(state: object) -> None:
    problem = state()
    seed = po.MixedSearch().seed(problem)
    lengths = [po.SplineRefiner(backend=backend).refine(problem, seed).length for backend in ("sqp", "ipopt")]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.003)  # found 0.03 % apart; what is asked for is 1 %
    assert max(lengths) < seed.length


def test_steps_are_followed_from_where_the_search_stands() -> None:
    """A step that was not taken may have led near a singularity: what follows begins from the place before it."""
    robot = po.robots.five_bar()
    home = robot.home_configuration
    goal = {name: home[name] for name in robot.mechanism.operational}
    goal["x"] -= 1.0
    problem = po.Problem(po.Scene(robot), home, goal, po.Margins(0.0, 0.01))
    nlp = po.build_nlp(problem, po.MixedSearch().seed(problem))
    here = nlp.evaluation.at(nlp.initial)
    far = nlp.initial + 0.3 * np.random.default_rng(0).normal(size=len(nlp.initial))
    nlp.evaluation(far)
    nlp.evaluation.recall(here)
    assert here.values is not None
    np.testing.assert_array_equal(nlp.evaluator.near, here.values.X)
    np.testing.assert_array_equal(nlp.evaluation(nlp.initial)[2], here.g)
