"""Units decoded as the array that they are: without their neighbours' fields, Earth's, and drift.

A decoder takes a background off the counts; this is where it comes from::

    background = ambient field + zeros (ambient.py) + what neighbours' films add (crosstalk.py)

Both look at what has been decoded, so that they are a cycle old; a second sweep decodes the same
cycle once more, with neighbours where they are now.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from skin.decode.decoder import Decoder
from skin.decode.plan import Plan
from skin.errors import OptionError
from skin.state import UNIT_WANTS, Reading
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.calibrate.stencil import Stencil

__all__ = ["ArrayDecoder"]

SWEEPS_MAX = 8


class ArrayDecoder:
    """Decodes the counts of a skin, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    want, estimator, dtype, consistency, temperature_every, skip
        As of `Decoder`. Cross-talk needs displacements, and ambient fields need fields and
        displacements: they are decoded with it.
    sweeps : int
        How often cross-talk is predicted and taken off in a cycle. 0: not at all. 1: once, from
        where the last cycle put the films, which costs no second decoding. 2: accurate, as the
        films are now.
    ambient : bool
        Take off the ambient field and follow zeros, as `Ambient` does.
    stencil : Stencil, optional
        Of the cross-talk, as calibrated; from magnet theory if not given.

    Attributes
    ----------
    decoder : Decoder
    crosstalk : CrossTalk or None
    ambient : Ambient or None
    plan : Plan

    Raises
    ------
    OptionError, CalibrationError
        As of `Decoder`; or sweeps that are negative or many.
    SkinError
        Units too near to each other for sweeps to converge.

    Examples
    --------
    >>> import topology
    >>> palm = topology.load("palm")
    >>> decoder = ArrayDecoder(palm, want={"force"})
    >>> decoder(np.zeros((6, palm.n), np.int16)).force.shape
    (3, 64)
    """

    def __init__(
        self,
        topology: Topology,
        want: Collection[str] | None = None,
        estimator: str | None = None,
        dtype: str = "float32",
        *,
        sweeps: int = 1,
        ambient: bool = True,
        stencil: Stencil | None = None,
        consistency: bool | None = None,
        temperature_every: int | None = None,
        skip: bool = False,
    ) -> None:
        if not 0 <= sweeps <= SWEEPS_MAX:
            raise OptionError(f"sweeps: must be 0 to {SWEEPS_MAX}; got {sweeps}")
        self.topology = topology
        self.sweeps = sweeps
        self.crosstalk = self.ambient = None
        wanted = set(UNIT_WANTS if want is None else [want] if isinstance(want, str) else want)
        told, rest_ut = topology, None
        if sweeps:
            from skin.decode.crosstalk import ACCURATE_UT, LIVE_UT, CrossTalk

            self.crosstalk = CrossTalk(
                topology, stencil, dtype=dtype, tolerance_ut=LIVE_UT if sweeps == 1 else ACCURATE_UT
            )
            rest_ut = self.crosstalk.stencil.rest_ut
            told = _less_sure(topology, self.crosstalk.residue_ut)
            wanted.add("displacement")
        if ambient:
            from skin.decode.ambient import Ambient

            self.ambient = Ambient(topology, dtype, crosstalk=sweeps > 0)
            wanted |= {"field", "displacement"}
            silent = ~topology.enabled | topology.counts_only
            if (topology.wired[CHANNELS.index("gel")] | silent).all():
                wanted.add("temperature")
        self.decoder = Decoder(
            told, wanted, estimator, dtype, consistency=consistency,
            temperature_every=temperature_every, skip=skip, rest_ut=rest_ut,
        )  # fmt: skip
        self.dtype = self.decoder.dtype
        self._own = np.zeros((4, topology.n), self.dtype)
        self._zero = np.zeros((4, topology.n), self.dtype)
        self._usable = np.zeros(topology.n, bool)
        self.reset()

    @property
    def plan(self) -> Plan:
        """What is compiled and done in a cycle."""
        return self.decoder.plan

    @property
    def estimator(self) -> str:
        """Inversion of the tangential field."""
        return self.decoder.estimator

    def reset(self) -> None:
        """Forget the past: the next cycle is the first."""
        self.decoder.reset()
        if self.ambient is not None:
            self.ambient.reset()
        self._displacement: np.ndarray | None = None

    def warmup(self) -> None:
        """Compile the kernels, or load them; what is remembered stays as it is."""
        self.decoder.warmup(background=self.crosstalk is not None or self.ambient is not None)
        if self.crosstalk is not None:
            self.crosstalk.warmup()
        if self.ambient is not None:
            self.ambient.warmup(self.decoder.reading)

    def __call__(
        self, raw: np.ndarray, status: np.ndarray | None = None, *, dt_s: float | None = None
    ) -> Reading:
        """Decode.

        Parameters
        ----------
        raw, status
            As of `Decoder`.
        dt_s : float, optional
            Since the last cycle; a period if not given.

        Returns
        -------
        Reading
            As of `Decoder`.
        """
        if self.crosstalk is None and self.ambient is None:
            return self.decoder(raw, status)
        if isinstance(raw, np.ndarray) and raw.ndim == 3:
            return self._batch(raw, status, dt_s)
        reading = self.decoder(raw, status, self._background())
        for _ in range(self.sweeps - 1):
            self._remember(reading)
            reading = self.decoder(raw, status, self._background(), advance=False)
        self._remember(reading)
        if self.ambient is not None:
            self.ambient.update(reading, dt_s)
        return reading

    def _background(self) -> np.ndarray:
        """What is taken off, shape (4, n): always the same array."""
        base = self._zero if self.ambient is None else self.ambient.background
        if self.crosstalk is None:
            return base
        own = self._own
        own[0] = base[0]
        if self._displacement is None:
            own[1:] = base[1:]
        else:
            self.crosstalk.predict(self._displacement, self._usable, own[1:], base[1:])
        return own

    def _remember(self, reading: Reading) -> None:
        """Keep where the films are; a view of the decoder's array, which the next cycle reads
        before it is written."""
        self._displacement = reading.displacement_mm
        self._usable = reading.valid

    def _batch(self, raw: np.ndarray, status: np.ndarray | None, dt_s: float | None) -> Reading:
        """Decode consecutive cycles, one after the other, into new arrays."""
        cycles: list[Reading] = []
        for t in range(raw.shape[0]):
            found = self(raw[t], None if status is None else status[t], dt_s=dt_s)
            cycles.append(_copied(found))
        if not cycles:
            return self.decoder(raw, status)
        return Reading(**{
            field.name: None if getattr(cycles[0], field.name) is None
            else np.stack([getattr(cycle, field.name) for cycle in cycles])
            for field in dataclasses.fields(Reading)
        })  # fmt: skip


def _less_sure(topology: Topology, residue_ut: np.ndarray) -> Topology:
    """The topology with what cross-talk leaves in the sigma of the field."""
    p = topology.parameters
    sigma = np.hypot(p["field_sigma_ut"], residue_ut)
    return dataclasses.replace(topology, parameters={**p, "field_sigma_ut": sigma})


def _copied(reading: Reading) -> Reading:
    return Reading(**{
        field.name: None if (value := getattr(reading, field.name)) is None else value.copy()
        for field in dataclasses.fields(Reading)
    })  # fmt: skip
