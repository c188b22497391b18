"""Files that are there whole or not at all."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from topology.files import whole_file


def test_a_file_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with whole_file(path, "w", encoding="utf-8") as file:
        file.write("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def fill(path: Path) -> None:
    with whole_file(path) as file:
        file.write(b"half")
        raise OSError("disk full")


def test_an_error_leaves_what_was_there(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="disk full"):
        fill(tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())


def test_of_two_writers_the_last_one_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with whole_file(path, "w", encoding="utf-8") as first:
        first.write("first")
        with whole_file(path, "w", encoding="utf-8") as second:
            second.write("second, and longer")
        assert path.read_text() == "second, and longer"
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_told_with_the_name_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with pytest.raises(OSError, match="No space left on device") as caught, whole_file(path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert caught.value.filename == str(path)
    with pytest.raises(FileNotFoundError) as missing, whole_file(tmp_path / "none" / "a.npz"):
        pass
    assert missing.value.filename == str(tmp_path / "none" / "a.npz")
    with pytest.raises(FileNotFoundError) as other, whole_file(path):
        Path("elsewhere").read_text("utf-8")
    assert other.value.filename == "elsewhere"
    assert not list(tmp_path.iterdir())
