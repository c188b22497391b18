"""One log by every output: each column of the table, value by value, as a state has it.

What a state has is said here by its public attributes alone: nothing of the table is used for it
but the names of the columns.
"""

from __future__ import annotations

import csv
import itertools
import json
from pathlib import Path

import numpy as np
import pytest

import skin
from bus.logs import write
from skin.cli import main
from skin.contact.record import QUANTITIES, Event
from skin.io.export import columns
from skin.io.export.columns import CYCLES, suffix
from skin.io.messages.definitions import fields_of
from tests.fixtures.live import frames_of
from tests.house import columns as reference

CYCLES_OF_LOG = 350
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
def folder(log, tmp_path_factory):
    """The log in every form."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    folder = tmp_path_factory.mktemp("out")
    for words in (["-o", "a.csv"], ["-o", "a.npz"], ["-o", "a.parquet"],
                  ["-o", "parquet", "--want", *WANT],
                  ["-o", "npz", "--format", "npz", "--want", *WANT]):  # fmt: skip
        words[1] = str(folder / words[1])
        assert main(["decode", str(log), "--topology", "palm", "--json", *words]) == 0
    return folder


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


def table(path):
    """Columns of texts."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def text(value, decimals):
    if isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    is_whole = isinstance(value, int | np.integer)
    return str(int(value)) if is_whole else f"{float(value):.{decimals}f}"


def test_contacts_in_parquet_are_those_of_the_states(states, folder):
    from pyarrow import parquet

    every, rows = contacts_of(states), parquet.read_table(folder / "a.parquet")["contacts"]
    listed = rows.combine_chunks().flatten()
    (file,) = (folder / "parquet" / "contacts").rglob("*.parquet")
    one_table = parquet.read_table(file)
    assert [len(row) for row in rows] == [len(state.contacts) for state in states]
    assert [one.name for one in listed.type] == one_table.column_names[2:]
    for one, _, name, unit in parts(QUANTITIES):
        expected = np.array([of_contact(name, contact) for contact in every])
        expected = expected.astype(str if one.words else one.dtype)
        for found in (listed.field(name), one_table[name].combine_chunks()):
            same(found.to_numpy(zero_copy_only=False), expected)
        for field in (listed.type.field(name), one_table.schema.field(name)):
            assert field.metadata == ({b"unit": unit.encode()} if unit else None)
    assert one_table["cycle"].to_pylist() == [s.cycle for s in states for _ in s.contacts]


def test_units_and_skin_in_parquet_are_those_of_the_states(states, folder):
    from pyarrow import parquet

    names = states[0].topology.unit_names
    (file,) = (folder / "parquet" / "cycles").rglob("*.parquet")
    for found in (parquet.read_table(folder / "a.parquet"), parquet.read_table(file)):
        assert found["time"].cast("int64").to_pylist() == [one.stamp_ns for one in states]
        assert found["closed_by"].to_pylist() == [str(one.closed_by) for one in states]
        for _, _, name, unit in parts(READINGS):
            expected = np.array([of_units(name, state) for state in states])
            for i, of in enumerate(names):
                same(found[f"{of}.{name}"].to_numpy(), expected[:, i])
                metadata = found.schema.field(f"{of}.{name}").metadata
                assert metadata == ({b"unit": unit.encode()} if unit else None)
        for one, _, name, _ in parts(CYCLES):
            head = f"{one.name.removesuffix('_sigma')}." if one.columns else ""
            same(found[head + name].to_numpy(), np.array([OF_SKIN[name](s) for s in states]))


def test_arrays_of_a_file_and_of_a_folder_are_those_of_the_states(states, folder):
    every, names = contacts_of(states), {}
    with np.load(folder / "a.npz") as one:
        names[""] = dict(one)
    for part in ("cycles", "contacts"):
        (file,) = (folder / "npz" / part).rglob("*.npz")
        with np.load(file) as one:
            names[part] = dict(one)
    for one, i, name, unit in parts(QUANTITIES):
        array = one.name + (suffix(unit) if isinstance(one.unit, str) else "")
        expected = np.array([of_contact(name, contact) for contact in every])
        expected = expected.astype(str if one.words else one.dtype)
        for found in (names[""][f"contact_{array}"], names["contacts"][array]):
            same(found[:, i].copy() if one.columns else found, expected)
    for one, i, name, unit in parts((*READINGS, *CYCLES)):
        array = one.name + (suffix(unit) if isinstance(one.unit, str) else "")
        reads = OF_SKIN.get(name) if one in CYCLES else lambda s, name=name: of_units(name, s)
        expected = np.array([reads(state) for state in states])
        for found in (names[""][array], names["cycles"][array]):
            same(found[:, i].copy() if one.columns else found, expected)
    index = np.repeat(np.arange(len(states)), [len(state.contacts) for state in states])
    np.testing.assert_array_equal(names[""]["contact_cycle"], index)
    np.testing.assert_array_equal(names["cycles"]["time"], [one.stamp_ns for one in states])


def test_tables_of_text_are_those_of_the_states(states, folder):
    units, wrench, contacts = (table(folder / f"a{part}.csv") for part in ("", ".wrench",
                                                                          ".contacts"))  # fmt: skip
    for one, _, name, unit in parts(READINGS):
        values = itertools.chain.from_iterable(of_units(name, state) for state in states)
        assert units[name + suffix(unit)] == [text(value, one.decimals) for value in values]
    for one, _, name, unit in parts(CYCLES):
        values = [text(OF_SKIN[name](state), one.decimals) for state in states]
        assert wrench[name + suffix(unit)] == values
    for one, _, name, unit in parts(QUANTITIES):
        head = "contact" if name == "id" else name + suffix(unit)
        values = [text(of_contact(name, contact), one.decimals) for contact in contacts_of(states)]
        assert contacts[head] == values
    assert wrench["contacts"] == [str(len(state.contacts)) for state in states]


def test_a_data_set_has_the_contacts_and_test_ratios_of_the_states(states, log, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    frames = tmp_path / "frames.csv"
    stamps = [f"{state.stamp_ns},1" for state in states]
    frames.write_text("\n".join(["stamp_ns,action.grip", *stamps]))
    assert main(["export", "lerobot", str(log), "--topology", "palm", "--frames", str(frames),
                 "-o", str(tmp_path / "set"), "--task", "press", "--fps", "250"]) == 0  # fmt: skip
    rows = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    found = np.array(rows["observation.tactile.contacts"].to_pylist(), np.float32)
    names = json.loads((tmp_path / "set/meta/tactile.json").read_text())["contact_columns"]
    assert names == [name for _, _, name, _ in parts(QUANTITIES)]
    for t, state in enumerate(states):
        expected = np.full(found[t].shape, np.nan, np.float32)
        for row, contact in zip(expected, state.contacts, strict=False):
            row[:] = [int(contact.slip) if name == "slip" else of_contact(name, contact)
                      for name in names]  # fmt: skip
        same(found[t], expected)
    ratios = np.array(rows["observation.tactile.test_ratio"].to_pylist(), np.float32)
    same(ratios, np.array([state.units.test_ratio for state in states]))


def test_a_message_has_all_that_leaves_of_a_contact():
    fields = {field.name for field in fields_of("f3t_msgs/msg/Contact")}
    missing = {one.name for one in QUANTITIES} - fields
    assert not missing, f"f3t_msgs/msg/Contact lacks {', '.join(missing)}"


def test_the_page_of_columns_is_that_of_the_table():
    path = Path(reference.PAGE)
    assert path.read_text("utf-8") == reference.page(), "python -m tests.house draw"
