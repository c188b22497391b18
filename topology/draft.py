"""Units while they are resolved: by patch, and then by exceptions."""

from __future__ import annotations

from typing import Any

import numpy as np

from topology.address import EXTENDED, Address, number
from topology.calibration import read_calibration
from topology.check.addresses import Claim, check_ids
from topology.check.models import given_parameters, parameter_faults, to_arrays
from topology.check.names import all_named, entries, refer
from topology.check.patches import Placed
from topology.files import missing
from topology.model import MODELS
from topology.parameter_roles import ZEROS
from topology.parts import Parts
from topology.pose import rotate
from topology.report import Report
from topology.schema import List, ListUnit, UnitException
from topology.source import Key, Source
from topology.wire import WireLayout

__all__ = ["Draft"]


class Draft:
    """n units of all placed patches, in the order of the file.

    Attributes
    ----------
    names : list of str, length n
        "patch/unit".
    patch : ndarray, shape (n,), int32
        Index into `placed`.
    tables : list of Key, length n
        Table that placed each unit: its patch, its entry in a list, or its exception.
    fixed : ndarray, shape (n,), bool
        Whether the place is valid.
    enabled : ndarray, shape (n,), bool
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
    address : Address
        Indices of bus and layout are -1 where they are invalid.
    claims : list of Claim, length n
        Owners of the addresses.
    """

    def __init__(
        self, parts: Parts, placed: list[Placed], report: Report, allow_no_calibration: bool = False
    ) -> None:
        self.parts = parts
        self._allow_no_calibration = allow_no_calibration
        self.placed = placed
        self.report = report
        sizes = [len(p.units.names) for p in placed]
        self.patch = np.repeat(np.arange(len(placed)), sizes).astype(np.int32)
        self.starts = np.concatenate([[0], np.cumsum(sizes, dtype=int)])
        self.names = [f"{p.patch.name}/{name}" for p in placed for name in p.units.names]
        self.tables = [table for p in placed for table in _tables(p)]
        self.fixed = np.concatenate([np.empty(0, bool), *(p.fixed for p in placed)])
        self.enabled = np.ones(len(self.names), bool)
        empty = np.empty((3, 0))
        self.position = np.concatenate([empty, *(p.units.position for p in placed)], axis=-1)
        turns = [np.empty((3, 3, 0)), *(p.units.rotation for p in placed)]
        self.rotation = np.concatenate(turns, axis=-1)
        self.model = [placed[p].patch.model for p in self.patch]
        self._given: dict[int, list[tuple[Source, Key, dict[str, Any]]]] = {}
        self.calibrated = np.zeros(len(self.names), bool)
        self.tared = np.zeros(len(self.names), bool)
        self.serials = [""] * len(self.names)

        self.layouts: list[WireLayout] = []
        nowhere = np.full(len(self.names), -1)
        self.address = Address(*(nowhere.copy() for _ in range(4)))
        self.claims: list[Claim | None] = [None] * len(self.names)

        for index in range(len(placed)):
            self._number(index)
            self._calibrate(index)
        self._except()
        self.parameters = self._resolve_parameters()

    @property
    def addressed(self) -> np.ndarray:
        """Whether the address of each unit is known, shape (n,)."""
        return self.address.slot >= 0

    def _number(self, index: int) -> None:
        """Assign addresses to the units of a patch."""
        placed, source, report = self.placed[index], self.parts.source, self.report
        key, patch = placed.key, placed.patch
        if not report.sound(source, key, "bus", "layout"):
            return
        layout = self.parts.layouts.get(patch.layout)
        bus_key = self.parts.buses.get(patch.bus)
        if layout is None or bus_key is None:
            return
        if layout not in self.layouts:
            self.layouts.append(layout)
        units = slice(self.starts[index], self.starts[index + 1])
        self.address.bus[units] = bus_key[1]
        self.address.layout[units] = self.layouts.index(layout)
        bus = self.parts.bus(bus_key)
        if layout.fd and not bus.fd and report.sound(source, bus_key, "data_bitrate"):
            report.add("fd-layout", source, (*key, "layout"), bus=repr(bus.name),
                       line=source.line(bus_key), name=repr(layout.name))  # fmt: skip
        if not report.sound(source, key, "extended", "first_id"):
            return
        listed = patch.units if isinstance(patch, List) else ()
        alone = []
        for i, unit in enumerate(listed):
            at = (*key, "units", i)
            if unit.id is not None or not report.sound(source, at, "id"):
                alone.append(i)
            self._address_one(self.starts[index] + i, unit, at)
        turn = np.delete(np.arange(units.start, units.stop), alone)
        if turn.size == 0:
            return
        if patch.first_id is None:
            without = repr(self.names[turn[0]])
            report.add("first-id", source, (*key, "first_id"), unit=without)
            return
        claim = Claim((*key, "first_id"), f"patch {patch.name!r}", False)
        can_id, slot = number(turn.size, patch.first_id, layout)
        self._claim(turn, can_id, slot, claim)

    def _address_one(self, unit: int, entry: ListUnit | UnitException, key: Key) -> None:
        """Assign one unit the address of its own table."""
        source, report = self.parts.source, self.report
        if not report.sound(source, key, "id", "slot"):
            self.address.slot[unit] = -1
        elif entry.id is not None:
            claim = Claim((*key, "id"), repr(self.names[unit]), True)
            layout = self.address.layout[unit]
            slot = entry.slot or 0
            if layout >= 0 and slot >= self.layouts[layout].units:
                report.add("slot-range", source, (*key, "slot"), limit=self.layouts[layout].units,
                           layout=repr(self.layouts[layout].name), got=slot)  # fmt: skip
                slot = -1
            self._claim(np.array([unit]), np.array([entry.id]), np.array([slot]), claim)
        elif entry.slot is not None:
            report.add("slot-alone", source, (*key, "slot"))

    def _claim(self, units: np.ndarray, can_id: np.ndarray, slot: np.ndarray, claim: Claim):
        """Store the addresses of some units of one patch."""
        index = self.address.layout[units[0]]
        if index < 0:
            return
        layout = self.layouts[index]
        placed = self.placed[self.patch[units[0]]]
        bus_key = self.parts.buses[placed.patch.bus]
        known = self.report.sound(self.parts.source, bus_key, "sync_id")
        ids = np.unique(can_id[:, None] + np.arange(layout.ids))
        check_ids(claim, ids, placed.patch.extended, layout,
                  self.parts.bus(bus_key) if known else None, bus_key,
                  self.parts.source, self.report)  # fmt: skip
        self.address.can_id[units] = can_id + EXTENDED * placed.patch.extended
        self.address.slot[units] = slot
        for unit in units:
            self.claims[unit] = claim

    def _calibrate(self, index: int) -> None:
        """Read the calibration file of a patch."""
        placed, source, report = self.placed[index], self.parts.source, self.report
        at = (*placed.key, "calibration")
        named = placed.patch.calibration
        if named is None or (self._allow_no_calibration and missing(source.path.parent / named)):
            return
        name, units = placed.patch.name, placed.units.names
        calibration, parameters, tared, serials = read_calibration(name, units, at, source, report)
        if calibration is None:
            return
        for unit, serial in serials.items():
            self.serials[int(self.starts[index]) + unit] = serial
        self.tared[[int(self.starts[index]) + unit for unit in tared]] = True
        for unit, given in parameters.items():
            entry = (calibration, ("units", units[unit]), given)
            self._given.setdefault(int(self.starts[index]) + unit, []).append(entry)

    def _except(self) -> None:
        """Apply the exceptions of single units."""
        source, report = self.parts.source, self.report
        index = {name: unit for unit, name in enumerate(self.names)}
        first: dict[str, Key] = {}
        for key, entry in entries(self.parts.file, "units"):
            if not report.sound(source, key, "unit") or not self._known(entry.unit, index, key):
                continue
            other = first.setdefault(entry.unit, key)
            if other != key:
                line = source.line((*other, "unit"))
                report.add("one-exception", source, (*key, "unit"), name=repr(entry.unit),
                           line=line)  # fmt: skip
                continue
            self._except_one(index[entry.unit], entry, key)

    def _known(self, name: str, index: dict[str, int], key: Key) -> bool:
        """Whether a unit exists; not reported where its patch could not be placed."""
        if name in index:
            return True
        patch, slash, unit = name.partition("/")
        patches = [p.name for _, p in entries(self.parts.file, "patches")]
        if not slash:
            known = [full for full in self.names if full.endswith(f"/{name}")]
        elif any(p.patch.name == patch for p in self.placed):
            known = [full for full in self.names if full.startswith(f"{patch}/")]
        elif patch in patches:
            return False
        else:
            known = [f"{p}/{unit}" for p in patches]
        source = self.parts.source
        return refer(name, "a unit", known, (*key, "unit"), source, self.report)

    def _except_one(self, unit: int, entry: UnitException, key: Key) -> None:
        source, report = self.parts.source, self.report
        self.enabled[unit] = entry.enabled
        if entry.model is not None and report.sound(source, key, "model"):
            at, complete = (*key, "model"), all_named("models", self.parts.file, source, report)
            if refer(entry.model, "a model", self.parts.models, at, source, report, complete):
                self.model[unit] = entry.model
        if any(entry.xyz_m):
            turn = self.placed[self.patch[unit]].turn
            self.position[:, unit] += rotate(turn, np.array(entry.xyz_m))
            self.tables[unit] = key
        self._address_one(unit, entry, key)
        given = given_parameters(entry, key, source, report)
        if given:
            self._given.setdefault(unit, []).append((source, key, given))

    def _resolve_parameters(self) -> dict[str, np.ndarray]:
        """Parameters of all units; inconsistent ones are reported."""
        sound = {name: model for name, model in self.parts.models.items() if model is not None}
        default = next(iter(MODELS))
        row = {name: i for i, name in enumerate(sound)}
        kind = np.array([row.get(name, row[default]) for name in self.model], int)
        table = to_arrays(list(sound.values()))
        parameters = {name: values[..., kind] for name, values in table.items()}
        for unit, changes in self._given.items():
            for _, _, given in changes:
                self.calibrated[unit] |= not given.keys() <= {*ZEROS}
                for name, value in given.items():
                    parameters[name][..., unit] = 0.0 if value == () else value
        single = np.zeros(len(self.names), bool)
        single[[unit for unit in self._given if self.model[unit] in sound]] = True
        for fault in parameter_faults(parameters):
            for unit in np.flatnonzero(fault.broken & single):
                changes = self._given[int(unit)]
                blamed = [c for c in changes if fault.field in c[2]] or changes
                source, key, _ = blamed[-1]
                values = {name: value[unit] for name, value in fault.values.items()}
                self.report.add(fault.code, source, (*key, fault.field), **values)
        return parameters


def _tables(placed: Placed) -> list[Key]:
    n = len(placed.units.names)
    if isinstance(placed.patch, List):
        return [(*placed.key, "units", i) for i in range(n)]
    return [placed.key] * n
