"""Files of a decoded log: units, wrench, contacts and events, as tables or as arrays."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.export.columns import contact_of_units
from skin.export.parquet import StateTable
from topology.files import Kind, arrays_of, check_over, whole_file

if TYPE_CHECKING:
    from skin.options import Options
    from skin.state import State
    from topology import Topology

__all__ = ["Events", "writer_for"]

UNIT_COLUMNS = "time_s unit temperature_c fx_n fy_n fz_n status valid contact test_ratio"
WRENCH_COLUMNS = "time_s fx_n fy_n fz_n mx_nm my_nm mz_nm x_m y_m z_m coverage contacts whole"
EVENT_COLUMNS = "time_s contact event"
CONTACT_COLUMNS = (
    "time_s contact units load_n x_m y_m z_m nx ny nz fx_n fy_n fz_n slip stick_ratio margin "
    "friction friction_sigma slip_probability grip_force_n grip_force_sigma_n whole"
)


TABLES = {
    "": UNIT_COLUMNS, ".wrench": WRENCH_COLUMNS, ".contacts": CONTACT_COLUMNS,
    ".events": EVENT_COLUMNS,
}  # fmt: skip
"""The tables of a log: what stands between the name and ".csv", and the columns."""
LATER = ("test_ratio", "whole")
"""Last columns that tables of earlier versions lack; such a table may be written over."""
ARRAYS = arrays_of("arrays of a decoded log", "time_s", "unit", "wrench", "event_contact")


@contextmanager
def writer_for(
    path: Path | None, topology: Topology, options: Options
) -> Iterator[Callable[[State], None]]:
    """A function that takes every state; the files are there at the end, if there was any state.

    Parameters
    ----------
    path : Path or None
        Ends in .csv, .npz or .parquet; None: nothing is written.
    topology : Topology
    options : Options
        By which the states are decoded: arrays have them as JSON (``_options``), a Parquet file in
        its metadata; a table of CSV has no place for them.
    """
    if path is None:
        yield lambda state: None
        return
    with ExitStack() as files:
        kinds = {".csv": _Tables, ".npz": _Arrays, ".parquet": StateTable}
        written = kinds[path.suffix](path, topology, files, options)
        yield written.add
        written.finish()


class Events:
    """What happens to contacts, from one state to the next."""

    def __init__(self) -> None:
        self._slip: dict[int, str] = {}

    def of(self, state: State) -> Iterator[tuple[int, str]]:
        """Identity and event: born, resumed, merged, split, ended, stick, incipient, gross."""
        present = {}
        for contact in state.contacts:
            for event in contact.event:
                yield contact.id, str(event.name).lower()
            present[contact.id] = slip = contact.slip.name.lower()
            if slip not in ("none", self._slip.get(contact.id)):
                yield contact.id, slip
        for identity in self._slip.keys() - present.keys():
            yield identity, "ended"
        self._slip = present


class _Tables:
    """Four CSV files, written as the states come."""

    def __init__(self, path: Path, topology: Topology, files: ExitStack, _options: Options) -> None:
        self._path, self._names, self._files = path, topology.unit_names, files
        self._start_ns: int | None = None
        self._events = Events()
        for part in TABLES:
            check_over(*self._place(part))

    def add(self, state: State) -> None:
        if self._start_ns is None:
            self._start_ns = state.stamp_ns
            self._units, self._wrenches, self._contacts, self._happened = map(self._open, TABLES)
        time_s = f"{1e-9 * (state.stamp_ns - self._start_ns):.6f}"
        units, touching = state.units, contact_of_units(state)
        for i, name in enumerate(self._names):
            self._units(
                [time_s, name, f"{units.temperature[i]:.3f}",
                 *(f"{value:.4f}" for value in units.force[:, i]), int(units.status[i]),
                 int(units.valid[i]), int(touching[i]), f"{units.test_ratio[i]:.4f}"]
            )  # fmt: skip
        self._wrenches(
            [time_s, *_texts(state.wrench), *_texts(state.centroid), f"{state.coverage:.4f}",
             len(state.contacts), int(state.whole)]
        )  # fmt: skip
        for contact in state.contacts:
            self._contacts(
                [time_s, contact.id, contact.units.size, f"{contact.load:.4f}",
                 *_texts(contact.centroid), *_texts(contact.normal), *_texts(contact.wrench[:3]),
                 contact.slip.name.lower(),
                 *_texts([contact.stick_ratio, contact.margin, contact.friction,
                          contact.friction_sigma, contact.slip_probability, contact.grip_force,
                          contact.grip_force_sigma]), int(contact.whole)]
            )  # fmt: skip
        for identity, event in self._events.of(state):
            self._happened([time_s, identity, event])

    def finish(self) -> None:
        """All is written already."""

    def _place(self, part: str) -> tuple[Path, Kind]:
        """The file of a table, and what it may be written over: the same table."""
        columns = TABLES[part].split()
        earlier = columns[:-1] if columns[-1] in LATER else columns
        heads = {",".join(names).encode() + b"\r\n" for names in (columns, earlier)}

        def is_one(path: Path) -> bool:
            with path.open("rb") as file:
                return file.readline(max(map(len, heads))) in heads

        name = part.removeprefix(".") or "units"
        place = self._path.with_name(f"{self._path.stem}{part}.csv")
        return place, Kind(f"a table of {name}", is_one)

    def _open(self, part: str) -> Callable[[list[Any]], object]:
        path, own = self._place(part)
        file = self._files.enter_context(
            whole_file(path, "w", over=own, newline="", encoding="utf-8")
        )
        write = csv.writer(file).writerow
        write(TABLES[part].split())
        return write


class _Arrays:
    """One file of arrays, written at the end."""

    def __init__(self, path: Path, topology: Topology, _files: ExitStack, options: Options) -> None:
        self._path, self._names = path, topology.unit_names
        self._options = json.dumps(options.report(), sort_keys=True)
        self._cycles: list[dict[str, Any]] = []
        self._contacts: list[dict[str, Any]] = []
        self._events, self._happened = Events(), []
        check_over(path, ARRAYS)

    def add(self, state: State) -> None:
        units = state.units
        for contact in state.contacts:
            self._contacts.append(
                {"cycle": len(self._cycles), "id": contact.id, "load_n": contact.load,
                 "centroid_m": contact.centroid.copy(), "normal": contact.normal.copy(),
                 "slip": contact.slip.name.lower(), "margin": contact.margin,
                 "friction": contact.friction, "whole": contact.whole}
            )  # fmt: skip
        self._happened += [(state.stamp_ns, *event) for event in self._events.of(state)]
        self._cycles.append(
            {"stamp_ns": state.stamp_ns, "temperature_c": units.temperature.copy(),
             "force_n": units.force.copy(), "status": units.status.copy(),
             "wrench": state.wrench.copy(), "wrench_sigma": state.wrench_sigma.copy(),
             "centroid_m": state.centroid.copy(), "contact": contact_of_units(state),
             "test_ratio": units.test_ratio.copy(), "whole": state.whole}
        )  # fmt: skip

    def finish(self) -> None:
        if not self._cycles:
            return
        arrays: dict[str, Any] = _stacked(self._cycles)
        stamps, start = arrays.pop("stamp_ns"), self._cycles[0]["stamp_ns"]
        of_contacts = _stacked(self._contacts) if self._contacts else NO_CONTACT
        arrays |= {f"contact_{name}": values for name, values in of_contacts.items()}
        with whole_file(self._path, over=ARRAYS) as file:
            np.savez_compressed(
                file,
                time_s=(stamps - start) * 1e-9,
                unit=np.array(self._names),
                _options=np.array(self._options),
                **arrays,
                event_time_s=np.array([1e-9 * (at - start) for at, _, _ in self._happened]),
                event_contact=np.array([one for _, one, _ in self._happened], np.int64),
                event=np.array([event for _, _, event in self._happened], str),
            )


NO_CONTACT = {
    "cycle": np.zeros(0, np.int64),
    "id": np.zeros(0, np.int64),
    "load_n": np.zeros(0),
    "centroid_m": np.zeros((0, 3)),
    "normal": np.zeros((0, 3)),
    "slip": np.zeros(0, str),
    "margin": np.zeros(0),
    "friction": np.zeros(0),
    "whole": np.zeros(0, bool),
}
"""Arrays of contacts where there are none."""


def _stacked(rows: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Rows of named values as arrays."""
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def _texts(values: Iterable[float]) -> list[str]:
    return [f"{value:.6f}" for value in values]
