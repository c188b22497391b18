"""`skin tare`: the zeros of an untouched skin, into its calibration files."""

from __future__ import annotations

import json as json_text
import sys
from itertools import islice
from typing import TYPE_CHECKING, Annotated, Any

from skin.cli import options
from skin.cli.table import columns

if TYPE_CHECKING:
    import numpy as np

    from skin.live import Skin
    from topology import Topology

__all__ = ["refused", "tare"]

SHOWN = 16


def tare(
    file: options.File,
    /,
    *,
    seconds: options.Listening = 2.0,
    output: options.Calibration = None,
    write: options.Write = False,
    leave_out: Annotated[
        tuple[str, ...], options.quiet("units that keep the zeros they have", metavar="[UNIT …]")
    ] = (),
    simulate: Annotated[
        bool, options.quiet("tare simulated units, which nothing touches, in this process")
    ] = False,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    json: options.Json = False,
) -> int:
    """Take the frequency and the lateral field of every unit as its zero, and save them.

    Nothing may touch the skin meanwhile. Every other value of the calibration files is kept. A file
    that the topology does not name yet is used once it has the line that is printed, or with
    --write added. If a unit is loaded, moving, noisy or invalid, nothing is written and the exit
    status is 1.
    """
    import skin
    from skin.calibrate.tare import calibration_files, chosen
    from skin.calibrate.tare import tare as take
    from skin.compiling import announcer
    from skin.errors import ScanError
    from skin.physics.stencil import neighbours_at_rest
    from skin.sim.scenes.script import SceneFile

    options.check_seconds(seconds)
    announcer()
    loaded = options.load(file, bus, allow_no_calibration=True)
    for unit in leave_out:
        loaded.unit_index(unit)
    if simulate:
        options.refuse_simulated(loaded, output)
    calibration_files(loaded, chosen(loaded, leave_out), output)  # refused before, not after
    scene = SceneFile(format=1, name="untouched", seconds=2.0 * seconds) if simulate else None
    with skin.open(
        loaded, options=skin.Options(want="temperature", auto_tare=False), sync=sync,
        simulate=scene, pace=not simulate,
    ) as opened:  # fmt: skip
        print(f"listening for {seconds:g} s …", file=sys.stderr, flush=True)
        counts, status = _listen(opened, seconds)
        if unsent := opened.timing.unsent:
            print(f"note: {unsent} SYNCs were not taken by the buses", file=sys.stderr)
    try:
        found = take(
            loaded, counts, status, rest_ut=neighbours_at_rest(loaded), leave_out=leave_out
        )
    except ScanError as error:
        return refused(str(error), loaded, json)
    changes = found.changes()
    print(_table(changes))
    written = options.named_in_file(loaded, found.write(output, simulated=simulate), write)
    if json:
        report = {"topology": loaded.name, "units": loaded.n, "tared": len(changes),
                  "cycles": len(counts), "refused": [], "changes": changes}  # fmt: skip
        print(json_text.dumps(report | written))
    return 0


def refused(message: str, topology: Topology, json: bool) -> int:
    """Print why nothing was written; the exit status."""
    print(message, file=sys.stderr)
    if json:
        report = {"topology": topology.name, "refused": message.splitlines(), "files": {}}
        print(json_text.dumps(report))
    return 1


def _listen(opened: Skin, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Counts, shape (t, c, n), and flags, shape (t, n), of the next cycles of an open skin."""
    import numpy as np

    pipeline = opened.pipeline
    counts, status = [pipeline.counts[np.newaxis][:0]], [pipeline.status[np.newaxis][:0]]
    for _ in islice(opened, max(1, round(seconds * opened.topology.cycle_rate_hz))):
        counts.append(pipeline.counts[np.newaxis].copy())
        status.append(pipeline.status[np.newaxis].copy())
    return np.concatenate(counts), np.concatenate(status)


def _table(changes: dict[str, dict[str, Any]]) -> str:
    rows = [
        (unit, _change(new, "frequency", "hz"), _change(new, "offset_x", "ut"),
         _change(new, "offset_y", "ut"), f"{new['axial_ut']:.0f}")
        for unit, new in list(changes.items())[:SHOWN]
    ]  # fmt: skip
    lines = columns(("unit", "frequency, Hz", "Bx, µT", "By, µT", "Bz, µT"), rows)
    if len(changes) > SHOWN:
        moved = max(abs(new["frequency_hz"] - new["frequency_before_hz"])
                    for new in changes.values())  # fmt: skip
        lines.append(
            f"and {len(changes) - SHOWN} more; frequencies moved by {moved:.1f} Hz at most"
        )
    return "\n".join(lines)


def _change(new: dict[str, Any], name: str, unit: str) -> str:
    sigma = new[f"{name.partition('_')[0]}_sigma_{unit}"]
    return f"{new[f'{name}_before_{unit}']:.1f} -> {new[f'{name}_{unit}']:.1f} ± {sigma:.1f}"
