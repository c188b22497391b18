"""Worst-case bits against frames built bit by bit, and bus loads against known figures."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.naive.topology as naive
from tests.fixtures.topology import write_topology
from topology import LAYOUTS, Bus, load
from topology.budget import bus_load, classic_bits, fd_bits, frame_seconds

CLASSIC = Bus(name="classic", interface="memory")
FD = Bus(name="fd", interface="memory", data_bitrate=5_000_000)

identifiers = st.booleans().flatmap(
    lambda extended: st.tuples(
        st.integers(0, 0x1FFFFFFF if extended else 0x7FF), st.just(extended)
    )
)  # fmt: skip


def payloads(sizes):
    return st.sampled_from(sizes).flatmap(lambda n: st.binary(min_size=n, max_size=n))


def stuffing_payload(head, size):
    """Bytes that prolong every run of equal bits, so that every fourth bit brings a stuff bit."""
    bits = list(head)
    while len(bits) < len(head) + 8 * size:
        bits.append(naive.stuffed(bits)[-1])
    text = "".join(map(str, bits[len(head) :]))
    return bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8))


@given(identifiers, payloads(range(9)))
def test_no_classic_frame_takes_more_than_the_worst_case(address, data):
    can_id, extended = address
    assert len(naive.classic_frame(can_id, data, extended)) <= classic_bits(len(data), extended)


@given(identifiers, payloads(naive.FD_CODES))
def test_no_fd_frame_takes_more_than_the_worst_case(address, data):
    can_id, extended = address
    nominal, fast = naive.fd_frame(can_id, data, extended)
    worst_nominal, worst_fast = fd_bits(len(data), extended)
    assert len(nominal) <= worst_nominal
    assert len(nominal) + len(fast) <= worst_nominal + worst_fast


@pytest.mark.parametrize(
    ("can_id", "extended", "data", "bits"),
    [(0x7FE, False, "3c3c3c3c3c3c3c07", 132), (0x01E001BE, True, "3c3c3c3c3c3c3c3c", 155)],
    ids=["11 bit", "29 bit"],
)
def test_the_worst_case_of_a_classic_frame_is_nearly_reached(can_id, extended, data, bits):
    """Fixed control bits and the CRC keep real frames a few bits below: 135 and 160."""
    assert len(naive.classic_frame(can_id, bytes.fromhex(data), extended)) == bits
    assert bits <= classic_bits(8, extended) <= bits + 5


def test_the_worst_case_of_a_64_byte_fd_frame_is_two_bits_from_a_real_one():
    head = [*naive.identifier_bits(0x078, False, 0), 1, 0, 1, 0, *naive.number_bits(15, 4)]
    nominal, fast = naive.fd_frame(0x078, stuffing_payload(head, 64))
    assert (len(nominal), len(fast)) == (33, 677)
    assert fd_bits(64) == (34, 678)


def test_known_figures_of_single_frames():
    assert [classic_bits(n) for n in (0, 1, 8)] == [55, 65, 135]
    assert [fd_bits(n) for n in (8, 16, 32, 48, 64)] == [
        (34, 113), (34, 193), (34, 358), (34, 518), (34, 678),
    ]  # fmt: skip
    microseconds = [1e6 * frame_seconds(n, True, FD) for n in (8, 16, 32, 48, 64)]
    assert microseconds == pytest.approx([56.6, 72.6, 105.6, 137.6, 169.6])


def most_units(bus, layout, rate_hz):
    """Most units whose frames keep within 80 % of a bus at a cycle rate."""
    frame = layout.parts * frame_seconds(layout.size, layout.fd, bus) * rate_hz
    beat = 0.0 if layout.counts_only else frame_seconds(8, False, bus)
    room = 0.8 - frame_seconds(1, False, bus) * rate_hz
    return int(room / (frame + beat)) * layout.units


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_bus_takes_just_as_many_units_as_fit_with_their_heartbeats(layout, tmp_path):
    wire, rate_hz = LAYOUTS[layout], 250
    bus = FD if wire.fd else CLASSIC
    units = most_units(bus, wire, rate_hz)
    rate = f"data_bitrate = {bus.data_bitrate}" if wire.fd else ""
    for n, fits in ((units, True), (units + 1, False)):
        file = write_topology(
            tmp_path,
            bus=f"{rate}\ncycle_rate_hz = {rate_hz}\nsync_id = 0x080",
            patch=f'kind = "grid"\nrows = 1\ncolumns = {n}\npitch_m = 0.012\n'
            f'layout = "{layout}"\nfirst_id = 0x100',
        )
        found = load(file, allow_overload=True)
        busload = bus_load(found, 0)
        assert (busload.load <= 0.8) == fits


def test_at_the_highest_rate_a_bus_is_just_as_full_as_allowed():
    palm = load("palm")
    faster = dataclasses.replace(palm, cycle_rate_hz=bus_load(palm, 0).highest_rate_hz)
    assert bus_load(faster, 0).load == pytest.approx(palm.buses[0].max_load)


def test_29_bit_identifiers_cost_what_they_take(tmp_path):
    shape = 'kind = "grid"\nrows = 1\ncolumns = 4\npitch_m = 0.012\nlayout = "f3t-classic"\n'
    cycle = {}
    for extended in (False, True):
        file = write_topology(
            tmp_path,
            bus="cycle_rate_hz = 100",
            patch=shape + f"first_id = 0x100\nextended = {str(extended).lower()}",
        )
        found = load(file)
        cycle[extended] = bus_load(found, 0).cycle_s
    assert cycle == pytest.approx({False: 4 * 135e-6, True: 4 * 160e-6})


def test_a_board_beats_once_however_many_frames_it_sends(tmp_path):
    signals = [
        f'{{ name = "{name}", start = 0, length = 12, part = {part} }}'
        for part, name in enumerate(("gel", "frequency", "bx", "by"))
    ]
    layout = f'[[layouts]]\nname = "own"\nsize = 8\nparts = 4\nsignals = [{", ".join(signals)}]'
    patch = (
        'kind = "grid"\nrows = 1\ncolumns = 3\npitch_m = 0.012\nlayout = "own"\nfirst_id = 0x100'
    )
    skin = load(write_topology(tmp_path, bus="cycle_rate_hz = 10", patch=patch, more=layout))
    found = bus_load(skin, 0)
    assert found.frames == 12
    assert found.load == pytest.approx(10 * 12 * 135e-6 + 3 * 135e-6)
