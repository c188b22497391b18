"""Numbers of boards, and frames on the identifier that is kept free for commands to them."""

from __future__ import annotations

import numpy as np

from bus.assemble import Assembler
from bus.cycle import FrameCounters
from bus.frame import ECHO
from bus.heartbeat import COMMAND_ID, node_numbers
from tests.fixtures.bus import frame
from topology import load

HAND = load("hand")


def test_boards_are_numbered_on_each_bus() -> None:
    for bus in range(2):
        here = HAND.frames.bus == bus
        np.testing.assert_array_equal(node_numbers(HAND)[here], np.arange(1, here.sum() + 1))


def test_commands_to_boards_are_not_foreign() -> None:
    assembler, record = Assembler(HAND), frame(COMMAND_ID, bytes(8))
    list(assembler.feed(record))
    assert assembler.counters == FrameCounters(configuration=1)
    record["origin"] = ECHO
    list(assembler.feed(record))
    assert assembler.counters == FrameCounters(configuration=1, echo=1)
