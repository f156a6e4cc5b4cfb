"""What pages and figures are told to draw: copied, read-only, and refused by name when faulty."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import paraopt as po
from paraopt.view import Body, CableLine, Mark, PathLine, Phase, Readout
from paraopt.view.content import KINDS, check_phases, increasing_times
from paraopt.view.style import KIND_COLORS, KIND_LABELS, check_color, path_color, series_color, series_dash

BALL = po.Sphere(radius=0.1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Body("arm", "a cylinder"), "shape of body 'arm' is a str"),  # type: ignore[arg-type]
        (lambda: Body("arm", BALL, frame=-2), "frame of body 'arm' is -2"),
        (lambda: Body("arm", BALL, frame=0.5), "frame of body 'arm' is 0.5"),  # type: ignore[arg-type]
        (lambda: Body("arm", BALL, frame=True), "frame of body 'arm' is True"),
        (lambda: Body("arm", BALL, kind="leg"), "kind of body 'arm': 'leg'"),
        (lambda: PathLine("way", [[0.0, 0.0]]), r"points of path 'way': shape is \(1, 2\)"),
        (lambda: PathLine("way", np.empty((0, 3))), r"points of path 'way': shape is \(0, 3\)"),
        (lambda: PathLine("way", [[0, 0, np.nan]]), r"points of path 'way': entry \(0, 2\) is nan"),
        (lambda: PathLine("way", [[0, 0, "up"]]), "points of path 'way': entries must be numbers"),
        (lambda: PathLine("way", [[0, 0, 0]], color="red"), "color of path 'way' is 'red'"),
        (lambda: PathLine("way", [[0, 0, 0]], color="#12345G"), "color of path 'way'"),
        (lambda: Readout("speed", "m/s", [[1.0]]), "values of readout 'speed': shape"),
        (lambda: Readout("speed", "m/s", [1.0, np.inf]), r"values of readout 'speed': entry \(1,\) is inf"),
        (lambda: Readout("speed", "m/s", [1.0], bound=np.nan), "bound of readout 'speed'"),
        (lambda: Readout("speed", "m/s", [1.0], side="above"), "side of readout 'speed': 'above'"),
        (lambda: CableLine("rope", (0, -2), np.zeros((2, 3)), 0.1), "frame of cable 'rope' is -2"),
        (lambda: CableLine("rope", (0, -1), np.zeros((2, 3)), 0.1, label=""), "label of cable 'rope' is ''"),
        (lambda: CableLine("rope", (0, -1), np.zeros((2, 3)), 0.1, color="red"), "color of cable 'rope'"),
        (lambda: CableLine("rope", (0,), np.zeros((2, 3)), 0.1), "frames of cable 'rope' are"),  # type: ignore[arg-type]
        (lambda: CableLine("rope", (0, 1), np.zeros((1, 3)), 0.1), r"points of cable 'rope': shape is \(1, 3\)"),
        (lambda: CableLine("rope", (0, 1), np.full((2, 3), np.nan), 0.1), "points of cable 'rope': entry"),
        (lambda: CableLine("rope", (0, 1), np.zeros((2, 3)), 0.0), "radius of cable 'rope' is 0.0 m"),
        (lambda: Mark("", 0), "label of a mark is ''"),
        (lambda: Mark("foot", -3), "frame of mark 'foot' is -3"),
        (lambda: Mark("foot", 0, (0, 0)), "point of mark 'foot'"),
        (lambda: Mark("foot", 0, color="red"), "color of mark 'foot' is 'red'"),
        (lambda: Phase("", 0.0, 1.0), "name of a phase is ''"),
        (lambda: Phase("swing", 1.0, 1.0), "phase 'swing' lasts from 1.0 s to 1.0 s; it must end after it begins"),
        (lambda: Phase("swing", 0.0, np.inf), "begin and end of 'swing'"),
        (lambda: Phase("swing", 0.0, 1.0, ["foot"]), "marks of phase 'swing' hold 'foot'"),  # type: ignore[list-item]
        (lambda: check_phases([Phase("a", 0, 1), Phase("b", 0.5, 2)], 0, 2), "'b' begins at 0.5 s, before 'a' ended"),
        (lambda: check_phases([Phase("a", 2, 3)], 0, 2), "'a' lasts from 2.0 s to 3.0 s, the motion from 0 s to 2 s"),
        (lambda: check_phases([Phase("a", -1, 0)], 0, 2), "they must have time in common"),
        (lambda: check_phases(["a"], 0, 2), "phases hold 'a'; each must be a Phase"),  # type: ignore[list-item]
        (lambda: increasing_times([0.0, 0.0]), "instant 1 is 0.0 s, after 0.0 s"),
        (lambda: increasing_times([0.0, 1.0, 0.5]), "instant 2 is 0.5 s, after 1.0 s"),
        (lambda: increasing_times([]), r"times: shape is \(0,\)"),
        (lambda: increasing_times([[0.0]]), "times: shape"),
    ],
)
def test_faulty_content_is_refused_by_name(make: Any, words: str) -> None:
    with pytest.raises(po.DefinitionError, match=words):
        make()


def test_arrays_are_copied_in_and_read_only() -> None:
    points, values = np.zeros((2, 3)), np.array([1.0, 2.0])
    line, readout = PathLine("way", points), Readout("speed", "m/s", values, bound=1)
    points[0, 0] = values[0] = 9.0
    assert line.points[0, 0] == 0.0
    assert readout.values[0] == 1.0
    assert readout.bound == 1.0
    for array in (line.points, readout.values, increasing_times([0.0, 1.0])):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_phases_may_leave_time_between_them() -> None:
    phases = [Phase("a", 0, 1), Phase("b", 1, 1.5), Phase("c", 2, 9)]
    assert check_phases(phases, 0.0, 3.0) == tuple(phases)
    assert check_phases([], 0.0, 3.0) == ()


def test_every_kind_has_a_colour_and_a_label() -> None:
    assert set(KINDS) == set(KIND_COLORS) == set(KIND_LABELS)
    for color in KIND_COLORS.values():
        assert check_color(color, "colour") == color


def test_curves_stay_apart_after_the_colours_repeat() -> None:
    looks = {(series_color(i), str(series_dash(i))) for i in range(21)}
    assert len(looks) == 21
    assert path_color(0) != path_color(1)
