"""What does a clearance query cost, compared with coal called directly?

The scene is that of the cylinder task; the configurations lie on its certified path. All contenders start from the
values of the variables, get the link poses from the same compiled function, ask coal for the same accuracy, and must
agree. "coal directly" asks for every pair, its solids placed in one array operation. `Scene.clearances` asks for the
few pairs that the bounds leave, `Scene.too_close` only whether a margin holds, `Scene.distances` for one pair with its
gradient.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import coal
import numpy as np
from benchmarks.tables import duration, table
from benchmarks.timing import race
from numpy.typing import NDArray
from problems.raf import Parameters, build_problem

import paraopt as po

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
    solids = [_solid(body.shape) for body in scene.bodies]
    measures = [coal.ComputeDistance(solids[p.first], solids[p.second]) for p in scene.pairs]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    request.gjk_tolerance = request.epa_tolerance = 1e-9  # as in paraopt
    request.gjk_max_iterations = request.epa_max_iterations = 512
    frames = [coal.Transform3s() for _ in scene.bodies]
    touching = int(scene.clearances(X[n_batch // 2 : n_batch // 2 + 1])[1][0])
    links = np.array([body.frame for body in scene.bodies])
    placements = np.array([body.shape.pose for body in scene.bodies])

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
    return {"n_batch": n_batch, "pairs": len(scene.pairs), "largest disagreement [m]": disagreement, "rates": rates}


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
    return table(["clearance of the RAF", "per configuration", "ratio", "spread"], rows, note)


def _solid(shape: object) -> coal.CollisionGeometry:
    match shape:
        case po.Box():
            return coal.Box(*np.asarray(shape.size, dtype=float))
        case po.Sphere():
            return coal.Sphere(shape.radius)
        case po.Cylinder():
            return coal.Cylinder(shape.radius, shape.length)
        case po.Capsule():
            return coal.Capsule(shape.radius, shape.length)
    raise TypeError(f"no solid for {type(shape).__name__}")
