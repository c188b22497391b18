"""`skin decode`: a recorded log into forces."""

from __future__ import annotations

import json as json_text
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from skin.cli import options
from skin.cli.table import counted

__all__ = ["decode"]

WANT = ("temperature", "force", "wrench", "centroid", "contacts", "slip")


def decode(
    log: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG", help="recorded CAN log")
    ],
    /,
    *,
    topology: Annotated[str, tyro.conf.arg(metavar="FILE", help=options.FILE_HELP)],
    output: Annotated[
        Path | None,
        options.quiet(
            "where to write: .csv (a row for each cycle and unit), .npz (arrays) or .parquet (a "
            "row for each cycle)",
            metavar="FILE",
            aliases=["-o"],
        ),
    ] = None,
    json: options.Json = False,
) -> int:
    """Decode a recorded CAN log (candump, BLF, ASC, TRC, …).

    The frames of a skin with several buses are told apart by the channels of its file, which the
    log must name.

    A .csv has a row for each cycle and unit; beside it lie FILE.wrench.csv with a row for each
    cycle, FILE.contacts.csv with one for each cycle and contact, and FILE.events.csv with what
    happened to contacts: born, resumed, merged, split, ended, stick, incipient, gross.

    The arrays of an .npz are time_s (t), temperature_c (t, n), force_n (t, 3, n), status (t, n),
    wrench and wrench_sigma (t, 6), centroid_m (t, 3), contact (t, n) and unit (n); of k contacts in
    all cycles contact_cycle (an index of t), contact_id, contact_load_n, contact_centroid_m (k, 3),
    contact_normal (k, 3), contact_slip, contact_margin and contact_friction; of e events
    event_time_s, event_contact and event. Nothing in it needs pickle. The contact of a unit is the
    identity of what touches it, the same as long as it stays, and 0 for nothing.
    A .parquet has a row for each cycle; docs/connect.md has its columns.

    Exits with 1 if the log holds no cycle of this skin, is damaged, lacks SYNC or has time that
    runs back; all that can be decoded is.
    """
    from skin.cli.decoded import writer_for
    from skin.errors import SkinError
    from skin.offline import decode_log
    from topology import load

    if output is not None and output.suffix not in (".csv", ".npz", ".parquet"):
        raise SkinError(f"--output: must end in .csv, .npz or .parquet; got {output.name!r}")
    options.check_folder("--output", output)
    loaded = load(topology)
    want = (*WANT, "sigma") if output is not None and output.suffix == ".parquet" else WANT
    states = decode_log(loaded, log, want=want, dtype="float64", sweeps=2)
    cycles, valid, peak = 0, 0, 0.0
    with writer_for(output, loaded) as add:
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
        "valid_share": valid / max(1, cycles * loaded.n),
        "peak_force_n": peak,
        "counters": counters,
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
