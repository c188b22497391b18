"""Addresses: identifiers within their ranges, and unique places in frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from topology.address import EXTENDED, Address
from topology.report import Report
from topology.schema import Bus
from topology.source import Key, Source
from topology.wire import LAYOUTS, WireLayout

__all__ = ["DATA_IDS", "Claim", "check_clashes", "check_ids", "format_ids"]

DATA_IDS = (0x100, 0x6FF)
"""Identifiers of data frames in the project's own protocol: below are SYNC and more urgent frames,
above heartbeats (0x700) and configuration (0x7E0)."""

LARGEST_STANDARD = 0x7FF
LARGEST_EXTENDED = 0x1FFF_FFFF


@dataclass(frozen=True)
class Claim:
    """Owner of identifiers: a patch by its first_id, or one unit by its id.

    Attributes
    ----------
    key : Key
        Where in the file.
    owner : str
        "patch 'palm'" or "'palm/r3c4'".
    single : bool
        It belongs to a single unit.
    """

    key: Key
    owner: str
    single: bool


def format_ids(ids: Iterable[int]) -> str:
    """Identifiers as text for messages: "0x100 to 0x10c"."""
    low, high = min(ids := [i & ~EXTENDED for i in ids]), max(ids)
    return f"{low:#05x}" if low == high else f"{low:#05x} to {high:#05x}"


def check_ids(
    claim: Claim,
    ids: np.ndarray,
    extended: bool,
    layout: WireLayout,
    bus: Bus | None,
    bus_key: Key,
    source: Source,
    report: Report,
) -> None:
    """Report identifiers (those of all parts) that lie where data frames may not.

    Parameters
    ----------
    ids : ndarray, shape (m,), int64
        Without the bit of 29-bit ones.
    bus : Bus or None
        None where its SYNC is unknown.
    """
    low, high = int(ids.min()), int(ids.max())
    got = format_ids([low, high])
    if not extended and high > LARGEST_STANDARD:
        report.add("id-extended", source, claim.key, got=got)
        return
    if extended:
        allowed = (0, LARGEST_EXTENDED)
    else:
        own = layout.name in LAYOUTS and not layout.counts_only
        allowed = DATA_IDS if own else (0, LARGEST_STANDARD)
    if low < allowed[0] or high > allowed[1]:
        report.add("id-range", source, claim.key, low=allowed[0], high=allowed[1], got=got)
    elif bus is not None and bus.sync_id is not None and not extended and bus.sync_id in ids:
        line = source.line((*bus_key, "sync_id"))
        report.add("id-sync", source, claim.key, bus=repr(bus.name), line=line, got=got)


def check_clashes(
    address: Address,
    layouts: list[WireLayout],
    claims: list[Claim],
    bus_names: list[str],
    source: Source,
    report: Report,
) -> None:
    """Report frames and slots of two units, once for each pair of claims.

    Parameters
    ----------
    address : Address
        Of n units.
    claims : list of Claim, length n
        Owner of each.
    """
    shared: dict[tuple[Key, Key], list[tuple[int, int, bool]]] = {}
    for one, two, same_frame in _clashes(address, layouts):
        i, j = sorted((one, two), key=lambda u: claims[u].key)
        shared.setdefault((claims[i].key, claims[j].key), []).append((i, j, same_frame))
    for found in shared.values():
        i, j, same_frame = found[0]
        blamed, other = claims[j], claims[i]
        values = {
            "bus": repr(bus_names[address.bus[j]]),
            "other": other.owner,
            "line": source.line(other.key),
        }
        if same_frame and (blamed.single or other.single):
            can_id = int(address.can_id[j]) & ~EXTENDED
            report.add("duplicate-slot", source, blamed.key, slot=int(address.slot[j]), id=can_id,
                       **values)  # fmt: skip
        else:
            got = format_ids(int(address.can_id[j]) for _, j, _ in found)
            report.add("duplicate-id", source, blamed.key, got=got, **values)


def _clashes(address: Address, layouts: list[WireLayout]) -> list[tuple[int, int, bool]]:
    """Pairs of units that clash: in one slot (True), or with different frames on one id (False)."""
    key = np.stack([address.bus, address.can_id, address.layout, address.slot])
    order = np.lexsort(key[::-1])
    key = key[:, order]
    same_slot = np.flatnonzero((key[:, 1:] == key[:, :-1]).all(axis=0))
    clashes = [(int(order[s]), int(order[s + 1]), True) for s in same_slot]

    head = np.flatnonzero(np.append(True, (key[:3, 1:] != key[:3, :-1]).any(axis=0)))
    ids = np.array([layout.ids for layout in layouts])[key[2, head]]
    frame = np.repeat(head, ids)
    step = np.arange(frame.size) - np.repeat(np.cumsum(ids) - ids, ids)
    taken = np.stack([key[0, frame], key[1, frame] + step])
    turn = np.lexsort((frame, taken[1], taken[0]))
    taken, frame = taken[:, turn], frame[turn]
    same_id = np.flatnonzero((taken[:, 1:] == taken[:, :-1]).all(axis=0))
    clashes += [(int(order[frame[s]]), int(order[frame[s + 1]]), False) for s in same_id]
    return clashes
