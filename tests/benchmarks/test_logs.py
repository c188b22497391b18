"""The benchmark of logs compares every frame, and its table shows what it found."""

import zlib

import numpy as np
import pytest

from benchmarks import logs


@pytest.mark.parametrize(("kind", "length", "flags"), [("classic", 8, 0), ("fd", 64, 5)])
@pytest.mark.parametrize("suffix", logs.FORMATS.values())
def test_both_readers_read_what_was_recorded(kind, length, flags, suffix, tmp_path):
    records = logs.record(logs.SKINS[kind], 300)
    assert set(records["length"]) == {length}
    assert set(records["flags"]) <= {flags, flags & 4}
    path = tmp_path / f"some.{suffix}"
    logs._write(path, logs._messages(records))
    figures = logs._compare(path, records, rounds=1)
    assert figures["frames_wrong"] == 0
    rate = figures["frames_per_s"] / figures["pythoncan_frames_per_s"]
    assert figures["ratio"] == pytest.approx(rate)


def test_a_frame_that_differs_is_counted():
    records = logs.record("strip", 50)
    own, peer = records.copy(), records.copy()
    own["data"][3, 7] ^= 1
    peer["id"][5] += 1
    peer["stamp_ns"][6] += 999
    own["stamp_ns"][7] += 1000
    assert logs._wrong(own, peer, records) == 3
    assert logs._wrong(own[:-1], peer, records) == 50


def test_the_table_has_a_row_for_each_log():
    names = ("frames_wrong", "frames_per_s", "pythoncan_frames_per_s", "ratio", "cpu_ratio",
             "written_per_s", "pythoncan_written_per_s", "bytes_per_frame")  # fmt: skip
    keys = ("candump", "candump_fd", "blf", "blf_fd")
    figures = {f"{key}_{name}": np.float64(1234.5) for key in keys for name in names}
    more = ("ratio", "cpu_ratio", "alone_cpu_ratio")
    figures |= {f"{key}_zlib_{name}": 12.3 for key in keys[2:] for name in more}
    shown = logs.table({**figures, "frames": 9, "rounds": 3, "inflated_by": "zlib"}).splitlines()
    assert [line.split()[0] for line in shown[1:-1]] == [*keys, *keys[2:]]


def test_the_containers_of_a_file_hold_its_frames(tmp_path):
    path = tmp_path / "some.blf"
    logs._write(path, logs._messages(logs.record("strip", 5000)))
    inside = b"".join(map(zlib.decompress, logs._containers(path)))
    assert inside.count(b"LOBJ") == 5000
    figures = logs._with_zlib(path, rounds=1)
    assert all(figure > 0 for figure in figures.values())
