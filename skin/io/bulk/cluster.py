"""A job on several machines, by an existing `dask.distributed` cluster: the only file that imports
it (extra `cluster`).

A log is a task. Tasks are idempotent, and files take their places by rename: the task of a lost
worker is run again by another one, which skips the partitions that exist. Topology, logs and
results are in a file system that all machines share.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any
from uuid import uuid4

from skin.errors import LibraryError
from skin.io.bulk.decode_part import decode_part
from skin.io.bulk.job import Job, Part, parts_of
from skin.io.bulk.manifest import load_manifest
from skin.io.bulk.progress import OnProgress, Progress
from skin.io.bulk.run import TRIES, report_of

__all__ = ["run_on"]


def run_on(
    client: Any, job: Job, logs: Iterable[Path], *, on_progress: OnProgress | None = None
) -> dict[str, Any]:
    """Decode logs on a cluster.

    Parameters
    ----------
    client : distributed.Client or str
        A client, or the address of a scheduler.
    job : Job
        Its folder has the same path on all workers.
    logs : iterable of Path
        They have the same paths on all workers.
    on_progress : callable, optional
        See `skin.io.bulk.run.run`.

    Returns
    -------
    dict
        See `skin.io.bulk.run.run`.

    Raises
    ------
    LibraryError
        distributed is not installed.
    """
    distributed = _library()
    parts = parts_of(logs)
    if isinstance(client, str):
        with distributed.Client(client) as own:
            return _run(distributed, own, job, parts, Progress(job, parts, on_progress))
    return _run(distributed, client, job, parts, Progress(job, parts, on_progress))


def _run(
    distributed: Any, client: Any, job: Job, parts: list[Part], progress: Progress
) -> dict[str, Any]:
    """Submit the tasks, largest first, and wait for them."""
    begun, run, done = time.monotonic(), uuid4().hex[:8], {}
    futures = {
        client.submit(
            decode_part, job, part, key=f"skin-{part.key}-{run}", pure=False, retries=TRIES - 1
        ): part
        for part in sorted(parts, key=lambda part: -part.size)
    }
    for future in distributed.as_completed(list(futures)):
        part = futures[future]
        try:
            done[part.key] = future.result()
        except Exception as error:  # a worker, or its loss, may raise anything
            found = (load_manifest(job, part) or {}).get("summary", {})
            done[part.key] = found | {
                "log": str(part.log), "key": part.key, "state": "failed",
                "error": f"{part.log}: must be decoded by a worker; got {error!r}",
            }  # fmt: skip
        progress.ended(part)
    return report_of(parts, done, time.monotonic() - begun)


def _library() -> Any:
    try:
        return import_module("distributed")
    except ImportError as error:
        raise LibraryError(
            "cluster: must have dask.distributed; not installed: pip install 'f3t-skin[cluster]'"
        ) from error
