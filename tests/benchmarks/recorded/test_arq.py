"""Slip sets of ARQ: what h5py wrote is what is read, and what is wrong is named."""

import numpy as np
import pytest

from benchmarks.recorded import arq
from benchmarks.recorded.array import Array
from benchmarks.recorded.read import read
from benchmarks.recorded.recording import Label, RecordingError
from tests.benchmarks.recorded.made import (
    HELD_S,
    MM_PER_READING,
    OFFSET,
    PRESS_S,
    arq_group,
    depths_mm,
    played,
    write_arq,
)

h5py = pytest.importorskip("h5py")
TOLD = Array(mm_per_reading=(MM_PER_READING, MM_PER_READING), n_per_mm=(1.0, 3.0))
GROUP = "GGCNN2/brush/Pose1/Exp1"


@pytest.mark.parametrize(("n", "rate_hz"), [(18, 180.0), (24, 100.0)])
def test_displacements_forces_and_labels_are_those_that_were_played(tmp_path, n, rate_hz):
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group(n, rate_hz=rate_hz)})
    (one,), left_out = read(file, TOLD)
    moved, slipping = played(one.time_s, depths_mm(n, {18: 3, 24: 4}[n]))
    assert left_out == []
    assert one.name == f"a.h5:{GROUP}"
    assert one.array == f"uSkin {n}, labels by hand"
    assert one.rate_hz == pytest.approx(rate_hz)
    np.testing.assert_allclose(one.displacement_mm, moved, atol=6 * MM_PER_READING * 2.1)
    np.testing.assert_allclose(one.force[:, 2], 3.0 * one.displacement_mm[:, 2], rtol=1e-5)
    np.testing.assert_allclose(one.force[:, 0], one.displacement_mm[:, 0], rtol=1e-5)
    np.testing.assert_array_equal(one.label == Label.SLIP, slipping.any(axis=1))
    taken = (one.time_s >= PRESS_S) & (one.time_s < HELD_S)
    np.testing.assert_array_equal(one.label == Label.IGNORE, taken)
    noise = MM_PER_READING * np.hypot(2.0, 12**-0.5)
    assert np.median(one.displacement_sigma_mm) == pytest.approx(noise, rel=0.2)


def test_each_code_of_a_label_is_slip_hold_or_neither(tmp_path):
    group = arq_group(slips=False)
    codes = group["tactile_slips_label"]
    codes[:] = 0
    codes[-7:] = range(7)
    (one,), _ = read(write_arq(tmp_path / "a.h5", {"Pose1/Exp1": group}), Array(rest=rest(18)))
    hold, slip, ignore = Label.HOLD, Label.SLIP, Label.IGNORE
    assert one.label[-7:].tolist() == [hold, slip, ignore, ignore, hold, slip, ignore]


def rest(n):
    return np.full((3, n), OFFSET)


def test_groups_come_in_natural_order(tmp_path):
    groups = {f"Pose1/Exp{k}": arq_group(seconds=1.0) for k in (10, 2, 1)}
    found, _ = read(write_arq(tmp_path / "a.h5", groups), TOLD)
    assert [one.name.rpartition("/")[2] for one in found] == ["Exp1", "Exp2", "Exp10"]


def test_lines_of_the_array_run_as_its_picture_shows(tmp_path):
    (one,), _ = read(write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group()}), TOLD)
    at = one.position_mm.reshape(2, 6, 3) / arq.PITCH_MM
    np.testing.assert_allclose(at[0, :, 0], [2.5, 1.5, 0.5, -0.5, -1.5, -2.5])  # C1 to C6
    np.testing.assert_allclose(at[1, 0], [-1.0, 0.0, 1.0])  # SDA1 to SDA3


def test_readings_that_fall_when_pressed_are_turned_round(tmp_path):
    group = arq_group()
    raw = group["tactile_data_raw"]
    raw[:, 2] = 2.0 * OFFSET - raw[:, 2]
    (one,), _ = read(write_arq(tmp_path / "a.h5", {"Pose1/Exp1": group}), TOLD)
    moved, _ = played(one.time_s, depths_mm(18, 3))
    np.testing.assert_allclose(one.displacement_mm[:, 2], moved[:, 2], atol=0.01)


def test_without_a_scale_the_greatest_readings_are_taken_for_full_way(tmp_path):
    (one,), _ = read(write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group()}), Array())
    shear = np.hypot(one.displacement_mm[:, 0], one.displacement_mm[:, 1])
    assert np.quantile(shear, 0.999) == pytest.approx(arq.FULL_MM[0], rel=1e-3)
    assert np.quantile(one.displacement_mm[:, 2], 0.999) == pytest.approx(arq.FULL_MM[1], rel=1e-3)


def test_recordings_that_begin_in_a_grasp_are_left_out_unless_rest_is_told(tmp_path):
    grasped, slips_first = arq_group(), arq_group()
    grasped["tactile_slips_label"][:10] = 4
    labels = slips_first["tactile_slips_label"]
    labels[labels == 3] = 1
    groups = {"Pose1/Exp1": grasped, "Pose1/Exp2": slips_first, "Pose1/Exp3": arq_group()}
    file = write_arq(tmp_path / "a.h5", groups)
    found, left_out = read(file, TOLD)
    assert [one.name for one in found] == ["a.h5:GGCNN2/brush/Pose1/Exp3"]
    assert [one.why for one in left_out] == [
        "its first 0.25 s, where zeros are taken, must be labelled 0; got 4 (or tell rest by "
        "--array)",
        "the object must be taken after zeros are; got a slip, 1, as the first event (or tell "
        "rest by --array)",
    ]
    told = Array(TOLD.positions_mm, TOLD.mm_per_reading, TOLD.n_per_mm, rest(18))
    found, left_out = read(file, told)
    assert len(found) == 3
    assert left_out == []


def broken(change):
    group = arq_group(seconds=1.0)
    change(group)
    return group


def put(name, values):
    return lambda group: group.__setitem__(name, values)


def put_at(name, index, value):
    return lambda group: group[name].__setitem__(index, value)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            put("tactile_data_raw", np.zeros((18, 180))),
            "/tactile_data_raw: must have shape (18, 3, 180) or (24, 3, 180); got (18, 180)",
        ),
        (
            put("tactile_data_raw", np.zeros((180, 18, 3))),
            "/tactile_data_raw: must have shape (18, 3, 180) or (24, 3, 180); got (180, 18, 3)",
        ),
        (
            put("tactile_slips_label", np.zeros(179, int)),
            "/tactile_slips_label: must have shape (180,); got (179,)",
        ),
        (
            put("tactile_slips_label", np.zeros(180)),
            "/tactile_slips_label: must be integers; got dtype float64",
        ),
        (
            put_at("tactile_slips_label", 5, 9),
            "/tactile_slips_label: must be 0 to 6; got 9 at [5]",
        ),
        (
            put_at("tactile_slips_label", 5, -1),
            "/tactile_slips_label: must be 0 to 6; got -1 at [5]",
        ),
        (
            put_at("tactile_data_raw", (3, 1, 7), np.nan),
            "/tactile_data_raw: must be within ±1e+15; got nan at [3, 1, 7], 1 in all",
        ),
        (
            put_at("tactile_data_raw", (0, 0, 0), 1e300),
            "/tactile_data_raw: must be within ±1e+15; got 1e+300 at [0, 0, 0], 1 in all",
        ),
        (
            put_at("tactile_timestamps", 4, np.inf),
            "/tactile_timestamps: must be within ±1e+15; got inf at [4], 1 in all",
        ),
        (
            put_at("tactile_timestamps", 3, 0.0),
            "/tactile_timestamps[3]: must be after the stamp before, 11.11111111111111; got 0.0",
        ),
        (
            put("tactile_timestamps", np.arange(180) / 180.0),
            "/tactile_timestamps[0]: must be milliseconds, 50 to 1200 samples a second; got steps "
            "of 0.00555556, 180000 a second",
        ),
        (
            put("tactile_timestamps", np.zeros((180, 1))),
            "/tactile_timestamps: must have shape (180,); got (180, 1)",
        ),
        (
            put("tactile_data_raw", np.full((18, 3, 180), b"a")),
            "/tactile_data_raw: must be numbers; got dtype |S1",
        ),
        (
            put("tactile_data_raw", np.zeros((18, 3, 180), complex)),
            "/tactile_data_raw: must be numbers; got dtype complex128",
        ),
        (
            lambda group: group.pop("tactile_slips_label"),
            "/tactile_slips_label: must be a dataset; got none (nearest: 'tactile_changes_label')",
        ),
        (
            lambda group: group.pop("tactile_timestamps"),
            "/tactile_timestamps: must be a dataset; got none",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_dataset(tmp_path, change, text):
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": broken(change)})
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value) == f"{file}: {GROUP}{text}"


def test_objects_and_references_are_refused_and_never_unpickled(tmp_path):
    file = tmp_path / "a.h5"
    write_arq(file, {"Pose1/Exp1": arq_group(seconds=1.0)})
    with h5py.File(file, "a") as opened:
        del opened[f"{GROUP}/tactile_data_raw"]
        text = opened.create_dataset(f"{GROUP}/tactile_data_raw", (2,), h5py.string_dtype())
        text[:] = ["cos\nsystem\n(S'true'\ntR.", "a"]
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value) == (
        f"{file}: {GROUP}/tactile_data_raw: must be numbers; got dtype object"
    )


def test_links_out_of_a_file_are_not_followed(tmp_path):
    write_arq(tmp_path / "other.h5", {"Pose1/Exp1": arq_group(seconds=1.0)})
    file = tmp_path / "a.h5"
    with h5py.File(file, "w") as opened:
        opened["GGCNN2"] = h5py.ExternalLink("other.h5", "/GGCNN2")
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value) == (
        f"{file}: must hold groups with a dataset 'tactile_data_raw'; got no dataset at all"
    )


def test_datasets_that_lie_in_other_files_are_refused(tmp_path):
    write_arq(tmp_path / "other.h5", {"Pose1/Exp1": arq_group(seconds=1.0)})
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group(seconds=1.0)})
    name = f"{GROUP}/tactile_data_raw"
    layout = h5py.VirtualLayout((18, 3, 180), "f8")
    layout[:] = h5py.VirtualSource("other.h5", name, (18, 3, 180))
    with h5py.File(file, "a") as opened:
        del opened[name]
        opened.create_virtual_dataset(name, layout)
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value) == (
        f"{file}: {name}: must hold its numbers itself; got a link to other files"
    )


def test_a_file_without_the_datasets_is_told_what_it_has(tmp_path):
    file = tmp_path / "a.h5"
    with h5py.File(file, "w") as opened:
        for k in range(7):
            opened[f"run{k}/forces"] = np.zeros(3)
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value) == (
        f"{file}: must hold groups with a dataset 'tactile_data_raw'; got 'run0/forces', "
        "'run1/forces', 'run2/forces', 'run3/forces', 'run4/forces' and 2 more"
    )


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_file_that_is_cut_short_is_named(tmp_path, share):
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group(seconds=1.0)})
    raw = file.read_bytes()
    file.write_bytes(raw[: int(share * len(raw))])
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value).startswith(f"{file}: must be a whole HDF5 file; got ")
    assert "truncated" in str(error.value)


def test_a_chunk_that_is_broken_is_named_with_its_dataset(tmp_path):
    file = tmp_path / "a.h5"
    with h5py.File(file, "w") as opened:
        for key, values in arq_group(seconds=1.0).items():
            opened.create_dataset(f"{GROUP}/{key}", data=values, compression="gzip")
    with h5py.File(file) as opened:
        chunk = opened[f"{GROUP}/tactile_data_raw"].id.get_chunk_info(0)
    raw = bytearray(file.read_bytes())
    raw[chunk.byte_offset : chunk.byte_offset + 16] = bytes(16)
    file.write_bytes(raw)
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value).startswith(f"{file}: {GROUP}/tactile_data_raw: must be readable; got ")


def test_a_damaged_file_is_refused_or_read_and_nothing_else(tmp_path):
    whole = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group(seconds=0.5)}).read_bytes()
    file, rng = tmp_path / "b.h5", np.random.default_rng(5)
    told = []
    for _ in range(150):
        raw = bytearray(whole)
        for at in rng.integers(8, 6000, 4):  # where names, shapes and types are
            raw[at] = rng.integers(256)
        file.write_bytes(raw)
        try:
            read(file, TOLD)
        except RecordingError as error:
            told.append(str(error))
    assert len(told) > 50
    assert all(text.startswith(f"{file}: ") for text in told)


def test_a_pointer_of_git_lfs_is_told_what_to_do(tmp_path):
    file = tmp_path / "slipDataset_brush_tactile.h5"
    file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 41105856\n")
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value) == (
        f"{file}: must be the recording itself; got a pointer of Git LFS: git lfs pull"
    )


def test_an_array_that_nothing_touches_has_no_scale(tmp_path):
    group = arq_group(seconds=1.0)
    group["tactile_data_raw"][:] = OFFSET
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": group})
    with pytest.raises(RecordingError) as error:
        read(file, Array())
    assert str(error.value) == (
        f"{file}: tactile_data_raw: must change where the array is touched; got 99.9% of shears "
        "and depths within 0 and 0 of rest"
    )


def test_groups_of_two_kinds_of_array_are_refused(tmp_path):
    groups = {"Pose1/Exp1": arq_group(18, seconds=1.0), "Pose1/Exp2": arq_group(24, seconds=1.0)}
    file = write_arq(tmp_path / "a.h5", groups)
    with pytest.raises(RecordingError) as error:
        read(file, TOLD)
    assert str(error.value) == (
        f"{file}: tactile_data_raw: must have as many taxels in each group; got 18 and 24"
    )


def test_a_description_of_another_array_is_refused(tmp_path):
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group(seconds=1.0)})
    with pytest.raises(RecordingError) as error:
        read(file, Array(rest=rest(24)))
    assert str(error.value) == (
        f"{file}: {GROUP}/tactile_data_raw: must have as many taxels as rest of --array, 24; got 18"
    )


def test_without_h5py_the_extra_is_named(tmp_path, monkeypatch):
    file = write_arq(tmp_path / "a.h5", {"Pose1/Exp1": arq_group(seconds=1.0)})
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(ImportError) as error:
        read(file, TOLD)
    assert str(error.value) == (
        f"{file}: must have h5py to be read; not installed: pip install 'f3t-skin[hdf5]'"
    )
