"""Text for people: aligned columns, named facts, counts by kind, a line of progress."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence

__all__ = ["columns", "counted", "facts", "progress"]

BAR = 30
"""Characters of a bar."""


def columns(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table, every column as wide as its widest cell."""
    cells = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]


def facts(rows: Mapping[str, str], width: int = 18) -> str:
    """One line for each name and its text."""
    return "\n".join(f"{name:<{width}} {text}" for name, text in rows.items())


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
