"""What a cable robot's winches are told: columns with its limits, and two dialects of files."""

from __future__ import annotations

import math
from collections.abc import Sequence

from paraopt.errors import DefinitionError
from paraopt.io.template import Column, Template
from paraopt.modes.cable import CableRobot, name_paid_out


def winch_columns(
    robot: CableRobot, *, angles: bool = False, scale: float = 1.0, digits: int | None = None, unit: str | None = None
) -> tuple[Column, ...]:
    """Make the columns of a cable robot's winches, with its limits.

    Where a cable runs over a pulley, the wheel takes up a length that changes with the pose. Its column stands for the
    length that the winch pays out, which is a variable of a `WinchMotion` and none of the trajectory: a program made of
    the trajectory itself is refused.

    Args:
        robot: The cable robot.
        angles: Whether the winches are told angles of their drums [rad], or lengths [m].
        scale: Factor to the controller's unit, such as 1e3 for millimetres or 180/pi for degrees.
        digits: Decimals, see `Column`.
        unit: Name of the controller's unit; m or rad when the scale is 1.

    Returns:
        One column for each cable, by its name.

    Raises:
        DefinitionError: Angles are asked of a robot without drums.
    """
    if angles and robot.drums is None:
        raise DefinitionError(f"{robot.name!r} has no drums; give them, or write lengths")
    if unit is None:
        unit = ("rad" if angles else "m") if scale == 1.0 else ""
    columns = []
    pulleys = robot.pulleys or (None,) * robot.n_cables
    for i, (name, variable, pulley) in enumerate(zip(robot.cables, name_paid_out(robot), pulleys, strict=True)):
        factor, shift = scale, 0.0
        if angles:
            drum = robot.drums[i]
            factor = scale / drum.length_per_radian
            shift = -factor * drum.zero_length
        # what lies on a wheel is less than one turn of it
        extra = 0.0 if pulley is None else 2.0 * math.pi * pulley.radius
        ends = sorted(factor * length + shift for length in (robot.lengths[0], robot.lengths[1] + extra))
        rate, bend = (
            float("inf") if limits is None else abs(factor) * float(limits[i])
            for limits in (robot.velocity, robot.acceleration)
        )
        columns.append(
            Column(
                name,
                variable=variable,
                scale=factor,
                offset=shift,
                digits=digits,
                unit=unit,
                lower=ends[0],
                upper=ends[1],
                velocity=rate,
                acceleration=bend,
            )
        )
    return tuple(columns)


def csv_template(columns: Sequence[Column]) -> Template:
    """Write commands as CSV: a header of names and units, the time [s], then one number for each column."""
    time = Column("t", quantity="time", unit="s")
    heads = [_escaped(f"{c.name} [{c.unit}]" if c.unit else c.name) for c in (time, *columns)]
    return Template(
        "csv", (time, *columns), ",".join(f"{{{c.name}}}" for c in (time, *columns)) + "\n", ",".join(heads) + "\n"
    )


def cbu_template(columns: Sequence[Column]) -> Template:
    """Write commands as a `.cbu` program.

    Only the ending is that of the source's winch controller, whose maker's syntax is not public: **the syntax is
    ours**, an example of what a template can say. It names robot, winches, units, period and count, then one line for
    each period.

    Source: Lahouar, IV.2.
    """
    names = " ".join(_escaped(c.name.replace(" ", "_")) for c in columns)
    units = " ".join(_escaped(c.unit or "1") for c in columns)
    return Template(
        "cbu",
        (Column("line", quantity="index", digits=0), *columns),
        "L{line}: " + " ".join(f"{{{c.name}}}" for c in columns) + "\n",
        "; winch program of {robot}; the syntax is paraopt's own, not the maker's\n"
        f"; winches {names}\n; units {units}\n"
        "PERIOD {period}\nCOUNT {count}\nBEGIN\n",
        "END\n",
    )


def _escaped(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")
