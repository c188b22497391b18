"""The site is built without a warning, and its reference has all that the program has."""

from __future__ import annotations

import html
import re
import subprocess
import sys
import tomllib

import pytest

from skin.cli import COMMANDS
from tests.house.sources import ROOT

pytest.importorskip("sphinx", reason="sphinx is not installed")
pytest.importorskip("myst_parser", reason="myst-parser is not installed")
pytest.importorskip("furo", reason="furo is not installed")
pytestmark = pytest.mark.long
BUILTIN = ROOT / "topology" / "builtin"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site, without the output of the examples."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html",
               "-d", str(folder / "doctrees"), "-D", "run_examples=0",
               str(ROOT / "docs"), str(folder / "html")]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "html"


def text_of(page):
    """A page without its marks."""
    return html.unescape(re.sub(r"<[^>]+>", "", page.read_text("utf-8")))


def keys(table):
    """All keys of a file of TOML, those of tables in it too."""
    for key, value in table.items():
        yield key
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, dict):
                yield from keys(one)


def test_every_page_is_there(site):
    pages = {
        file.relative_to(ROOT / "docs").with_suffix("") for file in (ROOT / "docs").rglob("*.md")
    }
    built = {file.relative_to(site).with_suffix("") for file in site.rglob("*.html")}
    assert pages - built == set()


def test_the_reference_has_every_key_of_the_ready_made_topologies(site):
    text = text_of(site / "reference" / "topology.html")
    used = {key for file in BUILTIN.glob("*.toml") for key in keys(tomllib.loads(file.read_text()))}
    assert len(used) > 20
    assert sorted(key for key in used if not re.search(rf"\b{key}\b", text)) == []


def test_the_reference_has_every_command_with_its_options(site):
    text = text_of(site / "reference" / "cli.html")
    assert [name for name in COMMANDS if f"usage: skin {name}" not in text] == []
    assert "usage: skin calibrate plan" in text
    assert "--simulate" in text
    assert "\x1b" not in text


def test_the_reference_of_python_has_what_the_package_offers(site):
    import skin

    text = "".join(text_of(page) for page in (site / "reference" / "python").glob("*.html"))
    public = [name for name in skin.__all__ if name not in ("errors", "view", "Pipeline")]
    assert [name for name in public if f"skin.{name}" not in text] == []


def test_no_part_of_a_page_is_left_to_be_made(site):
    for page in site.rglob("*.html"):
        assert "<!-- made:" not in page.read_text("utf-8"), page
