"""`skin export`: recorded logs as data sets of other tools."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

from skin.cli import options
from skin.cli.table import end, progress

__all__ = ["export"]

KINDS = ("lerobot",)
"""Data sets that are written."""


def export(
    kind: Annotated[str, tyro.conf.Positional, options.arg("lerobot")],
    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, options.arg("LOG [LOG ...]")],
    /,
    *,
    topology: Annotated[str | None, options.arg("FILE")] = None,
    frames: Annotated[tuple[Path, ...], options.arg("DIR [DIR ...]")],
    output: Annotated[Path, options.arg("DIR", "-o")],
    task: Annotated[tuple[str, ...], options.arg("TEXT [TEXT ...]")],
    fps: Annotated[int | None, options.arg("INT")] = None,
    taxel_image: Annotated[tuple[str, ...], options.arg("PATCH [PATCH ...]")] = (),
    offset_s: float = 0.0,
    map: options.Map = (),
    json: options.Json = False,
) -> int:
    """Write recordings, or CAN logs, and the frames of a camera as a LeRobot v3 data set.

    Each frame has the newest sample of the skin that is not later, and the seven before it; what
    is not valid is NaN. The report has the distances of frames and samples, and how many frames
    have no sample. docs/guides/connect.md has the features. Tables (.csv, .npz, .parquet) are
    written by `skin decode`. Exits with 1 if a log is damaged, with 2 if no frame of an episode has
    a sample.

    Parameters
    ----------
    kind
        kind of the data set
    logs
        recordings (.mcap) or CAN logs, an episode each
    topology
        topology file, or the name of a ready-made one: of logs; recordings have their own
    frames
        frames of the camera, for each log: a folder of <stamp_ns>.png or .jpg
    output
        folder to write, new or empty
    task
        what was done: for all logs, or for each
    fps
        frames a second of the camera; otherwise as they come
    taxel_image
        patches of rows and columns whose forces are also written as an image
    offset_s
        seconds that the clock of the log shows more than the camera's
    """
    from skin.errors import OptionError, SkinError, check_number
    from skin.io.bulk import WANT
    from skin.io.export.camera import read_frames
    from skin.io.export.lerobot import Dataset
    from skin.io.record import is_recording
    from skin.io.record.replay import recorded_topology, replay
    from topology import load

    if kind not in KINDS:
        raise OptionError.unknown("skin export", kind, KINDS)
    if len(frames) != len(logs):
        raise SkinError(f"--frames: must be as many as logs, {len(logs)}; got {len(frames)}")
    if len(task) not in (1, len(logs)):
        raise SkinError(f"--task: must be one, or as many as logs, {len(logs)}; got {len(task)}")
    check_number("--offset-s", offset_s, -1e10, 1e10)
    options.check_folder("--output", output / "meta" if output.is_dir() else output)
    recordings = [log for log in logs if is_recording(log)]
    if topology is None and not recordings:
        raise SkinError("--topology: must be given with logs; got none")
    loaded = recorded_topology(recordings[0]) if topology is None else load(topology)
    tasks = task if len(task) == len(logs) else task * len(logs)
    of_logs: dict[str, Any] = {"want": WANT} | options.mapped(map, *logs)
    wrong: list[str] = []
    with Dataset(output, loaded, fps=fps, taxels=taxel_image) as written:
        for done, (log, folder, text) in enumerate(zip(logs, frames, tasks, strict=True)):
            progress(done, len(logs), log.name)
            given = {"recalibrate": topology is not None} if is_recording(log) else of_logs
            states = replay(log, loaded, **given)
            written.add_episode(states, read_frames(folder, round(1e9 * offset_s)), text)
            wrong += states.faults
    progress(len(logs), len(logs), "")
    end(written.report() | {"output": str(output.resolve()), "faults": wrong}, json)
    sys.stderr.writelines(f"{fault}\n" for fault in wrong)
    return int(bool(wrong))
