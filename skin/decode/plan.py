"""What a scene needs of the decoder: decided once, from the topology and what is wanted."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skin.errors import OptionError, check_choice, check_flag, check_number, shown
from skin.options import DTYPES, ESTIMATORS, wanted
from skin.state import ARRAY_WANTS, UNIT_WANTS
from topology import CHANNELS, Topology

__all__ = ["HOLD_S", "LOOK_CYCLES", "DecodeOptions", "Plan"]

HOLD_S = 0.05
"""How long a temperature is held where blocks without load are skipped [assumed]. A gel that warms
by 1 K/s is then shown 0.05 °C late, which is its noise; the film lags by seconds."""

LOOK_CYCLES = 4
"""Cycles, at least, from one look at units without load to the next."""

TANGENTIAL = ("force", "tangential", "theta", "displacement")
FORCES = ("force", "tangential", "theta")
NEEDS = {
    "temperature": ("gel",),
    **dict.fromkeys(TANGENTIAL, ("frequency", "bx", "by")),
    "sigma": (),
    "field": ("bx", "by"),
    "test_ratio": (),
}


class DecodeOptions(NamedTuple):
    """What a decoder is asked for.

    Attributes
    ----------
    want : collection of str, or None
        Of `skin.state.UNIT_WANTS`; all of them if None.
    estimator, dtype, sweeps, ambient, creep
        As of `skin.options.Options`. The estimator `sine` is the paper's, R = asin(|B| / M0) / k
        (eq. 1); `field-angle` is a polynomial of psi = atan2(|B|, Bz) and the depth: it has no
        crest, and neither the temperature of the magnet nor the gain of the chip is in it.
    skip : bool
        Leave out what a scene does not need. Blocks of 16 units of which none is pressed by more
        than 2.9 sigma show NaN for all that is tangential and the flag IDLE; blocks whose counts
        and flags are those of the cycle before keep its results. All else is what a decoder without
        it shows that holds temperatures as long, to the bit; but with `ambient`, whose votes are
        fewer then.
    consistency : bool or None
        Hold the field against its model, and flag MAGNETIC_ANOMALY where a magnet or steel bends
        it; it needs Bz and a table, and is done where all units have them if None.
    temperature_every : int or None
        Cycles from one temperature to the next: it is held between, as is what is compensated by
        it. If None 1, or what `HOLD_S` lasts with `skip`.
    """

    want: Collection[str] | None = None
    estimator: str | None = None
    dtype: str = "float32"
    consistency: bool | None = None
    temperature_every: int | None = None
    skip: bool = False
    sweeps: int = 1
    ambient: bool = True
    creep: bool = True


@dataclass(frozen=True, slots=True)
class Plan:
    """What is compiled and done in a cycle; plain data, and `print` shows it.

    Attributes
    ----------
    quantities : tuple of str
        Of `skin.state.UNIT_WANTS`, without "sigma".
    sigma : bool
        One-sigma of each of them, but of the field.
    theta_correction : bool
        Correct directions by tables: a unit has one.
    film_centre : bool
        Take off where films sit beside their chips' axes: a unit has such a film.
    film_compensation, chip_compensation, chip_lags : bool
        Films, the neighbours' among them, and Hall chip have a drift that matters here; chips
        follow the gel, as the wire does not carry their temperature.
    estimator, consistency, dtype, temperature_every, skip, sweeps, ambient, creep
        As of `DecodeOptions`, decided; `sweeps` and `ambient` where anything of the field is
        wanted, `creep` where a force is and a unit has terms.
    """

    quantities: tuple[str, ...]
    sigma: bool
    estimator: str
    consistency: bool
    theta_correction: bool
    film_centre: bool
    film_compensation: bool
    chip_compensation: bool
    chip_lags: bool
    dtype: str
    temperature_every: int
    skip: bool
    sweeps: int
    ambient: bool
    creep: bool

    @classmethod
    def of(cls, topology: Topology, options: DecodeOptions) -> Plan:
        """The shortest plan for a scene.

        Raises
        ------
        OptionError
            No such quantity, estimator or type; or the wire of a unit does not carry what is
            needed.
        """
        p = topology.parameters
        names = _wanted(topology, options.want)
        needed = topology.enabled & ~topology.counts_only
        estimator, consistent = _inversion(topology, options, needed)
        if type(options.sweeps) is not int or options.sweeps not in (0, 1, 2):
            raise OptionError(f"sweeps: must be 0, 1 or 2; got {shown(options.sweeps)}")
        for name in ("skip", "ambient", "creep"):
            check_flag(name, getattr(options, name))
        if names.isdisjoint((*TANGENTIAL, "field")):
            options = options._replace(sweeps=0, ambient=False)
        looped = options.sweeps > 0 or options.ambient
        tangential = looped or not names.isdisjoint(TANGENTIAL)
        field = options.ambient or "field" in names
        tangential = tangential or (consistent and "test_ratio" in names)
        consistent = consistent and tangential

        magnet = tangential and (estimator == "sine" or consistent)
        gain = p["hall_gain_per_k"].any() and (magnet or field or options.sweeps > 0)
        drift = any(p[f"hall_drift_{axis}_ut_per_k"].any() for axis in "xyz")
        chip = bool(gain or drift) and (tangential or field)
        gel, own = (topology.wired[CHANNELS.index(name)] for name in ("gel", "hall_temperature"))
        relaxes = any(p[f"{law}_creep_relative"].any() for law in ("normal", "shear"))
        film = (magnet or options.sweeps) and (p["film_drift_per_k"] * gel).any()
        return cls(
            quantities=tuple(name for name in UNIT_WANTS if name in names - {"sigma"}),
            sigma="sigma" in names,
            estimator=estimator,
            consistency=consistent,
            theta_correction=tangential and bool(p["theta_correction_rad"].any()),
            film_centre=tangential and bool(p["film_x_mm"].any() or p["film_y_mm"].any()),
            film_compensation=bool(film),
            chip_compensation=chip,
            chip_lags=bool(chip and (gel & ~own).any()),
            dtype=_real(options.dtype),
            temperature_every=_cycles_held(topology, options),
            skip=options.skip,
            sweeps=options.sweeps,
            ambient=options.ambient,
            creep=bool(options.creep and relaxes and not names.isdisjoint(FORCES)),
        )

    @property
    def reads_field(self) -> bool:
        """Whether anything that is decoded needs the field of the chips."""
        return (
            self.sweeps > 0
            or self.ambient
            or not {*TANGENTIAL, "field"}.isdisjoint(self.quantities)
        )

    @property
    def looks_every(self) -> int:
        """Cycles from one estimate of the ambient field to the next; with `skip`, units without
        load are looked at for it alone."""
        return max(self.temperature_every, LOOK_CYCLES) if self.skip else 1

    def __str__(self) -> str:
        """One line for each decision."""
        rows = dataclasses.asdict(self)
        rows["quantities"] = ", ".join(self.quantities) or "none"
        shown = {True: "yes", False: "no"}
        width = max(map(len, rows))
        return "\n".join(
            f"{name.replace('_', ' '):<{width}}  "
            f"{shown[value] if isinstance(value, bool) else value}"
            for name, value in rows.items()
        )


def _inversion(topology: Topology, options: DecodeOptions, needed: np.ndarray) -> tuple[str, bool]:
    """The estimator, and whether the field is held against its model."""
    upright = topology.wired[CHANNELS.index("bz")] | ~needed
    tabled = topology.parameters["field_angle_mm"].any(axis=0) | ~needed
    angled = bool((upright & tabled).all())
    estimator = options.estimator
    if estimator is None:
        estimator = "field-angle" if angled else "sine"
    else:
        check_choice("estimator", estimator, ESTIMATORS)
    if estimator == "field-angle":
        _require_bz(topology, upright, "the estimator 'field-angle'")
    if options.consistency is not None:
        check_flag("consistency", options.consistency)
    if options.consistency:
        _require_bz(topology, upright, "consistency")
        if not tabled.all():
            unit = topology.unit_names[int(np.argmin(tabled))]
            raise OptionError(f"{unit}: must have 'field_angle_mm' for consistency; got none")
    return estimator, angled if options.consistency is None else options.consistency


def _cycles_held(topology: Topology, options: DecodeOptions) -> int:
    """Cycles from one temperature to the next."""
    if options.temperature_every is None:
        return max(1, int(HOLD_S * topology.cycle_rate_hz)) if options.skip else 1
    check_number("temperature_every", options.temperature_every, 1, 1_000_000, whole=True)
    return options.temperature_every


def _require_bz(topology: Topology, upright: np.ndarray, what: str) -> None:
    if not upright.all():
        unit = topology.unit_names[int(np.argmin(upright))]
        raise OptionError(
            f"{unit}: must have 'bz' on the wire for {what}; got a layout without it"
        )  # fmt: skip


def _real(dtype: str) -> str:
    try:
        found = np.dtype(dtype).name
    except (TypeError, ValueError, SyntaxError):
        raise OptionError.unknown("dtype", dtype, DTYPES) from None
    if found not in DTYPES:
        raise OptionError.unknown("dtype", found, DTYPES)
    return found


def _wanted(topology: Topology, want: Collection[str] | None) -> frozenset[str]:
    """The wanted quantities, each known and each with its channels on the wire of every unit."""
    found = wanted(UNIT_WANTS if want is None else want)
    for name in sorted(found.intersection(ARRAY_WANTS)):
        raise OptionError(
            f"want: must be of the units, one of {', '.join(map(repr, UNIT_WANTS))}; "
            f"got {name!r}, which is of the array: use skin.open"
        )
    needed = topology.enabled & ~topology.counts_only
    for name in UNIT_WANTS:
        for channel in NEEDS[name] if name in found else ():
            missing = needed & ~topology.wired[CHANNELS.index(channel)]
            if missing.any():
                unit = topology.unit_names[int(np.argmax(missing))]
                raise OptionError(f"{unit}: must have {channel!r} on the wire to decode {name!r}; "
                                  "got a layout without it")  # fmt: skip
    return found
