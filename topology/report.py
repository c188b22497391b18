"""Collects all faults of a file, so that one run of messages suffices to correct it."""

from __future__ import annotations

from topology.errors import MESSAGES, Issue, TopologyError
from topology.source import Key, Source

__all__ = ["Report"]

MOST_ISSUES = 1000
"""Maximum number of issues; the check stops there."""


class Report:
    """Issues so far, and the values that they exclude from further checks.

    Attributes
    ----------
    issues : list of Issue
        In order of discovery.
    notes : list of str
        What is passed over, in words.
    """

    def __init__(self) -> None:
        self.issues: list[Issue] = []
        self.notes: list[str] = []
        self._touched: set[tuple[str, Key]] = set()

    def about_file(
        self,
        code: str,
        file: str,
        line: int = 0,
        hint: str = "",
        *,
        where: str = "",
        **values: object,
    ):
        """Report a file that cannot be read, or that is not TOML."""
        self.enter(Issue(code, file, line, where, MESSAGES[code].format(**values) + hint))

    def add(
        self,
        code: str,
        source: Source,
        key: Key,
        hint: str = "",
        part: str | None = None,
        **values: object,
    ) -> None:
        """Report the value at `key`, or the missing key `part` of its table.

        `hint` follows the message: the nearest valid name.

        Raises
        ------
        TopologyError
            There are too many issues.
        """
        message = MESSAGES[code].format(**values) + hint
        self.enter(Issue(code, source.shown, source.line(key), source.where(key), message))
        key = key if part is None else (*key, part)
        self.spoil(source, key)

    def spoil(self, source: Source, key: Key) -> None:
        """Exclude a value from further checks, since another file's issue covers it."""
        self._touched.update((source.shown, key[: i + 1]) for i in range(len(key)))

    def enter(self, issue: Issue) -> None:
        """Report an issue, once."""
        if issue in self.issues:
            return
        self.issues.append(issue)
        if len(self.issues) == MOST_ISSUES:
            message = MESSAGES["too-many-issues"].format(limit=MOST_ISSUES)
            self.issues.append(Issue("too-many-issues", issue.file, 0, "", message))
            self.raise_if_any()

    def sound(self, source: Source, key: Key, *parts: str) -> bool:
        """Whether there is no issue with these keys of a table (or with any)."""
        wanted = [(*key, part) for part in parts] or [key]
        return not any((source.shown, part) in self._touched for part in wanted)

    def raise_if_any(self) -> None:
        """Raise all issues, ordered by file and line.

        Raises
        ------
        TopologyError
            There are issues.
        """
        if self.issues:
            files = {issue.file: turn for turn, issue in reversed(list(enumerate(self.issues)))}
            raise TopologyError(sorted(self.issues, key=lambda i: (files[i.file], i.line)))
