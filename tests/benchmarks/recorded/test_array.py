"""Descriptions of arrays: what files do not say of themselves."""

import numpy as np
import pytest

from benchmarks.recorded.array import lattice_mm, load
from benchmarks.recorded.recording import RecordingError


def test_a_description_is_read_as_it_is_written(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text(
        "positions_mm = [[0, 1], [2.5, 3]]\nmm_per_reading = [0.5, 1]\nn_per_mm = [1, 2]\n"
        "rest = [[1, 2, 3], [4, 5, 6]]\npress = -1\n"
    )
    array = load(file)
    np.testing.assert_array_equal(array.positions_mm, [[0, 2.5], [1, 3]])
    np.testing.assert_array_equal(array.rest, [[1, 4], [2, 5], [3, 6]])
    assert (array.mm_per_reading, array.n_per_mm, array.press) == ((0.5, 1.0), (1.0, 2.0), -1)


def test_nothing_told_is_nothing_known(tmp_path):
    (tmp_path / "a.toml").write_text("")
    array = load(tmp_path / "a.toml")
    assert [array.positions_mm, array.mm_per_reading, array.rest, array.press] == [None] * 4


def test_a_lattice_has_its_pitch_and_its_middle_at_zero():
    at = lattice_mm(6, 4, 4.7)
    assert at.shape == (2, 24)
    np.testing.assert_allclose(at.mean(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(at[:, 1] - at[:, 0], [0.0, 4.7])
    np.testing.assert_allclose(at[:, 4] - at[:, 0], [4.7, 0.0])


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("pres = 1", ": key: must be one of positions_mm, mm_per_reading, n_per_mm, rest, press; "
         "got 'pres' (nearest: 'press')"),
        ("press = 0", ": press: must be 1 or -1; got 0"),
        ("press = true", ": press: must be 1 or -1; got True"),
        ("n_per_mm = [1, 0]", ": n_per_mm: must be 2 numbers above 0, shear and normal; "
         "got [1, 0]"),
        ("mm_per_reading = 1", ": mm_per_reading: must be 2 numbers above 0, shear and normal; "
         "got 1"),
        ("rest = [[1, 2]]", ": rest: must be a list of 3 finite numbers a taxel; got [[1, 2]]"),
        ("rest = []", ": rest: must be a list of 3 finite numbers a taxel; got []"),
        ("positions_mm = [[1, nan]]",
         ": positions_mm: must be a list of 2 finite numbers a taxel; got [[1, nan]]"),
        ("positions_mm = [[1, 2], [1, 2]]",
         ": positions_mm: must differ from one another; got two alike"),
        ("positions_mm = [[1, 2]]", ": positions_mm: must be two taxels or more; got 1"),
    ],
)  # fmt: skip
def test_what_no_array_can_be_is_refused(tmp_path, content, text):
    file = tmp_path / "a.toml"
    file.write_text(content)
    with pytest.raises(RecordingError) as error:
        load(file)
    assert str(error.value) == f"{file}{text}"


def test_what_is_no_toml_is_refused(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text("press = ")
    with pytest.raises(RecordingError) as error:
        load(file)
    assert str(error.value).startswith(f"{file}: must be TOML; got Invalid value")
