"""What is to be done: logs, and by what they are known again."""

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
from bus.logs import read
from skin.errors import OptionError, check_choice, check_number
from skin.options import Options
from topology import Topology
from topology.packed import PARAMETER, TEXTS, to_arrays

__all__ = ["FORMATS", "Job", "Part", "parts_of"]

FORMATS = ("parquet", "npz", "mcap")
WANT = ("temperature", "force", "sigma", "wrench", "centroid", "contacts", "slip")
"""What is decoded where nothing else is asked for."""
END_BYTES = 1 << 20
"""Of the beginning and of the end of a log, which with its size tell whether it has changed: a byte
that was changed between them is not seen."""
HEAD_BYTES, HEAD_AT = 1 << 12, 256
"""Bytes that name a log, and where they begin: beyond what loggers write again when they end."""
BEGAN = slice(136, 144)
"""When an MF4 began (ASAM MDF 4.1, HD block), whose next bytes may be those of every log of the
same logger; bytes of other formats there stay as they are, too."""
RECORDING = ".mcap"
MOST_PARTITION_CYCLES = 1 << 24


@dataclass(frozen=True)
class Part:
    """One log of a job.

    Attributes
    ----------
    log : Path
    key : str
        Its name and a hash of its beginning: the same wherever it lies, and while it grows.
    size : int
        Bytes, when the job began.
    content : str
        Hash of its size, its first and its last bytes.
    """

    log: Path
    key: str
    size: int
    content: str

    @property
    def is_recording(self) -> bool:
        """Whether it is a recording of `skin record`, which has its own options."""
        return self.log.suffix.lower() == RECORDING


@dataclass(frozen=True)
class Job:
    """What is made of logs, and where.

    Parameters
    ----------
    topology : Topology
    folder : Path
        Where the results go.
    options : dict, optional
        As of `skin.options.Options`; a recording has its own in place of those not given.
    format : "parquet", "npz" or "mcap"
    anew : bool
        Whether logs are decoded again that have not changed.
    partition_cycles : int, optional
        Cycles of a file; by default a file has some tens of megabytes.

    Raises
    ------
    OptionError
        An option that there is not.
    """

    topology: Topology
    folder: Path
    options: dict[str, Any] = field(default_factory=dict)
    format: str = "parquet"
    anew: bool = False
    partition_cycles: int | None = None

    def __post_init__(self) -> None:
        check_choice("format", self.format, FORMATS)
        if self.partition_cycles is not None:
            check_number("partition_cycles", self.partition_cycles, 1, MOST_PARTITION_CYCLES,
                         whole=True)  # fmt: skip
        Options(**self.of_logs)

    @property
    def of_logs(self) -> dict[str, Any]:
        """The options that logs are decoded by; recordings have their own, but for those given."""
        return {"want": WANT} | self.options

    def told(self, part: Part) -> dict[str, str]:
        """What results tell of where they come from, and what they are compared by."""
        topology, calibration = hashes_of(self.topology)
        if part.is_recording:  # the others are those of its run
            report = Options(**self.options).report()
            given = {name: report.get(name) for name in self.options}
        else:
            given = Options(**self.of_logs).report()
        return {
            "skin": self.topology.name, "log": part.log.name, "log_sha256": part.content,
            "topology_sha256": topology, "calibration_sha256": calibration,
            "options": json.dumps(given, sort_keys=True) if given else "of the recording",
            "version": _version(), "format": self.format,
            "partition_cycles": str(self.partition_cycles),
        }  # fmt: skip

    def folder_of(self, table: str, part: Part) -> Path:
        """Where the files of a table of a log are."""
        name = quote(self.topology.name, safe="")
        return self.folder / table / f"skin={name}" / f"log={part.key}"

    def manifest_of(self, part: Part) -> Path:
        """The file that tells what is there of a log."""
        return self.folder / "_logs" / f"{part.key}.json"


def _version() -> str:
    """Of the package that this room is in, and that it must not import."""
    return str(vars(sys.modules["skin"])["__version__"])


def hashes_of(topology: Topology) -> tuple[str, str]:
    """Hashes of all that a topology is but its calibration, and of that."""
    found = hashlib.sha256(), hashlib.sha256()
    for name, array in sorted(to_arrays(topology).items()):
        is_parameter = name.startswith(PARAMETER) or name in ("calibrated", "tared")
        digest = found[is_parameter]
        digest.update(name.encode())
        if name == TEXTS:
            texts = json.loads(str(array))
            texts.pop("path", None)  # the same file may lie elsewhere
            digest.update(json.dumps(texts, sort_keys=True).encode())
        else:
            digest.update(array.tobytes())
    return found[0].hexdigest(), found[1].hexdigest()


def parts_of(logs: Iterable[Path]) -> list[Part]:
    """The parts of a job.

    Raises
    ------
    LogError
        There is no such log, or none of a kind that can be read.
    OptionError
        No log, or the same log twice.
    """
    found: dict[str, Part] = {}
    for log in map(Path, logs):
        if log.suffix.lower() != RECORDING:
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
    head = head or os.fsencode(log.absolute())  # of empty logs there are many
    stem = log.name.removesuffix(".gz").rpartition(".")[0] or log.name
    key = f"{quote(stem, safe='')}-{hashlib.sha256(head).hexdigest()[:8]}"
    digest = hashlib.sha256(b"%d\n" % size)
    digest.update(first)
    digest.update(last)
    return Part(log, key, size, digest.hexdigest())
