"""Rules for code, read from the syntax tree: how long, how many arguments, what only some may use.

`LIMITS` holds the numbers and `MANY_ARGUMENTS` every exception to them, with its reason.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.house.sources import (
    Definition,
    definitions,
    line_count,
    module_of,
    relative,
    sources,
    tree_of,
)

LIMITS = {"skin": 17_500, "file": 700, "function": 80, "arguments": 8}
"""Lines of the package `skin`, lines of a file and of a function, arguments of a function."""

PRIVATE_NUMBA = ("numba.core", "llvmlite")
"""What no version of numba promises."""
COMPILERS = {"njit", "jit", "register_jitable", "generated_jit", "vectorize", "guvectorize"}
"""Names of numba that are used through `bus.compiled`, which keeps the cache true."""
COMPILED = "bus/compiled/"

MANY_ARGUMENTS: dict[str, Callable[[Definition], bool]] = {
    "a public constructor: its arguments are settings, given by name": lambda d: (
        d.owner is not None
        and d.node.name in ("__init__", "__new__")
        and not d.owner.name.startswith("_")
    ),
    "skin.open, skin.sim.grasp, skin.io.publish.ros: all a user may set, given by name": lambda d: (
        (relative(d.file), d.name)
        in (
            ("skin/opening.py", "open"),
            ("skin/io/publish/__init__.py", "ros"),
            ("skin/sim/grasping/world.py", "grasp"),
        )
    ),
    "a command: its arguments are the options of the command line": lambda d: (
        relative(d.file).startswith("skin/cli/") and not d.name.startswith("_")
    ),
}
"""Functions that may take more arguments than the limit, by the reason why."""

CHANNEL_ROWS = {
    "(GEL, FREQUENCY, BX, BY, BZ, CHIP)",
    "(GEL, FREQUENCY, BX, BY, BZ, HALL_TEMPERATURE)",
}
"""Rows of counts: the order of `topology.CHANNELS`, which the wire fixes."""

COLUMNS = re.compile(r"[A-Z][A-Z0-9_]*$")


def may_take_many(definition: Definition) -> bool:
    """Whether a function is exempt from the limit of arguments."""
    return any(exempt(definition) for exempt in MANY_ARGUMENTS.values())


def size_errors() -> Iterator[str]:
    """Files and functions that are too long, functions with too many arguments."""
    for file in sources():
        if (lines := line_count(file)) > LIMITS["file"]:
            yield f"{relative(file)}: must have {LIMITS['file']} lines at most; got {lines}"
        for one in definitions(file):
            if one.lines > LIMITS["function"]:
                yield f"{one}: must have {LIMITS['function']} lines at most; got {one.lines}"
            most = LIMITS["arguments"]
            if one.arguments > most and not may_take_many(one):
                yield f"{one}: must take {most} arguments at most; got {one.arguments}"


def numba_errors(files: list[Path] | None = None) -> Iterator[str]:
    """Numba's own compilers and private parts outside `bus/compiled`, and flags that no kernel
    may have."""
    for file in sources() if files is None else files:
        for node in ast.walk(tree_of(file)):
            where = f"{relative(file)}:{getattr(node, 'lineno', 1)}"
            if isinstance(node, ast.Call):
                for flag in node.keywords:
                    is_true = isinstance(flag.value, ast.Constant) and flag.value.value is True
                    if flag.arg in ("fastmath", "parallel") and is_true:
                        yield f"{where}: {flag.arg}=True: must not be given to any kernel"
            if relative(file).startswith(COMPILED):
                continue
            for name in _numba_names(node):
                yield f"{where}: {name}: must be used in {COMPILED} only"


def _numba_names(node: ast.AST) -> Iterator[str]:
    """Private modules of numba and its compilers, where a node imports or names them."""
    if isinstance(node, ast.Import):
        yield from (a.name for a in node.names if a.name.startswith(PRIVATE_NUMBA))
    elif isinstance(node, ast.ImportFrom) and node.module:
        if node.module.startswith(PRIVATE_NUMBA):
            yield node.module
        elif node.module.split(".")[0] == "numba":
            yield from (
                f"numba.{a.name}" for a in node.names if a.name in COMPILERS or a.name == "core"
            )
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        if node.value.id == "numba" and (node.attr in COMPILERS or node.attr == "core"):
            yield f"numba.{node.attr}"


def column_errors(files: list[Path] | None = None) -> Iterator[str]:
    """Upper-case numbers that index an array: columns without a name.

    ``A, B, C = range(n)`` numbers columns; ``work[B, j]`` then reads one. An array of its own, or a
    field of a record, says what it is. The rows of counts, `CHANNEL_ROWS`, are no such columns.
    """
    files = sources("bus", "skin") if files is None else files
    numbers = {file: {n for one in tree_of(file).body for n in _numbered(one)} for file in files}
    by_module = {module_of(file): names for file, names in numbers.items()}
    for file in files:
        numbered = numbers[file] | {
            alias.asname or alias.name
            for node in ast.walk(tree_of(file))
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
            if alias.name in by_module.get(node.module or "", ())
        }
        used = {key.id for node in ast.walk(tree_of(file)) for key in _keys(node)} & numbered
        if used:
            yield (
                f"{relative(file)}: {', '.join(sorted(used))}: must be arrays of their own, or "
                "fields of a record; got numbers of columns"
            )


def _keys(node: ast.AST) -> list[ast.Name]:
    """Plain names that stand in the brackets of a subscript."""
    if not isinstance(node, ast.Subscript):
        return []
    keys = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    return [key for key in keys if isinstance(key, ast.Name)]


def _numbered(statement: ast.stmt) -> Iterator[str]:
    """Names that ``A, B, … = range(n)`` gives the numbers of columns."""
    if not isinstance(statement, ast.Assign):
        return
    target, value = statement.targets[0], statement.value
    is_range = (
        isinstance(value, ast.Call)
        and isinstance(value.func, ast.Name)
        and value.func.id == "range"
    )
    if is_range and isinstance(target, ast.Tuple) and ast.unparse(target) not in CHANNEL_ROWS:
        for name in ast.walk(target):
            if isinstance(name, ast.Name) and COLUMNS.match(name.id):
                yield name.id
