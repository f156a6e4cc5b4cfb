"""Read XML of strangers: a plain tree with line numbers, without entities and without files from elsewhere.

A document type may be named and may declare attributes; what could make a small file large, an entity that is declared,
is refused, and no other file is reached for.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Element:
    """Hold an element of a file.

    Attributes:
        tag: Its name.
        attributes: Its attributes.
        children: Elements inside, in their order.
        text: Text inside, without that of its children.
        line: Line on which it opens.
        file: File, for messages.
    """

    tag: str
    attributes: Mapping[str, str]
    children: tuple[Element, ...]
    text: str
    line: int
    file: str

    def __iter__(self) -> Iterator[Element]:
        return iter(self.children)

    def error(self, message: str) -> DefinitionError:
        """Make an error that names file, line and element."""
        return DefinitionError(f"{self.file}, line {self.line}, <{self.tag}>: {message}")

    def all(self, tag: str) -> list[Element]:
        """Give the children of a name."""
        return [child for child in self.children if child.tag == tag]

    def find(self, tag: str) -> Element | None:
        """Give the only child of a name, None where there is none.

        Raises:
            DefinitionError: There are several.
        """
        found = self.all(tag)
        if len(found) > 1:
            raise found[1].error(f"stands twice in <{self.tag}>")
        return found[0] if found else None

    def child(self, tag: str) -> Element:
        """Give the only child of a name.

        Raises:
            DefinitionError: There is none, or there are several.
        """
        found = self.find(tag)
        if found is None:
            raise self.error(f"has no <{tag}>")
        return found

    def attribute(self, name: str) -> str:
        """Give an attribute.

        Raises:
            DefinitionError: It is missing or empty.
        """
        if not self.attributes.get(name):
            raise self.error(f"has no attribute {name}")
        return self.attributes[name]

    def number(self) -> float:
        """Read the text as a finite number."""
        return float(self.vector(1)[0])

    def whole(self) -> int:
        """Read the text as a whole number."""
        value = self.number()
        if value != int(value):
            raise self.error(f"is {self.text.strip()!r}; it must be a whole number")
        return int(value)

    def vector(self, size: int | None = None, attribute: str | None = None) -> Array:
        """Read numbers that spaces or commas part.

        Args:
            size: How many there must be; any number but zero when None.
            attribute: Attribute that holds them; the text when None.

        Returns:
            The numbers.

        Raises:
            DefinitionError: An entry is not a finite number, or their count is another.
        """
        text = self.text if attribute is None else self.attribute(attribute)
        what = "" if attribute is None else f"attribute {attribute} "
        entries = text.replace(",", " ").split()
        try:
            values = np.array([float(entry) for entry in entries])
        except ValueError as error:
            raise self.error(f"{what}is {_short(text)!r}: {error}") from error
        if "_" in text or not np.all(np.abs(values) < 1e150):  # squares of larger numbers overflow
            raise self.error(f"{what}is {_short(text)!r}; it must hold finite numbers")
        if len(values) != size if size is not None else not len(values):
            wanted = "at least one number" if size is None else f"{size} number{'s' if size != 1 else ''}"
            raise self.error(f"{what}is {_short(text)!r}: {len(values)} numbers; it must hold {wanted}")
        return values


class _Open:
    """Collect an element that has not closed yet."""

    def __init__(self, tag: str, attributes: Mapping[str, str], line: int) -> None:
        self.tag, self.attributes, self.line = tag, attributes, line
        self.children: list[Element] = []
        self.text: list[str] = []


def read_xml(path: str | os.PathLike[str], deepest: int = 32) -> Element:
    """Read an XML file.

    Args:
        path: The file.
        deepest: How deep elements may stand in each other.

    Returns:
        Its outermost element.

    Raises:
        DefinitionError: It is not well-formed XML, declares an entity, refers to one, or stands too deep.
        OSError: It cannot be read.
    """
    file, content = os.fspath(path), Path(path).read_bytes()
    parser = expat.ParserCreate()
    stack: list[_Open] = []
    roots: list[Element] = []

    def refuse(message: str) -> DefinitionError:
        return DefinitionError(f"{file}, line {parser.CurrentLineNumber}: {message}")

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) >= deepest:
            raise refuse(f"<{tag}> stands more than {deepest} elements deep")
        stack.append(_Open(tag, attributes, parser.CurrentLineNumber))

    def end(_: str) -> None:
        done = stack.pop()
        element = Element(done.tag, done.attributes, tuple(done.children), "".join(done.text), done.line, file)
        (stack[-1].children if stack else roots).append(element)

    def data(text: str) -> None:
        if stack:
            stack[-1].text.append(text)

    def declared(name: str, *_: object) -> None:
        raise refuse(f"declares the entity {name!r}; entities are not read")

    def skipped(name: str, *_: object) -> None:
        raise refuse(f"refers to the entity {name!r}; entities are not read")

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, data
    parser.EntityDeclHandler = declared
    parser.SkippedEntityHandler = skipped
    parser.SetParamEntityParsing(expat.XML_PARAM_ENTITY_PARSING_NEVER)  # a DOCTYPE's file is not fetched
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise DefinitionError(f"{file}, line {error.lineno}: {expat.errors.messages[error.code]}") from error
    except (ValueError, LookupError) as error:  # an encoding that is not known
        if isinstance(error, DefinitionError):
            raise
        raise DefinitionError(f"{file} cannot be read as XML: {error}") from error
    return roots[0]


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."
