"""The paper's Fig. 3, regenerated from simulated units, agrees with the paper's figures."""

from __future__ import annotations

import pytest

from benchmarks import fig3


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    before = fig3.PICTURE
    fig3.PICTURE = tmp_path_factory.mktemp("fig3") / "fig3.png"
    try:
        yield fig3.run(quick=True)
    finally:
        fig3.PICTURE = before


@pytest.mark.parametrize(
    ("panel", "within"),
    [
        ("3a current", 1e-6),
        ("3d", 1e-3),
        ("3e first", 1e-6),
        ("3e second", 1e-6),
        ("3e normal", 1e-6),
        ("3i field at 1 N", 0.005),
        ("3i field added", 0.03),
    ],
)
def test_figure_is_the_papers(result, panel, within):
    ((paper, ours),) = [pair for name, pair in result["figures"].items() if name.startswith(panel)]
    assert ours == pytest.approx(paper, rel=within)


def test_what_has_a_bound_keeps_it(result):
    figures = result["figures"]
    raw, bound = figures["3a error of a polynomial in the raw current, °C, at most"][::-1]
    assert 0.01 < raw <= bound
    assert figures["3j-k direction error over all loads, degree, at most"][1] < 0.1


def test_picture_and_table_are_made(result):
    assert fig3.PICTURE.read_bytes().startswith(b"\x89PNG")
    text = fig3.table(result)
    assert all(name in text for name in result["figures"])
