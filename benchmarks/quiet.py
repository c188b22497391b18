"""How much of the machine others use while a benchmark runs, and a wait until they use little.

Linux counts the processor time of the whole machine in ``/proc/stat``, and that of a process and of
its ended children for itself; the difference is what others used, with the time that a host took
from this machine ("steal"). Elsewhere nothing is known, and no run counts as busy.
"""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path

__all__ = ["LIMIT", "Others", "wait"]

LIMIT = 0.1
"""Cores: a run while others used more is busy. A desktop at rest uses 0.01 to 0.05 [measured]."""
LOOK_S, PATIENCE_S = 5.0, 900.0

_STAT = Path("/proc/stat")
_BUSY = (0, 1, 2, 5, 6, 7)
"""Columns of its first line: user, nice, system, irq, softirq, steal; user has that of guests."""


class Others:
    """What others use from now on."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._others = _others_s()

    def cores(self) -> float | None:
        """Cores that others used since, on average; None where that is not known.

        Processor time of children counts as theirs once they have ended: call this after.
        """
        now = _others_s()
        if now is None or self._others is None:
            return None
        return max(0.0, (now - self._others) / (time.monotonic() - self._began))


def wait(patience_s: float = PATIENCE_S, look_s: float = LOOK_S) -> float | None:
    """Wait until others use less than `LIMIT`, and at most for `patience_s`.

    Returns
    -------
    float or None
        Cores that they used at last; None where that is not known.
    """
    until = time.monotonic() + patience_s
    while True:
        others = Others()
        time.sleep(look_s)
        used = others.cores()
        if used is None or used < LIMIT or time.monotonic() >= until:
            return used


def _others_s() -> float | None:
    """Processor seconds of the machine that are not of this process nor of its ended children."""
    try:
        numbers = [int(number) for number in _STAT.read_text("ascii").split("\n")[0].split()[1:]]
    except (OSError, ValueError):
        return None
    machine = sum(numbers[column] for column in _BUSY) / os.sysconf("SC_CLK_TCK")
    own = sum(
        one.ru_utime + one.ru_stime
        for one in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )
    return machine - own
