"""Who can reach a view, and what is said where nobody can."""

from __future__ import annotations

import re
import socket
import sys

import pytest

from skin.errors import LibraryError, OptionError, SkinError
from skin.view import show
from skin.view.server import LOOPBACK, address_of, check_free, is_loopback
from tests.fixtures.shown import Shown


@pytest.fixture
def taken():
    """A port that somebody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


def test_a_port_in_use_is_refused(taken):
    with pytest.raises(SkinError, match=f"^view: port: must be free; got {taken}, in use$"):
        check_free("127.0.0.1", taken)


def test_a_host_elsewhere_is_refused():
    with pytest.raises(SkinError, match=re.escape("must be an address of this machine; got '192.")):
        check_free("192.0.2.1", None)


def test_a_port_is_a_number_of_16_bits():
    with pytest.raises(OptionError, match="port: must be an integer from 0 to 65535; got 70000"):
        show(Shown(), port=70000)


@pytest.mark.parametrize(
    ("origin", "may"),
    [
        ("http://127.0.0.1:8080", True), ("http://localhost:9000", True), ("http://[::1]:1", True),
        ("https://example.org", False), ("http://127.0.0.1.example.org", False),
        ("http://localhost.example.org:8080", False), ("null", False),
    ],
)  # fmt: skip
def test_pages_of_other_places_may_not_talk_to_a_view_on_loopback(origin, may):
    assert (LOOPBACK.fullmatch(origin) is not None) == may


def test_loopback_is_told_from_what_others_reach():
    assert [*map(is_loopback, ("127.0.0.1", "127.1.2.3", "localhost", "::1"))] == [True] * 4
    assert [*map(is_loopback, ("0.0.0.0", "::", "192.168.1.5", ""))] == [False] * 4
    assert address_of("192.168.1.5", 80) == "http://192.168.1.5:80"


def test_without_viser_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(LibraryError, match=re.escape("pip install 'f3t-skin[view]'")):
        show(None)
