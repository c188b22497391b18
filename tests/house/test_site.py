"""The site is built without a warning, and its reference has all that the program has."""

from __future__ import annotations

import html
import re
import subprocess
import sys

import pytest

from tests.house.sources import ROOT

pytest.importorskip("sphinx", reason="sphinx is not installed")
pytest.importorskip("myst_parser", reason="myst-parser is not installed")
pytest.importorskip("furo", reason="furo is not installed")
pytestmark = pytest.mark.long


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


def test_every_page_is_there(site):
    pages = {
        file.relative_to(ROOT / "docs").with_suffix("") for file in (ROOT / "docs").rglob("*.md")
    }
    built = {file.relative_to(site).with_suffix("") for file in site.rglob("*.html")}
    assert pages - built == set()


def test_the_reference_of_python_has_what_the_package_offers(site):
    import skin

    text = "".join(text_of(page) for page in (site / "reference" / "python").glob("*.html"))
    public = [name for name in skin.__all__ if name not in ("errors", "view", "Pipeline")]
    assert [name for name in public if f"skin.{name}" not in text] == []
