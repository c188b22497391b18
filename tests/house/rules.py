"""Rules for code that ruff and basedpyright have not: sizes, unused code, plain words."""

from __future__ import annotations

import ast
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from tests.house.sources import PACKAGES, ROOT, relative, sources, text_of, tree_of

__all__ = ["prose_errors", "size_errors", "unused_errors"]

FILE_LINES, FUNCTION_LINES = 700, 80

USED_ELSEWHERE = {
    "close_films": "public: a user asks which units feel films of other links",
    "noise_ratio": "public: a user asks how noisy the units of a contact are",
    "impact": "public: a user asks whether a contact was hit",
    "trouble": "public: a user asks which units are not valid",
    "clocks": "public: a user asks what stamps the frames, and how well",
    "realtime_ns": "public: docs/guides/connect.md, a stamp next to that of a camera",
    "_repr_html_": "notebooks call it",
    "request_share_url": "skin/view/server.py: viser's panel calls it",
    "verbose": "skin/view/server.py: an argument of viser's method",
    "move_patch": "public: README, the pose of a patch in a moving hand",
    "everything": "public: NonIdeal of all kinds; benchmarks and tests",
    "plate": "skin/sim/mechanics/body.py: the kind of a shape in a scene file names it",
    "felt_n": "public: a gripper of the user takes the measured load",
    "give": "public: a user hands an object over",
    "weigh": "public: a user fills what is held (examples/fig6_tea.py)",
    "local_wrench": "public: a user asks for the wrench on a finger in its own frame",
    "local_wrench_sigma": "public: the same",
}
"""Names that nothing in the packages uses, and who does."""

PROSE = re.compile(r"\b(told|tells?|telling|untold|beside|whatever|anew)\b", re.IGNORECASE)
"""Words of prose in place of which a plain one is written: report, state, next to, in addition to,
any, again."""
CODE = re.compile(r"`+[^`]*`+")


def size_errors() -> Iterator[str]:
    """Files and functions that are too long."""
    for file in sources():
        if (lines := text_of(file).count("\n")) > FILE_LINES:
            yield f"{relative(file)}: must have {FILE_LINES} lines at most; got {lines}"
        for node in ast.walk(tree_of(file)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = node.end_lineno - node.lineno + 1
                if lines > FUNCTION_LINES:
                    where = f"{relative(file)}:{node.lineno}: {node.name}"
                    yield f"{where}: must have {FUNCTION_LINES} lines at most; got {lines}"


def unused_errors() -> Iterator[str]:
    """What nothing uses, as vulture finds it, and names of `USED_ELSEWHERE` that are used or gone.

    Fields of records and names of enums are left out: a table of parameters is read as a whole.
    """
    from vulture import Vulture

    finder = Vulture(ignore_decorators=["@overload*", "@type_callable*", "@lower_builtin*"])
    finder.scavenge([str(ROOT / name) for name in PACKAGES])
    seen = set()
    for item in finder.get_unused_code(min_confidence=60):
        is_code = item.typ in {"class", "function", "method", "property"}
        is_constant = item.typ == "variable" and item.name in _constants(Path(item.filename))
        counts = is_code or is_constant or item.confidence >= 80 or item.name.startswith("_")
        if not counts or item.name in ("__getattr__", "__dir__", "__doc__"):
            continue
        seen.add(item.name)
        if item.name not in USED_ELSEWHERE:
            where = f"{relative(Path(item.filename))}:{item.first_lineno}: {item.name}"
            yield f"{where}: must be used; got a {item.typ} that nothing uses"
    for name in sorted(USED_ELSEWHERE.keys() - seen):
        yield f"USED_ELSEWHERE: {name}: must be unused; got a name that is used or gone"


def _constants(file: Path) -> set[str]:
    """Names that a module assigns, classes apart."""
    return {
        name.id
        for statement in tree_of(file).body
        if isinstance(statement, ast.Assign | ast.AnnAssign)
        for name in ast.walk(statement)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
    }


def prose_errors() -> Iterator[str]:
    """Words of `PROSE` in docstrings, comments and messages; names in backticks are none."""
    for file in sources():
        with file.open("rb") as text:
            for token in tokenize.tokenize(text.readline):
                if tokenize.tok_name[token.type] in {"COMMENT", "STRING", "FSTRING_MIDDLE"}:
                    prose = CODE.sub("", token.string)
                    if " " in prose.strip() and (found := PROSE.search(prose)):
                        where = f"{relative(file)}:{token.start[0]}"
                        yield f"{where}: must be plain words; got {found[0]!r}"
