"""What does a clearance query cost, compared with coal called directly?

The scene is that of the cylinder task; the configurations lie on its certified path. All contenders start from the
values of the variables, get the link poses from the same compiled function, ask coal for the same accuracy, and must
agree. "coal directly" asks for every pair, its solids placed in one array operation. `Scene.clearances` asks for the
few pairs that the bounds leave, `Scene.too_close` only whether a margin holds, `Scene.distances` for one pair with its
gradient.

A second table holds queries of one configuration each, and of batches, for the RAF among ten obstacles against the sum
of coal's own distance calls for all checked pairs, solids already placed: what no caller of coal can do without. All
times there are of the processor, so that what else the machine does counts little; each round measures all.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import coal
import numpy as np
from benchmarks.tables import duration, table
from benchmarks.timing import race
from numpy.typing import NDArray
from problems.raf import Parameters, build_problem

import paraopt as po
from paraopt.scene import Cable
from paraopt.scene.geometry import build_geometry

Array = NDArray[np.float64]
DIRECT = "coal directly, every pair"
ONE = "one pair: coal directly"


def measure(n_batch: int = 200, rounds: int = 7) -> dict[str, Any]:
    """Race the queries per configuration."""
    plan = po.plan(build_problem(Parameters()), allow_failed=True)
    scene, margin = plan.problem.scene, plan.problem.margins.clearance
    kinematics = scene.robot.kinematics
    X = plan.path(np.linspace(0.0, 1.0, n_batch))
    T = plan.problem.space.tangent(X)
    solids = [build_geometry(body.shape) for body in scene.bodies]
    measures = [coal.ComputeDistance(solids[p.first], solids[p.second]) for p in scene.pairs]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    request.gjk_tolerance = request.epa_tolerance = 1e-9  # as in paraopt
    request.gjk_max_iterations = request.epa_max_iterations = 512
    frames = [coal.Transform3s() for _ in scene.bodies]
    touching = int(scene.clearances(X[n_batch // 2 : n_batch // 2 + 1])[1][0])
    links = np.array([body.frame for body in scene.bodies])
    placements = np.array([body.shape.pose for body in scene.bodies if not isinstance(body.shape, Cable)])

    def place(bodies: Sequence[int]) -> Iterator[None]:
        """Place some bodies at one configuration after the other."""
        poses = kinematics.poses(X)
        poses = np.concatenate([poses, np.tile(np.eye(4), (len(X), 1, 1, 1))], axis=1)  # the world is frame -1
        for placed in poses[:, links[bodies]] @ placements[bodies]:
            for k, X_WB in zip(bodies, placed, strict=True):
                frames[k].setTransform(X_WB[:3, :3], X_WB[:3, 3])
            yield

    def distance(k: int) -> float:
        pair = scene.pairs[k]
        result.clear()
        return float(measures[k](frames[pair.first], frames[pair.second], request, result))

    def every_pair() -> list[float]:
        return [min(distance(k) for k in range(len(measures))) for _ in place(range(len(frames)))]

    def one_pair() -> list[float]:
        pair = scene.pairs[touching]
        return [distance(touching) for _ in place([pair.first, pair.second])]

    disagreement = float(np.max(np.abs(np.array(every_pair()) - scene.clearances(X)[0])))
    contenders = {
        DIRECT: every_pair,
        "Scene.clearances, smallest of all": lambda: scene.clearances(X),
        "Scene.too_close, is the margin held": lambda: scene.too_close(X, margin),
        ONE: one_pair,
        "one pair: Scene.distances, with gradient": lambda: scene.distances(X, np.array([touching]), T),
    }
    rates = race(contenders, DIRECT, units=n_batch, rounds=rounds, slice_seconds=0.05)
    return {
        "n_batch": n_batch,
        "pairs": len(scene.pairs),
        "largest disagreement [m]": disagreement,
        "rates": rates,
        "ten obstacles": measure_ten_obstacles(),
    }


def measure_ten_obstacles(n_poses: int = 24, rounds: int = 15) -> dict[str, Any]:
    """Measure queries of the RAF among ten obstacles, over the sum of coal's calls for the checked pairs."""
    robot, random = po.robots.raf(), np.random.default_rng(0)
    places = [
        po.transform(random.uniform((-0.3, -0.3, 0.3), (0.3, 0.3, 0.8)).tolist(), random.uniform(-1, 1, 3).tolist())
        for _ in range(10)
    ]
    kinds = (
        lambda X: po.Sphere(radius=0.03, pose=X),
        lambda X: po.Cylinder(radius=0.03, length=0.2, pose=X),
        lambda X: po.Box(size=(0.05, 0.08, 0.1), pose=X),
        lambda X: po.Capsule(radius=0.02, length=0.2, pose=X),
    )
    scene = po.Scene(robot, [kinds[k % 4](X) for k, X in enumerate(places)])
    poses = random.uniform((-0.06, -0.06, 0.45), (0.06, 0.06, 0.56), size=(n_poses, 3)).tolist()
    there = [
        robot.kinematics.inverse(dict(zip("xyz", p, strict=True)), robot.home_configuration).configuration
        for p in poses
    ]
    X = np.array([c.X for c in there])
    many = np.tile(X, (20, 1))
    stacks = {"a cable more, batch": po.Scene(robot, scene.obstacles, [_add_cable(robot)])}
    coal_calls, least = _prepare_coal(scene, X)
    disagreement = float(np.max(np.abs(least - scene.clearances(X)[0])))
    queries: dict[str, tuple[Callable[[], object], int]] = {
        "Scene.clearance: distance, points, gradient": (lambda: [scene.clearance(c) for c in there], n_poses),
        "Scene.clearances, one by one": (lambda: [scene.clearances(x) for x in X], n_poses),
        "Scene.too_close, one by one": (lambda: [scene.too_close(x, 0.005) for x in X], n_poses),
        "Scene.clearances, batch": (lambda: scene.clearances(many), len(many)),
        "Scene.too_close, batch": (lambda: scene.too_close(many, 0.005), len(many)),
        **{f"Scene.clearances, {name}": (lambda s=s: s.clearances(many), len(many)) for name, s in stacks.items()},  # type: ignore[misc]
    }
    times: dict[str, list[float]] = {name: [] for name in ("coal's calls, all pairs", *queries)}
    for act, _ in queries.values():
        act()
    for _ in range(rounds):
        for name, (act, count) in {"coal's calls, all pairs": (coal_calls, n_poses), **queries}.items():
            begin = time.process_time()
            act()
            times[name].append((time.process_time() - begin) / count)
    reference = times["coal's calls, all pairs"]
    return {
        "pairs": len(scene.pairs),
        "poses": n_poses,
        "batch": len(many),
        "largest disagreement [m]": disagreement,
        "seconds": {name: statistics.median(values) for name, values in times.items()},
        "over coal": {
            name: statistics.median(ours / theirs for ours, theirs in zip(values, reference, strict=True))
            for name, values in times.items()
        },
    }


def _add_cable(robot: po.Robot) -> Cable:
    base, platform = robot.mechanism.base.name, "platform"
    return Cable(
        link_A=base, point_A=(0.3, 0.3, 0.0), link_B=platform, point_B=(0.0, 0.0, 0.0), radius=0.002, ignore=(0.02, 0.1)
    )


def _prepare_coal(scene: po.Scene, X: Array) -> tuple[Callable[[], object], Array]:
    """Place all solids, and give a function that makes all of coal's calls, with the smallest distances."""
    solids = [build_geometry(body.shape) for body in scene.bodies]
    measures = [(coal.ComputeDistance(solids[p.first], solids[p.second]), p.first, p.second) for p in scene.pairs]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    request.gjk_tolerance, request.epa_tolerance = 1e-9, 1e-6  # as in paraopt
    request.gjk_max_iterations = request.epa_max_iterations = 512
    world = np.tile(np.eye(4), (len(X), 1, 1, 1))
    poses = np.concatenate([scene.robot.kinematics.poses(X), world], axis=1)[:, [body.frame for body in scene.bodies]]
    placements = [body.shape.pose for body in scene.bodies if not isinstance(body.shape, Cable)]
    frames = [
        [coal.Transform3s(X_WB[:3, :3].copy(), X_WB[:3, 3].copy()) for X_WB in placed]
        for placed in poses @ np.array(placements)
    ]

    def calls(kept: Sequence[object] = solids) -> list[float]:  # coal keeps no reference of its own
        least = []
        for placed in frames:
            smallest = np.inf
            for compute, first, second in measures:
                result.clear()
                smallest = min(smallest, compute(placed[first], placed[second], request, result))
            least.append(smallest)
        return least

    return calls, np.array(calls())


def show(result: dict[str, Any]) -> str:
    rows = [
        [name, duration(rate.seconds), f"{rate.ratio:.3g}", f"{100 * rate.spread:.0f} %"]
        for name, rate in result["rates"].items()
    ]
    note = (
        f"{result['pairs']} pairs, batch of {result['n_batch']} configurations, link poses included; "
        f"ratio: to coal directly, every pair\n"
        f"coal directly and Scene.clearances differ by at most {1e9 * result['largest disagreement [m]']:.2g} nm"
    )
    first = table(["clearance of the RAF", "per configuration", "ratio", "spread"], rows, note)
    return f"{first}\n\n{show_ten_obstacles(result['ten obstacles'])}"


def show_ten_obstacles(result: dict[str, Any]) -> str:
    rows = [
        [name, duration(seconds), f"{result['over coal'][name]:.2f}"] for name, seconds in result["seconds"].items()
    ]
    note = (
        f"{result['pairs']} pairs, {result['poses']} configurations, batches of {result['batch']}; "
        f"time of the processor, link poses included; at most 2 is wanted\n"
        f"coal and Scene.clearances differ by at most {1e9 * result['largest disagreement [m]']:.2g} nm"
    )
    return table(["RAF among ten obstacles", "per configuration", "over coal's calls"], rows, note)
