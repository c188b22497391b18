"""One log by every output: each column of the table, value by value, as a state has it.

What a state has is said here by its public attributes alone: nothing of the table is used for it
but the names of the columns.
"""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

import skin
from skin.cli import main
from skin.contact.record import QUANTITIES, Event
from skin.io.export import columns, write_tables
from skin.io.export.columns import CYCLES
from skin.io.messages.definitions import fields_of
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write

CYCLES_OF_LOG = 350
FORMATS = ("parquet", "csv", "npz")
READINGS = [one for one in columns.READINGS if one.name != "counts"]  # of other skins
WANT = ("temperature", "force", "sigma", "test_ratio", "wrench", "centroid", "contacts", "slip")
LOADS = ("fx", "fy", "fz", "mx", "my", "mz")
OF_CONTACT = {
    **{name: lambda one, i=i: one.wrench[i] for i, name in enumerate(LOADS)},
    **{f"{name}_sigma": lambda one, i=i: one.wrench_sigma[i] for i, name in enumerate(LOADS)},
    **{name: lambda one, i=i: one.centroid[i] for i, name in enumerate("xyz")},
    **{f"n{name}": lambda one, i=i: one.normal[i] for i, name in enumerate("xyz")},
    **{name: lambda one, bit=bit: bool(one.event & bit)
       for name, bit in (("born", Event.BORN), ("resumed", Event.RESUMED),
                         ("merged", Event.MERGED), ("split", Event.SPLIT))},
    "units": lambda one: one.units.size,
    "slip": lambda one: one.slip.name.lower(),
    "slip_began": lambda one: one.onset_s == 0.0,
}  # fmt: skip
"""Columns whose values are no attributes of a contact."""
OF_SKIN = {
    **{name: lambda one, i=i: one.wrench[i] for i, name in enumerate(LOADS)},
    **{f"{name}_sigma": lambda one, i=i: one.wrench_sigma[i] for i, name in enumerate(LOADS)},
    **{name: lambda one, i=i: one.centroid[i] for i, name in enumerate("xyz")},
    "coverage": lambda one: one.coverage,
    "whole": lambda one: one.whole,
    "untracked": lambda one: one.untracked,
}
OF_UNITS = {
    **{name: lambda one, i=i: one.units.force[i] for i, name in enumerate(LOADS[:3])},
    **{f"{name}_sigma": lambda one, i=i: one.units.force_sigma[i]
       for i, name in enumerate(LOADS[:3])},
    "contact": lambda one: np.array([0, *(c.id for c in one.contacts)])[one.label + 1],
}  # fmt: skip


def of_contact(name, contact):
    return OF_CONTACT.get(name, lambda one: getattr(one, name))(contact)


def of_units(name, state):
    return OF_UNITS.get(name, lambda one: getattr(one.units, name))(state)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Bodies that press a palm, one board silent for a while."""
    frames = frames_of("palm", "press", CYCLES_OF_LOG)
    cycle = np.cumsum(frames["id"] == 0x80)
    silent = (frames["id"] == frames["id"][3]) & (cycle > 200) & (cycle < 240)
    path = tmp_path_factory.mktemp("log") / "run.log"
    write(path, frames[~silent])
    return path


@pytest.fixture(scope="module")
def states(log):
    found = [state.copy() for state in skin.decode_log("palm", log, want=WANT)]
    assert sum(len(state.contacts) for state in found) > 50
    assert not all(state.units.valid.all() for state in found)
    return found


@pytest.fixture(scope="module")
def expected(states):
    """What each table is to have: name, unit of measure, values of each column."""
    return {table: [*expected_columns(states, table)] for table in ("cycles", "contacts")}


@pytest.fixture(scope="module")
def folder(log, tmp_path_factory):
    """The log in every form: from a file, a folder, and Python."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    folder = tmp_path_factory.mktemp("out")
    for format in FORMATS:
        command = ["decode", "palm", str(log), "--json", "-o"]
        assert main([*command, str(folder / f"file.{format}")]) == 0
        assert main([*command, str(folder / format), "--format", format]) == 0
        decoded = skin.decode_log("palm", log, want=WANT)
        assert write_tables(decoded, folder / f"python.{format}") == CYCLES_OF_LOG
    return folder


def files(folder, table, format):
    """A table from a file, a folder, and Python."""
    name = format if table == "cycles" else f"{table}.{format}"
    (of_folder,) = (folder / format / table).rglob(f"*.{format}")
    return folder / f"file.{name}", of_folder, folder / f"python.{name}"


def tables(folder, table, format):
    """The columns of these, by name, as they are read."""
    for file in files(folder, table, format):
        if format == "parquet":
            from pyarrow import parquet

            yield parquet.read_table(file)
        elif format == "npz":
            with np.load(file, allow_pickle=False) as found:
                yield dict(found)
        else:
            with file.open(newline="") as opened:
                rows = list(csv.DictReader(opened))
            yield {name: [row[name] for row in rows] for name in rows[0]}


def contacts_of(states):
    return [contact for state in states for contact in state.contacts]


def parts(quantities):
    """Of each column: its quantity, its place in it, its name and its unit."""
    return [(one, i, name, unit) for one in quantities for i, (name, unit) in enumerate(one.heads)]


def same(found, expected):
    """Bit by bit: also NaN, and the type."""
    found, expected = np.asarray(found), np.asarray(expected)
    if expected.dtype.kind == "U":
        assert found.tolist() == expected.tolist()
    else:
        assert found.dtype == expected.dtype
        assert found.tobytes() == expected.tobytes()


def expected_columns(states, table):
    """Name, unit of measure, values, and the type of each column of a table but its head."""
    if table == "contacts":
        every = contacts_of(states)
        for one, _, name, unit in parts(QUANTITIES):
            values = np.array([of_contact(name, contact) for contact in every])
            yield name, unit, values.astype(str if one.words else one.dtype)
        return
    for _, _, name, unit in parts(READINGS):
        values = np.array([of_units(name, state) for state in states])
        for of, column in zip(states[0].topology.unit_names, values.T, strict=True):
            yield f"{of}.{name}", unit, column
    for one, _, name, unit in parts(CYCLES):
        head = f"{one.name.removesuffix('_sigma')}." if one.columns else ""
        yield head + name, unit, np.array([OF_SKIN[name](state) for state in states])


@pytest.mark.parametrize("table", ["cycles", "contacts"])
def test_parquet_has_the_values_of_the_states(table, states, expected, folder):
    for found in tables(folder, table, "parquet"):
        rows = [s for s in states for _ in (s.contacts if table == "contacts" else [s])]
        assert found["time"].cast("int64").to_pylist() == [state.stamp_ns for state in rows]
        assert found["cycle"].to_pylist() == [state.cycle for state in rows]
        names = ["time", "cycle", *(["closed_by"] if table == "cycles" else [])]
        for name, unit, values in expected[table]:
            names.append(name)
            same(found[name].to_numpy(), values)
            metadata = found.schema.field(name).metadata
            assert metadata == ({b"unit": unit.encode()} if unit else None)
            assert not found.schema.field(name).nullable
        assert found.column_names == names


@pytest.mark.parametrize("table", ["cycles", "contacts"])
def test_csv_has_the_names_and_values_of_parquet_with_all_digits(table, expected, folder):
    for found in tables(folder, table, "csv"):
        for name, _, values in expected[table]:
            read = found[name]
            if values.dtype.kind == "f":
                same(np.array(read, values.dtype), values)
            else:
                assert read == values.astype(str).tolist()
    (columns_of_parquet, *_), (columns_of_csv, *_) = (
        [*tables(folder, table, format)] for format in ("parquet", "csv")
    )
    assert list(columns_of_csv) == columns_of_parquet.column_names


@pytest.mark.parametrize("table", ["cycles", "contacts"])
def test_arrays_have_the_columns_of_a_quantity_side_by_side(table, states, folder):
    every, held = contacts_of(states), []
    for one, i, name, _ in parts(QUANTITIES if table == "contacts" else (*READINGS, *CYCLES)):
        if table == "contacts":
            values = np.array([of_contact(name, contact) for contact in every])
            values = values.astype(str if one.words else one.dtype)
        else:
            reads = OF_SKIN.get(name) if one in CYCLES else lambda s, name=name: of_units(name, s)
            values = np.array([reads(state) for state in states])
        held.append((one, i, values))
    for found in tables(folder, table, "npz"):
        assert found["_units"].tolist() == list(states[0].topology.unit_names)
        assert found["time"].dtype == "datetime64[ns]"
        for one, i, values in held:
            array = found[one.name]
            same(array[:, i].copy() if one.columns else array, values)


def test_files_say_by_what_they_were_decoded(folder):
    from pyarrow import parquet

    for format in ("parquet", "npz"):
        told = []
        for file in files(folder, "cycles", format):
            if format == "parquet":
                metadata = parquet.read_schema(file).metadata
                told.append({key.decode(): value.decode() for key, value in metadata.items()})
            else:
                with np.load(file) as found:
                    told.append({name[1:]: str(found[name]) for name in found.files
                                 if name.startswith("_")})  # fmt: skip
        for one in told:
            assert one["skin"] == "palm"
            assert json.loads(one["options"])["sweeps"] == 1
            assert json.loads(one["serials"]) is not None
            hashes = [one["topology_sha256"], one["calibration_sha256"]]
            assert hashes == [told[0]["topology_sha256"], told[0]["calibration_sha256"]]
        assert told[0]["log"] == told[1]["log"] == "run.log"


def test_a_message_has_all_that_leaves_of_a_contact():
    missing = {one.name for one in QUANTITIES} - fields_of("f3t_msgs/msg/Contact").keys()
    assert not missing, f"f3t_msgs/msg/Contact lacks {', '.join(missing)}"
