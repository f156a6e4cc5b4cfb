"""The studies of cable robots, run as a person runs them."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from paraopt.io import Column, cbu_template, read_program

SCRIPT = Path(__file__).resolve().parents[2] / "problems" / "larm.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def tensions(text: str) -> tuple[float, float, float, float]:
    """Give the least and the largest tension, and the limits, as printed."""
    found = re.search(r"tensions ([\d.]+) to ([\d.]+) N at 4001 times \(limits ([\d.]+) to ([\d.]+) N\)", text)
    assert found, text
    low, high, least, largest = (float(v) for v in found.groups())
    return low, high, least, largest


def check_hanging(text: str) -> None:
    low, high, least, largest = tensions(text)
    assert least < low < high < largest
    sway = re.search(r"unbalanced inertia up to ([\d.]+) %", text)
    firm = re.search(r"equilibria stable: least curvature of the energy ([\d.]+)", text)
    assert sway
    assert 0.0 < float(sway[1]) <= 2.0
    assert firm
    assert float(firm[1]) > 0.1
    assert "independent coordinates x, y, z, gamma;" in text


def test_the_platform_rises_before_its_cables_touch(tmp_path: Path) -> None:
    done = run("--output", str(tmp_path))
    assert done.returncode == 0, done.stderr
    check_hanging(done.stdout)
    assert re.search(r"blocked by collision wall / cable q[34]", done.stdout)
    rise = re.search(r"rises by ([\d.]+) m", done.stdout)
    # the wall is 0.1 m above the platform's origin at the start, whose box reaches 0.07 m below it
    assert rise
    assert 0.15 < float(rise[1]) < 0.25
    files = {p.name for p in tmp_path.iterdir()}
    assert files == {
        "to-goal", "scene.png", "lengths.png", "tensions.png", "cables.html", "winches.csv", "winches.cbu",
    }  # fmt: skip
    # what the winches are told are the lengths of the trajectory, and CSV and program say the same
    with (tmp_path / "winches.csv").open() as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["t [s]", "q1 [m]", "q2 [m]", "q3 [m]", "q4 [m]"]
    told = np.array(rows[1:], dtype=float)
    names = ("q1", "q2", "q3", "q4")
    program = read_program(tmp_path / "winches.cbu", cbu_template([Column(q, unit="m", digits=6) for q in names]))
    assert np.array_equal(program.values[:, 1:], told[:, 1:])
    with (tmp_path / "to-goal" / "trajectory.csv").open() as stream:
        header, *values = list(csv.reader(stream))
    motion = np.array(values, dtype=float)
    places = [header.index(f"active {q} [m]") for q in names]
    for i, place in enumerate(places, start=1):
        assert np.max(np.abs(np.interp(told[:-1, 0], motion[:, 0], motion[:, place]) - told[:-1, i])) < 2e-6


def test_three_tasks_are_one_motion() -> None:
    done = run("--task", "chain")
    assert done.returncode == 0, done.stderr
    check_hanging(done.stdout)
    assert [line.split(":")[0] for line in done.stdout.splitlines() if " -> " in line] == [
        "rest -> start", "start -> goal", "goal -> rest",
    ]  # fmt: skip
    assert done.stdout.count("certified motion") == 3
    assert re.search(r"straight motion: blocked by collision post / cable q\d", done.stdout)


def test_a_gripper_is_carried_over_a_wall_in_the_plane() -> None:
    done = run("--task", "planar")
    assert done.returncode == 0, done.stderr
    assert "blocked by collision gripper / wall" in done.stdout
    low, high, least, largest = tensions(done.stdout)
    assert least <= low < high <= largest


@pytest.mark.parametrize("retimer", ["ruckig", pytest.param("toppra", marks=pytest.mark.slow)])
def test_ipanema_goes_past_a_ball(retimer: str) -> None:
    done = run("--task", "ipanema", "--retimer", retimer)
    assert done.returncode == 0, done.stderr
    assert re.search(r"blocked by collision ball / cable \d", done.stdout)
    low, high, least, largest = tensions(done.stdout)
    assert (least, largest) == (10.0, 720.0)  # the largest is that of CASPR's file
    assert least <= low < high <= largest
    assert "independent coordinates x, y, z, alpha, beta, gamma;" in done.stdout


def test_what_cannot_be_done_is_an_error(tmp_path: Path) -> None:
    done = run("--task", "ipanema", "--caspr", str(tmp_path))
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "file of bodies" in done.stderr
    done = run("--task", "rise", "--tension", "2")
    assert done.returncode == 1
    assert "tension margin" in done.stderr
    assert "Traceback" not in done.stderr
