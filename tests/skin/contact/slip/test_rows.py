"""The memory of slip: each name has rows of its own, and all rows together are the blocks."""

import numpy as np
import pytest

from skin.contact.slip import data as names
from skin.contact.slip.data import SlipData, row_length, slip_arrays


@pytest.mark.parametrize("n", [1, 7, 8, 9, 16, 17, 33])
def test_rows_are_whole_vectors_odd_in_number_and_long_enough(n):
    assert row_length(n) >= n
    assert row_length(n) % 16 == 8


def test_memory_begins_as_zeros():
    for block in SlipData.zeros(5):
        assert not block.any()


def flat(arrays):
    return [part for each in arrays for part in (each if isinstance(each, tuple) else (each,))]


def test_every_name_has_rows_of_its_own_and_no_row_is_without():
    data = SlipData.zeros(3)
    arrays = slip_arrays(data)
    for block, named in (
        (data.kept, arrays.kept),
        (data.history, arrays.history),
        (data.unit, arrays.scratch.unit),
        (data.row, arrays.scratch.row),
        (data.vectors, arrays.scratch.fit[:3] + arrays.scratch.fit[5:]),
        (data.grid, arrays.scratch.pattern[1:]),
    ):
        for array in flat(named):
            np.add(array, 1.0, out=array)
        assert (block == 1.0).all(), named


def test_rows_that_others_read_are_those_of_their_names():
    data = SlipData.zeros(3)
    kept, history, scratch = slip_arrays(data)
    history.began[:], history.noisy[:], kept.noise_ratio[:] = 1.0, 2.0, 3.0
    assert (data.history[names.BEGAN] == 1.0).all()
    assert (data.history[names.NOISY_UNIT] == 2.0).all()
    assert (data.kept[names.NOISE_RATIO] == 3.0).all()
    assert scratch.pattern.prior is data.prior
    assert scratch.noise is data.noise
    two = {"anchor", "lag", "moved", "moved_slow", "followed", "followed_out", "lag_mean",
           "behind"}  # fmt: skip
    for name in kept._fields:
        assert getattr(kept, name).ndim == 1 + (name in two)
    for name in ("displacement", "direction", "moved_out"):
        assert getattr(scratch.row, name).shape[0] == 2
    assert np.shape(scratch.fit.axes) == (3, names.MOTIONS)
    assert [each.shape[0] for each in scratch.row.design] == [names.NUISANCES] * 2
    assert scratch.row.nuisance.shape[0] == names.NUISANCES
    assert history.mean_lag.shape[0] == history.lag_sum.shape[0] == 2
