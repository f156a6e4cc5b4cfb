"""The page of a real plan, opened in a headless Chromium without a network: it shows the robot, and it moves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import paraopt as po
from motions import TASKS, cable_plan, plan_of, problem_of
from paraopt.view import Body, Phase, Readout, mark_link, style, write_motion_page, write_page
from paraopt.view.motion import list_cable_ends, trace

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    return {task: plan_of(task).save(folder / task)["page"] for task in TASKS}


@pytest.fixture
def page(chromium: Any, pages: dict[str, Path]) -> Any:
    """Give the browser with the page of the cylinder task, open and paused at its start."""
    chromium.open(pages["cylinder"])
    chromium.evaluate("paraopt.seek(paraopt.start)")
    return chromium


def _still(browser: Any) -> np.ndarray:
    """Take a picture after the page had time to draw two frames."""
    browser.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")
    return browser.screenshot()


@pytest.mark.parametrize("task", TASKS)
def test_the_page_opens_without_an_error(chromium: Any, pages: dict[str, Path], task: str) -> None:
    chromium.open(pages[task])
    assert chromium.evaluate("paraopt.ready") is True
    assert chromium.evaluate("paraopt.failure") == ""
    assert chromium.evaluate("document.getElementById('failure').hidden") is True
    assert chromium.complaints == []
    assert chromium.evaluate("paraopt.end") == pytest.approx(plan_of(task).trajectory.duration, rel=1e-6)
    assert chromium.evaluate("document.querySelector('h1').textContent") == "RAF: certified motion"


@pytest.mark.parametrize("task", TASKS)
def test_the_page_asks_for_nothing_but_itself(chromium: Any, pages: dict[str, Path], task: str) -> None:
    chromium.open(pages[task])
    assert chromium.requests[0] == pages[task].resolve().as_uri()
    assert all(url.startswith("data:") for url in chromium.requests[1:])


def test_the_picture_is_not_blank(page: Any) -> None:
    picture = _still(page)
    assert picture.shape == (800, 1280, 3)
    view = picture[page.region("#view")]
    # a plain background has no variance; the robot, its shadow and the grid fill the view
    assert view.var() > 1e-3
    assert len(np.unique((255 * view).astype(int).reshape(-1, 3), axis=0)) > 500
    # blue of the platform and vermillion of the obstacle are there, in whatever light
    red, green, blue = view[..., 0], view[..., 1], view[..., 2]
    assert np.count_nonzero((blue > red + 0.2) & (blue > green)) > 500
    assert np.count_nonzero((red > blue + 0.2) & (red > green)) > 500


def test_two_instants_look_different(page: Any) -> None:
    area = page.region("#view")
    first = _still(page)[area]
    again = _still(page)[area]
    page.evaluate("paraopt.seek(0.5 * (paraopt.start + paraopt.end))")
    middle = _still(page)[area]
    page.evaluate("paraopt.seek(paraopt.start)")
    back = _still(page)[area]
    moved = np.abs(middle - first).max(axis=-1) > 0.1
    assert np.count_nonzero(moved) > 2000
    # while it stands the picture stands, and the start looks like the start again
    assert np.count_nonzero(np.abs(again - first).max(axis=-1) > 0.1) == 0
    assert np.count_nonzero(np.abs(back - first).max(axis=-1) > 0.1) == 0


@pytest.mark.parametrize("share", [0.0, 0.37, 1.0])
def test_bodies_stand_where_the_trajectory_puts_them(page: Any, share: float) -> None:
    plan = plan_of("cylinder")
    t = share * plan.trajectory.duration
    page.evaluate(f"paraopt.seek({t!r})")
    assert page.evaluate("paraopt.time") == pytest.approx(t, abs=1e-6)
    X = plan.trajectory(min(t, plan.trajectory.duration))[None, :]
    poses = problem_of("cylinder").robot.kinematics.poses(X)[0]
    bodies = {body.name: body for body in problem_of("cylinder").scene.bodies}
    for name in ("tool", "rod 2", "arm A", "forearm B-", "base plate", "cylinder"):
        body = bodies[name]
        expected = (poses[body.frame] if body.frame >= 0 else np.eye(4)) @ body.shape.pose
        drawn = np.array(page.evaluate(f"Array.from(paraopt.poseOf({name!r}))")).reshape(4, 4)
        # 32-bit floats, and chords between samples 1/60 s apart: at 0.5 m/s^2 some 0.02 mm, turned a little more
        np.testing.assert_allclose(drawn, expected, rtol=0, atol=3e-4)
    tip = np.array(page.evaluate("Array.from(paraopt.poseOf('tool'))")).reshape(4, 4)[:2, 3]
    assert tip == pytest.approx(trace(problem_of("cylinder"), X)[0, :2], abs=3e-4)


def test_the_page_plays(page: Any) -> None:
    frames = page.evaluate("paraopt.frame")
    page.evaluate("paraopt.play()")
    assert page.evaluate("paraopt.playing") is True
    wait = "const wait = () => paraopt.time > 0.1 ? done(true) : requestAnimationFrame(wait)"
    page.evaluate(f"new Promise(done => {{ {wait}; wait(); }})")
    page.evaluate("paraopt.pause()")
    assert page.evaluate("paraopt.playing") is False
    assert 0.1 < page.evaluate("paraopt.time") <= plan_of("cylinder").trajectory.duration + 1e-6
    assert page.evaluate("paraopt.frame") > frames
    assert page.complaints == []


def test_obstacles_can_be_hidden(page: Any) -> None:
    area = page.region("#view")
    with_obstacle = _still(page)[area]
    page.evaluate("paraopt.toggle('obstacles')")
    without = _still(page)[area]

    def vermillion(picture: np.ndarray) -> int:
        return int(np.count_nonzero((picture[..., 0] > picture[..., 2] + 0.3) & (picture[..., 0] > picture[..., 1])))

    assert vermillion(without) < 0.5 * vermillion(with_obstacle)


@pytest.mark.parametrize("view", ["top", "front", "side"])
def test_views_differ(page: Any, view: str) -> None:
    area = page.region("#view")
    usual = _still(page)[area]
    page.evaluate(f"paraopt.setView({view!r})")
    other = _still(page)[area]
    assert other.var() > 1e-3
    assert np.mean(np.abs(other - usual).max(axis=-1) > 0.1) > 0.02


def test_readouts_show_numbers_at_the_instant(page: Any) -> None:
    page.evaluate("paraopt.seek(paraopt.start)")
    first = page.evaluate("document.getElementById('readouts').innerText")
    page.evaluate("paraopt.seek(0.5 * paraopt.end)")
    assert page.evaluate("document.getElementById('readouts').innerText") != first
    for name in ("clearance", "parallel margin", "q1", "q2", "q3"):
        assert name in first
    assert "18.0" in first  # millimetres from the tool to the cylinder at the start


def test_names_are_shown_and_not_run(chromium: Any, tmp_path: Path) -> None:
    nasty = "</script><img src=x onerror='window.hacked = 1'><b>&"
    path = write_page(
        tmp_path / "nasty.html",
        title=nasty,
        caption=nasty,
        bodies=[Body(nasty, po.Sphere(radius=0.1), 0)],
        times=[0.0, 1.0],
        poses=np.array([[po.transform((0, 0, 0))], [po.transform((1, 0, 0))]]),
        readouts=[Readout(nasty, nasty, [0.0, 1.0])],
    )
    chromium.open(path)
    assert chromium.evaluate("paraopt.ready") is True
    assert chromium.evaluate("window.hacked === undefined") is True
    assert chromium.evaluate("document.querySelector('h1').textContent") == nasty
    assert chromium.evaluate(f"paraopt.poseOf({json.dumps(nasty)}) !== null") is True
    assert chromium.complaints == []


# --- Cables and phases


@pytest.fixture(scope="module")
def cable_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plan = cable_plan()
    mechanism, end = plan.problem.robot.mechanism, plan.trajectory.duration
    phases = [
        Phase("pull", 0.0, 0.4 * end, [mark_link(mechanism, "exit", "base", corner) for corner in ((0, 0), (0, 1))]),
        Phase("turn", 0.4 * end, 0.8 * end, [mark_link(mechanism, "held", "platform", (0.1, 0)),
                                             mark_link(mechanism, "moving", "platform")]),
    ]  # fmt: skip
    path = tmp_path_factory.mktemp("cables") / "motion.html"
    return write_motion_page(path, plan.problem, plan.seed, plan.trajectory, plan.certificate, phases=phases)


@pytest.mark.parametrize("share", [0.0, 0.31, 0.77, 1.0])
def test_cables_are_drawn_between_their_links(chromium: Any, cable_page: Path, share: float) -> None:
    chromium.open(cable_page)
    assert chromium.complaints == []
    plan = cable_plan()
    t = share * plan.trajectory.duration
    chromium.evaluate(f"paraopt.seek({t!r})")
    expected = list_cable_ends(plan.problem.scene, plan.trajectory(t)[None, :])[0]
    for cable, ends in zip(plan.problem.scene.all_cables, expected, strict=True):
        drawn = chromium.evaluate(f"paraopt.endsOf({cable.name!r})")
        np.testing.assert_allclose(drawn, ends, rtol=0, atol=3e-4)
    assert chromium.evaluate("paraopt.endsOf('no cable')") is None
    assert "Cables" in chromium.evaluate("document.getElementById('legend').innerText")


def test_cables_are_seen_and_have_names(chromium: Any, cable_page: Path) -> None:
    """From above the middle of a cable is dark, and resting there names it."""
    chromium.open(cable_page)
    chromium.evaluate("paraopt.seek(0)")
    chromium.evaluate("paraopt.setView('top')")
    picture = _still(chromium)
    rows, columns = chromium.region("#view")
    view = picture[rows, columns]
    dark = view.max(axis=-1) < 0.4
    assert np.count_nonzero(dark) > 400
    # the pointer visits dark pixels until one of them belongs to a cable
    named = set()
    spots = np.argwhere(dark)
    for y, x in spots[:: max(1, len(spots) // 60)]:
        chromium.call("Input.dispatchMouseEvent", type="mouseMoved", x=int(x) + columns.start, y=int(y) + rows.start)
        named.add(chromium.evaluate("document.getElementById('hover').textContent"))
    assert {f"cable q{i}" for i in (1, 2, 3, 4)} & named, named


def test_phases_name_themselves_and_mark_what_they_are_about(chromium: Any, cable_page: Path) -> None:
    chromium.open(cable_page)
    end = cable_plan().trajectory.duration
    text = "document.getElementById('phase').textContent"
    assert [chromium.evaluate(f"[...document.querySelectorAll('.phase')][{k}].textContent") for k in (0, 1)] == [
        "pull",
        "turn",
    ]
    for share, name in ((0.0, "pull"), (0.39, "pull"), (0.41, "turn"), (0.8, "turn"), (0.9, ""), (1.0, "")):
        chromium.evaluate(f"paraopt.seek({share * end!r})")
        assert chromium.evaluate("paraopt.phase") == chromium.evaluate(text) == name, share
        current = chromium.evaluate("document.querySelector('.phase[aria-current]')?.textContent ?? ''")
        assert current == name
    chromium.evaluate("paraopt.seek(0)")
    marks = chromium.evaluate("paraopt.marks()")
    assert [mark["label"] for mark in marks] == ["exit", "exit"]
    np.testing.assert_allclose([mark["point"] for mark in marks], [(0, 0, 0), (0, 1, 0)], rtol=0, atol=1e-6)
    t = 0.6 * end
    chromium.evaluate(f"paraopt.seek({t!r})")
    held, moving = chromium.evaluate("paraopt.marks()")
    x, y, theta = cable_plan().trajectory(t)[-3:]
    np.testing.assert_allclose(held["point"], (x + 0.1 * np.cos(theta), y + 0.1 * np.sin(theta), 0), rtol=0, atol=3e-4)
    assert moving["point"] is None
    assert set(moving["bodies"]) == {"platform", "platform bar"}
    legend = chromium.evaluate("document.getElementById('legend').innerText")
    assert all(label in legend for label in ("exit", "held", "moving"))
    chromium.evaluate("document.querySelectorAll('.phase')[1].click()")
    assert chromium.evaluate("paraopt.time") == pytest.approx(0.4 * end, abs=1e-6)
    assert chromium.evaluate("paraopt.playing") is False


def test_marks_are_seen_while_their_phase_lasts(chromium: Any, cable_page: Path) -> None:
    chromium.open(cable_page)
    end = cable_plan().trajectory.duration
    crimson = np.array([int(style.MARKS[0][i : i + 2], 16) for i in (1, 3, 5)]) / 255

    def count() -> int:
        view = _still(chromium)[chromium.region("#view")][90:]  # below the legend
        ratio = view / np.maximum(view.max(axis=-1, keepdims=True), 1e-6)
        hue = np.abs(ratio - crimson / crimson.max()).max(axis=-1) < 0.12
        return int(np.count_nonzero(hue & (view.max(axis=-1) > 0.3)))

    counts = []
    for share in (0.2, 0.9):
        chromium.evaluate(f"paraopt.seek({share * end!r})")
        counts.append(count())
    assert counts[0] > 100 > counts[1]


def test_a_page_without_phases_has_no_room_for_them(page: Any) -> None:
    for name in ("phase", "phases"):
        assert page.evaluate(f"document.getElementById('{name}').hidden") is True
    assert "Cables" not in page.evaluate("document.getElementById('legend').innerText")
    assert page.evaluate("paraopt.phase") == ""
    assert page.evaluate("paraopt.marks().length") == 0
