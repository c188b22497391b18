"""What a person sees of a skin in a browser, and what the buttons do."""

from __future__ import annotations

import time
from contextlib import contextmanager
from threading import Event, Thread

import numpy as np
import pytest

from skin.contact.record import SlipState
from skin.state import Status
from skin.view import show
from skin.view.colour import INVALID_COLOUR, colours
from skin.view.drawing import SLIP_COLOURS
from skin.view.scene import CHOSEN_COLOUR
from tests.fixtures.browser import PROGRAM, Browser
from tests.fixtures.patience import LONG_S
from tests.fixtures.shown import Shown

pytest.importorskip("viser", reason="viser is not installed")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        PROGRAM is None, reason="chromium is not installed: sudo apt-get install chromium"
    ),
]
PANEL = 870
"""Where the panel begins."""
ONE = np.ones(1, bool)


@pytest.fixture(scope="module")
def viewed():
    """A flat skin of 64 units, a browser that shows it."""
    shown = flat(8, 8)
    with show(shown, port=0) as view:
        browser = Browser(view.address)
        browser.wait_for("Health", 60.0)
        browser.close_notes()
        yield shown, view, browser
        browser.close()


def flat(rows, columns, pitch_m=0.012):
    """A plane of units that faces +z."""
    shown = Shown(rows, columns, pitch_m)
    n = rows * columns
    position = np.zeros((3, n))
    position[0], position[1] = (
        pitch_m * (np.arange(n) % columns),
        pitch_m * (np.arange(n) // columns),
    )
    rotation = np.repeat(np.diag([1.0, -1.0, -1.0])[:, :, None], n, axis=2)
    shown.poses = position, rotation
    return shown


def press(shown, units, load=4.0, status=None):
    """Show a load on some units until the view has it."""
    force = np.zeros((3, shown.topology.n))
    force[2, list(units)] = load
    for _ in range(3):  # due ones among them
        time.sleep(0.04)
        shown.show(force=force, status=status)


@contextmanager
def going_on(shown, status):
    """Cycles meanwhile, however long a picture takes."""
    ended = Event()

    def go():
        while not ended.wait(0.04):
            shown.show(status=status)

    thread = Thread(target=go)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def count(picture, colour, within=24):
    """Pixels beside the panel that have about this colour."""
    picture = picture[:, :PANEL]
    away = np.abs(picture.astype(int) - np.asarray(colour, int)).max(axis=2)
    return int(np.count_nonzero(away <= within))


def settled(browser, is_so, timeout_s=LONG_S):
    """The picture, once it is as it should be."""
    until = time.monotonic() + timeout_s
    while not is_so(picture := browser.picture()):
        assert time.monotonic() < until
        time.sleep(0.2)
    return picture


def shade(value, high):
    return colours(np.array([value]), ONE, 0.0, high)[0]


def test_a_pressed_region_has_the_colour_of_its_load(viewed):
    shown, _, browser = viewed
    press(shown, ())
    browser.wait_for("64 of 64 valid")
    rest = shade(0.0, 5.0)
    untouched = settled(browser, lambda seen: count(seen, rest) > 20_000)
    press(shown, range(16), 5.0)
    pressed = settled(browser, lambda seen: count(seen, rest) < 0.9 * count(untouched, rest))
    assert count(pressed, rest) > 5_000
    yellow = (228, 215, 112)  # as near as the renderer comes
    assert count(pressed, yellow) > 2_000
    assert count(untouched, yellow) == 0


def test_a_unit_that_dies_is_named_and_is_seen(viewed):
    shown, _, browser = viewed
    press(shown, ())
    status = np.zeros(64, np.uint16)
    status[[9, 10, 18]] = int(Status.STALE | Status.LATE)
    before = count(browser.picture(), INVALID_COLOUR, 55)
    press(shown, (), status=status)
    words = browser.wait_for("61 of 64 valid")
    for unit in ("u9", "u10", "u18"):
        assert f"{unit}\nlate, stale" in words or f"{unit}\nstale, late" in words
    assert "u11\n" not in words
    settled(browser, lambda seen: count(seen, INVALID_COLOUR, 55) > before + 400)
    press(shown, ())
    browser.wait_for("64 of 64 valid")


def test_a_contact_has_an_arrow_a_label_and_the_colour_of_its_slip(viewed):
    shown, _, browser = viewed
    press(shown, ())
    orange, paper = SLIP_COLOURS[SlipState.INCIPIENT], (225, 225, 225)
    settled(browser, lambda seen: count(seen, orange, 20) < 50)
    before = count(browser.picture(), paper, 30)
    for _ in range(3):
        time.sleep(0.04)
        shown.show(contacts=[shown.contact(20, 3.0, SlipState.INCIPIENT, number=12)])
    settled(
        browser,
        lambda seen: count(seen, orange, 50) > 300 and count(seen, paper, 30) > before + 1000,
    )
    press(shown, ())
    settled(browser, lambda seen: count(seen, orange, 20) < 50)


def test_tare_reaches_the_skin_and_the_answer_the_browser(viewed):
    shown, view, browser = viewed
    browser.press("Tare")
    browser.wait_for("touch nothing")
    press(shown, ())
    assert shown.retaken == 1
    assert view._worker.send("zeros", text="63 units tared, 1 refused: u3: is pressed")
    browser.wait_for("63 units tared, 1 refused: u3: is pressed")


def test_a_browser_that_returns_finds_the_view_as_it_was(viewed):
    _, view, browser = viewed
    browser.choose("load", "shear")
    browser.open("about:blank")
    browser.open(view.address)
    browser.wait_for("63 units tared")
    browser.choose("shear", "load")


def test_a_click_shows_a_unit_and_its_force(viewed):
    shown, _, browser = viewed
    press(shown, range(64), 5.0)  # the scale is as wide from here on
    press(shown, range(64), 2.5)
    magenta = tuple(CHOSEN_COLOUR.tolist())
    settled(browser, lambda seen: count(seen, shade(2.5, 5.0)) > 10_000)
    for x in range(300, 600, 20):  # beside a disc there is no unit
        browser.click(x, 400)
        found, until = False, time.monotonic() + 3.0
        while not found and time.monotonic() < until:
            press(shown, range(64), 2.5)
            found = "temperature\n30.0 °C" in browser.text()
        if found:
            break
    words = browser.wait_for("2.50 ± 0.01 N")
    assert "flags\nnone" in words
    settled(browser, lambda seen: count(seen, magenta, 40) > 100)
    browser.press("Close")
    browser.wait_until("!document.body.innerText.includes('2.50 ± 0.01 N')")


def test_health_is_amber_for_a_unit_and_red_for_a_patch_and_for_silence(viewed):
    shown, _, browser = viewed
    green, amber, red = (46, 125, 70), (255, 176, 32), (229, 53, 43)

    def has(colour):
        return lambda seen: np.all(seen[:160, PANEL:] == colour, axis=2).sum() > 500

    for units, colour in (([], green), ([9], amber), (slice(None), red), ([], green)):
        status = np.zeros(64, np.uint16)
        status[units] = int(Status.STALE)
        with going_on(shown, status):
            settled(browser, has(colour))
    browser.wait_for("no cycle for")  # the skin's loop does not go on
    settled(browser, has(red))
