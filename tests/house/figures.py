"""The figures of the house: each number beside its limit."""

from __future__ import annotations

import ast
from typing import NamedTuple

from tests.house.rules import LIMITS, may_take_many
from tests.house.sources import (
    PACKAGES,
    ROOT,
    definitions,
    line_count,
    relative,
    sources,
    tree_of,
)


class Figure(NamedTuple):
    """A number of the house.

    Attributes
    ----------
    name : str
    value : int or None
        None: not looked at.
    limit : int or None
        Most that is allowed.
    where : str
        What has this value.
    is_goal : bool
        Whether the limit is where the house is to go, and being over it fails no check yet.
    """

    name: str
    value: int | None
    limit: int | None = None
    where: str = ""
    is_goal: bool = False

    @property
    def over(self) -> bool:
        """Whether it is more than allowed."""
        return None not in (self.value, self.limit) and self.value > self.limit


def size_figures() -> list[Figure]:
    """Lines, longest file and function, most arguments, thresholds of slip."""
    figures = [
        Figure(
            f"lines of {name}", sum(map(line_count, sources(name))), LIMITS.get(name), is_goal=True
        )
        for name in PACKAGES
    ]
    file = max(sources(), key=line_count)
    figures.append(Figure("longest file", line_count(file), LIMITS["file"], relative(file)))
    every = [one for file in sources() for one in definitions(file)]
    long = max(every, key=lambda one: one.lines)
    figures.append(Figure("longest function", long.lines, LIMITS["function"], str(long)))
    wide = max((one for one in every if not may_take_many(one)), key=lambda one: one.arguments)
    figures.append(Figure("most arguments", wide.arguments, LIMITS["arguments"], str(wide)))
    figures.append(Figure("thresholds of slip", *slip_thresholds()))
    return figures


def slip_thresholds() -> tuple[int | None, None, str]:
    """Numbers that the slip detector stands on: fields of the classes ``…Parameters`` of its room.

    Returns
    -------
    count : int or None
        None where there is no such class.
    limit : None
    where : str
        File and classes.
    """
    count, where = 0, []
    for file in sorted((ROOT / "skin" / "contact").rglob("slip*/parameters.py")):
        for node in tree_of(file).body:
            if isinstance(node, ast.ClassDef) and node.name.endswith("Parameters"):
                fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
                count += len(fields)
                where.append(f"{relative(file)}: {node.name}")
    return (count, None, ", ".join(where)) if where else (None, None, "no parameters.py yet")


def table(figures: list[Figure]) -> str:
    """For people: one figure a line."""
    rows = [("figure", "value", "limit", "")]
    for one in figures:
        value = "–" if one.value is None else f"{one.value:_}".replace("_", " ")
        limit = "" if one.limit is None else f"{one.limit:_}".replace("_", " ")
        rows.append((one.name, value, limit, ("OVER  " if one.over else "") + one.where))
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    return "\n".join(
        f"{name:<{widths[0]}}  {value:>{widths[1]}}  {limit:>{widths[2]}}  {note}".rstrip()
        for name, value, limit, note in rows
    )
