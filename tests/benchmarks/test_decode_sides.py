"""What the benchmark of decoding times: both sides of each ratio do the same work."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import decode_sides, peers_bare
from benchmarks.decode_sides import LIVE, Side
from benchmarks.peers_decode import counts_of, numpy_decode

N = 384
"""Three blocks of units."""

pytestmark = pytest.mark.usefixtures("interpreted")


def test_decoders_of_the_peers_tell_what_these_tell():
    for name, side in decode_sides.sides_of(N).items():
        if name in ("live", "default"):
            continue
        counts = renew(side)
        rows = numpy_decode(side.skin, counts)
        limit = 0.5 if "field-angle" in name else 3e-3
        told = side.told()
        np.testing.assert_allclose(told[1:5], rows[1:5], atol=limit, err_msg=name)
        np.testing.assert_allclose(told[0], rows[0], atol=0.6, err_msg=name)  # the paper's fit
        assert told.shape == rows.shape


@pytest.mark.skipif(peers_bare.compiler() is None, reason="needs a C compiler")
def test_bare_arithmetic_decodes_all_that_the_decoders_decode():
    sides = decode_sides.calibrated_sides(N)
    assert list(sides) == [
        decode_sides.BARE, "sine", "sine, consistency", "field-angle", "field-angle, consistency",
    ]  # fmt: skip
    for name, side in sides.items():
        if side.decoder is not None:
            assert side.decoder.want == LIVE
            assert side.decoder.plan.consistency == name.endswith(" consistency")
            assert side.decoder.estimator == name.split(",")[0]
        counts = renew(side)
        rows = numpy_decode(side.skin, counts)[:4]
        told = side.told()
        assert told.shape == (4, N)
        angle = name.startswith("field-angle")
        np.testing.assert_allclose(told, rows, atol=0.5 if angle else 1e-3, err_msg=name)


def renew(side: Side) -> np.ndarray:
    """Counts of one cycle that the side has not been made with, in the array that it reads."""
    side.counts[...] = counts_of(side.skin, seed=9)
    return side.first
