"""RoboBASIC: a program that is played on paper follows the motion within one servo unit."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError, UnknownNameError
from paraopt.io.robobasic import RoboBasic, build_robobasic, robobasic_template
from paraopt.io.robobasic_player import Played, play
from paraopt.io.servos import Servo, ServoController, ServoTable, gipo_servos
from paraopt.robots import gipo

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]

GIPO = gipo_servos()
TWO = ServoTable((Servo("hip", 7), Servo("knee", 0, direction=-1, zero=120, gain=50.0, lower=40)))


def waves(seed: int, duration: float, amplitude: float, n: int) -> Curve:
    """Make smooth angles that start and end anywhere, of some whole number of waves."""
    rng = np.random.default_rng(seed)
    phase, turns = rng.uniform(0, 2 * np.pi, n), rng.integers(0, 4, n)
    return lambda t: np.asarray(amplitude * np.sin(2 * np.pi * turns * t[:, None] / duration + phase))


def played(program: RoboBasic, table: ServoTable, controller: ServoController | None = None) -> Played:
    start = np.full(24, 100.0)
    start[list(table.numbers)] = program.units[0]
    return play(program.text, list(start), controller)


def deviation(
    program: RoboBasic, table: ServoTable, motion: Curve, duration: float, controller: ServoController | None = None
) -> float:
    t = np.linspace(0.0, duration, 7919)  # not on the writer's milliseconds
    run = played(program, table, controller)
    return float(np.max(np.abs(run(program.lead + t)[:, list(table.numbers)] - table.units(motion(t)))))


# --- The same motion within one unit


@pytest.mark.parametrize("groups", [False, True])
@pytest.mark.parametrize(
    ("seed", "duration", "amplitude"), [(0, 4.0, 0.6), (1, 3.0, 0.7), (2, 20.0, 1.2), (3, 0.5, 0.03), (4, 5.0, 0.0)]
)
def test_the_played_program_follows_the_motion(seed: int, duration: float, amplitude: float, groups: bool) -> None:
    motion = waves(seed, duration, amplitude, 17)
    program = build_robobasic(motion, GIPO, duration=duration, names=GIPO.joints, groups=groups)
    found = deviation(program, GIPO, motion, duration)
    assert found <= 1.0 + 1e-3  # one unit; and what happens within a millisecond
    assert found == pytest.approx(program.deviation, abs=0.02)
    run = played(program, GIPO)
    assert run.duration == pytest.approx(program.lead + duration, abs=1e-3)
    used = sorted(GIPO.numbers)
    unused = [n for n in range(24) if n not in used]
    assert np.all(run.units[:, unused] == 100.0)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.3, 3.0), st.floats(0.6, 3.0))
def test_any_smooth_motion_is_followed_or_refused(seed: int, duration: float, tolerance: float) -> None:
    motion = waves(seed, duration, 0.6, 2)
    rates = np.abs(np.diff(TWO.units(motion(np.linspace(0, duration, 2001))), axis=0)) / (duration / 2000)
    try:
        program = build_robobasic(motion, TWO, duration=duration, names=["hip", "knee"], tolerance=tolerance)
    except InfeasibleError:
        program = None
    if program is None:  # speeds near the largest, or a tolerance that rounding nearly uses up
        assert np.max(rates) > 200.0 or tolerance < 1.0
    else:
        assert deviation(program, TWO, motion, duration) <= tolerance + 1e-3


def test_a_gait_is_written_in_few_moves() -> None:
    # 20 s at 50 places in a second would be 1000 moves
    program = build_robobasic(waves(5, 20.0, 0.4, 17), GIPO, duration=20.0, names=GIPO.joints)
    assert len(program.speeds) < 250
    assert np.min(np.diff(program.times)) >= 0.02 - 1e-9
    assert np.max(np.diff(program.times)) <= 1.0 + 1e-9


def test_a_wider_tolerance_needs_fewer_moves() -> None:
    motion = waves(6, 4.0, 0.6, 17)
    fine, coarse = (build_robobasic(motion, GIPO, duration=4.0, names=GIPO.joints, tolerance=t) for t in (1.0, 3.0))
    assert len(coarse.speeds) < 0.8 * len(fine.speeds)
    assert coarse.deviation <= 3.0


def test_a_pause_stays_a_pause() -> None:
    def motion(t: Array) -> Array:
        return np.column_stack([0.5 * np.clip(t - 2, 0, 1) ** 2 * (3 - 2 * np.clip(t - 2, 0, 1)), 0 * t])

    program = build_robobasic(motion, TWO, duration=5.0, names=["hip", "knee"])
    assert deviation(program, TWO, motion, 5.0) <= 1.0
    assert np.ptp(played(program, TWO)(program.lead + np.linspace(3.1, 5, 50))[:, 7]) == 0.0


def test_the_controllers_speed_is_a_parameter() -> None:
    slow = ServoController(rate=12.0, fastest=10, step=0.05)
    motion = waves(7, 6.0, 0.4, 2)
    program = build_robobasic(motion, TWO, duration=6.0, names=["hip", "knee"], controller=slow)
    assert deviation(program, TWO, motion, 6.0, controller=slow) <= 1.0 + 1e-3
    # another controller plays it otherwise: the timing is not decoration
    assert deviation(program, TWO, motion, 6.0, controller=ServoController(rate=3.0)) > 3.0


def test_a_corrupted_program_is_caught() -> None:
    motion = waves(8, 3.0, 0.5, 2)
    program = build_robobasic(motion, TWO, duration=3.0, names=["hip", "knee"])
    lines = program.text.splitlines()
    at = [i for i, line in enumerate(lines) if line.startswith("MOVE")][len(program.speeds) // 2]
    number = re.search(r"\d+(?=[^\d]*$)", lines[at])
    assert number is not None
    lines[at] = lines[at][: number.start()] + str(int(number.group()) + 3) + lines[at][number.end() :]
    start = np.full(24, 100.0)
    start[list(TWO.numbers)] = program.units[0]
    t = np.linspace(0, 3, 3001)
    run = play("\n".join(lines), list(start))
    assert np.max(np.abs(run(program.lead + t)[:, list(TWO.numbers)] - TWO.units(motion(t)))) > 1.5


# --- The text


def test_the_text_line_by_line() -> None:
    program = build_robobasic(
        lambda t: np.column_stack([0.1 * t, -0.2 * t]),
        TWO,
        duration=0.5,
        names=["hip", "knee"],
        title="a {step}",
        settle=0.5,
    )
    lines = program.text.splitlines()
    assert lines[:20] == [
        "' a _step_", "' servo 0: knee", "' servo 7: hip", "PTP SETON", "PTP ALLON",
        *(f"DIR G6{group}, 0, 0, 0, 0, 0, 0" for group in "ABCD"),
        "GETMOTORSET G24, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0", "MOTOR G24",
        "SPEED 3", "MOVE G24, 120, , , , , , , 100, , , , , , , , , , , , , , , ,", "WAIT", "DELAY 500",
        f"' 0.500 s in {len(program.speeds)} moves", f"SPEED {program.speeds[0]:.0f}",
        f"MOVE G24, {program.units[1, 1]:.0f}, , , , , , , {program.units[1, 0]:.0f}, , , , , , , , , , , , , , , ,",
        "WAIT", f"DELAY {program.delays[0]:.0f}",
    ]  # fmt: skip
    assert lines[-2:] == ["finished:", "GOTO finished"]
    np.testing.assert_array_equal(program.units[-1], [103, 125])  # 0.05 rad forward, 0.1 rad of the turned knee


def test_the_template_reads_the_program_back() -> None:
    program = build_robobasic(waves(9, 2.0, 0.5, 17), GIPO, duration=2.0, names=GIPO.joints, groups=True)
    values, fields = robobasic_template(GIPO, groups=True).parse(program.text)
    np.testing.assert_array_equal(values[:, 0], program.speeds)
    np.testing.assert_array_equal(values[:, 1:-1], program.units[1:])
    np.testing.assert_array_equal(values[:, -1], program.delays)
    assert [fields[f"start {n}"] for n in GIPO.numbers] == [str(int(u)) for u in program.units[0]]


def test_only_groups_that_are_used_are_told() -> None:
    program = build_robobasic(waves(10, 1.0, 0.2, 2), TWO, duration=1.0, names=["hip", "knee"], groups=True)
    assert set(re.findall(r"^MOVE (\w+)", program.text, re.MULTILINE)) == {"G6A", "G6B"}


def test_joints_that_no_servo_moves_are_left_out() -> None:
    motion = waves(11, 1.0, 0.2, 3)
    program = build_robobasic(motion, TWO, duration=1.0, names=["knee", "trunk", "hip"])
    t = np.linspace(0, 1, 501)
    units = played(program, TWO)(program.lead + t)[:, [7, 0]]
    assert np.max(np.abs(units - TWO.units(motion(t)[:, [2, 0]]))) <= 1.0
    with pytest.raises(UnknownNameError, match=r"unknown joint in the motion 'hip'; valid names: 'knee', 'trunk'"):
        build_robobasic(motion, TWO, duration=1.0, names=["knee", "trunk"])


def test_a_trajectory_of_gipo_knows_its_joints() -> None:
    robot = gipo()

    class Nod:
        """The legs at home, while neck and tail move."""

        def __init__(self) -> None:
            self.robot, self.duration = robot, 1.5

        def __call__(self, t: Array) -> Array:
            values = np.tile([robot.home.get(name, 0.0) for name in robot.mechanism.names], (len(t), 1))
            for name, size in (("neck 1", 0.3), ("tail", -0.6)):
                values[:, robot.mechanism.index(name)] = size * np.sin(np.pi * t / 1.5)
            return np.asarray(values)

    program = build_robobasic(Nod(), GIPO)
    run = played(program, GIPO)
    top = run(program.lead + 0.75)
    assert abs(top[GIPO.of("neck 1").number] - (100 + np.degrees(0.3))) <= 1.0
    assert abs(top[GIPO.of("tail").number] - (100 - np.degrees(0.6))) <= 1.0
    # thighs lean apart at home: seen in units, front and rear, and mirrored left and right
    leaning = {leg: round(top[GIPO.of(f"{leg} hip").number]) for leg in ("left rear", "right rear", "left front")}
    assert leaning == {"left rear": 123, "right rear": 77, "left front": 77}
    with pytest.raises(DefinitionError, match="says neither how long it lasts nor what it moves"):
        build_robobasic(lambda t: np.zeros((len(t), 17)), GIPO)


def test_a_program_is_written_whole(tmp_path: Path) -> None:
    program = build_robobasic(waves(12, 1.0, 0.2, 2), TWO, duration=1.0, names=["hip", "knee"])
    path = program.write(tmp_path / "step.bas")
    assert path.read_text() == program.text
    assert [p.name for p in tmp_path.iterdir()] == ["step.bas"]


# --- Limits


@pytest.mark.parametrize(("angle", "units", "bound"), [(1.6, 192, 190), (-1.6, 8, 10)])
def test_positions_beyond_the_range_are_refused(angle: float, units: int, bound: int) -> None:
    def motion(t: Array) -> Array:
        return np.column_stack([angle * t, 0 * t])

    with pytest.raises(
        InfeasibleError, match=rf"position of 'servo 7 \(hip\)' is {units} .*its bound is {bound}"
    ) as caught:
        build_robobasic(motion, TWO, duration=1.0, names=["hip", "knee"])
    assert caught.value.evidence["time"] == pytest.approx(1.0, abs=2e-3)
    build_robobasic(lambda t: motion(t) * 0.98, TWO, duration=1.0, names=["hip", "knee"])  # 190.0 and 10.0 round inside


def test_a_servos_own_range_is_held() -> None:
    with pytest.raises(InfeasibleError, match=r"position of 'servo 0 \(knee\)' is 38 units .*its bound is 40"):
        build_robobasic(lambda t: np.column_stack([0 * t, 1.64 * t]), TWO, duration=1.0, names=["hip", "knee"])


def test_a_servo_that_is_too_slow_is_named() -> None:
    with pytest.raises(
        InfeasibleError, match=r"servo 7 \(hip\) turns at 3\d\d units/s at t = .* SPEED 15 is 300"
    ) as caught:
        build_robobasic(lambda t: np.column_stack([np.sin(6 * t), 0 * t]), TWO, duration=1.0, names=["hip", "knee"])
    assert caught.value.evidence["joint"] == "hip"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"duration": 0.0}, "the motion lasts 0.0 s"),
        ({"duration": float("nan")}, "the motion lasts nan s"),
        ({"tolerance": 0.5}, "tolerance is 0.5 units; rounding alone takes 0.5"),
        ({"approach": 16}, "approach is 16; it must be a SPEED, 1 to 15"),
        ({"settle": -1.0}, "settle is -1.0 s"),
        ({"longest": 0.001}, "longest 0.001 s"),
        ({"names": ["hip", "knee", "toe"]}, r"the motion gives shape \(1001, 2\) for 1001 times"),
    ],
)
def test_faulty_options(options: dict[str, object], words: str) -> None:
    given = {"motion": waves(0, 1.0, 0.1, 2), "duration": 1.0, "table": TWO, "names": ["hip", "knee"], **options}
    with pytest.raises(DefinitionError, match=words):
        build_robobasic(**given)  # type: ignore[arg-type]


# --- The tables


def test_gipos_table_names_gipos_servos() -> None:
    mechanism = gipo().mechanism
    idle = {"neck 1", "neck 2", "head", "jaw", "tail"}
    assert set(GIPO.joints) == set(mechanism.active) | idle
    assert idle <= set(mechanism.names)
    # what the joints may do fits what the servos may be told: 90 degrees to either side
    for variable in mechanism.variables:
        if variable.name in GIPO.joints:
            ends = np.sort(GIPO.of(variable.name).column().scale * np.array(variable.range) + 100)
            np.testing.assert_allclose(ends, [10, 190])


def test_a_mirrored_pose_is_told_in_mirrored_units() -> None:
    # the same hip angle on both sides turns servos that face each other in opposite senses
    for leg in ("rear", "front"):
        left, right = GIPO.of(f"left {leg} hip"), GIPO.of(f"right {leg} hip")
        assert left.direction == -right.direction
        assert GIPO.of(f"left {leg} abduction").direction == GIPO.of(f"right {leg} abduction").direction


@given(st.lists(st.floats(-2, 2), min_size=17, max_size=17))
def test_units_and_angles_are_inverse(angles: list[float]) -> None:
    np.testing.assert_allclose(GIPO.angles(GIPO.units(angles)), angles, atol=1e-12)


def test_zeros_are_calibrated() -> None:
    table = gipo_servos([*range(92, 109)])
    np.testing.assert_array_equal(table.units(np.zeros(17)), range(92, 109))
    with pytest.raises(DefinitionError, match="3 zeros are given for GIPO's 17 servos"):
        gipo_servos([100, 100, 100])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"number": 24}, "servo of joint 'a' has number 24"),
        ({"direction": 0}, "direction 0"),
        ({"gain": 0.0}, "gain of 0.0 units/rad"),
        ({"lower": 5}, "from 5 to 190 units; it must be a range in 10 to 190"),
        ({"zero": 9.0}, "zero at 9.0 units, outside 10 to 190"),
    ],
)
def test_faulty_servos(options: dict[str, object], words: str) -> None:
    with pytest.raises(DefinitionError, match=words):
        Servo(**{"joint": "a", "number": 0, **options})  # type: ignore[arg-type]


def test_a_machine_without_head_and_tail_has_the_servos_of_its_legs() -> None:
    names = gipo(head_and_tail=False).mechanism.names
    table = GIPO.only(names)
    assert len(table.servos) == 12
    assert set(table.joints) <= set(names)
    with pytest.raises(DefinitionError, match="is empty"):
        GIPO.only(["wing"])


def test_faulty_tables() -> None:
    with pytest.raises(DefinitionError, match="number 3 stands twice"):
        ServoTable((Servo("a", 3), Servo("b", 3)))
    with pytest.raises(DefinitionError, match="is empty"):
        ServoTable(())
    with pytest.raises(UnknownNameError, match=r"joint of the table of servos 'hop' \(did you mean 'hip'"):
        TWO.of("hop")
    with pytest.raises(DefinitionError, match="rate of a servo controller is 0"):
        ServoController(rate=0)


# --- The player, on programs in the style of public ones


def test_servos_arrive_together() -> None:
    run = play("PTP ALLON\nSPEED 5\nMOVE G6A, 110, 150, , 90\nMOVE G6D, 100, 120\nWAIT\nDELAY 200\n")
    # 50 units at 5 * 20 units/s
    assert run.duration == pytest.approx(0.7)
    np.testing.assert_allclose(run(0.25)[[0, 1, 2, 3, 18, 19]], [105, 125, 100, 95, 100, 110])
    np.testing.assert_array_equal(run(0.6)[[0, 1, 3]], [110, 150, 90])
    assert run.moves == 2


def test_delays_while_servos_move() -> None:
    run = play("SPEED 1\nMOVE G6A, 120\nDELAY 400\nDELAY 800\nMOVE G6A, 110\nWAIT\n")
    np.testing.assert_allclose(run([0.5, 1.0, 1.1, 1.2, 1.45, 1.7])[:, 0], [110, 120, 120, 120, 115, 110])
    assert run.duration == pytest.approx(1.7)


def test_highspeed_and_comments_and_case() -> None:
    text = "  speed 2 ' slowly\n\nHIGHSPEED SETON\r\nmove g24,  130,,,,,,\n'MOVE G24, 10\nWAIT\n"
    text += "HIGHSPEED SETOFF\nMOVE24 100\n"
    run = play(text)
    assert run.duration == pytest.approx(30 / 120 + 30 / 40)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("MOVE G6A, 191", "a position is 191; it must be in 10 to 190"),
        ("MOVE G6A, 9", "a position is 9"),
        ("MOVE G6A, A", "a position is 'A'; a whole number belongs there"),
        ("MOVE G6A, 100.5", "a position is '100.5'"),
        ("MOVE G6A, 1, 2, 3, 4, 5, 6, 7", "7 positions for the 6 servos"),
        ("MOVE G6E, 100", "'G6E' is no group; groups are G6A, G6B, G6C, G6D, G24"),
        ("MOVE", "'' is no group"),
        ("SPEED 16", "SPEED is 16; it must be in 1 to 15"),
        ("SPEED", "SPEED is ''"),
        ("DELAY -1", "DELAY is '-1'"),
        ("HIGHSPEED ON", "it is not understood"),
        ("GOTO somewhere", "it is not understood"),
        ("FOR I = 1 TO 3", "it is not understood"),
        ("PTP SETOFF", "it is not understood"),
        ("DIR G6A, 1, 0, 0, 0, 0, 0", "a servo that DIR turns round is not played"),
        ("MOVE G6A, 150\nDELAY 10\nMOVE G6B, 150", "servos are still moving; a WAIT must stand before it"),
        ("MOVE G6A, 150\nMOVE G6A, 160", "servo 0 is told twice at once"),
    ],
)
def test_lines_that_are_not_played(line: str, words: str) -> None:
    with pytest.raises(DefinitionError, match=words) as caught:
        play(f"' first\nSPEED 5\n{line}\nWAIT\n")
    assert re.match(r"line [345]: ", str(caught.value))


def test_faulty_starts() -> None:
    with pytest.raises(DefinitionError, match=r"start has shape \(2,\); it must be 24 finite numbers"):
        play("", [100, 100])


WORDS = [
    "MOVE", "G6A", "G24", "MOVE24", ",", "100", "10", "191", "-1", "SPEED", "5", "DELAY", "WAIT", "HIGHSPEED SETON",
    "PTP", "DIR", "'", "\n", "\n", "\n", " ", "x:", "GOTO x", "9999999", "\0", "é",
]  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(st.lists(st.sampled_from(WORDS), max_size=30).map(" ".join) | st.text(max_size=60))
def test_any_text_is_played_or_refused(text: str) -> None:
    with contextlib.suppress(DefinitionError):  # anything else that is raised fails
        run = play(text)
        assert np.all(np.diff(run.times) >= 0.0)
        assert np.all((run.units >= 10) & (run.units <= 190))
