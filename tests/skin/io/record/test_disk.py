"""A disk that is full ends the recording, and nothing else."""

from __future__ import annotations

import itertools
import os
import subprocess
import time

import pytest

import skin
from tests.fixtures.patience import LONG_S

pytest.importorskip("mcap", reason="mcap is not installed")


@pytest.fixture
def full(tmp_path):
    """A folder on a disk that has room for one chunk at least, whatever the speed."""
    if os.geteuid():
        pytest.skip("only root may mount a tmpfs")
    mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(tmp_path)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"no tmpfs can be mounted: {done.stderr.strip()}")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


@pytest.mark.long
def test_a_full_disk_ends_the_recording_with_a_message_and_the_loop_goes_on(full, caplog):
    file, live = full / "run.mcap", []
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        recorder = strip.recorder
        until = time.monotonic() + LONG_S
        for state in strip:
            live.append(state.copy())
            if recorder.failure is not None or time.monotonic() > until:
                break
        after = sum(1 for _ in itertools.islice(strip, 50))
    assert after == 50
    expected = (
        f"{file}: must be written to the end of the run; got: No space left on device "
        "(what was written before can be read, the run goes on)"
    )
    assert recorder.failure == expected
    assert expected in caplog.messages
    check_kept(file, live)


def check_kept(file, live):
    """What was written before is whole, and replays to the states of the run, up to the first cycle
    that a slow writer left out."""
    replay, count = skin.replay(file), 0
    for state, true in zip(replay, live, strict=False):
        if state.cycle != true.cycle:
            break
        assert state.units.force.tobytes() == true.units.force.tobytes()
        count += 1
    assert count > 50
    assert replay.same >= count
