"""Figures, page and files of a walk."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import paraopt as po
from paraopt.io import read_trajectory, tabulate_legged
from paraopt.modes.legged import (
    LeggedPlan,
    LeggedTask,
    Phase,
    PhaseMark,
    PlaneSupport,
    build_polygon,
    measure_centre,
    plan_legged,
)
from paraopt.view import (
    draw_balance,
    draw_filmstrip,
    draw_footfalls,
    draw_leg_actuators,
    draw_support_margin,
    list_page_phases,
    save_legged,
)
from paraopt.view.legged_motion import follow_support


@pytest.fixture(scope="module")
def plan() -> LeggedPlan:
    """GIPO shifts its trunk and lifts a foot."""
    machine = po.robots.gipo_machine()
    trunk, foot = ("x", "y", "z", "alpha", "beta", "gamma"), tuple(f"right rear foot {axis}" for axis in "xyz")
    shift = Phase("shift", machine.names, trunk, {"y": 0.02, "z": -0.01})
    lift = Phase("lift", machine.names[1:], foot, {foot[2]: 0.02}, locked=(*trunk, "left front knee"))
    task = LeggedTask(machine, (shift, lift), PlaneSupport((0, 0, -0.155)))
    return plan_legged(task, retimer=po.TimeOptimal())


def test_the_margin_is_drawn_with_its_phases(plan: LeggedPlan) -> None:
    heavy = replace(plan.task.machine, masses={**(plan.task.machine.masses or {}), "head": 0.2})
    figure = draw_support_margin(plan, others={"heavy head": heavy})
    axes = figure.axes[0]
    planned = axes.lines[0].get_ydata()
    assert np.nanmin(planned) == pytest.approx(1e3 * plan.certificate.smallest_margin, rel=1e-3)
    assert np.count_nonzero(np.isnan(planned)) == 2  # the line is broken after each phase
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["lifting right rear", "as planned", "heavy head"]
    assert axes.get_ylabel() == "support margin [mm]"
    unsure = draw_support_margin(plan, mass_share=0.1).axes[0]
    worst = next(line for line in unsure.lines if line.get_label() == "worst masses within ±10 %")
    assert np.nanmin(planned - worst.get_ydata()) > 0.0
    moving = draw_support_margin(plan, inertia=True).axes[0]
    felt = next(line for line in moving.lines if line.get_label() == "with inertia").get_ydata()
    assert np.nanmin(felt) == pytest.approx(1e3 * plan.certificate.smallest_tipping)
    silent = replace(plan, phases=tuple(replace(p, phase=replace(p.phase, stability=None)) for p in plan.phases))
    with pytest.raises(po.DefinitionError, match="nothing to draw"):
        draw_support_margin(silent)


def test_footfalls_have_a_bar_while_a_foot_stands() -> None:
    marks = [
        PhaseMark("a", 0.0, 1.0, ("one", "two"), ()),
        PhaseMark("b", 1.0, 3.0, ("one",), ("two",)),
        PhaseMark("c", 3.0, 4.0, ("one", "two"), ()),
    ]
    axes = draw_footfalls(marks, feet=("one", "two")).axes[0]
    bars = [(b.get_x(), b.get_width(), round(b.get_y() + 0.31), b.get_hatch()) for b in axes.patches]
    # phases that follow each other are one bar
    assert bars == [(0.0, 4.0, 0, None), (0.0, 1.0, 1, None), (3.0, 1.0, 1, None), (1.0, 2.0, 1, "////")]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["one", "two"]
    with pytest.raises(po.DefinitionError, match="no phase"):
        draw_footfalls([])


def test_balance_and_filmstrip(plan: LeggedPlan) -> None:
    axes = draw_balance(plan).axes[0]
    assert axes.get_legend() is not None
    assert len(axes.patches) == 2  # the polygon of the one phase in which a foot is lifted, filled and outlined
    film = draw_filmstrip(plan, times=[0.0, plan.trajectory.duration], columns=2, resolution=40)
    assert len(film.axes) == 2
    first, last = (frame.images[0].get_array() for frame in film.axes)
    assert first.shape == last.shape
    assert np.mean(np.abs(first - last)) > 0.003, "the robot did not move"
    faces = [[line.get_markerfacecolor() for line in frame.lines] for frame in film.axes]
    assert len(set(faces[0])) == 1
    assert [face == faces[0][0] for face in faces[1]] == [False, True, True, True]  # the lifted foot is a ring
    assert len(draw_filmstrip(plan, resolution=40).axes) == 2
    for wrong in ({"times": []}, {"columns": 0}, {"times": [-1.0]}):
        with pytest.raises(po.DefinitionError):
            draw_filmstrip(plan, resolution=40, **wrong)  # type: ignore[arg-type]


def test_the_page_marks_feet_and_locks(plan: LeggedPlan) -> None:
    shift, lift = list_page_phases(plan)
    assert [mark.label for mark in shift.marks] == ["fixed foot"] * 4
    assert [mark.label for mark in lift.marks] == ["free foot", *["fixed foot"] * 3, "locked joint"]
    assert (shift.begin, shift.end, lift.end) == (0.0, lift.begin, plan.trajectory.duration)
    # a foot that is a link of its own takes the colour, since its solid hides the mark
    foot = replace(plan.task.machine.feet[0], link="right rear carrier z", point=(0, 0, 0))
    own = replace(
        plan, task=replace(plan.task, machine=replace(plan.task.machine, feet=(foot, *plan.task.machine.feet[1:])))
    )
    assert [(m.label, m.point) for m in list_page_phases(own)[1].marks[:2]] == [
        ("free foot", (0, 0, 0)),
        ("free foot", None),
    ]


def test_the_page_draws_the_support_polygon_and_where_weight_presses(plan: LeggedPlan) -> None:
    t = np.array([0.5, 1.0, 1.01, 1.5]) * plan.trajectory.borders[1]
    X = plan.trajectory(t)
    frames, lines = follow_support(plan, t, X)
    assert len(lines) == 4  # as many as the largest polygon has
    links = len(plan.task.machine.robot.mechanism.links)
    ends = np.array([[[frames[i, f - links, :3, 3] for f in line.frames] for line in lines] for i in range(len(t))])
    lengths = np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1)
    assert np.all(lengths[0] > 0.1)
    feet = plan.task.machine.contacts(X)[1]
    for i, standing in ((0, plan.task.machine.names), (3, plan.phases[1].phase.standing)):
        polygon = build_polygon(plan.task.machine, X[i], standing)
        around = sum(np.linalg.norm(np.roll(polygon.points, -1, axis=0) - polygon.points, axis=1))
        assert lengths[i].sum() == pytest.approx(around)
        assert np.max(np.min(np.linalg.norm(ends[i].reshape(-1, 1, 3) - feet[i], axis=2), axis=1)) < 1e-12
    assert np.array_equal(ends[1], ends[3])  # where phases meet it is that of the later one
    centre = measure_centre(plan.task.machine, X)
    np.testing.assert_allclose(frames[:, 0, :3, 3], np.column_stack([centre[:, :2], np.full(4, -0.155)]), atol=1e-12)
    free = replace(plan, phases=tuple(replace(p, phase=replace(p.phase, stability=None)) for p in plan.phases))
    assert follow_support(free, t, X)[1] == ()


def test_actuators_have_a_column_for_each_leg(plan: LeggedPlan) -> None:
    figure = draw_leg_actuators(plan, count=11)
    assert [axes.get_title("left") for axes in figure.axes[:4]] == list(plan.task.machine.names)
    assert [len([x for x in axes.lines if x.get_label() in ("hip", "abduction", "knee")]) for axes in figure.axes] == [
        3
    ] * 12
    knee = next(line for line in figure.axes[5].lines if line.get_label() == "knee").get_ydata()
    i = plan.task.machine.robot.mechanism.index("right front knee")
    times = np.linspace(0.0, plan.trajectory.duration, 11)
    np.testing.assert_allclose(knee, plan.trajectory(times, 1)[:, i])
    assert [len(axes.patches) for axes in figure.axes[:4]] == [1, 0, 0, 0]  # shaded while the foot is in the air
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == ["hip", "abduction", "knee", "limits", "foot in the air"]


def test_a_walk_is_saved(plan: LeggedPlan, tmp_path: Path) -> None:
    files = save_legged(plan, tmp_path / "walk", period=5e-3)
    assert set(files) == {
        "trajectory", "report", "actuators", "footfalls", "filmstrip", "margin", "balance", "page",
    }  # fmt: skip
    table = read_trajectory(files["trajectory"])
    assert table.columns[:2] == ("t [s]", "phase [1]")
    assert np.array_equal(table.values, tabulate_legged(plan.trajectory, 5e-3).values)
    border = plan.trajectory.borders[1]
    assert np.array_equal(table["phase [1]"], (table["t [s]"] >= border).astype(float))
    report = json.loads(files["report"].read_text())
    assert [phase["name"] for phase in report["phases"]] == ["shift", "lift"]
    assert report["phases"][1]["lifted"] == ["right rear"]
    assert report["phases"][1]["support margin asked [m]"] == 0.0
    assert report["phases"][1]["locked"]["y"] == 0.02
    assert report["certificate"]["passed"] is True
    assert report["certificate"]["smallest support margin [m]"] == plan.certificate.smallest_margin
    text = files["page"].read_text(encoding="utf-8")
    assert re.search(r'"shift"', text)
    assert re.search(r'"free foot"', text)
    assert re.search(r'"support polygon"', text)
    assert re.search(r'"point below the centre of gravity"', text)
    told = re.findall(r'"name":\s*"([a-z ]+ up)"', text)
    assert told == ["right rear up"]  # of the one foot that is lifted
    plain = save_legged(plan, tmp_path / "plain", view=False)
    assert set(plain) == {"trajectory", "report"}
