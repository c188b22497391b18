"""`skin decode`: a recorded log into forces."""

from __future__ import annotations

import csv
import json as json_text
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import tyro

from skin.cli import options
from skin.cli.table import counted
from topology.files import whole_file

if TYPE_CHECKING:
    from bus.frame import FrameBatch
    from skin.pipeline import Pipeline
    from skin.state import State
    from topology import Topology

__all__ = ["decode"]


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
            "where to write: .csv (a row for each cycle and unit) or .npz (arrays)",
            metavar="FILE",
            aliases=["-o"],
        ),
    ] = None,
    json: options.Json = False,
) -> int:
    """Decode a recorded CAN log (candump, BLF, ASC, TRC, …).

    The frames of a skin with several buses are told apart by the channels of its file, which the
    log must name.

    The arrays of an .npz are time_s (t), temperature_c (t, n), force_n (t, 3, n), status (t, n),
    wrench (t, 6), centroid_m (t, 3), contact (t, n) and unit (n); nothing in it needs pickle. The
    contact of a unit is the identity of what touches it, the same as long as it stays, and 0 for
    nothing.

    Exits with 1 if the log holds no cycle of this skin, or is damaged: then all that stands before
    the damage is decoded.
    """
    from bus.logs import buses_of, read
    from skin.compiling import announcer
    from skin.errors import SkinError
    from skin.options import Options
    from skin.pipeline import Pipeline
    from topology import load

    if output is not None and output.suffix not in (".csv", ".npz"):
        raise SkinError(f"--output: must end in .csv or .npz; got {output.name!r}")
    options.check_folder("--output", output)
    loaded = load(topology)
    announcer()
    want = {"temperature", "force", "wrench", "centroid", "contacts"}
    pipeline = Pipeline(loaded, Options(want=want, dtype="float64", sweeps=2))
    frames = read(log, buses=buses_of(loaded) if len(loaded.buses) > 1 else None, strict=False)
    rows = [_Row.of(state) for state in _states(pipeline, frames)]
    counters = asdict(pipeline.counters)
    if output is not None and rows:
        _write(output, loaded, rows)
    valid = sum(int(row.valid.sum()) for row in rows)
    peak = max((float(np.linalg.norm(row.wrench[:3])) for row in rows), default=0.0)
    report = {
        "topology": loaded.name,
        "units": loaded.n,
        "cycles": len(rows),
        "valid_share": valid / max(1, len(rows) * loaded.n),
        "peak_force_n": peak,
        "counters": counters,
        "damage": str(frames.damage) if frames.damage else None,
        "output": str(output.resolve()) if output is not None and rows else None,
    }
    if json:
        print(json_text.dumps(report))
    else:
        print(f"{len(rows)} cycles of {loaded.n} units; frames: {counted(counters)}")
        print(f"valid readings {100 * report['valid_share']:.2f} %, peak force {peak:.2f} N")
        if report["output"]:
            print(f"written: {report['output']}")
    if frames.damage:
        print(f"{frames.damage}; what stands before it was decoded", file=sys.stderr)
    return 0 if rows and not frames.damage else 1


def _states(pipeline: Pipeline, batches: Iterable[FrameBatch]) -> Iterator[State]:
    for batch in batches:
        # who recorded a frame as its own sent it on the bus all the same
        batch.frames["origin"] = 0
        yield from pipeline.feed(batch.frames)
    last = pipeline.flush()
    if last is not None:
        yield last


class _Row(NamedTuple):
    """What is written of a cycle; copies."""

    stamp_ns: int
    temperature_c: np.ndarray
    force_n: np.ndarray
    status: np.ndarray
    valid: np.ndarray
    wrench: np.ndarray
    centroid_m: np.ndarray
    contact: np.ndarray
    """Identity of what touches each unit, 0 for nothing."""

    @classmethod
    def of(cls, state: State) -> _Row:
        units = state.units
        identity = np.array([0, *(contact.id for contact in state.contacts)])
        return cls(
            state.stamp_ns, units.temperature.copy(), units.force.copy(), units.status.copy(),
            units.valid.copy(), state.wrench.copy(), state.centroid.copy(),
            identity[state.label + 1],
        )  # fmt: skip


def _write(path: Path, topology: Topology, rows: list[_Row]) -> None:
    start_ns = rows[0].stamp_ns
    if path.suffix == ".npz":
        stamp_ns, temperature, force, status, _, wrench, centroid, contact = map(
            np.stack, zip(*rows, strict=True)
        )
        with whole_file(path) as file:
            np.savez_compressed(
                file, time_s=(stamp_ns - start_ns) * 1e-9, temperature_c=temperature, force_n=force,
                status=status, wrench=wrench, centroid_m=centroid, contact=contact,
                unit=np.array(topology.unit_names),
            )  # fmt: skip
        return
    with whole_file(path, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow("time_s unit temperature_c fx_n fy_n fz_n status valid contact".split())
        for row in rows:
            time_s = (row.stamp_ns - start_ns) * 1e-9
            for i, name in enumerate(topology.unit_names):
                table.writerow(
                    [f"{time_s:.6f}", name, f"{row.temperature_c[i]:.3f}",
                     *(f"{value:.4f}" for value in row.force_n[:, i]), int(row.status[i]),
                     int(row.valid[i]), int(row.contact[i])]
                )  # fmt: skip
