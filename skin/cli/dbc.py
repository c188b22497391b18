"""`skin dbc`: the buses of a topology, described to every other CAN tool."""

from __future__ import annotations

import json as json_text
from pathlib import Path
from typing import Annotated

import tyro

from skin.cli import options
from skin.cli.table import columns

__all__ = ["dbc"]


def dbc(
    file: options.File,
    /,
    *,
    output: Annotated[
        Path, tyro.conf.arg(metavar="DIR", aliases=["-o"], help="folder to write into")
    ] = Path("."),
    json: options.Json = False,
) -> int:
    """Write one DBC file for each bus, named after the skin and the bus: palm-main.dbc.

    They hold SYNC, the data frames with their scales, heartbeats and configuration, and are read by
    cantools, canmatrix and SavvyCAN.
    """
    from bus.dbc import write_dbc
    from topology import load

    topology = load(file)
    written = write_dbc(topology, output)
    rows = [(file.bus, str(file.messages), str(file.signals), str(file.path)) for file in written]
    print("\n".join(columns(("bus", "messages", "signals", "file"), rows)))
    if json:
        files = [
            {"path": str(found.path.resolve()), "bus": found.bus, "messages": found.messages,
             "signals": found.signals}
            for found in written
        ]  # fmt: skip
        print(json_text.dumps({"topology": topology.name, "files": files}))
    return 0
