"""Configuration frames: their bytes, what is refused, and how the assembler counts them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.assemble import Assembler
from bus.configure import IDENTIFIER, Command, Configuration, node_numbers, pack, read
from bus.cycle import FrameCounters
from bus.frame import CAN_EFF, ECHO
from topology import load

HAND = load("hand")


@given(node=st.integers(0, 255), value=st.integers(1, 65535))
def test_frames_read_back_as_they_were_packed(node: int, value: int) -> None:
    assert read(pack(Command.RATE, node, value)[0]) == Configuration(Command.RATE, node, value)
    assert read(pack(Command.TARE, node)[0]) == Configuration(Command.TARE, node, 0)


def test_the_bytes_are_those_of_the_protocol() -> None:
    record = pack(Command.RATE, node=5, value=0x1234)[0]
    assert (record["id"], record["length"]) == (0x7E0, 8)
    assert record["data"][:8].tobytes() == bytes([2, 5, 0x34, 0x12, 0, 0, 0, 0])


@pytest.mark.parametrize(
    "arguments", [(7,), (Command.RATE,), (Command.RATE, 0, 65536), (Command.TARE, 0, 1),
                  (Command.TARE, 256), (Command.TARE, -1)],
)  # fmt: skip
def test_what_no_board_can_obey_is_refused(arguments) -> None:
    with pytest.raises(ValueError, match=r"^(command|node|value): must be .*; got"):
        pack(*arguments)


def test_other_frames_are_no_configuration() -> None:
    for name, value in [("id", 0x7E1), ("id", IDENTIFIER | CAN_EFF), ("length", 7)]:
        record = pack(Command.TARE)
        record[name] = value
        assert read(record[0]) is None
    later = pack(Command.TARE)
    later["data"][0, 7] = 1
    assert read(later[0]) is None


def test_boards_are_numbered_on_each_bus() -> None:
    for bus in range(2):
        here = HAND.frames.bus == bus
        np.testing.assert_array_equal(node_numbers(HAND)[here], np.arange(1, here.sum() + 1))


def test_configuration_is_not_foreign() -> None:
    assembler, record = Assembler(HAND), pack(Command.TARE)
    list(assembler.feed(record))
    assert assembler.counters == FrameCounters(configuration=1)
    record["origin"] = ECHO
    list(assembler.feed(record))
    assert assembler.counters == FrameCounters(configuration=1, echo=1)
