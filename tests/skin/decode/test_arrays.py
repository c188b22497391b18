"""Arrays of many units, and what is told with them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.decode_sides import touched
from bus.status import Status
from skin.decode import bound, sharing
from skin.decode.decoder import Decoder
from skin.decode.records import COEFFICIENT_ROWS, LANES
from skin.errors import CountsError, OptionError
from tests.fixtures.decode import calibrated, row_of, sensible_counts
from tests.skin.decode.test_field_angle import counts_at

pytestmark = pytest.mark.usefixtures("few_variants")

NAMES = ("temperature", "force", "displacement_mm", "status", "valid")


def test_many_units_are_read_where_their_counts_lie(monkeypatch):
    """Copied or not, each cycle's own counts and flags, without and with a background."""
    skin = calibrated(row_of(7), seed=3)
    raw, rng = sensible_counts(skin, 6, 1), np.random.default_rng(0)
    status = rng.choice([0, int(Status.LATE), int(Status.NEVER)], (6, 7)).astype(np.uint16)
    background = rng.normal(0.0, 30.0, (6, 4, 7)).astype(np.float32)
    copying = Decoder(skin, sweeps=0, ambient=False)
    expected = []
    for t in range(6):
        reading = copying(raw[t], status[t] if t % 3 else None, background[t] if t % 2 else None)
        expected.append([getattr(reading, name).copy() for name in NAMES])
    monkeypatch.setattr(bound, "COPIED", 6)
    reading_there = Decoder(skin, sweeps=0, ambient=False)
    for t in range(6):
        found = reading_there(
            raw[t], status[t] if t % 3 else None, background[t] if t % 2 else None
        )
        for name, value in zip(NAMES, expected[t], strict=True):
            np.testing.assert_array_equal(getattr(found, name), value, name)


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("background", [None, np.zeros((4, 150), np.float32)])
def test_sixteen_units_side_by_side_are_idle_together(background):
    """Where none of them is pressed by 2.9 sigma; a unit that is not heard of is not pressed."""
    skin = row_of(150, rate_hz=100.0)
    sigma_mm = np.hypot(6.0, 0.25 * 12.0**-0.5) / 900.0
    decoder = Decoder(skin, {"force"}, skip=True, sweeps=0, ambient=False)
    cases = (
        ({}, []), ({5: 3.0}, [0]), ({16: 2.8, 127: 3.1, 128: 3.1}, [7, 8]),
        ({149: 9.0, 31: 2.8}, [9]), ({40: 99.0}, []), ({47: 3.0}, [2]),
    )  # fmt: skip
    for load, pressed in cases:
        depth, status = np.zeros(150), np.zeros(150, np.uint16)
        for unit, sigmas in load.items():
            depth[unit] = sigmas * sigma_mm
            status[unit] = Status.NEVER if sigmas == 99.0 else 0
        idle = decoder(counts_at(skin, depth, 0.0, 0.0), status, background).status == Status.IDLE
        expected = ~np.isin(np.arange(150) // 16, pressed)
        np.testing.assert_array_equal(idle, expected & (status == 0))


def test_a_fifth_row_of_the_background_is_a_variance():
    """With it, and without it after it; one by one, and as a batch."""
    skin = row_of(4)
    raw = sensible_counts(skin, 3, 1, most=0.8)
    background = np.zeros((3, 5, 4), np.float32)
    background[:, 4] = 300.0**2
    whole = Decoder(skin, sweeps=0, ambient=False)(raw, None, background)
    bare = Decoder(skin, sweeps=0, ambient=False)(raw, None, background[:, :4])
    one = Decoder(skin, sweeps=0, ambient=False)
    for t in range(3):
        wide = one(raw[t], None, background[t]).displacement_sigma_mm.copy()
        np.testing.assert_array_equal(wide, whole.displacement_sigma_mm[t])
    assert (whole.displacement_sigma_mm[:, 0] > bare.displacement_sigma_mm[:, 0]).all()
    np.testing.assert_array_equal(Decoder(skin, sweeps=0, ambient=False)(raw).force, bare.force)


def test_cycles_are_counted_on_through_batches():
    """Temperatures that are held for four cycles are new in the same ones."""
    skin = row_of(3)
    raw = sensible_counts(skin, 14, 2)
    each = Decoder(skin, sweeps=0, ambient=False)(raw).temperature
    held, found = Decoder(skin, temperature_every=4, sweeps=0, ambient=False), []
    for first, last in ((0, 1), (1, 8), (8, 10), (10, 11), (11, 14)):
        given = raw[first] if last == first + 1 else raw[first:last]
        found.append(held(given).temperature.reshape(-1, 3).copy())
    np.testing.assert_array_equal(np.concatenate(found), each[np.arange(14) // 4 * 4])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"background": np.zeros((3, 4, 4), np.float32)}, "background: must be an array"),
        ({"background": np.zeros((2, 3, 4), np.float32)}, r"background: .* shape \(2, 4, 4\)"),
        ({"background": np.zeros((2, 6, 4), np.float32)}, r"background: .* shape \(2, 4, 4\)"),
        ({"status": np.zeros((3, 4), np.uint16)}, r"status: .* shape \(2, 4\)"),
        ({"status": np.zeros((2, 4), np.int64)}, "status: must be an array of uint16"),
    ],
)
def test_arrays_beside_a_batch_have_its_shape(given, message):
    with pytest.raises(CountsError, match=message):
        Decoder(row_of(4), sweeps=0, ambient=False)(np.zeros((2, 6, 4), np.int16), **given)


def test_bound_arrays_must_lie_together():
    decoder = Decoder(row_of(4), sweeps=0, ambient=False)
    counts, status = np.zeros((6, 4), np.int16), np.zeros(4, np.uint16)
    frozen = counts.copy()
    frozen.flags.writeable = False
    for raw, flags in ((np.zeros((4, 6), np.int16).T, status), (frozen, status),
                       (counts, np.zeros(8, np.uint16)[::2])):  # fmt: skip
        with pytest.raises(CountsError, match="row: must be contiguous and writeable to be bound"):
            decoder.bind(raw, flags)
    for raw, flags in ((counts[:5], status), (counts, status[:3])):
        with pytest.raises(CountsError, match="must be an array of"):
            decoder.bind(raw, flags)
    assert decoder.bind(counts, status)() is decoder.reading


@pytest.mark.parametrize("workers", [0, -1])
def test_someone_must_work(workers):
    with pytest.raises(
        OptionError, match=f"workers: must be an integer from 1 to 1024; got {workers}"
    ):
        Decoder(row_of(4), workers=workers, sweeps=0, ambient=False)
    assert Decoder(row_of(4), workers=1, sweeps=0, ambient=False).want >= {"force", "sigma"}
    assert "sigma" not in Decoder(row_of(4), {"force"}, sweeps=0, ambient=False).want


@pytest.mark.parametrize("estimator", ["sine", "field-angle"])
@pytest.mark.parametrize("consistency", [False, True])
@pytest.mark.parametrize("want", [{"temperature", "force"}, {"temperature", "force", "sigma"}])
def test_records_hold_what_a_kernel_reads(estimator, consistency, want):
    skin = row_of(3)
    decoder = Decoder(skin, want, estimator, consistency=consistency, sweeps=0, ambient=False)
    read = touched(decoder, np.zeros((6, skin.n), np.int16))["coefficients"]
    held = set(decoder._model.coefficients.dtype.names)
    only_here = set(COEFFICIENT_ROWS["background"])
    assert {path[2] for path in read} == held - only_here


@pytest.mark.parametrize(
    ("workers", "shares"),
    [(1, [(0, 3)]), (2, [(0, 3), (0, 1), (1, 3)]), (9, [(0, 3), (0, 1), (1, 2), (2, 3)])],
)
def test_blocks_are_shared_out_without_a_rest(workers, shares):
    """The first share is all of them; others come into play from enough units times cycles on."""
    found = sharing.Shares(3 * LANES - 1, np.dtype("float32"), workers)
    assert [(int(c["first"]), int(c["last"])) for c in found.control] == shares
    assert found.of(1) == slice(1)
    many = -(-sharing.ENOUGH // (3 * LANES - 1))
    assert found.of(many) == (slice(1) if workers == 1 else slice(1, None))
    assert found.of(many - 1) == slice(1)
