"""Wire layouts: bits as other CAN tools count them, and the built-in ones by their own rules."""

import cantools
import msgspec
import pytest
from cantools.database import Message
from cantools.database.conversion import BaseConversion
from hypothesis import given
from hypothesis import strategies as st

from tests.fixtures.topology import write_topology
from topology import LAYOUTS, Signal, TopologyError, load
from topology.check.layouts import CLASSIC_SIZES, FD_SIZES, signal_bits

SHAPE = 'kind = "grid"\nrows = 2\ncolumns = 3\npitch_m = 0.012\n'

signals = st.builds(
    Signal,
    name=st.just("gel"),
    start=st.integers(0, 63),
    length=st.integers(1, 16),
    order=st.sampled_from(["little", "big"]),
)


@given(signals)
def test_bits_of_a_signal_are_those_of_cantools(signal):
    bits = signal_bits(signal)
    assert len(set(bits)) == signal.length
    peer = cantools.database.Signal(
        "gel", signal.start, signal.length, f"{signal.order}_endian",
        conversion=BaseConversion.factory(),
    )  # fmt: skip
    try:
        message = Message(0x100, "frame", 8, [peer], strict=True)
    except cantools.database.Error:
        assert max(bits) >= 64
        return
    assert max(bits) < 64
    for i, bit in enumerate(bits):
        data = message.encode({"gel": 1 << i})
        assert int.from_bytes(data, "little") == 1 << bit


def as_toml(layout):
    rows = []
    for signal in layout.signals:
        table = msgspec.to_builtins(signal)
        pairs = ", ".join(f"{key} = {toml(value)}" for key, value in table.items())
        rows.append(f"    {{ {pairs} }},")
    head = f'[[layouts]]\nname = "{layout.name}-copy"\nsize = {layout.size}\n'
    head += f"fd = {toml(layout.fd)}\nunits = {layout.units}\nparts = {layout.parts}\n"
    head += f"pages = {list(layout.pages)}\ncounts_only = {toml(layout.counts_only)}\n"
    return head + "signals = [\n" + "\n".join(rows) + "\n]\n"


def toml(value):
    return str(value).lower() if isinstance(value, bool) else repr(value)


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_built_in_layout_written_out_is_the_built_in_layout(name, tmp_path):
    patch = SHAPE + f'layout = "{name}-copy"\nfirst_id = 0x100'
    skin = load(write_topology(tmp_path, patch=patch, more=as_toml(LAYOUTS[name])))
    assert skin.layouts == (msgspec.structs.replace(LAYOUTS[name], name=f"{name}-copy"),)


@pytest.mark.parametrize("fd", [False, True])
def test_frames_have_the_lengths_that_can_has(fd, tmp_path):
    signals = (
        '{ name = "gel", start = 0, length = 1 }, { name = "frequency", start = 1, length = 1 }'
    )
    signals += ', { name = "bx", start = 2, length = 1 }, { name = "by", start = 3, length = 1 }'
    refused = []
    for size in (1, 8, 9, 12, 13, 20, 21, 32, 48, 63, 64):
        layout = f'[[layouts]]\nname = "own"\nfd = {toml(fd)}\nsize = {size}\nsignals = [{signals}]'
        file = write_topology(
            tmp_path, patch=SHAPE + 'layout = "own"\nfirst_id = 0x100', more=layout
        )
        if size in (FD_SIZES if fd else CLASSIC_SIZES):
            assert load(file).layouts[0].size == size
        else:
            refused.append(size)
            with pytest.raises(TopologyError, match="must be a length of"):
                load(file)
    assert refused == ([9, 13, 21, 63] if fd else [9, 12, 13, 20, 21, 32, 48, 63, 64])
