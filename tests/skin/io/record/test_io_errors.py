"""Each opening, write and sync of a recording fails once: the run goes on, and a message says why;
what was written before can be read."""

from __future__ import annotations

import itertools

import pytest

import skin
from skin.errors import SkinError
from skin.io.record import recorder
from tests.fixtures.failing_recorder import AT, FOLDER, REPORT

pytest.importorskip("mcap", reason="mcap is not installed")

PARTS, CYCLES = 2, 40
"""Parts of a run, and cycles of each; every part is written out before the next."""


def record(file):
    """States of a run, its recorder, and the cycles that were recorded without an error."""
    live, kept = [], 0
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        own = strip.recorder
        for _ in range(PARTS):
            live += [state.copy() for state in itertools.islice(strip, CYCLES)]
            kept = own.report().get("cycles", kept) if own.failure is None else kept
    return live, own, kept


@pytest.fixture
def failing(tmp_path, monkeypatch):
    """A run on a disk that fails at an operation: its operations, the one that failed, its result
    or error, and its file."""
    monkeypatch.setattr(recorder, "MODULE", "tests.fixtures.failing_recorder")
    report = tmp_path / "report"
    monkeypatch.setenv(REPORT, str(report))

    def run(at):
        folder = tmp_path / f"at{at}"
        folder.mkdir()
        monkeypatch.setenv(FOLDER, str(folder))
        monkeypatch.setenv(AT, str(at))
        file, result = folder / "run.mcap", None
        try:
            result = record(file)
        except SkinError as error:
            result = error
        count, failed = report.read_text().split(" ")
        return int(count), failed, result, file

    return run


@pytest.mark.long
def test_each_operation_of_a_recording_fails_once(failing, caplog):
    count, failed, (live, own, kept), file = failing(10_000)
    assert (failed, own.failure, kept, len(live)) == ("", None, PARTS * CYCLES, PARTS * CYCLES)
    check_kept(file, live, kept)
    steps = []
    for at in range(count):
        _, failed, result, file = failing(at)
        steps.append(failed)
        if isinstance(result, SkinError):
            assert str(result) == f"{file}: No space left on device"
            assert not [*file.parent.iterdir()]  # nothing is in the way of the next
            continue
        live, own, kept = result
        assert len(live) == PARTS * CYCLES
        assert own.failure == (
            f"{file}: must be written to the end of the run; got: No space left on device "
            "(what was written before can be read, the run goes on)"
        )
        assert own.failure in caplog.messages
        check_kept(file, live, kept)
    assert steps[:2] == ["open", "write"]
    assert steps[-2:] == ["write", "fsync"]
    assert steps.count("write") >= 2 + PARTS


def check_kept(file, live, kept):
    """What was written before is whole, and replays to the states of the run."""
    replay = skin.replay(file)
    states = [state.units.force.tobytes() for state in replay]
    assert len(states) >= kept
    assert states == [state.units.force.tobytes() for state in live[: len(states)]]
