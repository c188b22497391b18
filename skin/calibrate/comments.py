"""Comments of a TOML file, carried over to another text of the same keys."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any, NamedTuple

__all__ = ["carry_comments"]

STRING = r'"(?:[^"\\]|\\.)*"|\'[^\']*\''
TRAILING = re.compile(rf"^(?:{STRING}|[^#\"'])*?\s*(#.*)$")
OWN = re.compile(r"# ± ")
"""How the comments begin that are written with a value, and again with each."""


class _Line(NamedTuple):
    """A key or a table, with the comments above it and behind it."""

    path: tuple[str, ...]
    above: list[str]
    text: str
    behind: str


def carry_comments(before: str, after: str) -> str:
    """The text `after` with the comments that stand in `before`, each at its key or table.

    Parameters
    ----------
    before, after : str
        TOML; `after` has no comments of lines of their own.

    Examples
    --------
    >>> print(carry_comments("# of the left hand\\na = 1  # by eye", "a = 2\\nb = 3\\n"))
    # of the left hand
    a = 2  # by eye
    b = 3
    <BLANKLINE>
    """
    *lines, end = _lines(before)
    kept = {line.path: line for line in lines}
    told = []
    *fresh, _ = _lines(after)
    for line in fresh:
        old = kept.pop(line.path, None)
        if line.text.startswith("["):
            told.append("")
        told += [] if old is None else old.above
        told.append(line.text if old is None or not old.behind else f"{line.text}  {old.behind}")
    for line in kept.values():  # what has no place any more is not lost
        told += line.above
    return "\n".join([*told, *end.above]) + "\n"


def _lines(text: str) -> Iterator[_Line]:
    """Keys and tables of a TOML text in their order, and at last what stands behind all of them."""
    table: tuple[str, ...] = ()
    above: list[str] = []
    waiting: list[str] = []
    for line in text.splitlines():
        stripped = line.strip()
        if not waiting and (not stripped or stripped.startswith("#")):
            above += [stripped] if stripped else []
            continue
        waiting.append(line)
        try:
            path = _path(tomllib.loads("\n".join(waiting)))
        except tomllib.TOMLDecodeError:  # goes on in the next line
            continue
        is_table = stripped.startswith("[") and len(waiting) == 1
        if is_table:
            table = path
        match = TRAILING.match(line)
        behind = "" if match is None or OWN.match(match[1]) else match[1]
        yield _Line(path if is_table else (*table, *path), above, "\n".join(waiting), behind)
        above, waiting = [], []
    yield _Line((), above, "", "")


def _path(parsed: dict[str, Any]) -> tuple[str, ...]:
    """The keys down to the one value, or to a table of several or none."""
    path: list[str] = []
    value: Any = parsed
    while isinstance(value, dict) and len(value) == 1:
        ((key, value),) = value.items()
        path.append(key)
    return tuple(path)
