"""What a scene needs of the decoder: decided once, from the topology and what is wanted."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from skin.errors import OptionError
from skin.state import ARRAY_WANTS, UNIT_WANTS, WANTS
from topology import CHANNELS, Topology

__all__ = ["ESTIMATORS", "HOLD_S", "Plan"]

ESTIMATORS = ("sine", "field-angle")
"""Inversions of the tangential field. `sine` is the paper's, R = asin(|B| / M0) / k (eq. 1);
`field-angle` is a polynomial of psi = atan2(|B|, Bz) and the depth: it has no crest, and neither
the temperature of the magnet nor the gain of the chip is in it."""
HOLD_S = 0.05
"""How long a temperature is held where blocks without load are skipped. A gel that warms by 1 K/s
is then shown 0.05 °C late, which is its noise; the film lags by seconds."""

LATERAL = ("force", "tangential", "theta", "displacement")
NEEDS = {
    "temperature": ("gel",),
    **dict.fromkeys(LATERAL, ("frequency", "bx", "by")),
    "sigma": (),
    "field": ("bx", "by"),
}


@dataclass(frozen=True, slots=True)
class Plan:
    """What is compiled and done in a cycle; plain data, and `print` shows it.

    Attributes
    ----------
    quantities : tuple of str
        Of `skin.state.UNIT_WANTS`, without "sigma".
    sigma : bool
        One-sigma of each of them, but of the field.
    estimator : str
        Of `ESTIMATORS`.
    consistency : bool
        Hold the field against its model, for the flag MAGNETIC_ANOMALY.
    theta_table : bool
        Correct directions by tables: a unit has one.
    film_centre : bool
        Take off where films sit beside their chips' axes: a unit has such a film.
    film_compensation, chip_compensation, chip_lags : bool
        Films, the neighbours' among them, and Hall chip have a drift that matters here; chips
        follow the gel, as the wire does not carry their temperature.
    dtype : str
        Of results and arithmetic.
    temperature_every : int
        Cycles from one temperature to the next.
    skip : bool
        Leave out the inversion of units without load, and what did not change.
    sweeps : int
        Predictions of cross-talk a cycle.
    ambient : bool
        Follow the ambient field and the zeros of the units.
    """

    quantities: tuple[str, ...]
    sigma: bool
    estimator: str
    consistency: bool
    theta_table: bool
    film_centre: bool
    film_compensation: bool
    chip_compensation: bool
    chip_lags: bool
    dtype: str
    temperature_every: int
    skip: bool
    sweeps: int
    ambient: bool

    @classmethod
    def of(
        cls,
        topology: Topology,
        want: Collection[str] | None = None,
        *,
        estimator: str | None = None,
        dtype: str = "float32",
        consistency: bool | None = None,
        temperature_every: int | None = None,
        skip: bool = False,
        sweeps: int = 0,
        ambient: bool = False,
    ) -> Plan:
        """The shortest plan for a scene; parameters and errors as of `Decoder`."""
        p = topology.parameters
        wanted = _wanted(topology, want)
        quantities = tuple(name for name in UNIT_WANTS if name in wanted and name != "sigma")
        lateral = not wanted.isdisjoint(LATERAL)
        needed = topology.enabled & ~topology.counts_only
        upright = topology.wired[CHANNELS.index("bz")] | ~needed
        tabled = p["field_angle_mm"].any(axis=0) | ~needed
        angled = bool((upright & tabled).all())
        if estimator is None:
            estimator = "field-angle" if angled else "sine"
        elif estimator not in ESTIMATORS:
            raise OptionError.unknown("estimator", estimator, ESTIMATORS)
        if estimator == "field-angle":
            _require_bz(topology, upright, "the estimator 'field-angle'")
        if consistency:
            _require_bz(topology, upright, "consistency")
            if not tabled.all():
                unit = topology.unit_names[int(np.argmin(tabled))]
                raise OptionError(f"{unit}: must have 'field_angle_mm' for consistency; got none")
        if temperature_every is None:
            temperature_every = max(1, int(HOLD_S * topology.cycle_rate_hz)) if skip else 1
        elif temperature_every < 1:
            raise OptionError(f"temperature_every: must be 1 or more; got {temperature_every}")

        if sweeps not in (0, 1, 2):
            raise OptionError(f"sweeps: must be 0, 1 or 2; got {sweeps}")
        looped = sweeps > 0 or ambient
        field = ambient or "field" in wanted
        lateral = lateral or looped
        consistent = lateral and (angled if consistency is None else consistency)

        magnet = lateral and (estimator == "sine" or consistent)
        gain = p["hall_gain_per_k"].any() and (magnet or field or sweeps > 0)
        drift = any(p[f"hall_drift_{axis}_ut_per_k"].any() for axis in "xyz")
        chip = bool(gain or drift) and (lateral or field)
        gel, own = (topology.wired[CHANNELS.index(name)] for name in ("gel", "hall_temperature"))
        return cls(
            quantities=quantities,
            sigma="sigma" in wanted,
            estimator=estimator,
            consistency=consistent,
            theta_table=lateral and bool(p["theta_correction_rad"].any()),
            film_centre=lateral and bool(p["film_x_mm"].any() or p["film_y_mm"].any()),
            film_compensation=bool((magnet or sweeps) and (p["film_drift_per_k"] * gel).any()),
            chip_compensation=chip,
            chip_lags=bool(chip and (gel & ~own).any()),
            dtype=_real(dtype),
            temperature_every=temperature_every,
            skip=skip,
            sweeps=sweeps,
            ambient=ambient,
        )

    def __str__(self) -> str:
        """One line for each decision."""
        rows = {
            field.name: getattr(self, field.name) for field in dataclasses.fields(self)
        }  # fmt: skip
        rows["quantities"] = ", ".join(self.quantities) or "none"
        shown = {True: "yes", False: "no"}
        width = max(map(len, rows))
        return "\n".join(
            f"{name.replace('_', ' '):<{width}}  "
            f"{shown[value] if isinstance(value, bool) else value}"
            for name, value in rows.items()
        )


def _require_bz(topology: Topology, upright: np.ndarray, what: str) -> None:
    if not upright.all():
        unit = topology.unit_names[int(np.argmin(upright))]
        raise OptionError(
            f"{unit}: must have 'bz' on the wire for {what}; got a layout without it"
        )  # fmt: skip


def _real(dtype: str) -> str:
    known = ("float32", "float64")
    try:
        found = np.dtype(dtype).name
    except TypeError:
        raise OptionError.unknown("dtype", dtype, known) from None
    if found not in known:
        raise OptionError.unknown("dtype", found, known)
    return found


def _wanted(topology: Topology, want: Collection[str] | None) -> frozenset[str]:
    """The wanted quantities, each known and each with its channels on the wire of every unit."""
    wanted = frozenset(UNIT_WANTS if want is None else [want] if isinstance(want, str) else want)
    for name in sorted(wanted, key=str):
        if name in ARRAY_WANTS:
            raise OptionError(
                f"want: must be of the units, one of {', '.join(map(repr, UNIT_WANTS))}; "
                f"got {name!r}, which is of the array: use skin.open"
            )
        if name not in UNIT_WANTS:
            raise OptionError.unknown("want", name, WANTS)
    needed = topology.enabled & ~topology.counts_only
    for name in UNIT_WANTS:
        for channel in NEEDS[name] if name in wanted else ():
            missing = needed & ~topology.wired[CHANNELS.index(channel)]
            if missing.any():
                unit = topology.unit_names[int(np.argmax(missing))]
                raise OptionError(f"{unit}: must have {channel!r} on the wire to decode {name!r}; "
                                  "got a layout without it")  # fmt: skip
    return wanted
