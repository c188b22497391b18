"""LogReader: base class of all readers."""

from __future__ import annotations

import gzip
import os
import zlib
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from bus.errors import ChannelError, LogError
from bus.frame import FrameBatch
from bus.logs.channels import ONLY, Channels, first_of
from topology.files import check_path, missing, open_regular

__all__ = ["LogReader", "existing"]


def existing(path: str | os.PathLike[str]) -> Path:
    """The path of a log, which must be a readable file.

    Raises
    ------
    LogError
        There is none, or it is not a regular file.
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

    Valid frames come first, then the error: of text those behind a damaged line, too.

    Parameters
    ----------
    path : path
        The file; compressed if it ends in .gz.
    buses : mapping of str to int, optional
        Bus index of each wanted channel; frames of others are left out. Without it the first
        channel that appears is bus 0, the next one bus 1, and so on.
    batch : int
        Maximum frames of a batch; the default fits into a processor's cache.
    strict : bool
        Whether damage is raised, behind the frames. If not, `damage` has the error.

    Attributes
    ----------
    channels : dict of str to int
        Bus index of every channel so far; -1 for unwanted ones.
    count : int
        Frames read so far.
    skipped : dict of str to int
        Counts by kind of objects that are not frames, and of frames of unwanted buses.
    lost : int
        Frames that were lost before the log was written, as the log itself says, or more.
    damage : LogError or None
        The first place that could not be read, and what was left out there.
    lacking : str
        The fault of a log, read to its end, without frames of a wanted channel; or "".

    Raises
    ------
    LogError
        There is no such file; when iterating: its format is another one, or it is damaged.
    ChannelError
        When iterating: no channel is wanted, or nothing says which bus it is, strict or not.
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
        """Bus index of every channel so far."""
        return self._channels.seen

    @property
    def format_suffix(self) -> str:
        """Suffix of the format, in lower case: ".log" of "run.LOG.gz"."""
        name = self.path.with_suffix("") if self.path.suffix.lower() == ".gz" else self.path
        return name.suffix.lower()

    @property
    def left_out(self) -> dict[str, int]:
        """Frames so far of each unwanted channel."""
        return {one: n for one in self.channels if (n := self.skipped.get(f"frame of {one}"))}

    @property
    def loss(self) -> str:
        """The fault of a log whose logger lost frames; or ""."""
        fault = f"must hold all frames of its buses; got {self.lost} or more lost by the logger"
        return f"{self.path}: {fault}" if self.lost else ""

    def __iter__(self) -> Iterator[FrameBatch]:
        """Yield the frames; each batch is overwritten by the next one."""
        self._start()
        batch = FrameBatch(self._capacity)
        try:
            for _ in self._fill(batch):
                self.count += len(batch)
                yield batch
                batch.clear()
        except ChannelError as error:
            raise ChannelError(f"{self.path}: {error}") from None
        except LogError as error:
            rest = "" if self.strict else "; what stands before it was read"
            self._faults.append(f"{error}{rest}")
        if self._passed:
            lines = "1 line was" if self._passed == 1 else f"{self._passed} lines were"
            self._faults[0] += f"; {lines} left out, the others were read"
        self.damage = LogError("\n".join(self._faults)) if self._faults else None
        if lacking := self._channels.lacking(bool(self.left_out)):
            self.lacking = f"{self.path}: {lacking}"
            if ONLY in (self._asked or ()) or not self.count + len(batch):
                raise ChannelError(self.lacking)
        if len(batch):
            self.count += len(batch)
            yield batch
        if self.strict and self.damage is not None:
            raise self.damage

    @abstractmethod
    def _fill(self, batch: FrameBatch) -> Generator[None]:
        """Fill the batch, yielding whenever it is full; raises faults."""

    def _start(self) -> None:
        self._channels = Channels(self._asked, first_of(self.path))
        self.count = self.lost = self._passed = 0
        self._faults: list[str] = []
        self.skipped: dict[str, int] = {}
        self.damage: LogError | None = None
        self.lacking = ""

    def _open(self) -> BinaryIO:
        try:
            if self.path.suffix.lower() == ".gz":
                return gzip.open(self.path, "rb")  # type: ignore[return-value]
            return self.path.open("rb")
        except OSError as error:
            raise LogError(f"{self.path}: must be a readable file; got: {error}") from error

    def _read_into(self, file: BinaryIO, view: memoryview) -> int:
        """Read some bytes into `view`; returns their number, 0 at the end."""
        try:
            # One read at a time, so that damage loses nothing before it.
            got: int = file.readinto1(view)  # type: ignore[attr-defined]
        except (OSError, EOFError, zlib.error) as error:
            raise LogError(f"{self.path}: must be readable to its end; got: {error}") from error
        return got

    def _leave_out(self, fault: str) -> None:
        """Count a line that is neither a frame nor anything known; keep the first one's fault."""
        self._passed += 1
        if self._passed == 1:
            self._faults.append(fault)

    def _skip(self, kind: str, count: int = 1) -> None:
        self.skipped[kind] = self.skipped.get(kind, 0) + count
