"""What a cable robot's winches are told: columns with its limits, and two dialects of files."""

from __future__ import annotations

from collections.abc import Sequence

from paraopt.errors import DefinitionError
from paraopt.io.template import Column, Template
from paraopt.modes.cable import CableRobot


def winch_columns(
    robot: CableRobot, *, angles: bool = False, scale: float = 1.0, digits: int | None = None, unit: str | None = None
) -> tuple[Column, ...]:
    """Make the columns of a cable robot's winches, with its limits.

    Args:
        robot: The cable robot. Its lengths run from exit to attachment.
        angles: Whether the winches are told angles of their drums [rad], or lengths [m].
        scale: Factor to the controller's unit, such as 1e3 for millimetres or 180/pi for degrees.
        digits: Decimals, see `Column`.
        unit: Name of the controller's unit; m or rad when the scale is 1.

    Returns:
        One column for each cable, by its name.

    Raises:
        DefinitionError: Angles are asked of a robot without drums, or a cable runs over a pulley: the wheel takes up a
            length of cable that changes with the pose, which no factor of the free length can give.
    """
    for name, pulley in zip(robot.cables, robot.pulleys or (), strict=False):
        if pulley is not None:
            raise DefinitionError(
                f"cable {name!r} of {robot.name!r} runs over a pulley of {pulley.radius:g} m; make columns for a "
                "motion of the lengths that the winches pay out"
            )
    if angles and robot.drums is None:
        raise DefinitionError(f"{robot.name!r} has no drums; give them, or write lengths")
    if unit is None:
        unit = ("rad" if angles else "m") if scale == 1.0 else ""
    columns = []
    for i, name in enumerate(robot.cables):
        factor, shift = scale, 0.0
        if angles:
            drum = robot.drums[i]
            factor = scale / drum.length_per_radian
            shift = -factor * drum.zero_length
        ends = sorted(factor * length + shift for length in robot.lengths)
        rate, bend = (
            float("inf") if limits is None else abs(factor) * float(limits[i])
            for limits in (robot.velocity, robot.acceleration)
        )
        columns.append(
            Column(
                name,
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
