"""Read what a person states about a cable robot: numbers, tables of points, and values for each cable."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError

Array = NDArray[np.float64]


def read_number(value: Any, what: str, unit: str, *, above: float = -np.inf, lowest: float = -np.inf) -> float:
    """Read a finite number above a bound, or not below another.

    Args:
        value: What was given.
        what: How an error calls it.
        unit: Its unit.
        above: Bound that it must exceed.
        lowest: Least value that is allowed.

    Returns:
        The number.

    Raises:
        DefinitionError: It is no finite number, or it is out of bounds.
    """
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} is {value!r}; it must be a number [{unit}]") from error
    if not np.isfinite(number) or abs(number) >= 1e150:  # squares of larger numbers overflow
        raise DefinitionError(f"{what} is {number} {unit}; it must be finite")
    if not number > above:
        raise DefinitionError(f"{what} is {number:g} {unit}; it must be above {above:g} {unit}")
    if number < lowest:
        raise DefinitionError(f"{what} is {number:g} {unit}; it must not be below {lowest:g} {unit}")
    return number


def read_table(values: Any, shape: tuple[int | None, ...], what: str) -> Array:
    """Read a table of finite numbers into a read-only array.

    Args:
        values: What was given.
        shape: Wanted shape; None where any size is allowed.
        what: How an error calls it.

    Returns:
        The array.

    Raises:
        DefinitionError: The shape is another, or an entry is not a finite number.
    """
    try:
        if np.iscomplexobj(values):
            raise TypeError("complex numbers have no place here")
        table = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} are {values!r}; they must be numbers") from error
    wanted = tuple("n" if size is None else str(size) for size in shape)
    if table.ndim != len(shape) or any(w is not None and w != g for w, g in zip(shape, table.shape, strict=True)):
        raise DefinitionError(f"{what} have shape {table.shape}; it must be ({', '.join(wanted)})")
    if not np.all(np.isfinite(table)) or np.any(np.abs(table) >= 1e150):
        raise DefinitionError(f"{what} are {table.tolist()}; every entry must be finite")
    table.flags.writeable = False
    return table


def read_rows(values: Any, count: int, width: int, what: str, columns: str = "", *, alone: bool = False) -> Array:
    """Read one row of finite numbers for all poses, or one row for each.

    Args:
        values: Numbers, shape (width,) or (count, width).
        count: Number of poses.
        width: Numbers in a row.
        what: How an error calls them.
        columns: What the numbers of a row are, for errors.
        alone: Whether one number may stand for all.

    Returns:
        The rows, shape (count, width).

    Raises:
        DefinitionError: The shape is another, or an entry is not a finite number.
    """
    try:
        table = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise DefinitionError(f"{what} are {values!r}; they must be numbers") from error
    if table.shape not in ((width,), (count, width)) and not (alone and table.ndim == 0):
        allowed = f"({width},) or ({count}, {width})" + (", or one number" if alone else "")
        of = f" of {columns}" if columns else ""
        raise DefinitionError(f"{what} have shape {table.shape}; it must be {allowed}{of}")
    if not np.all(np.isfinite(table)):
        raise DefinitionError(f"{what} are {table.tolist()}; every entry must be finite")
    return np.array(np.broadcast_to(table, (count, width)))


def read_for_cables(values: Any, names: tuple[str, ...], what: str, unit: str, **bounds: float) -> Array:
    """Read one number for all cables, or one for each, into a read-only array of shape (n,).

    Args:
        values: A number, or a sequence of as many as there are cables.
        names: Names of the cables.
        what: How an error calls the quantity.
        unit: Its unit.
        bounds: See `read_number`.

    Returns:
        The array.

    Raises:
        DefinitionError: There are more or fewer numbers than cables, or one is out of bounds.
    """
    if np.ndim(values) == 0:
        array = np.full(len(names), read_number(values, what, unit, **bounds))
    else:
        if len(values) != len(names):
            raise DefinitionError(
                f"{what} has {len(values)} values; it must be one number, or one for each of the {len(names)} cables"
            )
        array = np.array(
            [read_number(v, f"{what} of cable {c!r}", unit, **bounds) for v, c in zip(values, names, strict=True)]
        )
    array.flags.writeable = False
    return array
