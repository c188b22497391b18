"""The replay of a guest's tests is honest: nothing counts as passed that has not passed there.

The tests that need a real vcan are in tests/vcan; here, a stand-in for the guest runs pytest in a
process of its own, without a kernel.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

VCAN = Path(__file__).parents[1] / "vcan"

TESTS = """
import os
import pytest

def test_passes():
    assert "VCAN_REPORTS" in os.environ

@pytest.mark.parametrize("count", [3])
def test_fails(count):
    assert count == 4

def test_skips():
    pytest.skip("for a reason")

@pytest.mark.xfail
def test_is_expected_to_fail():
    assert False

@pytest.fixture
def broken():
    yield
    raise OSError("the tear-down broke")

def test_has_a_broken_fixture(broken):
    pass
"""

GUEST = """
import ast, os, pathlib, subprocess, sys

def unavailable():
    return {unavailable!r}

def run_tests(nodeids, root):
    reports = pathlib.Path(root, "reports")
    environment = os.environ | {{"VCAN_REPORTS": str(reports)}}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *nodeids]
    subprocess.run(command, cwd=root, env=environment, check=False)
    # as the guest's: see tests/vcan/guest.py
    replays = [ast.literal_eval(line) for line in reports.read_text().splitlines()]
    return replays[:{limit}], {came_up}, "the console's last words"
"""


@pytest.fixture
def replay(tmp_path):
    """Run a folder of tests against a stand-in guest; give its output and status."""

    def replay(unavailable=None, limit=None, came_up=True, ci=None):
        conftest = (VCAN / "conftest.py").read_text()
        hidden = conftest.replace('("vcan0", "vcan1")', '("too-long-for-an-interface",)')
        assert hidden != conftest
        (tmp_path / "conftest.py").write_text(hidden)
        shutil.copy(VCAN / "links.py", tmp_path)
        (tmp_path / "guest.py").write_text(
            GUEST.format(unavailable=unavailable, limit=limit, came_up=came_up)
        )
        (tmp_path / "test_away.py").write_text(TESTS)
        (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = vcan\naddopts = -ra -vv\n")
        unset = ("VCAN_REPORTS", "CI")
        environment = {key: value for key, value in os.environ.items() if key not in unset}
        if ci is not None:
            environment["CI"] = ci
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        return done.stdout, done.returncode

    return replay


def test_each_test_has_the_outcome_it_had_in_the_guest(replay):
    output, status = replay()
    assert "1 failed, 2 passed, 1 skipped, 1 xfailed, 1 error in" in output.splitlines()[-1]
    assert "test_away.py::test_passes PASSED" in output
    assert "assert 3 == 4" in output
    assert "for a reason" in output
    assert "the tear-down broke" in output
    assert status == 1


def test_what_the_guest_has_not_finished_fails_with_its_console(replay):
    output, status = replay(limit=4)  # three reports of the first test, the set-up of the second
    assert "1 passed, 4 errors in" in output.splitlines()[-1]
    assert "the guest has not reported on this test" in output
    assert "the console's last words" in output
    assert status == 1


def test_a_guest_that_is_installed_and_does_not_boot_fails_with_its_console(replay):
    output, status = replay(came_up=False, limit=0)
    assert "5 errors in" in output.splitlines()[-1]
    assert "User-Mode Linux is installed but does not start on this machine" in output
    assert "the console's last words" in output
    assert status == 1


@pytest.mark.parametrize("ci", [None, "", "false"])
def test_a_machine_without_the_packages_skips_and_names_them(replay, ci):
    output, status = replay(unavailable=guest_of("/nowhere").unavailable(), ci=ci)
    assert "5 skipped in" in output.splitlines()[-1]
    assert "sudo apt-get install user-mode-linux kmod iproute2 can-utils" in output
    assert status == 0


def test_in_ci_the_packages_are_required(replay):
    output, status = replay(unavailable=guest_of("/nowhere").unavailable(), ci="true")
    assert "5 errors in" in output.splitlines()[-1]
    assert "sudo apt-get install user-mode-linux kmod iproute2 can-utils" in output
    assert status == 1


def test_a_machine_with_the_programs_can_boot(tmp_path):
    for name in ("linux.uml", "insmod", "ip", "candump", "taskset"):
        shutil.copy(sys.executable, tmp_path / name)
    assert guest_of(str(tmp_path)).unavailable() is None


def guest_of(path):
    """Import the guest's own module with its programs looked for in one folder only."""
    spec = importlib.util.spec_from_file_location("guest_of_a_path", VCAN / "guest.py")
    guest = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(guest)
    guest.SEARCH = path
    return guest
