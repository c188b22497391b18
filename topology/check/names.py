"""Names: unique, and references to existing ones."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from topology.errors import nearest
from topology.report import Report
from topology.schema import File
from topology.source import Key, Source

__all__ = ["all_named", "check_name", "entries", "refer"]


def entries(file: File, table: str) -> Iterator[tuple[Key, Any]]:
    """Key and struct of every readable item of an array of tables."""
    for index, entry in enumerate(getattr(file, table) or ()):
        if entry is not None:
            yield (table, index), entry


def all_named(table: str, file: File, source: Source, report: Report) -> bool:
    """Whether every item of an array of tables has a name: otherwise a reference may be valid."""
    items = getattr(file, table)
    return items is not None and all(
        item is not None and report.sound(source, (table, index), "name")
        for index, item in enumerate(items)
    )


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
    name: str,
    kind: str,
    known: Collection[str],
    key: Key,
    source: Source,
    report: Report,
    complete: bool = True,
) -> bool:
    """Whether a name is one of the known ones; reported where it is not, if those are all."""
    if name in known:
        return True
    if complete:
        report.add("unknown-name", source, key, nearest(name, known), kind=kind, name=repr(name))
    return False
