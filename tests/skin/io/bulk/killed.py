"""A process that decodes a log and is killed once it has written so many partitions."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import topology
from skin.io.bulk import decode_part as module
from skin.io.bulk.job import Job, parts_of


def main(log: str, folder: str, partition: str, after: str) -> None:
    """Decode, and die."""
    job = Job(topology.load("palm"), Path(folder), partition_cycles=int(partition))
    commit, count = module._commit, [0]

    def counted(*given, **named):
        if count[0] == int(after):
            os.kill(os.getpid(), signal.SIGKILL)
        commit(*given, **named)
        count[0] += 1

    module._commit = counted
    module.decode_part(job, parts_of([Path(log)])[0])


if __name__ == "__main__":
    main(*sys.argv[1:])
