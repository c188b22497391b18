"""Tables of PapillArrays: both layouts say the same, and what is wrong is named by its line."""

import numpy as np
import pytest

from benchmarks.recorded.array import Array
from benchmarks.recorded.read import read
from benchmarks.recorded.recording import Label, RecordingError
from tests.benchmarks.recorded.made import (
    depths_mm,
    first_slip_s,
    last_slip_s,
    log_text,
    pillar_rows,
    played,
    write_plain,
)


def onset_s(one):
    return one.time_s[np.argmax(one.label == Label.SLIP)]


def test_a_table_without_a_header_is_read_as_its_columns_are_published(tmp_path):
    file = write_plain(tmp_path / "a.csv", pillar_rows())
    (one,), left_out = read(file, Array())
    depth = depths_mm(9, 3)
    moved, _ = played(one.time_s, depth)
    assert left_out == []
    assert one.array == "PapillArray, labels of the file"
    assert one.rate_hz == pytest.approx(1000.0)
    np.testing.assert_allclose(one.displacement_mm, moved, atol=0.03)
    np.testing.assert_allclose(one.force[:, 2], 3.0 * moved[:, 2], atol=0.07)
    assert onset_s(one) == pytest.approx(first_slip_s(depth), abs=0.002)
    gross_s = one.time_s[np.argmax(one.gross)]
    assert gross_s == pytest.approx(last_slip_s(depth), abs=0.002)


def test_a_log_says_the_same_and_that_its_labels_are_the_sensors(tmp_path):
    rows = pillar_rows(rate_hz=500.0)
    plain = write_plain(tmp_path / "a.csv", rows)
    log = tmp_path / "b.csv"
    log.write_text(log_text(rows))
    (one,), (other,) = read(plain, Array())[0], read(log, Array())[0]
    assert other.array == "PapillArray, the sensor's own word"
    for name in ("time_s", "force", "displacement_mm", "label", "gross"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-4)


def test_a_mark_of_utf_8_and_blank_lines_at_the_end_change_nothing(tmp_path):
    rows = pillar_rows(seconds=1.0, rate_hz=250.0)
    for name, text in (("a.csv", write_plain(tmp_path / "a.csv", rows).read_text()),
                       ("b.csv", log_text(rows))):  # fmt: skip
        file = tmp_path / name
        file.write_text(text)
        (plain,), _ = read(file, Array())
        file.write_text("\ufeff" + text.rstrip() + "\r\n\n \n", encoding="utf-8")
        (marked,), _ = read(file, Array())
        np.testing.assert_array_equal(plain.force, marked.force)


def test_two_sensors_of_a_log_are_two_recordings_and_an_idle_one_is_left_out(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text(log_text(pillar_rows(seconds=1.0, rate_hz=250.0), ("S0", "S1")))
    found, left_out = read(file, Array())
    assert [one.name for one in found] == ["a.csv:S0", "a.csv:S1"]
    assert left_out == []
    idle = pillar_rows(seconds=1.0, rate_hz=250.0)
    idle[:, 1:] = 0.0
    file.write_text(log_text(idle))
    found, left_out = read(file, Array())
    assert found == []
    assert [(one.name, one.why) for one in left_out] == [("a.csv:S0", "no pillar bears load in it")]


@pytest.mark.parametrize(("unit", "per_s"), [("s", 1.0), ("ms", 1e3), ("us", 1e6)])
def test_the_unit_of_a_time_without_one_follows_from_its_steps(tmp_path, unit, per_s):
    rows = pillar_rows(seconds=0.6)
    rows[:, 0] = 10.0 + np.round(rows[:, 0] * per_s, 3)
    (one,), _ = read(write_plain(tmp_path / "a.csv", rows), Array())
    assert one.rate_hz == pytest.approx(1000.0, rel=0.05)
    assert one.time_s[0] == 0.0


def test_forces_without_displacements_are_divided_by_the_stiffness(tmp_path):
    file = write_plain(tmp_path / "a.csv", pillar_rows(seconds=1.0, forces_alone=True))
    (one,), _ = read(file, Array(n_per_mm=(1.0, 3.0)))
    np.testing.assert_allclose(one.displacement_mm[:, 2], one.force[:, 2] / 3.0, rtol=1e-5)
    np.testing.assert_allclose(one.displacement_sigma_mm[:, 0], [0.05, 0.05, 0.05 / 3.0])
    (one,), _ = read(file, Array())
    np.testing.assert_allclose(one.displacement_mm[:, 2], one.force[:, 2] / 6.0, rtol=1e-5)


def test_pillars_stand_in_rows_of_three_about_the_fifth(tmp_path):
    (one,), _ = read(write_plain(tmp_path / "a.csv", pillar_rows(seconds=0.6)), Array())
    assert one.position_mm[:, 4].tolist() == [0.0, 0.0]
    assert one.position_mm[:, :3].tolist() == [[-7.0, 0.0, 7.0], [-7.0, -7.0, -7.0]]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda lines: lines[5].__setitem__(9, "nan"),
         ":6: S0_P1_contact: must be a number within ±1e+15; got 'nan'"),
        (lambda lines: lines[5].__setitem__(9, "one"),
         ":6: S0_P1_contact: must be a number within ±1e+15; got 'one'"),
        (lambda lines: lines[5].__setitem__(3, "1_0"),
         ":6: S0_P0_DX: must be a number within ±1e+15; got '1_0'"),
        (lambda lines: lines[-1].__delitem__(slice(40, None)),
         ":50: must have 73 columns; got 40"),
        (lambda lines: lines[3].__setitem__(0, "0.001"),
         ":4: time: must be after the stamp before, 0.002; got 0.001"),
        (lambda lines: lines[2].__setitem__(2, "2"),
         ":1: S0_P0_slip: must be one of 0, 1; got 2 in sample 2"),
        (lambda lines: lines[2].__setitem__(1, "0.5"),
         ":1: S0_P0_contact: must be one of 0, 1; got 0.5 in sample 2"),
        (lambda lines: [line.__setitem__(0, str(60 * k)) for k, line in enumerate(lines)],
         ": time: must be s, ms or us at 50 to 1200 samples a second; got steps of 60"),
        (lambda lines: lines.__delitem__(slice(1, None)),
         ":1: time: must be 2 stamps or more; got 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_table_is_named_with_its_line(tmp_path, change, text):
    file = write_plain(tmp_path / "a.csv", pillar_rows(seconds=0.05))
    lines = [line.split(",") for line in file.read_text().splitlines()]
    change(lines)
    file.write_text("\n".join(map(",".join, lines)) + "\n")
    with pytest.raises(RecordingError) as error:
        read(file, Array())
    assert str(error.value) == f"{file}{text}"


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("S0_P3_FY", "S0_P3_FN",
         ":1: must have columns T_us, S0_P0_DX … S0_P8_slipState, or no header and 73 columns; "
         "got none named 'S0_P3_FY'"),
        ("S0_FrictionEst", "T_us", ":1: must name each column once; got 'T_us' twice"),
        (",1,-2,", ",1,7,",
         ":2: S0_P0_slipState: must be one of 0, -2, -1, 1, 2, 3; got 7 in sample 0"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_log_is_named(tmp_path, old, new, text):
    file = tmp_path / "a.csv"
    content = log_text(pillar_rows(seconds=0.1, rate_hz=500.0)).replace(",0,-2,", ",1,-2,")
    file.write_text(content.replace(old, new, 1))
    with pytest.raises(RecordingError) as error:
        read(file, Array())
    assert str(error.value) == f"{file}{text}"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", ":1: must be a line of a table of a PapillArray; got ''"),
        (b"hello\n", ":1: must be a line of a table of a PapillArray; got 'hello\\n'"),
        (b"\x80\x04\x95", ": must be a table in ASCII or HDF5; got neither"),
        (b"1,2,3,4\n", ":1: must have 73 columns; got 4"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, content, text):
    file = tmp_path / "a.csv"
    file.write_bytes(content)
    with pytest.raises(RecordingError) as error:
        read(file, Array())
    assert str(error.value) == f"{file}{text}"


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RecordingError) as error:
        read(tmp_path / "none.csv", Array())
    assert str(error.value) == (
        f"{tmp_path / 'none.csv'}: must be a file to read; got No such file or directory"
    )
