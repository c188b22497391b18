"""Packing and unpacking against cantools, python-can and arithmetic bit by bit."""

import cantools.database.can as dbc
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bus
from bus import FrameBatch, LayoutError, Packer
from bus import codec_kernels as kernels
from bus.frame import as_bytes
from bus.table import FrameTable
from tests.fixtures.bus import counts_of, data_frames, make_topology
from tests.naive.bus import bits_of, crc16
from topology import CHANNELS, LAYOUTS, Signal, WireLayout

FD_SIZES = [*range(1, 9), 12, 16, 20, 24, 32, 48, 64]


@st.composite
def layouts(draw, parts=1):
    """Draw layouts whose signals lie anywhere, in either byte order, without overlap."""
    size = draw(st.sampled_from(FD_SIZES))
    units = draw(st.integers(1, 3))
    free = {(part, byte, bit) for part in range(parts) for byte in range(size) for bit in range(8)}
    wanted = [(name, slot) for name in (*CHANNELS, "unit_status") for slot in range(units)]
    wanted += [("sequence", 0), ("status", 0)]
    signals = []
    for name, slot in draw(st.permutations(wanted)):
        signed = name in CHANNELS and draw(st.booleans())
        length = draw(st.integers(1, 16))
        signal = Signal(
            name=name,
            start=draw(st.integers(0, 8 * size - 1)),
            length=length,
            signed=signed,
            order=draw(st.sampled_from(["little", "big"])),
            slot=slot,
            part=draw(st.integers(0, parts - 1)),
        )
        places = {(signal.part, byte, bit) for byte, bit in bits_of(signal)}
        if places <= free:
            free -= places
            signals.append(signal)
    return WireLayout(name="any", size=size, fd=size > 8, units=units, parts=parts,
                      signals=tuple(signals))  # fmt: skip


def as_dbc(layout, part=0):
    """Write the layout down as a message of cantools."""
    return dbc.Message(
        frame_id=0x100,
        name="frame",
        length=layout.size,
        is_fd=layout.fd,
        strict=True,
        signals=[
            dbc.Signal(f"{s.name}_{s.slot}", s.start, s.length, f"{s.order}_endian", s.signed)
            for s in layout.signals
            if s.part == part
        ],
    )


def unpack(small, records):
    """Unpack without assembling: counts and fault codes."""
    tables = FrameTable(small).tables
    counts = np.zeros((len(CHANNELS), small.n), np.int16)
    codes = np.zeros(small.n, np.uint8)
    data, flat = as_bytes(records), counts.reshape(-1)
    for f in range(len(small.frames)):
        kernels.unpack_frame(data, f, f, tables, flat, codes)
    return counts, codes


def limits(signal):
    """Return the smallest and the largest integer of a signal."""
    if signal.signed:
        return -(1 << signal.length - 1), (1 << signal.length - 1) - 1
    return 0, (1 << signal.length) - 1


def bias(signal):
    """Return what is taken off an integer so that it fits in int16."""
    return 32768 if signal.length == 16 and not signal.signed else 0


@given(layouts(), st.data())
def test_frames_are_those_of_cantools(layout, data):
    small = make_topology(layout, units=layout.units)
    message = as_dbc(layout)
    values = {
        f"{s.name}_{s.slot}": data.draw(st.integers(*limits(s)), f"{s.name}_{s.slot}")
        for s in layout.signals
        if s.name != "status"
    }
    counts = np.zeros((len(CHANNELS), small.n), np.int16)
    codes = np.zeros(small.n, np.uint8)
    for s in layout.signals:
        if s.name in CHANNELS:
            counts[CHANNELS.index(s.name), s.slot] = values[f"{s.name}_{s.slot}"] - bias(s)
        elif s.name == "unit_status":
            values[f"{s.name}_{s.slot}"] &= 0xFF
            codes[s.slot] = values[f"{s.name}_{s.slot}"]
        elif s.name == "status":
            values["status_0"] = 0
    batch = FrameBatch(2)
    Packer(small)(counts, batch, sequence=values.get("sequence_0", 0), fault_code=codes)
    packed = batch.frames[0]
    expected = message.encode(values, scaling=False, padding=False) if values else b""
    assert packed["data"][: layout.size].tobytes() == expected.ljust(layout.size, b"\0")

    back, back_codes = unpack(small, batch.frames)
    decoded = message.decode(packed["data"][: layout.size].tobytes(), scaling=False)
    for s in layout.signals:
        if s.name in CHANNELS:
            count = decoded[f"{s.name}_{s.slot}"] - bias(s)
            assert back[CHANNELS.index(s.name), s.slot] == count
        elif s.name == "unit_status":
            assert back_codes[s.slot] == decoded[f"{s.name}_{s.slot}"]


@given(layouts(parts=3), st.data())
def test_unpacking_undoes_packing(layout, data):
    small = make_topology(layout, units=2 * layout.units)
    counts = np.zeros((len(CHANNELS), small.n), np.int16)
    for s in layout.signals:
        if s.name in CHANNELS:
            for unit in (s.slot, layout.units + s.slot):
                value = data.draw(st.integers(*limits(s)))
                counts[CHANNELS.index(s.name), unit] = value - bias(s)
    batch = FrameBatch(8)
    assert Packer(small)(counts, batch, sequence=3) == len(small.frames)
    np.testing.assert_array_equal(unpack(small, batch.frames)[0], counts)


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_count_beyond_its_bits_is_written_as_the_nearest_that_fits(name):
    layout = LAYOUTS[name]
    small = make_topology(layout, units=layout.units)
    for rail, side in ((-32768, 0), (32767, 1)):
        counts = np.full((len(CHANNELS), small.n), rail, np.int16)
        codes = np.full(small.n, 255, np.uint8)
        batch = FrameBatch(2)
        Packer(small)(counts, batch, sequence=0, fault_code=codes)
        back, back_codes = unpack(small, batch.frames)
        for s in layout.signals:
            if s.name in CHANNELS:
                count = back[CHANNELS.index(s.name), s.slot]
                assert count == limits(s)[side] - bias(s) == s.rails[side]
            elif s.name == "unit_status":
                assert back_codes[s.slot] == min(255, limits(s)[1])


@given(st.binary(max_size=80))
def test_crc_is_that_of_the_bitwise_division(data):
    assert bus.crc16(data) == crc16(data)


def test_crc_has_the_published_check_value():
    assert bus.crc16(b"123456789") == crc16(b"123456789") == 0x29B1


@pytest.mark.parametrize("name", ["f3t-fd16", "f3t-fd64"])
@pytest.mark.parametrize("first_id", [0x1A5, 0x9234_5678])
def test_packed_frames_carry_the_crc_of_id_and_bytes(name, first_id):
    small = make_topology(name, units=7, first_id=first_id)
    for record in data_frames(small, 5, 77):
        payload = record["data"][: record["length"]].tobytes()
        can_id = int(record["id"]) & 0xFFFF
        covered = bytes([can_id & 0xFF, can_id >> 8]) + payload[:2] + payload[4:]
        assert int.from_bytes(payload[2:4], "little") == crc16(covered)


def test_frames_come_in_the_order_of_bus_and_id():
    small = make_topology("f3t-fd64", units=23, buses=2)
    frames = data_frames(small, 1, 2, stamp_ns=123)
    np.testing.assert_array_equal(frames["bus"], small.frames.bus)
    np.testing.assert_array_equal(frames["id"], small.frames.can_id)
    assert set(frames["stamp_ns"]) == {123}
    by_bus = [data_frames(small, 1, 2, stamp_ns=123, bus=b) for b in range(2)]
    np.testing.assert_array_equal(np.concatenate(by_bus), frames)


def test_a_batch_without_room_takes_nothing():
    small = make_topology(units=4)
    batch = FrameBatch(6)
    pack = Packer(small)
    assert pack(counts_of(small, 0), batch, sequence=0) == 4
    with pytest.raises(IndexError, match="must have room for 4 frames; got 2"):
        pack(counts_of(small, 0), batch, sequence=1)
    assert batch.count == 4


@pytest.mark.parametrize(
    ("counts", "codes", "message"),
    [
        (
            np.zeros((6, 3), np.int16),
            None,
            r"counts: must be int16 of shape \(6, 4\); got int16 of",
        ),
        (
            np.zeros((6, 4), np.int32),
            None,
            r"counts: must be int16 of shape \(6, 4\); got int32 of",
        ),
        (
            np.zeros((6, 4), np.int16),
            np.zeros(4, int),
            r"fault_code: must be uint8 of shape \(4,\)",
        ),
    ],
)
def test_arrays_of_another_shape_are_refused(counts, codes, message):
    with pytest.raises(ValueError, match=message):
        Packer(make_topology(units=4))(counts, FrameBatch(9), sequence=0, fault_code=codes)


@pytest.mark.parametrize(
    ("signal", "message"),
    [
        (
            Signal(name="gel", start=57, length=8),
            "layout 'own': signal 'gel' (slot 0): must lie within the 8 bytes of its frame; "
            "got 8 bits from bit 57, little endian",
        ),
        (
            Signal(name="bx", start=62, length=8, order="big"),
            "layout 'own': signal 'bx' (slot 0): must lie within the 8 bytes of its frame; "
            "got 8 bits from bit 62, big endian",
        ),
        (
            Signal(name="bx", start=0, length=12, slot=1),
            "layout 'own': signal 'bx' (slot 1): must be in one of 1 slots; got slot 1",
        ),
        (
            Signal(name="crc", start=4, length=16),
            "layout 'own': signal 'crc' (slot 0): must be 16 bits that fill two bytes; "
            "got 16 bits from bit 4",
        ),
    ],
)
def test_a_layout_that_cannot_be_read_is_refused(signal, message):
    small = make_topology(WireLayout(name="own", size=8, signals=(signal,)), units=1)
    with pytest.raises(LayoutError) as error:
        Packer(small)
    assert str(error.value) == message
