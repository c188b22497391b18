"""Frames of a camera from files: in the order of their times, or of the table."""

from __future__ import annotations

import numpy as np
import pytest

from skin.errors import SkinError
from skin.io.export.frames import read_frames


def test_a_folder_is_read_in_the_order_of_time(tmp_path):
    for stamp_ns in (30, 4, 200):
        (tmp_path / f"{stamp_ns}.png").write_bytes(str(stamp_ns).encode())
    (tmp_path / "notes.txt").write_text("by hand")
    frames = list(read_frames(tmp_path, offset_ns=1000))
    assert [frame.stamp_ns for frame in frames] == [1004, 1030, 1200]
    assert [frame.images for frame in frames] == [
        {"camera": name} for name in (b"4", b"30", b"200")
    ]


def test_an_image_without_a_time_is_refused(tmp_path):
    (tmp_path / "frame1.png").write_bytes(b"")
    with pytest.raises(SkinError) as told:
        list(read_frames(tmp_path))
    assert str(told.value) == (
        f"{tmp_path}/frame1.png: must be named by the time of its frame in ns, as "
        "1700000000000000000.png; got 'frame1.png'"
    )


def test_the_offset_must_leave_times_that_stamps_hold(tmp_path):
    file = tmp_path / "frames.csv"
    file.write_text("stamp_ns,grip\n1700000000000000000,2\n")
    for offset_ns in (9 * 10**18, -9 * 10**18):
        with pytest.raises(SkinError) as told:
            list(read_frames(file, offset_ns))
        assert str(told.value) == (
            f"{file}:2: must be from 0 to {2**63 - 1} ns on the clock of the skin; got "
            f"{1_700_000_000_000_000_000 + offset_ns}"
        )


def test_an_image_of_a_time_that_no_stamp_holds_is_refused(tmp_path):
    (tmp_path / f"{'9' * 30}.png").write_bytes(b"")
    with pytest.raises(SkinError) as told:
        list(read_frames(tmp_path))
    assert str(told.value) == (
        f"{tmp_path}/{'9' * 30}.png: must be from 0 to {2**63 - 1} ns on the clock of the skin; "
        f"got {'9' * 30}"
    )


@pytest.mark.parametrize(("one", "other"), [("7.jpg", "7.png"), ("001.png", "1.png")])
def test_two_images_of_one_time_are_refused_by_name(tmp_path, one, other):
    for name in (other, one):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(SkinError) as told:
        list(read_frames(tmp_path))
    assert str(told.value) == (
        f"{tmp_path}/{other}: must be the only image of its time; got {one!r}, too"
    )


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(SkinError, match=r"must have images .* got none"):
        list(read_frames(tmp_path))


def test_numbers_of_one_feature_stand_together(tmp_path):
    file = tmp_path / "frames.csv"
    file.write_text("time_s,action.x,action.y,grip\n1.5,1,2,3\n\n2.5,4,5,6\n")
    first, second = read_frames(file)
    assert (first.stamp_ns, second.stamp_ns) == (1_500_000_000, 2_500_000_000)
    assert {name: value.tolist() for name, value in second.values.items()} == {
        "action": [4.0, 5.0], "grip": [6.0],
    }  # fmt: skip
    assert first.values["action"].dtype == np.float32


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,grip,grip\n1,2,3\n", ":1: grip: must be a column of its own; got two of that"),
        ("time_s,grip\n", ": must have rows below its head; got none"),
        ("time_s,grip\nnan,2\n", ":2: time_s: must be finite; got 'nan'"),
        (
            f"stamp_ns,grip\n{'9' * 30},2\n",
            f":2: must be from 0 to {2**63 - 1} ns on the clock of the skin; got {'9' * 30}",
        ),
        (
            f"stamp_ns,grip\n{2**63},2\n",
            f":2: must be from 0 to {2**63 - 1} ns on the clock of the skin; got {2**63}",
        ),
        (
            "time_s,grip\n1e10,2\n",
            f":2: must be from 0 to {2**63 - 1} ns on the clock of the skin; got 1{'0' * 19}",
        ),
        (
            "time_s,grip\n1e300,2\n",
            f":2: must be from 0 to {2**63 - 1} ns on the clock of the skin; got 1000000",
        ),
        (
            "time_s,grip\n-1e-9,2\n",
            f":2: must be from 0 to {2**63 - 1} ns on the clock of the skin; got -1",
        ),
        (
            "stamp_ns,grip\n5,2\n\n5,3\n",
            ":4: must be later than the frame before it; got one of the same time",
        ),
        (
            "time_s,grip\n5,2\n3,3\n",
            ":3: must be later than the frame before it; got one 2 s earlier",
        ),
        (
            f"time_s,grip\n5,{'1' * 131073}\n",
            ":2: must be a row of a CSV table; got: field larger than field limit (131072)",
        ),
        ("time_s,grip\n1,2\n2,1e39\n", ":3: grip: must be finite as float32; got 1e+39"),
        ("time_s,grip\n1,-inf\n", ":2: grip: must be finite; got '-inf'"),
        (
            "time_s,arm_stamp_ns\n1,1152921504606846977\n",
            ":2: arm_stamp_ns: must be a number that float32 holds exactly, where it is beyond "
            "16777216; got 1152921504606846977",
        ),
        (
            "time_s,arm_time_s\n1,1795417954.25\n",
            ":2: arm_time_s: must be a number that float32 holds exactly, where it is beyond "
            "16777216; got 1795417954.25",
        ),
    ],
)
def test_a_table_that_cannot_be_is_refused(tmp_path, text, message):
    file = tmp_path / "frames.csv"
    file.write_text(text)
    with pytest.raises(SkinError) as told:
        list(read_frames(file))
    assert str(told.value).startswith(f"{file}{message}")


def test_an_image_that_is_missing_is_named(tmp_path):
    file = tmp_path / "frames.csv"
    file.write_text("time_s,wrist\n1,lost.png\n")
    with pytest.raises(FileNotFoundError, match=r"lost\.png"):
        list(read_frames(file))
