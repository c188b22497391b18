"""Moves: what a hand at a station can be told by any task."""

from __future__ import annotations

from skin.tasks.play import Does
from skin.tasks.station import Station

__all__ = ["MOVES"]

SPEED_M_PER_S = 0.03
SETTLE_S = 0.3
"""Without a grip before the hand moves [assumed]."""


def _close(station: Station, seconds: float, values: dict[str, float]) -> None:
    station.hand.close()


def _open(station: Station, seconds: float, values: dict[str, float]) -> None:
    station.hand.open()
    station.regripped()


def _move(station: Station, seconds: float, values: dict[str, float]) -> None:
    """To a height, and aside; where nothing is said of one, it stays."""
    speed = values.get("speed_m_per_s", SPEED_M_PER_S)
    goals = {name.removesuffix("_m"): value for name, value in values.items()
             if name in ("lift_m", "aside_m")}  # fmt: skip
    station.hand.go(speed, **goals)


def _hold(station: Station, seconds: float, values: dict[str, float]) -> None:
    """Stay as it is."""


MOVES = {
    "close": Does(_close),
    "open": Does(_open),
    "move": Does(_move, ("lift_m", "aside_m", "speed_m_per_s")),
    "hold": Does(_hold),
}
"""By name."""
