"""Studies on files: any robot is moved from pose to pose, and the tasks of the RAF run on a robot from a file."""

from __future__ import annotations

import importlib.util
import json
import math
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import tyro

import paraopt as po
from motions import plan_of
from paraopt.io import read_trajectory
from support import five_bar_robot, raf_robot

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
FILES = {"trajectory.csv", "report.json", "path.png", "actuators.png", "margins.png", "motion.html"}
FIVE_BAR = str(PROBLEMS / "five_bar.toml")


def _load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"{name}_problem_script_of_files", PROBLEMS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look names up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def move() -> ModuleType:
    return _load("move")


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Run the script as its text says."""
    folder = tmp_path_factory.mktemp("move")
    command = [
        sys.executable,
        str(PROBLEMS / "move.py"),
        "--robot",
        FIVE_BAR,
        "--start",
        "x=6 y=7",
        "--goal",
        "x=5 y=8",
    ]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    return run, folder / "out" / "move"


def test_a_robot_from_a_file_is_moved(demo: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    run, folder = demo
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("five-bar: certified motion of ")
    assert "Warning" not in run.stderr
    assert {p.name for p in folder.iterdir()} == FILES
    assert json.loads((folder / "report.json").read_text())["certificate"]["passed"] is True


def test_its_file_holds_a_motion_of_the_printed_machine(
    demo: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    """Bars of 8, 5, 5 and 8 m, 9 m between the driven axes: both chains end at the tip."""
    table = read_trajectory(demo[1] / "trajectory.csv")
    q = {name: table[f"{role} {name} [rad]"] for role, names in (("active", ("theta1", "theta2")),
         ("passive", ("theta3", "theta4"))) for name in names}  # fmt: skip
    tip = np.stack([table["operational x [m]"], table["operational y [m]"]])
    for at, (first, L), (second, M) in (
        (0.0, ("theta1", 8.0), ("theta3", 5.0)), (9.0, ("theta2", 5.0), ("theta4", 8.0)),
    ):  # fmt: skip
        a, b = q[first], q[first] + q[second]
        end = np.stack([at + L * np.cos(a) + M * np.cos(b), L * np.sin(a) + M * np.sin(b)])
        assert np.max(np.abs(end - tip)) < 1e-9
    assert tip[:, 0] == pytest.approx([6, 7], abs=1e-12)
    assert tip[:, -1] == pytest.approx([5, 8], abs=1e-12)
    length = float(np.sum(np.linalg.norm(np.diff(tip), axis=0)))
    assert length == pytest.approx(math.sqrt(2), abs=1e-6)  # straight, as the script's text says
    for drive in ("theta1", "theta2"):
        assert np.max(np.abs(table[f"active {drive} velocity [rad/s]"])) <= 1.001 * 2.0


def test_an_obstacle_from_a_file_is_passed(
    move: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The obstacle of the RAF's task, in a file in mm: the same way around it, as long."""
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'format = 1\nunits = { length = "mm" }\n[[obstacles]]\ntype = "Cylinder"\nname = "cylinder"\nradius = 30\n'
        "length = 400\nat = [0, 0, 690]\n"
    )
    parameters = tyro.cli(
        move.Parameters,
        args=["--robot", "raf", "--start", "x=-0.06", "--goal", "x=0.06", "--scene", str(scene),
              "--output", str(tmp_path / "out")],
    )  # fmt: skip
    code = move.main(parameters)
    told = capsys.readouterr()
    assert code == 0, told.err
    assert _length(told.out) == pytest.approx(1e3 * plan_of("cylinder").refined.length, abs=0.02)
    assert "blocked by collision tool / cylinder" in told.out


def _length(text: str) -> float:
    found = re.search(r"path ([\d.]+) mm", text)
    assert found, text
    return float(found[1])


def test_a_task_of_the_raf_runs_on_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    raf = _load("raf")
    path = po.save_robot(raf_robot(), tmp_path / "raf.toml")
    code = raf.main(tyro.cli(raf.Parameters, args=["--task", "cylinder", "--robot", str(path),
                                                   "--output", str(tmp_path / "out")]))  # fmt: skip
    told = capsys.readouterr()
    assert code == 0, told.err
    assert _length(told.out) == pytest.approx(1e3 * plan_of("cylinder").refined.length, abs=0.006)
    # the same robot to the last bit: the same file
    here = plan_of("cylinder").save(tmp_path / "here", view=False)["trajectory"]
    assert (tmp_path / "out" / "trajectory.csv").read_bytes() == here.read_bytes()


def test_a_pose_is_completed_from_home(move: ModuleType) -> None:
    problem = move.build_problem(move.Parameters(robot=FIVE_BAR, goal="x=5.5"))
    assert dict(problem.start) == {"x": 6.0, "y": 7.0}
    assert dict(problem.goal) == {"x": 5.5, "y": 7.0}
    assert problem.robot.mechanism == five_bar_robot().mechanism
    assert move.read_pose("left x=1, right x = -2e-1", "goal") == {"left x": 1.0, "right x": -0.2}
    assert move.read_pose(" x=1  y=2 ", "goal") == {"x": 1.0, "y": 2.0}


@pytest.mark.parametrize(
    ("parameters", "kind", "words"),
    [
        ({"robot": "five-bar"}, "DefinitionError", "'five-bar' is neither a file nor one of"),
        ({"robot": "{wrong}"}, "DefinitionError", "wrong.toml: format is missing"),
        ({"scene": Path("absent.toml")}, "DefinitionError", "absent.toml: there is no such file"),
        ({"scene": Path(FIVE_BAR)}, "UnknownNameError", "unknown key 'name'"),
        ({"goal": "x"}, "DefinitionError", "goal has 'x'; it must read like"),
        ({"goal": "x=a"}, "DefinitionError", "goal has 'x=a'"),
        ({"goal": "z=1"}, "Error", "'z'"),
        ({"goal": "x=100"}, "InfeasibleError", "goal is out of reach"),
        ({"start": "x=nan"}, "DefinitionError", "start value of 'x' is nan"),
        ({"goal": "x=6"}, "DefinitionError", "start and goal are the same pose"),
        ({"margins": po.Margins(singularity=0.9)}, "InfeasibleError", "start is too near a singularity"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_what_cannot_be_done_is_told_and_writes_nothing(
    parameters: dict[str, object],
    kind: str,
    words: str,
    move: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("")
    stated = {"robot": FIVE_BAR, "goal": "x=5 y=8", "output": tmp_path / "out", **parameters}
    if stated["robot"] == "{wrong}":
        stated["robot"] = str(wrong)
    assert move.main(move.Parameters(**stated)) == 1
    told = capsys.readouterr()
    assert told.out == ""
    assert kind in told.err.partition(":")[0]
    assert words in told.err
    assert list(tmp_path.iterdir()) == [wrong]


def test_a_motion_that_is_not_certified_ends_with_a_code(
    move: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise po.CertificateError("clearance is 1 mm; 5 mm were asked")

    monkeypatch.setattr(po, "plan", refuse)
    assert move.main(move.Parameters(robot=FIVE_BAR, goal="x=5 y=8", output=tmp_path / "out")) == 1
    assert "CertificateError: clearance is 1 mm" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_scripts_are_short() -> None:
    for script in ("move.py", "raf.py"):
        assert len((PROBLEMS / script).read_text(encoding="utf-8").splitlines()) < 100, script
