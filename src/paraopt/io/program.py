"""Controller programs: a motion sampled at a period, one command for each sample, in the words of a template.

Commands stand at the times 0, T, 2T, ... up to the first at or after the end of the motion, which holds the end: a
controller that plays one command each period needs no odd last step. Rates are differences of the commands as they are
written, with what their rounding can add allowed; before the first and after the last command the machine stands.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError, unknown_name
from paraopt.io.files import write_atomically
from paraopt.io.template import Column, Template
from paraopt.planning.trajectory import Motion

Array = NDArray[np.float64]
_ORDERS = {"value": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True, eq=False)
class Program:
    """Hold the commands of a controller file.

    Attributes:
        template: The words.
        values: The numbers as written, in the units of the columns, shape (n, n_columns).
        period: Time between commands [s].
        fields: Further texts of header and footer.
    """

    template: Template
    values: Array
    period: float
    fields: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=float)
        if values.ndim != 2 or values.shape[1] != len(self.template.columns) or not len(values):
            raise DefinitionError(
                f"a program of template {self.template.name!r} has commands of shape {values.shape}; it needs at least "
                f"one command of {len(self.template.columns)} numbers"
            )
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "period", _check_period(self.period))
        object.__setattr__(self, "fields", MappingProxyType({k: str(v) for k, v in self.fields.items()}))

    def __getitem__(self, column: str) -> Array:
        names = [c.name for c in self.template.columns]
        if column not in names:
            raise unknown_name("column", column, names)
        return self.values[:, names.index(column)]

    @property
    def times(self) -> Array:
        """Give the times of the commands [s], shape (n,)."""
        return np.asarray(self.period * np.arange(len(self.values)))

    @property
    def duration(self) -> float:
        """Give the time of the last command [s]."""
        return float(self.times[-1])

    def variables(self) -> dict[str, Array]:
        """Give the values of the variables that the commands stand for [SI], by name, shape (n,) each.

        They are those of the motion to within half a step of the last digit that is written.
        """
        columns = enumerate(self.template.columns)
        return {c.source: (self.values[:, i] - c.offset) / c.scale for i, c in columns if c.quantity == "value"}

    @cached_property
    def text(self) -> str:
        """Give the content of the file."""
        scale = self.template.period_scale
        given = {"period": repr(self.period * scale), "duration": repr(self.duration * scale), **self.fields}
        return self.template.render(self.values, given)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the file, whole or not at all.

        Args:
            path: Target file.

        Returns:
            The target.
        """
        return write_atomically(path, self.text.encode())


def build_program(
    motion: Motion,
    template: Template,
    period: float,
    *,
    fields: Mapping[str, object] | None = None,
    names: Sequence[str] | None = None,
    most_commands: int = 1_000_000,
) -> Program:
    """Turn a motion into the commands of a controller.

    Args:
        motion: The motion: a trajectory, or anything that is called with times [s] and an order.
        template: The words and the columns.
        period: Time between commands [s].
        fields: Texts for the placeholders of header and footer; count, period and duration fill themselves.
        names: What the motion's columns are called; when None its own `names`, or else those of its robot's variables.
        most_commands: Largest number of commands that is meant.

    Returns:
        The program; nothing is written yet.

    Raises:
        DefinitionError: Period, duration or what the motion returns is not usable.
        UnknownNameError: A column names a variable that the motion does not have.
        InfeasibleError: A command exceeds a bound of its column; the message tells which, where and by how much.
    """
    period = _check_period(period)
    duration = float(motion.duration)
    if not (np.isfinite(duration) and duration >= 0.0):
        raise DefinitionError(f"the motion lasts {duration} s; its duration must be finite and not below 0")
    if duration / period > most_commands - 1:
        raise DefinitionError(
            f"{duration:g} s at a period of {period:g} s are more than {most_commands} commands; is "
            "the period in seconds?"
        )
    count = int(np.ceil(duration / period - 1e-9)) + 1
    times = np.minimum(period * np.arange(count), duration)
    if names is None:
        names = _names_of(motion)
    names = list(names)
    samples: dict[int, Array] = {}
    table = np.empty((count, len(template.columns)))
    for i, column in enumerate(template.columns):
        if column.quantity in ("time", "index"):
            numbers = period * np.arange(count) if column.quantity == "time" else np.arange(float(count))
        else:
            order = _ORDERS[column.quantity]
            if order not in samples:
                samples[order] = _sample(motion, times, order, len(names))
            if column.source not in names:
                raise unknown_name(f"variable of column {column.name!r}", column.source, names)
            numbers = samples[order][:, names.index(column.source)]
        exact = column.scale * numbers + column.offset
        table[:, i] = exact if column.digits is None else [float(column.write(v)) for v in exact.tolist()]
    check_commands(template.columns, table, period)
    return Program(template, table, period, {k: str(v) for k, v in (fields or {}).items()})


def write_program(
    motion: Motion,
    template: Template,
    path: str | os.PathLike[str],
    period: float,
    *,
    fields: Mapping[str, object] | None = None,
    names: Sequence[str] | None = None,
) -> Path:
    """Write a motion as a controller file, see `build_program`.

    Args:
        motion: The motion.
        template: The words and the columns.
        path: Target file.
        period: Time between commands [s].
        fields: Texts for the placeholders of header and footer.
        names: What the motion's columns are called.

    Returns:
        The target. It appears whole or not at all; a program that is refused leaves an older file as it is.

    Raises:
        DefinitionError: As in `build_program`.
        InfeasibleError: A command exceeds a bound of its column.
    """
    return build_program(motion, template, period, fields=fields, names=names).write(path)


def read_program(path: str | os.PathLike[str], template: Template, period: float | None = None) -> Program:
    """Read a controller file with the template that wrote it; the numbers come back exactly.

    Args:
        path: The file.
        template: The words and the columns.
        period: Time between commands [s]; where the file names it, it may be left out.

    Returns:
        The program. Bounds are not judged: `check_commands` does.

    Raises:
        DefinitionError: The file is not of this template, has no command, its period is missing or not a number, or
            its times or indices do not count on.
    """
    what = os.fspath(path)
    try:
        text = Path(path).read_bytes().decode()
    except UnicodeDecodeError as error:
        raise DefinitionError(f"{what} is not text: {error}") from error
    values, fields = template.parse(text, what)
    if not len(values):
        raise DefinitionError(f"{what} has no command")
    told = fields.pop("period", None)
    for key in ("count", "duration"):
        fields.pop(key, None)
    if told is not None:
        try:
            read = float(told) / template.period_scale
        except ValueError as error:
            raise DefinitionError(f"{what}: the period {told!r} is not a number") from error
        if period is not None and not np.isclose(read, period, rtol=1e-9, atol=0.0):
            raise DefinitionError(f"{what} has a period of {read:g} s; {period:g} s are expected")
        period = read
    if period is None:
        raise DefinitionError(f"{what} does not name its period; give it")
    for i, column in enumerate(template.columns):
        if column.quantity in ("time", "index"):
            step = period if column.quantity == "time" else 1.0
            expected = column.scale * step * np.arange(len(values)) + column.offset
            gap = np.abs(values[:, i] - expected) - 0.5 * column.resolution - 1e-9 * (1.0 + np.abs(expected))
            if np.any(gap > 0.0):
                row = int(np.argmax(gap > 0.0))
                raise DefinitionError(
                    f"{what}: command {row} has {column.name} = {values[row, i]:g} where {expected[row]:g} belongs; "
                    "are commands missing?"
                )
    return Program(template, values, period, fields)


def check_commands(columns: Sequence[Column], values: Array, period: float) -> None:
    """Refuse commands that exceed a bound of their column.

    Args:
        columns: The columns.
        values: Numbers in their units, shape (n, n_columns).
        period: Time between commands [s].

    Raises:
        InfeasibleError: A bound is exceeded. The message tells the worst place in parts of its bound: the column, the
            kind of bound, the time, the number and by how much; evidence: column, kind, time, value, bound.
    """
    worst: tuple[float, str, Column, str, float, float, float] | None = None
    for i, column in enumerate(columns):
        path = values[:, i]
        still = np.concatenate([path[:1], path, path[-1:]])  # standing before and after
        half = 0.5 * column.resolution
        rate, bend = np.diff(path) / period, np.diff(still, 2) / period**2
        span = max(abs(b) for b in (column.lower, column.upper, 1e-300) if np.isfinite(b))
        tiny = 1e-9  # of the bound: what computing in other units may add
        for kind, sizes, bound, spare in (
            ("position", column.lower - path, column.lower, tiny * span),
            ("position", path - column.upper, column.upper, tiny * span),
            ("velocity", np.abs(rate) - column.velocity, column.velocity, 2 * half / period),
            ("acceleration", np.abs(bend) - column.acceleration, column.acceleration, 4 * half / period**2),
        ):
            if not len(sizes) or not np.isfinite(bound):
                continue
            at = int(np.argmax(sizes))
            excess = float(sizes[at])
            if excess <= spare + tiny * abs(bound):
                continue
            part = excess / max(abs(bound), 1e-12)
            value = float({"position": path, "velocity": rate, "acceleration": bend}[kind][at])
            if worst is None or part > worst[0]:
                worst = (part, kind, column, column.unit, at * period, value, float(bound))
    if worst is None:
        return
    _, kind, column, unit, time, value, bound = worst
    unit += {"position": "", "velocity": "/s", "acceleration": "/s^2"}[kind]
    excess = abs(value - bound) if kind == "position" else abs(value) - bound
    raise InfeasibleError(
        f"{kind} of {column.name!r} is {value:.6g} {unit} at t = {time:.6g} s; its bound is {bound:.6g} {unit}, "
        f"exceeded by {excess:.3g} {unit}; slow the motion or plan with this bound",
        column=column.name, kind=kind, time=time, value=value, bound=bound,
    )  # fmt: skip


def _check_period(period: float) -> float:
    if not (np.isfinite(period) and period > 0.0):
        raise DefinitionError(f"period of a program is {period} s; it must be finite and above 0")
    return float(period)


def _names_of(motion: Motion) -> Sequence[str]:
    named: Sequence[str] | None = getattr(motion, "names", None)
    if named is None:
        robot = getattr(motion, "robot", None)
        if robot is None:
            raise DefinitionError("the motion has no robot that names its variables; give their names")
        named = robot.mechanism.names
    return list(named)


def _sample(motion: Motion, times: Array, order: int, width: int) -> Array:
    values = np.asarray(motion(times, order), dtype=float)
    if values.shape != (len(times), width) or not np.all(np.isfinite(values)):
        raise DefinitionError(
            f"the motion gives shape {values.shape} for {len(times)} times, order {order}; it must be finite, shape "
            f"({len(times)}, {width})"
        )
    return values
