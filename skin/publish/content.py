"""What the messages of a skin say: from a record of the loop to the fields of each message."""

from __future__ import annotations

from typing import Any

import numpy as np

from bus.state import BusState
from bus.status import INVALID, Status
from skin.contact.record import Flag
from skin.messages import STATE_VERSION
from skin.publish.snapshot import BUS_STATES, COUNTERS, MOST_CONTACTS, contacts_of

__all__ = ["Slots", "diagnostics", "layout", "silence", "state", "transforms", "wrench"]

OK, WARN, ERROR, STALE = 0, 1, 2, 3
"""Levels of diagnostic_msgs/DiagnosticStatus."""
LISTED = 32
"""Units that a diagnosis names; of more, it tells how many there are."""

Message = dict[str, Any]
XYZ = ("x", "y", "z")
OF_SLIP = ("stick_ratio", "friction", "friction_sigma", "margin", "slip_probability", "grip_force",
           "grip_force_sigma")  # fmt: skip
"""Numbers of a contact that go into its message as they are."""


def header(stamp_ns: int, frame: str) -> Message:
    """A std_msgs/Header."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def vector(values: np.ndarray) -> dict[str, float]:
    """A Vector3 or Point."""
    return dict(zip(XYZ, values.tolist(), strict=True))


def wrench(stamp_ns: int, frame: str, values: np.ndarray) -> Message:
    """A geometry_msgs/WrenchStamped of force and moment about the origin of the frame."""
    return {"header": header(stamp_ns, frame), "wrench": _wrench(values)}


def _wrench(values: np.ndarray) -> Message:
    return {"force": vector(values[:3]), "torque": vector(values[3:])}


def state(record: np.void, frame: str) -> Message:
    """An f3t_msgs/SkinState: NaN for what is not valid, but for the test ratio, which says why."""
    bad = ~record["valid"]
    force, sigma = record["force"].copy(), record["force_sigma"].copy()
    temperature = record["temperature"].copy()
    force[:, bad], sigma[:, bad], temperature[bad] = np.nan, np.nan, np.nan
    return {
        "header": header(int(record["stamp_ns"]), frame), "version": STATE_VERSION,
        "cycle": int(record["cycle"]), "force": force.reshape(-1), "force_sigma": sigma.reshape(-1),
        "temperature": temperature, "test_ratio": record["test_ratio"],
        "status": record["status"], "contact": record["label"], "whole": bool(record["whole"]),
        "contacts": [_contact(one) for one in contacts_of(record)],
    }  # fmt: skip


def _contact(one: np.void) -> Message:
    return {
        "id": int(one["id"]), "wrench": _wrench(one["wrench"]),
        "wrench_sigma": one["wrench_sigma"], "centroid": vector(one["centroid"]),
        "normal": vector(one["normal"]), "slip": int(one["slip"]),
        **{name: float(one[name]) for name in OF_SLIP},
        "units": int(one["end"] - one["begin"]), "whole": not one["flags"] & Flag.UNSEEN,
    }  # fmt: skip


def layout(stamp_ns: int, frame: str, request: Message) -> Message:
    """An f3t_msgs/SkinLayout, as the topology file places the units."""
    names = ("topology", "names", "patches", "patch", "position", "rotation")
    return {"header": header(stamp_ns, frame)} | {name: request[name] for name in names}


def transforms(stamp_ns: int, frame: str, children: list[str], poses: np.ndarray) -> Message:
    """A tf2_msgs/TFMessage: where patches are in the frame of the skin.

    Parameters
    ----------
    poses : ndarray, shape (p, 7)
        As of `skin.publish.snapshot.patch_poses`.
    """
    told = []
    for child, pose in zip(children, poses, strict=True):
        turn = dict(zip((*XYZ, "w"), pose[3:].tolist(), strict=True))
        told.append(
            {"header": header(stamp_ns, frame), "child_frame_id": child,
             "transform": {"translation": vector(pose[:3]), "rotation": turn}}
        )  # fmt: skip
    return {"transforms": told}


class Slots:
    """A number for each contact, the lowest that is free, the same as long as it lasts."""

    def __init__(self) -> None:
        self._slots: dict[int, int] = {}

    def take(self, contacts: np.ndarray) -> tuple[list[tuple[int, np.void]], list[int]]:
        """Contacts with their slots, and slots whose contacts have ended."""
        present = {int(one["id"]): one for one in contacts}
        ended = [self._slots.pop(one) for one in list(self._slots) if one not in present]
        taken = set(self._slots.values())
        for identity in present:
            if identity not in self._slots:
                slot = next(number for number in range(len(taken) + 1) if number not in taken)
                taken.add(slot)
                self._slots[identity] = slot
        again = [slot for slot in ended if slot not in taken]
        return [(self._slots[identity], one) for identity, one in present.items()], again


def diagnostics(record: np.void, before: np.void | None, request: Message) -> Message:
    """A diagnostic_msgs/DiagnosticArray: units that are not to be trusted, frames that were lost
    since the diagnosis before, how each bus is.

    Parameters
    ----------
    record, before : void
        A record that is noted, and the one before it.
    request : dict
        ``name`` of the skin, ``topology``, ``names`` of the units, ``buses``.
    """
    told = [_units(record, request), _frames(record, before, request)]
    told += [
        _bus(at, bus, record, before, request) for at, bus in enumerate(request["buses"])
    ]  # fmt: skip
    return {"header": header(int(record["stamp_ns"]), ""), "status": told}


def silence(stamp_ns: int, seconds: float, request: Message) -> Message:
    """A diagnostic_msgs/DiagnosticArray of a skin that has no cycles."""
    told = _status(request, "units", STALE, f"no cycle for {seconds:.0f} s", {})
    return {"header": header(stamp_ns, ""), "status": [told]}


def _units(record: np.void, request: Message) -> Message:
    flags = record["status"] & int(INVALID)
    flagged, names = np.flatnonzero(flags), request["names"]
    values = {names[i]: str(Status(int(flags[i])).name) for i in flagged[:LISTED]}
    if flagged.size > LISTED:
        values["further units"] = str(flagged.size - LISTED)
    level = OK if not flagged.size else ERROR if flagged.size == flags.size else WARN
    text = f"{flagged.size} of {flags.size} units are not to be trusted"
    return _status(request, "units", level, text if flagged.size else "all units are fine", values)


def _frames(record: np.void, before: np.void | None, request: Message) -> Message:
    counts = dict(zip(COUNTERS, record["counters"].tolist(), strict=True))
    counts["overruns"], counts["left_out"] = int(record["overruns"]), int(record["left_out"])
    harmful = ("lost", "late", "torn", "crc", "short", "overruns", "left_out")
    old = dict.fromkeys(harmful, 0)
    if before is not None:
        of_before = dict(zip(COUNTERS, before["counters"].tolist(), strict=True))
        of_before |= {"overruns": int(before["overruns"]), "left_out": int(before["left_out"])}
        old = {name: of_before[name] for name in harmful}
    new = {name: counts[name] - old[name] for name in harmful if counts[name] > old[name]}
    text = ", ".join(f"{name} {count}" for name, count in new.items()) or "no frame was lost"
    counts["contacts_left_out"] = max(0, int(record["count"]) - MOST_CONTACTS)
    values = {name: str(count) for name, count in counts.items()}
    return _status(request, "frames", WARN if new else OK, text, values)


def _bus(at: int, bus: str, record: np.void, before: np.void | None, request: Message) -> Message:
    how, lost = BUS_STATES[record["bus_state"][at]], int(record["lost"][at])
    new = lost - (0 if before is None else int(before["lost"][at]))
    level = OK if how is BusState.ACTIVE else WARN if how is BusState.WARNING else ERROR
    text = str(how) + (f", {new} frames lost on this host" if new else "")
    values = {"state": str(how), "lost on this host": str(lost)}
    return _status(request, f"bus {bus}", max(level, WARN if new else OK), text, values)


def _status(request: Message, name: str, level: int, text: str, values: dict[str, str]) -> Message:
    return {
        "level": level, "name": f"{request['name']}: {name}", "message": text,
        "hardware_id": request["topology"],
        "values": [{"key": key, "value": value} for key, value in values.items()],
    }  # fmt: skip
