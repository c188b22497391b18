"""Bodies on units, of which some cycles are held to what they were: `tests/golden/values/slip.csv`.

Set UPDATE_GOLDEN to write the values of the tests that run, in one process, where a change of
values is meant. The column names are those of `bench`.
"""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from tests.skin.contact.slip.bench import Bench

GOLDEN = Path(__file__).parents[3] / "golden" / "values" / "slip.csv"


@pytest.fixture
def bench_of(request):
    """Make a `Bench`; what it wrote down is compared when the test has ended."""
    made = []

    def make(skin, rng, **settings):
        made.append(Bench(skin, rng, **settings))
        return made[-1]

    yield make
    held_to(request.node.name, [row for bench in made for row in bench.rows])


def held_to(test, found):
    """Compare rows with those of a test in the file."""
    rows = list(csv.reader(GOLDEN.read_text().splitlines()))
    if "UPDATE_GOLDEN" in os.environ:
        rows = [row for row in rows if row[0] != test]
        rows += [[test, *(f"{value:.8g}" for value in row)] for row in found]
        GOLDEN.write_text("".join(f"{','.join(row)}\n" for row in sorted(rows)))
        return
    expected = np.array([row[1:] for row in rows if row[0] == test], float)
    assert len(expected), f"{GOLDEN.name} has no values of {test}"
    found = np.array(sorted(found, key=lambda row: [f"{value:.8g}" for value in row]))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)
