"""Two hundred thousand random frames of each layout mean the same to cantools, by our DBC."""

import numpy as np
import pytest

from bus import Assembler, Packer
from bus.frame import FrameBatch
from tests.fixtures.dbc import by_cantools
from tests.fixtures.topology import write_topology
from topology import CHANNELS, load

UNITS = {"f3t-classic": 10, "f3t-fd16": 10, "f3t-fd64": 10}


def frames_until(skin, wanted, rng):
    """Cycles of random frames with the counts that we read from them."""
    pack, assemble = Packer(skin), Assembler(skin)
    batch = FrameBatch(len(skin.frames) + 1)
    made = cycle = 0
    while made < wanted:
        sent = rng.integers(-32768, 32768, (len(CHANNELS), skin.n)).astype(np.int16)
        batch.clear()
        batch.append(skin.sync_id, bytes([cycle & 0xFF]))
        pack(sent, batch, sequence=cycle & 0xFF)
        (read,) = assemble.feed(batch.frames)
        yield batch.frames[1:], read.counts
        made += len(skin.frames)
        cycle += 1


def check(layout, folder, wanted):
    row = 'kind = "grid"\nrows = 1\npitch_m = 0.02\n'
    patch = f'{row}columns = {UNITS[layout]}\nlayout = "{layout}"\nfirst_id = 0x100\n'
    skin = load(
        write_topology(folder, bus="data_bitrate = 5_000_000\nsync_id = 0x080", patch=patch)
    )
    database = by_cantools(skin)
    place = {
        f"{unit.replace('/', '_')}_{channel}": (c, i)
        for i, unit in enumerate(skin.unit_names)
        for c, channel in enumerate(CHANNELS)
    }
    messages = {
        int(can_id): database.get_message_by_frame_id(int(can_id)) for can_id in skin.frames.can_id
    }
    for frames, counts in frames_until(skin, wanted, np.random.default_rng(3)):
        for record in frames:
            message = messages[int(record["id"])]
            payload = record["data"][: record["length"]].tobytes()
            raw = message.decode(payload, decode_choices=False, scaling=False)
            physical = message.decode(payload, decode_choices=False)
            found = 0
            for name, value in raw.items():
                if name in place:
                    c, i = place[name]
                    assert value == counts[c, i]
                    ours = skin.scale[c, i] * int(counts[c, i]) + skin.offset[c, i]
                    assert abs(physical[name] - ours) <= np.spacing(abs(ours))
                    found += 1
            assert found >= 5


@pytest.mark.parametrize("layout", UNITS)
def test_three_hundred_frames_mean_the_same_to_cantools(layout, tmp_path):
    check(layout, tmp_path, 300)


@pytest.mark.long
@pytest.mark.parametrize("layout", UNITS)
def test_two_hundred_thousand_frames_mean_the_same_to_cantools(layout, tmp_path):
    check(layout, tmp_path, 200_000)
