"""Every transport that needs no hardware keeps the contract."""

from itertools import count

import pytest

from bus import MemoryTransport
from bus.open import open_transport
from tests.bus.transport_contract import CHECKS
from topology import Bus

names = (f"contract{i}" for i in count())


def memory_pair():
    return MemoryTransport.pair(index=3)


def named_memory():
    bus = Bus(name="main", interface="memory", channel=next(names))
    return open_transport(bus, 2), open_transport(bus, 3)


def virtual():
    bus = Bus(name="main", interface="virtual", channel=next(names), data_bitrate=5_000_000)
    return open_transport(bus, 2), open_transport(bus, 3)


PAIRS = {"memory-pair": memory_pair, "memory": named_memory, "python-can-virtual": virtual}


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_transport_keeps_the_contract(pair, check):
    near, far = pair()
    with near, far:
        check(near, far)
