"""`skin record`: run a skin, and record frames and states as MCAP."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from skin.cli import options
from skin.cli.run import AutoTare, Simulate, Wait, Zeros, run

__all__ = ["record"]


def record(
    file: options.File,
    /,
    *,
    output: Annotated[
        Path, tyro.conf.arg(metavar="FILE", help="new recording, .mcap", aliases=["-o"])
    ],
    seconds: options.Until = None,
    interface: options.Interface = None,
    channel: options.Channel = None,
    sync: options.Sync = "host",
    wait: Wait = "event",
    simulate: Simulate = False,
    scene: options.Scene = None,
    seed: options.Seed = None,
    auto_tare: AutoTare = True,
    zeros: Zeros = None,
    json: options.Json = False,
) -> int:
    """Run a skin as `skin run` does, and record its frames and states as MCAP.

    Foxglove, PlotJuggler and the tools for ROS 2 bags read the file as it is; `skin replay` plays
    it to the same states. A process of its own writes it: what was written can be read,
    however the run ends, and where the disk is full the run goes on.
    """
    return run(
        file, seconds=seconds, interface=interface, channel=channel, sync=sync, wait=wait,
        simulate=simulate, scene=scene, seed=seed, auto_tare=auto_tare, zeros=zeros,
        record=output, json=json,
    )  # fmt: skip
