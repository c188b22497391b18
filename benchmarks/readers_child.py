"""A reader that may crash or hang: ``python -m benchmarks.readers_child SIDE LIST FIRST PLANT``.

Reads the files of a list from number FIRST on, and prints for each a line of JSON: its frames, and
the message if there was one. PLANT is a fault of the harness's own test: "wrong", "lost", "crash"
or "hang", else "".
"""

from __future__ import annotations

import json
import logging
import os
import resource
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

SECONDS, MEMORY_MB = 20, 6000
"""Of computing for one file; address space."""
Frame = tuple[int, int, bool, bool, bool, str]


def _ours(path: Path) -> tuple[Iterator[Frame], Callable[[], str]]:
    from bus.frame import CAN_EFF, CAN_RTR, FD_FDF
    from bus.logs import read

    log = read(path, strict=False)
    frames = (
        (round(stamp / 1e6), can_id & 0x1FFFFFFF, bool(can_id & CAN_EFF), bool(can_id & CAN_RTR),
         bool(flags & FD_FDF), bytes(data[:length]).hex())
        for batch in log for stamp, can_id, length, flags, _, _, data in batch.frames.tolist()
    )  # fmt: skip
    return frames, lambda: str(log.damage or "") or (log.loss if log.lost else "")


def _python_can(path: Path) -> tuple[Iterator[Frame], Callable[[], str]]:
    import can

    frames = (
        (round(1e3 * m.timestamp), m.arbitration_id, m.is_extended_id, m.is_remote_frame, m.is_fd,
         bytes(m.data).hex())
        for m in can.LogReader(path)
    )  # fmt: skip
    return frames, str


def _asammdf(path: Path) -> tuple[Iterator[Frame], Callable[[], str]]:
    import asammdf

    def frames() -> Iterator[Frame]:
        with asammdf.MDF(path) as file:
            start = file.header.start_time.timestamp()
            for index, group in enumerate(file.groups):
                name = "CAN_DataFrame"
                if name in {c.name for c in group.channels} and group.channel_group.cycles_nr:
                    got = file.get(name, group=index, raw=True)
                    for stamp, row in zip(got.timestamps, got.samples, strict=True):
                        cell = {key.removeprefix(f"{name}."): row[key] for key in row.dtype.names}
                        data = bytes(cell["DataBytes"])[: int(cell["DataLength"])].hex()
                        yield (round(1e3 * (start + stamp)), int(cell["ID"]), bool(cell["IDE"]),
                               False, bool(cell["EDL"]), data)  # fmt: skip

    return frames(), str


SIDES = {"ours": _ours, "python-can": _python_can, "asammdf": _asammdf}


class _Told(logging.Handler):
    """What a library says by its logger, from warnings on."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.text = ""

    def emit(self, record: logging.LogRecord) -> None:
        self.text = self.text or record.getMessage()


def main() -> None:
    """Read the files."""
    side, listed, first, plant = sys.argv[1:]
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MB << 20, MEMORY_MB << 20))
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries print
    for path in Path(listed).read_text().split()[int(first) :]:
        told, found, message = _Told(), [], ""
        logging.getLogger().handlers[:] = [told]
        logging.getLogger("asammdf").handlers[:] = [told]
        signal.setitimer(signal.ITIMER_PROF, 1 if plant == "hang" else SECONDS)  # ends the process
        try:
            frames, said = SIDES[side](Path(path))
            for frame in frames:
                found.append(frame)
            message = said()
        except Exception as error:  # a message as good as any
            message = repr(error)
        if plant == "wrong":
            found[3] = (*found[3][:5], found[2][5])
        elif plant == "lost":
            del found[3]
        elif plant == "crash":
            os.abort()
        while plant == "hang":
            pass
        signal.setitimer(signal.ITIMER_PROF, 0)
        print(json.dumps([found, message or told.text]), file=out, flush=True)


if __name__ == "__main__":
    main()
