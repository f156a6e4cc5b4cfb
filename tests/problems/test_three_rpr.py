"""The study of the planar 3-RPR, run as a person runs it, and its seeds looked at densely.

Source: models.md, 4 and 10 (Lahouar, III.3; Chablat1998, tables 2 and 3).
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po

SCRIPT = Path(__file__).resolve().parents[2] / "problems" / "three_rpr.py"


def load() -> Any:
    spec = importlib.util.spec_from_file_location("three_rpr_study", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


STUDY = load()


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def walk_along(seed: po.Seed, count: int = 4000) -> np.ndarray:
    """Walk along a seed in small steps, without the planner."""
    kinematics, X = seed.problem.robot.kinematics, [seed.X[0]]
    for values in seed.at(np.linspace(0.0, 1.0, count + 1))[1:]:
        closed = kinematics.solve_batch(seed.problem.independent, values[None], X[-1][None])
        assert closed.converged[0]
        X.append(closed.X[0])
    return np.array(X)


def determinant(X: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Give det of the rows (n_x, n_y, (R b) x n) by hand, n the unit vectors along the legs."""
    b = np.array([(0.0, 0.0), (15.0, 0.0), (7.5, 12.990)])
    phi, theta = X[:, [names.index(f"phi{i}") for i in (1, 2, 3)]], X[:, [names.index("theta")]]
    n = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    arm = np.stack(
        [np.cos(theta) * b[:, 0] - np.sin(theta) * b[:, 1], np.sin(theta) * b[:, 0] + np.cos(theta) * b[:, 1]], axis=-1
    )
    moment = arm[..., 0] * n[..., 1] - arm[..., 1] * n[..., 0]
    return np.linalg.det(np.concatenate([n, moment[..., None]], axis=-1))


@pytest.mark.parametrize("task", ["T1", "T2"])
def test_seeds_keep_their_distance_and_are_short(task: str) -> None:
    problem = STUDY.build_problem(STUDY.Parameters(task=task))
    assert problem.metric.tolist() == [1.0, 1.0, 15.0]
    seed = po.MixedSearch(step=5.0).seed(problem)
    assert seed.straight_reason != "valid"
    # the best known way is 116.45 long (116.73 with the obstacle)
    assert 116.4 < seed.length < 127.0
    X = walk_along(seed)
    values = determinant(X, problem.robot.mechanism.names)
    assert np.all(values > 0.2)
    assert np.min(problem.space.margins(X).parallel) >= 0.01 - 1e-9
    theta = X[:, problem.robot.mechanism.index("theta")]
    assert theta.min() >= 0.0
    if task == "T2":
        # by hand: the gripper at (7.5, -20.67) of the platform, radius 1, and the disc of radius 3
        x, y = X[:, problem.robot.mechanism.indices(("x", "y"))].T
        gripper = x + 1j * y + np.exp(1j * theta) * (7.5 - 20.67j)
        clearance = np.abs(gripper - (15.6 - 8.8j)) - 4.0
        assert clearance.min() >= 0.0
        np.testing.assert_allclose(problem.scene.clearances(X)[0], clearance, atol=1e-6)


def test_the_default_search_finds_t1_too() -> None:
    seed = po.MixedSearch(cuts=3).seed(STUDY.build_problem(STUDY.Parameters()))
    assert seed.length < 127.0


def test_straight_t1_crosses_the_singularity_twice() -> None:
    problem = STUDY.build_problem(STUDY.Parameters())
    start, goal = problem.start_configuration.X[problem.index], problem.goal_values()
    assert np.linalg.norm((goal - start) * problem.metric) == pytest.approx(94.45, abs=0.01)
    X = [problem.start_configuration.X]
    for values in (start + t * (goal - start) for t in np.linspace(0.0, 1.0, 2001)[1:]):
        closed = problem.robot.kinematics.solve_batch(problem.independent, values[None], X[-1][None])
        X.append(closed.X[0])
    values = determinant(np.array(X), problem.robot.mechanism.names)
    crossings = np.flatnonzero(np.diff(np.sign(values))) / 2000.0
    assert crossings == pytest.approx([0.182, 0.694], abs=1e-3)


def test_fifteen_pairs_of_assemblies_are_answered() -> None:
    robot = po.robots.three_rpr_innocenti()
    robot = po.Robot(robot.mechanism, home=robot.home, limits=robot.limits)
    modes = robot.kinematics.assembly_modes({"rho1": 15.0, "rho2": 15.4, "rho3": 12.0}).modes
    joined, refused, turned = set(), set(), 0
    for (i, a), (j, b) in combinations(enumerate(modes), 2):
        goal = {name: b.configuration[name] for name in ("x", "y", "theta")}
        problem = po.Problem(po.Scene(robot), a.configuration, goal, margins=po.Margins(0.0, 0.01))
        if a.sign != b.sign:
            with pytest.raises(po.InfeasibleError, match="crosses a parallel singularity") as caught:
                po.MixedSearch().seed(problem)
            assert caught.value.evidence["reason"] == "branch"
            refused.add((i, j))
            continue
        seed = po.MixedSearch().seed(problem)
        X = walk_along(seed, 2000)
        signs = np.sign(problem.determinants(X)[0])
        assert np.all(signs == signs[0])
        drives = problem.robot.mechanism.indices(("rho1", "rho2", "rho3"))
        # the ends have the same drives, closed to 1e-12 of lengths of 16
        np.testing.assert_allclose(X[[0, -1]][:, drives], [[15.0, 15.4, 12.0]] * 2, atol=1e-8)
        turned += abs(seed.points[-1, 2] - goal["theta"]) > np.pi
        joined.add((i, j))
    assert (len(joined), len(refused)) == (6, 9)
    assert turned == 4


def test_t0_is_refused_by_the_script() -> None:
    done = run("--task", "T0")
    assert done.returncode == 0, done.stderr
    assert "parallel singularity" in done.stderr
    assert "at 41.46 % of the way" in done.stderr
    assert "Traceback" not in done.stderr


def test_t2_is_certified_by_the_script() -> None:
    done = run("--task", "T2")
    assert done.returncode == 0, done.stderr
    assert "certified motion" in done.stdout
    assert "NOT" not in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("task", ["T1", "modes"])
def test_longer_tasks_are_certified_by_the_script(task: str) -> None:
    done = run("--task", task)
    assert done.returncode == 0, done.stderr
    if task == "modes":
        assert "6 pairs joined, 9 pairs refused" in done.stdout


def test_a_margin_that_cannot_be_kept_is_an_error() -> None:
    done = run("--margins.singularity", "0.9")
    assert done.returncode == 1
    assert "start is too near a singularity" in done.stderr
