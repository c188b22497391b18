"""CandumpWriter: frames as lines of candump -L."""

from __future__ import annotations

import gzip
import os
from collections.abc import Sequence

import numpy as np

from bus.frame import as_bytes, as_words
from bus.logs.candump_faults import NAME_BYTES
from bus.logs.candump_format import LINE_BYTES, format_frames
from bus.logs.writer import PIECE, LogWriter

__all__ = ["CandumpWriter"]


class CandumpWriter(LogWriter):
    """Writes the same bytes as candump -L, or candump -L -x.

    Stamps are truncated to 1 µs. Without `directed` the log does not distinguish sent frames from
    received ones, as that of candump -L does not.

    Parameters
    ----------
    path : path
        Compressed if it ends in .gz.
    channels : sequence of str, optional
        Name of the interface of each bus; by default can0, can1, …
    directed : bool
        Whether R (received) or T (sent) ends each line.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        channels: Sequence[str] | None = None,
        directed: bool = False,
    ) -> None:
        super().__init__(path)
        names = [f"can{i}" for i in range(256)] if channels is None else list(channels)
        self._names = np.zeros((len(names), NAME_BYTES), np.uint8)
        self._lengths = np.zeros(len(names), np.int64)
        for i, name in enumerate(names):
            encoded = name.encode()
            if not 0 < len(encoded) < NAME_BYTES or min(encoded) <= ord(" "):
                raise ValueError(
                    f"channels[{i}]: must be a name of 1 to {NAME_BYTES - 1} bytes without "
                    f"blanks; got {name!r}"
                )
            self._names[i, : len(encoded)] = np.frombuffer(encoded, np.uint8)
            self._lengths[i] = len(encoded)
        self._directed = int(directed)
        self._text = np.empty(PIECE * LINE_BYTES, np.uint8)
        packed = self.path.suffix.lower() == ".gz"
        self._file = gzip.open(self.path, "wb") if packed else self.path.open("wb")

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def _check(self, records: np.ndarray) -> None:
        super()._check(records)
        known = f"of a bus with a name, below {self._lengths.size}"
        self._refuse(records["bus"] >= self._lengths.size, known, records["bus"])
        self._refuse(records["stamp_ns"] < 0, "of a time since 1970", records["stamp_ns"])

    def _append(self, records: np.ndarray) -> None:
        size = format_frames(
            self._text, as_words(records), as_bytes(records), self._names, self._lengths,
            self._directed,
        )  # fmt: skip
        self._file.write(self._text[:size].data)
