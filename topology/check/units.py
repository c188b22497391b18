"""Units of all patches: their places, addresses and parameters, and the rules between them."""

from __future__ import annotations

from typing import Any

import numpy as np

from topology.arrays import EXTENDED
from topology.calibration import read_calibration
from topology.check.models import given_parameters, parameter_faults, to_arrays
from topology.check.tables import Tables
from topology.files import missing
from topology.layout import place
from topology.model import ZEROS
from topology.neighbours import nearest_point
from topology.pose import compose, rotate
from topology.schema import List, ListUnit, Override
from topology.source import Key, Source
from topology.wire import LAYOUTS, WireLayout

__all__ = ["DATA_IDS", "Units", "format_ids"]

DATA_IDS = (0x100, 0x6FF)
"""Identifiers of data frames in the project's own protocol: below are SYNC and more urgent frames,
above heartbeats (0x700) and configuration (0x7E0)."""
LARGEST_STANDARD = 0x7FF
LARGEST_EXTENDED = 0x1FFF_FFFF

CLOSEST = 0.1
"""Fraction of their radius within which two units are the same one entered twice."""


def format_ids(low: int, high: int) -> str:
    """Identifiers as text for messages: "0x100 to 0x10c"."""
    return f"{low:#05x}" if low == high else f"{low:#05x} to {high:#05x}"


class Units:
    """n units of all patches, in the order of the file.

    Attributes
    ----------
    names : list of str, length n
        "patch/unit".
    patch : ndarray, shape (n,), int32
        Index of the patch.
    sources : list of Key, length n
        Table that placed each unit: its patch, its entry in a list, or its override.
    enabled, calibrated, tared : ndarray, shape (n,), bool
    position : ndarray, shape (3, n), float64
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n), float64
        R_skin_unit.
    model : list of str, length n
    parameters : dict of str to ndarray
        As in `Topology`.
    serials : list of str, length n
    layouts : list of WireLayout
        Those in use.
    bus, layout, can_id, slot : ndarray, shape (n,), int64
        Address: indices of bus and layout, identifier of the first frame, place in it; the last two
        are -1 where they are wrong.
    """

    def __init__(self, tables: Tables, allow_no_calibration: bool = False) -> None:
        self.tables, self.source = tables, tables.source
        patches = tables.file.patches
        placed = [place(patch) for patch in patches]
        posed = [
            compose(pose, (units.rotation, units.position))
            for pose, units in zip(tables.poses, placed, strict=True)
        ]
        self.rotation = np.concatenate([rotation for rotation, _ in posed], axis=-1)
        self.position = np.concatenate([position for _, position in posed], axis=-1)
        sizes = [len(units.names) for units in placed]
        n = sum(sizes)
        self.patch = np.repeat(np.arange(len(placed)), sizes).astype(np.int32)
        self.starts = np.cumsum([0, *sizes])
        self._own_names = [units.names for units in placed]
        self.names = [
            f"{patch.name}/{name}"
            for patch, units in zip(patches, placed, strict=True)
            for name in units.names
        ]
        self._index = {name: unit for unit, name in enumerate(self.names)}
        self.sources: list[Key] = [
            ("patches", int(p), "units", unit - int(self.starts[p]))
            if isinstance(patches[p], List)
            else ("patches", int(p))
            for unit, p in enumerate(self.patch)
        ]
        self.enabled = np.ones(n, bool)
        self.calibrated, self.tared = np.zeros((2, n), bool)
        self.serials = [""] * n
        self.model = [patches[p].model for p in self.patch]
        self._given: dict[int, list[tuple[Source, Key, dict[str, Any]]]] = {}

        of_patch = [tables.layouts[patch.layout] for patch in patches]
        self.layouts = list(dict.fromkeys(of_patch))
        buses = [bus.name for bus in tables.file.buses]
        self.bus = np.array([buses.index(patch.bus) for patch in patches])[self.patch]
        self.layout = np.array([self.layouts.index(one) for one in of_patch])[self.patch]
        self.can_id, self.slot = np.full((2, n), -1)
        self._claims: list[Key] = [()] * n
        """Key that gives each unit its address."""

        for index in range(len(patches)):
            self._number(index, of_patch[index])
            self._calibrate(index, allow_no_calibration)
        self._override()
        self.parameters = self._resolve_parameters()
        self._check_identifiers()
        self._check_clashes()
        self._check_places()

    def _number(self, index: int, layout: WireLayout) -> None:
        """Assign addresses to the units of a patch: `layout.units` a frame, one after the other."""
        patch, key = self.tables.file.patches[index], ("patches", index)
        bus = self.tables.file.buses[self.bus[self.starts[index]]]
        if layout.fd and not bus.fd:
            line = self.source.line(("buses", int(self.bus[self.starts[index]])))
            expected = f"a layout of classic frames, as bus {bus.name!r} (line {line}) has no "
            got = f"{layout.name!r} with FD frames"
            self.source.fault((*key, "layout"), f"{expected}data_bitrate", got)
        turn = []
        for unit in range(self.starts[index], self.starts[index + 1]):
            entry = patch.units[unit - self.starts[index]] if isinstance(patch, List) else None
            if entry is None or not self._own_address(unit, entry, self.sources[unit]):
                turn.append(unit)
        if turn and patch.first_id is None:
            at, unit = (*key, "first_id"), self.names[turn[0]]
            self.source.fault(at, f"given, as {unit!r} names no id of its own", "none")
        elif turn and patch.first_id is not None:
            group, self.slot[turn] = np.divmod(np.arange(len(turn)), layout.units)
            self.can_id[turn] = patch.first_id + group * layout.ids
            for unit in turn:
                self._claims[unit] = (*key, "first_id")

    def _own_address(self, unit: int, entry: ListUnit | Override, key: Key) -> bool:
        """Assign one unit the address of its own table; whether there is one."""
        if entry.id is None:
            if entry.slot is not None:
                self.source.fault((*key, "slot"), "given with an id", "a slot alone")
            return False
        layout, slot = self.layouts[self.layout[unit]], entry.slot or 0
        if slot >= layout.units:
            expected = f"below {layout.units}, the units in a frame of {layout.name!r}"
            self.source.fault((*key, "slot"), expected, slot)
            slot = -1
        self.can_id[unit], self.slot[unit] = entry.id, slot
        self._claims[unit] = (*key, "id")
        return True

    def _calibrate(self, index: int, allow_missing: bool) -> None:
        """Read the calibration file of a patch."""
        patch, start = self.tables.file.patches[index], int(self.starts[index])
        if patch.calibration is None:
            return
        if allow_missing and missing(self.source.named_file(patch.calibration)[0]):
            return
        known = {name: start + i for i, name in enumerate(self._own_names[index])}
        real = any(bus.interface != "memory" for bus in self.tables.file.buses)
        read = read_calibration(patch, known, ("patches", index, "calibration"), self.source, real)
        if read is None:
            return
        calibration, table = read
        self.tared[[known[name] for name in table.tared if name in known]] = True
        for name, measured in table.measured.items():
            if name in known:
                self.serials[known[name]] = measured.serial
        for name, entry in table.units.items():
            if name in known:
                self._give(known[name], entry, ("units", name), calibration)

    def _override(self) -> None:
        """Apply what differs for single units."""
        first: dict[str, Key] = {}
        for number, entry in enumerate(self.tables.file.overrides):
            key: Key = ("overrides", number)
            at = (*key, "unit")
            if not self.source.refer(entry.unit, "a unit", self._names_like(entry.unit), at):
                continue
            if (other := first.setdefault(entry.unit, at)) != at:
                got = f"{entry.unit!r}, also at line {self.source.line(other)}"
                self.source.fault(at, "a unit named once", got)
                continue
            unit = self._index[entry.unit]
            self.enabled[unit] = entry.enabled
            self.model[unit] = entry.model or self.model[unit]
            if any(entry.offset_m):
                turn, _ = self.tables.poses[self.patch[unit]]
                self.position[:, unit] += rotate(turn, np.array(entry.offset_m))
                self.sources[unit] = key
            self._own_address(unit, entry, key)
            self._give(unit, entry, key, self.source)

    def _names_like(self, name: str) -> list[str]:
        """Units among which a name is looked for: those of its patch, if there is one."""
        if name in self._index:
            return [name]
        patch, slash, unit = name.partition("/")
        own = [full for full in self.names if full.startswith(f"{patch}/")]
        return own if slash and own else [n for n in self.names if n.endswith(f"/{unit or patch}")]

    def _give(self, unit: int, table: Any, key: Key, source: Source) -> None:
        """Note the parameters that a table has for a unit."""
        if given := given_parameters(table, key, source):
            self._given.setdefault(unit, []).append((source, key, given))

    def _resolve_parameters(self) -> dict[str, np.ndarray]:
        """Parameters of all units; inconsistent ones are reported."""
        models = self.tables.models
        row = {name: i for i, name in enumerate(models)}
        kind = [row[name] for name in self.model]
        table = to_arrays(list(models.values()))
        parameters = {name: values[..., kind] for name, values in table.items()}
        single = np.zeros(len(self.names), bool)
        for unit, changes in self._given.items():
            single[unit] = True
            for _, _, given in changes:
                self.calibrated[unit] |= not given.keys() <= {*ZEROS}
                for name, value in given.items():
                    parameters[name][..., unit] = 0.0 if value == () else value
        for fault in parameter_faults(parameters):
            for unit in np.flatnonzero(fault.broken & single).tolist():
                changes = self._given[unit]
                blamed = [change for change in changes if fault.field in change[2]] or changes
                source, key, _ = blamed[-1]
                source.fault((*key, fault.field), *fault.words(unit))
        return parameters

    def _check_identifiers(self) -> None:
        """Identifiers lie where data frames may, all those of a claim together."""
        claimed: dict[Key, list[int]] = {}
        for unit, claim in enumerate(self._claims):
            if claim:
                claimed.setdefault(claim, []).append(unit)
        for claim, units in claimed.items():
            self._check_range(claim, units)

    def _check_range(self, claim: Key, units: list[int]) -> None:
        file, layout = self.tables.file, self.layouts[self.layout[units[0]]]
        low = int(self.can_id[units].min())
        high = int(self.can_id[units].max()) + layout.ids - 1
        got = format_ids(low, high)
        allowed, is_own = (0, LARGEST_STANDARD), layout.name in LAYOUTS and not layout.counts_only
        if file.patches[self.patch[units[0]]].extended:
            allowed = (0, LARGEST_EXTENDED)
            self.can_id[units] |= EXTENDED
        elif high > LARGEST_STANDARD:
            expected = f"at most {LARGEST_STANDARD:#x} unless `extended = true`"
            self.source.fault(claim, expected, got)
            return
        elif is_own:
            allowed = DATA_IDS
        if low < allowed[0] or high > allowed[1]:
            self.source.fault(claim, f"ids within {allowed[0]:#x} to {allowed[1]:#x}", got)
        elif file.sync_id is not None and low <= file.sync_id <= high and not (
            self.can_id[units[0]] & EXTENDED
        ):  # fmt: skip
            line = self.source.line(("sync_id",))
            self.source.fault(claim, f"ids other than that of SYNC (line {line})", got)

    def _check_clashes(self) -> None:
        """No two units have one place in a frame, and no two kinds of frames one identifier."""
        frames: dict[tuple[int, int], int] = {}
        places: dict[tuple[int, int, int], int] = {}
        clashes: dict[tuple[Key, Key], list[tuple[int, str]]] = {}

        def clash(one: int, two: int, can_id: int, what: str) -> None:
            order = sorted((self._claims[one], self._claims[two]), key=_overrides_last)
            clashes.setdefault((order[0], order[1]), []).append((can_id & ~EXTENDED, what))

        for unit in np.flatnonzero(self.slot >= 0).tolist():
            bus, layout = int(self.bus[unit]), int(self.layout[unit])
            can_id, slot = int(self.can_id[unit]), int(self.slot[unit])
            for own in range(can_id, can_id + self.layouts[layout].ids):
                other = frames.setdefault((bus, own), unit)
                if (self.can_id[other], self.layout[other]) != (can_id, layout):
                    clash(other, unit, own, "")
            other = places.setdefault((bus, can_id, slot), unit)
            if other != unit:
                clash(other, unit, can_id, f"slot {slot} of ")
        for (one, two), found in clashes.items():
            ids = [can_id for can_id, _ in found]
            what = found[0][1] if "id" in (one[-1], two[-1]) else ""
            bus = self.tables.file.buses[self.bus[self._claims.index(two)]]
            got = f"{what}{format_ids(min(ids), max(ids))}, already used by {self._owner(one)}"
            self.source.fault(two, f"free on bus {bus.name!r}", got)

    def _owner(self, claim: Key) -> str:
        unit = self._claims.index(claim)
        patch = f"patch {self.tables.file.patches[self.patch[unit]].name!r}"
        name = patch if claim[-1] == "first_id" else repr(self.names[unit])
        return f"{name} (line {self.source.line(claim)})"

    def _check_places(self) -> None:
        """No two units stand in one place; reported once for each pair of tables."""
        radius = self.parameters["radius_m"]
        distance, nearest = nearest_point(self.position)
        found: dict[tuple[Key, Key], list[tuple[int, int, float]]] = {}
        seen: set[tuple[int, int]] = set()
        for unit in np.flatnonzero(np.isfinite(distance)).tolist():
            one, two = sorted((unit, int(nearest[unit])))
            if distance[unit] >= CLOSEST * min(radius[one], radius[two]) or (one, two) in seen:
                continue
            seen.add((one, two))
            if self.sources[one][0] == "overrides":  # what was moved onto another is to blame
                one, two = two, one
            pair = (self.sources[one], self.sources[two])
            found.setdefault(pair, []).append((two, one, float(distance[unit])))
        for (other, table), pairs in found.items():
            two, one, least = min(pairs)
            more = f", and {len(pairs) - 1} more" if len(pairs) > 1 else ""
            limit = 1e3 * CLOSEST * min(radius[one], radius[two])
            between = f"between {self.names[two]!r} and {self.names[one]!r}"
            got = f"{round(1e3 * least, 6):.3g} mm {between} (line {self.source.line(other)}){more}"
            self.source.fault(table, f"{limit:.3g} mm or more from every other unit", got)


def _overrides_last(claim: Key) -> tuple[Any, ...]:
    return claim[0] == "overrides", claim
