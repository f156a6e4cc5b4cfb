"""The walls of the house: the order of its rooms, its doors, its words and its sources.

Every check is a function from text to a list of violations, so that each is also shown to fail.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "src"
PACKAGE = "paraopt"

# A room may use itself and what stands before it.
ROOMS = (
    "errors",
    "spatial",
    "mechanism",
    "closure",
    "kinematics",
    "shapes",
    "robot",
    "scene",
    "sweep",
    "workspace",
    "planning",
    "modes",
    "robots",
    "io",
    "view",
    "pipeline",
    "__init__",
)

# Members of a family do not know each other; a member named `base` is shared, and so is the package itself.
FAMILIES = (
    re.compile(r"paraopt\.planning\.seed\.(\w+)"),
    re.compile(r"paraopt\.planning\.retime[_.](\w+)"),
    re.compile(r"paraopt\.robots\.(\w+)"),
)
SHARED = {"base", "_base"}

# Backend -> the modules that may import it.
DOORS = {
    "coacd": re.compile(r"paraopt\.shapes\.decompose"),
    "trimesh": re.compile(r"paraopt\.shapes\.decompose"),
    "coal": re.compile(r"paraopt\.scene(\.|$)"),
    "toppra": re.compile(r"paraopt\.planning\.retime"),
    "ruckig": re.compile(r"paraopt\.planning\.retime[_.]ruckig"),
    "matplotlib": re.compile(r"paraopt\.view(\.|$)"),
    "mpl_toolkits": re.compile(r"paraopt\.view(\.|$)"),
}

KEY_LIKE = re.compile(r"\b[A-Z][A-Za-z]+(?:19|20)\d{2}[a-z]?\b")
# Absolute paths of one machine, and a word of its package index, spelled so that this file does not hold it.
FORBIDDEN = re.compile(r"(?<![\w.-])(?<!:/)/(?:work|root|home)\b|pypi" + "-more")


# --- What a module imports


def module_name(path: Path) -> str:
    """`src/paraopt/scene/pairs.py` -> `paraopt.scene.pairs`; a package's `__init__` -> the package."""
    parts = path.relative_to(SOURCES).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def all_modules() -> dict[str, Path]:
    return {module_name(path): path for path in sorted((SOURCES / PACKAGE).rglob("*.py"))}


def imported_names(source: str, module: str, *, is_package: bool, modules: set[str]) -> Iterator[tuple[int, str]]:
    """Yield the line and the full name of every imported module, wherever the import stands.

    `from a import b` counts as `a.b` where that is a module, or where `a` is the package's root and b one of its
    rooms, and as `a` elsewhere.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                here = module.split(".")
                package = here[: len(here) - node.level + is_package]
                origin = ".".join([*package, *([origin] if origin else [])])
            for alias in node.names:
                deeper = f"{origin}.{alias.name}"
                is_module = deeper in modules or (origin == PACKAGE and alias.name in ROOMS)
                yield node.lineno, deeper if is_module else origin
        elif isinstance(node, ast.Call) and node.args:
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            first = node.args[0]
            if (
                called in {"import_module", "__import__"}
                and isinstance(first, ast.Constant)
                and isinstance(first.value, str)
            ):
                yield node.lineno, first.value


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else "__init__"


def family_member(module: str) -> tuple[int, str] | None:
    for index, pattern in enumerate(FAMILIES):
        match = pattern.match(module)
        if match and match.group(1) not in SHARED:
            return index, match.group(1)
    return None


# --- The checkers


def order_violations(source: str, module: str, *, is_package: bool = False, modules: set[str]) -> list[str]:
    room = room_of(module)
    if room not in ROOMS:
        return [f"{module}: '{room}' is none of the rooms {', '.join(ROOMS)}"]
    found = []
    for line, name in imported_names(source, module, is_package=is_package, modules=modules):
        if name.split(".")[0] != PACKAGE:
            continue
        other = room_of(name)
        if other not in ROOMS:
            found.append(f"{module}:{line} imports '{name}', which is in none of the rooms")
        elif ROOMS.index(other) > ROOMS.index(room):
            found.append(f"{module}:{line} imports '{name}', but '{other}' stands below '{room}'")
        mine, theirs = family_member(module), family_member(name)
        if mine and theirs and mine[0] == theirs[0] and mine[1] != theirs[1]:
            found.append(f"{module}:{line} imports its sibling '{name}'")
    return found


def door_violations(source: str, module: str) -> list[str]:
    found = []
    for line, name in imported_names(source, module, is_package=False, modules=set()):
        door = DOORS.get(name.split(".")[0])
        if door and not door.match(module):
            found.append(f"{module}:{line} imports '{name}' past its door")
    return found


def habit_violations(source: str, module: str) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
            found.append(f"{module}:{node.lineno} prints")
        elif isinstance(node, ast.ExceptHandler) and node.type is None:
            found.append(f"{module}:{node.lineno} has a bare except")
    return found


def docstring_violation(name: str, documentation: str | None) -> list[str]:
    text = (documentation or "").strip()
    if not text:
        return [f"{name} has no docstring"]
    first = text.splitlines()[0]
    return [] if first.endswith(".") else [f"{name}: the docstring's first line does not end with a period: {first!r}"]


def documentation_violations(name: str, value: Any) -> list[str]:
    """Violations of a public name and of what is public in it."""
    if inspect.isclass(value):
        found = docstring_violation(name, value.__doc__)  # not getdoc: that would return a parent's words
        for member, attribute in vars(value).items():
            if member.startswith("_"):
                continue
            function = getattr(attribute, "__func__", getattr(attribute, "func", attribute))  # static, class, cached
            if inspect.isfunction(function) or isinstance(attribute, property):
                found += docstring_violation(f"{name}.{member}", inspect.getdoc(getattr(value, member)))
        return found
    if inspect.ismodule(value):
        found = docstring_violation(name, value.__doc__)
        for member in getattr(value, "__all__", []):
            if not inspect.ismodule(getattr(value, member)):
                found += documentation_violations(f"{name}.{member}", getattr(value, member))
        return found
    if callable(value) and not isinstance(value, types.GenericAlias):
        return docstring_violation(name, inspect.getdoc(value))
    return []  # a version, a unit or a type alias cannot carry a docstring


def vocabulary_violations(package: Any) -> list[str]:
    names = getattr(package, "__all__", None)
    if not names:
        return [f"{package.__name__} has no __all__"]
    found = [f"'{name}' stands twice in __all__" for name in sorted(set(names)) if names.count(name) > 1]
    for name in names:
        if hasattr(package, name):
            found += documentation_violations(name, getattr(package, name))
        else:
            found.append(f"'{name}' is in __all__ but does not exist")
    return found


def bibliography_keys(text: str) -> list[str]:
    return re.findall(r"^@\w+\{([^,\s]+),", text, flags=re.MULTILINE)


def source_paragraphs(source: str) -> Iterator[tuple[int, str]]:
    """Yield every `Source:` paragraph of the docstrings, those of attributes included."""
    for node in ast.walk(ast.parse(source)):
        if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            continue
        if isinstance(node.value.value, str):
            for match in re.finditer(r"^[ \t]*Sources?:(.*?)(?=\n[ \t]*\n|\Z)", node.value.value, re.M | re.S):
                line = node.lineno + node.value.value[: match.end(1)].count("\n") - match.group(1).count("\n")
                yield line, " ".join(match.group(1).split())


def citation_violations(source: str, module: str, keys: set[str]) -> list[str]:
    """Accept `Key, equation`, `Key (equation); Key` and `Key, Key`: each part opens with a key that exists."""
    found = []
    for line, text in source_paragraphs(source):
        parts = [part.strip() for part in re.sub(r"\([^()]*\)", " ", text).rstrip(". ").split(";")]
        for part in parts:
            key = re.match(r"[\w-]*", part).group()  # type: ignore[union-attr]
            if key not in keys:
                found.append(f"{module}:{line} cites '{key or text}', which is no key of references.bib")
        unknown = {word for word in KEY_LIKE.findall(text) if word not in keys} - {part.split(",")[0] for part in parts}
        found += [f"{module}:{line} cites '{word}', which is no key of references.bib" for word in sorted(unknown)]
    return found


def word_violations(text: str, name: str) -> list[str]:
    return [
        f"{name}:{number} names a path or a package index of one machine: {match.group()!r}"
        for number, line in enumerate(text.splitlines(), start=1)
        for match in FORBIDDEN.finditer(line)
    ]


def text_files() -> Iterator[tuple[str, str]]:
    """Yield what git tracks or would track; without git, every file outside environments, results and caches."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout.split("\0")
        paths = [ROOT / name for name in listed if name]
    except (OSError, subprocess.CalledProcessError):
        tops = [top for top in ROOT.iterdir() if top.name == ".ci" or not top.name.startswith(".")]
        tops = [top for top in tops if top.name not in {"out", "build", "dist"}]
        found = [path for top in tops for path in ([top] if top.is_file() else top.rglob("*"))]
        paths = [path for path in found if "__pycache__" not in path.parts]
    for path in paths:
        if path.is_file():
            content = path.read_bytes()
            if b"\0" not in content:
                yield str(path.relative_to(ROOT)), content.decode("utf-8", errors="replace")


# --- The house passes them


MODULES = all_modules()


def over_modules(check: Callable[[str, str], list[str]]) -> list[str]:
    assert MODULES, f"no module was found under {SOURCES / PACKAGE}"
    return [entry for module, path in MODULES.items() for entry in check(path.read_text(encoding="utf-8"), module)]


def report(violations: list[str]) -> None:
    assert not violations, "\n" + "\n".join(violations)


def test_rooms_import_only_what_stands_above_them() -> None:
    def check(source: str, module: str) -> list[str]:
        is_package = MODULES[module].name == "__init__.py"
        return order_violations(source, module, is_package=is_package, modules=set(MODULES))

    report(over_modules(check))


def test_backends_stay_behind_their_doors() -> None:
    report(over_modules(door_violations))


def test_sources_neither_print_nor_catch_everything() -> None:
    report(over_modules(habit_violations))


def test_public_names_exist_and_are_documented() -> None:
    report(vocabulary_violations(importlib.import_module(PACKAGE)))


def test_citations_are_in_the_bibliography() -> None:
    keys = bibliography_keys((ROOT / "references.bib").read_text(encoding="utf-8"))
    assert len(keys) == len(set(keys)), "a key stands twice in references.bib"
    report(over_modules(lambda source, module: citation_violations(source, module, set(keys))))


def test_files_name_no_machine() -> None:
    report([entry for name, text in text_files() for entry in word_violations(text, name)])


# --- Each checker can fail, and accepts what it should


@pytest.mark.parametrize(
    ("module", "source", "allowed"),
    [
        ("paraopt.closure", "from paraopt.mechanism import Mechanism", True),
        ("paraopt.closure", "from paraopt.kinematics import Kinematics", False),
        ("paraopt.closure", "def build():\n    from paraopt.scene import Scene", False),
        ("paraopt.closure", "from paraopt import view", False),
        ("paraopt.closure", "from . import view", False),
        ("paraopt.closure", "from .view import plot", False),
        ("paraopt.closure", "import paraopt.io.csv", False),
        ("paraopt.closure", "import paraopt", False),
        ("paraopt.closure", "from paraopt import Mechanism", False),
        ("paraopt.closure", "import importlib\nimportlib.import_module('paraopt.planning')", False),
        ("paraopt.closure", "from paraopt.utils import help", False),
        ("paraopt.utils", "", False),
        ("paraopt.scene.pairs", "from ..robot import Robot", True),
        ("paraopt.scene.pairs", "from ..robots import raf", False),
        ("paraopt.scene.pairs", "from .clearance import distance", True),
        ("paraopt.pipeline", "from paraopt.planning import verify\nfrom paraopt.view import plot", True),
        ("paraopt", "from paraopt.pipeline import plan", True),
        ("paraopt.planning.seed.tree", "from paraopt.planning.seed.base import Seeder", True),
        ("paraopt.planning.seed.tree", "from paraopt.planning.seed.search import Search", False),
        ("paraopt.planning.seed.tree", "from paraopt.planning.seed import search", False),
        ("paraopt.planning.seed", "from paraopt.planning.seed import search", True),
        ("paraopt.planning.retime_ruckig", "from paraopt.planning.retime_toppra import retime", False),
        ("paraopt.planning.retime_ruckig", "from paraopt.planning.retime_base import Retimer", True),
        ("paraopt.robots.raf", "from paraopt.robots.delta import delta", False),
        ("paraopt.robots.raf", "from paraopt.robots import base", True),
    ],
)
def test_order_checker(module: str, source: str, allowed: bool) -> None:
    modules = {
        *(f"paraopt.planning.seed.{name}" for name in ("base", "search", "tree")),
        *(f"paraopt.robots.{name}" for name in ("base", "delta", "raf")),
    }
    is_package = module in {"paraopt", "paraopt.planning.seed"}
    assert (order_violations(source, module, is_package=is_package, modules=modules) == []) is allowed


@pytest.mark.parametrize(
    ("module", "source", "allowed"),
    [
        ("paraopt.scene.distance", "import coal", True),
        ("paraopt.shapes", "import coal", False),
        ("paraopt.sceneries", "import coal", False),
        ("paraopt.planning.retime_toppra", "import toppra.constraint as tc", True),
        ("paraopt.planning.refine", "from toppra import algorithm", False),
        ("paraopt.planning.retime_ruckig", "from ruckig import Ruckig", True),
        ("paraopt.planning.retime_toppra", "from ruckig import Ruckig", False),
        ("paraopt.view.figures", "import matplotlib.pyplot as plt", True),
        ("paraopt.io.csv", "def save():\n    from matplotlib import pyplot", False),
    ],
)
def test_door_checker(module: str, source: str, allowed: bool) -> None:
    assert (door_violations(source, module) == []) is allowed


@pytest.mark.parametrize(
    ("source", "allowed"),
    [
        ("print('x')", False),
        ("try:\n    pass\nexcept:\n    pass", False),
        ("try:\n    pass\nexcept ValueError:\n    pass", True),
        ("'print(x)'  # print(x)", True),
    ],
)
def test_habit_checker(source: str, allowed: bool) -> None:
    assert (habit_violations(source, "synthetic") == []) is allowed


_INHERITED = """
__all__ = ["C"]
class B:
    @property
    def m(self):
        '''A value.'''
class C(B):
    '''A thing.'''
    @property
    def m(self): pass
"""


@pytest.mark.parametrize(
    ("source", "allowed"),
    [
        ("__all__ = ['f']\ndef f():\n    '''Do it.'''", True),
        ("", False),
        ("__all__ = ['f']", False),
        ("__all__ = ['f', 'f']\ndef f():\n    '''Do it.'''", False),
        ("__all__ = ['f']\ndef f(): pass", False),
        ("__all__ = ['f']\ndef f():\n    '''Do it'''", False),
        ("__all__ = ['C']\nclass C:\n    '''A thing.'''\n    def _hidden(self): pass", True),
        ("__all__ = ['C']\nclass B:\n    '''A base.'''\nclass C(B): pass", False),
        ("__all__ = ['C']\nclass C:\n    '''A thing.'''\n    def m(self): pass", False),
        (_INHERITED, True),
        ("__all__ = ['C']\nclass C:\n    '''A thing.'''\n    @property\n    def m(self): pass", False),
        ("__all__ = ['C']\nclass C:\n    '''A thing.'''\n    @classmethod\n    def m(cls): pass", False),
        ("__all__ = ['C']\nfrom dataclasses import dataclass\n@dataclass\nclass C:\n    x: int = 0", False),
    ],
)
def test_vocabulary_checker(source: str, allowed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("synthetic")
    monkeypatch.setitem(sys.modules, "synthetic", module)  # where dataclasses and inspect look names up
    exec(source, module.__dict__)
    assert (vocabulary_violations(module) == []) is allowed


@pytest.mark.parametrize(
    ("line", "allowed"),
    [
        ("Source: Lahouar, II.23", True),
        ("Source: Lahouar, II.1, II.2.", True),
        ("Source: Lahouar (II.28; checked); Chablat1998", True),
        ("Source: Lahouar, Chablat1998, 3.2", True),
        ("Source: Lahouar, II.1,\n    III.4", True),
        ("Source: II.23", False),
        ("Source:", False),
        ("Source: Lahouar, II.23; II.24", False),
        ("Source: Lahouar; Unknown", False),
        ("Source: Lahouar, Chablat1999", False),
        ("Source: Lahouar,\n    Chablat1999", False),
        ("A source: nobody", True),
    ],
)
def test_citation_checker(line: str, allowed: bool) -> None:
    keys = set(bibliography_keys("@phdthesis{Lahouar,\n  year = 1,\n}\n@phdthesis{Chablat1998,\n}"))
    assert keys == {"Lahouar", "Chablat1998"}
    source = f'def f():\n    """Do it.\n\n    {line}\n    """'
    assert (citation_violations(source, "synthetic", keys) == []) is allowed


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("/" + "work/main/x", False),
        ("path='/" + "root/x'", False),
        ("file:///" + "home/me", False),
        ("--index pypi" + "-more", False),
        ("src/work/x, https://home.example, network/homes", True),
    ],
)
def test_word_checker(text: str, allowed: bool) -> None:
    assert (word_violations(text, "synthetic") == []) is allowed


def test_words_are_looked_for_in_this_file() -> None:
    assert str(Path(__file__).resolve().relative_to(ROOT)) in dict(text_files())
