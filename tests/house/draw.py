"""The picture of who imports whom: rooms of `skin` by layer over `bus` and `topology`.

The arrows are read from the code; only the places of the boxes are chosen here. An arrow that
others imply is left out: where a imports b, and b imports c, none goes from a to c. What all of
`skin` may import is told once: `bus`, `topology`, and the common rooms.
"""

from __future__ import annotations

from tests.house.imports import COMMON, edges, room_of
from tests.house.sources import ROOT, module_of, sources

PICTURE = ROOT / "docs" / "pictures" / "imports.svg"

PLACES = {
    "cli": (1.6, 0),
    "view": (0.8, 1),
    "behaviours": (4.0, 0),
    "sim/grasping": (3.1, 1),
    "opening": (2.1, 1),
    "io": (1.2, 2),
    "live": (3.1, 2),
    "sinks": (3.7, 5),
    "offline": (0.9, 3),
    "blocks": (0.1, 3.6),
    "compiling": (3.9, 4),
    "pipeline": (1.7, 4),
    "clock": (2.4, 7),
    "calibrate": (1.3, 5),
    "robot": (0.2, 5),
    "contact": (0.4, 6),
    "decode": (1.6, 6),
    "sim": (3.2, 6),
    "arrow": (0.0, 7),
    "physics": (1.2, 7),
    "worker": (3.5, 7),
    "bus": (2.0, 9.1),
    "topology": (2.0, 10.0),
}
"""Column and layer of each box."""
NOTES = {
    "cli": "commands",
    "view": "pictures, live view",
    "arrow": "pyarrow",
    "io": "tables, recordings, topics",
    "sinks": "what sees the cycles",
    "worker": "a process of its own",
    "robot": "joints, mounting",
    "sim/grasping": "a hand in MuJoCo",
    "behaviours": "grip, gestures, handover",
    "opening": "opens the buses",
    "offline": "logs to states",
    "blocks": "many cycles at once",
    "live": "SYNC, pacing, poses",
    "pipeline": "the spine",
    "clock": "time of cycles",
    "calibrate": "fits, tare",
    "compiling": "says what takes long",
    "contact": "clusters, slip",
    "decode": "counts to forces",
    "sim": "bodies, chips",
    "physics": "what decoder and simulator share",
    "bus": "counts from wires",
    "topology": "what hangs where",
}
COLUMN, LAYER, LEFT, TOP = 178, 84, 112, 64
BOX, TALL, WIDE = 148, 48, 820
LAST = 7
"""Lowest layer of `skin`; what all may import stands below it."""


def imported() -> set[tuple[str, str]]:
    """Arrows between the rooms of `skin`. Who imports the package itself opens a skin."""
    told = COMMON | {"bus", "topology"}
    found = {
        (a, "opening" if b == "__init__" else b) for a, b in edges("skin") if not a.startswith("__")
    }
    return {(a, b) for a, b in found if not {a, b} & told}


def reduced(arrows: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Arrows that no others imply, sorted."""
    below: dict[str, set[str]] = {}
    for a, b in arrows:
        below.setdefault(a, set()).add(b)

    def all_below(name: str) -> set[str]:
        return {far for b in below.get(name, ()) for far in (b, *all_below(b))}

    return sorted(
        (a, b) for a, b in arrows if not any(b in all_below(o) for o in below[a] if o != b)
    )


def picture() -> str:
    """The text of the SVG file: the same for the same code."""
    arrows = imported()
    unplaced = {name for arrow in arrows for name in arrow} - PLACES.keys()
    if unplaced:
        raise ValueError(f"PLACES of tests/house/draw.py: must have {', '.join(sorted(unplaced))}")
    middle, foot = LEFT + 2.0 * COLUMN, TOP + (LAST + 1.45) * LAYER
    tall = (LAST + 1.95) * LAYER
    parts = [_rectangle(middle, foot - tall / 2, WIDE + 72, tall, "#fffdf8")]
    parts.append(_text(LEFT - 0.3 * COLUMN, TOP - 14, "skin", 17, "#111"))
    parts.append(_line(middle, foot, middle, _place("bus")[1] - TALL / 2))
    below = _place("bus")[1] + TALL / 2, _place("topology")[1] - TALL / 2
    parts.append(_line(middle, below[0], middle, below[1]))
    parts += [_arrow(a, b) for a, b in reduced(arrows)]
    there = {room_of(module_of(file)) for file in sources("skin")} | {"bus", "topology"}
    parts += [_box(name) for name in PLACES if name in there]
    common = " · ".join(sorted(COMMON))
    x, y = middle, TOP + (LAST + 0.95) * LAYER
    parts.append(_rectangle(x, y, WIDE, TALL, "#f4f4f4", "4 3"))
    parts.append(_text(x, y - 4, common, 13, "#333"))
    parts.append(_text(x, y + 13, "every room may import these", 11, "#777"))
    width, height = 2.0 * middle, _place("topology")[1] + 44
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}" height="{height:g}" font-family="Helvetica, Arial, sans-serif">\n'
        "<title>Who imports whom: arrows point to what is imported</title>\n"
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" '
        'markerHeight="8" orient="auto"><path d="M0 1 10 5 0 9z" fill="#555"/></marker></defs>\n'
        '<rect width="100%" height="100%" fill="white"/>\n'
    )
    return head + "\n".join(parts) + "\n</svg>\n"


def _place(name: str) -> tuple[float, float]:
    column, layer = PLACES[name]
    return LEFT + column * COLUMN, TOP + layer * LAYER


def _arrow(a: str, b: str) -> str:
    (x0, y0), (x1, y1) = _place(a), _place(b)
    aside = 0.22 * max(min(x1 - x0, BOX), -BOX)
    return _line(x0 + aside, y0 + TALL / 2, x1 - aside, y1 - TALL / 2)


def _line(x0: float, y0: float, x1: float, y1: float) -> str:
    line = f'x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"'
    return f'<line {line} stroke="#555" stroke-width="1.4" marker-end="url(#tip)"/>'


def _box(name: str) -> str:
    x, y = _place(name)
    wide = WIDE if name in ("bus", "topology") else BOX + 70 if name == "physics" else BOX
    fill = {"bus": "#e3eefb", "topology": "#e6f4e6"}.get(name, "#fdf3df")
    return "\n".join(
        (_rectangle(x, y, wide, TALL, fill), _text(x, y - 3, name, 15, "#111"),
         _text(x, y + 14, NOTES[name], 11, "#666"))
    )  # fmt: skip


def _rectangle(x: float, y: float, wide: float, tall: float, fill: str, dashes: str = "") -> str:
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    return (
        f'<rect x="{x - wide / 2:g}" y="{y - tall / 2:g}" width="{wide:g}" height="{tall:g}" '
        f'rx="6" fill="{fill}" stroke="#555"{dashed}/>'
    )


def _text(x: float, y: float, words: str, size: int, colour: str) -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{colour}" '
        f'text-anchor="middle" dominant-baseline="middle">{words}</text>'
    )
