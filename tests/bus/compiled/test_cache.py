"""Where compiled kernels are kept, and which folders are used."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

import bus
from bus.compiled import cache

ROOT = Path(bus.__file__).parent.parent
KERNEL = """
import json
import numpy as np
from bus.compiled import cache
from tests.fixtures.compiling import watch
from tests.bus.compiled.small import twice
named = []
with watch(named.append):
    twice(np.ones(3))
print(json.dumps([named, str(cache.folder())]))
"""
needs_compiler = pytest.mark.skipif(
    bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="kernels are interpreted"
)


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """A cache of its own, and a temporary folder."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    cache.folder.cache_clear()
    yield tmp_path
    cache.folder.cache_clear()


def run(folder):
    done = subprocess.run(
        [sys.executable, "-c", KERNEL], capture_output=True, text=True, check=True,
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])


@needs_compiler
def test_a_second_process_compiles_nothing(tmp_path):
    compiled, folder = run(tmp_path)
    assert compiled == ["twice_python"]
    assert folder == str(tmp_path / "f3t-skin" / cache.sources())
    assert run(tmp_path) == [[], folder]


def test_numbas_own_folder_is_set_while_kernels_are_decorated_and_not_after(fresh):
    before = numba.config.CACHE_DIR
    with cache.kept() as is_kept:
        assert is_kept
        assert numba.config.CACHE_DIR == str(cache.folder())
    assert before == numba.config.CACHE_DIR


def test_a_folder_that_others_can_write_is_not_used_and_is_named(fresh, caplog):
    base = fresh / "kept" / "f3t-skin"
    base.mkdir(parents=True)
    base.chmod(0o777)
    place = cache.folder()
    assert place is not None
    assert place.parent.parent == fresh / "temporary"
    assert f"compiled kernels in {base} are not used: must be writable by its owner" in caplog.text


def test_a_link_among_temporary_files_is_not_followed(fresh, monkeypatch, caplog):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/dev/null/nowhere")
    (fresh / "elsewhere").mkdir()
    (fresh / "temporary" / f"f3t-skin-{os.getuid()}").symlink_to(fresh / "elsewhere")
    assert cache.folder() is None
    assert "must be a folder; got a link" in caplog.text
    assert "compiled kernels are not kept: no folder can be written" in caplog.text


def test_folders_of_other_code_go_when_nobody_has_used_them_for_long(fresh):
    base = fresh / "kept" / "f3t-skin"
    old, young = base / "old", base / "young"
    for folder in (old, young):
        folder.mkdir(parents=True)
    past = time.time() - cache.UNUSED_S - 60.0
    os.utime(old, (past, past))
    assert cache.folder() is not None
    assert not old.exists()
    assert young.exists()


def test_all_that_was_compiled_can_be_cleared(fresh):
    place = cache.folder()
    assert place is not None
    assert cache.clear() == [place.parent]
    assert not place.exists()


def test_the_digest_knows_what_kernels_import():
    """A file without a kernel, whose constants they take."""
    text = (ROOT / "skin/decode/records.py").read_text()
    assert "bus.compiled" not in text
    assert len(cache.sources()) == 16
