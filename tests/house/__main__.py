"""``make check``: everything that is held without running the software, and the figures of the
house.

``python -m tests.house``          all checks; exit status 1 if one fails or a figure is over
``python -m tests.house --json``   with one JSON object as the last line
``python -m tests.house --quick``  without the type checker and the doctests
``python -m tests.house draw``     docs/pictures/imports.svg, the picture of who imports whom
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable

from tests.house import draw, imports, rules, unused, words
from tests.house.figures import Figure, size_figures, table
from tests.house.sources import relative
from tests.house.tools import Doctests, Ruff, Types


def main(arguments: list[str] | None = None) -> int:
    """Run the checks; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.house",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", nargs="?", choices=("check", "draw"), default="check")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    parser.add_argument("--quick", action="store_true", help="without types and doctests")
    given = parser.parse_args(arguments)
    if given.command == "draw":
        draw.PICTURE.write_text(draw.picture(), encoding="utf-8")
        print(relative(draw.PICTURE))
        return 0
    return check(quick=given.quick, as_json=given.json)


def check(*, quick: bool = False, as_json: bool = False) -> int:
    """Run all checks in order and print what they find, then the figures."""
    ruff = Ruff()
    types, doctests = (None, None) if quick else (Types(), Doctests())
    counts: dict[str, int] = {}

    def say(name: str, errors: Iterable[str], note: str = "") -> None:
        errors = list(errors)
        counts[name] = len(errors)
        print(f"{name}: {f'{len(errors)} to mend' if errors else 'fine'}{note}", flush=True)
        for error in errors:
            print("  " + error.replace("\n", "\n  "))

    figures = size_figures()
    say("ruff", ruff.outcome().errors)
    if types is not None:
        outcome = types.outcome()
        say("types", outcome.errors)
        figures.append(Figure("type errors", outcome.count, 0))
    if doctests is not None:
        outcome = doctests.outcome()
        say("doctests", outcome.errors, f" ({outcome.count} run)")
        figures.append(Figure("doctests run", outcome.count))
    say("imports", [*imports.package_errors(), *imports.room_errors()])
    say("sizes", rules.size_errors())
    say("kernels", [*rules.numba_errors(), *rules.column_errors()])
    say("unused", unused.unused_errors())
    say("words", [*words.word_errors(), *words.prose_errors()])
    print()
    print(table(figures))
    failed = any(counts.values()) or any(one.over and not one.is_goal for one in figures)
    if as_json:
        report = {"figures": {one.name: one._asdict() for one in figures}, "to_mend": counts}
        print(json.dumps(report | {"fine": not failed}))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
