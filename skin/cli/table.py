"""Text for people: aligned columns, a report as a table, counts by kind, a line of progress."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

__all__ = ["columns", "counted", "end", "facts", "progress"]

BAR = 30
"""Characters of a bar."""
SHOWN = 8
"""Entries of a list that a line names."""


def columns(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table, every column as wide as its widest cell."""
    cells = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]


def end(report: Mapping[str, Any], as_json: bool) -> None:
    """Print a report as the end of a command: one JSON object for programs, a table for people."""
    print(json.dumps(report) if as_json else facts(report))


def facts(report: Mapping[str, Any]) -> str:
    """A line for each entry of a report, under the name that it has for programs.

    Examples
    --------
    >>> print(facts({"cycles": 12, "peak_force_n": 1.25, "silent_units": []}))
    cycles        12
    peak_force_n  1.25
    silent_units  none
    """
    return "\n".join(columns(("", ""), [(name, _text(one)) for name, one in report.items()])[1:])


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        some = {name: one for name, one in value.items() if one not in (0, None, [], {})}
        return ", ".join(f"{name} {_text(one)}" for name, one in list(some.items())[:SHOWN]) or (
            "none"
        )
    if isinstance(value, list):
        more = f" and {len(value) - SHOWN} more" if len(value) > SHOWN else ""
        return (", ".join(map(_text, value[:SHOWN])) or "none") + more
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return "none" if value is None else str(value)


def counted(counts: Mapping[str, int]) -> str:
    """Kinds of which there is any.

    Examples
    --------
    >>> counted({"data": 12, "late": 0, "lost": 1})
    'data 12, lost 1'
    """
    return ", ".join(f"{kind} {count}" for kind, count in counts.items() if count) or "none"


def progress(done: int, of: int, what: str) -> None:
    """A bar on a terminal that is written over by the next one; nothing elsewhere."""
    if sys.stderr.isatty():
        full = BAR * done // max(of, 1)
        bar = f"[{'#' * full}{'.' * (BAR - full)}] {done}/{of} {what:<40.40}"
        print(f"\r{bar}", end="\n" if done >= of else "", file=sys.stderr, flush=True)
