"""The benchmark of unpacking: what it compares is equal, and its figures are whole."""

import json

import pytest

from benchmarks import unpack


@pytest.fixture(scope="module")
def figures():
    return unpack.run(quick=True)


def test_every_way_has_a_rate_and_every_value_was_compared(figures):
    assert set(figures["layouts"]) == {"f3t-fd64", "f3t-classic"}
    ways = {"table", "table scaled", "assembler", "numpy", "cantools", "cantools raw"}
    for found in figures["layouts"].values():
        assert set(found["frames_per_s"]) == ways
        assert all(rate > 0 for rate in found["frames_per_s"].values())
        assert found["values_compared"] >= 1000
        assert found["largest_relative_error"] < 1e-14
    least = min(found["cantools_ratio"] for found in figures["layouts"].values())
    assert figures["cantools_ratio"] == least


def test_figures_are_json_and_a_table(figures):
    assert json.loads(json.dumps(figures)) == figures
    rows = unpack.table(figures).splitlines()
    assert len(rows) == 1 + 2 * 7
    assert all(row.startswith(("layout", "f3t-", " ")) for row in rows)


def test_values_that_differ_are_not_passed_over(monkeypatch):
    real = unpack._compare

    def shifted(topology, database, physical, *rest):
        return real(topology, database, physical + topology.scale, *rest)

    monkeypatch.setattr(unpack, "_compare", shifted)
    with pytest.raises(AssertionError, match=r"must be .*; got"):
        unpack.run(quick=True)
