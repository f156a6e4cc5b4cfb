"""Trajectories as CSV: the header tells role and unit, and the numbers come back exactly."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import paraopt as po
from motions import plan_of, turning_problem
from paraopt.io import Table, read_trajectory, write_trajectory
from paraopt.planning import TimeLaw
from support import raf_robot


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_trajectory(plan_of("cylinder").trajectory, tmp_path_factory.mktemp("csv") / "trajectory.csv", 0.01)


@pytest.fixture(scope="module")
def table(written: Path) -> Table:
    return read_trajectory(written)


# --- The header


def test_the_first_column_is_time(table: Table) -> None:
    assert table.columns[0] == "t [s]"
    assert table["t [s]"][0] == 0.0
    assert table["t [s]"][-1] == plan_of("cylinder").trajectory.duration
    np.testing.assert_allclose(np.diff(table["t [s]"])[:-1], 0.01, rtol=0, atol=1e-14)


def test_columns_come_in_the_order_active_operational_passive(table: Table) -> None:
    roles = [column.split()[0] for column in table.columns[1:]]
    order = list(dict.fromkeys(roles))
    assert order == ["active", "operational", "passive"]
    assert roles == sorted(roles, key=order.index)
    mechanism = raf_robot().mechanism
    counts = {"active": mechanism.active, "operational": mechanism.operational, "passive": mechanism.passive}
    for role, names in counts.items():
        own = [column for column in table.columns if column.startswith(role)]
        # in the order of the mechanism, three columns each
        assert [column.removeprefix(role + " ").rsplit(" [", 1)[0] for column in own[::3]] == list(names)
        assert len(own) == 3 * len(names)


def test_every_column_has_its_unit(table: Table) -> None:
    by_name = {v.name: v for v in raf_robot().mechanism.variables}
    for column in table.columns[1:]:
        match = re.fullmatch(r"(active|operational|passive) (.+?)( velocity| acceleration)? \[(\S+)\]", column)
        assert match is not None, column
        variable = by_name[match[2]]
        per = {None: "", " velocity": "/s", " acceleration": "/s^2"}[match[3]]
        assert match[4] == variable.unit + per
        assert match[1] == variable.role


def test_a_turning_platform_is_written_in_radians(tmp_path: Path) -> None:
    problem = turning_problem(False)
    start = problem.start_configuration.X
    from scipy.interpolate import BSpline

    ends = np.array([start[-3:], problem.goal_values()])
    path = po.Path.along(problem.robot, problem.independent, BSpline(np.array([0.0, 0.0, 1.0, 1.0]), ends, 1), start)
    law = TimeLaw(np.array([0.0, 1.0]), np.array([[-2.0], [3.0], [0.0], [0.0]]))
    table = read_trajectory(write_trajectory(po.Trajectory(path, law), tmp_path / "t.csv", 0.1))
    assert "operational theta velocity [rad/s]" in table.columns
    assert "active rho1 acceleration [m/s^2]" in table.columns
    # unwrapped: a controller sees no jump at pi
    assert np.max(np.abs(np.diff(table["operational theta [rad]"]))) < 0.1


# --- The numbers


def test_numbers_come_back_exactly(table: Table) -> None:
    trajectory = plan_of("cylinder").trajectory
    state, mechanism = trajectory.sample(0.01), raf_robot().mechanism
    for variable in mechanism.variables:
        i, stem, unit = mechanism.index(variable.name), f"{variable.role} {variable.name}", variable.unit
        np.testing.assert_array_equal(table[f"{stem} [{unit}]"], state.X[:, i])
        np.testing.assert_array_equal(table[f"{stem} velocity [{unit}/s]"], state.velocity[:, i])
        np.testing.assert_array_equal(table[f"{stem} acceleration [{unit}/s^2]"], state.acceleration[:, i])
    assert table.values.shape == (len(state.t), 1 + 3 * len(mechanism.names))


def test_writing_twice_gives_the_same_bytes(written: Path, tmp_path: Path) -> None:
    again = write_trajectory(plan_of("cylinder").trajectory, tmp_path / "again.csv", 0.01)
    assert again.read_bytes() == written.read_bytes()


def test_the_file_is_plain(written: Path) -> None:
    content = written.read_bytes()
    assert b"\r" not in content
    assert content.endswith(b"\n")
    content.decode("ascii")
    widths = {line.count(b",") for line in content.splitlines()}
    assert widths == {3 * 32}


def test_an_unknown_column_is_named(table: Table) -> None:
    with pytest.raises(
        po.UnknownNameError, match=r"unknown column 'active q1 \[mm\]' \(did you mean 'active q1 \[m\]'"
    ):
        table["active q1 [mm]"]


@pytest.mark.parametrize("period", [0.0, -0.1, float("nan"), float("inf")])
def test_a_faulty_period_writes_nothing(period: float, tmp_path: Path) -> None:
    with pytest.raises(po.DefinitionError, match="sampling period"):
        write_trajectory(plan_of("free").trajectory, tmp_path / "t.csv", period)
    assert list(tmp_path.iterdir()) == []


# --- Malformed files


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "has 0 lines"),
        ("t [s],active q1 [m]\n", "has 1 lines"),
        ("t [s],active q1 [m]\n0.0\n", "line 2 .* has 1 entries; the header has 2"),
        ("t [s],active q1 [m]\n0.0,1.0\n0.1,1.0,2.0\n", "line 3 .* has 3 entries"),
        ("t [s],active q1 [m]\n0.0,fast\n", "line 2 .*: could not convert string to float: 'fast'"),
        ("t [s],active q1 [m]\n0.0,\n", "line 2 "),
        ("t [s],active q1 [m]\n0.0,1.0\n0.1,nan\n", "line 3 .* not finite"),
        ("t [s],active q1 [m]\n0.0,inf\n0.1,1.0\n", "line 2 .* not finite"),
        ("t [s],active q1 [m]\n0.0,1.0\n\n", "line 3 .* has 0 entries"),
    ],
)
def test_malformed_files_are_refused_with_the_line(content: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content)
    with pytest.raises(po.DefinitionError, match=words) as caught:
        read_trajectory(path)
    assert "t.csv" in str(caught.value)


def test_a_file_cut_off_in_the_middle_of_a_row_is_refused(written: Path, tmp_path: Path) -> None:
    content = written.read_bytes()
    (tmp_path / "cut.csv").write_bytes(content[: len(content) // 2])
    with pytest.raises(po.DefinitionError):
        read_trajectory(tmp_path / "cut.csv")


def test_a_missing_file_is_told_by_the_system(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nothing\.csv"):
        read_trajectory(tmp_path / "nothing.csv")
