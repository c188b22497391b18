"""MCAP files of a log: what a recording of the same frames holds, but for its frames."""

from __future__ import annotations

import dataclasses
import json
import os

import numpy as np
import pyarrow.parquet
import pytest

import skin
from bus.errors import LogError
from skin.io.bulk.decode_part import decode_part
from skin.io.bulk.job import parts_of
from skin.state import INVALID
from tests.skin.io.bulk.conftest import CYCLES, PARTITION

mcap = pytest.importorskip("mcap.reader", reason="mcap is not installed")


def done(job, log):
    (part,) = parts_of([log])
    return decode_part(job, part)


@pytest.fixture
def shown(job):
    """A job whose files are MCAP."""
    return dataclasses.replace(job, format="mcap")


def messages(files):
    """Topic, type, times and bytes of all messages but frames, by the library's own reader."""
    found = []
    for path in files:
        with path.open("rb") as file:
            for schema, channel, message in mcap.make_reader(file).iter_messages(
                log_time_order=False
            ):
                if channel.topic != "/skin/frames":
                    found.append((channel.topic, schema.name, schema.data, message.log_time,
                                  message.publish_time, message.data))  # fmt: skip
    return found


def files_of(job):
    return sorted(job.folder.rglob("part-*.mcap"))


def of_cycles(found):
    """Those that come with each cycle, wherever files end."""
    topics = "/skin/state", "/skin/wrench", "/skin/contact/"
    return [one for one in found if one[0].startswith(topics)]


@pytest.fixture
def recorded(record):
    """A recording of the frames of the log."""
    return record()[0]


def test_a_file_holds_the_messages_of_a_recording(shown, log, recorded):
    whole = dataclasses.replace(shown, partition_cycles=None)
    summary = done(whole, log)
    assert (summary["state"], summary["cycles"], summary["faults"]) == ("decoded", CYCLES, [])
    mine, theirs = messages(files_of(whole)), messages([recorded])
    assert {one[0] for one in mine} >= {
        "/skin/layout", "/tf", "/skin/points", "/skin/forces", "/diagnostics",
        "/skin/contact/0",
    }  # fmt: skip
    assert mine == theirs


def test_parts_hold_the_same_and_each_says_what_hangs_where(shown, log, recorded):
    done(shown, log)
    files = files_of(shown)
    assert len(files) == -(-CYCLES // PARTITION)
    assert of_cycles(messages(files)) == of_cycles(messages([recorded]))
    for file in files:
        assert [one[0] for one in messages([file])[:2]] == ["/skin/layout", "/tf"]


def test_values_are_those_of_the_tables(shown, job, log):
    done(shown, log)
    tables = dataclasses.replace(job, folder=job.folder / "tables", format="parquet")
    done(tables, log)
    found = pyarrow.parquet.read_table(tables.folder / "cycles")
    names, n = job.topology.unit_names, job.topology.n
    force = np.stack([[found[f"{name}.{axis}"].to_numpy() for name in names]
                      for axis in ("fx", "fy", "fz")])  # fmt: skip
    status = np.stack([found[f"{name}.status"].to_numpy() for name in names])
    force[:, status & int(INVALID) != 0] = np.nan
    stamps = found["time"].to_numpy().astype(np.int64)
    reading = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    states = [one for file in files_of(shown)
              for one in reading.read_ros2_messages(str(file), ["/skin/state"])]  # fmt: skip
    assert [one.log_time_ns for one in states] == stamps.tolist()
    got = np.stack([np.reshape(one.ros_msg.force, (3, n)) for one in states], axis=2)
    np.testing.assert_array_equal(got, force)
    contacts = [one for state in states for one in state.ros_msg.contacts]
    listed = pyarrow.parquet.read_table(tables.folder / "contacts")
    assert [one.id for one in contacts] == listed["id"].to_pylist()
    margins = np.array([one.margin for one in contacts], np.float32)
    np.testing.assert_array_equal(margins, listed["margin"].to_numpy().astype(np.float32))


def test_a_job_that_was_left_goes_on_to_the_same_files(shown, log, contents):
    done(shown, log)
    before, (part,) = contents(shown.folder), parts_of([log])
    manifest = shown.manifest_of(part)
    told = json.loads(manifest.read_text())
    assert told["tables"] == ["states"]
    manifest.write_text(json.dumps(told | {"partitions": told["partitions"][:2],
                                           "complete": False}))  # fmt: skip
    _, kept, *_ = files_of(shown)
    stamp_ns = kept.stat().st_mtime_ns
    assert done(shown, log)["state"] == "decoded"
    assert kept.stat().st_mtime_ns == stamp_ns
    assert contents(shown.folder) == before


def test_it_says_what_it_was_made_of_and_is_no_recording(shown, log):
    done(shown, log)
    file, *_ = files_of(shown)
    with file.open("rb") as opened:
        attached = {one.name: one.data for one in mcap.make_reader(opened).iter_attachments()}
    assert json.loads(attached["decoded.json"]) == shown.provenance(parts_of([log])[0])
    assert "topology.npz" in attached
    message = "must be a recording, with frames to be replayed; got states"
    with pytest.raises(LogError, match=message):
        skin.replay(file)


def test_a_recording_is_not_made_mcap_once_more(shown, recorded):
    summary = done(shown, recorded)
    assert summary["state"] == "failed"
    assert "must be 'parquet' or 'npz' for a recording" in summary["error"]
    assert not files_of(shown)


def test_a_disk_that_fills_leaves_no_half_file(shown, log, monkeypatch):
    write = os.write

    def full(file, data):
        if len(data) > 100_000:
            raise OSError(28, "No space left on device")
        return write(file, data)

    monkeypatch.setattr(os, "write", full)
    summary = done(shown, log)
    assert summary["state"] == "failed"
    assert summary["error"].endswith("part-00000.mcap: No space left on device")
    assert not [file for file in shown.folder.rglob("*part*")]
