"""The manifest of a log: the partitions that exist, and their provenance."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from topology.files import whole_file

if TYPE_CHECKING:
    from skin.io.bulk.job import Job, Part

__all__ = ["Manifest", "is_up_to_date", "load_manifest", "save_manifest"]

Manifest = dict[str, Any]
"""``told`` (as of `Job.provenance`), ``partitions`` (rows of each), ``tables`` (one file each),
``complete``, ``summary``."""


def load_manifest(job: Job, part: Part) -> Manifest | None:
    """The manifest of a log; None if it is missing or cannot be read."""
    try:
        found = json.loads(job.manifest_of(part).read_text("utf-8"))
        lists = isinstance(found["partitions"], list) and isinstance(found["tables"], list)
        return found if lists and isinstance(found["told"], dict) else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def save_manifest(job: Job, part: Part, manifest: Manifest) -> None:
    """Write it atomically."""
    path = job.manifest_of(part)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path, "w", encoding="utf-8") as file:
        json.dump(manifest, file, indent=1)


def committed(job: Job, part: Part) -> Manifest | None:
    """The manifest, if its provenance is that of the job and its files exist."""
    found = load_manifest(job, part)
    if found is None or job.force or found["told"] != job.provenance(part):
        return None
    there = all(
        (job.folder_of(str(table), part) / f"part-{number:05}.{job.format}").is_file()
        for table in found["tables"]
        for number in range(len(found["partitions"]))
    )
    return found if there else None


def is_up_to_date(job: Job, part: Part) -> bool:
    """Whether a log needs no work."""
    found = committed(job, part)
    return found is not None and bool(found.get("complete"))
