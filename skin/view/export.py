"""One or several snapshots as a self-contained HTML file."""

from __future__ import annotations

import time
from collections.abc import Sequence
from html import escape
from itertools import pairwise

from skin.view.history import Moment
from skin.view.kinds import PAGE_MARK
from skin.view.layout import Layout
from skin.view.legend import arrows_html, legend_html
from skin.view.scene import Scales, Scene, Shown
from skin.view.server import open_server

__all__ = ["EXPORTED_S", "as_html"]

EXPORTED_S = 10.0
"""Duration of an animation."""


def as_html(moments: Sequence[Moment], layout: Layout, shown: Shown, scales: Scales) -> str:
    """Snapshots as a page that plays them, with the colour scale.

    They are rendered on a private server that ends afterwards: a live view is not affected.

    Parameters
    ----------
    moments : sequence of Moment
        One or more, in order.
    layout : Layout
    shown : Shown
    scales : Scales
        Kept by the view, so that a file has its colours.
    """
    if layout.links is not None:
        layout.links.wait()
    server = open_server("127.0.0.1", 0, layout.title)
    try:
        scene = Scene(server, layout, moments[0])
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
        '<div style="position:fixed;left:1em;top:1em;pointer-events:none;z-index:10;width:19em;'
        "padding:0.5em 0;border-radius:6px;background:rgba(27,31,36,0.85);color:#e8ebef;"
        'font-family:system-ui,sans-serif">'
        f'<div style="padding:0 0.7em;font-weight:600">{escape(layout.title)}: '
        f'{escape(shown.quantity)}</div><div style="padding:0 0.9em;font-size:0.78em;opacity:0.75">'
        f"{when}, cycle {moments[-1].record['cycle']}</div>{legend_html(shown.quantity, scales)}"
        f"{arrows_html(scales)}</div>"
    )
    head, found, tail = page.rpartition("</body>")
    return f"{head}{PAGE_MARK}{words}{found}{tail}"
