"""Real readings: they are read without loss, and the figures are those of made signals."""

import numpy as np
import pytest

from benchmarks.recorded import noise, probe, run, table
from benchmarks.recorded.eflesh import COUNT_UT, STORED, Probe, _unpacked, load, pack, turned
from benchmarks.recorded.recording import RecordingError


def write(folder, held=None):
    """A set of the source's layout: counts, so that nothing is lost."""
    rng = np.random.default_rng(3)
    levels = rng.integers(-9000, 9000, (4, 40, 30)) if held is None else held
    field = levels * np.tile(COUNT_UT, 2)
    np.savez(folder / "slip_even.npz", field=field.astype(np.float32),
             pulled=np.array([1, 0, 1, 0], np.int8), sequence=np.arange(4))  # fmt: skip
    for name, chips in (("normal_force", 1), ("shear_force", 2)):
        states = np.stack([np.zeros(40), np.zeros(40), np.arange(40.0), np.arange(40.0) - 1.0], 1)
        np.savez(folder / f"{name}.npz", time_s=np.arange(40) / 10.0, states=states,
                 states_time_s=np.arange(40) / 10.0,
                 field=rng.integers(-9, 9, (40, 15 * chips)) * np.tile(COUNT_UT, chips),
                 )  # fmt: skip
    return folder


def test_what_is_packed_is_read_as_the_source_has_it(tmp_path, monkeypatch):
    folder = write(tmp_path)
    pack(folder, tmp_path / "packed.npz")
    monkeypatch.setattr("benchmarks.recorded.eflesh.STORED", tmp_path / "packed.npz")
    source, packed = load(folder), load()
    np.testing.assert_allclose(packed.held_ut, source.held_ut, atol=2e-3)
    assert packed.pulled.tolist() == source.pulled.tolist() == [True, False, True, False]
    np.testing.assert_allclose(packed.shear.field_ut, source.shear.field_ut, atol=2e-3)
    assert packed.normal.force.tolist() == list(range(39))  # -1 is no force


def test_other_arrays_are_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"must be an \.npz file to read"):
        load(tmp_path)
    folder = write(tmp_path)
    np.savez(folder / "slip_even.npz", field=np.zeros((4, 40, 29)), pulled=np.zeros(4))
    with pytest.raises(RecordingError, match=r"\(recordings, samples, 30\)"):
        load(folder)


def test_the_stored_set_is_that_of_the_source_and_small():
    found = load()
    assert found.held_ut.shape == (69, 300, 2, 5, 3)
    assert (int(found.pulled.sum()), int((~found.pulled).sum())) == (52, 17)
    assert STORED.stat().st_size < 1_000_000
    assert set(_unpacked()) == {"slip_even", "normal_force", "shear_force"}


def test_turned_fields_keep_their_length_and_their_z():
    field = np.random.default_rng(1).normal(size=(7, 2, 5, 3))
    out = turned(field)
    np.testing.assert_allclose(np.linalg.norm(out, axis=-1), np.linalg.norm(field, axis=-1))
    np.testing.assert_array_equal(out[..., 2], field[..., 2])


def test_noise_of_a_known_mixture_is_split_into_its_parts():
    rng = np.random.default_rng(5)
    r, t, white, walk, time_s, drift = 40, 300, 4.0, 3.0, 0.2, 5.0
    values = np.zeros((r, t, 30))
    keep = np.exp(-1.0 / (100.0 * time_s))
    state = walk * rng.normal(size=(r, 30))
    for k in range(t):
        values[:, k] = state + drift * k / 100.0
        state = keep * state + walk * np.sqrt(1.0 - keep**2) * rng.normal(size=(r, 30))
    values += white * rng.normal(size=values.shape)
    found = noise.noise(values.reshape(r, t, 2, 5, 3))
    assert found["white_ut"]["median"] == pytest.approx(white, rel=0.07)
    assert found["walk_ut"]["median"] == pytest.approx(walk, rel=0.3)
    # of steps: 2 white² of it and 2 walk² (1 - keep); turned chips mix axes of one variance
    step = 2.0 * walk**2 * (1.0 - keep)
    share = 2.0 * white**2 / (2.0 * white**2 + step)
    assert found["white_share"]["0.01 s"]["median"] == pytest.approx(share, abs=0.05)
    assert found["correlation"]["white"]["fingers"] < 0.03


def test_correlation_of_units_is_found_where_it_is():
    rng = np.random.default_rng(6)
    values = rng.normal(size=(30, 300, 2, 5, 3))
    values[:, :, 0] += np.sqrt(0.5) * rng.normal(size=(30, 300, 1, 1))  # 1/3 of a finger's variance
    found = noise.noise(values)["correlation"]["white"]
    assert found["fingers"] < 0.05
    # turned axes share it with other signs: the sum of squares of a pair of chips is kept
    assert found["units of a finger"] > 0.15


def test_a_law_of_the_first_half_is_scored_on_the_second():
    rng = np.random.default_rng(7)
    t = np.arange(2000)
    place = np.abs(t % 200 - 100) / 10.0
    # the three axes of a chip are independent, or no fit could distinguish them
    field = place[:, np.newaxis] * [3.0, -1.0, 2.0] + rng.normal(0.0, 0.5, (2000, 3))
    force = 7.0 + field @ [0.4, 1.0, -0.3] + rng.normal(0.0, 0.2, 2000)
    found = probe.force_of(Probe(t / 10.0, field, place, force))
    full = np.ptp(force)
    assert found["chosen"]["order"] == 1
    assert found["linear"]["rmse"] * full == pytest.approx(0.2, rel=0.1)


def test_the_figures_of_a_short_run_are_shown():
    found = run(quick=True)
    shown = table(found)
    assert "without training" in shown
    assert "second" in shown
    pulls = found["pulls"]["slip"]
    assert pulls["pulled"]["trials"] + pulls["held"]["trials"] == pulls["right"]["trials"] == 12
