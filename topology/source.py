"""The text of a TOML file, with the line of each key.

`tomllib` does not keep lines. The text is scanned for them only when an issue is reported, so that
valid files cost nothing.
"""

from __future__ import annotations

import bisect
import re
import tomllib
from collections.abc import Collection, Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

from topology.errors import Issue, Report, nearest

__all__ = ["Key", "Source"]

Key = tuple[str | int, ...]
"""Path of a value in a file: ("patches", 0, "pose", "xyz_m", 1)."""

_SPACE = re.compile(r"(?:[ \t\n]|#[^\n]*)*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}'
    r"|'''.*?'{3,5}"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}\n#]+")


class Source:
    """A parsed file with the lines of its keys, and what is wrong with them.

    Parameters
    ----------
    path : Path
        The file.
    text : str
        TOML, as parsed by `tomllib`.
    shown : str
        The file's name in messages.
    report : Report
        Collects the faults.
    """

    def __init__(self, path: Path, text: str, shown: str, report: Report) -> None:
        self.path = path
        self.shown = shown
        self.report = report
        self.text = text.replace("\r\n", "\n")
        self.data: dict[str, Any] = tomllib.loads(self.text)

    @cached_property
    def _lines(self) -> dict[Key, int]:
        return _Scanner(self.text).lines

    def line(self, key: Key) -> int:
        """Line of a key, or of the innermost table around it in the file; from 1."""
        while key and key not in self._lines:
            key = key[:-1]
        return self._lines.get(key, 1)

    def where(self, key: Key) -> str:
        """A key as text: "patches[0] 'palm' pitch_m"."""
        words: list[str] = []
        node: Any = self.data
        for part in key:
            if isinstance(part, int):
                words[-1] += f"[{part}]"
            else:
                words.append(part)
            node = _step(node, part)
            name = _step(node, "name") or _step(node, "unit")
            if isinstance(part, int) and isinstance(name, str):
                words.append(repr(name))
        return " ".join(words)

    def fault(self, key: Key, expected: str, got: object, hint: str = "") -> None:
        """Report that the value at `key` "must be `expected`; got `got`"."""
        self.report.about_file(
            self.shown, expected, got, line=self.line(key), where=self.where(key), hint=hint
        )

    def lacks(self, table: Key, name: str, expected: str) -> None:
        """Report that a table has no key of that name."""
        message = f"must have the key {name}, {expected}; got none"
        self.report.enter(Issue(self.shown, self.line(table), self.where(table), message))

    def refer(self, name: str, kind: str, known: Collection[str], key: Key) -> bool:
        """Whether a name is one of the known ones; reported, with the nearest one, if not."""
        if name not in known:
            self.fault(key, f"the name of {kind}", repr(name), nearest(name, known))
        return name in known

    def unique(
        self, table: str | Key, names: Iterable[str], reserved: Collection[str] = ()
    ) -> None:
        """Report names of an array of tables that are built in, or there twice."""
        first: dict[str, Key] = {}
        for index, name in enumerate(names):
            key = (*((table,) if isinstance(table, str) else table), index, "name")
            if name in reserved:
                self.fault(key, "another name than the built-in ones", repr(name))
            elif first.setdefault(name, key) != key:
                got = f"{name!r}, also at line {self.line(first[name])}"
                self.fault(key, "a name used once", got)

    def named_file(self, file: str) -> tuple[Path, str]:
        """A file that this one names, relative to it: its path, and its name in messages."""
        return self.path.parent / file, str(Path(self.shown).parent / file)


def _step(node: Any, part: str | int) -> Any:
    if isinstance(node, dict):
        return node.get(part)
    if isinstance(node, list) and isinstance(part, int) and part < len(node):
        return node[part]
    return None


class _Scanner:
    """Walks the text of a valid file and notes the line of every key and list item."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[Key, int] = {}
        self.count: dict[Key, int] = {}
        self.breaks = [m.start() for m in re.finditer("\n", text)]
        table: Key = ()
        while self.skip() < len(text):
            if text[self.at] == "[":
                table = self.header()
            else:
                self.pair(table)

    def skip(self) -> int:
        """Past blanks, line ends and comments."""
        self.at = _end(_SPACE, self.text, self.at)
        return self.at

    def note(self, key: Key) -> None:
        self.lines.setdefault(key, bisect.bisect_left(self.breaks, self.at) + 1)

    def header(self) -> Key:
        many = self.text.startswith("[[", self.at)
        start = self.at
        self.at += 1 + many
        *outer, last = self.dotted()
        end = self.at
        table: Key = ()
        for part in outer:
            table = self.latest((*table, part))
        table = (*table, last)
        if many:
            self.count[table] = self.count.get(table, -1) + 1
            self.at = start
            self.note(table)
        table = self.latest(table)
        self.at = start
        self.note(table)
        self.at = self.text.index("]", end) + 1 + many
        return table

    def latest(self, key: Key) -> Key:
        """A key, and the item last opened where it is an array of tables."""
        return (*key, self.count[key]) if key in self.count else key

    def pair(self, table: Key) -> None:
        start = self.at
        parts = self.dotted()
        after, self.at = self.at, start
        for i in range(len(parts)):
            self.note((*table, *parts[: i + 1]))
        self.at = self.text.index("=", after) + 1
        self.value((*table, *parts))

    def dotted(self) -> list[str]:
        parts = []
        while True:
            self.skip()
            quoted = _STRING.match(self.text, self.at)
            found: Any = quoted or _BARE.match(self.text, self.at)
            parts.append(tomllib.loads(f"key = {found[0]}")["key"] if quoted else found[0])
            self.at = found.end()
            if self.text[self.skip()] != ".":
                return parts
            self.at += 1

    def value(self, key: Key) -> None:
        self.skip()
        match self.text[self.at]:
            case "[":
                self.items(key)
            case "{":
                self.inline(key)
            case '"' | "'":
                self.at = _end(_STRING, self.text, self.at)
            case _:
                self.at = _end(_SCALAR, self.text, self.at)

    def items(self, key: Key) -> None:
        self.at += 1
        index = 0
        while self.text[self.skip()] != "]":
            self.note((*key, index))
            self.value((*key, index))
            index += 1
            if self.text[self.skip()] == ",":
                self.at += 1
        self.at += 1

    def inline(self, key: Key) -> None:
        self.at += 1
        while self.text[self.skip()] != "}":
            self.pair(key)
            if self.text[self.skip()] == ",":
                self.at += 1
        self.at += 1


def _end(pattern: re.Pattern[str], text: str, at: int) -> int:
    """Where the match of a pattern at a place ends; the place itself if there is none."""
    found = pattern.match(text, at)
    return at if found is None else found.end()
