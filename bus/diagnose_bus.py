"""The doctor's rules about one bus: silent, unknown, invalid and lost frames; boards, and their
serial numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from bus.boards import compare_serials, of_boards
from bus.discover import STALE_CYCLES, Heard, Survey
from bus.frame import CAN_EFF
from bus.heartbeat import FIRST_ID, LAST_ID, PERIOD_S, heartbeat_nodes, node_numbers
from bus.status import Status
from topology import Bus
from topology.wire import LAYOUTS

__all__ = ["LONG_SILENCE", "BusRules", "Finding", "identities", "other_serials", "some"]

Row = int | np.integer | np.ndarray

LONG_SILENCE = 20
"""Consecutive cycles without a reading that are more than losses."""
_RATE_TOLERANCE = 0.1
PATIENCE_S = 2.5 * PERIOD_S
"""Silence after which a heartbeat is missing."""
_HEARTBEATS = range(FIRST_ID, LAST_ID + 1)


@dataclass(frozen=True)
class Finding:
    """One fault or deviation.

    Attributes
    ----------
    code : str
        Kind of finding: "missing-unit", "silent-branch", …
    severity : "error" or "warning"
        An error costs readings now; a warning may.
    subject : str
        Bus, unit, identifier or host.
    count : int
        Occurrences: frames, units or cycles, as stated in the text.
    text : str
        Observation and expectation.
    likely_cause : str
        What to check first.
    """

    code: str
    severity: Literal["error", "warning"]
    subject: str
    count: int
    text: str
    likely_cause: str

    def __str__(self) -> str:
        return f"{self.subject}: {self.text}. Likely cause: {self.likely_cause}"


def hex_id(can_id: int) -> str:
    return f"0x{can_id & ~CAN_EFF:08X}" if can_id & CAN_EFF else f"0x{can_id:03X}"


def some(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def frame_kind(is_fd: bool) -> str:
    return "CAN FD" if is_fd else "classic"


def rates(bus: Bus) -> str:
    data = "" if bus.data_bitrate is None else f" and {bus.data_bitrate / 1e6:g} Mbit/s for data"
    return f"{bus.bitrate / 1e6:g} Mbit/s{data}"


class BusRules:
    """The rules about one bus.

    Parameters
    ----------
    survey : Survey
    index : int
        Of the bus.
    instead : int, optional
        Bus whose units are received here, instead of this bus's own.
    """

    def __init__(self, survey: Survey, index: int, instead: int | None = None) -> None:
        self.survey, self.index, self.instead = survey, index, instead
        self.skin = survey.topology
        self.bus = self.skin.buses[index]
        self.name = f"bus {self.bus.name!r}"
        self.rows = np.flatnonzero(self.skin.frames.bus == index)
        self.ids = [int(can_id) for can_id in self.skin.frames.can_id[self.rows]]
        self.here = {kind: n for kind, n in survey.heard.items() if kind.bus == index}
        heard = {kind.can_id for kind in self.here}
        self.never = np.array([can_id not in heard for can_id in self.ids], bool)
        self.fell = np.array([self._has_fallen(row) for row in self.rows], bool) & ~self.never
        self.enabled = np.array([self._is_enabled(row) for row in self.rows], bool)
        self.gone = (self.never | self.fell) & self.enabled
        self.interrupted = np.array([self._has_come_back(row) for row in self.rows], bool)
        self.slow = np.zeros(self.rows.size, bool)
        """Frames at a constant but wrong rate: no losses."""
        of_other = self.skin.frames.can_id[self.skin.frames.bus == instead].tolist()
        self.known = {*self.ids, self.skin.sync_id, *_HEARTBEATS, *of_other}
        self.unknown = self._unknown_ids()

    def findings(self) -> Iterator[Finding]:
        """All findings of this bus."""
        yield from self._errors()
        yield from self._sync()
        if self.instead is not None:
            yield from self._unknown()
            return
        yield from self._silence()
        yield from self._unknown()
        yield from self._shape()
        yield from self._rate()
        yield from self._losses()
        yield from board_findings(self.survey, self.index, self.never | self.fell)

    # -- rows of this bus ---------------------------------------------------------

    def _units(self, row: Row) -> np.ndarray:
        units = self.skin.frames.units[row]
        return units[units >= 0]

    def _is_enabled(self, row: Row) -> bool:
        return bool(self.skin.enabled[self._units(row)].any())

    def _has_fallen(self, row: Row) -> bool:
        age = self.survey.age[self._units(row)]
        return age.size > 0 and bool((age >= STALE_CYCLES).all())

    def _has_come_back(self, row: Row) -> bool:
        return self.survey.longest_age[self._units(row)].max(initial=0) >= LONG_SILENCE

    def _frame(self, place: Row) -> str:
        """A frame of this bus as text, by its units."""
        units = [self.skin.unit_names[u] for u in self._units(self.rows[place])]
        names = units[0] if len(units) == 1 else f"{units[0]} … {units[-1]}"
        return f"{names} ({hex_id(self.ids[place])})"

    def _unknown_ids(self) -> list[int]:
        """Unknown identifiers with frames of the size of a layout, no more than missing ones."""
        sizes = {(layout.size, layout.fd) for layout in self.skin.layouts}
        known = self.known.union(self.skin.frames.can_id.tolist())
        found = {kind.can_id: n for kind, n in self.here.items()
                 if kind.can_id not in known and (kind.length, kind.is_fd) in sizes}  # fmt: skip
        missing = len({i for i, gone in zip(self.ids, self.gone, strict=True) if gone})
        return sorted(found, key=lambda i: -found[i])[:missing]

    # -- rules ---------------------------------------------------------------------------------

    def _errors(self) -> Iterator[Finding]:
        errors = self.survey.errors[self.index]
        count = sum(errors.values())
        if not count:
            return
        words, most = max(errors.items(), key=lambda item: item[1])
        if not self.survey.traffic[self.index]:
            yield Finding(
                "wrong-bitrate", "error", self.name, count,
                f"{some(count, 'error frame')} ({words}) and not a single frame",
                f"another bit rate than {rates(self.bus)} on this host or on the units; else "
                "CAN_H and CAN_L swapped, or nobody else on the bus to acknowledge",
            )  # fmt: skip
        else:
            yield Finding(
                "bus-errors", "warning", self.name, count,
                f"{some(count, 'error frame')} between the others, most often ({most}): {words}",
                "termination (120 ohm at both ends, and no more), a bad contact, or a unit with "
                "another sample point or data bit rate",
            )  # fmt: skip

    def _sync(self) -> Iterator[Finding]:
        if self.skin.sync_id is None:
            return
        survey, b = self.survey, self.index
        foreign, syncs = int(survey.foreign_syncs[b]), int(survey.syncs[b])
        empty = sum(n for kind, n in self.here.items()
                    if kind.can_id == self.skin.sync_id and not kind.length)  # fmt: skip
        if 0 < empty < syncs:
            foreign, syncs = foreign - empty, syncs - empty
            yield Finding(
                "foreign-sync", "warning", self.name, empty,
                f"{some(empty, 'SYNC')} ({hex_id(self.skin.sync_id)}) without a counter, which "
                "cycles leave out",
                "a CANopen master, whose SYNC has this identifier and which units may answer too: "
                "give one of them another (`sync_id` of the file, or object 1005h)",
            )  # fmt: skip
        if unsent := int(survey.unsent[b]):
            yield Finding(
                "unsent-sync", "error", self.name, unsent,
                f"{some(unsent, 'SYNC')} not taken by the interface, which has no room",
                "nobody on the bus acknowledges what is sent, so that it waits: no power, no "
                "cable, or another bit rate",
            )  # fmt: skip
        if survey.sends_sync and foreign:
            yield Finding(
                "second-sync", "error", self.name, foreign,
                f"{foreign} SYNCs of somebody else, in addition to this host's own",
                "another host, or a second program on this one, sends SYNC too; listen with "
                "--sync bus, or stop the other",
            )  # fmt: skip
        elif not syncs and survey.traffic[b] and not unsent:
            yield Finding(
                "no-sync", "error", self.name, 0,
                f"no SYNC ({hex_id(self.skin.sync_id)}), which units answer to",
                "nobody sends it (--sync host does), or its identifier is another one",
            )  # fmt: skip
        elif syncs and not survey.sends_sync and survey.cycles >= LONG_SILENCE and survey.seconds:
            rate_hz = syncs / survey.seconds
            if abs(rate_hz / self.skin.cycle_rate_hz - 1.0) > _RATE_TOLERANCE:
                yield Finding(
                    "wrong-rate", "warning", self.name, syncs,
                    f"SYNC comes at {rate_hz:.1f} Hz; expected {self.skin.cycle_rate_hz:g} Hz",
                    "whoever sends SYNC has another rate than cycle_rate_hz of the file",
                )  # fmt: skip

    def _silence(self) -> Iterator[Finding]:
        if not self.gone.any():
            return
        if self.gone[self.enabled].all() and self.never[self.enabled].all():
            yield from self._silent_bus()
            return
        left = self.gone.copy()
        for places, where in self._branches():
            if left[places].all():
                yield self._branch(places, where)
                left[places] = False
        for place in np.flatnonzero(left):
            count = self._units(self.rows[place]).size
            cause = "a loose plug, or a unit that has reset or lost its power"
            if self.never[place]:
                cause = "no power, a loose plug, or another address than the file says"
            node = int(node_numbers(self.skin)[self.rows[place]])
            if (self.index, node) in self.survey.boards.heard:
                cause = (
                    "another identifier than the file's, no SYNC that reaches it, or sampling that "
                    f"has stopped, as heartbeats of node {node} come"
                )
            yield Finding(
                "missing-unit", "error", self._frame(place), count,
                self._how(np.array([place])), self._cause([place], cause),
            )  # fmt: skip

    def _silent_bus(self) -> Iterator[Finding]:
        traffic, errors = self.survey.traffic[self.index], self.survey.errors[self.index]
        units = sum(self._units(row).size for row in self.rows)
        if traffic:
            cause = (
                "units without power, another first_id than the file's, or the file of another skin"
            )
            if any(bus == self.index for bus, _ in self.survey.boards.heard):
                cause = ("its boards live, by heartbeat: no SYNC that reaches them, or another "
                         "sync_id or first_id than the file's")  # fmt: skip
            yield Finding(
                "silent-bus", "error", self.name, units,
                f"none of {units} units is heard, though others send",
                self._cause(np.flatnonzero(self.enabled), cause),
            )  # fmt: skip
        elif not errors and self.bus.interface == "memory":
            yield Finding(
                "no-traffic", "error", self.name, units, "not a single frame",
                "the interface 'memory' reaches this process only; name the real one with --bus",
            )  # fmt: skip
        elif not errors:
            cause = "no power, no cable, or units that wait for a SYNC which nobody sends"
            if self.skin.sync_id is None or self.survey.sends_sync:
                cause = "no power, no cable, or the wrong channel"
            yield Finding("no-traffic", "error", self.name, units, "not a single frame", cause)

    def _branches(self) -> Iterator[tuple[np.ndarray, str]]:
        """Runs of silent frames that one cable may explain, and where they begin."""
        last = np.flatnonzero(~self.gone & self.enabled)
        if last.size:
            places = np.arange(last[-1] + 1, self.rows.size)
            places = places[self.enabled[places]]
            if places.size >= 2:
                yield places, f"all units behind {self._frame(last[-1])}"
        for patch, name in enumerate(self.skin.patch_names):
            mine = np.array([(self.skin.patch[self._units(row)] == patch).all()
                             for row in self.rows]) & self.enabled  # fmt: skip
            places = np.flatnonzero(mine)
            if places.size >= 2:
                yield places, f"all of patch {name!r}"

    def _branch(self, places: np.ndarray, where: str) -> Finding:
        units = sum(self._units(self.rows[place]).size for place in places)
        return Finding(
            "silent-branch", "error", self.name, units,
            f"{where}, {units} units on {hex_id(self.ids[places[0]])} to "
            f"{hex_id(self.ids[places[-1]])}: {self._how(places)}",
            self._cause(places, "the cable or plug between the last unit that is heard and the "
                        "first that is not, or the power of that branch"),
        )  # fmt: skip

    def _cause(self, places: Any, otherwise: str) -> str:
        """The likely cause of silent frames, by what else comes."""
        if min(len(self.unknown), len(places)) < 2:
            return otherwise
        return (
            f"other addresses than the file's, as {len(self.unknown)} unknown identifiers come "
            f"instead; else {otherwise}"
        )

    def _how(self, places: np.ndarray) -> str:
        """Never received, or silent since when."""
        if self.never[places].all():
            return "never heard"
        fallen = places[self.fell[places]]
        age = min(int(self.survey.age[self._units(self.rows[p])].min()) for p in fallen)
        return f"silent for the last {age / self.skin.cycle_rate_hz:.1f} s"

    def _unknown(self) -> Iterator[Finding]:
        ids: dict[int, list[tuple[Heard, int]]] = {}
        for kind, count in self.here.items():
            if kind.can_id not in self.known:
                ids.setdefault(kind.can_id, []).append((kind, count))
        totals = {can_id: sum(n for _, n in kinds) for can_id, kinds in ids.items()}
        for can_id in sorted(totals, key=lambda i: -totals[i]):
            count, kind = totals[can_id], ids[can_id][0][0]
            yield Finding(
                "unknown-id", "warning", f"{hex_id(can_id)} on {self.name}", count,
                f"{some(count, 'frame')}{self._at(count)} of {some(kind.length, 'byte')} that the "
                "file does not know",
                self._explain_unknown_id(can_id),
            )  # fmt: skip
        if self.index == 0 and self.survey.more_kinds:
            yield Finding(
                "unknown-id", "warning", "further identifiers", self.survey.more_kinds,
                f"{self.survey.more_kinds} frames of more kinds than are listed",
                "a device that sends with identifiers of chance: a babbling node or a fuzzer",
            )  # fmt: skip

    def _explain_unknown_id(self, can_id: int) -> str:
        frames = self.skin.frames
        for other in np.flatnonzero((frames.can_id == can_id) & (frames.bus != self.index)):
            name = self.skin.buses[frames.bus[other]].name
            return f"a unit on the wrong bus: bus {name!r} expects it"
        if can_id in self.unknown:
            return "a unit with a wrong address, since one is missing and this frame has its size"
        if self.survey.seconds and sum(self.here.values()) < 4 * sum(
            n for k, n in self.here.items() if k.can_id == can_id
        ):
            return "a babbling node: it fills a quarter of all frames"
        return "another device on the bus, or a unit that is not in the file"

    def _at(self, count: int) -> str:
        if not self.survey.seconds or count < LONG_SILENCE:
            return ""
        return f" ({count / self.survey.seconds:.1f} Hz)"

    def _shape(self) -> Iterator[Finding]:
        """Frames of another length or kind than their layout's."""
        found, fd_mismatches = [], 0
        for place in range(self.rows.size):
            if place and self.ids[place] == self.ids[place - 1]:
                continue  # another page of the same identifier
            layout = self.skin.layouts[self.skin.frames.layout[self.rows[place]]]
            kinds = {k: n for k, n in self.here.items() if k.can_id == self.ids[place]}
            wrong = {k: n for k, n in kinds.items()
                     if (k.length, k.is_fd) != (layout.size, layout.fd)}  # fmt: skip
            if not wrong:
                continue
            count, kind = sum(wrong.values()), max(wrong, key=lambda k: wrong[k])
            if kind.is_fd != layout.fd:
                fd_mismatches += 1
                found.append(self._fd_mismatch(self._frame(place), count, layout.fd))
                continue
            found.append(Finding(
                "wrong-length", "error", self._frame(place), count,
                f"{count} frames of {kind.length} bytes; expected {layout.size}",
                "another firmware, or another layout than the file's" if len(wrong) == len(kinds)
                else "a gateway or adapter that cuts frames, or a second device on this id",
            ))  # fmt: skip
        if fd_mismatches > 1 and fd_mismatches == len(set(self.ids)) - len(self._never_heard()):
            total = sum(finding.count for finding in found)
            yield self._fd_mismatch(self.name, total, found[0].text.endswith("CAN FD"))
        else:
            yield from found

    def _never_heard(self) -> set[int]:
        return {can_id for can_id, never in zip(self.ids, self.never, strict=True) if never}

    def _fd_mismatch(self, subject: str, count: int, is_fd_expected: bool) -> Finding:
        got, expected = frame_kind(not is_fd_expected), frame_kind(is_fd_expected)
        return Finding(
            "fd-mismatch", "error", subject, count, f"{count} {got} frames; expected {expected}",
            f"the units, or this host's interface, are set to {got} frames",
        )  # fmt: skip

    def _rate(self) -> Iterator[Finding]:
        """Units that send at a constant rate other than once a cycle."""
        survey, cycles = self.survey, self.survey.cycles
        if cycles < LONG_SILENCE:
            return
        if self.skin.sync_id is None:
            cycles = survey.seconds * self.skin.cycle_rate_hz
        data, lost = (survey.by_frame(kind) for kind in ("data", "lost"))
        extra = survey.by_frame("late") + survey.by_frame("repeated")
        for place, row in enumerate(self.rows):
            units = self._units(row)
            if self.gone[place] or self.interrupted[place] or not data[row]:
                continue
            share = (data[row] + extra[row]) / cycles
            divided = 1.0 / round(1.0 / share) if share <= 0.6 else 1.0
            even = self.skin.sync_id is not None and abs(share / divided - 1.0) < 0.05
            free = self.skin.sync_id is None and lost[row] < 0.5 * (cycles - data[row])
            twice = share > 1.0 + _RATE_TOLERANCE and not self._is_double(units)
            self.slow[place] = share < 1.0 - _RATE_TOLERANCE and (free or (even and divided < 1.0))
            if twice or self.slow[place]:
                yield Finding(
                    "wrong-rate", "warning", self._frame(place), int(data[row]),
                    f"sends at {share * self.skin.cycle_rate_hz:.1f} Hz; expected "
                    f"{self.skin.cycle_rate_hz:g} Hz",
                    "a unit configured to another rate" + (
                        ", or too slow to answer each SYNC" if self.skin.sync_id is not None else ""
                    ),
                )  # fmt: skip

    def _is_double(self, units: np.ndarray) -> bool:
        return bool(self.survey.flagged[Status.DUPLICATE][units].any())

    def _losses(self) -> Iterator[Finding]:
        survey = self.survey
        doubled = np.array([self._is_double(self._units(row)) for row in self.rows])
        for code, kind, text, one, many in (
            ("sequence-gaps", "lost", "frames are missing by their sequence numbers",
             "this unit's plug or supply, or its CPU is too slow",
             "the bus (errors, load) or this host loses them; compare with the other findings"),
            ("crc", "crc", "frames fail their CRC, though CAN's own was right",
             "this unit's memory or firmware, or another unit that sends with its identifier",
             "a gateway or adapter that changes frames, or a firmware with another CRC"),
            ("late", "late", "frames came after their cycle was closed",
             "this unit takes too long from SYNC to its frame",
             "the bus is too full for the cycle rate, or this host is late"),
        ):  # fmt: skip
            if kind == "late" and self.skin.sync_id is not None and not survey.syncs[self.index]:
                continue  # without a SYNC frames cannot be late
            explained = doubled | ((self.interrupted | self.slow) & (kind == "lost"))
            counts = survey.by_frame(kind)[self.rows] * ~explained
            if kind == "lost":  # a frame that came late was missed first
                counts = np.maximum(counts - survey.by_frame("late")[self.rows], 0)
            hit, total = np.flatnonzero(counts), int(counts.sum())
            if not total:
                continue
            is_one = counts.max() > 0.8 * total
            subject = self._frame(int(counts.argmax())) if is_one else self.name
            where = "" if is_one else f", of {hit.size} of {self.rows.size} identifiers"
            yield Finding(code, "warning", subject, total, f"{total} {text}{where}",
                          one if is_one else many)  # fmt: skip


def board_findings(survey: Survey, index: int, gone: np.ndarray) -> Iterator[Finding]:
    """Everything about the boards of one bus.

    Parameters
    ----------
    survey : Survey
    index : int
        Of the bus.
    gone : ndarray, shape (f,), bool
        Missing frames of this bus.
    """
    skin, seconds = survey.topology, float(survey.listened_s[index])
    frames, on = skin.frames, f"bus {skin.buses[index].name!r}"
    heard = {node: board for (bus, node), board in survey.boards.heard.items() if bus == index}
    expected = heartbeat_nodes(skin, index)
    layouts = frames.layout[(frames.bus == index) & (frames.part == 0)]
    talking = set(node_numbers(skin)[frames.bus == index][~gone].tolist())

    def named(node: int) -> str:
        return f"node {node} ({hex_id(FIRST_ID + node)}) on {on}"

    for node in sorted(talking.intersection(expected)):
        # boards with frames of another project send heartbeats or not
        if node not in heard and skin.layouts[layouts[node - 1]] not in LAYOUTS.values():
            continue
        since = seconds - (heard[node].last_s if node in heard else 0.0)
        if since >= PATIENCE_S:
            how = "has not come for the last" if node in heard else "never came in"
            yield Finding(
                "missing-heartbeat", "warning", named(node), 1,
                f"its heartbeat {how} {since:.1f} s, though its data do",
                "a firmware of which only the sampling still runs" if node in heard
                else "another node number than the file's, or a firmware without heartbeats",
            )  # fmt: skip
    for node, board in sorted(heard.items()):
        numbers = sorted(board.serials)
        serials = ", ".join(map(str, numbers[:4])) + (", …" if len(numbers) > 4 else "")
        if node not in expected:
            yield Finding(
                "unknown-board", "warning", named(node), board.heartbeats,
                f"{some(board.heartbeats, 'heartbeat')} of a board that the file does not know "
                f"(serial number {serials})",
                "a board that is not in the file, or that has another node number",
            )  # fmt: skip
        if len(numbers) > 1:
            yield Finding(
                "duplicate-node", "error", named(node), len(numbers),
                f"heartbeats with {len(numbers)} serial numbers ({serials})",
                "two boards set to the same address",
            )  # fmt: skip
        if board.state == "fault":
            yield Finding(
                "board-fault", "error", named(node), board.heartbeats,
                "the board reports a fault in its heartbeats",
                "see the board's manual; its units may be wrong though their frames come",
            )  # fmt: skip


def identities(survey: Survey) -> dict[str, str]:
    """Units whose serial number is in their calibration file and in heartbeats; and what is wrong
    with it, if anything."""
    skin = survey.topology
    given = {name: serial for name, serial in zip(skin.unit_names, skin.serials, strict=False)}
    heard = of_boards(skin, survey.boards)
    return compare_serials(given, heard, given, "the calibration file")


def other_serials(survey: Survey) -> Iterator[Finding]:
    """Units with the calibration of another unit."""
    for name, wrong in identities(survey).items():
        if wrong:
            yield Finding(
                "other-serial", "error", name, 1, wrong,
                "boards that were exchanged, or set to each other's address: its readings are "
                "decoded with the constants of another unit",
            )  # fmt: skip
