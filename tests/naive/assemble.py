"""Slow, obvious reference: classic frames, one unit each, on one bus whose SYNC they echo."""

import itertools

from tests.naive.bus import read
from topology import CHANNELS, LAYOUTS

LAYOUT = LAYOUTS["f3t-classic"]
RANGE = 16


def assemble(records, units, first_id=0x100, sync_id=0x80, stale_cycles=5):
    """Return the cycles, as dicts, and the totals of a stream of SYNCs and data frames."""
    totals = dict.fromkeys(("data", "sync", "late", "repeated", "lost"), 0)
    known = {u: {"counts": [0] * len(CHANNELS), "cycle": None} for u in range(units)}
    missed = dict.fromkeys(range(units), 0)
    dropped = dict.fromkeys(range(units), 0)
    heard = dict.fromkeys(range(units), 0)
    newest = dict.fromkeys(range(units), -1)
    arrivals = {u: [] for u in range(units)}
    usual = dict.fromkeys(range(units), 1)
    calm = dict.fromkeys(range(units), 0)
    doubt = dict.fromkeys(range(units), "none")
    number, came, waits, is_open = None, {}, set(), False
    cycles = []

    def close(why):
        nonlocal is_open
        is_open = False
        for u in range(units):
            if u in came:
                known[u] = {"counts": came[u], "cycle": number}
                missed[u] = 0
            else:
                missed[u] += 1
            judge(u)
        cycles.append(
            {
                "number": number,
                "closed_by": why,
                "counts": [list(known[u]["counts"]) for u in range(units)],
                "age": [
                    -1 if known[u]["cycle"] is None else number - known[u]["cycle"]
                    for u in range(units)
                ],
            }
        )

    def rate(u):
        """Cycles to which frames of the unit belong, from one to the next."""
        every = 1
        for (before, _), (cycle, count) in itertools.pairwise(arrivals[u]):
            if count <= usual[u] and cycle > before:
                every = cycle - before if before >= 0 else 1
        return every

    def judge(u):
        """Whether the unit is to be believed, by how many frames came when."""
        when = [cycle for cycle, _ in arrivals[u][-1:] if cycle >= 0]
        every = rate(u)
        if not heard[u]:
            if when and number - when[-1] >= max(RANGE, 2 * every + 1):
                doubt[u], calm[u] = "old", 0
            return
        counts = [count for _, count in arrivals[u]] + [heard[u]]
        if len(counts) > 16 and len(set(counts[-17:])) == 1:
            usual[u] = heard[u]
        elif doubt[u] == "none":
            usual[u] = max(usual[u], min([*counts[-2:], heard[u]] if len(counts) > 1 else [0]))
        after = newest[u] - when[-1] if when else 1
        if heard[u] > usual[u]:
            calm[u] = 0
        elif after > 0:
            calm[u] = 1 if after > every else calm[u] + 1
        arrivals[u].append((newest[u], heard[u]))
        if doubt[u] != "none":
            doubt[u] = "over" if calm[u] >= 2 else "old"
            if u in came and heard[u] <= usual[u] + 1:
                doubt[u] = "none"
        heard[u] = 0

    for record in records:
        data = record["data"][: record["length"]].tolist()
        if record["id"] == sync_id:
            totals["sync"] += 1
            step = 0 if number is None else (data[0] - number) % 256
            if number is not None and step == 0:
                continue
            if is_open:
                close("sync")
            if step > stale_cycles:
                for u in range(units):
                    known[u]["restarted"] = True
                    dropped[u] = 0
            number = data[0] if number is None else number + step
            came, is_open = {}, True
            waits = {
                u
                for u in range(units)
                if missed[u] < stale_cycles
                or doubt[u] == "over"
                or any(number == cycle + rate(u) for cycle, _ in arrivals[u][-1:] if cycle >= 0)
            }
            continue
        u = int(record["id"]) - first_id
        heard[u] += 1
        values = {s.name: read(s, data) for s in LAYOUT.signals}
        if number is not None:
            newest[u] = max(newest[u], number - (number - values["sequence"]) % RANGE)
        if doubt[u] == "old":
            totals["late"] += 1
            dropped[u] += 1
            continue
        last = None if known[u].get("restarted") else known[u]["cycle"]
        if u in came:
            last = number
        behind = None if number is None else (number - values["sequence"]) % RANGE
        if behind is None:
            totals["late"] += 1
            dropped[u] += 1
        elif last == number - behind:
            totals["repeated"] += 1
        elif behind or not is_open:
            totals["late"] += 1
            dropped[u] += 1
            if behind == 0:
                missed[u] = 0
        else:
            asked = 0 if last is None else sum(last < one["number"] < number for one in cycles)
            if asked < RANGE // 2:
                totals["lost"] += max(0, asked - dropped[u])
            dropped[u] = 0
            totals["data"] += 1
            came[u] = [values.get(name, 0) for name in CHANNELS]
            if u in waits:
                waits.remove(u)
                if not waits:
                    close("complete")
    if is_open:
        close("end")
    return cycles, totals
