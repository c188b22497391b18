"""The three packages as files, text and syntax trees."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

__all__ = ["PACKAGES", "ROOT", "module_of", "relative", "sources", "text_of", "tree_of"]

ROOT = Path(__file__).parents[2]
PACKAGES = ("topology", "bus", "skin")


def sources(*packages: str) -> list[Path]:
    """Python files of packages, of all three if none is named."""
    return sorted(file for name in packages or PACKAGES for file in (ROOT / name).rglob("*.py"))


def relative(file: Path) -> str:
    """A file's place in the repository, as messages name it."""
    return file.relative_to(ROOT).as_posix()


def module_of(file: Path) -> str:
    """A file's dotted name."""
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def text_of(file: Path) -> str:
    """A file's text."""
    return file.read_text(encoding="utf-8")


@functools.cache
def tree_of(file: Path) -> ast.Module:
    """A file's syntax tree."""
    return ast.parse(text_of(file), str(file))
