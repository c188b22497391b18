"""The colour scale as HTML, for a live view and for an exported file."""

from __future__ import annotations

from html import escape

from skin.cividis import CIVIDIS
from skin.view.colour import INVALID_COLOUR, OFF_COLOUR, QUANTITIES
from skin.view.scene import Scales

__all__ = ["arrows_html", "legend_html"]


def legend_html(quantity: str, scales: Scales) -> str:
    """A bar with the ends, the middle and the unit of its scale, and the colour of invalid
    units."""
    chosen, scale = QUANTITIES[quantity], scales.of[quantity]
    stops = ",".join(_css(colour) for colour in CIVIDIS[::4])
    if quantity == "validity":
        ticks = ["flagged, if it has no cross", "", "valid"]
    else:
        middle = 0.5 * (scale.low + scale.high)
        ticks = [f"{value:g}" for value in (scale.low, middle, scale.high)]
        ticks[2] += f" {chosen.unit}"
    labels = "".join(f"<span>{escape(tick)}</span>" for tick in ticks)
    mark = (
        f'<span style="display:inline-block;width:1.1em;height:1.1em;border-radius:50%;'
        f"background:{_css(INVALID_COLOUR)};color:#14181c;text-align:center;line-height:1.1em;"
        f'font-weight:700">×</span>'
    )
    off = (
        '<span style="display:inline-block;width:1.1em;height:1.1em;border-radius:50%;'
        f'vertical-align:text-bottom;background:{_css(OFF_COLOUR)}"></span>'
    )
    return (
        f'<div style="padding:0.3em 0.9em;font-size:0.78em">'
        f'<div style="height:0.9em;border-radius:3px;background:linear-gradient(90deg,{stops})">'
        f'</div><div style="display:flex;justify-content:space-between">{labels}</div>'
        f"<div>{mark} not valid: no reading, or flagged &ensp; "
        f'<span style="white-space:nowrap">{off} switched off</span></div></div>'
    )


def arrows_html(scales: Scales) -> str:
    """Scale of the arrows."""
    return (
        '<div style="padding:0 0.9em 0.4em;font-size:0.78em;opacity:0.75">'
        f"longest arrow of a unit {scales.unit.high:g} N, of a contact {scales.contact.high:g} N"
        "</div>"
    )


def _css(colour: object) -> str:
    red, green, blue = (int(part) for part in colour)  # type: ignore[attr-defined]
    return f"rgb({red},{green},{blue})"
