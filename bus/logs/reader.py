"""LogReader: what the readers of all formats have in common."""

from __future__ import annotations

import gzip
import os
import zlib
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from bus.errors import LogError
from bus.frame import FrameBatch
from bus.logs.channels import Channels
from topology.files import check_path, missing, open_regular

__all__ = ["LogReader", "existing"]


def existing(path: str | os.PathLike[str]) -> Path:
    """The path of a log, which must be a file.

    Raises
    ------
    LogError
        There is none, or it is no regular file that may be read.
    """
    check_path("log", path, LogError)
    if missing(path):
        raise LogError(f"{path}: must be an existing file; got none")
    try:
        open_regular(path).close()
    except OSError as error:
        raise LogError(f"{path}: must be a readable file; got: {error.strerror}") from None
    return Path(path)


class LogReader(ABC):
    """Frames of a log file, batch by batch, from the first one each time it is iterated.

    Nothing that is good before a damage is lost: those frames come first, then the error.

    Parameters
    ----------
    path : path
        The file; compressed if it ends in .gz.
    buses : mapping of str to int, optional
        Bus index of each channel that counts; frames of others are left out. Without it the first
        channel that appears is bus 0, the next one bus 1, and so on.
    batch : int
        Most frames of a batch; of those given by default a processor's cache holds all.
    strict : bool
        Whether damage is raised. If not, reading ends there all the same, and `damage` tells.

    Attributes
    ----------
    channels : dict of str to int
        Bus index of every channel that appeared so far; -1 for those left out.
    count : int
        Frames read so far.
    read_bytes : int
        Bytes read so far, unpacked; 0 where a library reads the file.
    skipped : dict of str to int
        What was read and is no frame, or of no bus asked for: kinds and how many so far.
    damage : LogError or None
        Where reading had to end, and what was lost.

    Raises
    ------
    LogError
        There is no such file; from iterating: it is not what its name says, or it is damaged.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        buses: Mapping[str, int] | None = None,
        batch: int = 4096,
        strict: bool = True,
    ) -> None:
        if batch < 1:
            raise ValueError(f"batch: must be at least 1 frame; got {batch}")
        self.path = existing(path)
        self.strict = strict
        self._asked = buses
        self._capacity = batch
        self._start()

    @property
    def channels(self) -> dict[str, int]:
        """Bus index of every channel that appeared so far."""
        return self._channels.seen

    @property
    def format_suffix(self) -> str:
        """Suffix that tells the format, in small letters: ".log" of "run.LOG.gz"."""
        name = self.path.with_suffix("") if self.path.suffix.lower() == ".gz" else self.path
        return name.suffix.lower()

    def __iter__(self) -> Iterator[FrameBatch]:
        """Yield the frames; each batch is overwritten by the next one."""
        self._start()
        batch = FrameBatch(self._capacity)
        try:
            for _ in self._fill(batch):
                self.count += len(batch)
                yield batch
                batch.clear()
            missing = self._channels.missing()
            if missing:
                raise LogError(f"{self.path}: {missing}")
        except LogError as error:
            self.damage = error
        if len(batch):
            self.count += len(batch)
            yield batch
        if self.strict and self.damage is not None:
            raise self.damage

    @abstractmethod
    def _fill(self, batch: FrameBatch) -> Generator[None]:
        """Fill the batch, yielding whenever it is full, and raise what is wrong."""

    def _start(self) -> None:
        self._channels = Channels(self._asked)
        self.count = self.read_bytes = 0
        self.skipped: dict[str, int] = {}
        self.damage: LogError | None = None

    def _open(self) -> BinaryIO:
        try:
            if self.path.suffix.lower() == ".gz":
                return gzip.open(self.path, "rb")  # type: ignore[return-value]
            return self.path.open("rb")
        except OSError as error:
            raise LogError(f"{self.path}: must be a readable file; got: {error}") from error

    def _read_into(self, file: BinaryIO, view: memoryview) -> int:
        """Read some bytes into `view`; return their number, 0 at the end."""
        try:
            # What one read gives, so that a damage takes nothing along that came before it.
            got: int = file.readinto1(view)  # type: ignore[attr-defined]
        except (OSError, EOFError, zlib.error) as error:
            raise LogError(f"{self.path}: must be readable to its end; got: {error}") from error
        self.read_bytes += got
        return got

    def _skip(self, kind: str, count: int = 1) -> None:
        self.skipped[kind] = self.skipped.get(kind, 0) + count
