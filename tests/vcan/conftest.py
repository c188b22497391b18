"""Tests of this folder run on a real vcan: the machine's own, or one in User-Mode Linux.

Where the machine has none, all selected tests of the folder run in one boot of a guest kernel; the
guest's pytest writes its reports down, and here each test replays its own, as if it had run here.

They skip only where the guest's packages are missing; where these are installed and the guest does
not start, they fail, and where CI is set they never skip for want of a kernel.
"""

import os
import subprocess
from functools import cache
from pathlib import Path

import guest
import links
import pytest

INTERFACES = ("vcan0", "vcan1")
REPORTS = os.environ.get("VCAN_REPORTS")  # set inside the guest, where every test runs on the spot


def pytest_itemcollected(item):
    item.add_marker("vcan")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    """Replay the guest's reports; without any, the usual protocol goes on to the set-up below."""
    if not _is_away(item):
        return None
    reports = _run_in_guest(item.session)[0].get(item.nodeid, [])
    if [report.when for report in reports][-1:] != ["teardown"]:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Say why the guest has not reported on a test."""
    if not _is_away(item):
        return
    if reason := guest.unavailable():
        if _is_required():
            pytest.fail(f"CI is set, and so these tests are required: {reason}", pytrace=False)
        pytest.skip(reason)
    _, came_up, console = _run_in_guest(item.session)
    said = "the guest has not reported on this test; its console:"
    if not came_up:
        said = "User-Mode Linux is installed but does not start on this machine; its console:"
    pytest.fail(f"{said}\n{console}", pytrace=False)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if REPORTS:
        data = item.config.hook.pytest_report_to_serializable(config=item.config, report=report)
        with open(REPORTS, "a") as file:
            print(ascii(data), file=file)  # not JSON, which makes lists of the tuples in it
    return report


@pytest.fixture
def link():
    """Name of an interface of this test's own, on which no frame of another test arrives late."""
    name = next(links.names)
    links.make(name)
    yield name
    links.ip("link", "delete", name, check=False)


def _is_required():
    return os.environ.get("CI", "").lower() not in ("", "0", "false")


def _is_away(item):
    return bool(item.get_closest_marker("vcan")) and not REPORTS and not _has_vcan(item.config)


@cache
def _has_vcan(config):
    """Tell whether both interfaces are here and carry CAN FD, making those missing if we may."""
    for name in INTERFACES:
        settings = Path("/sys/class/net") / name
        if not settings.exists():
            if not _ip("link", "add", name, "type", "vcan"):
                return False
            config.add_cleanup(lambda name=name: _ip("link", "delete", name))
            _ip("link", "set", name, "mtu", "72", "up")
        is_up = int(settings.joinpath("flags").read_text(), 16) & 1
        if not is_up or settings.joinpath("mtu").read_text().strip() != "72":
            return False
    return True


def _ip(*arguments):
    try:
        return subprocess.run(["ip", *arguments], capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


@cache
def _run_in_guest(session):
    """Boot once a session: reports by test, whether the guest came up, its console."""
    if guest.unavailable():
        return {}, False, ""
    items = [item for item in session.items if item.get_closest_marker("vcan")]
    if any(item.get_closest_marker("long") for item in items):
        guest.LIMIT_S += guest.LONG_S
    nodeids = [item.nodeid for item in items]
    data, came_up, console = guest.run_tests(nodeids, session.config.rootpath)
    hook, reports = session.config.hook, {}
    for one in data:
        report = hook.pytest_report_from_serializable(config=session.config, data=one)
        reports.setdefault(report.nodeid, []).append(report)
    return reports, came_up, console
