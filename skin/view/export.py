"""A moment or a stretch as one HTML file, which needs nothing but a browser."""

from __future__ import annotations

import time
from collections.abc import Sequence
from html import escape
from itertools import pairwise

import numpy as np

from skin.view.history import Moment
from skin.view.kinds import PAGE_MARK
from skin.view.legend import arrows_html, legend_html
from skin.view.scene import Scales, Scene, Shown
from skin.view.server import open_server

__all__ = ["EXPORTED_S", "as_html"]

EXPORTED_S = 10.0
"""Length of a stretch."""


def as_html(
    moments: Sequence[Moment], area: np.ndarray, title: str, shown: Shown, scales: Scales
) -> str:
    """Moments as a page that plays them, with the scale of colours.

    They are drawn on a server of its own, which nobody is told of and which is gone afterwards: a
    live view goes on undisturbed.

    Parameters
    ----------
    moments : sequence of Moment
        One or more, in their order.
    area : ndarray, shape (n,)
        Of the units, square metre.
    title : str
    shown : Shown
    scales : Scales
        As they are kept, so that a file has the colours of the view.
    """
    server = open_server("127.0.0.1", 0, title)
    try:
        scene = Scene(server, area, moments[0])
        scene.draw(moments[0], shown, scales)
        serializer = server.get_scene_serializer()
        for before, moment in pairwise(moments):
            serializer.insert_sleep(max(0.0, moment.time_s - before.time_s))
            scene.draw(moment, shown, scales)
        page = serializer.as_html(dark_mode=True)
    finally:
        server.stop()
    when = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(moments[-1].time_s))
    words = (
        '<div style="position:fixed;left:1em;bottom:1em;z-index:10;width:19em;padding:0.5em 0;'
        "border-radius:6px;background:rgba(27,31,36,0.85);color:#e8ebef;"
        'font-family:system-ui,sans-serif">'
        f'<div style="padding:0 0.7em;font-weight:600">{escape(title)}: {escape(shown.quantity)}'
        f'</div><div style="padding:0 0.9em;font-size:0.78em;opacity:0.75">{when}, cycle '
        f"{moments[-1].record['cycle']}</div>{legend_html(shown.quantity, scales)}"
        f"{arrows_html(scales)}</div>"
    )
    head, found, tail = page.rpartition("</body>")
    return f"{head}{PAGE_MARK}{words}{found}{tail}"
