"""The panel next to the picture: the chosen unit, colours, health."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from html import escape
from queue import SimpleQueue
from typing import Any

import numpy as np

from skin.cividis import CIVIDIS
from skin.io.messages.record import contacts_of
from skin.state import Status
from skin.view.colour import INVALID_COLOUR, OFF_COLOUR, OFF_SIZE, QUANTITIES
from skin.view.drawing import Pose
from skin.view.fingers import Events, Fingers
from skin.view.health import PALE, Health, table_html
from skin.view.scene import RIM_COLOUR, Scales
from topology import Topology
from topology.robot.model import RobotModel

__all__ = ["Panel", "unit_html"]

RELEASED_S = 1.0
"""Time after which a slider follows the joints again [assumed]."""
STEPS = 200
"""Of a slider."""


class Panel:
    """The panel of a view. Requests of browsers wait in `requests` for the view's own loop.

    Parameters
    ----------
    server : viser.ViserServer
    topology : Topology
    is_live : bool
        Whether it is a live skin, whose zeros can be taken.

    Attributes
    ----------
    unit : int or None
        The chosen one.
    """

    def __init__(self, server: Any, topology: Topology, is_live: bool) -> None:
        self.requests: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._names, self._is_live, self.unit = topology.unit_names, is_live, None
        self._health = Health(topology)
        self._fingers, self._events = Fingers(topology), Events(topology)
        self._came_s = self._slid_s = 0.0
        gui = server.gui
        self._banner = gui.add_html("")
        self._folder = gui.add_folder("Unit", visible=False)
        with self._folder:
            self._unit_words = gui.add_html("")
            close = gui.add_button("Close")
        with gui.add_folder("Fingers"):
            self._bars, self._log = gui.add_html(""), gui.add_html("")
            top = gui.add_button("Top", hint="look on the face of the largest patch")
        with gui.add_folder("Colour"):
            self._quantity = gui.add_dropdown("quantity", tuple(QUANTITIES), initial_value="load")
            self._legend = gui.add_html("")
            fit = gui.add_button("Fit the scale", hint="to the values shown now")
        with gui.add_folder("Health"):
            self._words = gui.add_html("")
            tare = gui.add_button(
                "Tare", hint="take the zeros of all untouched units again", visible=is_live
            )
            self._tare_text = gui.add_html("", visible=False)
        self._sliders: list[Any] = []
        if is_live and topology.robot is not None:
            with gui.add_folder("Joints", expand_by_default=False):
                self._sliders = _sliders(gui, topology.robot)
            for slider in self._sliders:
                slider.on_update(self._slid)
        self._quantity.on_update(self._requests("draw"))
        for button, request in (
            (fit, "fit"), (tare, "tare"), (close, "close"), (top, "top"),
        ):  # fmt: skip
            button.on_click(self._requests(request))

    def _requests(self, request: str) -> Callable[[Any], None]:
        """A callback that leaves a request: it runs in a thread of the server."""
        return lambda event: self.requests.put((request, event.client))

    def _slid(self, event: Any) -> None:
        """A slider was moved in a browser, and not by `follow`."""
        if event.client is not None:
            self._slid_s = time.monotonic()
            self.requests.put(("joints", [slider.value for slider in self._sliders]))

    def follow(self, q: np.ndarray) -> None:
        """Let the sliders show the joints, but not against the hand that has just moved them."""
        if np.isfinite(q).all() and time.monotonic() - self._slid_s > RELEASED_S:
            for slider, value in zip(self._sliders, q.tolist(), strict=False):
                slider.value = value

    @property
    def quantity(self) -> str:
        """That units are coloured by."""
        return self._quantity.value

    def report_tare(self, text: str) -> None:
        """Show what came of taking the zeros."""
        self._tare_text.visible = True
        self._tare_text.content = (
            f'<div style="padding:0.2em 0.9em;font-size:0.78em">{escape(text)}</div>'
        )

    def choose(self, unit: int | None) -> None:
        """Show a unit, or none."""
        self.unit = unit
        self._folder.visible = unit is not None

    def add(self, record: np.void, now_s: float) -> None:
        """A snapshot has come."""
        self._health.add(record)
        self._events.add(record)
        self._came_s = now_s

    def refresh(
        self, newest: np.void, pose: Pose, now_s: float, scales: Scales,
        faults: Sequence[tuple[str, str]],
    ) -> None:  # fmt: skip
        """Show the newest snapshot; `faults` are those of links."""
        silent_s = now_s - self._came_s if self._is_live else 0.0
        self._banner.content = self._health.banner_html(newest, silent_s)
        self._bars.content = self._fingers.html(newest, pose, scales.contact.high)
        self._log.content = self._events.html(int(newest["stamp_ns"]))
        self._words.content = self._health.html(newest, faults)
        self._legend.content = legend_html(self.quantity, scales)
        if self.unit is not None:
            self._unit_words.content = unit_html(newest, self.unit, self._names[self.unit])


def _sliders(gui: Any, robot: RobotModel) -> list[Any]:
    """A slider for each joint; one without limits turns once."""
    lower, upper = np.nan_to_num(robot.lower, nan=-np.pi), np.nan_to_num(robot.upper, nan=np.pi)
    ends = zip(robot.joint_names, lower.tolist(), upper.tolist(), robot.home.tolist(), strict=True)
    return [
        gui.add_slider(name, low, high, (high - low) / STEPS, min(max(home, low), high))
        for name, low, high, home in ends
    ]


def unit_html(record: np.void, unit: int, name: str) -> str:
    """A unit as text.

    Force and its parts are in the unit's frame: z, the normal force, points into the skin.
    """
    force, sigma = record["force"][:, unit].astype(float), record["force_sigma"][:, unit]
    size = float(np.linalg.norm(force))
    along = force / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    status = Status(int(record["status"][unit]))
    temperature = float(record["temperature"][unit])
    rows = [
        ("unit", name, "#ff9ade"),
        ("force", _with_sigma(size, float(np.linalg.norm(along * sigma))), ""),
        *((f"f{axis}", _with_sigma(float(value), float(error)), "")
          for axis, value, error in zip("xyz", force, sigma, strict=True)),
        ("temperature", f"{temperature:.1f} °C" if np.isfinite(temperature) else "unknown", ""),
        ("flags", ", ".join(str(flag.name).lower() for flag in status) or "none", PALE),
    ]  # fmt: skip
    if np.isfinite(ratio := record["test_ratio"][unit]):
        rows.append(("test ratio", f"{ratio:.2f}; 1 is the limit", ""))
    if 0 <= (contact := int(record["contact"][unit])) < int(record["contact_count"]):
        rows.append(("contact", f"{contacts_of(record)['id'][contact]}", ""))
    return table_html(rows)


def _with_sigma(value: float, sigma: float) -> str:
    if not np.isfinite(value):
        return "unknown"
    return f"{value:.2f} N" if np.isnan(sigma) else f"{value:.2f} ± {sigma:.2f} N"


def legend_html(quantity: str, scales: Scales) -> str:
    """A bar with the ends, the middle and the unit of its scale, the colours of units that are not
    valid or switched off, and the scale of the arrows."""
    scale = scales.of[quantity]
    ends = (scale.low, 0.5 * (scale.low + scale.high), scale.high)
    ticks = "".join(f"<span>{value:g}</span>" for value in ends)
    disc = '<span style="display:inline-block;width:1.1em;height:1.1em;border-radius:50%;background'
    dot = f"radial-gradient({_css(OFF_COLOUR)} {100 * OFF_SIZE:.0f}%,{_css(RIM_COLOUR)} 0)"
    bar = ",".join(_css(colour) for colour in CIVIDIS[::4])
    return (
        '<div style="padding:0.3em 0.9em;font-size:0.78em">'
        f'<div style="height:0.9em;border-radius:3px;background:linear-gradient(90deg,{bar})">'
        f'</div><div style="display:flex;justify-content:space-between">{ticks}</div>'
        f"<div>{escape(QUANTITIES[quantity].unit)}</div>"
        f'<div>{disc}:{_css(INVALID_COLOUR)}"></span> with a cross: not valid &ensp; '
        f'{disc}:{dot}"></span> with a dot: switched off</div>'
        f'<div style="opacity:0.75">longest arrow of a unit {scales.unit.high:g} N, of a contact '
        f"{scales.contact.high:g} N</div></div>"
    )


def _css(colour: Iterable[int]) -> str:
    return "rgb({},{},{})".format(*colour)
