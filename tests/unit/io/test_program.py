"""Controller programs: what is written reads back, limits are held, templates say what they cannot say."""

from __future__ import annotations

import contextlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

import paraopt as po
from cable_robots import planar
from motions import plan_of
from paraopt.errors import DefinitionError, InfeasibleError, UnknownNameError
from paraopt.io.program import Program, build_program, check_commands, read_program, write_program
from paraopt.io.template import Column, Template
from paraopt.io.winches import cbu_template, csv_template, winch_columns
from paraopt.modes.cable import CableRobot, Drum, Pulley, WinchLimits, WinchMotion, cable_functions

Array = NDArray[np.float64]


class Rise:
    """Two lengths from rest to rest in a second: 1 -> 1.5 m, 2 -> 1.7 m."""

    duration = 1.0

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        s = np.asarray(t, dtype=float)
        law = [10 * s**3 - 15 * s**4 + 6 * s**5, 30 * s**2 * (1 - s) ** 2, 60 * s - 180 * s**2 + 120 * s**3][order]
        start = np.array([1.0, 2.0]) if order == 0 else np.zeros(2)
        return np.asarray(start + law[..., None] * [0.5, -0.3])


ROOT = Path(__file__).parents[3]
NAMES = ("q1", "q2")
PEAK = 0.5 * 30 / 16  # m/s of q1, at half time
DRUMS = (Drum(0.05, zero_length=1.0), Drum(0.04, sign=-1, pitch=0.002))


def winched(**changes: Any) -> CableRobot:
    robot = CableRobot(
        name="two", planar=True, exits=[(0, 0), (4, 0)], attachments=[(0, 0), (0, 0)], mass=1.0, t_max=100.0,
        home={"x": 2, "y": -1}, drums=DRUMS, lengths=(0.5, 5.0), velocity=1.0, acceleration=3.0,
    )  # fmt: skip
    return replace(robot, **changes)


def build(template: Template, period: float = 0.01) -> Program:
    return build_program(Rise(), template, period, names=NAMES, fields={"robot": "two"})


# --- What is written


def test_a_cbu_program_line_by_line() -> None:
    columns = (Column("q1", scale=1e3, digits=1, unit="mm"), Column("right", "q2", scale=-1e3, offset=2000, digits=0))
    program = build_program(Rise(), cbu_template(columns), 0.25, names=NAMES, fields={"robot": "two"})
    assert program.text.splitlines() == [
        "; winch program of two; the syntax is paraopt's own, not the maker's",
        "; winches q1 right",
        "; units mm 1",
        "PERIOD 0.25",
        "COUNT 5",
        "BEGIN",
        "L0: 1000.0 0",
        "L1: 1051.8 31",
        "L2: 1250.0 150",
        "L3: 1448.2 269",
        "L4: 1500.0 300",
        "END",
    ]


def test_csv_has_the_time_and_the_units_in_its_header() -> None:
    text = build(csv_template([Column("q1", unit="m", digits=3), Column("q2", unit="m", digits=3)]), 0.5).text
    assert text == "t [s],q1 [m],q2 [m]\n0.0,1.000,2.000\n0.5,1.250,1.850\n1.0,1.500,1.700\n"


def test_the_last_command_is_the_end_of_the_motion() -> None:
    program = build(csv_template([Column("q1"), Column("q2")]), 0.3)
    np.testing.assert_allclose(program.times, [0, 0.3, 0.6, 0.9, 1.2])
    assert program["q1"][-1] == 1.5
    with pytest.raises(UnknownNameError, match="unknown column 'q3'"):
        program["q3"]


def test_angles_of_drums() -> None:
    columns = winch_columns(winched(), angles=True, scale=180 / np.pi, digits=4, unit="deg")
    program = build(cbu_template(columns))
    lengths = Rise()(np.minimum(program.times, 1.0))
    for i, (name, drum) in enumerate(zip(NAMES, DRUMS, strict=True)):
        np.testing.assert_allclose(program[name], np.degrees(drum.angles(lengths[:, i])), atol=0.5001e-4)
        # and back to the motion, to half a step of the last digit
        step = np.radians(1e-4) * abs(drum.length_per_radian)
        np.testing.assert_allclose(program.variables()[name], lengths[:, i], rtol=0, atol=0.5001 * step)


def test_velocities_are_written_where_they_are_asked() -> None:
    columns = (Column("q1"), Column("v1", "q1", "velocity", scale=1e3), Column("a1", "q1", "acceleration"))
    program = build(Template("own", columns, "{q1} {v1} {a1}\n"))
    expected = np.column_stack([Rise()(program.times, order)[:, 0] for order in (0, 1, 2)]) * [1, 1e3, 1]
    np.testing.assert_array_equal(program.values, expected)
    assert set(program.variables()) == {"q1"}


def test_a_trajectory_names_its_variables(tmp_path: Path) -> None:
    trajectory = plan_of("free").trajectory
    columns = [Column(name, scale=1e3, digits=4, unit="mm") for name in trajectory.robot.mechanism.active]
    path = write_program(trajectory, csv_template(columns), tmp_path / "raf.csv", 0.01)
    back = read_program(path, csv_template(columns), 0.01)
    state = trajectory(np.minimum(back.times, trajectory.duration))
    for name in trajectory.robot.mechanism.active:
        i = trajectory.robot.mechanism.index(name)
        np.testing.assert_allclose(back.variables()[name], state[:, i], rtol=0, atol=0.5001e-7)


# --- What reads back

SEPARATORS = st.text(st.sampled_from(" ;,:|XYZ={}'()%\t"), min_size=1, max_size=4)


@st.composite
def templates(draw: st.DrawFn) -> Template:
    """Draw words round columns: any names, any separators, any digits."""
    names = draw(
        st.lists(st.text("abcXY _-.0123456789[]", min_size=1, max_size=6), min_size=1, max_size=4, unique=True)
    )
    columns = [Column(n, digits=draw(st.none() | st.integers(0, 6))) for n in names]

    def literal(text: str) -> str:
        return text.replace("{", "{{").replace("}", "}}")

    order = draw(st.permutations(names))
    words = "".join(literal(draw(SEPARATORS)) + f"{{{n}}}" for n in order) + literal(draw(SEPARATORS)) + "\n"
    return Template(
        "drawn", tuple(columns), words, "HEAD {note}\n" + literal(draw(SEPARATORS)) + "{count}\n", "FOOT {note}\n"
    )


@settings(max_examples=150, deadline=None)
@given(templates(), st.data())
def test_numbers_round_trip(template: Template, data: st.DataObject) -> None:
    numbers = st.floats(-1e6, 1e6)
    width = len(template.columns)
    rows = data.draw(st.lists(st.lists(numbers, min_size=width, max_size=width), min_size=1, max_size=5))
    note = data.draw(st.text(st.characters(codec="utf-8", exclude_characters="\r\n"), max_size=8))
    text = template.render(rows, {"note": note})
    values, fields = template.parse(text.replace("\n", "\r\n"))
    assert fields == {"note": note, "count": str(len(rows))}
    for column, written, read in zip(template.columns, np.array(rows).T, values.T, strict=True):
        if column.digits is None:
            np.testing.assert_array_equal(read, written)
        else:  # rounded once, to the nearest: half a step, and the spacing of floats of this size
            np.testing.assert_allclose(read, written, rtol=1e-15, atol=0.5 * column.resolution * (1 + 1e-9))
    # what was read is written as the same text
    assert template.render(values, fields) == text


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_a_damaged_file_is_refused_or_reads_as_a_program(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    template = cbu_template(winch_columns(winched(), digits=3))
    text = build(template, 0.25).text
    start = data.draw(st.integers(0, len(text)))
    stop = data.draw(st.integers(start, len(text)))
    new = data.draw(st.text(st.sampled_from("0123456789.-+eE: \nL{}\0;"), max_size=6))
    path = tmp_path_factory.mktemp("fuzz") / "p.cbu"
    path.write_text(text[:start] + new + text[stop:])
    with contextlib.suppress(DefinitionError):  # anything else that is raised fails
        assert len(read_program(path, template).values) == 5  # COUNT and line numbers let no line vanish


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=100))
def test_any_bytes_are_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("bytes") / "p.cbu"
    path.write_bytes(content)
    with pytest.raises(DefinitionError, match=r"p\.cbu"):
        read_program(path, cbu_template([Column("q1")]))


def test_a_file_without_its_last_lines_is_refused(tmp_path: Path) -> None:
    template = cbu_template(winch_columns(winched(), digits=3))
    text = build(template).text
    for cut, words in (
        (text.replace("L7:", "L8:"), "command 7 has line = 8 where 7 belongs"),
        (text.replace(text.splitlines()[20] + "\n", ""), "announces 101 commands and has 100"),
        (text[: len(text) // 2], "is neither a command nor the footer"),
        (text.replace("PERIOD 0.01", "PERIOD soon"), "the period 'soon' is not a number"),
        (text.replace("PERIOD 0.01", "PERIOD -1"), "period of a program is -1.0 s"),
    ):
        (tmp_path / "p.cbu").write_text(cut)
        with pytest.raises(DefinitionError, match=words):
            read_program(tmp_path / "p.cbu", template)


def test_the_period_comes_from_the_file_or_from_the_reader(tmp_path: Path) -> None:
    ms = replace(cbu_template([Column("q1"), Column("q2")]), period_scale=1e3)
    path = build(ms, 0.007).write(tmp_path / "p.cbu")
    assert "PERIOD 7.0\n" in path.read_text()
    assert read_program(path, ms).period == 0.007
    with pytest.raises(DefinitionError, match=r"has a period of 0.007 s; 0.01 s are expected"):
        read_program(path, ms, 0.01)
    bare = Template("bare", (Column("q1"),), "{q1}\n")
    build(bare).write(tmp_path / "b.txt")
    with pytest.raises(DefinitionError, match="does not name its period; give it"):
        read_program(tmp_path / "b.txt", bare)
    assert read_program(tmp_path / "b.txt", bare, 0.01).duration == 1.0


def blocks() -> list[str]:
    text = (ROOT / "docs" / "controller-files.md").read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("number", range(3))
def test_the_page_runs(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    assert len(blocks()) == 3
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks()[number], f"controller-files.md, block {number}", "exec"), {})
    if number == 1:
        assert capsys.readouterr().out == (
            "; two, 5 lines\nG1 A2000.0 B2000.0\nG1 A2041.4 B1958.6\nG1 A2200.0 B1800.0\nG1 A2358.6 B1641.4\n"
            "G1 A2400.0 B1600.0\nM2\n\n"
        )


# --- Limits


@pytest.mark.parametrize(
    ("limits", "kind", "time", "value"),
    [
        ({"upper": 1.45}, "position", 1.0, 1.5),
        ({"lower": 1.01}, "position", 0.0, 1.0),
        ({"velocity": 0.9}, "velocity", 0.5, PEAK),
        ({"acceleration": 2.5}, "acceleration", 0.79, -2.887),
    ],
)
def test_a_program_beyond_a_limit_is_refused(
    limits: dict[str, float], kind: str, time: float, value: float, tmp_path: Path
) -> None:
    target = tmp_path / "p.cbu"
    target.write_text("old")
    template = cbu_template([Column("q1", unit="m", **limits), Column("q2")])  # type: ignore[arg-type]
    with pytest.raises(
        InfeasibleError, match=rf"{kind} of 'q1' is .* at t = .* s; its bound is .*, exceeded by"
    ) as caught:
        write_program(Rise(), template, target, 0.01, names=NAMES, fields={"robot": "two"})
    evidence = caught.value.evidence
    assert (evidence["column"], evidence["kind"]) == ("q1", kind)
    assert evidence["time"] == pytest.approx(time, abs=0.021)
    assert evidence["value"] == pytest.approx(value, rel=2e-3)
    assert [p.name for p in tmp_path.iterdir()] == ["p.cbu"]
    assert target.read_text() == "old"


def test_limits_are_held_at_their_very_value() -> None:
    # the largest difference of the samples is a touch below the peak of the motion
    for column in (Column("q1", upper=1.5, lower=1.0, velocity=PEAK), Column("q1", digits=3, velocity=PEAK)):
        build(Template("own", (column,), "{q1}\n"))
    with pytest.raises(InfeasibleError):
        build(Template("own", (Column("q1", velocity=PEAK * 0.999),), "{q1}\n"))


def test_rounding_is_not_taken_for_a_rate() -> None:
    # half a millimetre of rounding looks like 10 m/s^2 at 10 ms, which the motion (2.9 m/s^2) does not have
    program = build(Template("own", (Column("q1", digits=3, acceleration=3.0),), "{q1}\n"))
    assert np.max(np.abs(np.diff(program["q1"], 2))) / 0.01**2 > 3.0


def test_a_program_starts_and_ends_at_rest() -> None:
    ramp = np.linspace(0.0, 1.0, 11)[:, None]  # 1 m/s from the first command on
    with pytest.raises(InfeasibleError, match=r"acceleration of 'q' is 10 /s\^2 at t = 0 s") as caught:
        check_commands([Column("q", acceleration=5.0)], ramp, 0.1)
    assert caught.value.evidence["time"] == 0.0
    check_commands([Column("q", acceleration=10.0)], ramp, 0.1)


def test_the_worst_of_several_is_told() -> None:
    columns = [Column("q1", velocity=0.9), Column("q2", velocity=0.1)]
    with pytest.raises(InfeasibleError, match=r"velocity of 'q2' is -0\.56"):
        build(csv_template(columns))


def test_winch_columns_carry_the_robots_limits() -> None:
    column = winch_columns(winched(), angles=True)[1]
    rate = abs(DRUMS[1].length_per_radian)
    assert column.unit == "rad"
    assert column.scale == pytest.approx(-1 / rate)
    np.testing.assert_allclose([column.velocity, column.acceleration], [1 / rate, 3 / rate])
    np.testing.assert_allclose([column.lower, column.upper], [-5 / rate, -0.5 / rate])
    free = winch_columns(winched(velocity=None, acceleration=None))[0]
    assert (free.velocity, free.acceleration, free.unit) == (np.inf, np.inf, "m")
    with pytest.raises(InfeasibleError, match=r"velocity of 'q1' is 0\.94"):
        build(cbu_template(winch_columns(winched(velocity=0.9), digits=4)))


def test_what_winches_cannot_be_told() -> None:
    with pytest.raises(DefinitionError, match="'two' has no drums"):
        winch_columns(winched(drums=None), angles=True)
    # over a pulley the free length is not what the winch pays out
    wheels = winch_columns(winched(pulleys=(None, Pulley(0.02, (0, 1, 0)))))
    assert [c.source for c in wheels] == ["q1", "paid-out q2"]
    assert wheels[1].upper == pytest.approx(5.0 + 2 * np.pi * 0.02)
    with pytest.raises(UnknownNameError, match="paid-out q2"):
        build(csv_template(wheels))


def test_a_program_of_winches_behind_pulleys() -> None:
    """The angles of the drums turn by all that is paid out: the free part, and what lies on the wheel."""
    robot = planar(
        pulleys=[Pulley(0.03, (1, 0, 0))] * 4, drums=[Drum(0.05, zero_length=0.2)] * 4, velocity=1.0, acceleration=5.0,
        gravity=(0, -9.81), t_min=1.0,
    )  # fmt: skip
    start = {"x": 0.4, "y": 0.45, "theta": 0.0}
    goal = {"x": 0.6, "y": 0.55, "theta": 0.1}
    trajectory = po.plan(po.Problem(po.Scene(robot.robot), start, goal, dynamics=(WinchLimits(robot),))).trajectory
    motion = WinchMotion(robot, trajectory)
    assert motion.names == tuple(f"paid-out q{i}" for i in range(1, 5))
    template = cbu_template(winch_columns(robot, angles=True, digits=9))
    program = build_program(motion, template, 0.01, fields={"robot": robot.name})
    times = np.minimum(program.times, trajectory.duration)
    poses = trajectory(times)[:, trajectory.robot.mechanism.indices(robot.coordinates)]
    wanted = cable_functions(robot).winch_angles(poses)
    assert program.values[:, 1:] == pytest.approx(wanted, abs=0.51e-9)
    assert np.max(np.abs(wanted - (cable_functions(planar()).lengths(poses) - 0.2) / 0.05)) > 0.1
    h = 1e-5
    inner = times[5:-5]
    assert motion(inner, 1) == pytest.approx((motion(inner + h) - motion(inner - h)) / (2 * h), abs=1e-5)
    assert motion(inner, 2) == pytest.approx((motion(inner + h, 1) - motion(inner - h, 1)) / (2 * h), abs=0.05)
    assert motion(0.1).shape == (4,)
    with pytest.raises(DefinitionError, match="order"):
        motion(0.1, 3)
    with pytest.raises(UnknownNameError, match="paid-out q1"):
        build_program(trajectory, template, 0.01, fields={"robot": robot.name})
    with pytest.raises(DefinitionError, match="lacks the coordinates"):
        WinchMotion(robot, plan_of("free").trajectory)


# --- What cannot be built


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf"), 1e-9])
def test_faulty_periods(period: float) -> None:
    with pytest.raises(DefinitionError, match="period"):
        build(csv_template([Column("q1")]), period)


def test_faulty_motions() -> None:
    template = csv_template([Column("q1")])
    with pytest.raises(UnknownNameError, match=r"variable of column 'q1' 'q1'.*valid names: 'a', 'b'"):
        build_program(Rise(), template, 0.1, names=("a", "b"))
    with pytest.raises(DefinitionError, match=r"gives shape \(11, 2\) for 11 times, order 0"):
        build_program(Rise(), template, 0.1, names=("q1",))
    with pytest.raises(DefinitionError, match="has no robot that names its variables"):
        build_program(Rise(), template, 0.1)
    endless = Rise()
    endless.duration = float("inf")
    with pytest.raises(DefinitionError, match="lasts inf s"):
        build_program(endless, template, 0.1, names=NAMES)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"command": "{a}{b}\n"}, "'' stands between 'a' and 'b'"),
        ({"command": "{a}.{b}\n"}, r"'\.' stands between 'a' and 'b'"),
        ({"command": "{a} {c}\n"}, "unknown column in the command of template 't' 'c'"),
        ({"command": "{a}\n"}, "must name each of .* once"),
        ({"command": "{a} {b} {a}\n"}, "must name each of .* once"),
        ({"command": "{a} {b:.3f}\n"}, "unknown column in the command of template 't' 'b:.3f'"),
        ({"command": "{a.__class__} {b}\n"}, "unknown column in the command of template 't' 'a.__class__'"),
        ({"command": "{} {b}\n"}, "command of template 't', line 1: '{}' is no placeholder"),
        ({"command": "{a} {b\n"}, "command of template 't', line 1: '{' is no placeholder"),
        ({"command": "{a} {b}\n", "header": "ok\n}"}, "header of template 't', line 2: '}' is no placeholder"),
        ({"command": "{a} {b}\r\n"}, r"lines end in \\n"),
        ({"command": "{a} {b}\n", "period_scale": 0.0}, "period_scale of template 't' is 0.0"),
        ({"command": "{a} {b}\n", "columns": ()}, "it needs at least one"),
        ({"command": "{a} {b}\n", "columns": (Column("a"), Column("a"))}, "it needs at least one, each name once"),
    ],
)
def test_faulty_templates(options: dict[str, object], words: str) -> None:
    with pytest.raises(DefinitionError, match=words):
        Template(**{"name": "t", "columns": (Column("a"), Column("b")), **options})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"name": ""}, "name of a column is ''"),
        ({"name": "a{b"}, "without braces"),
        ({"quantity": "speed"}, "unknown quantity of column 'a' 'speed'"),
        ({"scale": 0.0}, "has scale 0.0"),
        ({"offset": float("nan")}, "offset nan"),
        ({"digits": 16}, "digits of column 'a' are 16"),
        ({"digits": 2.0}, r"digits of column 'a' are 2\.0"),
        ({"lower": 1.0, "upper": 0.0}, r"bounds \[1.0, 0.0\]"),
        ({"velocity": -1.0}, "largest velocity of column 'a' is -1.0"),
    ],
)
def test_faulty_columns(options: dict[str, object], words: str) -> None:
    with pytest.raises(DefinitionError, match=words):
        Column(**{"name": "a", **options})  # type: ignore[arg-type]


def test_fields_that_would_not_read_back_are_refused() -> None:
    template = Template("t", (Column("a"),), "{a}\n", "{x} and {y}\n")
    with pytest.raises(DefinitionError, match="field 'x' of template 't' is 'p and q' and would read back as 'p'"):
        template.render([[1.0]], {"x": "p and q", "y": "r"})
    with pytest.raises(DefinitionError, match="has a line end"):
        template.render([[1.0]], {"x": "p\nq", "y": "r"})
    with pytest.raises(UnknownNameError, match="field of template 't': not given 'y'"):
        template.render([[1.0]], {"x": "p"})
    with pytest.raises(DefinitionError, match="command 1: 'a' is nan; not finite"):
        template.render([[1.0], [float("nan")]], {"x": "p", "y": "r"})
    with pytest.raises(DefinitionError, match="'7' and would read back as ''"):
        Template("t", (Column("a"),), "{a}\n", "{x}").render([[1.0]], {"x": "7"})
    with pytest.raises(DefinitionError, match="does not read what it writes"):
        Template("t", (Column("a"),), "{a}\n", footer="1\n").render([[1.0]], {})


@given(st.floats(allow_nan=False, allow_infinity=False), st.none() | st.integers(0, 15))
def test_a_number_is_written_without_an_empty_sign(value: float, digits: int | None) -> None:
    assume(digits is None or abs(value) < 1e15)
    text = Column("a", digits=digits).write(value)
    assert not (text.startswith("-") and float(text) == 0.0)
    assert float(text) == (value if digits is None else float(f"{value:.{digits}f}"))
