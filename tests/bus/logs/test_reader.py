"""What no log reader waits for, or fills the memory with."""

from __future__ import annotations

import os

import pytest

from bus.errors import FaultScriptError, LogError
from bus.faults.script import load_script
from bus.logs import read, read_all


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc", ".log.gz", ".db", ".mf4"])
def test_what_is_no_regular_file_is_refused_at_once(suffix, tmp_path):
    pipe = tmp_path / f"pipe{suffix}"
    os.mkfifo(pipe)
    with pytest.raises(LogError, match="must be a readable file; got: a FIFO"):
        read(pipe)
    device = tmp_path / f"zero{suffix}"
    device.symlink_to("/dev/zero")
    with pytest.raises(LogError, match="must be a readable file; got: a device"):
        read(device)
    with pytest.raises(LogError, match="must be a readable file; got: File name too long"):
        read(f"{'n' * 300}{suffix}")


def test_a_line_without_an_end_is_refused_before_the_memory_is_full(tmp_path):
    log = tmp_path / "long.asc"
    log.write_text("date today\n" + "7" * 3_000_000)
    with pytest.raises(LogError, match=r"long.asc:2: must be a line .*left out"):
        read_all(log)


def test_a_fault_script_is_a_regular_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(FaultScriptError, match="a FIFO, and no regular file"):
        load_script(tmp_path / "pipe.toml")
    (tmp_path / "digits.toml").write_text("format = 1\nseed = " + "7" * 5000)
    with pytest.raises(FaultScriptError, match=r"digits.toml:2: .*thousands of digits"):
        load_script(tmp_path / "digits.toml")
    (tmp_path / "many.toml").write_text("".join(f"k{i} = 1\n" for i in range(1100)))
    with pytest.raises(FaultScriptError, match="must have less than 1000 problems"):
        load_script(tmp_path / "many.toml")
