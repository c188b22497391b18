"""Behaviours in closed loop: how well each does on physics that can drop things, and its time.

Each part is a module of this folder of its own, whose figures and targets it explains.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

PARTS = (
    "behaviours_grip", "behaviours_gesture", "behaviours_handover",
)  # fmt: skip
"""Modules with `run(quick)` and `table(figures)`."""


def run(quick: bool) -> dict[str, Any]:
    """Measure; see the parts for what the figures are."""
    return {_name(part): import_module(f"benchmarks.{part}").run(quick) for part in PARTS}


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    return "\n\n".join(
        f"{_name(part)}\n{import_module(f'benchmarks.{part}').table(figures[_name(part)])}"
        for part in PARTS
    )


def _name(part: str) -> str:
    return part.removeprefix("behaviours_")
