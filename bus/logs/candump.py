"""CandumpReader: logs of candump, parsed by compiled code."""

from __future__ import annotations

import re
from collections.abc import Generator

import numpy as np

from bus.errors import LogError
from bus.frame import FrameBatch, as_bytes, as_words
from bus.logs import candump_kernels as kernels
from bus.logs.reader import LogReader

__all__ = ["CandumpReader"]

CHUNK_BYTES = 1 << 20
"""Chunk size; a line must fit in."""
_SHOWN = 60
_DROPS = re.compile(rb"DROPCOUNT: dropped (\d{1,9}) CAN frames? on '[!-~]+' socket")
"""What candump -d writes between frames."""
_SURE = re.compile(rb"#[\dA-Fa-f]{16}(_[\dA-Fa-f])?\s*$|##[\dA-Fa-f]{129}\s*$|\s[RTrt]\s*$")
"""Ends of a line to which no digit can be lacking."""


class CandumpReader(LogReader):
    """Reads the output of candump with -L or -l, also with -x and -d.

    Lines may be blank or end in CR LF; stamps may have up to nine digits after the point. A last
    line without its end is taken where it cannot be longer.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        buffer = bytearray(CHUNK_BYTES + 1)
        self._text = np.frombuffer(buffer, np.uint8)
        self._state = np.zeros(1, kernels.STATE)
        self._names = np.zeros((kernels.MOST_NAMES, kernels.NAME_BYTES), np.uint8)
        self._buses = np.zeros(kernels.MOST_NAMES, np.int64)
        self._left_out = np.zeros(kernels.MOST_NAMES, np.int64)
        end = 0
        with self._open() as file:
            while got := self._read_into(file, memoryview(buffer)[end:CHUNK_BYTES]):
                end += got
                whole = buffer.rfind(b"\n", 0, end) + 1
                if whole:
                    yield from self._parse(buffer, whole, batch)
                    buffer[: end - whole] = buffer[whole:end]
                    end -= whole
                elif end == CHUNK_BYTES:
                    buffer[_SHOWN], end = 0, _SHOWN + 1  # no line has this byte
        rest = bytes(buffer[:end]).strip()
        if b"#" in rest and not _SURE.search(rest):
            self._leave_out(
                f"{self.path}:{self._line}: must be a whole line, with its end, "
                f"of at most {CHUNK_BYTES} bytes; got {_shown(rest)}"
            )
        elif rest:
            buffer[end] = ord("\n")
            yield from self._parse(buffer, end + 1, batch)

    @property
    def _line(self) -> int:
        """Number of the current line, from 1 on."""
        return int(self._state["line"][0]) + 1

    def _parse(self, buffer: bytearray, end: int, batch: FrameBatch) -> Generator[None]:
        """Parse the text up to `end`; yield whenever the batch is full."""
        words, data, state = as_words(batch.records), as_bytes(batch.records), self._state
        state["position"][0] = 0
        status = None
        while status != kernels.MORE:
            state["count"][0] = batch.count
            status = kernels.parse(
                self._text, end, self._names, self._buses, self._left_out, words, data, state
            )
            batch.count = int(state["count"][0])
            if status == kernels.FULL:
                yield
            elif status == kernels.NEW_NAME:
                fault = self._add(bytes(buffer[state["start"][0] : state["end"][0]]))
                if fault:
                    raise LogError(self._fault(buffer, fault))
            elif status != kernels.MORE:
                self._pass(buffer, f"must be {kernels.EXPECTED[status]}")
        for name, count in zip(self.channels, self._left_out, strict=False):
            if count:
                self.skipped[f"frame of {name}"] = int(count)

    def _add(self, name: bytes) -> str:
        """Assign a bus to a new interface; returns the fault, if any."""
        k = int(self._state["names"][0])
        try:
            self._buses[k] = self._channels.index(name.decode("utf-8", "backslashreplace"))
        except ValueError as error:
            return str(error)
        self._names[k, : len(name)] = np.frombuffer(name, np.uint8)
        self._state["names"][0] = k + 1
        return ""

    def _pass(self, buffer: bytearray, fault: str) -> None:
        """Go on behind a line that is no frame."""
        begin = int(self._state["position"][0])
        end = buffer.index(b"\n", begin) + 1
        drop = _DROPS.match(buffer, begin, end)
        if drop:
            self.lost += int(drop[1])
        else:
            self._leave_out(self._fault(buffer, fault))
        self._state["position"] = end
        self._state["line"] += 1

    def _fault(self, buffer: bytearray, message: str) -> str:
        """The fault at a place in the current line."""
        begin, place = int(self._state["position"][0]), int(self._state["start"][0])
        rest = buffer[place : buffer.index(b"\n", place)]
        return (
            f"{self.path}:{self._line}: column {place - begin + 1}: {message}; got {_shown(rest)}"
        )


def _shown(text: bytes | bytearray) -> str:
    """The beginning of a text, for messages."""
    shown = repr(text[:_SHOWN].decode("utf-8", "backslashreplace"))
    return shown if len(text) <= _SHOWN else f"{shown}..."
