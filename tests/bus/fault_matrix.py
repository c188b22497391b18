"""Every fault on every layout over one transport: what was flagged, when, and what was counted."""

import tempfile
from collections import deque
from dataclasses import replace
from pathlib import Path

import msgspec

import topology
from bus.faults.script import ClockStep
from bus.open import open_transport
from bus.transport import Transport
from tests.bus import fault_trials as faults

STRIP = Path(topology.__file__).parent / "builtin" / "strip.toml"
LAYOUTS = ("f3t-classic", "f3t-fd16", "f3t-fd64")
CYCLES = 120
PATIENCE_S = 10.0
COUNTED_BY_UNIT = ("missing",)  # the kill of a frame silences all its units


class Lockstep(Transport):
    """Both ends of a bus as one: `receive` waits for what `send` has put on it.

    Frames get the stamps back that they were sent with, so that the faults of a seed hit the same
    frames on every transport, however long a frame takes there.
    """

    def __init__(self, near, far):
        super().__init__(far.index)
        self.near, self.far, self._stamps = near, far, deque()

    def send(self, records):
        taken = self.near.send(records)
        assert taken == records.size, f"{taken} of {records.size} frames taken"
        self._stamps.extend(records["stamp_ns"].tolist())
        return taken

    def receive(self, batch, timeout_s=0.0):
        if not self._stamps:
            return 0
        taken = self.far.receive(batch, PATIENCE_S)
        assert taken, f"{len(self._stamps)} frames lost on the way"
        stamps = [self._stamps.popleft() for _ in range(taken)]
        batch.frames["stamp_ns"][batch.count - taken :] = stamps
        return taken

    def close(self):
        self.near.close()
        self.far.close()


def skin_of(layout, interface, channel):
    """The strip of ten units, with frames of a layout."""
    text = STRIP.read_text()
    other = text.replace('layout = "f3t-classic"', f'layout = "{layout}"')
    if layout != "f3t-classic":
        other = other.replace("bitrate =", "data_bitrate = 5_000_000\nbitrate =")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"{layout}.toml")
        file.write_text(other)
        skin = topology.load(file)
    assert skin.layouts[0].name == layout
    return skin.on(interface=interface, channel=channel)


def trials_of(skin):
    """The kinds of fault of the benchmark, once each, on the units of this skin."""
    for trial in faults.trials(CYCLES):
        if trial.name.endswith(", classic"):
            continue  # the same kind again, on a skin of the benchmark's own
        fault, counter = trial.fault, trial.counter
        if fault.units:
            fault = msgspec.structs.replace(fault, units=skin.unit_names[:1])
        if isinstance(fault, ClockStep):
            fault = msgspec.structs.replace(fault, every=101)
        if trial.name.startswith("kill"):
            counter = "missing"  # a silence may be longer than the sequence numbers can tell
        yield replace(trial, fault=fault, counter=counter)


def has_crc(skin):
    """Tell whether a receiver can see that payload bits were inverted."""
    return any(signal.name == "crc" for signal in skin.layouts[0].signals)


def matrix(interface, channel):
    """Measure every kind on every layout.

    Returns
    -------
    list of dict
        Rows of `tests.bus.fault_trials`, with their `layout`, and whether the fault is `visible`.
    """
    rows = []
    for layout in LAYOUTS:
        skin = skin_of(layout, interface, channel)
        for trial in trials_of(skin):
            ends = open_transport(skin.buses[0]), open_transport(skin.buses[0])
            link = Lockstep(*ends)
            row = faults.past(trial, skin, link, link, CYCLES)
            share = skin.layouts[0].units if trial.counter in COUNTED_BY_UNIT else 1
            row["counted"] //= share
            row["due"] = trial.flag.name if trial.flag else "-"
            row["visible"] = row["counter"] != "crc" or has_crc(skin)
            rows.append({"layout": layout, **row})
    return rows


def check(rows):
    """Hold every row to: counted exactly, flagged if due, and no wrong value without a flag."""
    for row in rows:
        assert row["injected"] > 0, row
        if not row["visible"]:
            # The documented limit: CAN's own CRC ends at the controller, and a classic frame has
            # no room for another. What gets through is at most the one value that was hit.
            assert row["counted"] == 0 < row["wrong_unflagged"] <= row["injected"], row
            continue
        # four bits of a count do not tell how long a silence was: two cycles of doubt follow it
        doubted = 2 * (row["fault"] == "kill and revive" and row["layout"] == "f3t-classic")
        assert row["counted"] == row["injected"] + doubted, row
        assert row["wrong_unflagged"] == 0, row
        assert (row["cycles_to_flag"] is not None) == (row["due"] != "-"), row
        # Standing counts and a second sender are told by some cycles; all else at once.
        takes_time = row["due"] in ("FROZEN", "DUPLICATE")
        cycles = row["cycles_to_flag"] if takes_time else 0
        assert row["wrong_before_flag"] <= cycles * row["units_flagged"], row


def table(rows, title):
    """The rows as text."""
    lines = [
        title,
        f"{'fault':<20} {'layout':<12} {'put in':>6} {'counted':>7}  {'as':<20} {'flagged':>8} "
        f"{'as':<9} {'after cycles':>12} {'wrong before':>12} {'wrong unflagged':>15}",
    ]
    for row in rows:
        after = "-" if row["cycles_to_flag"] is None else row["cycles_to_flag"]
        flagged = f"{row['units_flagged']} of {row['units']}"
        lines.append(
            f"{row['fault']:<20} {row['layout']:<12} {row['injected']:>6} {row['counted']:>7}  "
            f"{row['counter']:<20} {flagged:>8} {row['due']:<9} {after:>12} "
            f"{row['wrong_before_flag']:>12} {row['wrong_unflagged']:>15}"
        )
    return "\n".join(lines)
