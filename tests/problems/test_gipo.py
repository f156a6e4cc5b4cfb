"""The study of GIPO, run as a person runs it; its program is played against the trajectory that it was made of."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from paraopt.io import gipo_servos, play, read_trajectory

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "problems" / "gipo.py"


def _run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], cwd=cwd, capture_output=True, text=True, timeout=580, check=False
    )


def _margins(text: str) -> dict[str, tuple[float, float]]:
    """Read the support margins, and those with wrong masses, of the gaits as stated and as found [mm]."""
    found = re.findall(r"^(as stated|found): support margin (-?[\d.]+) mm, (-?[\d.]+) mm with masses", text, re.M)
    return {what: (float(margin), float(worst)) for what, margin, worst in found}


def test_refusals_name_phase_foot_and_margin(tmp_path: Path) -> None:
    run = _run("--task", "slope", "--slope", "60", cwd=tmp_path)
    assert run.returncode == 1
    assert re.search(r"InfeasibleError: phase '.*swing (\w+ \w+)', foot '\1' in the air: .* -\d+\.\d+ mm", run.stderr)
    run = _run("--step", "0.4", cwd=tmp_path)
    assert run.returncode == 1
    assert re.search(r"InfeasibleError: .*foot '.*' .*lacking", run.stderr)
    assert "Traceback" not in run.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "least", "says"),
    [
        (("--task", "turn"), 38.0, r"travel 0\.0 mm and 15\.0 degrees"),
        (("--task", "walk", "--cycles", "2"), 43.0, r"travel 150\.0 mm and 0\.0 degrees"),
        (("--task", "slope"), 35.0, r"travel 90\.0 mm"),
        (("--task", "sideways", "--step", "0.04"), 35.0, r"travel 60\.0 mm"),
        (("--optimise", "speed"), 10.0, r"travel 1[0-9]{2}\.\d mm"),
    ],
)
def test_tasks_are_certified_and_exported(arguments: tuple[str, ...], least: float, says: str, tmp_path: Path) -> None:
    run = _run(*arguments, "--output", "out", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "GIPO: certified motion" in run.stdout
    assert re.search(says, run.stdout)
    margins = _margins(run.stdout)
    assert margins["as stated"][0] < 0 < least < margins["found"][0]
    assert 0 < margins["found"][1] < margins["found"][0]
    # the program moves the servos as the trajectory does, within a unit
    table, rows = gipo_servos(), read_trajectory(tmp_path / "out" / "trajectory.csv")

    def column(joint: str) -> np.ndarray:
        (name,) = [n for n in rows.columns if re.fullmatch(rf"(?:active|passive) {joint} \[rad\]", n)]
        return rows[name]

    t = rows[rows.columns[0]]
    units = table.units(np.column_stack([column(joint) for joint in table.joints]))
    program = play((tmp_path / "out" / "gipo.bas").read_text(encoding="ascii"))
    # the program ends with the motion; before it the servos come from wherever they were
    played = program(t + program.duration - t[-1])[:, list(table.numbers)]
    # one unit, and what a servo of 4 rad/s turns within the millisecond of the program's clock: 0.23 units
    assert np.max(np.abs(played - units)) <= 1.0 + 0.23 + 0.01
    # feet and trunk arrive together: rest stance again, elsewhere
    for leg in ("right rear", "right front", "left rear", "left front"):
        for joint in ("hip", "abduction", "knee"):
            assert column(f"{leg} {joint}")[-1] == pytest.approx(column(f"{leg} {joint}")[0], abs=1e-8)
