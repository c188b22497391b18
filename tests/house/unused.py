"""Code that nothing uses, as vulture finds it.

Fields of records and names of enums are told apart from the rest: a table of parameters is read as
a whole. What is left must be used within the packages, promised in an ``__all__``, or stand in
`unused.txt` with who uses it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.house.sources import PACKAGES, ROOT, relative, tree_of

SURE = 80
"""Confidence in percent from which every finding counts: arguments, imports, code out of reach."""
KINDS = {"class", "function", "method", "property"}
"""What counts from `LIKELY` on."""
LIKELY = 60
REGISTERS = ["@overload*", "@type_callable*", "@lower_builtin*"]
"""Decorators by which numba finds a function that nobody names."""
WHITELIST = Path(__file__).with_name("unused.txt")


def whitelist() -> dict[str, str]:
    """Names that are used from elsewhere, with the reason."""
    lines = WHITELIST.read_text(encoding="utf-8").splitlines()
    entries = (line.partition("#") for line in lines if line and not line.startswith("#"))
    return {name.strip(): reason.strip() for name, _, reason in entries}


def unused_errors() -> Iterator[str]:
    """What nothing uses, and names of the whitelist that are used or gone."""
    from vulture import Vulture

    finder = Vulture(ignore_decorators=REGISTERS)
    finder.scavenge([str(ROOT / name) for name in PACKAGES])
    excused, seen = whitelist(), set()
    for item in finder.get_unused_code(min_confidence=LIKELY):
        file = Path(item.filename)
        counts = (
            item.confidence >= SURE
            or item.typ in KINDS
            or item.name.startswith("_")
            or (item.typ == "variable" and item.name in _constants(file))
        )
        if not counts or item.name in ("__getattr__", "__dir__", "__doc__"):
            continue
        seen.add(item.name)
        if item.name not in excused:
            yield (
                f"{relative(file)}:{item.first_lineno}: {item.name}: must be used; "
                f"got a {item.typ} that nothing uses"
            )
    for name in sorted(excused.keys() - seen):
        yield f"{relative(WHITELIST)}: {name}: must be unused; got a name that is used or gone"


def _constants(file: Path) -> set[str]:
    """Names that a module assigns, classes apart."""
    return {
        name.id
        for statement in tree_of(file).body
        if isinstance(statement, ast.Assign | ast.AnnAssign)
        for name in ast.walk(statement)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
    }
