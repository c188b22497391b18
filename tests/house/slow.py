"""Which tests are slow? ``python -m tests.house.slow REPORT`` writes `slow.txt` anew.

REPORT is what pytest writes with ``--junitxml``. Of a slow test with several cases all but the
first are marked `long`, and so is a slow test with one case (`tests/conftest.py`): `make test-long`
runs them. What a newcomer does, broken input and the cache of kernels stay in `make test`, however
long they take.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from collections import defaultdict
from pathlib import Path

__all__ = ["FILE", "main", "slow"]

FILE = Path(__file__).with_name("slow.txt")
CASES_S, ALONE_S = 1.0, 1.5
"""Seconds of all cases of a test, and of a test with one case, above which it is slow."""
KEPT = (
    "tests/attack/", "tests/bus/compiled/", "tests/examples/", "tests/house/",
    "tests/skin/cli/test_demo", "tests/skin/test_readme", "tests/test_", "tests/vcan/",
)  # fmt: skip


def slow(report: str) -> list[str]:
    """Names of the slow tests, sorted."""
    seconds: dict[str, list[float]] = defaultdict(list)
    for case in ET.parse(report).iter("testcase"):
        file = case.attrib["classname"].replace(".", "/") + ".py"
        test = case.attrib["name"].partition("[")[0]
        seconds[f"{file}::{test}"].append(float(case.attrib["time"]))
    return sorted(
        test for test, each in seconds.items()
        if not test.startswith(KEPT) and sum(each) > (CASES_S if len(each) > 1 else ALONE_S)
    )  # fmt: skip


def main(arguments: list[str]) -> int:
    """Write the list."""
    found = slow(arguments[0])
    FILE.write_text("\n".join(found) + "\n")
    print(f"{len(found)} slow tests")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
