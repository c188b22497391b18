"""Foreign dialects: handmade frames of XELA and iCub skins to counts, never to forces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import skin
from bus import Assembler, Status
from skin.decode.decoder import Decoder
from tests.fixtures.bus import frame, join
from tests.fixtures.topology import write_topology
from topology import CHANNELS, load
from topology.summary import summary

BX, BY, BZ, FREQUENCY = (CHANNELS.index(name) for name in ("bx", "by", "bz", "frequency"))
PERIOD_NS = 10_000_000
LINE = 'kind = "grid"\nrows = 1\npitch_m = 0.02\n'
RATE = "cycle_rate_hz = 100"

axes = st.tuples(*3 * [st.integers(0, 65535)])


@pytest.fixture(scope="module")
def xela(tmp_path_factory):
    patch = LINE + 'columns = 3\nlayout = "xela-uskin"\nfirst_id = 0x710'
    return load(write_topology(tmp_path_factory.mktemp("xela"), bus=RATE, patch=patch))


@pytest.fixture(scope="module")
def icub(tmp_path_factory):
    """Two triangles of board 2."""
    patch = LINE + 'columns = 24\nlayout = "icub-skin"\nfirst_id = 0x420'
    return load(write_topology(tmp_path_factory.mktemp("icub"), bus=RATE, patch=patch))


def taxel(k, x, y, z, *, cycle=0):
    """Make a XELA frame."""
    data = bytes([0]) + b"".join(v.to_bytes(2, "big") for v in (x, y, z))
    return frame(0x710 + k, data, stamp_ns=PERIOD_NS * (cycle + 1) + 100_000 * k)


def head(values, *, triangle=0, cycle=0):
    """Make the first frame of an iCub triangle."""
    stamp = PERIOD_NS * (cycle + 1) + 200_000 * triangle
    return frame(0x420 + triangle, bytes([0x40, *values[:7]]), stamp_ns=stamp)


def tail(values, *, triangle=0, cycle=0, out_of_range=0, errors=0):
    """Make the second one: five taxels, a mask of those out of range, error flags."""
    stamp = PERIOD_NS * (cycle + 1) + 200_000 * triangle + 100_000
    data = bytes([0xC0, *values[7:], out_of_range >> 4, (out_of_range & 15) << 4 | errors])
    return frame(0x420 + triangle, data, stamp_ns=stamp)


def last_cycle(topology, *frames):
    assembler = Assembler(topology)
    for _ in assembler.feed(join(*frames)):
        pass
    cycle = assembler.flush()
    assert cycle is not None
    return cycle


@given(st.tuples(axes, axes, axes))
def test_xela_taxels_are_read_big_endian_and_unsigned(xela, values):
    cycle = last_cycle(xela, *(taxel(k, *xyz) for k, xyz in enumerate(values)))
    assert cycle.valid.all()
    for k, xyz in enumerate(values):
        wire = xela.scale[BX : BZ + 1, k] * cycle.counts[BX : BZ + 1, k] + xela.offset[BX:, k][:3]
        assert wire.tolist() == list(xyz)


def test_a_silent_xela_taxel_is_never_read_as_no_touch(xela):
    cycle = last_cycle(xela, taxel(0, 1, 2, 3), taxel(2, 4, 5, 6))
    assert cycle.valid.tolist() == [True, False, True]
    assert cycle.status[1] == Status.NEVER


@given(st.lists(st.integers(0, 255), min_size=12, max_size=12), st.integers(0, 4095))
def test_icub_triangles_are_put_together_of_head_and_tail(icub, values, out_of_range):
    other = values[::-1]
    cycle = last_cycle(
        icub, head(values), tail(values, out_of_range=out_of_range),
        head(other, triangle=1), tail(other, triangle=1),
    )  # fmt: skip
    assert cycle.counts[FREQUENCY].tolist() == values + other
    wrong = [out_of_range >> k & 1 == 1 for k in range(12)]
    assert ((cycle.status[:12] & Status.FAULT) != 0).tolist() == wrong
    assert cycle.valid[12:].all()


def test_an_icub_triangle_without_acknowledge_or_connection_is_at_fault_as_a_whole(icub):
    values = list(range(12))
    for errors in (1, 2):
        cycle = last_cycle(
            icub, head(values), tail(values, errors=errors),
            head(values, triangle=1), tail(values, triangle=1),
        )  # fmt: skip
        assert (cycle.fault_code[:12] == errors).all()
        assert cycle.valid.tolist() == 12 * [False] + 12 * [True]


@pytest.mark.parametrize("lost", ["head", "tail"])
def test_a_torn_icub_triangle_keeps_its_last_whole_value(icub, lost):
    old, new, newest = ([value] * 12 for value in (10, 20, 30))
    half = head if lost == "tail" else tail
    frames = join(
        head(old), tail(old), half(new, cycle=1), half(new, cycle=2),
        *(make(newest, cycle=cycle) for cycle in (3, 4, 5) for make in (head, tail)),
    )  # fmt: skip
    assembler = Assembler(icub)
    cycles = [(c.counts[FREQUENCY, :12].tolist(), c.status[0]) for c in assembler.feed(frames)]
    assert [counts for counts, _ in cycles] == [12 * [v] for v in (10, 10, 30, 30)]
    assert [status & Status.TORN != 0 for _, status in cycles] == [False, True, False, False]
    assert assembler.counters.torn == 2
    assert assembler.counters.data == 8


def test_a_page_that_nobody_knows_is_foreign(icub):
    strange = frame(0x420, bytes([0x80] + 7 * [1]), stamp_ns=PERIOD_NS)
    assembler = Assembler(icub)
    assert list(assembler.feed(strange)) == []
    assert assembler.counters.foreign == 1
    assert assembler.counters.data == 0


def test_a_check_says_which_patches_give_counts_only(icub):
    (note,) = summary(icub)["warnings"]
    assert note == (
        "patch 'patch' gives counts only: its layout 'icub-skin' is of another sensor (not F3T)"
    )


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    patch = LINE + 'columns = 2\nlayout = "f3t-classic"\nfirst_id = 0x100'
    more = (
        '[[patches]]\nname = "far"\nbus = "main"\npose = { xyz_m = [0, 1, 0] }\n'
        f'{LINE}columns = 2\nlayout = "xela-uskin"\nfirst_id = 0x710'
    )
    return load(write_topology(tmp_path_factory.mktemp("mixed"), bus=RATE, patch=patch, more=more))


@pytest.mark.usefixtures("interpreted")
def test_foreign_units_are_flagged_and_never_decoded(mixed):
    assert mixed.counts_only.tolist() == [False, False, True, True]
    counts = np.zeros((2, 6, 4), np.int16)
    # A unit at rest: 4500 Hz, some 4 mT along the axis, little across.
    counts[:, 0], counts[:, FREQUENCY], counts[:, BX], counts[:, BZ] = 180, 9000, 5, 66
    for dtype in ("float32", "float64"):
        reading = Decoder(mixed, dtype=dtype, sweeps=0, ambient=False)(counts)
        assert (reading.status[:, 2:] == Status.NOT_F3T).all()
        assert reading.valid.tolist() == 2 * [[True, True, False, False]]
        values = [reading.temperature, reading.force, reading.tangential, reading.theta,
                  reading.displacement_mm]  # fmt: skip
        for value in values:
            assert np.isnan(value[..., 2:]).all()
            assert np.isfinite(value[..., :2]).all()


def test_foreign_units_are_left_out_of_the_wrench_and_named(mixed):
    with skin.open(mixed, simulate=True, pace=False, sync="bus") as opened:
        for state in opened:
            if state.units.valid[:2].all():
                break
        assert np.isfinite(state.wrench).all()
        assert state.coverage == pytest.approx(0.5)
        assert {"far/r0c0", "far/r0c1"} <= set(opened.trouble(state))
