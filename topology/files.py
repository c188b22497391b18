"""Files that are written atomically, and read only if they are regular files."""

from __future__ import annotations

import errno
import os
import stat
import uuid
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, BinaryIO, NamedTuple

import numpy as np

__all__ = [
    "NO_KIND",
    "Kind",
    "TooLargeError",
    "arrays_of",
    "check_over",
    "check_path",
    "marked",
    "missing",
    "named",
    "open_regular",
    "read_arrays",
    "read_regular",
    "sync",
    "whole_file",
    "whole_path",
]

LARGEST_ARRAYS = 1 << 31
"""Upper bound of the bytes of all arrays of an archive, unpacked [assumed: the stencil of 100 000
units]."""

_KINDS = {stat.S_IFIFO: "a FIFO", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device",
          stat.S_IFSOCK: "a socket"}  # fmt: skip


class TooLargeError(OSError):
    """A file is larger than allowed.

    Attributes
    ----------
    size : int
        Bytes, as far as known.
    """

    def __init__(self, size: int) -> None:
        super().__init__(errno.EFBIG, os.strerror(errno.EFBIG))
        self.size = size


class Kind(NamedTuple):
    """A kind of files that a writer may replace, since it has written them."""

    name: str
    """Description with its article: "a stencil"."""
    is_one: Callable[[Path], bool]
    """Whether an existing file is of this kind; may raise anything for others."""


NO_KIND = Kind("", lambda path: False)
"""Of files that are never replaced: recordings."""


def marked(name: str, *marks: bytes, at_most: int = 1 << 16) -> Kind:
    """Files with each of these marks in their first or last `at_most` bytes."""

    def is_one(path: Path) -> bool:
        with open_regular(path) as file:
            known = file.read(at_most)
            file.seek(max(os.fstat(file.fileno()).st_size - at_most, 0))
            known += b"\0" + file.read(at_most)
        return all(mark in known for mark in marks)

    return Kind(name, is_one)


def arrays_of(name: str, *arrays: str) -> Kind:
    """Files of arrays (.npz) that include these."""

    def is_one(path: Path) -> bool:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            return {f"{array}.npy" for array in arrays} <= set(archive.namelist())

    return Kind(name, is_one)


def check_over(path: Path, kind: Kind) -> None:
    """Refuse to replace an existing file that is not of `kind`.

    Empty files may be replaced; folders, devices and pipes are refused when they are opened.

    Raises
    ------
    FileExistsError
        It exists, and is of another kind.
    """
    if not path.is_file() or not path.stat().st_size:
        return
    try:
        is_own = kind.is_one(path)
    except Exception:  # another kind may raise anything
        is_own = False
    if not is_own:
        wanted, got = (f", or {kind.name}", "another") if kind.name else ("", "one")
        text = f"must be a new file{wanted}; got {got} that is there already"
        raise FileExistsError(errno.EEXIST, text, str(path))


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Add `path` to errors of writing: a full disk reports no path, and that of a temporary file
    means nothing to the user."""
    try:
        yield
    except OSError as error:
        other = Path(str(error.filename or path)).name
        if path.name in other and error.filename != str(path):
            raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
        raise


def sync(path: Path) -> None:
    """Sync a file to the disk, so that it is complete after a loss of power when it replaces
    another one, and late errors of writing are reported.

    Raises
    ------
    OSError
        The disk reports an error.
    """
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


@contextmanager
def whole_path(path: Path, over: Kind | None = None) -> Iterator[Path]:
    """A temporary path next to `path`, which is synced and renamed to it at the end of the block,
    and removed after an error. Of several concurrent writers, the last one wins. An error of
    writing has `path`. Devices and pipes are refused, since a file would replace them; so are files
    of other kinds than `over`, see `check_over`."""
    if over is not None:
        check_over(path, over)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "must be a regular file, or a new one", str(path))
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.part")
    try:
        with named(path):
            yield draft
            sync(draft)
            os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


@contextmanager
def whole_file(
    path: Path, mode: str = "wb", *, over: Kind | None = None, **how: Any
) -> Iterator[IO[Any]]:
    """Open a file that replaces `path` at the end of the block, see `whole_path`; `how` is for
    `open`."""
    with whole_path(path, over) as draft, draft.open(mode, **how) as file:
        yield file


def check_path(where: str, value: object, error: Callable[[str], Exception]) -> None:
    """Require a path of a file, or raise this error.

    Examples
    --------
    >>> check_path("log", 3, ValueError)
    Traceback (most recent call last):
    ValueError: log: must be the path of a file; got an object of type int
    """
    is_path = isinstance(value, str | os.PathLike)
    if not is_path or not isinstance(os.fspath(value), str):
        raise error(
            f"{where}: must be the path of a file; got an object of type {type(value).__name__}"
        )


def missing(path: str | os.PathLike[str]) -> bool:
    """Whether nothing has that name; an existing file may be unreadable."""
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return True
    except (OSError, ValueError):
        return False
    return False


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading; never blocks on other kinds.

    Raises
    ------
    OSError
        It cannot be opened, or is a directory, FIFO, device or socket; see `strerror`.
    """
    try:
        _check_regular(os.stat(path).st_mode)
        file = open(path, "rb", opener=_without_waiting)
    except ValueError as error:
        raise OSError(errno.EINVAL, f"no name of a file ({error})") from None
    try:
        _check_regular(os.fstat(file.fileno()).st_mode)
    except OSError:
        file.close()
        raise
    return file


def read_regular(path: str | os.PathLike[str], at_most: int) -> bytes:
    """All bytes of a regular file.

    Raises
    ------
    TooLargeError
        There are more than `at_most`.
    OSError
        See `open_regular`.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        raw = b"" if size > at_most else file.read(at_most + 1) or b""
    if max(size, len(raw)) > at_most:
        raise TooLargeError(max(size, len(raw)))
    return raw


def read_arrays(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The arrays of an .npz file.

    Raises
    ------
    ValueError
        It is not one, or is larger than any that was saved.
    OSError
        See `open_regular`.
    """
    try:
        with open_regular(path) as file:
            with zipfile.ZipFile(file) as archive:
                size = sum(part.file_size for part in archive.infolist())
            if size > LARGEST_ARRAYS:
                raise ValueError(f"{size / 1e6:.0f} MB of arrays")
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return dict(arrays)
    except OSError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise ValueError(str(error) or type(error).__name__) from None


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _check_regular(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "something else")
        raise OSError(errno.EINVAL, f"{kind}, and no regular file")
