"""Force and margin of each finger as bars, and the events of the last minute, both as HTML."""

from __future__ import annotations

from collections import deque
from html import escape

import numpy as np

from skin.contact.record import SlipState
from skin.io.messages.record import contacts_of
from skin.view.colour import valid
from skin.view.drawing import SLIP_COLOURS, Pose, margin_text
from skin.view.health import flagged, table_html
from topology import Topology

__all__ = ["Events", "Fingers"]

KEPT_NS = 60_000_000_000
SHOWN = 6
"""Events that are named: above the fold of a window of 900 pixels with six fingers."""


class Fingers:
    """The parts of a skin, by names that `State.patch` knows: its patches, those on one frame or
    link together."""

    def __init__(self, topology: Topology) -> None:
        patches = topology.patch_names
        carried = zip(topology.patch_frames or patches, patches, strict=True)
        alone = {"skin", *patches}
        of_patch = np.array([patch if frame in alone else frame for frame, patch in carried])
        self.names = list(dict.fromkeys(of_patch.tolist()))
        self._units = [np.flatnonzero(of_patch[topology.patch] == name) for name in self.names]

    def forces(self, record: np.void, pose: Pose) -> list[tuple[str, float, np.ndarray]]:
        """Of each: name, force of its units in contact, N, and its CONTACT records."""
        contacts, found = contacts_of(record), []
        at = record["contact"]
        heard = valid(record) & (at >= 0) & (at < contacts.size)
        for name, units in zip(self.names, self._units, strict=True):
            own = units[heard[units]]
            force = np.einsum("abn,bn->a", pose.rotation[:, :, own], record["force"][:, own])
            touching = np.unique(record["contact"][own])
            found.append((name, float(np.linalg.norm(force)), contacts[touching]))
        return found

    def html(self, record: np.void, pose: Pose, full_n: float) -> str:
        """A bar for each, `full_n` newton long at most, in the colour of the worst slip."""
        rows = []
        for name, force_n, contacts in self.forces(record, pose):
            slip, text = SlipState.UNKNOWN, f"{force_n:.2f} N"
            if contacts.size:
                slip = SlipState(int(contacts["slip"].max()))
                least = contacts[np.argmin(np.nan_to_num(contacts["margin_at_least"], nan=np.inf))]
                text += f" {slip.name.lower()} {margin_text(least)}"
            width = 100.0 * min(force_n / full_n, 1.0)
            rows.append(
                f'<span>{escape(name)}</span><span style="background:#20262d;height:0.8em">'
                f'<span style="display:block;height:100%;width:{width:.0f}%;'
                f'background:rgb{SLIP_COLOURS[slip]}"></span></span><span>{text}</span>'
            )
        return (
            '<div style="display:grid;grid-template-columns:auto 6em 1fr;gap:0.15em 0.7em;'
            'padding:0.3em 0.9em;font-size:0.78em;align-items:center">' + "".join(rows) + "</div>"
        )


class Events:
    """Contacts that begin and end, slips and faults, as the snapshots of the last minute show them;
    a contact between two snapshots, of less than 33 ms, is not among them."""

    def __init__(self, topology: Topology) -> None:
        self._names = topology.unit_names
        self._kept: deque[tuple[int, str]] = deque()
        self._slips: dict[int, SlipState] = {}
        self._faults: dict[str, str] | None = None

    def add(self, record: np.void) -> None:
        """Compare a snapshot with the one before."""
        now_ns, found = int(record["stamp_ns"]), list[str]()
        if record["cycle"] < 0:
            return
        contacts = contacts_of(record)
        slips = {int(one["id"]): SlipState(int(one["slip"])) for one in contacts}
        for one in contacts:
            slip, before = slips[int(one["id"])], self._slips.get(int(one["id"]))
            if before is None:
                found.append(f"contact {one['id']} begins, {one['load']:.2f} N")
            if slip > max(SlipState.STICK, before or SlipState.UNKNOWN):
                found.append(f"contact {one['id']}: {slip.name.lower()} slip")
        found += [f"contact {one} ends" for one in self._slips.keys() - slips.keys()]
        faults = dict(flagged(record["status"], self._names))
        if self._faults is not None:
            new = [f"{name}: {why}" for name, why in faults.items() if name not in self._faults]
            found += new[:SHOWN] + [f"and {len(new) - SHOWN} more units"] * (len(new) > SHOWN)
            if again := len(self._faults.keys() - faults.keys()):
                found.append(f"{again} units valid again")
        self._slips, self._faults = slips, faults
        self._kept.extend((now_ns, text) for text in found)
        while self._kept and not 0 <= now_ns - self._kept[0][0] <= KEPT_NS:
            self._kept.popleft()

    def html(self, now_ns: int) -> str:
        """The newest first, with their age."""
        rows = [(f"{1e-9 * (now_ns - at_ns):.0f} s ago", text, "")
                for at_ns, text in list(self._kept)[: -SHOWN - 1 : -1]]  # fmt: skip
        return table_html(rows or [("", "no contact, slip or fault in the last minute", "")])
