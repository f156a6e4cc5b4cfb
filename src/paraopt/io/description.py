"""Machines as files: TOML that a person can read and write, and that gives the same machine back to the last bit.

The layout is told by example in `docs/file-format.md`; the types and their keys stand in `paraopt.io.schema`.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import Array, InlineTable, Item, Table

from paraopt.errors import DefinitionError
from paraopt.io.codecs import ANGLES, LENGTHS, Place, Record, Text, Units, shorten
from paraopt.io.files import write_atomically
from paraopt.io.schema import MECHANISM, OBSTACLES, ROBOT
from paraopt.mechanism import Mechanism
from paraopt.robot import Robot
from paraopt.shapes import Shape

FORMAT = 1
_HEAD = ("format", "units")
# strings and comments, so that what is left are keys, numbers and punctuation
_WORDS = re.compile(r"""\"{3}(?:\\.|[^\\])*?\"{3}|'{3}.*?'{3}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|#[^\n]*""", re.DOTALL)
# twenty keys joined by dots: no description is that deep, and the time to parse them grows with their square
_TOO_DEEP = re.compile(r"(?<![\w-])(?:[\w-]+[ \t]*\.[ \t]*){20}")


def load_mechanism(path: str | os.PathLike[str]) -> Mechanism:
    """Read a mechanism from a TOML file; what the file says of a robot beyond its mechanism is not looked at.

    Args:
        path: The file.

    Returns:
        The mechanism, equal to the last bit to the one that was saved.

    Raises:
        DefinitionError: The file cannot be read or describes no mechanism; the message gives the file, the path of the
            key, the value and what it must be.
    """
    data, place = _read_file(path, [*MECHANISM.keys, *ROBOT.keys])
    return _build_mechanism(data, place)


def load_robot(path: str | os.PathLike[str]) -> Robot:
    """Read a robot from a TOML file.

    Args:
        path: The file.

    Returns:
        The robot; its numbers are those that were saved, to the last bit.

    Raises:
        DefinitionError: The file cannot be read or describes no robot; the message gives the file, the path of the
            key, the value and what it must be.
    """
    data, place = _read_file(path, [*MECHANISM.keys, *ROBOT.keys])
    mechanism = _build_mechanism(data, place)
    place = replace(place, kinds={v.name: v.kind for v in mechanism.variables})
    robot: Robot = ROBOT.read(_part(data, ROBOT), place, mechanism=mechanism)
    return robot


def load_obstacles(path: str | os.PathLike[str]) -> tuple[Shape, ...]:
    """Read the obstacles of a scene from a TOML file.

    Args:
        path: The file; its key `obstacles` is an array of shapes, placed in the world.

    Returns:
        The shapes.

    Raises:
        DefinitionError: The file cannot be read or a shape is faulty.
    """
    data, place = _read_file(path, ["obstacles"])
    if "obstacles" not in data:
        raise place.error("lacks 'obstacles'; a scene needs it, and it may be empty")
    obstacles: tuple[Shape, ...] = OBSTACLES.read(data["obstacles"], place / "obstacles")
    return obstacles


def save_mechanism(mechanism: Mechanism, path: str | os.PathLike[str]) -> Path:
    """Write a mechanism as TOML, in metres and radians; the file appears whole or not at all.

    Args:
        mechanism: The mechanism.
        path: Target; missing folders are made.

    Returns:
        The target.

    Raises:
        DefinitionError: A type is not one of the format, or a text holds what no file can.
        OSError: The file cannot be written.
    """
    if not isinstance(mechanism, Mechanism):
        raise DefinitionError(f"{shorten(mechanism)} is given; save_mechanism writes a Mechanism, save_robot a Robot")
    return write_atomically(path, _to_toml(MECHANISM.write(mechanism)))


def save_robot(robot: Robot, path: str | os.PathLike[str]) -> Path:
    """Write a robot as TOML, in metres and radians; the file appears whole or not at all.

    Args:
        robot: The robot.
        path: Target; missing folders are made.

    Returns:
        The target.

    Raises:
        DefinitionError: A type is not one of the format, or a text holds what no file can.
        OSError: The file cannot be written.
    """
    if not isinstance(robot, Robot):
        raise DefinitionError(f"{shorten(robot)} is given; save_robot writes a Robot, save_mechanism a Mechanism")
    data = MECHANISM.write(robot.mechanism) | ROBOT.write(robot, mechanism=robot.mechanism)
    return write_atomically(path, _to_toml(data))


def read_description(text: str, name: str) -> tuple[dict[str, Any], Place]:
    """Parse TOML and its head: the version of the format and the units.

    Args:
        text: The TOML.
        name: How errors call it.

    Returns:
        The keys but for those of the head, and the place from which they are read.

    Raises:
        DefinitionError: The text is no TOML, or its head is faulty.
    """
    place = Place(name)
    try:
        if _TOO_DEEP.search(_WORDS.sub("word", text)):
            raise RecursionError
        data = tomllib.loads(text)
    except RecursionError as error:
        raise place.error("is nested too deeply") from error
    except ValueError as error:  # syntax, with line and column; or an integer of thousands of digits
        raise place.error(f"is not valid TOML: {error}") from error
    stated = data.get("format")
    if isinstance(stated, bool) or stated != FORMAT:
        told = "is missing" if stated is None else f"is {stated!r:.60}"
        raise place.error(f"format {told}; this version reads 'format = {FORMAT}'")
    units = Record(Units, {"length": Text(tuple(LENGTHS)), "angle": Text(ANGLES)})
    place = replace(place, units=units.read(data.get("units", {}), place / "units"))
    return {k: v for k, v in data.items() if k not in _HEAD}, place


def _read_file(
    path: str | os.PathLike[str], keys: list[str], largest: int = 10_000_000
) -> tuple[dict[str, Any], Place]:
    """Read a regular file of at most `largest` bytes, whose keys are among some."""
    file = Path(path)
    place = Place(os.fspath(file))
    try:
        # pipes and devices may never end
        if not file.is_file():
            raise place.error("is a folder or a device, not a file" if file.exists() else "there is no such file")
        if (size := file.stat().st_size) > largest:
            raise place.error(f"holds {size} bytes; a description holds {largest} at most")
        text = file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise place.error(f"is not UTF-8: byte {error.start} is {error.object[error.start]:#04x}") from error
    except (OSError, ValueError) as error:  # ValueError: a null in the name
        raise _unreadable(place, error) from error
    data, place = read_description(text, place.file)
    for key in data:
        if key not in keys:
            raise place.unknown("key", key, [*_HEAD, *keys])
    return data, place


def _unreadable(place: Place, error: Exception) -> DefinitionError:
    return error if isinstance(error, DefinitionError) else place.error(f"cannot be read: {error}")


def _part(data: Mapping[str, Any], record: Record) -> dict[str, Any]:
    return {k: v for k, v in data.items() if k in record.keys}


def _build_mechanism(data: Mapping[str, Any], place: Place) -> Mechanism:
    mechanism: Mechanism = MECHANISM.read(_part(data, MECHANISM), place)
    return mechanism


# --- Writing: short values first, then a section for each table and for each member of an array of tables


def _to_toml(data: Mapping[str, Any]) -> bytes:
    document = tomlkit.document()
    document["format"] = FORMAT
    document["units"] = _inline({"length": "m", "angle": "rad"})
    document.add(tomlkit.nl())
    sections = {k: v for k, v in data.items() if isinstance(v, Mapping) or _is_tables(v)}
    for key, value in data.items():
        if key not in sections:
            document[key] = _inline(value)
    for key, value in sections.items():
        document[key] = _section(value)
    try:
        return document.as_string().encode()
    except UnicodeEncodeError as error:
        raise DefinitionError(f"{error.object!r:.60} has a lone surrogate, which no text file can hold") from error


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _section(value: Any) -> Item:
    if _is_tables(value):
        tables = tomlkit.aot()
        for entry in value:
            tables.append(_table(entry))
        return tables
    return _table(value)


def _table(value: Mapping[str, Any]) -> Table:
    table = tomlkit.table()
    for key, entry in sorted(value.items(), key=lambda item: _is_tables(item[1])):  # else they would join a section
        table[key] = _section(entry) if _is_tables(entry) else _inline(entry)
    return table


def _inline(value: Any) -> Any:
    if isinstance(value, Mapping):
        table: InlineTable = tomlkit.inline_table()
        for key, entry in value.items():
            table[key] = _inline(entry)
        return table
    if isinstance(value, list):
        array: Array = tomlkit.array()
        array.extend(_inline(v) for v in value)
        return array
    return value
