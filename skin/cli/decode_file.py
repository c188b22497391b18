"""One log into one file: what `skin decode` does with a .csv, .npz or .parquet, or none."""

from __future__ import annotations

import json as json_text
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.cli import options
from skin.cli.table import counted

if TYPE_CHECKING:
    from skin.blocks.block import Block
    from topology import Topology

__all__ = ["decode_file"]


def decode_file(
    log: Path, *, topology: Topology, output: Path | None, asked: dict[str, Any], json: bool
) -> int:
    """Decode a log, by these options of `skin.options.Options` and else its defaults, or a
    recording, by these and else those of its run; the exit status. See `skin.cli.decode`."""
    from skin.cli.decoded import writer_for
    from skin.errors import SkinError

    if output is not None and output.suffix not in (".csv", ".npz", ".parquet"):
        raise SkinError(f"--output: must end in .csv, .npz or .parquet; got {output.name!r}")
    options.check_folder("--output", output)
    states, blocks = _source(log, topology, asked)
    cycles, valid, peak = 0, 0, 0.0
    with writer_for(output, topology, states.pipeline.options) as add:
        for block in blocks:
            cycles += len(block)
            valid += int(np.count_nonzero(block.units.valid))
            peak = max(peak, float(np.linalg.norm(block.wrench[:, :3], axis=1).max()))
            add(block)
    counters, damage = asdict(states.counters), getattr(states, "damage", None)
    left_out = getattr(states, "left_out", {})
    report = {
        "topology": topology.name,
        "units": topology.n,
        "cycles": cycles,
        "valid_share": options.share_of(valid, cycles, topology),
        "peak_force_n": peak,
        "counters": counters,
        "left_out": left_out,
        "options": states.pipeline.options.report(),
        "damage": damage,
        "skipped": getattr(states, "skipped", {}),
        "faults": states.faults,
        "output": str(output.resolve()) if output is not None and cycles else None,
    }
    if json:
        print(json_text.dumps(report))
    else:
        print(f"{cycles} cycles of {topology.n} units; frames: {counted(counters)}")
        if left_out:
            print(f"frames of other channels: {counted(left_out)}")
        print(f"valid readings {options.percent(report['valid_share'])}, peak force {peak:.2f} N")
        if report["skipped"]:
            print(f"not decoded: {counted(report['skipped'])}")
        if report["output"]:
            print(f"written: {report['output']}")
    for note in getattr(states, "notes", []):
        print(f"note: {note}", file=sys.stderr)
    if damage:
        print(damage, file=sys.stderr)
    for fault in states.faults:
        print(fault, file=sys.stderr)
    return 0 if cycles and not damage and not states.faults else 1


def _source(log: Path, topology: Topology, asked: dict[str, Any]) -> tuple[Any, Iterator[Block]]:
    """What has counters and faults of a log or recording, and its blocks."""
    from skin.blocks.blocks import blocks_of
    from skin.io.bulk.job import WANT
    from skin.io.record import is_recording
    from skin.io.record.replay import redecode
    from skin.offline import decode_log

    if is_recording(log):
        played = redecode(log, topology, **asked)
        return played, blocks_of(played, played.pipeline)
    decoded = decode_log(topology, log, **dict[str, Any](want=(*WANT, "test_ratio")) | asked)
    return decoded, decoded.blocks()
