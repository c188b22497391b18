"""The Shadow hand of gymnasium-robotics with a skin of 124 units: palm and all five fingers.

Nothing of the package is copied: its model is read where pip has put it (MIT licence).
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

__all__ = ["hand_model", "hand_topology"]

FINGERS = ("ff", "mf", "rf", "lf", "th")
SEGMENTS = {"proximal": (0.0225, 0.010), "middle": (0.0125, 0.008), "distal": (0.012, 0.007)}
"""Middle along the link's z, and radius, metre."""
THUMB = {"proximal": (0.031, 0.013), "middle": (0.018, 0.011), "distal": (0.013, 0.0092)}

HEAD = """format = 1
name = "shadow"
description = "64 units on the palm and 12 on each finger of a Shadow hand"
cycle_rate_hz = 250
sync_id = 0x080

[robot]
model = "{model}"
"""
BUS = """
[[buses]]
name = "{name}"
interface = "memory"
channel = "shadow-{name}"
bitrate = 1_000_000
data_bitrate = 5_000_000
"""
PATCH = """
[[patches]]
name = "{name}"
kind = "grid"
rows = {side}
columns = {side}
pitch_m = 0.012
link = "robot0:{link}"
pose = {{ xyz_m = [{x}, {y}, {z}], rpy_deg = [90, 0, 0] }}
bus = "{bus}"
layout = "f3t-fd64"
first_id = {first}
"""


def hand_model() -> Path | None:
    """The model with an object above the palm; None where gymnasium-robotics is not installed."""
    spec = find_spec("gymnasium_robotics")
    if spec is None or not spec.submodule_search_locations:
        return None
    file = Path(spec.submodule_search_locations[0]) / "envs/assets/hand/manipulate_block.xml"
    return file if file.is_file() else None


def hand_topology(folder: Path, model: Path) -> Path:
    """Write the topology into a folder; its file."""
    palm = PATCH.format(name="palm", side=8, link="palm", x=-0.008, y=-0.0115, z=0.038, bus="palm",
                        first=0x100)  # fmt: skip
    parts = [HEAD.format(model=model), BUS.format(name="palm"), BUS.format(name="fingers"), palm]
    first = 0x100
    for finger in FINGERS:
        segments = THUMB if finger == "th" else SEGMENTS
        for segment, (middle, radius) in segments.items():
            parts.append(PATCH.format(
                name=f"{finger}-{segment}", side=2, link=finger + segment, x=0.0,
                y=-(radius + 0.0005), z=middle, bus="fingers", first=first,
            ))  # fmt: skip
            first += 1
    file = folder / "shadow.toml"
    file.write_text("".join(parts), encoding="utf-8")
    return file
