"""The README runs: its Python blocks do, they print what it tells, and what it names exists."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
RUNNER: dict[str, Any] = runpy.run_path(str(ROOT / "docs" / "run_readme.py"))


def test_blocks_run_and_print_what_the_readme_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = RUNNER["differences"](TEXT)
    assert not found, "\n".join([*found, "To refresh: python docs/run_readme.py --write"])
    names = {path.name for path in (tmp_path / "raf").iterdir()}
    assert names >= {"trajectory.csv", "report.json", "motion.html", "path.png", "actuators.png", "margins.png"}


@pytest.mark.parametrize(
    ("told", "same"),
    [
        ("path 1.0 mm at 0.5 s, tool", True),
        ("path 2.5e-3 mm at 0.7 s, rod 1", True),
        ("length 1.0 mm at 0.5 s, tool", False),
        ("", False),
    ],
)
def test_a_wrong_output_is_seen(told: str, same: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = f"```python\nprint('path 1.5 mm at 0.5 s, tool')\n```\n\n```text\n{told}\n```\n"
    assert (RUNNER["differences"](text) == []) is same


def test_relative_links_and_folders_exist() -> None:
    targets = [t for t in re.findall(r"\]\(([^)]+)\)", TEXT) if not t.startswith("http")]
    headings = {
        "#" + re.sub(r"[^\w -]", "", h).strip().lower().replace(" ", "-") for h in re.findall(r"^#+ (.*)", TEXT, re.M)
    }
    for target in targets:
        assert target in headings if target.startswith("#") else (ROOT / target).exists(), target
    for folder in re.findall(r"`((?:src|problems|notebooks|benchmarks|tests|docs)/[\w./-]*)`", TEXT):
        assert (ROOT / folder).exists(), folder


def test_targets_of_make_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:^    |`)make ([a-z-]+)", TEXT, re.M):
        assert re.search(rf"^{target}:", makefile, re.M), target
