"""Collects everything that is wrong, so that one look at the messages is enough to mend a file."""

from __future__ import annotations

from topology.errors import MESSAGES, Issue, TopologyError
from topology.source import Key, Source

__all__ = ["Report"]

MOST_ISSUES = 1000
"""Of a file that has more of them no more are looked for."""


class Report:
    """Issues found so far, and what they make unfit for further checks.

    Attributes
    ----------
    issues : list of Issue
        In the order in which they were found.
    """

    def __init__(self) -> None:
        self.issues: list[Issue] = []
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
        """Report a file that could not be read at all, or that is no TOML."""
        self._enter(Issue(code, file, line, where, MESSAGES[code].format(**values) + hint))

    def add(
        self,
        code: str,
        source: Source,
        key: Key,
        hint: str = "",
        part: str | None = None,
        **values: object,
    ) -> None:
        """Report the value at `key`, or what its table lacks under the key `part`.

        `hint` is what follows the message: the nearest valid name.

        Raises
        ------
        TopologyError
            Too much is wrong to go on.
        """
        message = MESSAGES[code].format(**values) + hint
        self._enter(Issue(code, source.shown, source.line(key), source.where(key), message))
        key = key if part is None else (*key, part)
        self.spoil(source, key)

    def spoil(self, source: Source, key: Key) -> None:
        """Make a value unfit for further checks, as another file says what is wrong with it."""
        self._touched.update((source.shown, key[: i + 1]) for i in range(len(key)))

    def _enter(self, issue: Issue) -> None:
        self.issues.append(issue)
        if len(self.issues) == MOST_ISSUES:
            message = MESSAGES["too-many-issues"].format(limit=MOST_ISSUES)
            self.issues.append(Issue("too-many-issues", issue.file, 0, "", message))
            self.raise_if_any()

    def sound(self, source: Source, key: Key, *parts: str) -> bool:
        """Whether nothing has been said yet against these keys of a table (or against any)."""
        wanted = [(*key, part) for part in parts] or [key]
        return not any((source.shown, part) in self._touched for part in wanted)

    def raise_if_any(self) -> None:
        """Raise everything at once, ordered by file and line.

        Raises
        ------
        TopologyError
            Something is wrong.
        """
        if self.issues:
            files = {issue.file: turn for turn, issue in reversed(list(enumerate(self.issues)))}
            raise TopologyError(sorted(self.issues, key=lambda i: (files[i.file], i.line)))
