"""One log into one file: what `skin decode` does with a .csv, .npz or .parquet, or none."""

from __future__ import annotations

import json as json_text
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from skin.cli import options
from skin.cli.table import counted

__all__ = ["decode_file"]

WANT = ("temperature", "force", "test_ratio", "wrench", "centroid", "contacts", "slip")


def decode_file(
    log: Path, *, topology: str, output: Path | None, asked: dict[str, Any], json: bool
) -> int:
    """Decode a log, by these options of `skin.options.Options` and else its defaults; the exit
    status. See `skin.cli.decode`."""
    from skin.cli.decoded import writer_for
    from skin.errors import SkinError
    from skin.offline import decode_log
    from topology import load

    if output is not None and output.suffix not in (".csv", ".npz", ".parquet"):
        raise SkinError(f"--output: must end in .csv, .npz or .parquet; got {output.name!r}")
    options.check_folder("--output", output)
    loaded = load(topology)
    want = (*WANT, "sigma") if output is not None and output.suffix == ".parquet" else WANT
    states = decode_log(loaded, log, want=want, **asked)
    cycles, valid, peak = 0, 0, 0.0
    with writer_for(output, loaded, states.pipeline.options) as add:
        for state in states:
            cycles += 1
            valid += int(state.units.valid.sum())
            peak = max(peak, float(np.linalg.norm(state.wrench[:3])))
            add(state)
    counters = asdict(states.counters)
    report = {
        "topology": loaded.name,
        "units": loaded.n,
        "cycles": cycles,
        "valid_share": valid / max(1, cycles * int(loaded.enabled.sum())),
        "peak_force_n": peak,
        "counters": counters,
        "options": states.pipeline.options.report(),
        "damage": states.damage,
        "faults": states.faults,
        "output": str(output.resolve()) if output is not None and cycles else None,
    }
    if json:
        print(json_text.dumps(report))
    else:
        print(f"{cycles} cycles of {loaded.n} units; frames: {counted(counters)}")
        print(f"valid readings {100 * report['valid_share']:.2f} %, peak force {peak:.2f} N")
        if report["output"]:
            print(f"written: {report['output']}")
    if states.damage:
        print(f"{states.damage}; what stands before it was decoded", file=sys.stderr)
    for fault in states.faults:
        print(fault, file=sys.stderr)
    return 0 if cycles and not states.damage and not states.faults else 1
