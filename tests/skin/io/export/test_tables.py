"""Files of tables: written as they fill, in their places when they are complete."""

from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest

import skin
from skin.errors import LibraryError, OptionError
from skin.io.export import tables, write_tables
from skin.options import Options
from skin.pipeline import Pipeline
from tests.fixtures.live import frames_of

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")


def test_row_groups_are_written_as_they_fill(log, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MOST_ROWS", 64)
    decoded = skin.decode_log("palm", log)
    whole, blocks = decoded.blocks, lambda: whole(32)
    monkeypatch.setattr(decoded, "blocks", blocks)
    assert write_tables(decoded, tmp_path / "a.parquet") == 400
    found = pq.ParquetFile(tmp_path / "a.parquet").metadata
    rows = [found.row_group(i).num_rows for i in range(found.num_row_groups)]
    assert rows == [64] * 6 + [16]


def test_no_column_has_nulls(log, tmp_path):
    write_tables(skin.decode_log("palm", log), tmp_path / "a.parquet")
    schema = pq.ParquetFile(tmp_path / "a.parquet").schema
    assert {schema.column(i).max_definition_level for i in range(len(schema.names))} == {0}


def test_what_is_not_wanted_has_no_column_and_leaves_no_old_table(log, tmp_path):
    short = tmp_path / "short" / "palm.log"
    short.parent.mkdir()
    short.write_text("".join(log.read_text().splitlines(keepends=True)[:400]))
    write_tables(skin.decode_log("palm", short), tmp_path / "a.parquet")
    write_tables(skin.decode_log("palm", short, want={"force"}), tmp_path / "a.parquet")
    names = pq.read_schema(tmp_path / "a.parquet").names
    assert "palm/r0c0.fx" in names
    assert not {"palm/r0c0.temperature", "palm/r0c0.fx_sigma", "wrench.fx"} & {*names}
    assert sorted(one.name for one in tmp_path.glob("a*")) == ["a.faults.parquet", "a.parquet"]


def test_a_live_skin_is_written_for_a_while(tmp_path):
    with skin.open("strip", simulate="press", pace=False) as strip:
        count = write_tables(itertools.islice(strip, 20), tmp_path / "a.npz", strip.pipeline)
    with np.load(tmp_path / "a.npz") as found:
        assert len(found["time"]) == count == 20
        assert np.diff(found["cycle"]).tolist() == [1] * 19


@pytest.mark.parametrize("format", ["parquet", "csv", "npz"])
def test_an_error_leaves_no_file_and_no_states_make_none(palm, format, tmp_path):
    pipeline = Pipeline(palm, Options())

    def broken():
        yield from itertools.islice(pipeline.feed(frames_of("palm", "press", 10)), 3)
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_tables(broken(), tmp_path / f"a.{format}", pipeline)
    assert write_tables([], tmp_path / f"a.{format}", pipeline) == 0
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_said(palm, pipeline, tmp_path, monkeypatch):
    with pytest.raises(OptionError, match=r"format: must be .*; got 'xls'"):
        write_tables([], tmp_path / "a.xls", pipeline)
    for name in ("a.parquet", "a.csv", "a.contacts.npz"):
        (tmp_path / name).write_text("notes\n")
        with pytest.raises(FileExistsError, match="must be a new file, or a table of c"):
            write_tables([], tmp_path / name.replace("contacts.", ""), pipeline)
        assert (tmp_path / name).read_text() == "notes\n"
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(LibraryError) as told:
        write_tables([], tmp_path / "b.parquet", pipeline)
    assert str(told.value) == (
        f"{tmp_path}/b.parquet: must have pyarrow to be written; not installed: "
        "pip install 'f3t-skin[data]'"
    )
