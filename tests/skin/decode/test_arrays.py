"""Arrays of many units, and what is told with them."""

from __future__ import annotations

import numpy as np
import pytest

from skin.decode.decoder import Decoder
from skin.errors import CountsError
from tests.fixtures.decode import row_of


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
