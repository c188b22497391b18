"""Text for people: aligned columns, named facts, counts by kind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

__all__ = ["columns", "counted", "facts"]


def columns(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table, every column as wide as its widest cell."""
    cells = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]


def facts(rows: Mapping[str, str], values: Mapping[str, Any], width: int = 18) -> str:
    """One line for each name and its text, in which values stand for what is in braces."""
    return "\n".join(f"{name:<{width}} {text.format(**values)}" for name, text in rows.items())


def counted(counts: Mapping[str, int]) -> str:
    """Kinds of which there is any.

    Examples
    --------
    >>> counted({"data": 12, "late": 0, "lost": 1})
    'data 12, lost 1'
    """
    return ", ".join(f"{kind} {count}" for kind, count in counts.items() if count) or "none"
