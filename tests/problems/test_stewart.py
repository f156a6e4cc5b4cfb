"""The study of the Stewart platform among posts, run as a person runs it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "problems" / "stewart.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def test_the_pin_is_brought_round_the_posts() -> None:
    done = run()
    assert done.returncode == 0, done.stderr
    assert "certified motion" in done.stdout
    assert "blocked by collision tool / post 1" in done.stdout
    length = float(done.stdout.split("path ")[1].split(" mm")[0])
    # the straight motion alone is 0.32 m long: 0.24 m, and half a radian of turning at 0.4 m
    assert 300.0 < length < 360.0


def test_a_goal_out_of_reach_is_an_error() -> None:
    done = run("--goal", "0.12", "0", "2.0", "0", "0", "0")
    assert done.returncode == 1
    assert "out of" in done.stderr
    assert "Traceback" not in done.stderr
