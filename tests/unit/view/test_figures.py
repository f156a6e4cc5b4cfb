"""Figures along time: the curves, the limits they must respect, and files that are the same every time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

import paraopt as po
from paraopt.view import draw_actuators, draw_margins, draw_series, save_figure

T = np.linspace(0.0, 2.0, 50)
CURVES = {"one": np.sin(T), "two": np.cos(T)}


# --- Series


def test_series_share_a_panel_with_their_limits(looked_at: Any) -> None:
    figure = draw_series(T, CURVES, title="Series", ylabel="angle [rad]", limits=(-1.5, 1.2))
    (axes,) = figure.axes
    assert looked_at.lines_at(axes, -1.5)
    assert looked_at.lines_at(axes, 1.2)
    for name, values in CURVES.items():
        (curve,) = [line for line in axes.get_lines() if line.get_label() == name]
        np.testing.assert_array_equal(curve.get_ydata(), values)
        np.testing.assert_array_equal(curve.get_xdata(), T)
    texts = looked_at.texts(figure)
    for word in ("Series", "angle [rad]", "time [s]", "lower limit −1.5", "upper limit 1.2"):
        assert word in texts
    low, high = axes.get_ylim()
    assert low < -1.5 < 1.2 < high  # limits are in the picture


def test_limits_by_name_give_each_series_a_panel(looked_at: Any) -> None:
    limits = {"one": (-1.0, 2.0), "two": (-3.0, np.inf)}
    figure = draw_series(T, CURVES, title="Series", ylabel="angle [rad]", limits=limits)
    first, second = figure.axes
    assert looked_at.lines_at(first, -1.0)
    assert looked_at.lines_at(first, 2.0)
    assert looked_at.lines_at(second, -3.0)
    assert not looked_at.lines_at(second, 2.0)
    assert "inf" not in looked_at.texts(figure)  # an infinite limit is not drawn


def test_a_bound_marks_the_least_value(looked_at: Any) -> None:
    figure = draw_series(T, {"margin": 0.5 + (T - 1.0) ** 2}, title="Margin", ylabel="margin", bound=0.2)
    (axes,) = figure.axes
    assert looked_at.lines_at(axes, 0.2)
    texts = looked_at.texts(figure)
    assert "asked 0.2" in texts
    assert "least 0.5" in texts


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"series": {}}, "series is empty"),
        ({"series": {"one": [1.0, 2.0]}}, r"series 'one': shape is \(2,\); it must be \(50,\)"),
        ({"series": {"one": np.where(T > 1, np.nan, T)}}, "series 'one': entry"),
        ({"times": T[::-1]}, "times: instant 1"),
        ({"limits": {"three": (0, 1)}}, "limits name 'three', which is no series"),
        ({"limits": (1.0, -1.0)}, "limits of 'one' are"),
        ({"limits": {"one": (np.nan, 1.0)}}, "limits of 'one' are"),
        ({"bound": np.inf}, "bound: entry"),
    ],
)
def test_faulty_series_are_refused(arguments: dict[str, Any], words: str) -> None:
    options = {"times": T, "series": CURVES, "title": "", "ylabel": "", **arguments}
    with pytest.raises(po.DefinitionError, match=words):
        draw_series(options.pop("times"), options.pop("series"), **options)


# --- Actuators


def _actuators(**changes: Any) -> Any:
    q = np.column_stack([0.1 * np.sin(T), 0.05 * np.cos(T)])
    v, a = np.gradient(q, T, axis=0), np.gradient(np.gradient(q, T, axis=0), T, axis=0)
    options: dict[str, Any] = {
        "units": "m",
        "position_limits": [(-0.2, 0.2), (-0.2, 0.2)],
        "velocity_limits": [(-0.3, 0.3), (-0.3, 0.3)],
        "acceleration_limits": [(-0.4, 0.4), (-0.5, 0.5)],
    }
    return draw_actuators(T, ["q1", "q2"], q, v, a, **{**options, **changes})


def test_actuators_are_drawn_with_all_their_limits(looked_at: Any) -> None:
    figure = _actuators()
    position, velocity, acceleration = figure.axes
    for axes, limits in ((position, (200,)), (velocity, (300,)), (acceleration, (400, 500))):
        for limit in limits:  # lengths below two metres are printed in millimetres
            assert looked_at.lines_at(axes, limit, 1e-6), (axes.get_ylabel(), limit)
            assert looked_at.lines_at(axes, -limit, 1e-6)
            assert axes.get_ylim()[0] < -limit < limit < axes.get_ylim()[1]
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "position [mm]", "velocity [mm/s]", "acceleration [mm/s²]",
    ]  # fmt: skip
    curves = [line for line in position.get_lines() if line.get_label() in ("q1", "q2")]
    np.testing.assert_allclose(curves[0].get_ydata(), 100.0 * np.sin(T), rtol=1e-12, atol=1e-12)


def test_actuators_of_different_units_stand_apart(looked_at: Any) -> None:
    figure = _actuators(units=["m", "rad"], position_limits=None, velocity_limits=None, acceleration_limits=None)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert len(labels) == 6
    assert {"position [mm]", "position [rad]", "velocity [rad/s]"} <= set(labels)


def test_infinite_limits_are_not_drawn(looked_at: Any) -> None:
    figure = _actuators(position_limits=[(-np.inf, np.inf)] * 2)
    assert "limit" not in "\n".join(t.get_text() for t in figure.axes[0].texts)
    assert "inf" not in looked_at.texts(figure)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"units": ["m"]}, "units: there are 1 for 2 actuators"),
        ({"velocity_limits": [(-1, 1)]}, "velocity limits are"),
        ({"position_limits": [(1, -1), (0, 1)]}, "position limits are"),
        ({"acceleration_limits": [("a", 1), (0, 1)]}, "acceleration limits: entries must be numbers"),
    ],
)
def test_faulty_actuators_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        _actuators(**changes)


# --- Margins


def test_margins_are_drawn_with_what_was_asked(looked_at: Any) -> None:
    margins = {"parallel": 0.2 + 0.1 * np.cos(T), "serial": 0.5 + 0.0 * T}
    figure = draw_margins(T, 0.006 + 0.004 * np.sin(T), 0.005, margins, 0.05)
    above, below = figure.axes
    assert looked_at.lines_at(above, 5.0, 1e-9)  # in millimetres
    assert looked_at.lines_at(below, 0.05)
    texts = looked_at.texts(figure)
    for word in (
        "clearance [mm]",
        "singularity margin",
        "asked 5 mm",
        "asked 0.05",
        "parallel",
        "serial",
        "least 6 mm",
    ):
        assert word in texts, word


def test_margins_of_many_decades_are_drawn_on_a_logarithmic_axis() -> None:
    figure = draw_margins(T, 0.01 + 0 * T, 0.005, {"parallel": np.exp(-6.0 * T)}, 0.05)
    assert figure.axes[-1].get_yscale() == "log"
    assert draw_margins(T, 0.01 + 0 * T, 0.005, {"parallel": 0.2 + 0 * T}, 0.05).axes[-1].get_yscale() == "linear"


def test_a_machine_that_cannot_collide_has_no_clearance_panel(looked_at: Any) -> None:
    figure = draw_margins(T, None, 0.005, {"parallel": 0.2 + 0 * T}, 0.05)
    assert len(figure.axes) == 1
    assert "clearance" not in looked_at.texts(figure)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((T[:-1], 0.005, CURVES, 0.05), "clearance: shape"),
        ((np.full(50, np.inf), 0.005, CURVES, 0.05), "clearance: entry"),
        ((T, float("nan"), CURVES, 0.05), "clearance bound"),
        ((T, 0.005, {}, 0.05), "margins is empty"),
        ((T, 0.005, {"parallel": [1.0]}, 0.05), "margins 'parallel'"),
        ((T, 0.005, CURVES, float("inf")), "margin bound"),
    ],
)
def test_faulty_margins_are_refused(arguments: tuple[Any, ...], words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        draw_margins(T, *arguments)


# --- Saving


def test_a_saved_figure_is_not_blank(tmp_path: Path, looked_at: Any) -> None:
    path = save_figure(_actuators(), tmp_path / "figures" / "actuators.png", resolution=80)
    pixels = looked_at.read_png(path)
    assert pixels.shape[:2] == (560, 592)  # 7.0 by 7.4 inches
    # a white page has no variance; curves and letters cover a few percent
    assert pixels.var() > 1e-3
    assert 0.005 < np.mean(np.min(pixels, axis=-1) < 0.9) < 0.5
    assert list((tmp_path / "figures").iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_same_figure_gives_the_same_bytes(suffix: str, tmp_path: Path) -> None:
    first, second = (save_figure(_actuators(), tmp_path / f"{i}{suffix}") for i in (1, 2))
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("name", ["figure.pdf", "figure", "figure.PNG.txt"])
def test_other_formats_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(po.DefinitionError, match=r"must end in \.png or \.svg"):
        save_figure(_actuators(), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_persons_own_settings_are_left_alone_and_not_followed(tmp_path: Path) -> None:
    usual = save_figure(_actuators(), tmp_path / "usual.png").read_bytes()
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.facecolor": "black"}):
        other = save_figure(_actuators(), tmp_path / "other.png").read_bytes()
        assert mpl.rcParams["lines.linewidth"] == 9.0
    assert other == usual
