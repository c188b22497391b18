"""`skin tare`: the zeros of an untouched skin, into its calibration files."""

from __future__ import annotations

import json as json_text
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from skin.cli import options

if TYPE_CHECKING:
    import numpy as np

    from bus.cycle import RawCycle
    from skin.sim.truth import Truth
    from topology import Topology

__all__ = ["Heard", "Ticks", "refused", "tare"]

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
    interface: options.Interface = None,
    channel: options.Channel = None,
    sync: options.Sync = "host",
    json: options.Json = False,
) -> int:
    """Take the frequency and the lateral field of every unit as its zero, and save them.

    Nothing may touch the skin meanwhile. Every other value of the calibration files is kept. A file
    that the topology does not name yet is used once it has the line that is printed, or with
    --write added. If a unit is loaded, moving, noisy or invalid, nothing is written and the exit
    status is 1.
    """
    from skin.calibrate.tare import calibration_files, chosen
    from skin.calibrate.tare import tare as take
    from skin.compiling import announcer
    from skin.errors import ScanError
    from skin.physics.stencil import neighbours_at_rest
    from topology import load

    options.check_seconds(seconds)
    announcer()
    loaded = load(file, allow_no_calibration=True).on(interface=interface, channel=channel)
    for unit in leave_out:
        loaded.unit_index(unit)
    if simulate:
        options.refuse_simulated(loaded, output)
    calibration_files(loaded, chosen(loaded, leave_out), output)  # refused before, not after
    counts, status = _listen(loaded, seconds, sync, simulate)
    try:
        found = take(
            loaded, counts, status, rest_ut=neighbours_at_rest(loaded), leave_out=leave_out
        )
    except ScanError as error:
        return refused(str(error), loaded, json)
    changes = found.changes()
    files = {
        patch: path.resolve() for patch, path in found.write(output, simulated=simulate).items()
    }
    print(_table(changes))
    for patch, path in files.items():
        print(f"{patch}: written to {path}")
    lines = options.named_in_file(loaded, files, write)
    if json:
        report = {"topology": loaded.name, "units": loaded.n, "tared": len(changes),
                "cycles": len(counts), "refused": [], "changes": changes,
                "files": {patch: str(path) for patch, path in files.items()},
                "lines": lines}  # fmt: skip
        print(json_text.dumps(report))
    return 0


def refused(message: str, topology: Topology, json: bool) -> int:
    """Print why nothing was written; the exit status."""
    print(message, file=sys.stderr)
    if json:
        report = {"topology": topology.name, "refused": message.splitlines(), "files": {}}
        print(json_text.dumps(report))
    return 1


class Heard:
    """Counts and flags of every cycle that `bus.discover.listen` hears."""

    def __init__(self, topology: Topology, clock: Callable[[], int]) -> None:
        import numpy as np

        from bus.assemble import Assembler

        self.topology, self.sends_sync, self.closed = topology, False, ""
        self.unsent = np.zeros(len(topology.buses), np.int64)
        self.counts: list[np.ndarray] = []
        self.status: list[np.ndarray] = []
        self._assembler = Assembler(topology, clock=clock)

    def feed(self, frames: np.ndarray) -> None:
        for cycle in self._assembler.feed(frames):
            self._keep(cycle)

    def expire(self, now_ns: int) -> None:
        self._keep(self._assembler.expire(now_ns) or self._assembler.silence(now_ns))

    def finish(self) -> None:
        self._keep(self._assembler.flush())

    def _keep(self, cycle: RawCycle | None) -> None:
        if cycle is not None:
            self.counts.append(cycle.counts.copy())
            self.status.append(cycle.status.copy())


def _listen(
    topology: Topology, seconds: float, sync: Literal["host", "bus"], simulate: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Counts, shape (t, c, n), and flags, shape (t, n), of all cycles of that time."""
    import numpy as np

    import skin
    from bus.discover import listen
    from bus.errors import BusClosedError
    from topology import CHANNELS

    # simulated units answer at once: nobody need wait for them, but where they send on their own
    synced = all(bus.sync_id is not None for bus in topology.buses)
    clock = Ticks(topology.cycle_rate_hz) if simulate and synced else time.monotonic_ns
    recording = Heard(topology, clock)
    scene = _Untouched(topology.n) if simulate else None
    with skin.open(
        topology, want="temperature", auto_tare=False, sync=sync, simulate=scene
    ) as opened:
        print(f"listening for {seconds:g} s …", file=sys.stderr, flush=True)
        listen(recording, opened.transports, seconds, sync=sync, clock=clock)
    if unsent := int(recording.unsent.sum()):
        print(f"note: {unsent} SYNCs were not taken by the buses", file=sys.stderr)
    if recording.closed:
        raise BusClosedError(recording.closed)
    if not recording.counts:
        return np.zeros((0, len(CHANNELS), topology.n), np.int16), np.zeros(
            (0, topology.n), np.uint16
        )
    return np.stack(recording.counts), np.stack(recording.status)


class Ticks:
    """A clock that goes on by a third of a cycle whenever `listen` looks at it, thrice a cycle."""

    def __init__(self, rate_hz: float) -> None:
        self._now_ns, self._step_ns = 0, round(1e9 / (3.0 * rate_hz))

    def __call__(self) -> int:
        self._now_ns += self._step_ns
        return self._now_ns


class _Untouched:
    """A scene in which nothing happens."""

    def __init__(self, n: int) -> None:
        from skin.sim.truth import Truth

        self._truth = Truth.at_rest(n, 24.0)

    def at(self, time_s: float) -> Truth:
        self._truth.time_s = time_s
        return self._truth


def _table(changes: dict[str, dict[str, Any]]) -> str:
    wide = max(map(len, changes))
    lines = [f"{'unit':<{wide}}  {'frequency, Hz':>24}  {'Bx, µT':>22}  {'By, µT':>22}  Bz, µT"]
    for unit, new in list(changes.items())[:SHOWN]:
        frequency = (
            f"{new['frequency_before_hz']:.1f} -> {new['frequency_hz']:.1f}"
            f" ± {new['frequency_sigma_hz']:.1f}"
        )
        fields = [
            f"{new[f'offset_{axis}_before_ut']:.0f} -> {new[f'offset_{axis}_ut']:.0f}"
            f" ± {new['offset_sigma_ut']:.0f}"
            for axis in "xy"
        ]
        lines.append(
            f"{unit:<{wide}}  {frequency:>24}  {fields[0]:>22}  {fields[1]:>22}  "
            f"{new['axial_ut']:.0f}"
        )
    if len(changes) > SHOWN:
        moved = max(abs(new["frequency_hz"] - new["frequency_before_hz"])
                    for new in changes.values())  # fmt: skip
        lines.append(
            f"and {len(changes) - SHOWN} more; frequencies moved by {moved:.1f} Hz at most"
        )
    return "\n".join(lines)
