"""Arrays of many units, and what is told with them."""

from __future__ import annotations

import numpy as np
import pytest

from bus.status import Status
from skin.decode.decoder import Decoder
from skin.decode.records import LANES
from skin.errors import CountsError
from tests.fixtures.decode import row_of
from tests.skin.decode.test_field_angle import counts_at

pytestmark = pytest.mark.usefixtures("few_variants")


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("background", [None, np.zeros((4, 150), np.float32)])
def test_units_of_a_block_are_idle_together(background):
    """Where none of them is pressed by 2.9 sigma; a unit that is not heard of is not pressed."""
    skin = row_of(150, rate_hz=100.0)
    sigma_mm = np.hypot(6.0, 0.25 * 12.0**-0.5) / 900.0
    decoder = Decoder(skin, {"force"}, skip=True, sweeps=0, ambient=False)
    cases = (
        ({}, []), ({5: 3.0}, [0]), ({16: 2.8, 127: 3.1, 128: 3.1}, [1, 2]),
        ({149: 9.0, 31: 2.8}, [2]), ({40: 99.0}, []), ({47: 3.0}, [0]),
    )  # fmt: skip
    for load, pressed in cases:
        depth, status = np.zeros(150), np.zeros(150, np.uint16)
        for unit, sigmas in load.items():
            depth[unit] = sigmas * sigma_mm
            status[unit] = Status.NEVER if sigmas == 99.0 else 0
        idle = decoder(counts_at(skin, depth, 0.0, 0.0), status, background).status == Status.IDLE
        expected = ~np.isin(np.arange(150) // LANES, pressed)
        np.testing.assert_array_equal(idle, expected & (status == 0))


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
            decoder.inputs(raw, flags)
    for raw, flags in ((counts[:5], status), (counts, status[:3])):
        with pytest.raises(CountsError, match="must be an array of"):
            decoder.inputs(raw, flags)
    decoder.step(decoder.inputs(counts, status))
    assert decoder.reading.valid.shape == (4,)
