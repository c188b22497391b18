"""The rules for code find what they are for, and nothing else."""

import pytest

from tests.house import rules, unused, words
from tests.house.figures import Figure, size_figures, table
from tests.house.sources import ROOT, definitions, sources


@pytest.fixture
def file_of(tmp_path):
    def write(text, name="kernel.py"):
        file = tmp_path / name
        file.write_text(text)
        return file

    return write


def definition(file_of, text):
    return next(definitions(file_of(text)))


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("def f(a, b, /, c, *, d): pass\n", 4),
        ("def f(*a, **b): pass\n", 2),
        ("class A:\n    def f(self, a): pass\n", 1),
        ("class A:\n    @classmethod\n    def f(cls, a): pass\n", 1),
        ("class A:\n    @staticmethod\n    def f(a): pass\n", 1),
    ],
)
def test_arguments_are_counted_without_self(file_of, text, count):
    assert definition(file_of, text).arguments == count


def test_lines_are_counted_from_def_to_end_with_what_lies_within(file_of):
    one = definition(
        file_of, "@cache\ndef outer():\n    def inner():\n        pass\n    return inner\n"
    )
    assert (one.name, one.lines) == ("outer", 4)


@pytest.mark.parametrize(
    "text",
    [
        "from numba import njit\n",
        "import numba\nf = numba.njit(g)\n",
        "from numba.core import cgutils\n",
        "import llvmlite.ir\n",
        "from numba.extending import register_jitable\n",
        "f = compiled(g, fastmath=True)\n",
        "f = compiled(g, parallel=True)\n",
    ],
)
def test_what_only_the_room_of_compilation_may_use_is_found(file_of, text):
    assert len(list(rules.numba_errors([file_of(text)]))) == 1


@pytest.mark.parametrize(
    "text", ["f = compiled(g, fastmath={'contract'})\n", "from numba import prange\n"]
)
def test_what_every_kernel_may_use_is_not(file_of, text):
    assert list(rules.numba_errors([file_of(text)])) == []


def test_columns_with_numbers_for_names_are_found(file_of):
    text = "X, Y = range(2)\ndef f(work, j):\n    return work[Y, j]\n"
    (error,) = rules.column_errors([file_of(text)])
    assert "kernel.py: Y: must be" in error


@pytest.mark.parametrize(
    "text",
    [
        "X, Y = range(2)\ndef f(kind):\n    return kind == Y\n",
        "GEL, FREQUENCY, BX, BY, BZ, CHIP = range(6)\ndef f(counts):\n    return counts[BY]\n",
        "def f(work, j):\n    return work['y'][j]\n",
    ],
)
def test_arrays_with_names_and_the_channels_of_the_wire_are_not(file_of, text):
    assert list(rules.column_errors([file_of(text)])) == []


def test_private_paraphrases_are_found_wherever_a_name_is_given(file_of):
    text = "def _furnish(reach):\n    apart = 1\n    self.ahead = apart\n    reach_m = 2\n"
    found = [line.split(": ")[1] for line in words.word_errors([file_of(text)])]
    assert sorted(found) == ["_furnish", "ahead", "apart", "reach"]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('"""What is told."""\n', 1),
        ("x = 1  # beside the point\n", 1),
        ('y = 2\nraise ValueError(f"{y}: tells nothing")\n', 2),
        ('"""One line.\n\nTaken anew.\n"""\n', 1),
    ],
)
def test_private_words_are_found_in_prose(file_of, text, line):
    (found,) = words.prose_errors([file_of(text)])
    assert found.startswith(f"kernel.py:{line}: must be plain words; got ")


@pytest.mark.parametrize(
    "text", ['"""See ``told`` of a file."""\n', 'found["told"] = 1\n', "file.tell()\n"]
)
def test_names_in_code_are_no_prose(file_of, text):
    assert list(words.prose_errors([file_of(text)])) == []


def test_an_exception_to_the_limit_of_arguments_has_a_reason_and_is_used():
    every = [one for file in sources() for one in definitions(file)]
    wide = [one for one in every if one.arguments > rules.LIMITS["arguments"]]
    unneeded = [why for why, exempt in rules.MANY_ARGUMENTS.items() if not any(map(exempt, wide))]
    assert unneeded == []


def test_every_name_of_the_whitelist_has_a_reason():
    assert [name for name, reason in unused.whitelist().items() if not reason] == []


def test_a_figure_over_its_limit_is_marked():
    rows = table([Figure("a", 1, 2), Figure("b", 3, 2, "here"), Figure("c", None)]).splitlines()
    assert ["OVER" in row for row in rows] == [False, False, True, False]


def test_there_is_a_figure_for_each_limit():
    limits = [one.limit for one in size_figures() if one.limit is not None]
    assert sorted(limits) == sorted(rules.LIMITS.values())


def test_the_house_is_checked_in_ci_before_the_tests():
    lines = (ROOT / ".ci" / "run").read_text().splitlines()
    steps = [line.split()[1] for line in lines if line.startswith("make ")]
    assert steps == ["check", "test"]
