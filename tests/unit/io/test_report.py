"""Reports: everything that a person needs to judge or to repeat a plan, as JSON."""

from __future__ import annotations

import dataclasses
import functools
import json
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po
from motions import GOAL, START, TASKS, plan_of, problem_of, raf_problem
from paraopt.io import build_report, describe, write_report


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = write_report(plan_of("cylinder").report(), tmp_path_factory.mktemp("json") / "report.json")
    return json.loads(path.read_text(encoding="utf-8"))


def test_the_problem_is_told(report: dict[str, Any]) -> None:
    problem = report["problem"]
    assert problem["start"] == START
    assert problem["goal"] == GOAL
    assert problem["margins"] == {"type": "Margins", "clearance": 0.005, "singularity": 0.05}
    assert problem["limits"]["velocity"] == {"q1": 0.1, "q2": 0.1, "q3": 0.1}
    (obstacle,) = problem["obstacles"]
    assert (obstacle["type"], obstacle["name"], obstacle["radius"], obstacle["length"]) == (
        "Cylinder", "cylinder", 0.03, 0.4,
    )  # fmt: skip
    assert np.array(obstacle["pose"])[:3, 3].tolist() == [0.0, 0.0, 0.69]
    assert problem["straight motion"] == "collision tool / cylinder"
    assert report["robot"]["name"] == "RAF"
    assert "Lahouar" in report["robot"]["source"]


def test_the_problem_can_be_stated_again_from_the_report(report: dict[str, Any]) -> None:
    told = report["problem"]
    (shape,) = told["obstacles"]
    obstacle = po.Cylinder(name=shape["name"], radius=shape["radius"], length=shape["length"], pose=shape["pose"])
    margins = po.Margins(told["margins"]["clearance"], told["margins"]["singularity"])
    limits = po.Limits(**{k: told["limits"][k] for k in ("position", "velocity", "acceleration", "jerk")})
    scene = po.Scene(problem_of("cylinder").robot, [obstacle])
    again = po.Problem(scene, told["start"], told["goal"], margins=margins, limits=limits)
    # JSON writes the shortest decimals that read back as the same numbers
    np.testing.assert_array_equal(po.MixedSearch().seed(again).points, plan_of("cylinder").seed.points)


def test_options_and_versions_are_told(report: dict[str, Any]) -> None:
    assert {k: v["type"] for k, v in report["options"].items()} == {
        "seeder": "MixedSearch", "refiner": "SplineRefiner", "retimer": "TimeOptimal",
    }  # fmt: skip
    assert report["options"]["retimer"]["n_grid"] == po.TimeOptimal().n_grid
    assert report["options"]["seeder"]["step"] is None
    versions = report["versions"]
    for package in ("casadi", "numpy", "scipy", "ruckig", "toppra", "coal", "osqp", "qpsolvers"):
        assert versions[package][0].isdigit(), package
    assert versions["python"].startswith("3.")
    assert isinstance(versions["compiled"], bool)


def test_timings_are_told_per_stage(report: dict[str, Any]) -> None:
    assert list(report["timings [s]"]) == ["compile", "check", "seed", "refine", "retime", "verify"]
    assert all(isinstance(v, float) and v >= 0.0 for v in report["timings [s]"].values())


def test_the_certificate_is_told_check_by_check(report: dict[str, Any]) -> None:
    told, certificate = report["certificate"], plan_of("cylinder").certificate
    assert told["passed"] is True
    assert told["samples"] == certificate.n_samples
    assert told["period [s]"] == certificate.period
    assert [check["name"] for check in told["checks"]] == [check.name for check in certificate.checks]
    for check, original in zip(told["checks"], certificate.checks, strict=True):
        assert check == {"type": "Check", **dataclasses.asdict(original)}


def test_the_result_is_told(report: dict[str, Any]) -> None:
    plan, result = plan_of("cylinder"), report["result"]
    assert result["duration [s]"] == plan.trajectory.duration
    assert result["path length [m]"] == plan.refined.length <= result["seed length [m]"] == plan.seed.length
    assert result["poses judged"] == plan.seed.checks
    assert result["method"] == "time-optimal (toppra)"


@pytest.mark.parametrize("task", TASKS)
def test_reports_are_strict_json(task: str, tmp_path: Path) -> None:
    """No NaN and no Infinity, which JSON does not know: a strict reader accepts the file."""

    def refuse(word: str) -> None:
        raise AssertionError(word)

    path = write_report(plan_of(task).report(), tmp_path / "report.json")
    read = json.loads(path.read_text(), parse_constant=refuse)
    assert read == json.loads(json.dumps(plan_of(task).report()))


def test_ends_that_are_configurations_are_told_as_values() -> None:
    plan, goal = plan_of("free"), problem_of("free").goal_configuration
    report = build_report(
        raf_problem(goal=goal), plan.seed, plan.refined, plan.trajectory, plan.certificate, options={}, timings={}
    )
    assert report["problem"]["goal"] == goal.as_dict()


def test_a_failed_certificate_is_told_as_failed() -> None:
    plan = plan_of("free")
    strict = raf_problem(margins=po.Margins(singularity=0.4))
    failed = po.verify(strict, plan.trajectory)
    report = build_report(strict, plan.seed, plan.refined, plan.trajectory, failed, options={}, timings={})
    assert report["certificate"]["passed"] is False
    assert sum(not check["passed"] for check in report["certificate"]["checks"]) == 2


class _Colour(Enum):
    RED = "red"


@dataclasses.dataclass(frozen=True)
class _Thing:
    size: float
    parts: tuple[int, ...] = ()


@pytest.mark.parametrize(
    ("thing", "told"),
    [
        (None, None),
        (True, True),
        (np.bool_(False), False),
        (3, 3),
        (np.int64(3), 3),
        (0.1, 0.1),
        (np.float32(0.5), 0.5),
        (float("inf"), "inf"),
        (float("-inf"), "-inf"),
        (float("nan"), "nan"),
        (np.array([[1.0, np.inf]]), [[1.0, "inf"]]),
        ({1: (2, 3)}, {"1": [2, 3]}),
        (_Colour.RED, "red"),
        (_Thing(0.5, (1, 2)), {"type": "_Thing", "size": 0.5, "parts": [1, 2]}),
        ([_Thing(1.0)], [{"type": "_Thing", "size": 1.0, "parts": []}]),
        (np.linspace, "numpy.linspace"),
        (functools.partial(max, 3), "functools.partial"),
    ],
)
def test_things_become_what_json_can_hold(thing: Any, told: Any) -> None:
    result = describe(thing)
    assert result == told
    assert type(result) is type(told)
    json.dumps(result, allow_nan=False)


def test_what_json_cannot_hold_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_report({"value": float("nan")}, tmp_path / "report.json")
    assert list(tmp_path.iterdir()) == []
