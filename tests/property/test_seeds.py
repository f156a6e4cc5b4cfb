"""Seeds in random scenes: what a search calls a way, a check ten times denser does not refute.

Poses are drawn around each robot's home, obstacles around the way of its platform between two of them.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

import paraopt as po
from paraopt.planning.ground import Ground
from paraopt.planning.seed.base import sample_region
from paraopt.planning.validity import Validity
from paraopt.shapes import Shape

Array = NDArray[np.float64]
ROBOTS = ("five_bar", "three_rpr", "raf", "delta")
# mixed search as it is by default, but for the budget: some random scenes have no way, and proving that is long
SEEDER = po.MixedSearch(max_checks=8000, refinements=1)


@functools.cache
def _robot(name: str) -> po.Robot:
    robot = getattr(po.robots, name)()
    assert isinstance(robot, po.Robot)
    return robot


@functools.cache
def _poses(name: str, count: int = 80) -> Array:
    """Draw poses that are valid without obstacles, on the branch of home."""
    robot = _robot(name)
    home = robot.home_configuration
    problem = po.Problem(po.Scene(robot), home, home, margins=_margins(robot))
    ground = Ground(problem, Validity(problem), 1.0, 10**6)
    drawn = sample_region(problem, np.random.default_rng(5), count, 1.5 * robot.mechanism.length)
    spots, _ = ground.place(drawn, [ground.origin] * count)
    return np.array([spot.value for spot in spots if spot is not None])


def _margins(robot: po.Robot) -> po.Margins:
    return po.Margins(clearance=0.01 * robot.mechanism.length, singularity=0.02)


def _obstacle(random: np.random.Generator, name: str, centre: Array, length: float) -> Shape:
    a, b, c = random.uniform(0.1, 0.5, 3) * length
    pose = po.transform(centre, random.uniform(-1.0, 1.0, 3))
    match int(random.integers(3)):
        case 0:
            return po.Sphere(name=name, radius=0.5 * a, pose=pose)
        case 1:
            return po.Cylinder(name=name, radius=0.4 * a, length=b, pose=pose)
    return po.Box(name=name, size=(a, b, c), pose=pose)


def _problems(name: str, count: int) -> Iterator[po.Problem]:
    """Draw scenes whose start and goal are valid."""
    robot, poses, random = _robot(name), _poses(name), np.random.default_rng(11)
    names, length = robot.mechanism.operational, robot.mechanism.length
    found = 0
    while found < count:
        start, goal = poses[random.choice(len(poses), 2, replace=False)]
        ends = [dict(zip(names, end.tolist(), strict=True)) for end in (start, goal)]
        obstacles = []
        for k in range(int(random.integers(1, 4))):
            share = random.uniform(0.2, 0.8)
            at = {n: (1 - share) * ends[0][n] + share * ends[1][n] for n in names}
            centre = np.array([at["x"], at["y"], at.get("z", 0.0)]) + random.normal(0.0, 0.2 * length, 3)
            obstacles.append(_obstacle(random, f"obstacle {k}", centre, length))
        problem = po.Problem(po.Scene(robot, obstacles), *ends, margins=_margins(robot))
        X = np.array([problem.start_configuration.X, problem.goal_configuration.X])
        if np.all(Validity(problem).judge_configurations(X).valid):
            found += 1
            yield problem


def _refute(seed: po.Seed, spacing: float) -> str:
    """Walk along a seed in steps of a spacing [m], without the planner, and look for anything that does not hold."""
    problem = seed.problem
    kinematics, index = problem.robot.kinematics, problem.index
    walk = [seed.X[0]]
    for a, b in zip(seed.points[:-1], seed.points[1:], strict=True):
        count = int(np.ceil(np.linalg.norm((b - a) * problem.metric) / spacing)) + 1
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            values, here = (a + share * (b - a))[None], walk[-1][None]
            predicted = here + np.einsum("nvm,nm->nv", problem.space.tangent(here), values - here[:, index])
            closed = kinematics.solve_batch(problem.independent, values, predicted)
            if not closed.converged[0]:
                return "the loops open"
            walk.append(closed.X[0])
    X = np.array(walk)
    low, high = problem.bounds.bounds(problem.robot.mechanism)
    margins = problem.space.margins(X)
    signs = np.array(problem.determinants.signs(X))
    distance = problem.scene.clearances(X)[0] - problem.margins.clearance
    singular = np.minimum(margins.parallel, margins.serial) - problem.margins.singularity
    # round-off of what is compared: positions are closed to 1e-12
    found = {
        "range": float(np.min(np.minimum(X - low, high - X))) < -1e-9,
        "singularity": float(np.min(singular)) < -1e-9,
        "clearance": float(np.min(distance)) < -1e-9,
        "determinant": bool(np.any(signs != signs[:, :1])) if not np.any(np.isnan(signs)) else False,
    }
    return ", ".join(what for what, wrong in found.items() if wrong)


def _run(name: str, count: int) -> Counter[str]:
    outcomes: Counter[str] = Counter()
    for number, problem in enumerate(_problems(name, count)):
        try:
            seed = SEEDER.seed(problem)
        except (po.NoPathError, po.BudgetExceededError, po.InfeasibleError) as error:
            outcomes[type(error).__name__] += 1
            continue
        wrong = _refute(seed, 0.1 * SEEDER.resolution * seed.step)
        assert not wrong, f"{name}, scene {number}: a denser check finds {wrong}"
        outcomes["straight" if len(seed.points) == 2 else "around"] += 1
    return outcomes


@pytest.mark.parametrize("name", ROBOTS)
def test_a_dozen_random_scenes_are_seeded_and_not_refuted(name: str) -> None:
    outcomes = _run(name, 12)
    assert outcomes["straight"] + outcomes["around"] >= 4  # else the test looks at nothing


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_a_hundred_random_scenes_are_seeded_and_not_refuted(name: str) -> None:
    outcomes = _run(name, 100)
    assert outcomes["around"] >= 10


def test_the_denser_check_can_refute() -> None:
    """A straight line through an obstacle is refuted."""
    for problem in _problems("raf", 30):
        ground = Ground(problem, Validity(problem), 1.0, 1000)
        if Validity(problem).checks == 0 and po.MixedSearch().seed(problem).straight_reason.startswith("collision"):
            straight = po.Seed.along(ground, [ground.origin, ground.goal], step=1.0, straight_reason="valid")
            assert "clearance" in _refute(straight, 0.001)
            return
    pytest.fail("no random scene blocks the straight motion")
