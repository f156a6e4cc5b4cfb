"""The study of the RAF robot, run end to end as a person runs it, and its file judged by a model of our own here.

The model below is written with NumPy from the printed tables and shares nothing with paraopt.
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

import paraopt as po
from motions import (
    ACCELERATION,
    CLEARANCE,
    JERK,
    TASKS,
    TOOL_TOP,
    VELOCITY,
    distance_of_uprights,
    plan_of,
    problem_of,
)
from paraopt.io import Table, read_trajectory

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "problems" / "raf.py"
FILES = {"trajectory.csv", "report.json", "path.png", "actuators.png", "margins.png", "motion.html"}
Array = np.ndarray


def _run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], cwd=cwd, capture_output=True, text=True, timeout=300, check=False
    )


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("raf_problem_script", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look names up
    spec.loader.exec_module(module)
    return module


# --- A model of our own: models.md, 3 (Lahouar, IV.1), millimetres

JACK_AT_BASE = np.array([(185, -106, 20), (-185, -106, 20), (0, 214, 20)])
JACK_AT_PLATFORM = np.array([(85, -49, -20), (-85, -49, -20), (0, 98, -20)])
ARMS = {"A": ((-50, -180, 25), 0.0), "B": ((-180, 50, 25), -0.5 * np.pi)}
FORKS = {  # both pins of each forearm's fork, at x = +5 and x = -5 of the fork
    "A+": ((35, -134, -47), (25, -134, -47)),
    "A-": ((-25, -134, -47), (-35, -134, -47)),
    "B+": ((-126, -35, -47), (-126, -25, -47)),
    "B-": ((-126, 25, -47), (-126, 35, -47)),
}


def _residual(q: dict[str, Array]) -> Array:
    """Measure how far the 11 pairs of points that must coincide lie apart [m], for n instants; shape (n, 11)."""

    def turn(axes: str, *names: str) -> Rotation:
        return Rotation.from_euler(axes, np.column_stack([q[name] for name in names]))

    def point(*values: float) -> Array:
        return 1e-3 * np.array(values, dtype=float)

    platform = turn("XYZ", "alpha", "beta", "gamma")  # intrinsic: Rx Ry Rz
    origin = np.column_stack([q["x"], q["y"], q["z"]])
    gaps = []
    for i in (1, 2, 3):
        leg = turn("XYZ", f"jack {i}.x", f"jack {i}.y", f"jack {i}.z")
        length = 0.298 + 0.092 + q[f"q{i}"]
        tip = point(*JACK_AT_BASE[i - 1]) + leg.apply(np.column_stack([0 * length, 0 * length, length]))
        gaps.append(tip - origin - platform.apply(point(*JACK_AT_PLATFORM[i - 1])))
    for key, pins in FORKS.items():
        at, constant = ARMS[key[0]]
        arm = Rotation.from_euler("Z", constant) * turn("X", f"arm {key[0]}")
        cross = arm * turn("X", f"cross {key}")
        forearm = cross * turn("Z", f"forearm {key}")
        fork = forearm * turn("Z", f"fork {key}")
        elbow = point(*at) + arm.apply(point(30 if key[1] == "+" else -30, 52, 275))
        wrist = elbow + forearm.apply(point(0, 331, 0))
        for x, pin in zip((5, -5), pins, strict=True):
            gaps.append(wrist + fork.apply(point(x, 0, 0)) - origin - platform.apply(point(*pin)))
    return np.linalg.norm(np.stack(gaps, axis=1), axis=2)


def _positions(table: Table) -> dict[str, Array]:
    found = {}
    for column in table.columns:
        if match := re.fullmatch(r"(?:active|operational|passive) (.+) \[(?:m|rad)\]", column):
            found[match[1]] = table[column]
    return found


def test_the_model_here_knows_the_reference_pose() -> None:
    """At (0, 0, 480) the strokes are 64.807, 64.807 and 65.034 mm, the arms at 0.9912 and 0.9694 rad."""
    home = po.robots.raf().home_configuration
    assert 1e3 * home.active == pytest.approx([64.807, 64.807, 65.034], abs=5e-4)
    assert (home["arm A"], home["arm B"]) == pytest.approx((0.9912, 0.9694), abs=5e-5)
    values = {name: np.array([value]) for name, value in home.as_dict().items()}
    assert _residual(values).max() < 1e-12
    # and it sees what is open: a microradian at an arm of 0.3 m
    values["arm A"] = values["arm A"] + 1e-6
    assert _residual(values).max() > 1e-7


# --- Run as a person runs it


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Run the script with nothing but its defaults."""
    folder = tmp_path_factory.mktemp("demo")
    return _run(cwd=folder), folder


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Run another task with the other retimer and margins of its own."""
    folder = tmp_path_factory.mktemp("other")
    run = _run(
        "--task", "box", "--retimer", "ruckig", "--margins.clearance", "0.008", "--margins.singularity", "0.1",
        "--limits", "0.12", "0.6", "15", "--period", "0.002", "--output", "results/box",
        cwd=folder,
    )  # fmt: skip
    return run, folder


def test_the_demo_says_what_came_out(demo: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    run, folder = demo
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert 1 < len(lines) <= 10
    assert lines[0].startswith("RAF: certified motion of ")
    assert "blocked by collision tool / cylinder" in run.stdout
    assert str((folder / "out" / "raf-cylinder").resolve()) in lines[-1]
    assert all(name in lines[-1] for name in FILES)
    # progress goes elsewhere, stage by stage
    stages = [line.split()[0] for line in run.stderr.splitlines()]
    assert [s for s in stages if s in plan_of("cylinder").timings] == list(plan_of("cylinder").timings)
    assert "Warning" not in run.stderr
    assert "Traceback" not in run.stderr


def test_the_demo_writes_whole_files(demo: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    _, folder = demo
    assert {p.name for p in (folder / "out" / "raf-cylinder").iterdir()} == FILES
    assert {p.name for p in folder.rglob("*") if p.is_file()} == FILES
    report = json.loads((folder / "out" / "raf-cylinder" / "report.json").read_text())
    assert report["certificate"]["passed"] is True
    assert report["problem"]["obstacles"][0]["name"] == "cylinder"


def test_the_demo_gives_the_bytes_of_any_other_run(
    demo: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    """Another process, another robot object, the same problem: the same file."""
    here = plan_of("cylinder").save(tmp_path, view=False)["trajectory"]
    assert (demo[1] / "out" / "raf-cylinder" / "trajectory.csv").read_bytes() == here.read_bytes()


def test_options_are_followed(other: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    run, folder = other
    assert run.returncode == 0, run.stderr
    assert len(run.stdout.splitlines()) <= 10
    assert "jerk-limited (ruckig)" in run.stdout
    assert "(asked 8 mm)" in run.stdout
    assert "(asked 0.1)" in run.stdout
    assert {p.name for p in (folder / "results" / "box").iterdir()} == FILES
    report = json.loads((folder / "results" / "box" / "report.json").read_text())
    assert report["problem"]["margins"] == {"type": "Margins", "clearance": 0.008, "singularity": 0.1}
    assert report["problem"]["limits"]["jerk"] == {"q1": 15.0, "q2": 15.0, "q3": 15.0}
    assert report["options"]["retimer"]["type"] == "JerkLimited"
    table = read_trajectory(folder / "results" / "box" / "trajectory.csv")
    np.testing.assert_allclose(np.diff(table["t [s]"])[:-1], 0.002, rtol=0, atol=1e-12)
    for quantity, unit, limit in (("velocity", "m/s", 0.12), ("acceleration", "m/s^2", 0.6)):
        used = [np.max(np.abs(table[f"active {q} {quantity} [{unit}]"])) for q in ("q1", "q2", "q3")]
        assert max(used) <= 1.001 * limit
    tip = table["operational z [m]"] + TOOL_TOP
    under = np.abs(table["operational x [m]"]) < 0.042
    assert np.max(tip[under]) <= 0.545 - 0.008 + 1e-6


def test_help_tells_the_parameters(tmp_path: Path) -> None:
    run = _run("--help", cwd=tmp_path)
    assert run.returncode == 0
    options = ("task", "start", "goal", "obstacle", "cylinder", "box", "limits", "margins.clearance",
               "margins.singularity", "retimer", "period", "output", "view")  # fmt: skip
    for option in (f"--{name}" for name in options):
        assert option in run.stdout, option
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments", [("--task", "sphere"), ("--limits", "0", "0.5", "10", "--output", "out")], ids=" ".join
)
def test_bad_values_end_with_a_word_and_a_code(arguments: tuple[str, ...], tmp_path: Path) -> None:
    run = _run(*arguments, cwd=tmp_path)
    assert run.returncode != 0
    assert arguments[1] in run.stderr + run.stdout
    assert "Traceback" not in run.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ("--retimer", "none"),
        ("--start", "left", "0", "0.48"),
        ("--start", "0", "0"),
        ("--margins.clearance", "-1"),
        ("--margins.singularity", "1"),
        ("--speed", "3"),
    ],
    ids=" ".join,
)
def test_bad_words_on_the_command_line_are_refused(
    arguments: tuple[str, ...], script: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        tyro.cli(script.Parameters, args=list(arguments))
    assert caught.value.code not in (0, None)
    told = capsys.readouterr()
    assert told.out + told.err


# --- The file, judged by the model here


def _files(task: str, demo: Path, tmp_path: Path) -> Path:
    """Give a task's file at a kilohertz: that of the demo, or one written from the plan."""
    if task == "cylinder":
        return demo / "out" / "raf-cylinder" / "trajectory.csv"
    return plan_of(task).save(tmp_path, view=False)["trajectory"]


@pytest.mark.parametrize("task", TASKS)
def test_the_file_holds_a_motion_of_the_printed_machine(
    task: str, demo: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    table = read_trajectory(_files(task, demo[1], tmp_path))
    t, q = table["t [s]"], _positions(table)
    assert len(q) == 32
    # a kilohertz
    np.testing.assert_allclose(np.diff(t)[:-1], 1e-3, rtol=0, atol=1e-12)
    # the loops
    assert _residual(q).max() <= 1e-9
    for angle in ("alpha", "beta", "gamma"):
        assert np.max(np.abs(q[angle])) <= 1e-9
    # the ends
    first, last = ([q[c][i] for c in "xyz"] for i in (0, -1))
    assert first == pytest.approx([-0.06, 0.0, 0.48], abs=1e-12)
    assert last == pytest.approx([0.06, 0.0, 0.48], abs=1e-12)
    # the drives: stated, and by differences of the positions
    for drive in ("q1", "q2", "q3"):
        assert np.all((q[drive] >= 0.0) & (q[drive] <= 0.2))
        v, a = table[f"active {drive} velocity [m/s]"], table[f"active {drive} acceleration [m/s^2]"]
        assert np.max(np.abs(v)) <= 1.001 * VELOCITY
        assert np.max(np.abs(a)) <= 1.001 * ACCELERATION
        step = np.diff(t)[:-1]
        # a mean never exceeds the largest value; a second difference of numbers good to 1e-13 over 1e-6 s^2 adds 4e-7
        assert np.max(np.abs(np.diff(q[drive])[:-1] / step)) <= 1.001 * VELOCITY
        assert np.max(np.abs(np.diff(q[drive][:-1], 2) / step[0] ** 2)) <= 1.001 * ACCELERATION + 1e-6
        assert abs(v[0]) + abs(v[-1]) < 1e-9
    # the obstacle: the platform does not turn, so its tool stands upright
    if task != "free":
        xy = np.column_stack([q["x"], q["y"]])
        distance = distance_of_uprights(xy, q["z"] - 0.01, q["z"] + TOOL_TOP, task)
        assert distance.min() >= CLEARANCE - 1e-8
        # as near as the margin allows: 0.2 mm more would be a detour
        assert distance.min() < CLEARANCE + 2e-4
    # each motion has the shape that the script's text announces
    length = float(np.sum(np.linalg.norm(np.diff(np.column_stack([q[c] for c in "xyz"]), axis=0), axis=1)))
    assert 1e3 * length == pytest.approx({"free": 120.0, "cylinder": 159.2, "box": 139.2}[task], abs=0.5)
    swing, dip = 1e3 * np.max(np.abs(q["y"])), 1e3 * (0.48 - np.min(q["z"]))
    assert swing == pytest.approx({"free": 0.0, "cylinder": 47.0, "box": 0.0}[task], abs=0.5)
    assert dip == pytest.approx({"free": 0.0, "cylinder": 0.0, "box": 20.4}[task], abs=1.0)


# --- In this process


@pytest.mark.parametrize("task", TASKS)
def test_the_defaults_are_the_tasks_of_the_tests(task: str, script: ModuleType) -> None:
    stated, expected = script.build_problem(script.Parameters(task=task)), problem_of(task)
    assert (dict(stated.start), dict(stated.goal)) == (dict(expected.start), dict(expected.goal))
    assert stated.margins == expected.margins
    for quantity, value in (("velocity", VELOCITY), ("acceleration", ACCELERATION), ("jerk", JERK)):
        assert getattr(stated.bounds, quantity) == dict.fromkeys(("q1", "q2", "q3"), value)
    assert len(stated.scene.obstacles) == len(expected.scene.obstacles)
    for ours, theirs in zip(stated.scene.obstacles, expected.scene.obstacles, strict=True):
        assert type(ours) is type(theirs)
        np.testing.assert_allclose(ours.pose, theirs.pose, rtol=0, atol=1e-15)
        assert ours.bounding_radius == pytest.approx(theirs.bounding_radius, rel=1e-15)


@pytest.mark.parametrize(
    ("parameters", "kind", "words"),
    [
        ({"obstacle": (-0.06, 0.0)}, "InfeasibleError", "start is in collision"),
        ({"obstacle": (0.06, 0.0)}, "InfeasibleError", "goal is in collision"),
        ({"goal": (0.0, 0.0, 2.0)}, "InfeasibleError", "goal is out of reach"),
        ({"goal": (0.06, 0.0, 0.64)}, "InfeasibleError", "goal is out of the range of 'q"),
        ({"start": (float("nan"), 0.0, 0.48)}, "DefinitionError", "start value of 'x' is nan"),
        ({"limits": (0.0, 0.5, 10.0)}, "DefinitionError", "velocity limit of 'q1' is 0.0"),
        ({"limits": (0.1, float("nan"), 10.0)}, "DefinitionError", "acceleration limit of 'q1' is nan"),
        ({"goal": (-0.06, 0.0, 0.48)}, "DefinitionError", "start and goal are the same pose"),
        ({"cylinder": (0.0, 0.4, 0.49)}, "DefinitionError", "radius of cylinder 'cylinder' is 0.0 m"),
        ({"margins": po.Margins(singularity=0.3)}, "InfeasibleError", "start is too near a singularity"),
        ({"task": "free", "period": 0.0}, "DefinitionError", "sampling period is 0.0 s"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_bad_input_is_told_and_writes_nothing(
    parameters: dict[str, object],
    kind: str,
    words: str,
    script: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code = script.main(script.Parameters(output=tmp_path / "out", **parameters))
    told = capsys.readouterr()
    assert code == 1
    assert told.out == ""
    assert told.err.splitlines()[-1].startswith(f"{kind}: ")
    assert words in told.err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_told(
    script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("a file stands in the way")
    code = script.main(script.Parameters(task="free", output=tmp_path / "out"))
    assert code == 1
    assert "Error: " in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "a file stands in the way"
