"""What the benchmark of decoding times: both sides of each ratio do the same work."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import decode_sides, peers_bare
from benchmarks.decode_sides import LIVE, Side
from benchmarks.peers_decode import array_of, counts_of, numpy_decode
from skin.decode import sharing
from skin.decode.decoder import Decoder

N = 384
"""Three blocks of units."""

pytestmark = pytest.mark.usefixtures("interpreted")


@pytest.fixture
def three_processors(monkeypatch):
    """All arrays are worth three threads; returns how many took part, call by call."""
    monkeypatch.setattr(sharing, "processors", lambda: 3)
    monkeypatch.setattr(sharing, "ENOUGH", 1)
    together, threads = sharing.together, []
    monkeypatch.setattr(
        sharing, "together", lambda calls: (threads.append(len(calls)), together(calls))
    )
    return threads


WHOLE = {
    "live": (True, {"estimator": "sine", "consistency": False, "workers": 1}, 1),
    "shared": (True, {"estimator": "sine", "consistency": False}, 3),
    "default": (False, {}, 3),
}
"""Whether units are alike, options and threads of what is copied."""


@pytest.mark.parametrize("name", WHOLE)
def test_a_copy_has_the_bytes_and_the_threads_of_its_decoder(monkeypatch, three_processors, name):
    alike, options, threads = WHOLE[name]
    side = decode_sides.sides_of(N)[name]
    expect_work(side, Decoder(array_of(N, alike=alike), LIVE, sweeps=0, ambient=False, **options))
    calls = decode_sides.with_copies({name: side})
    assert threads_of(calls[name], three_processors) == threads
    expect_copy(monkeypatch, calls[f"copy for {name}"], side, three_processors, threads)


def test_a_recording_is_copied_into_new_arrays_by_as_many_threads(monkeypatch, three_processors):
    side = decode_sides.recording_side(12)
    assert side.counts.shape == (12, 6, 64)
    expect_work(side, Decoder(array_of(64, alike=False), LIVE, sweeps=0, ambient=False))
    calls = decode_sides.with_copies({"decode": side})
    threads = threads_of(calls["decode"], three_processors)
    assert threads == side.threads == 1  # 64 units are one block
    made = expect_copy(monkeypatch, calls["copy for decode"], side, three_processors, threads)
    again = expect_copy(monkeypatch, calls["copy for decode"], side, three_processors, threads)
    assert not np.shares_memory(made, again)


def test_decoders_of_the_peers_tell_what_these_tell(three_processors):
    """In one thread each, as numpy and the paper have it."""
    for name, side in decode_sides.sides_of(N).items():
        if name in WHOLE:
            continue
        counts = renew(side)
        rows = numpy_decode(side.skin, counts)
        limit = 0.5 if "field-angle" in name else 3e-3
        told = side.told()
        np.testing.assert_allclose(told[1:5], rows[1:5], atol=limit, err_msg=name)
        np.testing.assert_allclose(told[0], rows[0], atol=0.6, err_msg=name)  # the paper's fit
        assert threads_of(side.call, three_processors) == side.threads == 1, name
        assert told.shape == rows.shape


@pytest.mark.skipif(peers_bare.compiler() is None, reason="needs a C compiler")
def test_bare_arithmetic_decodes_all_that_the_decoders_decode(three_processors):
    sides = decode_sides.calibrated_sides(N)
    assert list(sides) == [
        decode_sides.BARE, "sine", "sine, consistency", "sine, every 8th temperature",
        "field-angle", "field-angle, consistency", "field-angle, every 8th temperature",
    ]  # fmt: skip
    for name, side in sides.items():
        if side.decoder is not None:
            assert side.decoder.want == LIVE
            assert side.decoder.plan.consistency == name.endswith(" consistency")
            assert side.decoder.plan.temperature_every == (8 if "8th" in name else 1)
            assert side.decoder.estimator == name.split(",")[0]
        counts = renew(side)
        rows = numpy_decode(side.skin, counts)[:4]
        told = side.told()
        assert told.shape == (4, N)
        angle = name.startswith("field-angle")
        np.testing.assert_allclose(told, rows, atol=0.5 if angle else 1e-3, err_msg=name)
        assert threads_of(side.call, three_processors) == side.threads == 1, name


@pytest.mark.parametrize("alike", [False, True])
def test_calibration_that_is_not_counted_is_not_read(alike):
    """Numbers that the kernel's Python never touches may be anything."""
    decoder = Decoder(array_of(N, alike=alike), LIVE, sweeps=0, ambient=False)
    counts = counts_of(decoder.topology)
    side = decode_sides._bound(decoder, counts)
    before = side.told()
    own = decode_sides.touched(decoder, counts)["coefficients"]
    names = {path[1] for way, *path in own}
    assert {"gel_scale", "depth_scale", "x_bx", "angle", "anomaly_share"} <= names
    for name in set(decoder._model.coefficients.dtype.names) - names:
        decoder._model.coefficients[name] = np.nan
    decoder.reset()
    np.testing.assert_array_equal(side.told(), before)
    lanes = sum(size for (way, *_), size in own.items() if way == "read") / 128
    each = sum(decoder._model.coefficients.dtype[name].itemsize for name in names) / 128
    assert lanes == each
    assert side.moved > (1 if alike else N) * each


def renew(side: Side) -> np.ndarray:
    """Counts of one cycle that the side has not been made with, in the array that it reads."""
    side.counts[...] = counts_of(side.skin, seed=9)
    return side.first


def expect_work(side: Side, other: Decoder) -> None:
    """The side's call decodes all of its counts, by such a decoder."""
    assert side.decoder is not None
    assert side.decoder.plan == other.plan
    assert side.decoder.want == LIVE
    renew(side)
    np.testing.assert_array_equal(side.told(), decode_sides._rows(other(side.counts)))


def threads_of(call, threads: list[int]) -> int:
    """Among which a call shares its work."""
    threads.clear()
    call()
    return max(threads, default=1)


def expect_copy(monkeypatch, call, side: Side, threads: list[int], count: int) -> np.ndarray:
    """The call moves the side's bytes in so many threads; where to."""
    moved, copyto = [], np.copyto
    with monkeypatch.context() as patch:
        patch.setattr(
            decode_sides.np, "copyto", lambda to, of: (moved.append((to, of)), copyto(to, of))
        )
        assert threads_of(call, threads) == count
    told = side.told().nbytes + 3 * side.skin.n * side.cycles
    assert side.moved > side.counts.nbytes + told
    assert sum(to.nbytes + of.nbytes for to, of in moved) == pytest.approx(side.moved, abs=1)
    assert len(moved) == count
    return moved[0][0]
