"""``make check``: what is held without running the software.

``python -m tests.house``          all checks; exit status 1 if one fails
``python -m tests.house --quick``  without the type checker and the doctests
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from tests.house import imports, rules
from tests.house.sources import PACKAGES, ROOT

RUFF = ("ruff", "check", "--quiet")
FORMAT = ("ruff", "format", "--check", "--quiet")
TYPES = ("basedpyright", "--level", "error", "--pythonpath", sys.executable)
DOCTESTS = (
    "pytest", "--doctest-modules", "--doctest-ignore-import-errors", "-q", "-p", "no:cacheprovider",
    "-p", "tests.conftest", "--durations=0", "--durations-min=60", *PACKAGES,
)  # fmt: skip
RULES = {
    "imports": imports.import_errors,
    "sizes": rules.size_errors,
    "unused": rules.unused_errors,
    "words": rules.prose_errors,
}


def main() -> int:
    """Run the checks; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.house", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="without types and doctests")
    quick = parser.parse_args().quick
    failed = 0
    for program in (RUFF, FORMAT) if quick else (RUFF, FORMAT, TYPES, DOCTESTS):
        print(f"{' '.join(program[:2])} …", flush=True)
        failed |= subprocess.call([sys.executable, "-m", *program], cwd=ROOT) != 0
    for name, check in RULES.items():
        errors = list(check())
        print(f"{name}: {f'{len(errors)} to mend' if errors else 'fine'}")
        for error in errors:
            print(f"  {error}")
        failed |= bool(errors)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
