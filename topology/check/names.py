"""Names: each one used once, and each reference to one that exists."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from topology.errors import nearest
from topology.report import Report
from topology.schema import PARAMETERS, File
from topology.source import Key, Source

__all__ = ["check_name", "entries", "overrides", "refer"]


def entries(file: File, table: str) -> Iterator[tuple[Key, Any]]:
    """Key and struct of every item of an array of tables that could be read."""
    for index, entry in enumerate(getattr(file, table) or ()):
        if entry is not None:
            yield (table, index), entry


def overrides(table: Any) -> dict[str, Any]:
    """The parameters that a table gives."""
    return {name: value for name in PARAMETERS if (value := getattr(table, name)) is not None}


def check_name(
    name: str,
    key: Key,
    first: dict[str, Key],
    reserved: Collection[str],
    source: Source,
    report: Report,
) -> None:
    """Report a name that is built in, or that stands in `first`; enter it there otherwise."""
    if name in reserved:
        report.add("reserved-name", source, (*key, "name"), name=repr(name))
    elif first.setdefault(name, key) != key:
        line = source.line((*first[name], "name"))
        report.add("duplicate-name", source, (*key, "name"), name=repr(name), line=line)


def refer(
    name: str, kind: str, known: Collection[str], key: Key, source: Source, report: Report
) -> bool:
    """Whether a name is one of the known ones; reported where it is not."""
    if name in known:
        return True
    report.add("unknown-name", source, key, nearest(name, known), kind=kind, name=repr(name))
    return False
