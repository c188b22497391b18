"""Virtual interfaces that a test makes for itself."""

import itertools
import subprocess

import pytest

names = (f"vcan{i}" for i in itertools.count(40))


def ip(*arguments, check=True):
    return subprocess.run(["ip", *arguments], check=check, capture_output=True, text=True)


def make(name, mtu=72, up=True):
    """Make a virtual interface, or skip where this user may not."""
    done = ip("link", "add", name, "type", "vcan", check=False)
    if done.returncode:
        pytest.skip(f"may not make interfaces: {done.stderr.strip()}")
    ip("link", "set", name, "mtu", str(mtu), *(["up"] if up else []))
