"""Text for people: a report as aligned lines and tables, and a line of progress."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

__all__ = ["columns", "end", "facts", "progress", "table"]

BAR = 30
"""Characters of a bar."""
SHOWN = 8
"""Entries of a list that a line names."""
ROWS = 64
"""Rows of a table."""


def end(report: Mapping[str, Any], as_json: bool) -> None:
    """Print a report as the end of a command: one JSON object for programs, a table for people."""
    print(json.dumps(report) if as_json else facts(report))


def facts(report: Mapping[str, Any]) -> str:
    """A line for each entry of a report, under the name that it has for programs; objects in a
    list, or by name, are a `table` below.

    Examples
    --------
    >>> print(facts({"cycles": 12, "silent_units": [], "buses": [{"name": "main", "load": 0.57}]}))
    cycles        12
    silent_units  none
    <BLANKLINE>
    buses:
    name  load
    main  0.57
    """
    tables = {name: rows for name, one in report.items() if (rows := _rows(one))}
    plain = [(name, _text(one)) for name, one in report.items() if name not in tables]
    below = [f"\n{name}:\n{table(rows, *_plain(rows))}" for name, rows in tables.items()]
    return "\n".join([*columns(("", ""), plain)[1:], *below])


def table(rows: Iterable[Mapping[str, Any]], *names: str) -> str:
    """Objects of a report as rows under the names of some of their entries.

    Examples
    --------
    >>> print(table([{"bus": "main", "load": 0.5693, "ok": True}], "bus", "load"))
    bus   load
    main  0.5693
    """
    cells = [[_text(row.get(name)) for name in names] for row in rows]
    more = [f"and {len(cells) - ROWS} more"] if len(cells) > ROWS else []
    return "\n".join([*columns(names, cells[:ROWS]), *more])


def columns(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table, every column as wide as its widest cell."""
    cells = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]


def _rows(value: Any) -> list[Mapping[str, Any]]:
    """Objects in a list, or by name; none of anything else."""
    if isinstance(value, Mapping):
        value = [{"": name, **one} if isinstance(one, Mapping) else one
                 for name, one in value.items()]  # fmt: skip
    if isinstance(value, list) and all(isinstance(one, Mapping) for one in value):
        return value
    return []


def _plain(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Entries of objects that fit into a cell."""
    found = {name: None for row in rows for name, value in row.items()
             if not isinstance(value, Mapping | list)}  # fmt: skip
    return list(found)


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        some = {name: one for name, one in value.items() if one not in (0, None, [], {})}
        return ", ".join(f"{name} {_text(one)}" for name, one in list(some.items())[:SHOWN]) or (
            "none"
        )
    if isinstance(value, list | tuple):
        more = f" and {len(value) - SHOWN} more" if len(value) > SHOWN else ""
        return (", ".join(map(_text, value[:SHOWN])) or "none") + more
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return "none" if value is None else str(value)


def progress(done: int, of: int, what: str) -> None:
    """A bar on a terminal that is written over by the next one; nothing elsewhere."""
    if sys.stderr.isatty():
        full = BAR * done // max(of, 1)
        bar = f"[{'#' * full}{'.' * (BAR - full)}] {done}/{of} {what:<40.40}"
        print(f"\r{bar}", end="\n" if done >= of else "", file=sys.stderr, flush=True)
