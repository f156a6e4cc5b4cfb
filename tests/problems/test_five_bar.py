"""The study of the five-bar's working modes, run as a person runs it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "problems" / "five_bar.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def test_all_pairs_are_answered_by_their_signs() -> None:
    done = run()
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 13
    assert sum("certified" in line for line in lines) == 6
    assert sum("refused" in line for line in lines) == 6
    assert all("+-" in line.split(":")[0].split() for line in lines if "refused" in line)
    # one leg changes its posture between these, two between those
    single, double = (next(line for line in lines if line.startswith(pair)) for pair in ("++ -> -+", "++ -> --"))
    assert "det [M N]: 1" in single
    assert "det [M N]: 2" in double
    assert lines[-1] == "12 of 12 pairs answered by the sign of det [N K]"


def test_an_unknown_mode_is_an_error() -> None:
    done = run("--only", "++,+*")
    assert done.returncode == 1
    assert "posture" in done.stderr
    assert "Traceback" not in done.stderr
