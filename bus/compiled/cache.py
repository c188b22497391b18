"""The folder in which numba keeps compiled kernels: of the user's own, for this very code.

``f3t-skin/<digest>`` in NUMBA_CACHE_DIR where that is set, else in the user's folder for caches
(XDG_CACHE_HOME, ``~/.cache``), else among temporary files. The digest is of the files that kernels
are made of and of the versions of Python, numba, llvmlite and numpy: an edit or an upgrade never
finds old code. Folders of other digests go when nobody has used them for 30 days.

Numba needs a folder that it can write. One that is only to be read, as in an image of a container,
is copied to the next that can be written.

What is read from there is run. So a folder is used only if it belongs to the user or to root and
nobody else may write into it; the logger "bus" says which is not, and why.
"""

from __future__ import annotations

import logging
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from hashlib import blake2b
from pathlib import Path
from stat import S_IMODE, S_ISDIR, S_IWGRP, S_IWOTH, S_IWUSR
from typing import Any

import llvmlite
import numba
import numpy as np

__all__ = ["clear", "digest", "fault_of", "folder", "kept", "sources"]

NAME = "f3t-skin"
UNUSED_S = 30 * 24 * 3600.0
"""Age at which folders of other code go [assumed]."""
ROOT = Path(__file__).parents[2]
PACKAGES = ("bus", "skin", "topology")
IMPORT = re.compile(rb"^from ((?:bus|skin|topology)[\w.]*) import (.*)", re.MULTILINE)
"""An import that a kernel's constants may come by."""

_log = logging.getLogger("bus")


@contextmanager
def kept() -> Iterator[bool]:
    """Let numba keep what is decorated within this context; yields whether it can."""
    place = folder()
    settings: Any = getattr(numba, "config")  # noqa: B009, missing in numba's stubs
    if place is None:
        yield False
        return
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(place)
    try:
        yield True
    finally:
        settings.CACHE_DIR = before


def digest(text: str) -> str:
    """A short name for a text."""
    return blake2b(text.encode(), digest_size=8).hexdigest()


@cache
def folder() -> Path | None:
    """The folder of this code, made if it is not there; None where none can be written."""
    only_read = None
    for base in _bases():
        place = base / sources()
        try:
            is_new = not place.exists()
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            fault = fault_of(base) or fault_of(place)
        except OSError:
            continue
        if fault is not None:
            _log.warning("f3t-skin: compiled kernels in %s are not used: %s", base, fault)
        elif os.access(place, os.W_OK | os.X_OK):
            if only_read is not None and is_new:
                shutil.copytree(only_read, place, dirs_exist_ok=True)
                _allow_writing(place)
            os.utime(place)
            _remove_old(base, place)
            return place
        else:
            only_read = place
    _log.warning("f3t-skin: compiled kernels are not kept: no folder can be written; set "
                 "NUMBA_CACHE_DIR to one that can")  # fmt: skip
    return None


def clear() -> list[Path]:
    """Remove all compiled kernels of this user; returns the folders that are gone."""
    gone = [base for base in _bases() if base.is_dir() and fault_of(base) is None]
    for base in gone:
        shutil.rmtree(base, ignore_errors=True)
    folder.cache_clear()
    return gone


@cache
def sources() -> str:
    """Digest of all that kernels are made of: the files that compile, those that they import, and
    versions."""
    todo = [
        file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))
        if b"bus.compiled" in file.read_bytes()
    ]  # fmt: skip
    known = dict.fromkeys(todo)
    while todo:
        for module, names in IMPORT.findall(todo.pop().read_bytes()):
            place = ROOT.joinpath(*module.decode().split("."))
            inner = (place / f"{name}.py" for name in re.findall(r"\w+", names.decode()))
            for file in (place.with_suffix(".py"), *inner):
                if file not in known and file.exists():
                    known[file] = None
                    todo.append(file)
    versions = (numba.__version__, llvmlite.__version__, np.__version__, sys.version)
    found = blake2b(repr(versions).encode(), digest_size=8)
    for file in sorted(known):
        found.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return found.hexdigest()


def fault_of(place: Path) -> str | None:
    """Why code from a folder must not be run; None if it may be.

    Raises
    ------
    OSError
        It cannot be looked at.
    """
    if os.name != "posix":
        return None
    found = place.lstat() if place.parent == Path(tempfile.gettempdir()) else place.stat()
    if not S_ISDIR(found.st_mode):
        return "must be a folder; got a link"
    if found.st_uid not in (0, os.getuid()):
        return f"must belong to this user or to root; got owner {found.st_uid}"
    if found.st_mode & (S_IWGRP | S_IWOTH):
        return f"must be writable by its owner alone; got mode {S_IMODE(found.st_mode):o}"
    return None


def _bases() -> Iterator[Path]:
    """Folders that may hold those of all code, the wanted one first."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(given, NAME).absolute()
    else:
        caches = os.environ.get("XDG_CACHE_HOME", "")
        home = os.environ.get("HOME", os.path.expanduser("~"))
        if os.path.isabs(caches):
            yield Path(caches, NAME)
        elif os.path.isabs(home) and Path(home).is_dir():
            yield Path(home, ".cache", NAME)
    user = os.getuid() if os.name == "posix" else 0
    yield Path(tempfile.gettempdir(), f"{NAME}-{user}")


def _allow_writing(place: Path) -> None:
    """Let the owner write what was copied with its modes."""
    for path in (place, *place.rglob("*")):
        path.chmod(S_IMODE(path.stat().st_mode) | S_IWUSR)


def _remove_old(base: Path, place: Path) -> None:
    for other in base.iterdir():
        try:
            if other != place and time.time() - other.stat().st_mtime > UNUSED_S:
                shutil.rmtree(other, ignore_errors=True)
        except OSError:  # another process removes it
            continue
