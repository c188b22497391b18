"""Who may import whom: between the packages, and between the rooms of `skin`.

A room is a folder of `skin`, or a file that lies in it next to the folders. Every import counts,
those within functions too; an import for the type checker only (under ``if TYPE_CHECKING``) does
not.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.house.sources import PACKAGES, ROOT, module_of, relative, sources, tree_of

__all__ = ["FORBIDDEN", "LAYERS", "Import", "import_errors", "imports_of"]

FORBIDDEN = {"topology": {"bus", "skin"}, "bus": {"skin"}, "skin": set()}
"""What a package must not import of the others."""

LAYERS = (
    {"errors", "cividis"},
    {"physics", "arrow", "worker", "notebook", "compiling", "clock"},
    {"patch"},
    {"state"},
    {"options"},
    {"sinks"},
    {"decode", "contact", "sim"},
    {"calibrate", "robot", "behaviours"},
    {"pipeline"},
    {"blocks", "live"},
    {"offline"},
    {"io"},
    {"opening"},
    {"view", "sim/grasping"},
    {"__init__"},
    {"cli"},
    {"__main__"},
)
"""Rooms of `skin`, from below: each may import of the layers below its own, and of itself."""
LAYER = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}


class Import(NamedTuple):
    """A module that a file imports."""

    file: Path
    line: int
    module: str
    """Dotted; of ``from a import b`` it is ``a.b`` where that is a module, else ``a``."""


@functools.cache
def imports_of(file: Path) -> tuple[Import, ...]:
    """All imports of a file that run, at any depth of it."""
    found = []
    waiting: list[ast.AST] = [tree_of(file)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found += [Import(file, node.lineno, module) for module in _modules(node)]
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            waiting += node.orelse
        else:
            waiting += ast.iter_child_nodes(node)
    return tuple(found)


def _modules(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    base = node.module or ""
    for alias in node.names:
        place = ROOT.joinpath(*base.split("."), alias.name)
        is_module = place.with_suffix(".py").exists() or place.is_dir()
        yield f"{base}.{alias.name}" if is_module else base


def _room_of(module: str) -> str:
    """The room of a module of `skin`: ``skin.decode.laws`` is in ``decode``."""
    parts = module.split(".")
    within = "/".join(parts[1:3])
    return within if within in LAYER else parts[1] if len(parts) > 1 else "__init__"


def import_errors() -> Iterator[str]:
    """Imports that go the wrong way, and rooms without a layer."""
    for package in PACKAGES:
        for file in sources(package):
            room = _room_of(module_of(file))
            if package == "skin" and room not in LAYER:
                yield f"{relative(file)}: {room}: must stand in LAYERS of tests/house/imports.py"
                continue
            for found in imports_of(file):
                top, other = found.module.split(".")[0], _room_of(found.module)
                is_above = package == top == "skin" and other != room and (
                    LAYER.get(other, len(LAYERS)) >= LAYER[room]
                )  # fmt: skip
                if top in FORBIDDEN[package] or is_above:
                    yield (
                        f"{relative(file)}:{found.line}: {found.module}: "
                        f"must not be imported from {room if is_above else package}"
                    )
