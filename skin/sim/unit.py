"""Simulated units: from their true state to counts."""

from __future__ import annotations

import numpy as np

from skin.sim.field import Field, SineField
from skin.sim.hall import HallChip
from skin.sim.truth import Truth
from topology import CHANNELS, Topology
from topology.gel import gel_share

__all__ = ["UnitSimulator"]

GEL, FREQUENCY, BX, BY, BZ, HALL_TEMPERATURE = range(len(CHANNELS))

SQUEEZED = 1e-3
"""Fraction of its frequency at rest below which a timer does not fall: its discs touch."""


class UnitSimulator:
    """Forward model of the n units of a topology, from displacement and temperature to counts.

    Gel current from its law, field from the film's law, and frequency from the gap of the
    capacitor's discs, whose capacitance, 1 over the gap, cancels in the timer's 1 over it; then
    noise, quantisation and the rails of the wire.

    Parameters
    ----------
    topology : Topology
        Its `parameters` are the true ones of the units.
    seed : int
        Seed of the noise.
    noise : bool
        False: quantisation only.
    field : Field, optional
        Field of the film; the paper's sine law if not given.

    Attributes
    ----------
    lowest, highest : ndarray, shape (c, n), int32
        Rails of the counts: the range of the wire's bits; 0 where the wire does not carry the
        channel.
    """

    def __init__(
        self,
        topology: Topology,
        *,
        seed: int = 0,
        noise: bool = True,
        field: Field | None = None,
    ) -> None:
        p = topology.parameters
        self.topology = topology
        self._gel_20c = p["gel_current_20c_ua"]
        self._rest_hz, self._slope_hz = p["frequency_rest_hz"], p["frequency_slope_hz_per_mm"]
        self._field = field or SineField(topology)
        self._hall = HallChip(topology)
        self._gel_noise = p["gel_noise_relative"]
        self._noise = np.stack([p["frequency_noise_hz"], *3 * [p["field_noise_ut"]]])
        self._random = np.random.default_rng(seed) if noise else None
        self._scale = np.where(topology.wired, topology.scale, 1.0)
        self._offset = topology.offset
        self.lowest, self.highest = _rails(topology)

    def quantities(
        self,
        depth_mm: np.ndarray,
        displacement_mm: np.ndarray,
        temperature: np.ndarray,
        film_temperature: np.ndarray | None = None,
        hall_temperature: np.ndarray | None = None,
    ) -> np.ndarray:
        """Physical values of the channels, without noise.

        Parameters
        ----------
        depth_mm : ndarray, shape (..., n)
            Pressed depth H.
        displacement_mm : ndarray, shape (..., 2, n)
            Tangential displacement, unit frame.
        temperature, film_temperature, hall_temperature : ndarray, shape (..., n)
            Degree Celsius; film and Hall chip have the gel's temperature if theirs are not given.

        Returns
        -------
        ndarray, shape (..., c, n)
            Channels as in `topology.CHANNELS`: µA, Hz, µT, °C.
        """
        film = temperature if film_temperature is None else film_temperature
        chip = temperature if hall_temperature is None else hall_temperature
        field = self._hall(self._field(displacement_mm, depth_mm, film), chip)
        values = np.empty((*field.shape[:-2], len(CHANNELS), self.topology.n))
        values[..., GEL, :] = self._gel_20c * gel_share(self.topology.parameters, temperature)
        frequency = self._rest_hz - self._slope_hz * depth_mm
        values[..., FREQUENCY, :] = np.maximum(frequency, SQUEEZED * self._rest_hz)
        values[..., BX : BZ + 1, :] = field
        values[..., HALL_TEMPERATURE, :] = chip
        return values

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """Add the noise of one sample to `values`, shape (..., c, n), in place."""
        if self._random is not None:
            noise = self._random.standard_normal((*values.shape[:-2], BZ + 1, values.shape[-1]))
            values[..., GEL, :] *= 1.0 + self._gel_noise * noise[..., GEL, :]
            values[..., FREQUENCY : BZ + 1, :] += self._noise * noise[..., FREQUENCY:, :]
        return values

    def quantise(self, values: np.ndarray) -> np.ndarray:
        """Counts on the wire, int16: rounded and clipped at the rails. From and to shape (..., c,
        n)."""
        counts = np.rint((values - self._offset) / self._scale)
        return np.clip(counts, self.lowest, self.highest).astype(np.int16)

    def counts(self, truth: Truth) -> np.ndarray:
        """One sample of all units, shape (c, n), int16; (t, c, n) of t instants. See `values`."""
        return self.quantise(self.values(truth))

    def values(self, truth: Truth) -> np.ndarray:
        """One sample of all units on the boards, before the wire rounds it.

        Parameters
        ----------
        truth : Truth
            Of one instant, or stacked of t of them.

        Returns
        -------
        ndarray, shape (c, n) or (t, c, n)
            Physical values of the channels.
        """
        values = self.quantities(
            truth.depth_mm, truth.displacement_mm, truth.temperature, truth.film_temperature,
            truth.hall_temperature,
        )  # fmt: skip
        return self.disturb(values)


def _rails(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest count of each channel and unit, shape (c, n)."""
    lowest = np.zeros((len(CHANNELS), topology.n), np.int32)
    highest = np.zeros_like(lowest)
    frames = topology.frames
    for layout_index, part, units in zip(frames.layout, frames.part, frames.units, strict=True):
        for signal in topology.layouts[layout_index].signals:
            if signal.part != part or signal.name not in CHANNELS or units[signal.slot] < 0:
                continue
            channel = CHANNELS.index(signal.name)
            unit = units[signal.slot]
            lowest[channel, unit], highest[channel, unit] = signal.rails
    return lowest, highest
