"""Text templates of controller files: what writes the commands also reads them back.

A template is plain text with placeholders in braces, `{{` and `}}` being braces themselves: a header, one block for
each command, a footer. Placeholders of the command name columns of numbers; those of header and footer name fields of
text. Nothing but a name may stand in a placeholder: how a number is written belongs to its column.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name

Array = NDArray[np.float64]
Quantity = Literal["value", "velocity", "acceleration", "time", "index"]
QUANTITIES: tuple[Quantity, ...] = ("value", "velocity", "acceleration", "time", "index")

_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_PIECES = re.compile(r"\{\{|\}\}|\{([^{}\n]*)\}|[{}]|[^{}]+")
_OF_NUMBERS = set("0123456789.eE+-")


@dataclass(frozen=True)
class Column:
    """Describe one number of a command: where it comes from, its unit, how it is written, what it may be.

    What is written is `scale * quantity + offset`, rounded to `digits`. All bounds are on what is written, in its unit.

    Attributes:
        name: Name of the placeholder.
        variable: Variable of the motion; the name when None. Not used by time and index.
        quantity: What of it: its value, velocity or acceleration; or the time of the command [s]; or its index from 0.
        scale: Factor: unit and sign.
        offset: What is added afterwards, in the column's unit.
        digits: Decimals; None writes the shortest text that reads back to the same number.
        unit: Name of the unit, for messages and headers.
        lower: Least number that may be written.
        upper: Largest number that may be written.
        velocity: Largest change between commands [unit/s].
        acceleration: Largest change of that change [unit/s^2].

    Raises:
        DefinitionError: A name is empty or has a brace, the scale is zero, digits are not in 0 to 15, a bound is below
            zero or not a number.
    """

    name: str
    variable: str | None = None
    quantity: Quantity = "value"
    scale: float = 1.0
    offset: float = 0.0
    digits: int | None = None
    unit: str = ""
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    acceleration: float = np.inf

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name or set(self.name) & set("{}\r\n"):
            raise DefinitionError(f"name of a column is {self.name!r}; it must be text without braces and line ends")
        what = f"column {self.name!r}"
        if self.quantity not in QUANTITIES:
            raise unknown_name(f"quantity of {what}", str(self.quantity), QUANTITIES)
        if not (np.isfinite(self.scale) and self.scale != 0.0 and np.isfinite(self.offset)):
            raise DefinitionError(
                f"{what} has scale {self.scale} and offset {self.offset}; both must be finite and the scale not 0"
            )
        if self.digits is not None and not (type(self.digits) is int and 0 <= self.digits <= 15):
            raise DefinitionError(
                f"digits of {what} are {self.digits!r}; they must be a whole number in 0 to 15 or None"
            )
        if not self.lower <= self.upper:
            raise DefinitionError(f"{what} has bounds [{self.lower}, {self.upper}]; the lower one must not be above")
        for key in ("velocity", "acceleration"):
            if not getattr(self, key) >= 0.0:
                raise DefinitionError(f"largest {key} of {what} is {getattr(self, key)}; it must not be below 0")

    @property
    def source(self) -> str:
        """Give the name of the variable."""
        return self.name if self.variable is None else self.variable

    @property
    def resolution(self) -> float:
        """Give the step between numbers that can be written, 0 where all digits are."""
        return 0.0 if self.digits is None else 10.0**-self.digits

    def write(self, value: float) -> str:
        """Write a number of the column's unit."""
        if self.digits is None:
            return repr(float(value) + 0.0)  # -0.0 + 0.0 is 0.0: no sign without a value
        text = f"{value:.{self.digits}f}"
        return text.removeprefix("-") if not text.strip("-0.") else text


@dataclass(frozen=True)
class Template:
    r"""Describe the text of a controller file.

    Fields that are filled by themselves, where header or footer name them: `count` (commands), `period` and `duration`
    [s], times `period_scale`.

    Attributes:
        name: Name of the dialect, for messages.
        columns: The numbers of a command.
        command: Text of a command, its line end included; it names each column once.
        header: Text before the commands.
        footer: Text after the commands.
        period_scale: Factor for period and duration; 1e3 for milliseconds.

    Raises:
        DefinitionError: A brace is not closed, a column is missing, stands twice, or is not told from its neighbour by
            a separator.
        UnknownNameError: The command names a column that does not exist.
    """

    name: str
    columns: tuple[Column, ...]
    command: str
    header: str = ""
    footer: str = ""
    period_scale: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", tuple(self.columns))
        names = [c.name for c in self.columns]
        if not names or len(set(names)) != len(names):
            raise DefinitionError(
                f"columns of template {self.name!r} are {names}; it needs at least one, each name once"
            )
        if not (np.isfinite(self.period_scale) and self.period_scale > 0.0):
            raise DefinitionError(f"period_scale of template {self.name!r} is {self.period_scale}; it must be above 0")
        named = [name for _, name in self._parts["command"] if name is not None]
        for name in named:
            if name not in names:
                raise unknown_name(f"column in the command of template {self.name!r}", name, names)
        if sorted(named) != sorted(names):
            raise DefinitionError(
                f"the command of template {self.name!r} names the columns {named}; it must name each of {names} once"
            )
        for (_, left), (between, right) in zip(self._parts["command"], self._parts["command"][1:], strict=False):
            if left is not None and right is not None and (not between or between[0] in _OF_NUMBERS):
                raise DefinitionError(
                    f"in the command of template {self.name!r} {between!r} stands between {left!r} and {right!r}; a "
                    "separator must begin with a character that no number has"
                )

    @cached_property
    def _parts(self) -> Mapping[str, list[tuple[str, str | None]]]:
        return {key: self._split(key) for key in ("header", "command", "footer")}

    def _split(self, key: str) -> list[tuple[str, str | None]]:
        text = getattr(self, key)
        if not isinstance(text, str) or "\r" in text:
            raise DefinitionError(f"{key} of template {self.name!r} must be text whose lines end in \\n")
        parts: list[tuple[str, str | None]] = []
        literal = ""
        for found in _PIECES.finditer(text):
            piece, name = found.group(), found.group(1)
            if piece in ("{", "}") or name == "":
                line = text.count("\n", 0, found.start()) + 1
                raise DefinitionError(
                    f"{key} of template {self.name!r}, line {line}: {piece!r} is no placeholder; a brace is doubled"
                )
            if name is None:
                literal += piece[0] if piece in ("{{", "}}") else piece
            else:
                parts.append((literal, name))
                literal = ""
        return [*parts, (literal, None)] if literal else parts

    @property
    def fields(self) -> tuple[str, ...]:
        """Name the fields of header and footer, each once."""
        named = [name for key in ("header", "footer") for _, name in self._parts[key] if name is not None]
        return tuple(dict.fromkeys(named))

    # --- Writing

    def render(self, rows: Sequence[Sequence[float]] | Array, fields: Mapping[str, object]) -> str:
        """Write a file.

        Args:
            rows: Numbers of the commands in the units of the columns, shape (n, n_columns).
            fields: Texts of header and footer.

        Returns:
            The text; it reads back to the same fields and to the numbers as they are written.

        Raises:
            DefinitionError: A number is not finite, a field is missing, or a field's text cannot be told from the text
                around it.
        """
        table = np.asarray(rows, dtype=float)
        if table.ndim != 2 or table.shape[1] != len(self.columns):
            raise DefinitionError(
                f"commands have shape {table.shape}; template {self.name!r} has {len(self.columns)} columns"
            )
        if not np.all(np.isfinite(table)):
            row, column = np.argwhere(~np.isfinite(table))[0]
            raise DefinitionError(f"command {row}: {self.columns[column].name!r} is {table[row, column]}; not finite")
        given = {key: str(value) for key, value in {"count": len(table), **fields}.items()}
        for name in self.fields:
            if name not in given:
                raise unknown_name(f"field of template {self.name!r}: not given", name, given)
            if "\n" in given[name] or "\r" in given[name]:
                raise DefinitionError(f"field {name!r} of template {self.name!r} has a line end: {given[name]!r}")
        order = {c.name: i for i, c in enumerate(self.columns)}
        pieces = [self._fill("header", given)]
        parts = [(text, None if name is None else order[name]) for text, name in self._parts["command"]]
        for row in table.tolist():
            pieces += [t if i is None else t + self.columns[i].write(row[i]) for t, i in parts]
        text = "".join([*pieces, self._fill("footer", given)])
        try:
            _, back = self.parse(text)
        except DefinitionError as error:
            raise DefinitionError(f"template {self.name!r} does not read what it writes: {error}") from error
        for name, value in back.items():
            if value != given[name]:
                raise DefinitionError(
                    f"field {name!r} of template {self.name!r} is {given[name]!r} and would read back as {value!r}"
                )
        return text

    def _fill(self, key: str, given: Mapping[str, str]) -> str:
        return "".join(text + ("" if name is None else given[name]) for text, name in self._parts[key])

    # --- Reading

    def parse(self, text: str, what: str = "text") -> tuple[Array, dict[str, str]]:
        """Read a file.

        Args:
            text: The text; its lines may end in CR LF.
            what: How an error calls it.

        Returns:
            The numbers as written, shape (n, n_columns), and the fields by name.

        Raises:
            DefinitionError: The text is not of this template, or `count` is not the number of its commands; the
                message names the line.
        """
        text = text.replace("\r\n", "\n")
        head = self._patterns["header"].match(text)
        if head is None:
            raise DefinitionError(f"{what}, line 1: the header is not that of template {self.name!r}")
        place, rows = head.end(), []
        while (found := self._patterns["command"].match(text, place)) and found.end() > place:
            rows.append([float(entry) for entry in found.groups()])
            place = found.end()
        foot = self._patterns["footer"].fullmatch(text, place)
        if foot is None:
            line = text.count("\n", 0, place) + 1
            shown = text[place:].split("\n", 1)[0]
            raise DefinitionError(
                f"{what}, line {line}: {shown!r} is neither a command nor the footer of template {self.name!r}"
            )
        fields: dict[str, str] = {}
        for key, match in (("header", head), ("footer", foot)):
            for name, value in zip(self._groups[key], match.groups(), strict=True):
                if fields.setdefault(name, value) != value:
                    raise DefinitionError(f"{what}: field {name!r} is {fields[name]!r} and {value!r}")
        if "count" in fields and fields["count"] != str(len(rows)):
            raise DefinitionError(f"{what} announces {fields['count']} commands and has {len(rows)}")
        order = [name for _, name in self._parts["command"] if name is not None]
        table = np.array(rows, dtype=float).reshape(len(rows), len(order))
        if not np.all(np.isfinite(table)):  # 1e999 is a number by its letters
            raise DefinitionError(f"{what}: command {int(np.argwhere(~np.isfinite(table))[0, 0])} overflows")
        return table[:, [order.index(c.name) for c in self.columns]], fields

    @cached_property
    def _patterns(self) -> Mapping[str, re.Pattern[str]]:
        patterns = {}
        for key, parts in self._parts.items():
            entry = rf"({_NUMBER})" if key == "command" else r"([^\n]*?)"
            patterns[key] = re.compile("".join(re.escape(t) + ("" if n is None else entry) for t, n in parts))
        return patterns

    @cached_property
    def _groups(self) -> Mapping[str, list[str]]:
        return {key: [n for _, n in self._parts[key] if n is not None] for key in ("header", "footer")}
