"""A job: its logs, their identities, and the options."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bus.errors import LogError
from bus.logs import buses_of, read
from skin.errors import OptionError, check_choice, check_number
from skin.io.record import is_recording
from skin.options import Options
from topology import Topology
from topology.packed import PARAMETER, TEXTS, to_arrays

__all__ = ["FORMATS", "Job", "Part", "parts_of"]

FORMATS = ("parquet", "npz")
WANT = ("temperature", "force", "sigma", "wrench", "centroid", "contacts", "slip")
"""Quantities that are decoded by default."""
END_BYTES = 1 << 20
"""Bytes at the beginning and at the end of a log that are hashed, with its size, to detect a
change: a change between them is not detected."""
HEAD_BYTES, HEAD_AT = 1 << 12, 256
"""Bytes that identify a log, and their offset: beyond those that loggers rewrite when they end."""
BEGAN = slice(136, 144)
"""When an MF4 began (ASAM MDF 4.1, HD block), whose next bytes may be those of every log of the
same logger; bytes of other formats there stay as they are, too."""
MOST_PARTITION_CYCLES = 1 << 24


@dataclass(frozen=True)
class Part:
    """One log of a job.

    Attributes
    ----------
    log : Path
    key : str
        Its name and a hash of its beginning: the same in any folder, and while it grows.
    size : int
        Bytes at the start of the job.
    content : str
        Hash of its size, its first and its last bytes.
    """

    log: Path
    key: str
    size: int
    content: str

    @property
    def is_recording(self) -> bool:
        """Whether it is a recording of `skin run --record`, which has its own options."""
        return is_recording(self.log)


@dataclass(frozen=True)
class Job:
    """What is decoded from logs, and into which folder.

    Parameters
    ----------
    topology : Topology
    folder : Path
        Folder of the results.
    options : dict, optional
        See `skin.options.Options`; a recording's own options hold where none are given.
    format : "parquet" or "npz"
    force : bool
        Whether unchanged logs are decoded again.
    channels : dict, optional
        As of `skin.decode_log`.
    partition_cycles : int, optional
        Cycles per file; by default a file has some tens of megabytes.

    Raises
    ------
    OptionError, bus.LogError
        An unknown option, or an unknown bus.
    """

    topology: Topology
    folder: Path
    options: dict[str, Any] = field(default_factory=dict)
    format: str = "parquet"
    force: bool = False
    partition_cycles: int | None = None
    channels: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_choice("format", self.format, FORMATS)
        if self.partition_cycles is not None:
            check_number("partition_cycles", self.partition_cycles, 1, MOST_PARTITION_CYCLES,
                         whole=True)  # fmt: skip
        Options(**self.of_logs)
        buses_of(self.topology, None, self.channels)

    @property
    def of_logs(self) -> dict[str, Any]:
        """Options for logs; recordings have their own, except for given ones."""
        return {"want": WANT} | self.options

    def provenance(self, part: Part) -> dict[str, str]:
        """Provenance of the results, as metadata and to detect changes."""
        topology, calibration = hashes_of(self.topology)
        if part.is_recording:  # the other options are those of its run
            report = Options(**self.options).report()
            given = {name: report.get(name) for name in self.options}
        else:
            given = Options(**self.of_logs).report()
        return {
            "skin": self.topology.name, "log": part.log.name, "log_sha256": part.content,
            "topology_sha256": topology, "calibration_sha256": calibration,
            "channels": json.dumps(self.channels, sort_keys=True),
            "options": json.dumps(given, sort_keys=True) if given else "of the recording",
            "version": _version(), "format": self.format,
            "partition_cycles": str(self.partition_cycles),
        }  # fmt: skip

    def folder_of(self, table: str, part: Part) -> Path:
        """Folder of the files of a table of a log."""
        name = quote(self.topology.name, safe="")
        return self.folder / table / f"skin={name}" / f"log={part.key}"

    def manifest_of(self, part: Part) -> Path:
        """Path of the manifest of a log."""
        return self.folder / "_logs" / f"{part.key}.json"


def _version() -> str:
    """Version of this package, which must not be imported here."""
    return str(vars(sys.modules["skin"])["__version__"])


def hashes_of(topology: Topology) -> tuple[str, str]:
    """Hashes of a topology: of all but its calibration, and of the calibration."""
    found = hashlib.sha256(), hashlib.sha256()
    for name, array in sorted(to_arrays(topology).items()):
        is_parameter = name.startswith(PARAMETER) or name in ("calibrated", "tared")
        digest = found[is_parameter]
        digest.update(name.encode())
        if name == TEXTS:
            texts = json.loads(str(array))
            texts.pop("path", None)  # the same file may be in another folder
            digest.update(json.dumps(texts, sort_keys=True).encode())
        else:
            digest.update(array.tobytes())
    return found[0].hexdigest(), found[1].hexdigest()


def parts_of(logs: Iterable[Path]) -> list[Part]:
    """The parts of a job.

    Raises
    ------
    LogError
        There is no such log, or its format is unknown.
    OptionError
        No log, or the same log twice.
    """
    found: dict[str, Part] = {}
    for log in map(Path, logs):
        if not is_recording(log):
            read(log)  # looks at its name, and whether it is there
        part = _part_of(log)
        if part.key in found:
            raise OptionError(f"{log}: must be another log than {found[part.key].log}; got the "
                              "same name and beginning")  # fmt: skip
        found[part.key] = part
    if not found:
        raise OptionError("logs: must be at least one; got none")
    return list(found.values())


def _part_of(log: Path) -> Part:
    """A log as it is now."""
    try:
        size = log.stat().st_size
        with log.open("rb") as file:
            first = file.read(END_BYTES)
            file.seek(max(size - END_BYTES, 0))
            last = file.read(END_BYTES)
    except OSError as error:
        raise LogError(f"{log}: must be a readable file; got: {error.strerror}") from None
    head = first[BEGAN] + first[HEAD_AT : HEAD_AT + HEAD_BYTES] if size > HEAD_AT else first
    head = head or os.fsencode(log.absolute())  # distinguishes empty logs
    stem = log.name.removesuffix(".gz").rpartition(".")[0] or log.name
    key = f"{quote(stem, safe='')}-{hashlib.sha256(head).hexdigest()[:8]}"
    digest = hashlib.sha256(b"%d\n" % size)
    digest.update(first)
    digest.update(last)
    return Part(log, key, size, digest.hexdigest())
