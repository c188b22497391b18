"""What a scene needs of the decoder: decided once, from the topology and the options.

The estimator `sine` is the paper's, R = asin(|B| / M0) / k (eq. 1); `field-angle` is a polynomial
of psi = atan2(|B|, Bz) and the depth: it has no crest, and neither the temperature of the magnet
nor the gain of the chip is in it.

With `skip`, blocks of 64 units of which none is pressed by more than 2.9 sigma show NaN for all
that is tangential and the flag IDLE. All else is equal to the bit to a decoder without it, except
with `ambient`, which then has fewer readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skin.decode.records import FILM_ABOVE, FORCE_PER_UT, ROWS, SIGMA
from skin.errors import OptionError, check_flag
from skin.options import Options
from skin.state import ARRAY_WANTS, UNIT_WANTS
from topology import CHANNELS, Topology

__all__ = ["LOOK_S", "TANGENTIAL", "Plan", "Wants"]

LOOK_S = 0.05
"""From one look at units without load to the next, for the ambient field [assumed]: a hand that
turns by 1 rad/s has changed 50 µT by 2.5 µT then, less than a reading's noise."""

TANGENTIAL = ("force", "tangential", "theta", "displacement")
FORCES = ("force", "tangential", "theta")
NEEDS = {
    "temperature": ("gel",),
    **dict.fromkeys(TANGENTIAL, ("frequency", "bx", "by")),
    "sigma": (),
    "field": ("bx", "by"),
    "test_ratio": (),
}


class Wants(NamedTuple):
    """What a kernel computes: True, or None for what it leaves out, which the compiler sees by its
    type.

    Attributes
    ----------
    shear : bool or None
        Displacements and forces.
    angle
        R comes from the angle of the field; else from its strength.
    check
        The field is held against its model.
    sigma
        One-sigma of all of it.
    theta, field
        Directions; fields without the gain of the chips.
    correction
        Directions are corrected by tables: a unit has one.
    centre
        Films sit off their chips' axes, which is taken off: a unit has such a film.
    chip
        Temperatures of chips that are not on the wire: they follow the gel.
    """

    shear: bool | None
    angle: bool | None
    check: bool | None
    sigma: bool | None
    theta: bool | None
    field: bool | None
    correction: bool | None
    centre: bool | None
    chip: bool | None


@dataclass(frozen=True, slots=True)
class Plan:
    """What is done in a cycle; plain data.

    Attributes
    ----------
    quantities : tuple of str
        Of `skin.state.UNIT_WANTS`, without "sigma".
    wants : Wants
        What the kernel computes: all that is wanted, and what the loop over cycles needs.
    look_every : int
        Cycles from one estimate of the ambient field to the next; with `skip`, units without load
        are looked at for it alone.
    estimator, consistency, dtype, skip, sweeps, ambient, creep
        As of `skin.options.Options` and `of`, decided; `sweeps` and `ambient` where anything of
        the field is wanted, `creep` where a force is and a unit has terms.
    """

    quantities: tuple[str, ...]
    wants: Wants
    estimator: str
    consistency: bool
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
        p = topology.parameters
        names = _wanted(topology, options.quantities)
        estimator, consistent = _inversion(topology, options.estimator, consistency)
        sweeps, ambient = options.sweeps, options.ambient
        if names.isdisjoint((*TANGENTIAL, "field")):
            sweeps, ambient = 0, False
        shear = sweeps > 0 or ambient or not names.isdisjoint(TANGENTIAL)
        shear = shear or (consistent and "test_ratio" in names)
        relaxes = any(p[f"{law}_creep_relative"].any() for law in ("normal", "shear"))
        computed = dict(
            shear=shear, angle=shear and estimator == "field-angle", check=shear and consistent,
            sigma="sigma" in names, theta="theta" in names, field=ambient or "field" in names,
            correction=shear and p["theta_correction_rad"].any(),
            centre=shear and (p["film_x_mm"].any() or p["film_y_mm"].any()),
            chip=bool((~topology.wired[CHANNELS.index("hall_temperature")] & topology.feels).any()),
        )  # fmt: skip
        return cls(
            quantities=tuple(name for name in UNIT_WANTS if name in names - {"sigma"}),
            wants=Wants(**{name: True if each else None for name, each in computed.items()}),
            estimator=estimator,
            consistency=consistent and shear,
            dtype=options.dtype,
            skip=options.skip,
            look_every=max(1, int(LOOK_S * topology.cycle_rate_hz)) if options.skip else 1,
            sweeps=sweeps,
            ambient=ambient,
            creep=options.creep and bool(relaxes) and not names.isdisjoint(FORCES),
        )

    @property
    def rows(self) -> list[int]:
        """Rows of the results that anyone reads: what is wanted, and what the loop needs."""
        names = {*self.quantities}
        if self.creep:
            names |= {"force", "tangential"}
        if self.sweeps or self.ambient:
            names |= {"displacement"}
        found = {FILM_ABOVE} if self.sweeps else set[int]()
        if None not in (self.wants.shear, self.wants.field, self.wants.sigma):
            found.update(range(FORCE_PER_UT, FORCE_PER_UT + 6))
        for name, (first, count) in ROWS.items():
            if name in names or (self.ambient and name in ("field", "temperature")):
                known = self.wants.sigma is not None and first < SIGMA
                for begin in (first, first + SIGMA) if known else (first,):
                    found.update(range(begin, begin + count))
        return sorted(found)

    @property
    def reads_field(self) -> bool:
        """Whether anything that is decoded needs the field of the chips."""
        looped = self.sweeps > 0 or self.ambient
        return looped or not {*TANGENTIAL, "field"}.isdisjoint(self.quantities)


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
