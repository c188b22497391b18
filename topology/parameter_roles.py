"""Parameters of units by their role."""

from __future__ import annotations

from topology.model import CREEP

__all__ = ["SIGMAS", "ZEROS"]

SIGMAS = (
    "temperature_sigma_c",
    "frequency_sigma_hz",
    "depth_sigma_mm",
    "normal_sigma_relative",
    "normal_sigma_n",
    "field_sigma_ut",
    "axial_rest_sigma_ut",
    "field_angle_sigma_mm",
    "field_amplitude_sigma_relative",
    "shear_sigma_relative",
    "shear_sigma_n",
    "normal_creep_sigma_relative",
    "shear_creep_sigma_relative",
    "placement_sigma_mm",
    "placement_sigma_rad",
    "stray_sigma_relative",
)
"""Parameters that are uncertainties of others."""
ZEROS = (
    "frequency_rest_hz",
    "frequency_sigma_hz",
    "hall_offset_x_ut",
    "hall_offset_y_ut",
    "hall_offset_z_ut",
    "tare_rest_x_ut",
    "tare_rest_y_ut",
    "field_sigma_ut",
    "axial_rest_ut",
    "axial_rest_sigma_ut",
    "placement_sigma_mm",
    "placement_sigma_rad",
    "stray_sigma_relative",
    "frozen_cycles",
    *(f"{law}_creep_{part}" for law in ("normal", "shear") for part in CREEP),
)
"""Parameters unrelated to a unit's elastic laws: a unit with only these is not calibrated. The
frequency at rest and its sigma come from a tare."""
