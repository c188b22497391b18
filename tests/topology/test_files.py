"""Files that are written whole or not at all, and read only where they are files indeed."""

from __future__ import annotations

import errno
import os
import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest

from topology import files
from topology.files import (
    TooLargeError,
    missing,
    open_regular,
    read_arrays,
    read_regular,
    whole_file,
)


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


def test_a_regular_file_is_read_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"abc")
    assert read_regular(path, 3) == b"abc"
    with pytest.raises(TooLargeError) as large:
        read_regular(path, 2)
    assert large.value.size == 3
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="a FIFO, and no regular file"):
        open_regular(tmp_path / "pipe")
    with pytest.raises(OSError, match="a device, and no regular file"):
        open_regular("/dev/zero")
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(OSError, match="no name of a file"):
        open_regular("a\0b")


def test_what_is_there_but_cannot_be_read_is_not_missing(tmp_path: Path) -> None:
    assert missing(tmp_path / "none")
    assert not missing(tmp_path)
    assert not missing("n" * 300)
    assert not missing("a\0b")


def test_arrays_are_read_from_sound_archives_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, a=np.arange(3))
    assert read_arrays(path)["a"].tolist() == [0, 1, 2]
    sound = path.read_bytes()
    for damaged in (b"", b"PK", sound[:-30], sound.replace(b"NUMPY", b"NUMPI")):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"."):
            read_arrays(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + bytes(1 << 20))
    monkeypatch.setattr(files, "LARGEST_ARRAYS", 1 << 19)
    with pytest.raises(ValueError, match="1 MB of arrays"):
        read_arrays(path)


def test_a_full_disk_is_told_with_the_name_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with pytest.raises(OSError, match="No space left on device") as caught, whole_file(path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert caught.value.filename == str(path)
    with pytest.raises(FileNotFoundError) as absent, whole_file(tmp_path / "none" / "a.npz"):
        pass
    assert absent.value.filename == str(tmp_path / "none" / "a.npz")
    with pytest.raises(FileNotFoundError) as other, whole_file(path):
        Path("elsewhere").read_text("utf-8")
    assert other.value.filename == "elsewhere"
    assert not list(tmp_path.iterdir())


def test_a_device_or_a_pipe_is_not_replaced_by_a_file(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="must be a regular file, or a new one"), whole_file(pipe):
        pass
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert [entry.name for entry in tmp_path.iterdir()] == ["pipe"]
