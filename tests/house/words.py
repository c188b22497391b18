"""Private paraphrases that must not come back as names in `skin`; words:
docs/reference/glossary.md."""

from __future__ import annotations

import ast
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from tests.house.sources import relative, sources, tree_of

PARAPHRASES = {
    "add_up": "pattern_test, or sum",
    "ahead": "prefetch, or along",
    "apart": "distance, or assume_noalias",
    "furnish": "allocate",
    "gives": "gain",
    "lacks": "residual, or what it lags behind",
    "looking_back": "ring buffer",
    "matter": "ground_truth, or fault",
    "reach": "displacement, radius or depth",
    "sure": "information",
    "takes": "nuisance",
    "theta_table": "theta_correction",
    "turning": "theta_correction",
    "with_turning": "theta_correction",
}
"""A name that is nothing but one of these, underscores apart, and what to write in its place.
A longer name that says the unit or the thing (`reach_m`, a public parameter) is not meant."""

PROSE = re.compile(r"\b(told|tells?|telling|untold|beside|whatever|anew)\b", re.IGNORECASE)
"""Words of prose in place of which a plain one is written: report, state, next to, in addition to,
any, again."""
CODE = re.compile(r"`+[^`]*`+")


def word_errors(files: list[Path] | None = None) -> Iterator[str]:
    """Functions, classes, arguments, fields and variables with a private paraphrase as a name."""
    for file in sources("skin") if files is None else files:
        told: set[str] = set()
        for line, name in _names(tree_of(file)):
            word = PARAPHRASES.get(name.strip("_").lower())
            if word is not None and name not in told:
                told.add(name)
                yield f"{relative(file)}:{line}: {name}: must be named in the field's words: {word}"


def prose_errors(files: list[Path] | None = None) -> Iterator[str]:
    """Words of `PROSE` in docstrings, comments and messages; names in backticks are none."""
    for file in sources() if files is None else files:
        with file.open("rb") as text:
            for token in tokenize.tokenize(text.readline):
                name = tokenize.tok_name[token.type]
                if name not in {"COMMENT", "STRING", "FSTRING_MIDDLE"}:
                    continue
                prose = CODE.sub("", token.string)
                if " " in prose.strip() and (found := PROSE.search(prose)):
                    place = f"{relative(file)}:{token.start[0]}"
                    yield f"{place}: must be plain words; got {found[0]!r}"


def _names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Names that a file gives, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.lineno, alias.asname) for alias in node.names if alias.asname)
