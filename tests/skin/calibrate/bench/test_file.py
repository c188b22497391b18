"""BENCH files and tables: what is wrong is named with its line and key."""

from __future__ import annotations

import numpy as np
import pytest

from skin.calibrate.bench.file import read_bench
from skin.calibrate.bench.series import read_table
from skin.errors import ScanError
from topology import TopologyError

GOOD = """format = 1
topology = "palm"

[columns]
time = { column = "t", unit = "ms" }
force_z = { column = "Fz", unit = "gf", reversed = true }

[[recordings]]
counts = "a.log"
reference = "a.csv"
units = { "palm/r0c0" = "F3T-7" }
segments = [
  { kind = "tare", start_s = 0.0, end_s = 10.0 },
]
"""


def refused(folder, text):
    """What is said of a BENCH file of this text, without the file's name."""
    for name in ("a.log", "a.csv"):
        (folder / name).write_text("t,Fz\n0,1\n")
    file = folder / "bench.toml"
    file.write_text(text)
    try:
        read_bench(file)
    except TopologyError as error:
        return str(error).replace(f"{file}:", "").splitlines()
    return []


def test_a_good_file_is_read_and_its_head_is_that_of_every_recording(tmp_path):
    assert refused(tmp_path, GOOD) == []
    bench, _ = read_bench(tmp_path / "bench.toml")
    (recording,) = bench.recordings
    assert recording.columns["force_z"].reversed
    assert recording.segments[0].end_s == 10.0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("force_z", "force_q", "6: columns force_q: must be a known key; got 'force_q'; nearest"),
        ('"gf"', '"pounds"', "6: columns force_z unit: must be 'N' or 'mN' or 'gf' or 'kgf' or"),
        ('"tare"', '"tear"', "13: recordings[0] segments[0] kind: must be 'array' or 'bare' or"),
        ("end_s = 10.0", "end_s = 0.0", "13: recordings[0] segments[0] end_s: must be above start"),
        ("a.log", "b.log", "9: recordings[0] counts: must be an existing file; got none at"),
        ('"palm/r0c0" = "F3T-7"', "", "11: recordings[0] units: must be a table with one unit"),
        ("time =", "# time =", "4: columns: must have the key time, a table with the column of"),
        ("format = 1", "format = 1\nmount_radius_mm = 1", "2: mount_radius_mm: must be a finite"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, old, new, said):
    (first, *_) = refused(tmp_path, GOOD.replace(old, new))
    assert first.startswith(said)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,f\n0,1\n1,x\n", ":3: f: must be a number; got 'x'"),
        ("t,f\n0,1\n1\n", ":3: must have 2 cells; got 1"),
        ("t,t\n0,1\n", ":1: t: must be a column of its own; got two of that name"),
        ("t,f\n", ": must have rows below its head; got none"),
    ],
)
def test_a_table_that_cannot_be_read_names_line_and_column(tmp_path, text, said):
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(ScanError) as caught:
        read_table(file)
    assert str(caught.value) == f"{file}{said}"


def test_an_empty_cell_is_no_number(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t,f\n0,1\n1,\n2,3\n")
    np.testing.assert_array_equal(read_table(file)["f"], [1.0, np.nan, 3.0])
