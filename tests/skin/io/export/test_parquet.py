"""States in Parquet files: what pyarrow reads back are the states, with names and units."""

from __future__ import annotations

import csv
import sys
from dataclasses import replace

import numpy as np
import pytest

from skin.cli import main
from skin.errors import LibraryError
from skin.io.export import parquet as room
from skin.io.export import write_parquet

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")


@pytest.fixture(scope="module")
def file(palm, states, tmp_path_factory):
    path = tmp_path_factory.mktemp("parquet") / "run.parquet"
    assert write_parquet(states, path, palm) == len(states)
    return path


def test_columns_are_the_states(palm, states, file):
    table = pq.read_table(file)
    for at, name in enumerate(palm.unit_names):
        for axis, ending in enumerate(("fx", "fy", "fz")):
            values = table[f"{name}.{ending}"].to_numpy()
            expected = [state.units.force[axis, at] for state in states]
            np.testing.assert_array_equal(values, np.array(expected, np.float32))
        np.testing.assert_array_equal(
            table[f"{name}.fz_sigma"].to_numpy(), [one.units.force_sigma[2, at] for one in states]
        )
        np.testing.assert_array_equal(
            table[f"{name}.status"].to_numpy(), [one.units.status[at] for one in states]
        )
        assert table[f"{name}.valid"].to_pylist() == [one.units.valid[at] for one in states]
    assert table["cycle"].to_pylist() == [state.cycle for state in states]
    stamps = table["time"].cast("int64").to_pylist()
    assert stamps == [state.stamp_ns for state in states]
    assert table["wrench.mz"].to_pylist() == [state.wrench[5] for state in states]


def test_contacts_are_lists_of_named_values(states, file):
    contacts = pq.read_table(file)["contacts"].to_pylist()
    assert [[one["id"] for one in row] for row in contacts] == [
        [contact.id for contact in state.contacts] for state in states
    ]
    last = next(state for state in reversed(states) if state.contacts).contacts[0]
    told = next(row for row in reversed(contacts) if row)[0]
    assert (told["load"], told["mz"], told["slip"]) == (
        last.load, last.wrench[5], last.slip.name.lower(),
    )  # fmt: skip
    assert told["units"] == last.units.size > 0


def test_columns_tell_their_units_of_measure(palm, file):
    schema = pq.read_schema(file)
    name = palm.unit_names[7]
    told = {end: schema.field(f"{name}.{end}").metadata for end in ("fx", "temperature_sigma")}
    assert told == {"fx": {b"unit": b"N"}, "temperature_sigma": {b"unit": b"degC"}}
    assert schema.field("centroid.x").metadata == {b"unit": b"m"}
    assert schema.field("contacts").type.value_type.field("load").metadata == {b"unit": b"N"}
    assert schema.field("coverage").metadata is None


def test_no_column_has_nulls(file):
    schema = pq.ParquetFile(file).schema
    levels = {schema.column(i).max_definition_level for i in range(len(schema.names))
              if not schema.column(i).path.startswith("contacts.")}  # fmt: skip
    assert levels == {0}


def test_row_groups_are_written_as_they_fill(palm, states, tmp_path, monkeypatch):
    monkeypatch.setattr(room, "STATES", 32)
    monkeypatch.setattr(room, "MOST_ROWS", 64)
    write_parquet(states, tmp_path / "a.parquet", palm)
    found = pq.ParquetFile(tmp_path / "a.parquet").metadata
    rows = [found.row_group(i).num_rows for i in range(found.num_row_groups)]
    assert rows == [64] * (len(states) // 64) + [len(states) % 64]
    assert pq.read_table(tmp_path / "a.parquet")["cycle"].to_pylist() == [
        state.cycle for state in states
    ]


def test_what_is_not_wanted_has_no_column(palm, states, tmp_path):
    units = replace(states[0].units, temperature=None, force_sigma=None)
    state = replace(states[0], units=units, contacts=None, wrench=None, wrench_sigma=None)
    write_parquet([state] * 5, tmp_path / "a.parquet", palm)
    names = pq.read_schema(tmp_path / "a.parquet").names
    assert "palm/r0c0.fx" in names
    assert not {"palm/r0c0.temperature", "palm/r0c0.fx_sigma", "wrench.fx", "contacts"} & {*names}


def test_an_error_leaves_no_file(palm, states, tmp_path):
    def broken():
        yield from states[:3]
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_parquet(broken(), tmp_path / "a.parquet", palm)
    assert list(tmp_path.iterdir()) == []


def test_no_states_make_no_file(palm, tmp_path):
    assert write_parquet([], tmp_path / "a.parquet", palm) == 0
    assert list(tmp_path.iterdir()) == []


def test_decode_writes_what_it_writes_as_csv(log, tmp_path, capsys):
    for name in ("run.parquet", "run.csv"):
        assert main(["decode", str(log), "--topology", "palm", "-o", str(tmp_path / name)]) == 0
    table = pq.read_table(tmp_path / "run.parquet")
    with (tmp_path / "run.csv").open(newline="") as file:
        third = [row for row in csv.DictReader(file) if row["unit"] == "palm/r3c3"]
    told = [f"{value:.4f}" for value in table["palm/r3c3.fz"].to_pylist()]
    assert told == [row["fz_n"] for row in third]
    assert table["palm/r3c3.contact"].to_pylist() == [int(row["contact"]) for row in third]
    assert "palm/r3c3.fz_sigma" in table.column_names


def test_without_pyarrow_the_message_names_the_extra(palm, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(LibraryError) as told:
        write_parquet([], tmp_path / "a.parquet", palm)
    assert str(told.value) == (
        f"{tmp_path}/a.parquet: must have pyarrow to be written; not installed: "
        "pip install 'f3t-skin[data]'"
    )
