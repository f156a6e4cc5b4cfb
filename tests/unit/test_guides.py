"""The guides run: their Python blocks do, they print what is told below them, and what they name exists."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

import paraopt as po
from paraopt import cable, legged

ROOT = Path(__file__).resolve().parents[2]
RUNNER: dict[str, Any] = runpy.run_path(str(ROOT / "docs" / "run_readme.py"))
PAGES = ("cables.md", "legged.md")


def read(page: str) -> str:
    return (ROOT / "docs" / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_blocks_run_and_print_what_is_told(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tests").symlink_to(ROOT / "tests")  # for the data that a page reads
    monkeypatch.chdir(tmp_path)
    found = [difference.replace("README.md", page) for difference in RUNNER["differences"](read(page))]
    assert not found, "\n".join(found)


def test_motions_of_the_guides_are_certified() -> None:
    """Blocks raise where a certificate fails; what they print must not say otherwise."""
    for page in PAGES:
        told = "\n".join(re.findall(r"```text\n(.*?)```", read(page), re.S))
        assert "certified" in told
        assert not re.search(r"NOT|FAIL", told)


@pytest.mark.parametrize("page", PAGES)
def test_names_and_links_exist(page: str) -> None:
    text = read(page)
    prose = re.sub(r"```.*?```", "", text, flags=re.S)
    for target in re.findall(r"\]\(([^)]+)\)", prose):
        assert target.startswith("http") or (ROOT / "docs" / target).exists(), target
    for path in re.findall(r"`((?:problems|notebooks)/[\w./-]+)`", prose):
        assert (ROOT / path).exists(), path
    spaces = (po, cable if page == "cables.md" else legged)
    for name in re.findall(r"`([A-Za-z_.]+)", _table(prose)):
        assert any(_has(space, name.removeprefix("paraopt.").split(".")) for space in spaces), name


def _has(space: Any, names: list[str]) -> bool:
    """Tell whether a name of attributes leads somewhere."""
    return not names or (hasattr(space, names[0]) and _has(getattr(space, names[0]), names[1:]))


def _table(prose: str) -> str:
    """Give the last column of the first table, which says what to use."""
    rows = re.findall(r"^\|.*\|$", prose.split("\n\n## ")[0], re.M)[2:]
    assert len(rows) > 5
    return "\n".join(row.rstrip("|").rsplit("|", 1)[1] for row in rows)
