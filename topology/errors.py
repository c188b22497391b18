"""Errors of the package, and the collector of all faults of a file.

::

    Exception
    └── TopologyError (also a ValueError)        a topology or calibration file is wrong
        └── UnknownNameError (also a KeyError)   no unit of that name in a loaded topology

A message reads `<file>:<line>: <where>: must be <expected>; got <value>`, and where the value is a
name, the nearest valid one follows.
"""

from __future__ import annotations

import bisect
import difflib
from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["Issue", "Report", "TopologyError", "UnknownNameError", "nearest", "unknown_unit"]

MANY_NAMES = 256
"""With more names, only those with the same beginning are compared: a patch may have thousands of
units."""

MOST_ISSUES = 1000
"""Maximum number of issues; the check stops there."""


@dataclass(frozen=True)
class Issue:
    """One fault of a file.

    Attributes
    ----------
    file : str
        As given by the user.
    line : int
        From 1; 0 for the whole file.
    where : str
        The table and key, e.g. "patches[0] 'palm' pitch_m"; may be empty.
    message : str
        "must be ...; got ...", and the nearest valid name.
    """

    file: str
    line: int
    where: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return ": ".join(part for part in (place, self.where, self.message) if part)


class TopologyError(ValueError):
    """A topology file, or one of its calibration files, is invalid.

    Attributes
    ----------
    issues : tuple of Issue
        All faults, in the order of the files' lines; the message has one a line.
    """

    def __init__(self, issues: Iterable[Issue]) -> None:
        self.issues = tuple(issues)
        super().__init__(self.issues)

    def __str__(self) -> str:
        return "\n".join(map(str, self.issues))


class UnknownNameError(TopologyError, KeyError):
    """No unit of that name in a loaded topology."""


def unknown_unit(name: str, skin: str, units: Iterable[str]) -> UnknownNameError:
    """The error for a unit that a loaded skin does not have."""
    message = f"must be the name of a unit of {skin!r}; got {name!r}{nearest(name, units)}"
    return UnknownNameError([Issue(skin, 0, "", message)])


class Report:
    """Faults of a file, and of those that it names, so that one run of messages suffices.

    Attributes
    ----------
    issues : list of Issue
        In order of discovery, each once.
    """

    def __init__(self) -> None:
        self.issues: list[Issue] = []

    def about_file(
        self, file: str, expected: str, got: object, *, line: int = 0, where: str = "",
        hint: str = "",
    ) -> None:  # fmt: skip
        """Report a file, or a line of one, that "must be `expected`; got `got`"."""
        self.enter(Issue(file, line, where, f"must be {expected}; got {got}{hint}"))

    def enter(self, issue: Issue) -> None:
        """Report an issue.

        Raises
        ------
        TopologyError
            There are too many issues.
        """
        if issue in self.issues:
            return
        self.issues.append(issue)
        if len(self.issues) == MOST_ISSUES:
            message = f"must have less than {MOST_ISSUES} problems; got that many, and no more"
            self.issues.append(Issue(issue.file, 0, "", f"{message} are looked for"))
            self.raise_if_any()

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


def nearest(name: object, names: Iterable[str], or_all: bool = True) -> str:
    """Ending of a message: the nearest valid name, or all if they are few.

    `or_all` is False where the message lists them anyway.

    Examples
    --------
    >>> nearest("pich_m", ["rows", "pitch_m"])
    "; nearest: 'pitch_m'"
    >>> nearest("bogus", ["can0", "can1"])
    "; known: 'can0', 'can1'"
    """
    names = list(names)
    if len(names) > MANY_NAMES:
        names.sort()
        at = bisect.bisect(names, str(name))
        names = names[max(at - MANY_NAMES // 2, 0) : at + MANY_NAMES // 2]
    close = difflib.get_close_matches(str(name), names, n=1)
    if close:
        return f"; nearest: {close[0]!r}"
    if or_all and 0 < len(names) <= 12:
        return "; known: " + ", ".join(map(repr, names))
    return ""
