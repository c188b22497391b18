"""A job on several machines, by a `dask.distributed` cluster that is there: the one file that
imports it (extra `cluster`).

A log is a task. Tasks give the same files wherever and however often they run, and files take their
places by rename, so that a task whose worker was lost is run again by another one, which passes
over the partitions that are there. All machines see topology, logs and results in one file system.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any
from uuid import uuid4

from skin.bulk.decode_part import decode_part
from skin.bulk.job import Job, Part, parts_of
from skin.bulk.manifest import load_manifest
from skin.bulk.progress import Progress, Tell
from skin.bulk.run import TRIES, report_of
from skin.errors import LibraryError

__all__ = ["run_on"]


def run_on(
    client: Any, job: Job, logs: Iterable[Path], *, tell: Tell | None = None
) -> dict[str, Any]:
    """Decode logs on a cluster.

    Parameters
    ----------
    client : distributed.Client or str
        Of the cluster, or the address of its scheduler.
    job : Job
        Whose folder all workers see under the same name.
    logs : iterable of Path
        Likewise.
    tell : callable, optional
        As of `skin.bulk.run.run`.

    Returns
    -------
    dict
        As of `skin.bulk.run.run`.

    Raises
    ------
    LibraryError
        distributed is not installed.
    """
    distributed = _library()
    parts = parts_of(logs)
    if isinstance(client, str):
        with distributed.Client(client) as own:
            return _run(distributed, own, job, parts, Progress(job, parts, tell))
    return _run(distributed, client, job, parts, Progress(job, parts, tell))


def _run(
    distributed: Any, client: Any, job: Job, parts: list[Part], progress: Progress
) -> dict[str, Any]:
    """Hand the tasks out, largest first, and wait for them."""
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
        except Exception as error:  # whatever a worker, or its loss, may raise
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
