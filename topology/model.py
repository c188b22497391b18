"""Unit models: every constant of an F3T unit, with its unit in its name and its source in its doc.

A `UnitModel` describes a *nominal* unit. A topology file may override any parameter for a model, a
calibration file for a single unit; the loaded `Topology` has the results as one array a parameter
(`Topology.parameters`). The simulator converts these parameters to counts, the decoder to the
coefficients of its kernel; neither has constants of its own.

Sources: [paper] is in Yang et al., "F3T: A soft tactile unit with 3D force and temperature
mathematical decoupling ability for robots"; [derived] follows from the paper's figures; [assumed]
is a preset chosen here because the paper has none; [calibrated] is a property of the single unit,
without effect until a calibration sets it.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

__all__ = [
    "CREEP_TERMS",
    "FIELD_ANGLE_TERMS",
    "MODELS",
    "PARAMETERS",
    "SIGMAS",
    "TABLES",
    "THETA_KNOTS",
    "VARIANCE_TERMS",
    "ZEROS",
    "UnitModel",
]

THETA_KNOTS = 16
"""Knots of the direction-correction table, equally spaced over [-pi, pi), periodic."""
FIELD_ANGLE_TERMS = 16
"""Coefficients of R(psi, H): entry 4 i + j is of ``psi**(2 i + 1) * H**j``, rad and mm."""
VARIANCE_TERMS = 6
"""Coefficients of a film's variance over R and H in mm: entry 2 i + j is of R^(3 i) H^(2 j)."""
CREEP_TERMS = 3
"""Terms of a relaxation; unused ones have weight 0."""
CREEP = ("relative", "s", "sigma_relative")
"""Parts of it, after ``normal_creep_`` and ``shear_creep_``."""
TABLES = {
    "theta_correction_rad": THETA_KNOTS,
    "field_angle_mm": FIELD_ANGLE_TERMS,
    "field_angle_variance_relative": VARIANCE_TERMS,
    **{f"{law}_creep_{part}": CREEP_TERMS for law in ("normal", "shear") for part in CREEP[:2]},
}
"""Parameters that are tables, and their lengths; an empty one stands for zeros."""


def _doc(text: str, least: float | None = None, most: float | None = None) -> Meta:
    return Meta(description=text, ge=least, le=most)


_Shares = tuple[Annotated[float, Meta(ge=0, le=10)], ...]
_Times = tuple[Annotated[float, Meta(ge=0, le=1e6)], ...]
_LAW_LEFT = _doc(
    "Additional one-sigma in newton: law of another form, at most the force itself [calibrated]",
    0, 1000
)  # fmt: skip
_CREEP_LEFT = _doc("One-sigma that the terms leave, of what relaxes [calibrated]", 0, 1)


class UnitModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters of one kind of unit; the defaults are the built-in model `f3t-paper`.

    Names end in the unit of the value; `_mm`, `_ut` (microtesla), `_hz`, `_ua` (microampere), `_c`
    (degree Celsius), `_k` (kelvin, of differences), `_n` (newton), `_rad`, `_s`.
    """

    # -- temperature: gel current ----------------------------------------------------------------
    gel_current_20c_ua: Annotated[
        float, _doc("Gel current at 20 °C [assumed; only ratios matter]", 1e-3, 1e6)
    ] = 10.0
    gel_current_ratio: Annotated[
        float,
        _doc(
            "Current at 80 °C over current at 20 °C, exponential law (Fig. 3a) [assumed]", 1.01, 1e4
        ),
    ] = 12.0
    gel_bend_c: Annotated[
        float,
        _doc("b of T = 20 + 60 x + b x (x - 1) + c x (x - 1) (2 x - 1), x being ln(I / I20) over "
             "ln(ratio) [calibrated]", -200, 200),
    ] = 0.0  # fmt: skip
    gel_twist_c: Annotated[float, _doc("c of the same [calibrated]", -200, 200)] = 0.0
    temperature_min_c: Annotated[
        float, _doc("Lower end of the calibrated temperature range [assumed]", -100, 300)
    ] = 15.0
    temperature_max_c: Annotated[
        float,
        _doc(
            "Upper end of the calibrated range; the PVA task stays below 90 °C [paper]", -100, 300
        ),
    ] = 95.0
    gel_noise_relative: Annotated[
        float, _doc("One-sigma noise of the gel current, relative (0.05 °C) [assumed]", 0, 1)
    ] = 0.002

    # -- normal force: timer frequency -----------------------------------------------------------
    frequency_rest_hz: Annotated[
        float, _doc("Timer frequency of the unloaded unit, tared per unit [assumed]", 1, 1e5)
    ] = 4500.0
    frequency_slope_hz_per_mm: Annotated[
        float, _doc("Fall of the frequency per mm pressed (Fig. 3d) [paper]", 1, 1e5)
    ] = 900.0
    normal_break_hz: Annotated[
        float,
        _doc(
            "Frequency fall at which the stiffness changes; gives 7.2 N at 2 mm [derived]", 0, 1e5
        ),
    ] = 540.0
    normal_soft_n_per_hz: Annotated[
        float, _doc("Normal force per Hz below the break (Fig. 3e) [paper]", 1e-7, 0.1)
    ] = 1.0 / 600.0
    normal_stiff_n_per_hz: Annotated[
        float, _doc("Normal force per Hz above the break (Fig. 3e) [paper]", 1e-7, 0.1)
    ] = 1.0 / 200.0
    normal_cubic_n_per_hz3: Annotated[
        float,
        _doc("Normal force per cube of what the fall is above the break, which it adds to that of "
             "both slopes: rubber stiffens; 0: none [calibrated]", 0, 1e-3),
    ] = 0.0  # fmt: skip
    normal_max_n: Annotated[
        float, _doc("Upper end of the calibrated normal force [paper]", 1e-3, 1000)
    ] = 7.2
    frequency_noise_hz: Annotated[
        float,
        _doc("One-sigma frequency noise: 0.01 N below 1 N, 0.03 N above [derived]", 0, 1e4),
    ] = 6.0

    # -- tangential force: lateral field of the Halbach film -------------------------------------
    field_wavenumber_rad_per_mm: Annotated[
        float, _doc("k of M_r = M0 sin(k R) (eq. 1); crest at 2.5 mm [derived]", 1e-3, 100)
    ] = math.pi / 5.0
    field_amplitude_ut: Annotated[
        float, _doc("M0 at the reference depth, 25 °C [derived from Fig. 3i]", 1, 1e6)
    ] = 11073.0
    field_reference_mm: Annotated[
        float, _doc("Pressed depth at which the amplitude is given [paper]", 0, 20)
    ] = 2.0
    field_growth_per_mm: Annotated[
        float, _doc("d ln M0 / dH, from magnet field theory [derived]", 1e-3, 20)
    ] = 0.72
    field_growth_per_mm2: Annotated[
        float,
        _doc("Quadratic part of ln M0(H) about the reference depth [calibrated]", -20, 20),
    ] = 0.0
    field_vertical_ratio: Annotated[
        float, _doc("Bz on the axis over M0: Bz = ratio * M0 cos(k R) [derived]", 1e-3, 1000)
    ] = 1.65
    shear_soft_n_per_mm: Annotated[
        float, _doc("Ft per mm of tangential displacement: 1 N at 2 mm [paper]", 1e-4, 1000)
    ] = 0.5
    shear_break_mm: Annotated[
        float, _doc("Displacement at which the shear law stiffens [derived]", 1e-3, 100)
    ] = 2.0
    shear_stiff_n_per_mm: Annotated[
        float, _doc("Slope added beyond the break: 2 N at 2.348 mm [derived]", 0, 1e4)
    ] = 2.375
    shear_cubic_n_per_mm3: Annotated[
        float,
        _doc("Ft per cube of what the displacement is beyond the break, added; 0: none "
             "[calibrated]", 0, 1e4),
    ] = 0.0  # fmt: skip
    shear_gain_per_mm: Annotated[
        float,
        _doc(
            "Relative change of Ft(R) per mm of depth, about the reference depth [assumed]", -10, 10
        ),
    ] = 0.0
    tangential_max_mm: Annotated[
        float, _doc("Upper end of the one-to-one range of R [paper]", 1e-3, 100)
    ] = 2.5
    field_noise_ut: Annotated[
        float,
        _doc("One-sigma noise of each field axis: 0.01 N at 2 mm depth [derived]", 0, 1e5),
    ] = 105.0
    field_angle_mm: Annotated[
        tuple[Annotated[float, Meta(ge=-1000, le=1000)], ...],
        _doc(
            f"R = sum c[4 i + j] psi^(2 i + 1) H^j, psi = atan2(M_r, Bz) in rad, H in mm: "
            f"{FIELD_ANGLE_TERMS} coefficients in mm; empty: not known [derived from magnet "
            "theory, within 0.7 µm to H = 2.5 mm and R = 3 mm]"
        ),
    ] = (
        2.594018, 0.09835543, -0.03409520, 0.005782639,
        -0.4034802, -0.02441805, -0.0006012635, 0.0001037254,
        0.1027639, 0.004771070, 0.001475361, -0.0002934835,
        -0.01345522, -0.0008990075, -0.0002320453, 0.00006145529,
    )  # fmt: skip
    field_angle_max_mm: Annotated[
        float,
        _doc("Upper end of the range of R from the angle of the field [derived]", 1e-3, 100),
    ] = 3.0

    film_x_mm: Annotated[
        float,
        _doc(
            "Middle of the film off the chip's axis, x: off the displacement [calibrated]", -10, 10
        ),
    ] = 0.0
    film_y_mm: Annotated[float, _doc("The same along y [calibrated]", -10, 10)] = 0.0

    # -- relaxation: F = F_e + sum w_j integral exp(-(t - s) / T_j) dF_e(s), F_e by these laws ----
    normal_creep_relative: Annotated[
        _Shares, _doc("w_j of the normal force, 0 for fewer terms; empty: none [calibrated]")
    ] = ()
    normal_creep_s: Annotated[_Times, _doc("T_j of the normal force, rising [calibrated]")] = ()
    normal_creep_sigma_relative: Annotated[float, _CREEP_LEFT] = 0.0
    shear_creep_relative: Annotated[_Shares, _doc("w_j of the tangential force [calibrated]")] = ()
    shear_creep_s: Annotated[_Times, _doc("T_j of the tangential force [calibrated]")] = ()
    shear_creep_sigma_relative: Annotated[float, _CREEP_LEFT] = 0.0

    # -- temperature of film and Hall chip -------------------------------------------------------
    film_drift_per_k: Annotated[
        float,
        _doc("Relative change of M0 per kelvin of the film [assumed, NdFeB]", -0.1, 0.1),
    ] = -0.0011
    film_reference_c: Annotated[
        float, _doc("Film temperature at which M0 holds [assumed]", -100, 300)
    ] = 25.0
    film_lag_s: Annotated[
        float,
        _doc("Time constant of the film behind the gel, 1-D heat model [assumed]", 0, 1e5),
    ] = 7.0
    hall_gain_per_k: Annotated[
        float,
        _doc("Relative change of the Hall chip's gain per kelvin (Fig. 3l) [assumed]", -0.1, 0.1),
    ] = 0.0005
    hall_reference_c: Annotated[
        float, _doc("Chip temperature of zero drift [assumed]", -100, 300)
    ] = 25.0
    hall_lag_s: Annotated[
        float,
        _doc(
            "Time constant of the chip behind the gel, used where the wire does not carry the "
            "chip's own temperature [assumed]",
            0,
            1e5,
        ),
    ] = 190.0
    hall_offset_x_ut: Annotated[
        float, _doc("Offset of Bx at the reference temperature [calibrated]", -1e6, 1e6)
    ] = 0.0
    hall_offset_y_ut: Annotated[
        float, _doc("Offset of By at the reference temperature [calibrated]", -1e6, 1e6)
    ] = 0.0
    hall_offset_z_ut: Annotated[
        float, _doc("Offset of Bz at the reference temperature [calibrated]", -1e6, 1e6)
    ] = 0.0
    axial_rest_ut: Annotated[
        float,
        _doc(
            "Bz of the untouched unit in its place beyond offset and own film: what neighbours at "
            "rest and the ambient field of a tare add [calibrated]",
            -1e6,
            1e6,
        ),
    ] = 0.0
    tare_rest_x_ut: Annotated[
        float,
        _doc(
            "Bx of resting neighbours that a zero taken in place leaves out, less that of magnet "
            "theory: of the stencil that it was taken with [calibrated]",
            -1e6,
            1e6,
        ),
    ] = 0.0
    tare_rest_y_ut: Annotated[
        float, _doc("By of resting neighbours, in the same way [calibrated]", -1e6, 1e6)
    ] = 0.0
    hall_drift_x_ut_per_k: Annotated[
        float, _doc("Drift of the Bx offset [calibrated]", -1e4, 1e4)
    ] = 0.0
    hall_drift_y_ut_per_k: Annotated[
        float, _doc("Drift of the By offset [calibrated]", -1e4, 1e4)
    ] = 0.0
    hall_drift_z_ut_per_k: Annotated[
        float, _doc("Drift of the Bz offset [calibrated]", -1e4, 1e4)
    ] = 0.0

    # -- direction -------------------------------------------------------------------------------
    field_xx: Annotated[
        float, _doc("2x2 map of (Bx, By): x from x (harmonics 0-2) [calibrated]", -1000, 1000)
    ] = 1.0
    field_xy: Annotated[float, _doc("2x2 map of (Bx, By): x from y [calibrated]", -1000, 1000)] = (
        0.0
    )
    field_yx: Annotated[float, _doc("2x2 map of (Bx, By): y from x [calibrated]", -1000, 1000)] = (
        0.0
    )
    field_yy: Annotated[float, _doc("2x2 map of (Bx, By): y from y [calibrated]", -1000, 1000)] = (
        1.0
    )
    theta_correction_rad: Annotated[
        tuple[Annotated[float, Meta(ge=-4, le=4)], ...],
        _doc(
            f"Added to theta = atan2(By, Bx): {THETA_KNOTS} knots equally spaced from -pi, "
            "periodic, linear between (Fig. 3j-k, S8); empty: none [calibrated]"
        ),
    ] = ()

    # -- one-sigma of the constants, equal in all readings, in addition to noise: the spread between
    # units, or the residual of a unit's calibration -----------------------------------------------
    temperature_sigma_c: Annotated[
        float,
        _doc("Of the temperature: current and ratio evenly spread by 5 % [assumed]", 0, 100),
    ] = 1.0
    frequency_sigma_hz: Annotated[
        float, _doc("Of the frequency at rest: evenly spread by 2 % [assumed]", 0, 1e5)
    ] = 52.0
    depth_sigma_mm: Annotated[
        float, _doc("Of the depth at a frequency: a law not straight [calibrated]", 0, 100)
    ] = 0.0
    normal_sigma_relative: Annotated[
        float,
        _doc(
            "Of the normal force at a fall of the frequency: slope and break evenly spread by "
            "3 %, stiffness by 5 % [assumed]",
            0,
            100,
        ),
    ] = 0.04
    normal_sigma_n: Annotated[float, _LAW_LEFT] = 0.0
    field_sigma_ut: Annotated[
        float,
        _doc(
            "Of each axis of the field: offsets evenly spread by 150 µT, what neighbours add "
            "[assumed]",
            0,
            1e6,
        ),
    ] = 87.0
    axial_rest_sigma_ut: Annotated[
        float,
        _doc("Of axial_rest_ut; 0 where no tare has measured it [calibrated]", 0, 1e6),
    ] = 0.0
    field_angle_sigma_mm: Annotated[
        float,
        _doc(
            "Of R(psi, H), across R: films evenly off the chip's axis by 0.1 mm, tilted by 1° "
            "[assumed]",
            0,
            100,
        ),
    ] = 0.07
    field_angle_variance_relative: Annotated[
        tuple[Annotated[float, Meta(ge=-1e6, le=1e6)], ...],
        _doc(
            "How the square of field_angle_sigma_mm changes over the range: it is times 1 + sum "
            f"c[2 i + j] R^(3 i) H^(2 j), R and H in mm: {VARIANCE_TERMS} coefficients; empty: the "
            "same everywhere [calibrated]"
        ),
    ] = ()
    field_amplitude_sigma_relative: Annotated[
        float, _doc("Of M0: evenly spread by 5 % [assumed]", 0, 100)
    ] = 0.03
    shear_sigma_relative: Annotated[
        float,
        _doc(
            "Of the tangential force at a displacement: stiffness evenly spread by 5 % [assumed]",
            0,
            100,
        ),
    ] = 0.03
    shear_sigma_n: Annotated[float, _LAW_LEFT] = 0.0

    placement_sigma_mm: Annotated[
        float,
        _doc(
            "Of the place of a unit along each axis: evenly spread by 0.2 mm, as ISO 2768-1 "
            "medium has it for 6 to 30 mm [assumed]",
            0,
            10,
        ),
    ] = 0.12
    placement_sigma_rad: Annotated[
        float,
        _doc(
            "Of its tilt about x and about y: evenly spread by 1°, as ISO 2768-1 medium has it for "
            "sides to 10 mm [assumed]",
            0,
            1,
        ),
    ] = 0.01

    stray_sigma_relative: Annotated[
        float,
        _doc(
            "Of the field that films add at their neighbours' chips, at rest and moved, the own "
            "one being known: films whose radius and wavelength are off by 5 %, thickness and "
            "profile by 20 %; until it is learned (`skin.physics.multipoles`) [derived]",
            0,
            10,
        ),
    ] = 0.25

    # -- geometry and health ---------------------------------------------------------------------
    radius_m: Annotated[float, _doc("Radius of the cylindrical unit [paper]", 1e-4, 1)] = 0.006
    frozen_cycles: Annotated[
        int,
        _doc(
            "Readings for which a channel, or all, may stand still before the unit is frozen, at "
            "least; 0: never [assumed]",
            0,
            1_000_000,
        ),
    ] = 50


MODELS: dict[str, UnitModel] = {"f3t-paper": UnitModel()}
"""Built-in unit models by name."""

PARAMETERS: tuple[str, ...] = UnitModel.__struct_fields__
"""Names of the parameters of a unit."""
SIGMAS = tuple(name for name in PARAMETERS if "_sigma_" in name)
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
