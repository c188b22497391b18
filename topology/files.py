"""Files that are written whole or not at all, and read only where they are files indeed."""

from __future__ import annotations

import errno
import os
import stat
import tomllib
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

LONGEST_TOLD = 1 << 20
"""Bytes that are read of a file that is in the way, to say what it is [assumed]."""
LARGEST_ARRAYS = 1 << 31
"""Bytes of all arrays of an archive, unpacked [assumed: the stencil of 100 000 units]."""

_KINDS = {stat.S_IFIFO: "a FIFO", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device",
          stat.S_IFSOCK: "a socket"}  # fmt: skip


class TooLargeError(OSError):
    """A file has more bytes than it may have.

    Attributes
    ----------
    size : int
        Bytes, as far as they are known.
    """

    def __init__(self, size: int) -> None:
        super().__init__(errno.EFBIG, os.strerror(errno.EFBIG))
        self.size = size


class Kind(NamedTuple):
    """Files that a writer may put its own in place of, since it has written them."""

    name: str
    """What one is, with its article: "a stencil"."""
    is_one: Callable[[Path], bool]
    """Whether the file that is there is one; may raise anything about a file that is none."""


NO_KIND = Kind("", lambda path: False)
"""Of what is never written over: recordings."""


def marked(name: str, *marks: bytes, at_most: int = 1 << 16) -> Kind:
    """Files whose first or last `at_most` bytes have each of these marks."""

    def is_one(path: Path) -> bool:
        with open_regular(path) as file:
            known = file.read(at_most)
            file.seek(max(os.fstat(file.fileno()).st_size - at_most, 0))
            known += b"\0" + file.read(at_most)
        return all(mark in known for mark in marks)

    return Kind(name, is_one)


def arrays_of(name: str, *arrays: str) -> Kind:
    """Files of arrays (.npz), these among them."""

    def is_one(path: Path) -> bool:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            return {f"{array}.npy" for array in arrays} <= set(archive.namelist())

    return Kind(name, is_one)


def check_over(path: Path, kind: Kind) -> None:
    """Refuse to write a file of `kind` over what is another: a writer replaces its own alone.

    An empty file is nothing to lose; a folder, device or pipe is refused by who opens it.

    Raises
    ------
    FileExistsError
        It names what is there.
    """
    if not path.is_file() or not path.stat().st_size:
        return
    try:
        is_own = kind.is_one(path)
    except Exception:  # anything may come of reading what is another
        is_own = False
    if not is_own:
        wanted = f"a new file, or {kind.name}" if kind.name else "a new file"
        raise FileExistsError(
            errno.EEXIST, f"must be {wanted}; got {_told(path)} that is there already", str(path)
        )


def _told(path: Path) -> str:
    """What a file is, as far as it shows, in a few words."""
    try:
        with open_regular(path) as file:
            head = file.read(LONGEST_TOLD)
    except OSError:
        return "a file"
    if head.startswith(b"PK"):
        return "an archive or file of arrays"
    try:
        text = head.decode()
    except UnicodeDecodeError as error:
        if error.start < len(head) - 3:
            return f"a {path.suffix or 'binary'} file"
        text = head[: error.start].decode()
    if "\0" in text:
        return f"a {path.suffix or 'binary'} file"
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        table = {}
    if "patches" in table:
        return f"the topology file of {str(table.get('name', ''))!r}"
    if "patch" in table and "units" in table:
        return f"the calibration file of patch {str(table['patch'])!r}"
    line = next((line for line in text.splitlines() if line.strip()), "")
    return f"a file that begins with {line.strip()[:40]!r}"


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Let errors of writing name `path`: where the disk is full they name none, and a file that is
    to take its place means nothing to the user."""
    try:
        yield
    except OSError as error:
        other = Path(str(error.filename or path)).name
        if path.name in other and error.filename != str(path):
            raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
        raise


def sync(path: Path) -> None:
    """Let the disk have what was written into a file: what takes the place of another is whole then
    after a loss of power, too, and an error of writing that came late is told.

    Raises
    ------
    OSError
        The disk does not take it.
    """
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


@contextmanager
def whole_path(path: Path, over: Kind | None = None) -> Iterator[Path]:
    """The path of a new file beside `path`, which takes its place at the end of the block, once the
    disk has it, and is gone if an error ends it. Of several that write at once, the last one stays.
    An error of writing names `path`. A device or pipe is refused, since a file would take its
    place; so is a file that is not of the kind `over`, as of `check_over`."""
    if over is not None:
        check_over(path, over)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "must be a regular file, or a new one", str(path))
    beside = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.part")
    try:
        with named(path):
            yield beside
            sync(beside)
            os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def whole_file(
    path: Path, mode: str = "wb", *, over: Kind | None = None, **how: Any
) -> Iterator[IO[Any]]:
    """Open a file that takes the place of `path` at the end of the block, as of `whole_path`; `how`
    is for `open`."""
    with whole_path(path, over) as beside, beside.open(mode, **how) as file:
        yield file


def check_path(where: str, value: object, error: Callable[[str], Exception]) -> None:
    """Refuse, with this error, what is no path of a file.

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
    """Whether there is nothing of that name; what is there may be unreadable all the same."""
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return True
    except (OSError, ValueError):
        return False
    return False


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading, without ever waiting for what is none.

    Raises
    ------
    OSError
        It cannot be opened, or is a directory, FIFO, device or socket; `strerror` says it.
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
        They are more than `at_most`.
    OSError
        As of `open_regular`.
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
        It is none, or has more bytes than any that was saved.
    OSError
        As of `open_regular`.
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
    except Exception as error:  # anything may come of reading what is damaged
        raise ValueError(str(error) or type(error).__name__) from None


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _check_regular(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "something else")
        raise OSError(errno.EINVAL, f"{kind}, and no regular file")
