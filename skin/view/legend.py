"""The scale of colours, as HTML: the same beside a live view and in an exported file."""

from __future__ import annotations

from html import escape

from skin.view.colour import CIVIDIS, INVALID_COLOUR, QUANTITIES
from skin.view.scene import Scales

__all__ = ["arrows_html", "legend_html"]


def legend_html(quantity: str, scales: Scales) -> str:
    """A bar with the ends, the middle and the unit of its scale, and the colour outside of it."""
    chosen, scale = QUANTITIES[quantity], scales.of[quantity]
    stops = ",".join(_css(colour) for colour in CIVIDIS[::4])
    if quantity == "validity":
        ticks = ["flagged, if it has no cross", "", "valid"]
    else:
        middle = 0.5 * (scale.low + scale.high)
        ticks = [f"{value:g}" for value in (scale.low, middle, scale.high)]
        ticks[2] += f" {chosen.unit}"
    told = "".join(f"<span>{escape(tick)}</span>" for tick in ticks)
    mark = (
        f'<span style="display:inline-block;width:1.1em;height:1.1em;border-radius:50%;'
        f"background:{_css(INVALID_COLOUR)};color:#14181c;text-align:center;line-height:1.1em;"
        f'font-weight:700">×</span>'
    )
    return (
        f'<div style="padding:0.3em 0.9em;font-size:0.78em">'
        f'<div style="height:0.9em;border-radius:3px;background:linear-gradient(90deg,{stops})">'
        f'</div><div style="display:flex;justify-content:space-between">{told}</div>'
        f"<div>{mark} not to be trusted: no reading, or flagged</div></div>"
    )


def arrows_html(scales: Scales) -> str:
    """What the lengths of arrows mean."""
    return (
        '<div style="padding:0 0.9em 0.4em;font-size:0.78em;opacity:0.75">'
        f"longest arrow of a unit {scales.unit.high:g} N, of a contact {scales.contact.high:g} N"
        "</div>"
    )


def _css(colour: object) -> str:
    red, green, blue = (int(part) for part in colour)  # type: ignore[attr-defined]
    return f"rgb({red},{green},{blue})"
