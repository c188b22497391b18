"""The adapter of python-can: messages and frames are the same, and every failure has words."""

import errno
import sys
import time
import types

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import FRAME_DTYPE, BusClosedError, BusOpenError, FrameBatch
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, FD_BRS, FD_ESI, FD_FDF
from bus.pythoncan import PythonCanTransport, _arguments, from_message, to_message
from bus.state import BusState
from tests.bus.transport_contract import numbered, numbers, receive
from tests.fixtures.bus import frame, join
from topology import Bus


class FakeBus(can.BusABC):
    """An interface that does what a test tells it to."""

    channel_info = "fake"

    def __init__(self, channel, **arguments):
        self.arguments = arguments
        self.script = list(arguments.pop("script", []))
        self.sent = []
        self._can_protocol = can.CanProtocol.CAN_20
        super().__init__(channel)
        if channel == "broken":
            raise arguments["error"]

    def _recv_internal(self, timeout):
        step = self.script.pop(0) if self.script else None
        if isinstance(step, Exception):
            raise step
        return step, True

    def send(self, msg, timeout=None):
        step = self.script.pop(0) if self.script else None
        if step is not None:
            raise step
        self.sent.append(msg)


@pytest.fixture
def fake(monkeypatch):
    """Register the interface `fake`, and return a maker of transports on it."""
    module = types.ModuleType("fakecan")
    module.FakeBus = FakeBus
    monkeypatch.setitem(sys.modules, "fakecan", module)
    monkeypatch.setitem(can.interfaces.BACKENDS, "fake", ("fakecan", "FakeBus"))
    monkeypatch.setattr(
        can.interfaces, "VALID_INTERFACES", can.interfaces.VALID_INTERFACES | {"fake"}
    )
    return lambda *script, **options: PythonCanTransport(
        Bus(name="main", interface="fake", channel="0", options={"script": script, **options}), 4
    )


def message(number=1, **fields):
    return can.Message(
        arbitration_id=0x123, is_extended_id=False, data=number.to_bytes(4, "little"),
        timestamp=1.5, **fields,
    )  # fmt: skip


def gone(number=errno.ENODEV, words="Error receiving: No such device"):
    return can.CanOperationError(words, number)


# -- messages and records --------------------------------------------------------------------------

FRAMES = st.one_of(
    st.tuples(st.integers(0, 0x7FF), st.integers(0, 8), st.just(0)),
    st.tuples(st.integers(CAN_EFF, CAN_EFF | 0x1FFFFFFF), st.integers(0, 8), st.just(0)),
    st.tuples(
        st.integers(0, 0x7FF),
        st.sampled_from([*range(9), 12, 16, 20, 24, 32, 48, 64]),
        st.integers(0, 3).map(lambda bits: bits | FD_FDF),
    ),
    st.tuples(st.integers(CAN_RTR, CAN_RTR | 0x7FF), st.integers(0, 8), st.just(0)),
    st.tuples(st.integers(CAN_ERR, CAN_ERR | 0x7FF), st.just(8), st.just(0)),
)


@given(FRAMES, st.binary(min_size=64, max_size=64), st.integers(1, 2**60))
def test_a_frame_survives_the_way_through_a_message(fields, data, stamp_ns):
    can_id, length, flags = fields
    sent = frame(can_id, data[:length], flags=flags, stamp_ns=stamp_ns)
    came = np.zeros(1, FRAME_DTYPE)
    from_message(to_message(sent[0]), memoryview(came.view(np.uint8)), 0, 6)
    if can_id & CAN_RTR:
        sent["data"] = 0
    sent["bus"] = 6
    np.testing.assert_allclose(came["stamp_ns"], sent["stamp_ns"], rtol=4e-16)
    came["stamp_ns"] = sent["stamp_ns"]
    np.testing.assert_array_equal(came, sent)


@given(FRAMES, st.binary(min_size=64, max_size=64))
def test_a_record_is_the_message_that_python_can_would_build(fields, data):
    can_id, length, flags = fields
    got = to_message(frame(can_id, data[:length], flags=flags)[0])
    expected = can.Message(
        arbitration_id=can_id & 0x1FFFFFFF,
        is_extended_id=bool(can_id & CAN_EFF),
        is_error_frame=bool(can_id & CAN_ERR),
        is_remote_frame=bool(can_id & CAN_RTR),
        is_fd=bool(flags & FD_FDF),
        bitrate_switch=bool(flags & FD_BRS),
        error_state_indicator=bool(flags & FD_ESI),
        dlc=length,
        data=None if can_id & CAN_RTR else data[:length],
        check=True,
    )
    assert got.equals(expected)


def test_error_frames_of_other_drivers_are_no_linux_error_classes(fake):
    error = can.Message(is_error_frame=True, arbitration_id=0x4, data=[0, 1, 0, 0], timestamp=1.0)
    with fake(error) as transport:
        assert receive(transport, 1)["id"].tolist() == [CAN_ERR]
        assert transport.counters.error_frames == 1
        assert transport.counters.controller_overflows == 0


# -- receiving -------------------------------------------------------------------------------------


def test_echoes_do_not_come_back(fake):
    with fake(message(1, is_rx=False), message(2), message(3, is_rx=False), message(4)) as end:
        assert numbers(receive(end, 2)) == [2, 4]
        assert end.counters.received == 2


def test_frames_before_the_end_of_an_interface_are_not_lost(fake):
    with fake(message(1), message(2), gone()) as end:
        batch = FrameBatch(8)
        assert end.receive(batch) == 2
        assert end.state is BusState.GONE
        for _ in range(2):
            with pytest.raises(BusClosedError) as error:
                end.receive(batch)
            assert str(error.value) == (
                "bus 'main' (fake 0): Error receiving: No such device [Error Code 19]"
            )
        with pytest.raises(BusClosedError):
            end.send(numbered(1))


def test_an_interface_that_is_switched_off_may_come_back(fake):
    with fake(gone(errno.ENETDOWN, "Network is down"), None, message(1)) as end:
        batch = FrameBatch(8)
        assert end.receive(batch) == 0
        assert end.state is BusState.DOWN
        assert end.receive(batch) == 0
        assert end.receive(batch) == 1
        assert end.state is BusState.ACTIVE
        assert [str(change.state) for change in end.changes] == ["down", "error-active"]


@pytest.mark.parametrize("error", [TypeError("NoneType"), AttributeError("handle"), KeyError(3)])
def test_whatever_a_driver_raises_is_the_end_of_its_interface(fake, error):
    with fake(message(1), error) as end:
        assert end.receive(FrameBatch(8)) == 1
        for use in (lambda: end.receive(FrameBatch(8)), lambda: end.send(numbered(1))):
            with pytest.raises(BusClosedError, match=r"bus 'main' \(fake 0\): "):
                use()


def test_an_adapter_that_is_gone_is_closed_without_a_word(fake, monkeypatch):
    def shutdown(self):
        raise can.CanOperationError("Could not write to serial device")

    end = fake()
    monkeypatch.setattr(FakeBus, "shutdown", shutdown)
    end.close()
    end.close()
    assert end.state is BusState.GONE
    assert end._can._is_shutdown


# -- sending ---------------------------------------------------------------------------------------


def full():
    return can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)


def test_a_full_transmit_queue_is_waited_for(fake):
    with fake(None, full(), full()) as end:
        assert end.send(numbered(3)) == 3
        assert [m.data[0] for m in end._can.sent] == [0, 1, 2]
        assert (end.counters.sent, end.counters.send_waits) == (3, 2)


def test_a_transmit_queue_that_stays_full_is_given_up(fake):
    with fake(None, *[full()] * 500) as end:
        assert end.send(numbered(3)) == 1
        counters = end.counters
        assert (counters.sent, counters.send_failures) == (1, 2)
        assert 0 < counters.send_waits < 100


@pytest.mark.parametrize(
    "error", [can.CanOperationError("no"), ValueError("no"), OSError(errno.EINVAL, "no")]
)
def test_a_frame_that_is_refused_is_counted(fake, error):
    with fake(error) as end:
        assert end.send(numbered(2)) == 0
        assert end.counters.send_failures == 2
        assert end.send(numbered(2)) == 2


def wrapped():
    """As slcan raises it: the number is in the cause."""
    error = can.CanOperationError("No such device or address")
    error.__cause__ = OSError(errno.EIO, "Input/output error")
    return error


@pytest.mark.parametrize("error", [gone(errno.ENXIO, "No such device or address"), wrapped()])
def test_an_interface_that_is_gone_takes_nothing(fake, error):
    with fake(error) as end:
        assert end.send(numbered(2)) == 0
        assert end.state is BusState.GONE
        with pytest.raises(BusClosedError, match="No such device or address"):
            end.send(numbered(2))


# -- opening ---------------------------------------------------------------------------------------


REFUSED = [
    # what differs of a bus 'left', and how the message begins and ends
    (
        {"interface": "virtul"},
        "interface: must be one of canalystii, ",
        "; got 'virtul'; nearest: 'virtual'",
    ),
    (
        {"interface": "fake", "data_bitrate": 2_000_000},
        "data_bitrate: must be absent, for python-can opens this interface for classic CAN only",
        "; got 2000000",
    ),
    (
        {"interface": "virtual", "options": {"receive_own_messages": True}},
        "options: receive_own_messages: must be false or absent",
        "; got true",
    ),
    *(
        (
            {"interface": "fake", "channel": "broken", "options": {"error": error}},
            f"fake channel 'broken': cannot be opened: {type(error).__name__}",
            str(error),
        )
        for error in (
            can.CanInitializationError("no such channel", 3),
            ImportError("no driver"),
            TypeError("unexpected keyword"),
            AttributeError(),
        )
    ),
    *(
        (
            {"interface": "socketcan", "channel": channel, "data_bitrate": data_bitrate},
            f"socketcan channel '{channel}': cannot be opened: ",
            f"; remedy: sudo ip link {remedy}",
        )
        for channel, data_bitrate, remedy in (
            ("can7", None, "set can7 up type can bitrate 1000000"),
            ("can7", 5_000_000, "set can7 up type can bitrate 1000000 dbitrate 5000000 fd on"),
            ("vcan77", 5_000_000, "add vcan77 type vcan; sudo ip link set vcan77 mtu 72 up"),
        )
    ),
]


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")
@pytest.mark.usefixtures("fake")
@pytest.mark.parametrize(("differs", "begins", "ends"), REFUSED)
def test_a_bus_that_cannot_be_opened_is_refused_with_the_reason(differs, begins, ends):
    with pytest.raises(BusOpenError) as raised:
        PythonCanTransport(Bus(**{"name": "left", "channel": "x", **differs}))
    assert str(raised.value).startswith(f"bus 'left': {begins}")
    assert str(raised.value).endswith(ends)


@pytest.mark.parametrize(
    ("interface", "data_bitrate", "expected"),
    [
        ("kvaser", None, {"bitrate": 250_000}),
        ("kvaser", 4_000_000, {"bitrate": 250_000, "fd": True, "data_bitrate": 4_000_000}),
        ("vector", 4_000_000, {"bitrate": 250_000, "fd": True, "data_bitrate": 4_000_000}),
        ("nixnet", 4_000_000, {"bitrate": 250_000, "fd": True, "fd_bitrate": 4_000_000}),
        ("slcan", None, {"bitrate": 250_000}),
        ("pcan", None, {"bitrate": 250_000}),
        ("socketcan", None, {}),
        ("socketcan", 4_000_000, {"fd": True}),
        ("serial", None, {}),
        ("virtual", None, {"protocol": can.CanProtocol.CAN_20}),
        ("virtual", 4_000_000, {"protocol": can.CanProtocol.CAN_FD}),
    ],
)
def test_an_interface_is_told_the_bit_rates_in_its_own_words(interface, data_bitrate, expected):
    bus = Bus(name="a", interface=interface, bitrate=250_000, data_bitrate=data_bitrate)
    assert _arguments(bus) == expected


def test_options_have_the_last_word():
    bus = Bus(name="a", interface="kvaser", options={"bitrate": 5, "single_handle": True})
    assert _arguments(bus) == {"bitrate": 5, "single_handle": True}


def test_pcan_gets_a_bit_timing_where_it_has_no_name_for_the_rate():
    timing = _arguments(Bus(name="a", interface="pcan", data_bitrate=5_000_000))["timing"]
    assert (timing.nom_bitrate, timing.data_bitrate) == (1_000_000, 5_000_000)
    assert (timing.nom_sample_point, timing.data_sample_point) == (80.0, 75.0)
    timing = _arguments(Bus(name="a", interface="pcan", bitrate=400_000))["timing"]
    assert timing.bitrate == 400_000
    own = {"f_clock_mhz": 20, "nom_brp": 5}
    arguments = _arguments(Bus(name="a", interface="pcan", data_bitrate=2_000_000, options=own))
    assert "timing" not in arguments
    assert own.items() <= arguments.items()


def test_no_configuration_file_has_a_say(tmp_path, monkeypatch):
    monkeypatch.setenv("CAN_INTERFACE", "kvaser")
    monkeypatch.setenv("CAN_CHANNEL", "9")
    bus = Bus(name="a", interface="virtual", channel="quiet")
    with PythonCanTransport(bus) as a, PythonCanTransport(bus) as b:
        a.send(join(frame(1, b"x")))
        assert receive(b, 1)["id"].tolist() == [1]


def test_frames_without_stamps_of_the_kernel_have_the_time_at_which_they_are_read(fake):
    with fake(message(1)) as transport:
        before_ns = time.time_ns()
        (stamp_ns,) = receive(transport, 1)["stamp_ns"].tolist()
        assert transport.stamped_by == "host"
        assert before_ns <= stamp_ns <= time.time_ns()
