"""Files appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from paraopt.io import write_atomically


def test_a_file_holds_what_was_written(tmp_path: Path) -> None:
    content = bytes(range(256)) * 100
    target = write_atomically(tmp_path / "a.bin", content)
    assert target == tmp_path / "a.bin"
    assert target.read_bytes() == content
    assert list(tmp_path.iterdir()) == [target]


def test_missing_folders_are_made(tmp_path: Path) -> None:
    assert write_atomically(str(tmp_path / "a" / "b" / "c.txt"), b"x").read_bytes() == b"x"


def test_an_old_file_is_replaced(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_bytes(b"old and longer")
    write_atomically(target, b"new")
    assert target.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [target]


def test_a_reader_of_the_old_file_keeps_it(tmp_path: Path) -> None:
    """The name moves to the new content; nobody sees a part of it."""
    target = tmp_path / "a.txt"
    target.write_bytes(b"old")
    with target.open("rb") as reader:
        write_atomically(target, b"new")
        assert reader.read() == b"old"


def test_a_failure_while_writing_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(TypeError):
        write_atomically(tmp_path / "a.txt", "a text, which is not bytes")  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_failure_while_writing_keeps_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_bytes(b"old")
    with pytest.raises(TypeError):
        write_atomically(target, ["not", "bytes"])  # type: ignore[arg-type]
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_while_renaming_leaves_nothing(tmp_path: Path) -> None:
    """A folder of that name stands in the way."""
    (tmp_path / "a.txt" / "inside").mkdir(parents=True)
    with pytest.raises(OSError):  # noqa: PT011 - which one depends on the system
        write_atomically(tmp_path / "a.txt", b"content")
    assert list(tmp_path.iterdir()) == [tmp_path / "a.txt"]
    assert (tmp_path / "a.txt" / "inside").is_dir()


def test_a_file_in_the_way_of_a_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "out").write_bytes(b"a file")
    with pytest.raises(OSError):  # noqa: PT011 - which one depends on the system
        write_atomically(tmp_path / "out" / "a.txt", b"content")
    assert (tmp_path / "out").read_bytes() == b"a file"
