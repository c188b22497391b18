"""What is no recording, or not of this skin, is refused by name; what is whole of it is played."""

from __future__ import annotations

import itertools
import re
from contextlib import suppress

import numpy as np
import pytest

import skin
import topology
from bus.errors import LogError
from skin.cli import main
from skin.errors import LibraryError, OptionError, SkinError
from skin.io.messages.definitions import FRAMES, STATE
from skin.io.record.attached import read_setup
from skin.io.record.container import RecordedFile
from tests.fixtures.cases import long_after_first
from topology.packed import from_arrays, to_arrays

pytest.importorskip("mcap", reason="mcap is not installed")
CYCLES = 300


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A recording of some chunks."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    with skin.open("strip", simulate=True, pace=False, record=path) as strip:
        for count in range(3):
            for _ in itertools.islice(strip, CYCLES // 3):
                pass
            strip.recorder.report()  # ends a chunk
            assert count < 3
    return path


def damaged(file, tmp_path, data):
    path = tmp_path / "other.mcap"
    path.write_bytes(data)
    return path


def played(path):
    replay = skin.replay(path)
    return sum(1 for _ in replay), replay


def test_a_cut_recording_is_played_up_to_there(file, tmp_path):
    data = file.read_bytes()
    path = damaged(file, tmp_path, data[: len(data) * 2 // 3])
    count, replay = played(path)
    assert 0 < count < CYCLES
    assert replay.same == count
    (fault,) = replay.faults
    assert re.fullmatch(
        rf"{re.escape(str(path))}: must go on to its footer; got no more that is whole after "
        rf"\d+ of {len(data) * 2 // 3} bytes \(.+\)",
        fault,
    )


def chunks_of(file):
    """End and length of the data of each chunk that has cycles; a slow start ends one without."""
    from mcap.stream_reader import StreamReader, breakup_chunk

    places = []
    with file.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if type(record).__name__ == "Chunk":
                inside = sum(type(entry).__name__ == "Message" for entry in breakup_chunk(record))
                if inside > CYCLES // 10:
                    places.append((stream.tell(), len(record.data)))
    return places


@long_after_first("which", [0, 1])
def test_a_damaged_chunk_costs_no_more_than_that_chunk(file, tmp_path, which):
    """Though the first is the one that declares the channels of all."""
    data = bytearray(file.read_bytes())
    end, size = chunks_of(file)[which]
    data[end - size // 2] ^= 1
    count, replay = played(damaged(file, tmp_path, bytes(data)))
    assert CYCLES // 2 < count < CYCLES
    faults = [fault for fault in replay.faults if "got a chunk of" in fault]
    assert len(faults) == 1
    assert "damaged" in faults[0]


def test_the_command_tells_damage_and_ends_with_1(file, tmp_path, capsys):
    data = file.read_bytes()
    path = damaged(file, tmp_path, data[: len(data) * 2 // 3])
    assert main(["replay", str(path), "--speed", "0"]) == 1
    assert "must go on to its footer" in capsys.readouterr().err
    assert main(["replay", str(file), "--speed", "0"]) == 0
    told = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["same", str(CYCLES)] in told


@pytest.mark.parametrize("keep", [0, 5, 8, 20, 60, 400, 3000])
def test_what_is_no_whole_beginning_is_refused(file, tmp_path, keep):
    path = damaged(file, tmp_path, file.read_bytes()[:keep])
    with pytest.raises(LogError, match=re.escape(f"{path}: must ")):
        skin.replay(path)


@pytest.mark.parametrize(
    ("name", "got"), [(b"run.json", "nothing"), (b"topology.npz", "'run.json'")]
)
def test_a_cut_within_the_attachments_says_where_it_is_and_what_is_left(file, tmp_path, name, got):
    data = file.read_bytes()
    size = data.index(name) + 40
    path = damaged(file, tmp_path, data[:size])
    with pytest.raises(LogError) as raised:
        skin.replay(path)
    assert re.fullmatch(
        rf"{re.escape(str(path))}: must go on to its footer; got no more that is whole after "
        rf"\d+ of {size} bytes \(.+\): of the topology and options, which come before all frames "
        rf"and states, {got} can be read",
        str(raised.value),
    )


def test_bytes_that_are_damaged_anywhere_are_refused_or_told(file, tmp_path):
    whole, topics = file.read_bytes(), {FRAMES, STATE}
    told = [*RecordedFile(file).messages(topics)]
    rng = np.random.default_rng(8)
    for _ in range(60):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 3):
            data[at] ^= int(rng.integers(1, 256))
        path = damaged(file, tmp_path, bytes(data))
        with suppress(LogError):  # of a beginning that cannot be read
            recorded = RecordedFile(path)
            read_setup(recorded)
            found = [*recorded.messages(topics)]
            assert found == told or recorded.damage


def test_a_file_of_another_kind_is_refused(tmp_path):
    path = damaged(None, tmp_path, b"(1700000000.0) can0 123#00\n" * 10)
    with pytest.raises(LogError, match=f"{path}: must be an MCAP file; got "):
        skin.replay(path)
    with pytest.raises(LogError, match=r"none\.mcap: must be an existing file; got none"):
        skin.replay(tmp_path / "none.mcap")


def test_an_mcap_of_somebody_else_is_refused(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start()
        writer.finish()
    with pytest.raises(
        LogError,
        match=r"other\.mcap: must be a recording of a skin, with 'run\.json' attached; got nothing",
    ):
        skin.replay(path)


def test_a_recording_of_another_topology_is_refused_with_what_differs(file):
    assert skin.replay(file, "strip").topology.name == "strip"
    with pytest.raises(
        LogError,
        match=r"run\.mcap: topology: must be recorded with 'palm' as it is now; got differences "
        r"in name, unit_names, patch_names, ",
    ):
        skin.replay(file, "palm")


def test_a_recording_of_other_definitions_is_refused(file, monkeypatch):
    monkeypatch.setattr("skin.io.record.container.definition", lambda name: f"uint8 {name}")
    with pytest.raises(LogError, match=r"run\.mcap: f3t_msgs/msg/\w+: must be defined as in this "):
        played(file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": None}, "position: must be there, as this version of f3t-skin has it; got n"),
        ({"area": np.zeros(3)}, "area: must be of shape (10,); got (3,)"),
        ({"texts": np.array("{}")}, "texts: must be buses, layouts and names of a topology; got "),
        ({"texts": None}, "texts: must be buses, layouts and names of a topology; got 'texts'"),
    ],
)  # fmt: skip
def test_arrays_that_are_no_topology_are_refused(change, message):
    arrays = to_arrays(topology.load("strip"))
    for name, value in change.items():
        arrays.pop(name)
        if value is not None:
            arrays[name] = value
    with pytest.raises(ValueError, match=re.escape(message)):
        from_arrays(arrays)


def test_other_options_give_other_states_which_are_not_compared(file):
    replay = skin.replay(file, want="force")
    assert [hasattr(state, "wrench") for state in itertools.islice(replay, 3)] == [False] * 3
    assert (replay.count, replay.faults) == (0, [])
    with pytest.raises(OptionError, match=r"speed: must be a number from 1e-06 to 1e\+06; got 0"):
        skin.replay(file, speed=0)


@pytest.mark.long
def test_files_that_cannot_be_recorded_to_are_refused_and_kept(file, tmp_path, capsys):
    before = file.read_bytes()
    far = tmp_path / "none" / "run.mcap"
    is_new = "must be a new file; got one that is there already"
    needs_folder = "must be in a folder that exists; got"
    for path, expected, of_command in (
        (file, f"{file}: {is_new}", f"{file}: {is_new}"),
        (far, f"{far}: {needs_folder} '{far.parent}'", f"--record: {needs_folder} '{far}'"),
    ):
        with pytest.raises(SkinError, match=re.escape(expected)):
            skin.open("strip", simulate=True, record=path)
        assert main(["run", "strip", "--simulate", "--record", str(path)]) == 2
        assert capsys.readouterr().err == f"{of_command}\n"
    assert file.read_bytes() == before


def test_what_the_system_refuses_is_told():
    with pytest.raises(SkinError, match=r"/proc/run\.mcap: "):
        skin.open("strip", simulate=True, record="/proc/run.mcap")


def test_without_the_library_it_is_named(monkeypatch, tmp_path, file):
    monkeypatch.setattr("skin.io.messages.definitions.find_spec", lambda name: None)
    with pytest.raises(
        LibraryError,
        match=r"record: must have mcap; not installed: pip install 'f3t-skin\[log\]'",
    ):
        skin.open("strip", simulate=True, record=tmp_path / "run.mcap")
    with pytest.raises(LibraryError, match=r"run\.mcap: must have mcap; not installed"):
        skin.replay(file)


@pytest.mark.long
def test_what_is_left_out_is_counted_and_told(tmp_path, caplog):
    file = tmp_path / "run.mcap"
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        recorder = strip.recorder
        states = iter(strip)
        recorder.look_at = float("inf")
        next(states)
        recorder._closed = True
        for _ in itertools.islice(states, 7):
            pass
        recorder._closed = False
        recorder.look_at = 0.0
        for _ in itertools.islice(states, 7):
            pass
    report = recorder.report()
    assert report["lost_cycles"] == 7
    assert report["lost_frames"] > 7
    assert f"left out 7 cycles and {report['lost_frames']} frames so far" in caplog.text
    replay = skin.replay(file)
    count = sum(1 for _ in replay)
    assert count == report["cycles"] == 8
    assert f"got 7 cycles and {report['lost_frames']} frames left out" in replay.faults[0]
