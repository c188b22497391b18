"""`skin export`: recorded logs as data sets of other tools."""

from __future__ import annotations

from typing import Annotated

import tyro

__all__ = ["SUBCOMMANDS", "export"]

SUBCOMMANDS = {"lerobot": "skin.cli.export_lerobot:export_lerobot"}
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
