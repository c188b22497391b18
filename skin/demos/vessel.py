"""Vessel: a cup or a beaker of water, heated by a flame or filled with hot water.

The true state: well mixed water, warmed by a flame and hot water and cooled by the room, and the
outer face of the wall, which lags it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from skin.errors import check_numbers

__all__ = ["Vessel", "VesselSettings"]

WATER_J_PER_KG_K, GLASS_J_PER_KG_K = 4184.0, 830.0
"""Heat capacities [tables]."""


@dataclass(frozen=True)
class VesselSettings:
    """Parameters of a vessel.

    Attributes
    ----------
    glass_kg, water_kg : float
        Before pouring.
    water_c, room_c : float
    wall_lag_s : float
        Of the outer face behind the water.
    wall_share : float
        Fraction of the difference between water and room that the outer face reaches.
    loss_w_per_k : float
        To the room.
    flame_lag_s, tap_lag_s : float
        Lags of a flame's power and of a flow behind their settings.
    """

    glass_kg: float = 0.18
    water_kg: float = 0.11
    water_c: float = 20.0
    room_c: float = 24.0
    wall_lag_s: float = 1.0
    wall_share: float = 1.0
    loss_w_per_k: float = 0.5
    flame_lag_s: float = 0.3
    tap_lag_s: float = 0.1

    def __post_init__(self) -> None:
        check_numbers(1e-3, 100.0, glass_kg=self.glass_kg)
        check_numbers(0.0, 100.0, water_kg=self.water_kg, loss_w_per_k=self.loss_w_per_k)
        check_numbers(1e-3, 1e3, wall_lag_s=self.wall_lag_s, flame_lag_s=self.flame_lag_s,
                      tap_lag_s=self.tap_lag_s)  # fmt: skip
        check_numbers(0.0, 1.0, wall_share=self.wall_share)


class Vessel:
    """State of a vessel over time.

    Attributes
    ----------
    water_kg, water_c, wall_c : float
    poured_kg : float
        Since the start.
    power_w, flow_kg_per_s : float
        Actual power of the flame and flow of the tap.
    rate_c_per_s : float
        Rise of the water's temperature.

    Examples
    --------
    >>> kettle = Vessel(VesselSettings(loss_w_per_k=0.0))
    >>> for _ in range(1000):
    ...     kettle.step(0.1, power_w=10.0)
    >>> round(kettle.water_c, 1)  # 1000 J, less the flame's lag, into 610 J/K
    21.6
    """

    def __init__(self, settings: VesselSettings) -> None:
        self.settings = settings
        self.water_kg, self.water_c = settings.water_kg, settings.water_c
        self.wall_c = self._wall_goal()
        self.poured_kg = self.power_w = self.flow_kg_per_s = self.rate_c_per_s = 0.0

    @property
    def mass_kg(self) -> float:
        """Total mass."""
        return self.settings.glass_kg + self.water_kg

    def step(
        self, dt_s: float, *, power_w: float = 0.0, flow_kg_per_s: float = 0.0, hot_c: float = 0.0
    ) -> None:
        """Advance by a short time, with these settings of flame and tap."""
        ask = self.settings
        self.power_w += (power_w - self.power_w) * -math.expm1(-dt_s / ask.flame_lag_s)
        self.flow_kg_per_s += (flow_kg_per_s - self.flow_kg_per_s) * -math.expm1(
            -dt_s / ask.tap_lag_s
        )
        gained = self.flow_kg_per_s * dt_s
        capacity = WATER_J_PER_KG_K * self.water_kg + GLASS_J_PER_KG_K * ask.glass_kg
        heat_w = self.power_w - ask.loss_w_per_k * (self.water_c - ask.room_c)
        heat_w += WATER_J_PER_KG_K * self.flow_kg_per_s * (hot_c - self.water_c)
        self.rate_c_per_s = heat_w / (capacity + WATER_J_PER_KG_K * gained)
        self.water_c += self.rate_c_per_s * dt_s
        self.water_kg += gained
        self.poured_kg += gained
        self.wall_c += (self._wall_goal() - self.wall_c) * -math.expm1(-dt_s / ask.wall_lag_s)

    def _wall_goal(self) -> float:
        ask = self.settings
        return ask.room_c + ask.wall_share * (self.water_c - ask.room_c)
