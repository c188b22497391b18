"""What a scene needs of the decoder: decided once, from the topology and the options.

A plan is what kernels are made of, too: its truth values stand around the stages, not in their
arguments, and what they leave out is cut away before the compiler looks at it.

The estimator `sine` is the paper's, R = asin(|B| / M0) / k (eq. 1); `field-angle` is a polynomial
of psi = atan2(|B|, Bz) and the depth: it has no crest, and neither the temperature of the magnet
nor the gain of the chip is in it.

With `skip`, blocks of 64 units of which none is pressed by more than 2.9 sigma show NaN for all
that is tangential and the flag IDLE. All else is equal to the bit to a decoder without it, except
with `ambient`, which then has fewer readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from skin.decode.records import RESULT_ROWS
from skin.errors import OptionError, check_flag
from skin.options import Options
from skin.state import ARRAY_WANTS, UNIT_WANTS
from topology import CHANNELS, Topology

__all__ = ["LOOK_S", "QUANTITIES", "TANGENTIAL", "Plan"]

LOOK_S = 0.05
"""From one look at units without load to the next, for the ambient field [assumed]: a hand that
turns by 1 rad/s has changed 50 µT by 2.5 µT then, less than a reading's noise."""

TANGENTIAL = ("force", "tangential", "theta", "displacement")
FORCES = ("force", "tangential", "theta")
QUANTITIES = ("temperature", "force", "tangential", "theta", "displacement")
"""That have a sigma, in the order of the kernel's rows."""
NEEDS = {
    "temperature": ("gel",),
    **dict.fromkeys(TANGENTIAL, ("frequency", "bx", "by")),
    "sigma": (),
    "field": ("bx", "by"),
    "test_ratio": (),
}


@dataclass(frozen=True, slots=True)
class Plan:
    """What is compiled and done in a cycle; plain data.

    Attributes
    ----------
    quantities : tuple of str
        Of `skin.state.UNIT_WANTS`, without "sigma".
    results : tuple of str
        What the kernel computes, sigmas among them, in the order of its rows: all that is wanted,
        and what the loop over cycles needs. Zeros are followed only while the temperature is
        steady, where the wire of all units carries it.
    sigma : bool
        One-sigma of each of them, but of the field.
    theta_correction : bool
        Correct directions by tables: a unit has one.
    film_centre : bool
        Take off where films sit off their chips' axes: a unit has such a film.
    cubes : bool
        Force laws stiffen: a unit has one that is more than two lines.
    film_compensation, chip_compensation, chip_lags : bool
        Films, the neighbours' among them, and Hall chip have a drift that matters here; chips
        follow the gel, as the wire does not carry their temperature.
    look_every : int
        Cycles from one estimate of the ambient field to the next; with `skip`, units without load
        are looked at for it alone.
    estimator, consistency, dtype, skip, sweeps, ambient, creep
        As of `skin.options.Options` and `of`, decided; `sweeps` and `ambient` where anything of
        the field is wanted, `creep` where a force is and a unit has terms.
    """

    quantities: tuple[str, ...]
    results: tuple[str, ...]
    sigma: bool
    estimator: str
    consistency: bool
    theta_correction: bool
    film_centre: bool
    cubes: bool
    film_compensation: bool
    chip_compensation: bool
    chip_lags: bool
    dtype: str
    skip: bool
    look_every: int
    sweeps: int
    ambient: bool
    creep: bool

    @classmethod
    def of(
        cls,
        topology: Topology,
        options: Options,
        consistency: bool | None = None,
    ) -> Plan:
        """The shortest plan for a scene.

        Parameters
        ----------
        topology : Topology
        options : Options
            Quantities of units alone are wanted.
        consistency : bool or None
            Compare the field with its model, and flag MAGNETIC_ANOMALY where a magnet or steel
            bends it; it needs Bz and a table, and is done where all units have them if None.

        Raises
        ------
        OptionError
            A quantity of the array is wanted, or the wire of a unit does not carry what is needed.
        """
        from skin.physics.force_law import stiffens  # brings the compiler along

        p = topology.parameters
        names = _wanted(topology, options.quantities)
        estimator, consistent = _inversion(topology, options.estimator, consistency)
        sweeps, ambient = options.sweeps, options.ambient
        if names.isdisjoint((*TANGENTIAL, "field")):
            sweeps, ambient = 0, False
        looped = sweeps > 0 or ambient
        tangential = looped or not names.isdisjoint(TANGENTIAL)
        field = ambient or "field" in names
        tangential = tangential or (consistent and "test_ratio" in names)
        consistent = consistent and tangential

        magnet = tangential and (estimator == "sine" or consistent)
        gain = p["hall_gain_per_k"].any() and (magnet or field or sweeps > 0)
        drift = any(p[f"hall_drift_{axis}_ut_per_k"].any() for axis in "xyz")
        chip = bool(gain or drift) and (tangential or field)
        gel, own = (topology.wired[CHANNELS.index(name)] for name in ("gel", "hall_temperature"))
        relaxes = any(p[f"{law}_creep_relative"].any() for law in ("normal", "shear"))
        film = bool((magnet or sweeps) and (p["film_drift_per_k"] * gel).any())
        relaxed = options.creep and bool(relaxes) and not names.isdisjoint(FORCES)
        return cls(
            quantities=tuple(name for name in UNIT_WANTS if name in names - {"sigma"}),
            results=_results(topology, names, sweeps, ambient, relaxed, film, consistent),
            sigma="sigma" in names,
            estimator=estimator,
            consistency=consistent,
            theta_correction=tangential and bool(p["theta_correction_rad"].any()),
            film_centre=tangential and bool(p["film_x_mm"].any() or p["film_y_mm"].any()),
            cubes=not names.isdisjoint(("force", "tangential")) and stiffens(p),
            film_compensation=film,
            chip_compensation=chip,
            chip_lags=bool(chip and (gel & ~own).any()),
            dtype=options.dtype,
            skip=options.skip,
            look_every=max(1, int(LOOK_S * topology.cycle_rate_hz)) if options.skip else 1,
            sweeps=sweeps,
            ambient=ambient,
            creep=relaxed,
        )

    @property
    def reads_field(self) -> bool:
        """Whether anything that is decoded needs the field of the chips."""
        looped = self.sweeps > 0 or self.ambient
        return looped or not {*TANGENTIAL, "field"}.isdisjoint(self.quantities)

    @property
    def shear(self) -> bool:
        """Whether the tangential displacement is decoded."""
        return not {*TANGENTIAL, "test_ratio"}.isdisjoint(self.results)

    @property
    def angle(self) -> bool:
        """Whether R comes from the angle of the field; else from its strength, if at all."""
        return self.shear and self.estimator == "field-angle"

    @property
    def look(self) -> bool:
        """Whether units without load are looked at all the same, every few cycles: for who follows
        the ambient field."""
        return self.skip and self.ambient

    @property
    def kernel(self) -> Plan:
        """The plan without what a kernel does not look at: one kernel serves all plans that have
        the same."""
        return replace(
            self, quantities=(), dtype="", look_every=1, sweeps=0, ambient=self.look, creep=False,
            estimator="field-angle" if self.angle else "sine",
        )  # fmt: skip

    def row(self, result: str) -> int:
        """The first row of a result among those of the kernel; -1 if it is not computed."""
        row = 0
        for name in self.results:
            if name == result:
                return row
            row += RESULT_ROWS[name]
        return -1

    @property
    def tangential_rows(self) -> tuple[int, ...]:
        """Rows of results that a unit without load does not show: of force and displacement all but
        what is normal."""
        rows: list[int] = []
        for name in self.results:
            row, normal = self.row(name), name.startswith(("force", "displacement"))
            if not name.startswith(("temperature", "film")):
                rows += range(row, row + RESULT_ROWS[name] - normal)
        return tuple(rows)


def _results(
    topology: Topology,
    names: frozenset[str],
    sweeps: int,
    ambient: bool,
    relaxed: bool,
    film: bool,
    consistent: bool,
) -> tuple[str, ...]:
    """Results in the order of the kernel's rows; see `Plan`."""
    computed = set(names)
    computed |= {"force", "tangential"} if relaxed else set()
    computed |= {"displacement"} if sweeps or ambient else set()
    if ambient:
        warm = (topology.wired[CHANNELS.index("gel")] | ~topology.feels).all()
        computed |= {"field", "temperature"} if warm else {"field"}
    plain = tuple(name for name in QUANTITIES if name in computed)
    others = {
        "field": "field" in computed,
        "test_ratio": consistent and "test_ratio" in computed,
        "film_above": sweeps > 0 and film,
    }
    sigmas = (f"{name}_sigma" for name in plain if "sigma" in names)
    return (*plain, *sigmas, *(name for name, is_computed in others.items() if is_computed))


def _inversion(
    topology: Topology, estimator: str | None, consistency: bool | None
) -> tuple[str, bool]:
    """The estimator, and whether the field is held against its model."""
    others = ~topology.feels
    upright = topology.wired[CHANNELS.index("bz")] | others
    tabled = topology.parameters["field_angle_mm"].any(axis=0) | others
    angled = bool((upright & tabled).all())
    if estimator is None:
        estimator = "field-angle" if angled else "sine"
    if estimator == "field-angle":
        _require_bz(topology, upright, "the estimator 'field-angle'")
    if consistency is not None:
        check_flag("consistency", consistency)
    if consistency:
        _require_bz(topology, upright, "consistency")
        if not tabled.all():
            unit = topology.unit_names[int(np.argmin(tabled))]
            raise OptionError(f"{unit}: must have 'field_angle_mm' for consistency; got none")
    return estimator, angled if consistency is None else consistency


def _require_bz(topology: Topology, upright: np.ndarray, what: str) -> None:
    if not upright.all():
        unit = topology.unit_names[int(np.argmin(upright))]
        raise OptionError(
            f"{unit}: must have 'bz' on the wire for {what}; got a layout without it"
        )  # fmt: skip


def _wanted(topology: Topology, found: frozenset[str]) -> frozenset[str]:
    """The wanted quantities, each known and each with its channels on the wire of every unit."""
    for name in sorted(found.intersection(ARRAY_WANTS)):
        raise OptionError(
            f"want: must be of the units, one of {', '.join(map(repr, UNIT_WANTS))}; "
            f"got {name!r}, which is of the array: use skin.open"
        )
    needed = topology.feels
    for name in UNIT_WANTS:
        for channel in NEEDS[name] if name in found else ():
            missing = needed & ~topology.wired[CHANNELS.index(channel)]
            if missing.any():
                unit = topology.unit_names[int(np.argmax(missing))]
                raise OptionError(f"{unit}: must have {channel!r} on the wire to decode {name!r}; "
                                  "got a layout without it")  # fmt: skip
    return found
