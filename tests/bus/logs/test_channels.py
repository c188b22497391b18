"""Which channel of a log is which bus: one rule for all formats, and a refusal where it fails."""

import pytest

import topology
from bus.errors import ChannelError
from bus.logs import Recording, buses_of, read
from tests.fixtures.logs import blf_file, can_message, records, write_by_pythoncan

TRC = ";$FILEVERSION=2.1\n;$STARTTIME=43008.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"


def skin(*channels, interface="socketcan"):
    """A skin with a bus for each channel; of two they are the palm's and the fingers'."""
    loaded = topology.load("hand" if len(channels) == 2 else "strip")
    return loaded.on(interface=interface, channel=",".join(channels))


def write(path, channels):
    """A log of a frame for each channel, as the format counts it; the identifier is its place."""
    suffix, frames = path.suffix, list(enumerate(channels))
    if suffix == ".log":
        path.write_text("".join(f"({i}.0) {name} {i:03X}#11\n" for i, name in frames))
    elif suffix == ".asc":
        lines = (f"   {i}.000000 {n}  {i:X}  Rx   d 1 11\n" for i, n in frames)
        path.write_text("base hex  timestamps absolute\n" + "".join(lines))
    elif suffix == ".trc":
        lines = (f" {i + 1} {i}.0 DT {n} {i:04X} Rx - 1 11\n" for i, n in frames)
        path.write_text(TRC + "".join(lines))
    elif suffix == ".blf":
        path.write_bytes(blf_file(*(can_message(i, channel=n) for i, n in frames)))
    else:
        write_by_pythoncan(path, records(*((10**9 * i, i, 1, 0, 0, 0, b"\x11") for i, _ in frames)))
    return path


BOTH = ("can0", "can1")
NUMBERED = [".asc", ".blf", ".trc"]


ROWS = [
    # names: what the topology names, whoever speaks first or late
    ([".log"], ["can1", "can0", "can0"], ("can0",), {}, {1: 0, 2: 0}),
    ([".log"], ["can0", "can0", "can1"], ("can1",), {}, {2: 0}),
    ([".log"], ["can2", "can1", "can0"], BOTH, {}, {1: 1, 2: 0}),
    ([".log"], ["a", "b"], BOTH, {"a": "fingers", "b": "palm"}, {0: 1, 1: 0}),
    ([".log"], ["can0", "can1"], BOTH, {"can1": "palm", "can0": "fingers"}, {0: 1, 1: 0}),
    # numbers: can0 is 1
    (NUMBERED, [2, 1], BOTH, {}, {0: 1, 1: 0}),
    (NUMBERED, [1, 1, 2], ("can1",), {}, {2: 0}),
    (NUMBERED, [3, 2], ("vcan1",), {}, {1: 0}),
    (NUMBERED, [1, 2], ("1",), {}, {1: 0}),
    (NUMBERED, [7, 1], ("can_left", "can_right"), {1: "fingers", "7": "palm"}, {0: 0, 1: 1}),
    (NUMBERED, [1, 2], BOTH, {"1": "fingers", "2": "palm"}, {0: 1, 1: 0}),
    (NUMBERED, [4, 4], ("can_left",), {}, {0: 0, 1: 0}),
    (NUMBERED, [1, 0], BOTH, {"1": "palm", "0": "fingers"}, {0: 0, 1: 1}),
    # none: only for one bus
    ([".csv"], [None, None], ("can1",), {}, {0: 0, 1: 0}),
]  # fmt: skip
"""Formats, channels of the frames as the file counts them, those of the topology, the map, and the
bus of each frame that is not left out."""


@pytest.mark.parametrize(
    ("suffix", "channels", "buses", "given", "expected"),
    [(suffix, *row) for suffixes, *row in ROWS for suffix in suffixes],
)
def test_a_frame_is_of_the_bus_whose_channel_it_came_on(
    suffix, channels, buses, given, expected, tmp_path
):
    path = write(tmp_path / f"some{suffix}", channels)
    log = read(path, buses=buses_of(skin(*buses), path, given))
    found = {int(f["id"]): int(f["bus"]) for batch in log for f in batch.frames}
    assert found == expected
    assert log.lacking == ""
    assert sum(log.left_out.values()) == len(channels) - len(expected)


@pytest.mark.parametrize(
    ("suffix", "channels", "buses", "told"),
    [
        (".log", ["can0"], ("can1",), "must hold frames of 'can1'; got 'can0' alone: --map FILE"),
        (".log", ["vcan0"], ("can0",), "must hold frames of 'can0'; got 'vcan0' alone"),
        (".asc", [1, 2], ("can_left", "can_right"),
         "must hold frames of 'can_left', 'can_right'; got channel 1 (can0), channel 2 (can1) "
         "alone: --map FILE_CHANNEL=BUS"),
        (".blf", [1], ("can1",), "must hold frames of 'can1'; got channel 1 (can0) alone"),
        (".trc", [1, 1, 2], ("can_left",), "must have one channel, or 'can_left'; got channel 1"),
        (".blf", [1, 0], BOTH, "must count its channels from 1; got channel 0: --map"),
        (".csv", [None, None], BOTH, "must name the channel of each frame, for a skin of 2 buses"),
    ],
)  # fmt: skip
def test_channels_that_tell_no_bus_are_refused(suffix, channels, buses, told, tmp_path):
    path = write(tmp_path / f"some{suffix}", channels)
    for strict in (True, False):
        with pytest.raises(ChannelError) as raised:
            list(read(path, buses=buses_of(skin(*buses), path), strict=strict))
        assert str(raised.value).startswith(f"{path}: {told}")


def test_a_bus_without_frames_is_told_with_the_channels_of_the_log(tmp_path):
    path = write(tmp_path / "some.blf", [1, 3, 3])
    log = read(path, buses=buses_of(skin(*BOTH), path))
    assert sum(len(batch) for batch in log) == 1
    assert log.damage is None
    assert log.left_out == {"can2": 2}
    assert log.lacking.startswith(f"{path}: must hold frames of 'can1'; got channel 1 (can0), "
                                  "channel 3 (can2) alone: --map")  # fmt: skip


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"1": "plam"}, "channels: 1: must be a bus of 'hand', each once; got 'plam'; nearest: "),
        ({"1": "palm", "2": "palm"}, "channels: 2: must be a bus of 'hand', each once; got 'palm'"),
    ],
)
def test_a_channel_is_of_one_bus_that_is_there(given, told):
    with pytest.raises(ChannelError, match=told):
        buses_of(skin(*BOTH), "some.asc", given)


@pytest.mark.parametrize("name", ["palm", "hand"])
def test_what_a_skin_within_the_process_records_is_read_back(name, tmp_path):
    loaded, path = topology.load(name), tmp_path / "run.log"
    count = len(loaded.buses)
    recording = Recording(path, loaded)
    recording.write(records(*((10**9 + i, i, 1, 0, 0, i, b"1") for i in reversed(range(count)))))
    recording.close()
    log = read(path, buses=buses_of(loaded, path))
    found = {int(f["id"]): int(f["bus"]) for batch in log for f in batch.frames}
    assert found == {i: i for i in range(count)}


def test_only_a_skin_within_the_process_takes_the_only_channel_whatever_its_name(tmp_path):
    palm = topology.load("palm")
    for channels, count in ((["can7", "can7"], 2), (["palm", "can7"], 1)):
        path = write(tmp_path / "some.log", channels)
        assert sum(len(batch) for batch in read(path, buses=buses_of(palm, path))) == count
    path = write(tmp_path / "some.log", ["can7", "palm"])
    with pytest.raises(ChannelError, match="must have one channel, or 'palm'; got 'can7', 'palm'"):
        list(read(path, buses=buses_of(palm, path)))
