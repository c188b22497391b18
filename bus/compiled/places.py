"""Folders in which compiled kernels are kept: of the user's own, for all virtual environments.

``f3t-skin`` in NUMBA_CACHE_DIR where that is set, else in the user's folder for caches
(XDG_CACHE_HOME, ``~/.cache``). Where it cannot be written, as in a read-only image that brings its
code, it is read all the same, and new kernels go into a folder among temporary files.

What is read from there is run. So a folder is used only if it belongs to the user or to root and
nobody else may write into it; the logger "bus" says which is not, and why.
"""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from stat import S_IMODE, S_IRWXG, S_IRWXO, S_ISDIR, S_ISVTX, S_IWGRP, S_IWOTH

__all__ = ["fault_of", "read", "temporary", "wanted", "written"]

NAME = "f3t-skin"
_log = logging.getLogger("bus")


def wanted() -> Path | None:
    """The folder that the environment asks for; None of a user without a home."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(given, NAME).absolute()
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):
        return Path(given, NAME)
    home = os.environ.get("HOME", os.path.expanduser("~"))
    return Path(home, ".cache", NAME) if os.path.isabs(home) and Path(home).is_dir() else None


def read() -> Iterator[Path]:
    """Folders to look for a kernel in, one after the other."""
    folder = wanted()
    if folder is not None and folder.is_dir() and _is_safe(folder):
        yield folder
        if os.access(folder, os.W_OK):
            return
    if (spare := temporary()) is not None:
        yield spare


def written() -> Path | None:
    """The folder for new kernels, made if it is not there; None where none can be written."""
    folder = wanted()
    if folder is not None and _is_made(folder) and _is_safe(folder):
        return folder
    if (spare := temporary()) is not None:
        _say_kept_in(spare)
    return spare


def temporary() -> Path | None:
    """A folder among temporary files that nobody else can read or write, made if it is not there.
    Not in the working folder, which `tempfile` takes where it finds no other."""
    user = os.getuid() if os.name == "posix" else 0
    try:
        place = Path(tempfile.gettempdir())
        if place.samefile(Path.cwd()) and not place.stat().st_mode & S_ISVTX:
            return None
        folder = place / f"{NAME}-{user}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    if os.name == "posix" and (found.st_uid != user or found.st_mode & (S_IRWXG | S_IRWXO)):
        return None
    return folder if S_ISDIR(found.st_mode) else None


def fault_of(folder: Path) -> str | None:
    """Why code from a folder must not be run; None if it may be.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    OSError
        It cannot be looked at.
    """
    if os.name != "posix":
        return None
    found = folder.stat()
    if found.st_uid not in (0, os.getuid()):
        return f"must belong to this user or to root; got owner {found.st_uid}"
    if found.st_mode & (S_IWGRP | S_IWOTH):
        return f"must be writable by its owner alone; got mode {S_IMODE(found.st_mode):o}"
    return None


def _is_made(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _is_safe(folder: Path) -> bool:
    try:
        fault = fault_of(folder)
    except OSError:
        return False
    if fault is not None:
        _say_unsafe(folder, fault)
    return fault is None


@cache
def _say_unsafe(folder: Path, fault: str) -> None:
    """Say, once, that code is not taken from a folder."""
    _log.warning("f3t-skin: compiled kernels in %s are not used: %s", folder, fault)


@cache
def _say_kept_in(folder: Path) -> None:
    """Say, once, where compiled code goes."""
    _log.warning(
        "f3t-skin: compiled kernels are kept in %s: no other folder can be written; "
        "set NUMBA_CACHE_DIR to one that can",
        folder,
    )
