"""CandumpReader: logs of candump, parsed by compiled code."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from bus.errors import LogError
from bus.frame import FrameBatch, as_bytes, as_words
from bus.logs import candump_faults as faults
from bus.logs import candump_kernels as kernels
from bus.logs.reader import LogReader

__all__ = ["CandumpReader"]

CHUNK_BYTES = 1 << 20
"""Chunk size; a line must fit in."""
_SHOWN = 60


class CandumpReader(LogReader):
    """Reads the output of candump with -L or -l, and that with -t a, each also with -x.

    Lines may be blank or end in CR LF; stamps may have up to nine digits after the point. Without
    -x the output of -t a does not contain the BRS and ESI flags of a CAN FD frame.
    """

    def _fill(self, batch: FrameBatch) -> Generator[None]:
        buffer = bytearray(CHUNK_BYTES)
        self._text = np.frombuffer(buffer, np.uint8)
        self._state = np.zeros(1, kernels.STATE)
        self._names = np.zeros((kernels.MOST_NAMES, faults.NAME_BYTES), np.uint8)
        self._buses = np.zeros(kernels.MOST_NAMES, np.int64)
        self._left_out = np.zeros(kernels.MOST_NAMES, np.int64)
        end = 0
        with self._open() as file:
            while True:
                got = self._read_into(file, memoryview(buffer)[end:])
                end += got
                whole = buffer.rfind(b"\n", 0, end) + 1
                if not got:
                    break
                if not whole:
                    continue
                yield from self._parse(buffer, whole, batch)
                buffer[: end - whole] = buffer[whole:end]
                end -= whole
        if buffer[:end].strip():
            raise LogError(
                f"{self.path}:{self._line}: must be a whole line, with its end, "
                f"of at most {CHUNK_BYTES} bytes; got {_shown(buffer[:end])}"
            )

    @property
    def _line(self) -> int:
        """Number of the current line, from 1 on."""
        return int(self._state["line"][0]) + 1

    def _parse(self, buffer: bytearray, end: int, batch: FrameBatch) -> Generator[None]:
        """Parse the text up to `end`; yield whenever the batch is full."""
        words, data, state = as_words(batch.records), as_bytes(batch.records), self._state
        state["position"][0] = 0
        status = None
        while status != faults.MORE:
            state["count"][0] = batch.count
            status = kernels.parse(
                self._text, end, self._names, self._buses, self._left_out, words, data, state
            )
            batch.count = int(state["count"][0])
            if status == faults.FULL:
                yield
            elif status == faults.NEW_NAME:
                fault = self._add(bytes(buffer[state["start"][0] : state["end"][0]]))
                if fault:
                    raise self._error(buffer, fault)
            elif status != faults.MORE:
                raise self._error(buffer, f"must be {faults.EXPECTED[status]}")
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

    def _error(self, buffer: bytearray, message: str) -> LogError:
        """The error at a place in the current line."""
        begin, place = int(self._state["position"][0]), int(self._state["start"][0])
        rest = buffer[place : buffer.index(b"\n", place)]
        return LogError(
            f"{self.path}:{self._line}: column {place - begin + 1}: {message}; got {_shown(rest)}"
        )


def _shown(text: bytes | bytearray) -> str:
    """The beginning of a text, for messages."""
    shown = repr(text[:_SHOWN].decode("utf-8", "backslashreplace"))
    return shown if len(text) <= _SHOWN else f"{shown}..."
