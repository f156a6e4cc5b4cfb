"""The page: one file that needs nothing else, carries the motion, and refuses what it cannot show."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po
from paraopt.view import Body, CableLine, Mark, PathLine, Phase, Readout, build_page, style, write_page
from paraopt.view.page import MODULES

TIMES = np.linspace(0.0, 1.0, 5)
NASTY = "</script><script>window.hacked = 1</script><b>&\"'"


def _poses(n: int = 5, frames: int = 2) -> np.ndarray:
    poses = np.tile(np.eye(4), (n, frames, 1, 1))
    for i in range(n):
        for f in range(frames):
            poses[i, f] = po.transform((0.1 * i, 0.2 * f, 0.0), (0.3 * i, 0.1 * f, 0.0))
    return poses


def _arguments(**changes: Any) -> dict[str, Any]:
    arguments: dict[str, Any] = {
        "title": "Robot",
        "bodies": [
            Body("floor", po.Box(size=(1.0, 1.0, 0.1)), -1, "obstacle"),
            Body("arm", po.Capsule(radius=0.05, length=0.3), 0),
            Body("hand", po.Sphere(radius=0.05), 1, "platform"),
        ],
        "times": TIMES,
        "poses": _poses(),
        "paths": [PathLine("way", np.random.default_rng(0).normal(size=(9, 3)), dashed=True)],
        "readouts": [Readout("clearance", "mm", np.arange(5.0), bound=2.0)],
        "caption": "a caption",
    }
    return {**arguments, **changes}


def _data(page: str) -> dict[str, Any]:
    match = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return json.loads(match[1])


def _numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4").astype(float)


class _Links(HTMLParser):
    """Collect what a browser would fetch, and the elements of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.elements: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        self.fetched += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]


# --- Alone


def test_a_page_fetches_nothing() -> None:
    page = build_page(**_arguments())
    links = _Links()
    links.feed(page)
    assert all(target.startswith("data:") for target in links.fetched)
    assert re.search(r"url\(\s*['\"]?(?!data:)\w", page) is None
    assert "@import" not in page
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert "default-src 'none'" in policy[1]
    assert "http" not in policy[1]


def test_its_scripts_are_inside_and_ask_for_nothing() -> None:
    page = build_page(**_arguments())
    match = re.search(r'<script type="importmap">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    imports = json.loads(match[1])["imports"]
    assert set(imports) == set(MODULES)
    own = [page[page.index('<script type="module">') :]]
    for name, url in imports.items():
        kind, _, content = url.partition("base64,")
        assert kind == "data:text/javascript;"
        source = base64.b64decode(content).decode("utf-8")
        if name.startswith("paraopt/"):
            own.append(source)
        # every import is answered by the map
        for wanted in re.findall(r'\bfrom\s*["\']([^"\']+)["\']', source):
            assert wanted in imports, (name, wanted)
    for source in own:
        assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|EventSource|sendBeacon|importScripts)\s*\(", source)
        # the name of a language of drawings is no place to fetch from
        text = source.split("<!--")[0].replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://", text)


def test_the_licence_of_what_is_carried_is_carried() -> None:
    page = build_page(**_arguments())
    assert "three.js authors" in page
    assert "Permission is hereby granted" in page


# --- What it carries


def test_the_motion_is_carried() -> None:
    data = _data(build_page(**_arguments()))
    assert data["count"] == 5
    assert data["frames"] == 2
    np.testing.assert_allclose(_numbers(data["times"]), TIMES, rtol=1e-7)
    poses = _numbers(data["poses"]).reshape(5, 2, 7)
    np.testing.assert_allclose(poses[..., :3], _poses()[..., :3, 3], rtol=0, atol=1e-7)
    # unit quaternions, continuous in time
    np.testing.assert_allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1.0, rtol=0, atol=1e-6)
    assert np.all(np.sum(poses[1:, :, 3:] * poses[:-1, :, 3:], axis=-1) > 0.0)
    # the rotation again, from the quaternion x y z w
    x, y, z, w = np.moveaxis(poses[..., 3:], -1, 0)
    np.testing.assert_allclose(1.0 - 2.0 * (y**2 + z**2), _poses()[..., 0, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(2.0 * (x * y + z * w), _poses()[..., 1, 0], rtol=0, atol=1e-6)


def test_quaternions_do_not_jump_over_a_full_turn() -> None:
    angles = np.linspace(0.0, 4.0 * np.pi, 61)
    poses = np.array([[po.transform((0, 0, 0), (0, 0, a))] for a in angles])
    body = [Body("wheel", po.Sphere(radius=1.0), 0)]
    data = _data(build_page(title="", bodies=body, times=np.arange(61.0), poses=poses))
    q = _numbers(data["poses"]).reshape(61, 7)[:, 3:]
    # 12 degrees a step: half of it in the quaternion
    assert np.all(np.sum(q[1:] * q[:-1], axis=-1) > np.cos(0.2))


def test_bodies_paths_and_readouts_are_carried() -> None:
    data = _data(build_page(**_arguments()))
    assert [body["name"] for body in data["bodies"]] == ["floor", "arm", "hand"]
    assert [body["frame"] for body in data["bodies"]] == [-1, 0, 1]
    assert [body["shape"]["type"] for body in data["bodies"]] == ["box", "capsule", "sphere"]
    assert data["bodies"][1]["shape"] == {"type": "capsule", "radius": 0.05, "length": 0.3}
    (path,), (readout,) = data["paths"], data["readouts"]
    assert path["dashed"] is True
    np.testing.assert_allclose(
        _numbers(path["points"]).reshape(-1, 3), np.random.default_rng(0).normal(size=(9, 3)), rtol=0, atol=1e-6
    )
    assert (readout["name"], readout["unit"], readout["bound"], readout["side"]) == ("clearance", "mm", 2.0, "lower")
    np.testing.assert_array_equal(_numbers(readout["values"]), np.arange(5.0))


def test_frames_that_carry_nothing_are_left_out() -> None:
    bodies = [Body("hand", po.Sphere(radius=0.05), 3)]
    data = _data(build_page(**_arguments(bodies=bodies, poses=_poses(frames=5))))
    assert data["frames"] == 1
    assert data["bodies"][0]["frame"] == 0
    np.testing.assert_allclose(_numbers(data["poses"]).reshape(5, 7)[:, 1], 0.6, rtol=0, atol=1e-6)


def test_cables_are_carried_with_the_frames_of_their_ends() -> None:
    cables = [
        CableLine("rope", (-1, 4), [(0, 0, 1), (0.1, 0, 0)], 0.002),
        CableLine("hose", (0, 4), np.ones((2, 3)), 0.01, "hoses", style.GREEN),
    ]
    data = _data(build_page(**_arguments(cables=cables, poses=_poses(frames=5))))
    assert data["frames"] == 3  # 0 and 1 of the bodies, 4 of the cables alone
    assert [cable["frames"] for cable in data["cables"]] == [[-1, 2], [0, 2]]
    assert data["cables"][0] == {
        "name": "rope", "frames": [-1, 2], "points": [[0, 0, 1], [0.1, 0, 0]], "radius": 0.002, "label": "Cables",
        "color": style.CABLE,
    }  # fmt: skip
    assert (data["cables"][1]["label"], data["cables"][1]["color"]) == ("hoses", style.GREEN)
    # a page may hold nothing else
    alone = _data(build_page(title="", bodies=[], cables=cables[:1], times=TIMES, poses=_poses(frames=5)))
    assert alone["frames"] == 1
    assert alone["bodies"] == []


def test_phases_are_carried_and_labels_have_colours() -> None:
    phases = [
        Phase("stand", 0.0, 0.4, [Mark("fixed", 0, (0, 0, 1)), Mark("fixed", 1, (0, 0, 2))]),
        Phase("swing", 0.4, 1.0, [Mark("fixed", 0, (0, 0, 1)), Mark("free", 3), Mark("odd", -1, (1, 2, 3), "#123456")]),
    ]
    data = _data(build_page(**_arguments(phases=phases, poses=_poses(frames=4))))
    assert data["frames"] == 3
    stand, swing = data["phases"]
    assert (stand["name"], stand["begin"], stand["end"]) == ("stand", 0.0, 0.4)
    assert [mark["frame"] for mark in stand["marks"]] == [0, 1]
    assert [mark["frame"] for mark in swing["marks"]] == [0, 2, -1]
    assert [mark["point"] for mark in swing["marks"]] == [[0, 0, 1], None, [1, 2, 3]]
    assert {mark["color"] for mark in stand["marks"]} == {style.MARKS[0]} == {swing["marks"][0]["color"]}
    assert [mark["color"] for mark in swing["marks"][1:]] == [style.MARKS[1], "#123456"]


def test_without_cables_and_phases_there_are_none() -> None:
    data = _data(build_page(**_arguments()))
    assert data["cables"] == data["phases"] == []


def test_a_scene_that_does_not_move_has_a_page_too() -> None:
    bodies = [Body("floor", po.Box(size=(1.0, 1.0, 0.1)))]
    data = _data(build_page(title="", bodies=bodies, times=[0.0], poses=np.zeros((1, 0, 4, 4))))
    assert (data["count"], data["frames"]) == (1, 0)


def test_the_same_content_gives_the_same_page() -> None:
    assert build_page(**_arguments()) == build_page(**_arguments())


# --- Escaping


def test_names_cannot_break_out() -> None:
    bodies = [Body(NASTY, po.Sphere(radius=0.05), 0)]
    changes = {
        "title": NASTY,
        "caption": NASTY,
        "bodies": bodies,
        "paths": [PathLine(NASTY, np.zeros((2, 3)))],
        "readouts": [Readout(NASTY, "</script>", np.zeros(5))],
        "cables": [CableLine(NASTY, (0, 1), np.ones((2, 3)), 0.1)],
        "phases": [Phase(NASTY, 0.0, 1.0, [Mark(NASTY, 0)])],
    }
    page, harmless = build_page(**_arguments(**changes)), build_page(**_arguments())
    looked, usual = _Links(), _Links()
    looked.feed(page)
    usual.feed(harmless)
    assert looked.elements == usual.elements  # no element more
    assert "window.hacked" in page
    assert "<script>window.hacked" not in page
    data = _data(page)
    assert data["bodies"][0]["name"] == data["paths"][0]["name"] == data["readouts"][0]["name"] == NASTY
    assert data["cables"][0]["name"] == data["phases"][0]["name"] == data["phases"][0]["marks"][0]["label"] == NASTY


def test_braces_are_not_taken_for_places_to_fill() -> None:
    page = build_page(**_arguments(title="{{data}} {{script}}", caption="{{unknown}}"))
    assert "<h1>{{data}} {{script}}</h1>" in page
    assert "{{unknown}}" in page


# --- Refusals


def _spoilt_poses(change: Any) -> np.ndarray:
    poses = _poses()
    change(poses)
    return poses


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bodies": []}, "bodies is empty"),
        ({"up": "w"}, "axis that points up: 'w'"),
        ({"times": TIMES[::-1]}, "times: instant 1"),
        ({"times": [0.0, 1.0]}, "poses: shape"),
        ({"times": np.append(TIMES[:-1], np.nan)}, "times: entry"),
        ({"poses": _poses()[..., :3, :]}, "poses: shape"),
        ({"poses": _spoilt_poses(lambda p: p.__setitem__((2, 1, 0, 3), np.nan))}, "poses: entry"),
        ({"poses": _spoilt_poses(lambda p: p.__setitem__((2, 1, 0, 0), 2.0))}, "frame 1 at sample 2 is not a rigid"),
        (
            {"poses": _spoilt_poses(lambda p: p.__imul__(np.diag([1, 1, -1, 1.0])))},
            "frame 0 at sample 0 is not",
        ),
        ({"poses": _spoilt_poses(lambda p: p.__setitem__((0, 0, 3, 0), 1e-3))}, "is not a rigid pose"),
        ({"bodies": [Body("hand", po.Sphere(radius=1.0), 2)]}, "frame of body 'hand' is 2, but poses hold 2 frames"),
        (
            {"cables": [CableLine("rope", (0, 2), np.ones((2, 3)), 1)]},
            "frame of cable 'rope' is 2, but poses hold 2 frames",
        ),
        ({"phases": [Phase("swing", 0, 1, [Mark("foot", 7)])]}, "frame of mark 'foot' is 7, but poses hold 2 frames"),
        ({"phases": [Phase("swing", 3, 4)]}, "phase 'swing' lasts from 3.0 s to 4.0 s, the motion from 0.0 s to 1.0 s"),
        ({"readouts": [Readout("speed", "", [1.0])]}, "values of readout 'speed': there are 1 for 5 times"),
    ],
)
def test_faulty_pages_are_refused_and_not_written(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        write_page(tmp_path / "page.html", **_arguments(**changes))
    assert list(tmp_path.iterdir()) == []


def test_a_page_is_written_as_it_was_built(tmp_path: Path) -> None:
    path = write_page(tmp_path / "new" / "page.html", **_arguments())
    assert path.read_text(encoding="utf-8") == build_page(**_arguments())
