"""`skin warmup`: what is compiled, and where it is kept."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import skin
from bus.compiled import cache
from skin.cli import main
from tests.fixtures.compiling import watch
from tests.fixtures.topology import PAIR

pytestmark = pytest.mark.usefixtures("machine_code")

ROOT = Path(skin.__file__).parent.parent
ON_SOCKETS = """
import json, sys
opened = []
sys.addaudithook(lambda event, given: event == "open" and opened.append(str(given[0])))
import skin
from skin.cli import main
assert main("warmup pad.toml --json".split()) == 0
assert any("mmsg." in name and ".nbc" in name for name in opened)  # loaded or kept
"""


def report(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_what_is_compiled_is_found_the_second_time(capsys):
    assert main(["warmup", "--json"]) == 0
    capsys.readouterr()
    compiled: list[str] = []
    with watch(compiled.append):
        assert main(["warmup", "--json"]) == 0
    assert compiled == []  # here: other tests may compile what the report lists
    found = report(capsys)
    assert found["topology"] == "palm"
    assert found["folder"] == str(cache.folder())
    assert main(["warmup"]) == 0
    said = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["folder", str(cache.folder())] in said


@pytest.mark.long
def test_a_start_finds_all_that_was_compiled_for_it(tmp_path, capsys):
    """With a recording, which has kernels of its own."""
    assert main(["warmup", "palm", "--json"]) == 0
    capsys.readouterr()
    with_record = subprocess.run(
        [sys.executable, "-c", "import sys; from tests.fixtures.compiling import watch\n"
         "from skin.cli import main\ncompiled = []\n"
         "with watch(compiled.append):\n    status = main(sys.argv[1:])\n"
         "assert not compiled, compiled\nsys.exit(status)",
         "run", "palm", "--simulate", "--seconds", "0.3", "--record", str(tmp_path / "a.mcap")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert with_record.returncode == 0, with_record.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="needs sockets of Linux")
def test_what_reads_sockets_is_compiled_and_no_bus_is_opened(tmp_path):
    text = PAIR.replace('interface = "memory"', 'interface = "socketcan"')
    assert "socketcan" in text
    (tmp_path / "pad.toml").write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", ON_SOCKETS], cwd=tmp_path, capture_output=True, text=True,
        check=False, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(os.name != "posix", reason="needs modes of files")
def test_where_nothing_can_be_kept_it_says_so(monkeypatch, capsys):
    monkeypatch.setattr(cache, "folder", lambda: None)
    assert main(["warmup", "fingertip"]) == 1
    assert ["folder", "none"] in [line.split() for line in capsys.readouterr().out.splitlines()]


def test_the_folder_can_be_cleared(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(cache, "_bases", lambda: [tmp_path / "f3t-skin"])
    (tmp_path / "f3t-skin/old").mkdir(parents=True, mode=0o700)
    (tmp_path / "f3t-skin").chmod(0o700)
    assert main(["warmup", "--clear", "--json"]) == 0
    assert report(capsys)["removed"] == [str(tmp_path / "f3t-skin")]
    assert not (tmp_path / "f3t-skin").exists()
