"""`skin check`: what a topology file says, and whether its buses can carry it."""

from __future__ import annotations

import json as json_text
from typing import TYPE_CHECKING, Annotated

from skin.cli import options
from skin.cli.table import columns

if TYPE_CHECKING:
    from topology import Topology
    from topology.summary import BusSummary, PatchSummary, Summary

__all__ = ["check"]

MOST_UNITS = 2000
"""Units of which the fields at each other's chips are looked at: more take some seconds."""


def check(
    file: options.FileOrNone = None,
    /,
    *,
    json: options.Json = False,
    schema: Annotated[
        bool, options.quiet("print the JSON Schema of topology files, for your editor")
    ] = False,
) -> int:
    """Check a topology file: units, identifiers, frames, and the load of each bus at worst.

    Exits with 1 if a bus cannot carry its cycle rate, or if units are nearer to each other than
    their magnets allow. If the file is wrong, exits with 2, after every problem with its line.
    """
    import msgspec

    from topology.json_schema import json_schema
    from topology.load import load
    from topology.summary import summary

    if schema:
        print(json_text.dumps(json_schema(), indent=2))
        return 0
    file = options.given(file, "check")
    loaded = load(file, allow_overload=True)
    found = summary(loaded)
    print(_table(found))
    for hint in options.hints(file, loaded):
        print(f"\nnote: {hint}")
    too_dense = _too_dense(loaded)
    for line in too_dense:
        print(f"\n{line}")
    ok = found.ok and not too_dense
    if json:
        more = {
            "never_tared": options.never_tared(loaded),
            "uncalibrated": options.uncalibrated(loaded),
            "too_dense": too_dense,
            "ok": ok,
        }
        print(json_text.dumps(msgspec.to_builtins(found) | more))
    return 0 if ok else 1


def _too_dense(topology: Topology) -> list[str]:
    """What `skin.open` would refuse, as units are too near to each other."""
    from skin.decode.spacing import far_apart

    if far_apart(topology):
        return []
    if topology.n > MOST_UNITS:
        print(f"\nnote: whether {topology.n} units are too near to each other is seen at opening")
        return []
    from skin.compiling import announcer
    from skin.decode.density import sparse_enough
    from skin.errors import TooDenseError

    announcer()
    try:
        sparse_enough(topology)
    except TooDenseError as error:
        return str(error).splitlines()
    return []


def _table(found: Summary) -> str:
    disabled = f", {found.disabled} disabled" if found.disabled else ""
    lines = [
        f"{found.name}: {found.units} units{disabled}, {found.frames} frames a cycle, "
        f"{found.neighbours:.1f} neighbours a unit",
        "",
        *columns(["bus", "units", "frames", "ids", "cycle", "load", "limit", "at most"],
                  [_bus_row(bus) for bus in found.buses]),
        "",
        *columns(["patch", "units", "layout", "bus", "ids", "nearest"],
                  [_patch_row(patch) for patch in found.patches]),
    ]  # fmt: skip
    for text in found.warnings:
        lines += ["", f"note: {text}"]
    for bus in found.buses:
        if not bus.ok:
            lines += [
                "",
                f"bus {bus.name!r} cannot carry {bus.cycle_rate_hz:g} Hz: worst-case load "
                f"{bus.load:.1%}, limit {bus.max_load:.1%}",
            ]
    return "\n".join(lines)


def _bus_row(bus: BusSummary) -> list[str]:
    rate = "" if bus.highest_rate_hz is None else f"{bus.highest_rate_hz:.1f} Hz"
    return [bus.name, str(bus.units), str(bus.frames), _ids(bus.ids), f"{bus.cycle_ms:.3f} ms",
            f"{bus.load:.1%} at {bus.cycle_rate_hz:g} Hz", f"{bus.max_load:.1%}", rate]  # fmt: skip


def _patch_row(patch: PatchSummary) -> list[str]:
    off = f" ({patch.disabled} off)" if patch.disabled else ""
    near = "" if patch.nearest_mm is None else f"{patch.nearest_mm:.2f} mm"
    return [patch.name, f"{patch.units}{off}", ", ".join(patch.layouts), ", ".join(patch.buses),
            _ids(patch.ids), near]  # fmt: skip


def _ids(ids: tuple[int, int] | None) -> str:
    return "" if ids is None else f"{ids[0]:#05x}–{ids[1]:#05x}"
