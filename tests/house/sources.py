"""The three packages as source text and syntax trees: what every check of the house reads."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PACKAGES = ("topology", "bus", "skin")

Function = ast.FunctionDef | ast.AsyncFunctionDef


class Definition(NamedTuple):
    """A function where it stands: its name with those of the classes and functions around it."""

    file: Path
    name: str
    node: Function
    owner: ast.ClassDef | None

    @property
    def first_line(self) -> int:
        """The line of the first decorator, or of ``def``: as Python's code objects tell it."""
        return min([self.node.lineno, *(mark.lineno for mark in self.node.decorator_list)])

    @property
    def lines(self) -> int:
        """From the line of its ``def``, decorators apart, to its end."""
        return (self.node.end_lineno or self.node.lineno) - self.node.lineno + 1

    @property
    def arguments(self) -> int:
        """How many a caller may give, those of ``*`` and ``**`` once each; self not counted."""
        given = self.node.args
        count = len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)
        count += (given.vararg is not None) + (given.kwarg is not None)
        marks = {mark.id for mark in self.node.decorator_list if isinstance(mark, ast.Name)}
        return count - (self.owner is not None and "staticmethod" not in marks)

    def __str__(self) -> str:
        return f"{relative(self.file)}:{self.node.lineno}: {self.name}"


def sources(*packages: str) -> list[Path]:
    """Python files of packages, of all three if none is named."""
    return sorted(file for name in packages or PACKAGES for file in (ROOT / name).rglob("*.py"))


def relative(file: Path) -> str:
    """A file's place in the repository, as messages name it."""
    return file.relative_to(ROOT).as_posix() if file.is_relative_to(ROOT) else file.name


def module_of(file: Path) -> str:
    """A file's dotted name."""
    place = file.relative_to(ROOT) if file.is_relative_to(ROOT) else Path(file.name)
    return ".".join(place.with_suffix("").parts).removesuffix(".__init__")


@functools.cache
def text_of(file: Path) -> str:
    """A file's text."""
    return file.read_text(encoding="utf-8")


@functools.cache
def tree_of(file: Path) -> ast.Module:
    """A file's syntax tree."""
    return ast.parse(text_of(file), str(file))


def line_count(file: Path) -> int:
    """Lines of a file, as ``wc -l`` counts them."""
    return text_of(file).count("\n")


def definitions(file: Path) -> Iterator[Definition]:
    """Every function of a file, those within classes and functions included."""

    def within(node: ast.AST, path: tuple[str, ...], owner: ast.ClassDef | None):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, Function):
                yield Definition(file, ".".join((*path, child.name)), child, owner)
                yield from within(child, (*path, child.name), None)
            elif isinstance(child, ast.ClassDef):
                yield from within(child, (*path, child.name), child)
            else:
                yield from within(child, path, owner)

    yield from within(tree_of(file), (), None)
