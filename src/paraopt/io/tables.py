"""Trajectories as CSV: one row per instant, one column per quantity, role and unit in the header."""

from __future__ import annotations

import csv
import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.io.files import write_atomically
from paraopt.mechanism import Variable
from paraopt.planning import State, Trajectory
from paraopt.robot import Robot

_ROLES = ("active", "operational", "passive")


@dataclass(frozen=True, eq=False)
class Table:
    """Hold a table of numbers.

    Attributes:
        columns: Header of each column, such as "active q1 velocity [m/s]".
        values: Numbers, shape (n_rows, n_columns).
    """

    columns: tuple[str, ...]
    values: NDArray[np.float64]

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        if column not in self.columns:
            raise unknown_name("column", column, self.columns)
        return self.values[:, self.columns.index(column)]


class _Machine(Protocol):
    """Whatever has a robot."""

    @property
    def robot(self) -> Robot: ...


def tabulate(trajectory: _Machine, state: State) -> Table:
    """Arrange samples of a trajectory: time, then active, operational and passive variables.

    Args:
        trajectory: The trajectory.
        state: Its samples.

    Returns:
        The table: for each variable value, velocity and acceleration.
    """
    mechanism = trajectory.robot.mechanism
    order = [v for role in _ROLES for v in mechanism.variables if v.role == role]
    columns, values = ["t [s]"], [np.asarray(state.t)]
    for variable in order:
        i = mechanism.index(variable.name)
        columns += _headers(variable)
        values += [state.X[:, i], state.velocity[:, i], state.acceleration[:, i]]
    return Table(tuple(columns), np.column_stack(values))


def write_trajectory(trajectory: Trajectory, path: str | os.PathLike[str], period: float = 1e-3) -> Path:
    """Write a trajectory as CSV.

    Args:
        trajectory: The trajectory.
        path: Target file.
        period: Time between rows [s]; the last row is the end of the motion, whatever its distance to the one before.

    Returns:
        The target.

    Raises:
        DefinitionError: The period is not finite and above 0.
    """
    return write_table(tabulate(trajectory, trajectory.sample(period)), path)


def write_table(table: Table, path: str | os.PathLike[str]) -> Path:
    """Write a table as CSV, every number with all its digits.

    Args:
        table: The table.
        path: Target file.

    Returns:
        The target.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([[repr(float(v)) for v in row] for row in table.values])
    return write_atomically(path, stream.getvalue().encode())


def read_trajectory(path: str | os.PathLike[str]) -> Table:
    """Read a CSV file written by `write_trajectory`; the numbers come back exactly.

    Args:
        path: The file.

    Returns:
        The table.

    Raises:
        DefinitionError: The file is empty, a row has the wrong length, or an entry is not a finite number.
    """
    with open(path, newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    if len(rows) < 2:
        raise DefinitionError(f"{path} has {len(rows)} lines; a header and at least one row are needed")
    header = tuple(rows[0])
    values = np.empty((len(rows) - 1, len(header)))
    for i, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise DefinitionError(f"line {i} of {path} has {len(row)} entries; the header has {len(header)}")
        try:
            values[i - 2] = [float(entry) for entry in row]
        except ValueError as error:
            raise DefinitionError(f"line {i} of {path}: {error}") from error
    if not np.all(np.isfinite(values)):
        line = 2 + int(np.argmin(np.all(np.isfinite(values), axis=1)))
        raise DefinitionError(f"line {line} of {path} has an entry that is not finite")
    return Table(header, values)


def _headers(variable: Variable) -> list[str]:
    stem, unit = f"{variable.role} {variable.name}", variable.unit
    return [f"{stem} [{unit}]", f"{stem} velocity [{unit}/s]", f"{stem} acceleration [{unit}/s^2]"]
