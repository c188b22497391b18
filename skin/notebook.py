"""What a notebook shows of a skin: a small picture of the units, as SVG.

Units lie as they are, seen along the direction in which the skin is thinnest; colour is the normal
force, and a cross is a unit that must not be trusted.
"""

from __future__ import annotations

from html import escape

import numpy as np

from topology import Topology

__all__ = ["map_svg", "with_map"]

WIDTH, HEIGHT, MARGIN = 300.0, 200.0, 6.0
"""Points of the largest picture, and around the units [assumed]."""
STOPS = np.array([[253, 234, 69], [187, 175, 113], [124, 123, 120], [59, 73, 108], [0, 34, 78]])
"""Colours of cividis, light to dark: even steps also for the colour-blind [Nuñez et al.,
PLOS ONE 13 (2018)]."""
UNTOUCHED, WRONG = "#eceef1", "#d55e00"
LEAST_N = 1.0
"""Normal force at the dark end of the scale, at least [assumed]."""


def colour(share: float) -> str:
    """Colour of a share of the scale, from 0 to 1.

    Examples
    --------
    >>> colour(0.0), colour(1.0)
    ('#fdea45', '#00224e')
    """
    at = np.clip(share, 0.0, 1.0) * (len(STOPS) - 1)
    rgb = [round(np.interp(at, np.arange(len(STOPS)), column)) for column in STOPS.T]
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
        Units that have a colour.
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
        told = f"{load[i]:.2f} N" if trusted[i] else "not to be trusted"
        parts.append(
            f'<circle cx="{left[i]:.1f}" cy="{top[i]:.1f}" r="{size:.1f}" fill="{fill}">'
            f"<title>{escape(name)}: {told}</title></circle>"
        )
        if not trusted[i]:
            d = 0.6 * size
            parts.append(
                f'<path d="M{left[i] - d:.1f} {top[i] - d:.1f}l{2 * d:.1f} {2 * d:.1f}m0 '
                f'{-2 * d:.1f}l{-2 * d:.1f} {2 * d:.1f}" stroke="{WRONG}" stroke-width="1.5"/>'
            )
    return "".join([*parts, "</svg>"])


def with_map(text: str, svg: str, most_n: float | None = None) -> str:
    """A line of text over a picture, as HTML; `most_n` tells what the darkest colour is."""
    scale = "" if most_n is None else (
        f"<br><small>normal force, light to dark: 0 to {max(most_n, LEAST_N):.2f} N; "
        "crossed: not to be trusted</small>"
    )  # fmt: skip
    return f"<div><code>{escape(text)}</code><br>{svg}{scale}</div>"
