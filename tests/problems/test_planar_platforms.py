"""The study of the planar platforms, run as a person runs it on a few types of legs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "problems" / "planar_platforms.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_exceptions_are_told_with_their_reasons() -> None:
    """Of the four ways to choose three of two types, two have more than one leg that holds only the rotation."""
    done = run("--only", "R_P_R", "_R_PP", "--poses", "2", "--jobs", "2")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 6
    assert lines[0].split()[:3] == ["R_P_R", "_R_PP", "_R_PP"]
    assert "slides without turning at every pose (1 freedom): R2.1, R3.1 act alike" in lines[0]
    assert "(2 freedoms): R1.1, R2.1, R3.1 act alike" in lines[1]
    assert lines[2].startswith("4 platforms, largest residual at home")
    assert lines[3].startswith("2 controlled")
    assert [line.split(" exceptions")[0] for line in lines[4:]] == ["1", "1"]
    assert "4/4" in done.stderr


def test_an_unknown_leg_is_an_error() -> None:
    done = run("--only", "RPR", "--backend", "sequential")
    assert done.returncode == 1
    assert "unknown type of leg 'RPR'" in done.stderr
    assert "Traceback" not in done.stderr
