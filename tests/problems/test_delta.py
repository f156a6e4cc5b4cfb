"""The study of the Delta that carries a part over a box, run as a person runs it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "problems" / "delta.py"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def test_the_part_is_carried_over_the_box_and_back(tmp_path: Path) -> None:
    done = run("--output", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("certified motion") == 2
    assert done.stdout.count("blocked by collision gripper / box") == 2
    rises = [float(line.split("by ")[1].split(" m")[0]) for line in done.stdout.splitlines() if "rises" in line]
    # the box's top is 0.3 m above the gripper's end at pick, and 20 mm are kept
    assert all(0.32 < rise < 0.45 for rise in rises)
    assert {p.name for p in tmp_path.iterdir()} == {"there", "back"}


def test_a_box_too_high_is_an_error() -> None:
    done = run("--box", "0.6", "6", "2.5")
    assert done.returncode == 1
    assert "box" in done.stderr
    assert "Traceback" not in done.stderr
