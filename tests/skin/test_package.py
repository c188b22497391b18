"""The package as a whole: version, command, neighbours, what its source archive holds."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import skin

ROOT = Path(skin.__file__).parent.parent


def python(*arguments, **how):
    return subprocess.run(
        [sys.executable, *arguments], check=False, capture_output=True, text=True, **how
    )


def test_version_is_told_by_the_package_and_the_command():
    done = python("-m", "skin", "--version", cwd=ROOT)
    assert done.stdout.strip() == skin.__version__
    assert f"version: {skin.__version__}\n" in (ROOT / "CITATION.cff").read_text()


@pytest.mark.parametrize("name", ["bus", "topology"])
@pytest.mark.parametrize("place", ["{name}.py", "{name}/__init__.py"])
def test_another_package_of_the_name_of_ours_is_told(name, place, tmp_path):
    file = tmp_path / place.format(name=name)
    file.parent.mkdir(exist_ok=True)
    file.write_text("")
    code = f"import sys; sys.path[:0] = [{str(tmp_path)!r}]; sys.path[2:2] = [{str(ROOT)!r}]"
    done = python("-c", f"{code}; import skin")
    assert done.returncode == 1
    told = done.stderr.splitlines()[-1]
    assert told.startswith(f"ImportError: skin: package {name!r}: must be the one in {ROOT}; got ")
    assert str(file) in told


@pytest.fixture
def tracked():
    """The files that git knows."""
    listed = subprocess.run(
        ["git", "ls-files"], check=False, cwd=ROOT, capture_output=True, text=True
    )
    if listed.returncode:
        pytest.skip("not in a checkout of git")
    return {line for line in listed.stdout.splitlines() if ROOT.joinpath(line).exists()}


def test_the_source_archive_holds_every_file(tracked):
    """None is left out on purpose: the archive tests and checks itself."""
    sdist = pytest.importorskip(
        "hatchling.builders.sdist", reason="needs hatchling: pip install 'f3t-skin[test]'"
    )
    builder = sdist.SdistBuilder(str(ROOT))
    held = {file.relative_path for file in builder.recurse_included_files()}
    assert tracked - held - {".gitignore", "pyproject.toml"} == set()  # these go in by themselves
    assert {file for file in held if file.endswith((".pyc", ".nbc"))} == set()


def test_the_extra_all_is_every_extra_of_users():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    (named,) = extras["all"]
    own = set(extras) - {"all", "docs", "fuzz", "test"}
    assert named == f"f3t-skin[{','.join(sorted(own))}]"
