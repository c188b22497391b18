"""Reports faults of a model file, with its name and line, by the topology's messages."""

from __future__ import annotations

from collections.abc import Iterable

from topology.errors import nearest
from topology.report import Report

__all__ = ["ModelReport"]


class ModelReport:
    """Adds issues of one model file to a report.

    Parameters
    ----------
    report : Report
    shown : str
        Name of the file in messages.
    """

    def __init__(self, report: Report, shown: str) -> None:
        self.report = report
        self.shown = shown

    def add(self, code: str, line: int = 0, where: str = "", hint: str = "", **values: object):
        """Report a fault at a line."""
        self.report.about_file(code, self.shown, line, hint, where=where, **values)

    def unknown(self, kind: str, name: str, known: Iterable[str], line: int, where: str) -> None:
        """Report an unknown name, with the nearest known one."""
        names = list(known)
        self.add("unknown-name", line, where, nearest(name, names), kind=kind, name=repr(name))

    def value(self, expected: str, got: str | None, line: int, where: str) -> None:
        """Report an invalid value."""
        shown = "none" if got is None else repr(got if len(got) <= 60 else got[:57] + "...")
        self.add("value", line, where, expected=expected, got=shown)
