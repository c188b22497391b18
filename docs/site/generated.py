"""Parts of pages that the build makes: where a page has ``<!-- made: NAME -->``, the text of
`PARTS[NAME]` stands in the site. Links to files outside of the site become their names."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from docutils import nodes

import gallery

ROOT = Path(__file__).parents[2]
LETTERS = ("n", "k", "t", "c", "m", "path", "file", "int", "float", "bool", "str")
BARS = re.compile(r"\|([\w, ]+)\|")
MARK = re.compile(r"<!-- made: (\w+) -->")
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s:]+)(#[^)\s]*)?\)")


def setup(app: Any) -> dict[str, Any]:
    """What Sphinx calls."""
    app.add_config_value("run_examples", True, "env")
    app.connect("source-read", _fill)
    app.connect("doctree-resolved", _without_letters)
    app.connect("autodoc-process-docstring", _with_bars, priority=100)
    return {"parallel_read_safe": False}


def _fill(app: Any, name: str, source: list[str]) -> None:
    """Put the generated parts into the source of a page."""
    folder = (ROOT / "docs" / name).parent

    def part(found: re.Match[str]) -> str:
        return PARTS[found[1]](app)

    def link(found: re.Match[str]) -> str:
        file = Path(os.path.normpath(folder / found[2]))
        is_ours = file.is_relative_to(ROOT / "docs") or not file.exists()
        if is_ours:
            return found[0]
        name = str(file.relative_to(ROOT))
        return found[1] if name in found[1] else f"{found[1]} (`{name}`)"

    source[0] = LINK.sub(link, MARK.sub(part, source[0]))


def _with_bars(app: object, what: str, name: str, thing: object, options: object,
               lines: list[str]) -> None:  # fmt: skip
    """Let |x| be the size of x, not a substitution."""
    lines[:] = [BARS.sub(r"\\|\1\\|", line) for line in lines]


def _without_letters(app: object, doctree: nodes.document, page: str) -> None:
    """Undo links of the letters of shapes, such as n: Sphinx takes them for names of types."""
    for link in list(doctree.findall(nodes.reference)):
        if link.astext() in LETTERS:
            link.replace_self(link.children)


# -- files at the root of the repository


def _file_at_root(name: str) -> str:
    """Its text, with links as from a page of docs/explanation."""

    def link(found: re.Match[str]) -> str:
        if not (ROOT / found[2]).exists():
            return found[0]
        place = os.path.relpath(ROOT / found[2], ROOT / "docs" / "explanation")
        return f"[{found[1]}]({place}{found[3] or ''})"

    return LINK.sub(link, (ROOT / name).read_text("utf-8"))


PARTS: dict[str, Callable[[Any], str]] = {
    "gallery": gallery.page,
    "contributing": lambda app: _file_at_root("CONTRIBUTING.md"),
    "changelog": lambda app: _file_at_root("CHANGELOG.md"),
}
