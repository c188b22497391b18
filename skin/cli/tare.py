"""`skin tare`: the zeros of an untouched skin, into its calibration files."""

from __future__ import annotations

import sys
from itertools import islice
from typing import TYPE_CHECKING

from skin.cli import options
from skin.cli.table import end

if TYPE_CHECKING:
    import numpy as np

    from skin.live import Skin
    from topology import Topology

__all__ = ["refused", "tare"]


def tare(
    file: options.File,
    /,
    *,
    seconds: options.Listening = 2.0,
    output: options.Calibration = None,
    simulate: bool = False,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    json: options.Json = False,
) -> int:
    """Take the frequency and the lateral field of every unit as its zero, and save them.

    Nothing may touch the skin meanwhile. Every other value of the calibration files is kept. A file
    that the topology does not name yet is used once the topology has the line that is printed. If a
    unit is loaded, moving, noisy or invalid, nothing is written and the exit status is 1; a unit
    that is broken is left out by `enabled = false` in the topology file.

    Parameters
    ----------
    simulate
        tare simulated units, which nothing touches, in this process
    """
    import skin
    from skin.calibrate.files import calibration_files
    from skin.calibrate.tare import chosen
    from skin.calibrate.tare import tare as take
    from skin.errors import OptionError, ScanError
    from skin.physics.stencil import neighbours_at_rest
    from skin.sim.scenes.script import SceneFile

    options.check_seconds(seconds)
    loaded = options.load(file, bus, allow_no_calibration=True)
    if simulate and output is None and not loaded.in_process:
        raise OptionError(
            f"--output: must be given with --simulate, since {loaded.name!r} is on a real bus, "
            "whose zeros simulated ones would replace; got none"
        )
    calibration_files(loaded, chosen(loaded), output)  # refused before, not after
    scene = SceneFile(format=1, name="untouched", seconds=2.0 * seconds) if simulate else None
    with skin.open(
        loaded, options=skin.Options(want="temperature", auto_tare=False), sync=sync,
        simulate=scene, pace=not simulate,
    ) as opened:  # fmt: skip
        print(f"listening for {seconds:g} s …", file=sys.stderr, flush=True)
        counts, status = _listen(opened, seconds)
        if unsent := opened.timing.unsent:
            options.note([f"{unsent} SYNCs were not taken by the buses"])
    try:
        found = take(loaded, counts, status, rest_ut=neighbours_at_rest(loaded))
    except ScanError as error:
        return refused(str(error), loaded, json)
    changes = found.changes()
    report = {"topology": loaded.name, "units": loaded.n, "tared": len(changes),
              "cycles": len(counts), "refused": [], "changes": changes}  # fmt: skip
    written = options.named_in_file(loaded, found.write(output, simulated=simulate))
    end(report | written, json)
    return 0


def refused(message: str, topology: Topology, json: bool) -> int:
    """Print why nothing was written; the exit status."""
    print(message, file=sys.stderr)
    if json:
        end({"topology": topology.name, "refused": message.splitlines(), "files": {}}, json)
    return 1


def _listen(opened: Skin, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Counts, shape (t, c, n), and flags, shape (t, n), of the next cycles of an open skin."""
    import numpy as np

    pipeline = opened.pipeline
    cycles = islice(opened, max(1, round(seconds * opened.topology.cycle_rate_hz)))
    taken = [(pipeline.counts.copy(), pipeline.status.copy()) for _ in cycles]
    counts, status = zip(*taken, strict=True)
    return np.stack(counts), np.stack(status)
