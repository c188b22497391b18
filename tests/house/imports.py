"""Who may import whom: between the packages, and between the rooms of `skin`.

A room is a folder of `skin`, or a file that lies in it beside the folders. Every import counts,
those within functions too; an import for the type checker only (under ``if TYPE_CHECKING``) is held
to the same rules, with the exceptions that `TYPE_ONLY` names.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.house.sources import PACKAGES, ROOT, module_of, relative, sources, tree_of

FORBIDDEN = {"topology": {"bus", "skin"}, "bus": {"skin"}, "skin": set()}
"""What a package must not import of the others."""

COMMON = frozenset({"cividis", "errors", "options", "state"})
"""Rooms that every other may import."""

ROOMS: dict[str, frozenset[str]] = {
    "errors": frozenset(),
    "arrow": frozenset({"errors"}),
    "sinks": COMMON | {"worker"},
    "worker": frozenset({"errors"}),
    "physics": frozenset({"errors"}),
    "cividis": frozenset(),
    "notebook": frozenset({"cividis"}),
    "state": frozenset({"errors", "notebook"}),
    "options": frozenset({"errors", "state"}),
    "decode": COMMON | {"physics"},
    "contact": COMMON | {"physics"},
    "calibrate": COMMON | {"physics", "decode", "worker", "arrow", "sinks"},
    "sim": COMMON | {"physics"},
    "compiling": frozenset({"errors"}),
    "clock": frozenset(),
    "robot": COMMON | {"physics", "contact"},
    "pipeline": COMMON
    | {"physics", "decode", "contact", "calibrate", "clock", "compiling", "sinks"},
    "live": COMMON
    | {"physics", "decode", "contact", "calibrate", "pipeline", "compiling", "sim", "robot"}
    | {"sinks"},
    "io": COMMON
    | {"physics", "contact", "pipeline", "compiling", "blocks", "offline", "live", "worker"}
    | {"arrow", "sinks"},
    "opening": COMMON
    | {"physics", "contact", "pipeline", "compiling", "sim", "live", "io"}
    | {"calibrate"},
    "blocks": COMMON | {"pipeline", "contact", "decode"},
    "offline": COMMON | {"pipeline", "compiling", "blocks", "sinks"},
    "view": COMMON | {"live", "pipeline", "calibrate", "contact", "worker", "sinks", "io", "robot"},
    "behaviours": COMMON | {"contact"},
    "sim/grasping": COMMON | {"physics", "contact", "sim", "live", "opening"},
}
"""What each room may import of `skin`, beside itself. `opening` starts simulated units when a skin
is opened with ``simulate=True``. `cli` and the package's own `__init__` may import everything."""

ANYTHING = frozenset({"cli", "__init__", "__main__"})
"""Rooms that may import every other, and that no other may import."""

ONLY_OF_BUS = {"physics": ("bus.compiled",)}
"""What a room may import of `bus`, where not all of it."""

TYPE_ONLY = {
    ("state", "contact"),  # a State holds contacts; who makes them imports State
    ("options", "contact"),  # Options may hold the parameters of slip
    ("options", "physics"),  # and a stencil
    ("calibrate", "pipeline"),  # what learns is a sink of a pipeline
    ("sinks", "pipeline"),  # that calls them
    ("live", "io"),  # a Skin names its recorder
    ("sim", "sim/grasping"),  # its world is found under `skin.sim`, and opens a skin
}
"""Edges allowed under ``if TYPE_CHECKING``, although the rooms' order is the other way."""


class Import(NamedTuple):
    """A module that a file imports."""

    file: Path
    line: int
    module: str
    """Dotted; of ``from a import b`` it is ``a.b`` where that is a module, else ``a``."""
    type_only: bool

    def __str__(self) -> str:
        return f"{relative(self.file)}:{self.line}: {self.module}"


@functools.cache
def imports_of(file: Path) -> tuple[Import, ...]:
    """All imports of a file, at any depth of it."""
    tree = tree_of(file)
    types: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            types.update(below for child in node.body for below in ast.walk(child))
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            found += [
                Import(file, node.lineno, module, node in types) for module in _modules(file, node)
            ]
    return tuple(found)


def _modules(file: Path, node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    base = node.module or ""
    if node.level:
        package = file.relative_to(ROOT).parent.parts
        above = package[: len(package) - node.level + 1]
        base = ".".join((*above, base)) if base else ".".join(above)
    for alias in node.names:
        place = ROOT.joinpath(*base.split("."), alias.name)
        is_module = place.with_suffix(".py").exists() or place.is_dir()
        yield f"{base}.{alias.name}" if is_module else base


def room_of(module: str) -> str:
    """The room of a module of `skin`: ``skin.decode.laws`` is in ``decode``; a folder in a room is
    one where the table has it."""
    parts = module.split(".")
    if "/".join(parts[1:3]) in ROOMS:
        return "/".join(parts[1:3])
    return parts[1] if len(parts) > 1 else "__init__"


def package_errors() -> list[str]:
    """Imports from one package to another that go the wrong way."""
    return [
        f"{found}: must not be imported from {name}"
        for name in PACKAGES
        for file in sources(name)
        for found in imports_of(file)
        if found.module.split(".")[0] in FORBIDDEN[name]
    ]


def room_errors(files: list[Path] | None = None) -> list[str]:
    """Imports between rooms of `skin` that the table does not allow."""
    wrong = []
    for file in sources("skin") if files is None else files:
        room = room_of(module_of(file))
        if room not in ROOMS and room not in ANYTHING:
            wrong.append(f"{relative(file)}: {room}: must stand in ROOMS of tests/house/imports.py")
            continue
        wrong += [
            f"{found}: must not be imported from {room}"
            for found in imports_of(file)
            if not _allowed(room, found)
        ]
    return wrong


def _allowed(room: str, found: Import) -> bool:
    package = found.module.split(".")[0]
    if package == "bus" and room in ONLY_OF_BUS:
        return found.module.startswith(ONLY_OF_BUS[room])
    if package != "skin" or room in ANYTHING:
        return True
    other = room_of(found.module)
    if other == room or other in ROOMS[room]:
        return True
    return found.type_only and (room, other) in TYPE_ONLY


def edges(package: str = "skin") -> set[tuple[str, str]]:
    """Which room of a package imports which other, and which other packages; types apart."""
    found = set()
    for file in sources(package):
        room = room_of(module_of(file))
        for one in imports_of(file):
            top = one.module.split(".")[0]
            if one.type_only or top not in PACKAGES:
                continue
            other = room_of(one.module) if top == package else top
            if other != room:
                found.add((room, other))
    return found
