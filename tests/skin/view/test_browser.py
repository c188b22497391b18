"""What a person sees of a skin in a browser, and what the buttons do."""

from __future__ import annotations

import time

import numpy as np
import pytest

from skin.view import show
from skin.view.colour import colours
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


def test_tare_reaches_the_skin_and_the_answer_the_browser(viewed):
    shown, view, browser = viewed
    browser.press("Tare")
    browser.wait_for("touch nothing")
    press(shown, ())
    assert shown.retaken == 1
    assert view._worker.send("zeros", text="63 units tared, 1 refused: u3: is pressed")
    browser.wait_for("63 units tared, 1 refused: u3: is pressed")
