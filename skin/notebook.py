"""Picture of a skin in notebooks: a small map of the units, as SVG.

Units are seen along the direction in which the skin is thinnest; colour is the normal force, and a
cross marks a unit that is not valid.
"""

from __future__ import annotations

from html import escape

import numpy as np

from skin.cividis import cividis
from topology import Topology

__all__ = ["map_svg", "with_map"]

WIDTH, HEIGHT, MARGIN = 300.0, 200.0, 6.0
"""Points of the largest picture, and around the units [assumed]."""
UNTOUCHED, WRONG = "#eceef1", "#d55e00"
LEAST_N = 1.0
"""Lower bound of the normal force at the dark end of the scale [assumed]."""


def colour(share: float) -> str:
    """Colour at a position on the scale, from 0 (light) to 1 (dark).

    Examples
    --------
    >>> colour(0.0), colour(1.0)
    ('#fee838', '#00224e')
    """
    rgb = np.rint(cividis(1.0 - share)).astype(int).tolist()
    return "#" + "".join(f"{value:02x}" for value in rgb)


def map_svg(
    topology: Topology, normal_n: np.ndarray, trusted: np.ndarray, touched: np.ndarray
) -> str:
    """A map of the units, as an SVG element.

    Parameters
    ----------
    topology : Topology
    normal_n : ndarray, shape (n,)
        Normal force; NaN where it is not known.
    trusted : ndarray, shape (n,), bool
        Units whose reading is valid; the others are crossed out.
    touched : ndarray, shape (n,), bool
        Units that are coloured.
    """
    centred = topology.position - topology.position.mean(axis=1, keepdims=True)
    axes = np.linalg.svd(centred, full_matrices=True)[0][:, :2].T
    axes *= np.sign(axes[np.arange(2), np.abs(axes).argmax(axis=1)])[:, np.newaxis]
    x, y = axes @ centred
    radius = float(np.sqrt(np.median(topology.area) / np.pi))
    wide, high = (float(np.ptp(values)) + 2.0 * radius for values in (x, y))
    scale = min((WIDTH - 2.0 * MARGIN) / wide, (HEIGHT - 2.0 * MARGIN) / high)
    left, top = scale * (x - x.min() + radius) + MARGIN, scale * (y.max() - y + radius) + MARGIN
    load = np.nan_to_num(normal_n)
    most = max(float(load[trusted].max(initial=0.0)), LEAST_N)
    width, height = scale * wide + 2.0 * MARGIN, scale * high + 2.0 * MARGIN
    size = 0.92 * scale * radius
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}">']
    for i, name in enumerate(topology.unit_names):
        share = load[i] / most
        fill = colour(share) if trusted[i] and touched[i] else UNTOUCHED
        label = f"{load[i]:.2f} N" if trusted[i] else "not valid"
        parts.append(
            f'<circle cx="{left[i]:.1f}" cy="{top[i]:.1f}" r="{size:.1f}" fill="{fill}">'
            f"<title>{escape(name)}: {label}</title></circle>"
        )
        if not trusted[i]:
            d = 0.6 * size
            parts.append(
                f'<path d="M{left[i] - d:.1f} {top[i] - d:.1f}l{2 * d:.1f} {2 * d:.1f}m0 '
                f'{-2 * d:.1f}l{-2 * d:.1f} {2 * d:.1f}" stroke="{WRONG}" stroke-width="1.5"/>'
            )
    return "".join([*parts, "</svg>"])


def with_map(text: str, svg: str, most_n: float | None = None) -> str:
    """A line of text over a picture, as HTML; `most_n` is the force at the darkest colour."""
    scale = "" if most_n is None else (
        f"<br><small>normal force, light to dark: 0 to {max(most_n, LEAST_N):.2f} N; "
        "crossed: not valid</small>"
    )  # fmt: skip
    return f"<div><code>{escape(text)}</code><br>{svg}{scale}</div>"
