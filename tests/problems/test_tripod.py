"""The study of the tripod, run end to end as a person runs it, and its file judged by a model of our own here.

The model below is written with NumPy from the definition of the machine and shares nothing with paraopt.
"""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import tyro
from scipy.spatial.transform import Rotation

from paraopt.io import read_trajectory

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "problems" / "tripod.py"
FILES = {"trajectory.csv", "report.json", "actuators.png", "footfalls.png", "filmstrip.png", "motion.html"}
POSE = ("x", "y", "z", "alpha", "beta", "gamma")
LEGS = (1, 2, 3)
Array = np.ndarray


def _run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], cwd=cwd, capture_output=True, text=True, timeout=500, check=False
    )


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tripod_problem_script", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look names up
    spec.loader.exec_module(module)
    return module


def _run_task(task: str, folder: Path) -> tuple[str, Path]:
    """Run a task with its defaults, certified; give what it says and the folder of its files."""
    run = _run("--task", task, cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "Warning" not in run.stderr
    assert run.stdout.startswith("tripod: certified motion of ")
    output = folder / "out" / f"tripod-{task}"
    assert {p.name for p in output.iterdir()} == FILES
    report = json.loads((output / "report.json").read_text())
    assert report["certificate"]["passed"] is True
    for found, tilt in re.findall(r"over its swing (0\.\d+), from a tilt of 0\.3 rad (0\.\d+)", run.stdout):
        assert float(found) > 2.5 * float(tilt)
    return run.stdout, output


def _frame(q: dict[str, Array], prefix: str = "") -> tuple[Array, Rotation]:
    place = np.column_stack([q[f"{prefix}{c}"] for c in "xyz"])
    return place, Rotation.from_euler("ZYX", np.column_stack([q[f"{prefix}{c}"] for c in ("gamma", "beta", "alpha")]))


def test_a_swing(tmp_path: Path) -> None:
    told, output = _run_task("swing", tmp_path)
    assert re.search(r"planned 2 phases in \d+\.\d s, lock poses included", told)
    check_motion(output, {1: 0.08})


@pytest.mark.slow
def test_the_scenario(tmp_path: Path) -> None:
    told, output = _run_task("scenario", tmp_path)
    assert re.search(r"planned 9 phases in \d+\.\d s, lock poses included", told)
    origin, R = check_motion(output, dict.fromkeys(LEGS, 0.06))
    # both works: the tip runs round its circle
    tip = origin + R.apply([0.0, 0.0, -0.1])
    for place, at in ((0.0, tip[:400]), (0.06, tip[-400:])):
        radius = np.linalg.norm(at[:, :2] - [place, 0.0], axis=1)
        assert np.max(np.abs(radius - 0.03)) < 3e-6
        assert np.max(np.abs(at[:, 2] - 0.2)) < 3e-6


def check_motion(folder: Path, steps: dict[int, float]) -> tuple[Array, Rotation]:
    """Check a file every millisecond: lengths of actuators, limits, locked joints, feet; give the platform's frames."""
    table = read_trajectory(folder / "trajectory.csv")
    q = {m[1]: table[c] for c in table.columns if (m := re.fullmatch(r"\w+ (.+) \[(?:m|rad)\]", c))}
    q = {name: values for name, values in q.items() if not name.endswith(("velocity", "acceleration"))}
    origin, R = _frame(q)
    directions = {}
    for i in LEGS:
        A, R_a = _frame(q, f"foot {i} ")
        ends = []
        for side, sign in (("L", -1), ("R", 1)):
            angle = (i - 1) * 2 * np.pi / 3 + sign * np.radians(20)
            P = origin + R.apply(0.15 * np.array([np.cos(angle), np.sin(angle), 0.0]))
            ends.append(P)
            assert np.max(np.abs(np.linalg.norm(P - A, axis=1) - q[f"q{side} {i}"])) < 1e-9
            assert 0.25 <= np.min(q[f"q{side} {i}"]) < np.max(q[f"q{side} {i}"]) <= 0.46
            assert np.max(np.abs(table[f"active q{side} {i} velocity [m/s]"])) <= 0.2 * 1.001
            assert np.max(np.abs(table[f"active q{side} {i} acceleration [m/s^2]"])) <= 1.001
        v3 = np.cross(ends[1] - ends[0], 0.5 * (ends[0] + ends[1]) - A)
        directions[i] = R_a.inv().apply(v3 / np.linalg.norm(v3, axis=1, keepdims=True))
    feet = np.stack([np.column_stack([q[f"foot {i} {c}"] for c in POSE]) for i in LEGS], axis=1)
    moving = np.any(np.abs(np.diff(feet, axis=0)) > 1e-9, axis=2)
    assert np.max(np.sum(moving, axis=1)) == 1  # at most one foot is off
    assert np.min(feet[:, :, 2]) >= 0.0
    assert np.max(feet[:, :, 2]) == pytest.approx(0.03, abs=2e-3)
    for i in LEGS:
        expected = np.array([steps.get(i, 0.0), 0, 0, 0, 0, 0])
        np.testing.assert_allclose(feet[-1, i - 1] - feet[0, i - 1], expected, atol=1e-9)
    for i in steps:
        # while leg i is in the air the plane of each leg's actuators keeps its direction about its foot: q1
        air = np.flatnonzero(moving[:, i - 1])
        air = np.arange(air[0], air[-1] + 1)
        for k in LEGS:
            turn = np.arctan2(directions[k][air, 1], directions[k][air, 0])
            assert np.ptp(turn) < 1e-8
            assert k != i or np.ptp(directions[k][air], axis=0).max() < 1e-8  # and q2 of leg i
    return origin, R


def test_help_tells_the_parameters(tmp_path: Path) -> None:
    run = _run("--help", cwd=tmp_path)
    assert run.returncode == 0
    for option in (
        "task",
        "shift",
        "turn",
        "lift",
        "bar",
        "work",
        "limits",
        "margins.clearance",
        "lock.starts",
        "output",
    ):
        assert f"--{option}" in run.stdout, option
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("parameters", "kind", "words"),
    [
        ({"task": "swing", "bar": 0.03}, "InfeasibleError", "phase 'swing of foot 1': foot 1, lifted by 30 mm, comes"),
        (
            {"task": "swing", "shift": (0.7, 0.0, 0.0)},
            "InfeasibleError",
            "phase 'swing of foot 1': foot 1 cannot",
        ),
        ({"work": (0.03, 0.12, 0.4)}, "InfeasibleError", "phase 'machining': 'q"),
        ({"task": "swing", "limits": (0.0, 1.0, 20.0)}, "DefinitionError", "velocity limit of 'qL 1' is 0.0"),
        ({"task": "swing", "lift": -0.1}, "DefinitionError", "lift of foot 1 is -0.1 m"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_what_cannot_be_is_told_and_writes_nothing(
    parameters: dict[str, object],
    kind: str,
    words: str,
    script: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert script.main(script.Parameters(output=tmp_path / "out", **parameters)) == 1
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines()[-1].startswith(f"{kind}: ")
    assert words in told.err
    assert list(tmp_path.iterdir()) == []


def test_bad_words_on_the_command_line_are_refused(script: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        tyro.cli(script.Parameters, args=["--task", "fly"])
    assert caught.value.code not in (0, None)
    assert "fly" in capsys.readouterr().err
