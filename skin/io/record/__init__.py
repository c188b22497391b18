"""Recordings of runs as MCAP files, and their replay to the same states, bit for bit.

::

    loop     Pipeline ─► Recorder (a sink) ─► ring buffer
    worker   ring buffer ─► SkinMessages ─► Container ─► run.mcap
    replay   run.mcap ─► events in their order ─► Pipeline ─► states

A file contains the inputs of the pipeline, in order (frames, cycles that the clock closed, new
poses), and its states, as messages that any reader of MCAP with the profile ros2 knows.
"""

import os
from pathlib import Path

__all__ = ["is_recording"]


def is_recording(file: str | os.PathLike[str]) -> bool:
    """Whether a file is named as a recording is (.mcap), and not as a log."""
    return Path(file).suffix.lower() == ".mcap"
