"""`skin export`: recorded logs as data sets of other tools."""

from __future__ import annotations

import json as json_text
import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

from skin.cli import options

__all__ = ["SUBCOMMANDS", "export", "lerobot"]

SUBCOMMANDS = {"lerobot": "skin.cli.export:lerobot"}
"""Words that stand for commands of their own: module and function."""


def export(
    kind: Annotated[
        str, tyro.conf.Positional, tyro.conf.arg(metavar="KIND", help=" or ".join(SUBCOMMANDS))
    ],
    /,
) -> int:
    """Write recorded logs as a data set of another tool: `skin export lerobot --help`.

    Tables (.csv, .npz, .parquet) are written by `skin decode`.
    """
    from skin.errors import OptionError

    raise OptionError.unknown("skin export", kind, SUBCOMMANDS)


Logs = Annotated[
    tuple[Path, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="LOG [LOG ...]", help="recordings (.mcap) or CAN logs, an episode each"),
]
TopologyFile = Annotated[
    str | None,
    options.quiet(f"{options.FILE_HELP}: of logs; recordings have their own", metavar="FILE"),
]
Frames = Annotated[
    tuple[Path, ...],
    tyro.conf.arg(
        metavar="DIR [DIR ...]",
        help="frames of the camera, for each log: a folder of <stamp_ns>.png or .jpg",
    ),
]
Output = Annotated[
    Path, tyro.conf.arg(metavar="DIR", help="folder to write, new or empty", aliases=["-o"])
]
Tasks = Annotated[
    tuple[str, ...],
    tyro.conf.arg(metavar="TEXT [TEXT ...]", help="what was done: for all logs, or for each"),
]
Fps = Annotated[int, tyro.conf.arg(metavar="INT", help="frames a second of the camera")]
Window = Annotated[int, tyro.conf.arg(metavar="INT", help="samples of the skin in a window")]
TaxelImages = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        metavar="PATCH [PATCH ...]",
        help="patches of rows and columns whose forces are also written as an image",
    ),
]
Offset = Annotated[
    float,
    tyro.conf.arg(metavar="SECONDS", help="what the clock of the log shows more than the camera's"),
]


def lerobot(
    logs: Logs,
    /,
    *,
    topology: TopologyFile = None,
    frames: Frames,
    output: Output,
    task: Tasks,
    fps: Fps,
    window: Window = 8,
    taxel_image: TaxelImages = (),
    offset_s: Offset = 0.0,
    map: options.Map = (),
    sweeps: options.Sweeps = None,
    dtype: options.DType = None,
    json: options.Json = False,
) -> int:
    """Write recordings, or CAN logs, and the frames of a camera as a LeRobot v3 data set.

    Each frame has the newest sample of the skin that is not later, and the window before it; what
    is not valid is NaN. The report has the distances of frames and samples, and how many frames
    have no sample. docs/guides/connect.md has the features. Exits with 1 if a log is damaged, with
    2 if no frame of an episode has a sample.
    """
    from skin.errors import SkinError, check_number
    from skin.io.bulk import WANT
    from skin.io.export.camera import read_frames
    from skin.io.export.lerobot import Dataset
    from skin.io.record import is_recording
    from skin.io.record.replay import recorded_topology, replay
    from topology import load

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
    asked, wrong = options.chosen(sweeps=sweeps, dtype=dtype) | options.mapped(map, *logs), []
    with Dataset(output, loaded, fps=fps, window=window, taxels=taxel_image) as written:
        for log, folder, text in zip(logs, frames, tasks, strict=True):
            wanted: dict[str, Any] = {} if is_recording(log) else {"want": WANT}
            states = replay(log, loaded, **wanted | asked)
            written.add_episode(states, read_frames(folder, round(1e9 * offset_s)), text)
            wrong += states.faults
    report = written.report() | {"output": str(output.resolve()), "faults": wrong}
    print(json_text.dumps(report) if json else _table(report))
    sys.stderr.writelines(f"{fault}\n" for fault in wrong)
    return int(bool(wrong))


def _table(report: dict[str, Any]) -> str:
    lines = []
    for number, one in enumerate(report["alignment"]):
        lines.append(
            f"episode {number}: {one['frames']} frames, {one['without_sample']} without a sample, "
            f"{one['window_gaps']} samples lacking in windows; samples are "
            f"{1e3 * one['age_s_p50']:.2f} ms old (p50), {1e3 * one['age_s_max']:.2f} at most; "
            f"{one['camera_gaps']} gaps of the camera"
        )
    return "\n".join([*lines, f"written: {report['output']}"])
