"""The documents speak of what is there: files, functions, commands and words."""

import ast
import doctest
import importlib
import importlib.metadata
import re
import subprocess
import sys

import pytest

from tests.fixtures.patience import LONG_S
from tests.house.sources import ROOT, sources, text_of, tree_of

DOCUMENTS = [ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
CONSTRAINTS = ROOT / "constraints.txt"
ARCHITECTURE = ROOT / "docs" / "explanation" / "architecture.md"
LINK = re.compile(r"\[([^\]]+)\]\(([^)#\s]+)\)")
FUNCTION = re.compile(r"`([\w.]+)`$")
NAMED = re.compile(r"`([\w./-]+\.(?:py|toml|md|txt|svg|yaml))`")


def links(document):
    return LINK.findall(document.read_text())


def steps():
    """Links of the walk that name a function."""
    return [
        (found[1], place) for told, place in links(ARCHITECTURE) if (found := FUNCTION.match(told))
    ]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document.name)
def test_every_relative_link_leads_to_a_file(document):
    here = [place for _, place in links(document) if "://" not in place]
    assert [place for place in here if not (document.parent / place).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document.name)
def test_every_file_that_is_named_is_there(document):
    named = {place for place in NAMED.findall(document.read_text()) if "/" in place}
    assert sorted(place for place in named if not (ROOT / place).exists()) == []


@pytest.mark.parametrize(("function", "place"), steps(), ids=str)
def test_every_step_of_the_walk_is_a_function_of_its_file(function, place):
    file = (ARCHITECTURE.parent / place).resolve()
    names = set()
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{one.name}" for one in node.body if hasattr(one, "name")}
    assert function in names or f"{function}_python" in names


def test_the_walk_goes_through_all_rooms_of_a_cycle():
    places = " ".join(place for _, place in steps())
    for room in ("bus/assemble", "skin/pipeline", "skin/decode/", "skin/contact/", "contact/slip/"):
        assert room in places


def test_every_command_of_make_that_is_named_is_there():
    makefile = (ROOT / "Makefile").read_text()
    named = {
        name for file in DOCUMENTS for name in re.findall(r"`make ([\w-]+)`", file.read_text())
    }
    assert sorted(name for name in named if f"\n{name}:" not in makefile) == []


def test_the_reference_is_what_the_program_knows(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    reference = importlib.import_module("reference")
    locked = dict(line.split("==") for line in CONSTRAINTS.read_text().split() if "==" in line)
    if importlib.metadata.version("tyro") != locked["tyro"]:
        pytest.skip("help texts of another version of tyro")
    stale = [
        page.name
        for page in reference.pages()
        if reference.written(text := page.read_text("utf-8")) != text
    ]
    assert stale == [], "make reference"
    assert len(reference.pages()) == 4


PYTHON = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def programs():
    """Blocks of Python of the site that open simulated units and end by themselves."""
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for number, text in enumerate(PYTHON.findall(page.read_text())):
            if "simulate=" in text and "break" in text:
                yield pytest.param(text, id=f"{page.stem} {number}")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document.name)
def test_every_block_of_python_is_python(document):
    for text in PYTHON.findall(document.read_text()):
        if ">>>" not in text:
            ast.parse(text.replace("for ...)", "for _ in ())"))


@pytest.mark.long
@pytest.mark.parametrize("program", list(programs()))
def test_every_program_runs_and_reports(program):
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=False, capture_output=True, text=True,
        timeout=LONG_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") >= 1


@pytest.mark.long
def test_every_session_of_a_page_gives_what_it_shows():
    pages = [page for page in DOCUMENTS if ">>> " in page.read_text()]
    assert pages
    for page in pages:
        assert doctest.testfile(str(page), module_relative=False).failed == 0, page


def test_the_names_of_the_guide_are_those_of_the_code():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    code = "\n".join(text_of(file) for file in sources())
    code += "".join(file.read_text() for file in (ROOT / "tests" / "house").glob("*.py"))
    for name in ("UnitModel", "Fields", "LAYERS"):
        assert name in text
        assert re.search(rf"\b{name}\b", code)
