"""The gallery holds every robot of the library, with pictures that exist."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "gallery.md"
TEXT = PAGE.read_text(encoding="utf-8")
MAKER: dict[str, Any] = runpy.run_path(str(ROOT / "docs" / "make_gallery.py"))
ROBOTS = list(MAKER["list_robots"]())
REFRESH = "to refresh: make gallery"


def test_robots_are_found() -> None:
    assert {"five_bar", "raf", "planar_platform"} <= set(ROBOTS)
    assert "LEG_TYPES" not in ROBOTS


def test_every_robot_is_in_the_gallery_in_order() -> None:
    assert re.findall(r"^## (\w+)$", TEXT, flags=re.M) == sorted(ROBOTS), REFRESH


@pytest.mark.parametrize("name", ROBOTS)
def test_a_section_describes_its_robot(name: str) -> None:
    section = TEXT.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
    assert MAKER["describe_function"](MAKER["list_robots"]()[name]) in section, REFRESH
    for image in (f"images/gallery/{name}.png", f"images/gallery/{name}-graph.png"):
        assert f"]({image})" in section, REFRESH
    for word in ("Source: ", "| variables |", "| equations |", "| mobility |"):
        assert word in section, REFRESH


def test_pictures_exist_are_small_and_none_is_left_over() -> None:
    named = {PAGE.parent / path for path in re.findall(r"\]\((images/[^)]+)\)", TEXT)}
    assert named == set((PAGE.parent / "images" / "gallery").iterdir()), REFRESH
    sizes = {path.name: path.stat().st_size for path in named}
    assert max(sizes.values()) < 120_000, sizes
    assert sum(sizes.values()) < 4_000_000
    for path in named:
        assert path.read_bytes().startswith(b"\x89PNG\r\n"), path.name


@pytest.mark.slow
def test_the_page_tells_what_is_computed_today() -> None:
    """All robots are built and solved at home, without the compiler, some seconds each."""
    assert MAKER["describe_gallery"]() == TEXT, REFRESH
